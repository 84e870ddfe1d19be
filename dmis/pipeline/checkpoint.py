"""Checkpoints: the finished tiles of an image in a file, so that an interrupted render can be resumed.

The file is a log. Each tile is appended as it is finished, as an ``.npz`` archive (arrays and JSON, no pickles) with a
checksum; then the number of complete bytes, at the head of the file, is raised. A process that is killed loses only the
tiles that it had not finished: a record that was half appended is not counted, and the next one overwrites it.
"""

from __future__ import annotations

import fcntl
import io
import json
import os
import zlib
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from dmis.base.atomic_files import replacing
from dmis.pipeline.film import FilmTile

MAGIC = b"dmis checkpoint 3\n"
_NUMBER = 8  # bytes of a length or checksum, little-endian
_START = len(MAGIC) + _NUMBER


class UnusableCheckpoint(ValueError):
    """A checkpoint from which a render cannot be resumed: damaged, of another version, or of a different image."""


class Store:
    """Appends the finished tiles of all passes to a file, and reads them back.

    Parameters
    ----------
    path
        The checkpoint, which is made if it does not exist.
    provenance
        Everything that the tiles depend on, which must be that of the file.

    Raises
    ------
    UnusableCheckpoint
        If the file is not a checkpoint, is damaged, or belongs to another image.
    ValueError
        If another process is using it.
    """

    def __init__(self, path: str | os.PathLike[str], provenance: Mapping[str, Any]) -> None:
        self._places: dict[int, list[int]] = {}
        self._path = Path(path)
        if not self._path.exists():
            key = _pack({"key": dict(provenance)}, {})
            with replacing(self._path) as partial:
                partial.write_bytes(MAGIC + (_START + len(key)).to_bytes(_NUMBER, "little") + key)
        self._file: BinaryIO = open(self._path, "r+b", buffering=0)
        try:
            self._whole = self._read(json.loads(json.dumps(provenance)))
        except BaseException:
            self._file.close()
            raise

    def finished_tiles(self, pass_: int) -> Iterator[FilmTile]:
        """Yield the tiles of a pass that the file had when it was opened."""
        for place in self._places.get(pass_, []):
            yield _tile_of(*self._unpack(place)[:2])

    def append(self, tile: FilmTile) -> None:
        """Append a tile to the file."""
        record = _record(tile)
        self._write(self._whole, record)
        self._whole += len(record)
        self._write(len(MAGIC), self._whole.to_bytes(_NUMBER, "little"))

    def close(self) -> None:
        """Close the file and keep it, so that the render can be resumed."""
        self._file.close()

    def remove(self) -> None:
        """Delete the file, because the image is finished."""
        self._path.unlink(missing_ok=True)
        self._file.close()

    def _write(self, place: int, data: bytes) -> None:
        try:
            while data:  # an unbuffered file may take a part
                written = os.pwrite(self._file.fileno(), data, place)
                place, data = place + written, data[written:]
        except OSError as error:
            raise type(error)(f"cannot write checkpoint {self._path}: {error.strerror}") from error

    def _read(self, provenance: Mapping[str, Any]) -> int:
        """Check the whole file, note where its tiles are, and return the number of complete bytes."""
        try:
            fcntl.lockf(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as error:
            raise ValueError(f"checkpoint {self._path} is in use by another process ({error.strerror})") from error
        head, size = self._file.read(_START), os.fstat(self._file.fileno()).st_size
        name = MAGIC.rpartition(b" ")[0]
        if not head.startswith(name):
            raise UnusableCheckpoint(
                f"checkpoint {self._path} is not readable as one: it does not begin with {name.decode()}"
            )
        if not head.startswith(MAGIC):
            raise UnusableCheckpoint(
                f"checkpoint {self._path} is of another version: {head.splitlines()[0]!r}, and not {MAGIC[:-1]!r}"
            )
        whole = int.from_bytes(head[len(MAGIC) :], "little")
        if size < whole or len(head) < _START:
            raise UnusableCheckpoint(
                f"checkpoint {self._path} is truncated: it has {size} bytes of {whole}; remove it to begin again"
            )
        about, _, place = self._unpack(_START)
        if differences := _differences(about.get("key", {}), provenance):
            raise UnusableCheckpoint(
                f"checkpoint {self._path} belongs to a different image; remove it, or use the same arguments: "
                + "; ".join(differences)
            )
        while place < whole:
            begin = place
            about, _, place = self._unpack(place)
            self._places.setdefault(about["pass"], []).append(begin)
        if place != whole:
            raise UnusableCheckpoint(
                f"checkpoint {self._path} is damaged: a record ends at byte {place}, not at {whole}"
            )
        return whole

    def _unpack(self, place: int) -> tuple[dict[str, Any], dict[str, np.ndarray], int]:
        """Return the JSON and the arrays of the record at byte `place`, and the place of the next record."""
        try:
            self._file.seek(place)
            length, checksum = (int.from_bytes(self._file.read(_NUMBER), "little") for _ in range(2))
            if length > os.fstat(self._file.fileno()).st_size - self._file.tell():
                raise ValueError(f"a length of {length} bytes")
            data = self._file.read(length)
            if zlib.crc32(data) != checksum:
                raise ValueError("the checksum is wrong")
            with np.load(io.BytesIO(data), allow_pickle=False) as archive:
                arrays = dict(archive)
            return json.loads(str(arrays.pop("about"))), arrays, self._file.tell()
        except Exception as error:
            raise UnusableCheckpoint(
                f"checkpoint {self._path} is damaged at byte {place}: {error}; remove it to begin again"
            ) from error


def _record(tile: FilmTile) -> bytes:
    """Return the record of a tile."""
    about = {"pass": tile.pass_, "number": tile.number, "rows": tile.rows, "columns": tile.columns}
    return _pack({**about, "rays": dict(tile.rays)}, {"mean": tile.mean, "root": tile.root, **tile.sums})


def _tile_of(about: Mapping[str, Any], arrays: Mapping[str, np.ndarray]) -> FilmTile:
    """Return the tile of which `_record` made a record."""
    sums = dict(arrays)
    mean, root = sums.pop("mean"), sums.pop("root")
    rows, columns = tuple(about["rows"]), tuple(about["columns"])
    return FilmTile(about["pass"], about["number"], rows, columns, mean, root, about["rays"], sums)


def _pack(about: Mapping[str, Any], arrays: Mapping[str, np.ndarray]) -> bytes:
    """Return a record: its length, its checksum and an ``.npz`` archive of the JSON and the arrays."""
    file = io.BytesIO()
    np.savez(file, about=np.array(json.dumps(about)), **arrays)  # type: ignore[arg-type]
    data = file.getvalue()
    return b"".join(number.to_bytes(_NUMBER, "little") for number in (len(data), zlib.crc32(data))) + data


def _differences(stored: Mapping[str, Any], requested: Mapping[str, Any], prefix: str = "") -> list[str]:
    """Return each difference by name, ``seed is 1 in the checkpoint and 2 in this render``."""
    out = []
    for name in sorted({*stored, *requested}):
        there, here = stored.get(name), requested.get(name)
        if name == "rule_hash" and stored.get("rule") != requested.get("rule"):
            continue  # the text of the rule says it
        if isinstance(there, dict) and isinstance(here, dict):
            out += _differences(there, here, f"{prefix}{name}.")
        elif there != here:
            out.append(f"{prefix}{name} is {there} in the checkpoint and {here} in this render")
    return out
