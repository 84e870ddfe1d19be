"""Atomic writing of files, and checks before a computation that its results can be written."""

from __future__ import annotations

import os
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path


def check_writable(path: str | os.PathLike[str], size: int = 0) -> None:
    """Check that a file of `size` bytes can be written, before its contents are computed.

    An OSError if the directory does not exist or is write-protected, the disk is full, the name is too long, or the
    path is that of a directory; a ValueError if it is not UTF-8.
    """
    path = Path(path)
    try:
        str(path.resolve()).encode()
    except UnicodeEncodeError as error:
        raise ValueError(f"cannot write {os.fsencode(path)!r}: its path must be UTF-8") from error
    folder = path.resolve().parent
    if not folder.is_dir():
        raise FileNotFoundError(f"cannot write {path}: its directory does not exist; create it first")
    if path.is_dir():
        raise IsADirectoryError(f"cannot write {path}: it is a directory")
    if path.exists() and not os.access(path, os.W_OK):  # an error if the name is too long
        raise PermissionError(f"cannot write {path}: it is write-protected")
    if path.exists() and not path.is_file():
        return  # a pipe or a device is written in place
    _check_folder_writable(folder, f"cannot write {path}")
    free = shutil.disk_usage(folder).free
    if free < size:
        raise OSError(
            f"cannot write {path}: it may need {size / 1e6:.1f} MB, and {folder} has {free / 1e6:.1f} MB left"
        )


def check_folder(path: str | os.PathLike[str]) -> None:
    """Check that files can be written into a folder, which may not exist yet, before their contents are computed.

    An OSError if the folder, or the nearest existing one above it, is write-protected or a file.
    """
    path = Path(path)
    nearest = next(folder for folder in (path.resolve(), *path.resolve().parents) if folder.exists())
    if not nearest.is_dir():
        raise NotADirectoryError(f"cannot write into {path}: {nearest} is not a directory")
    _check_folder_writable(nearest, f"cannot write into {path}")


def _check_folder_writable(folder: Path, complaint: str) -> None:
    """Write a byte into a nameless file in a folder; the message of an error begins with `complaint`."""
    try:
        with tempfile.TemporaryFile(dir=folder) as file:
            file.write(b"\0")
    except OSError as error:
        raise type(error)(f"{complaint}: {error.strerror} (in {folder})") from error


def partial_path(path: str | os.PathLike[str]) -> Path:
    """Return a new short path beside `path`, where its content is written before it is moved there."""
    return Path(path).resolve().with_name(f".{os.urandom(8).hex()}.partial")


@contextmanager
def replacing(path: str | os.PathLike[str], called: str = "") -> Iterator[Path]:
    """Yield a path beside `path` to write to, and at the end replace `path` by it in one step.

    An error or an interruption leaves the earlier file as it was. Pipes and devices are written in place. An OSError
    names what is written, `path` or what it is `called`, see `naming`.
    """
    path = Path(path)
    if path.exists() and not path.is_file():
        with naming(called or path):
            yield path
        return
    partial = partial_path(path)
    try:
        with naming(called or path):
            yield partial
            os.replace(partial, path.resolve())  # a symbolic link stays, and its target is replaced
    except BaseException:
        partial.unlink(missing_ok=True)
        raise


@contextmanager
def naming(path: str | os.PathLike[str]) -> Iterator[None]:
    """Name the file that is written in errors of the system, such as that of a full disk; their type stays."""
    try:
        yield
    except OSError as error:
        if error.strerror is None:  # the library's own message
            raise
        raise type(error)(f"cannot write {path}: {error.strerror}") from error
