"""Files that are whole or not there, and a look beforehand at whether they can be written."""

from __future__ import annotations

import os
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path


def check_writable(path: str | os.PathLike[str], size: int = 0) -> None:
    """See that a file of `size` bytes can be written, before work is spent on what is to be in it.

    Raises
    ------
    OSError
        If it cannot: there is no such directory, it may not be written to, there is no room, or the path is taken by
        something that is not a file.
    """
    path = Path(path)
    if path.is_dir():
        raise IsADirectoryError(f"cannot write {path}: it is a directory")
    folder = path.resolve().parent
    if not folder.is_dir():
        raise FileNotFoundError(f"cannot write {path}: its directory does not exist")
    if path.exists() and not os.access(path, os.W_OK):
        raise PermissionError(f"cannot write {path}: it is write-protected")
    if path.exists() and not path.is_file():
        return  # a pipe or a device is written in place
    try:
        with tempfile.TemporaryFile(dir=folder) as file:
            file.write(b"\0")
    except OSError as error:
        raise type(error)(f"cannot write {path}: {error.strerror} (in {folder})") from error
    free = shutil.disk_usage(folder).free
    if free < size:
        raise OSError(f"cannot write {path}: it may need {_mb(size)}, and {folder} has {_mb(free)} left")


def _mb(size: int) -> str:
    return f"{size / 1e6:.1f} MB"


@contextmanager
def replacing(path: str | os.PathLike[str]) -> Iterator[Path]:
    """A path beside `path` to write to; at the end it takes the place of `path`, all at once.

    An error or an interruption on the way leaves what was there before. Pipes and devices are written in place.
    """
    path = Path(path)
    if path.exists() and not path.is_file():
        yield path
        return
    path = path.resolve()  # a link stays, and what it points to is replaced
    partial = path.with_name(f"{path.name}.{os.getpid()}.partial")
    try:
        yield partial
        os.replace(partial, path)
    except BaseException:
        partial.unlink(missing_ok=True)
        raise
