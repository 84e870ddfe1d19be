"""Checkpoints: finished tiles of an image, kept in a file, so that interrupted work is not lost.

The file is a log. Each tile is appended as it is finished, as an ``.npz`` archive (arrays and JSON, no pickles) with a
checksum; then a number at the head, how many bytes of the file are whole, is moved on. A process that is killed loses
the tiles that it had not finished, and nothing else: what was appended by halves is not counted, and overwritten.
"""

from __future__ import annotations

import fcntl
import io
import json
import os
import zlib
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from dmis.files import replacing
from dmis.tile import BASE, Rendered, Tile

MAGIC = b"dmis checkpoint 3\n"
_NUMBER = 8  # bytes of a length or checksum, little-endian
_START = len(MAGIC) + _NUMBER


@dataclass(eq=False)
class Pass:
    """What is finished of one pass over the image; `mean` and `root` as in `dmis.variance.Film`."""

    mean: np.ndarray
    root: np.ndarray
    done: np.ndarray
    rays: Counter[str]
    sums: dict[str, np.ndarray]

    def put(self, about: Mapping[str, Any], arrays: Mapping[str, np.ndarray]) -> None:
        """Enter a tile, as `_record` describes it."""
        area = slice(*about["rows"]), slice(*about["columns"])
        self.mean[area], self.root[area] = arrays["mean"], arrays["root"]
        corner = about["rows"][0] // BASE, about["columns"][0] // BASE
        for name, values in arrays.items():
            if name in ("mean", "root"):
                continue
            if name not in self.sums:
                whole = (-(-n // BASE) for n in self.mean.shape[:2])
                self.sums[name] = np.zeros((*values.shape[:-2], *whole))
            rows, columns = (slice(c, c + n) for c, n in zip(corner, values.shape[-2:], strict=True))
            self.sums[name][..., rows, columns] = values
        self.rays.update(about["rays"])
        self.done[about["number"]] = True


class Store:
    """Finished tiles: of the pass that was started last in memory, and of all, if there is a path, in a file.

    Raises
    ------
    ValueError
        If the file is not a checkpoint, is damaged, belongs to another image, or is in use.
    """

    def __init__(self, path: str | os.PathLike[str] | None, provenance: Mapping[str, Any]) -> None:
        self._pass: Pass | None = None
        self._places: dict[int, list[int]] = {}
        self._file: BinaryIO | None = None
        if path is None:
            return
        self._path = Path(path)
        if not self._path.exists():
            key = _pack({"key": dict(provenance)}, {})
            with replacing(self._path) as partial:
                partial.write_bytes(MAGIC + (_START + len(key)).to_bytes(_NUMBER, "little") + key)
        self._file = open(self._path, "r+b", buffering=0)
        try:
            self._whole = self._read(json.loads(json.dumps(provenance)))
        except BaseException:
            self._file.close()
            raise

    def start(self, pass_: int, shape: tuple[int, int, int], tiles: int) -> Pass:
        """A pass, as far as the file has it."""
        self._pass = None  # it is large
        mean, root = (np.zeros(shape, np.float32) for _ in range(2))
        found = Pass(mean, root, np.zeros(tiles, bool), Counter(), {})
        for place in self._places.get(pass_, []):
            found.put(*self._unpack(place)[:2])
        self._pass = found
        return found

    def put(self, tile: Tile, rendered: Rendered) -> None:
        """Enter a tile of the pass."""
        assert self._pass is not None
        about, arrays = _record(tile, rendered)
        if self._file is not None:
            record = _pack(about, arrays)
            self._write(self._whole, record)
            self._whole += len(record)
            self._write(len(MAGIC), self._whole.to_bytes(_NUMBER, "little"))
        self._pass.put(about, arrays)

    def close(self) -> None:
        """Leave the file for another time."""
        if self._file is not None:
            self._file.close()

    def remove(self) -> None:
        """The image is finished: the file has served."""
        if self._file is not None:
            self._path.unlink(missing_ok=True)
            self._file.close()

    def _write(self, place: int, data: bytes) -> None:
        assert self._file is not None
        try:
            while data:  # an unbuffered file may take a part
                written = os.pwrite(self._file.fileno(), data, place)
                place, data = place + written, data[written:]
        except OSError as error:
            raise type(error)(f"cannot write checkpoint {self._path}: {error.strerror}") from error

    def _read(self, provenance: Mapping[str, Any]) -> int:
        """Look through the whole file; how many of its bytes are whole."""
        assert self._file is not None
        try:
            fcntl.lockf(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as error:
            raise ValueError(f"checkpoint {self._path} is in use by another process ({error.strerror})") from error
        head, size = self._file.read(_START), os.fstat(self._file.fileno()).st_size
        name = MAGIC.rpartition(b" ")[0]
        if not head.startswith(name):
            raise ValueError(f"checkpoint {self._path} is not readable as one: it does not begin with {name.decode()}")
        if not head.startswith(MAGIC):
            raise ValueError(
                f"checkpoint {self._path} is of another version: {head.splitlines()[0]!r}, and not {MAGIC[:-1]!r}"
            )
        whole = int.from_bytes(head[len(MAGIC) :], "little")
        if size < whole or len(head) < _START:
            raise ValueError(
                f"checkpoint {self._path} is truncated: it has {size} bytes of {whole}; remove it to begin again"
            )
        about, _, place = self._unpack(_START)
        if differences := _differences(about.get("key", {}), provenance):
            raise ValueError(
                f"checkpoint {self._path} belongs to a different image; remove it, or use the same arguments: "
                + "; ".join(differences)
            )
        while place < whole:
            begin = place
            about, _, place = self._unpack(place)
            self._places.setdefault(about["pass"], []).append(begin)
        if place != whole:
            raise ValueError(f"checkpoint {self._path} is damaged: a record ends at byte {place}, not at {whole}")
        return whole

    def _unpack(self, place: int) -> tuple[dict[str, Any], dict[str, np.ndarray], int]:
        """The record at byte `place`, and where the next one is."""
        assert self._file is not None
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
            raise ValueError(
                f"checkpoint {self._path} is damaged at byte {place}: {error}; remove it to begin again"
            ) from error


def _record(tile: Tile, rendered: Rendered) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
    """What a checkpoint keeps of a tile."""
    where = {"pass": tile.pass_, "number": tile.number, "rows": tile.rows, "columns": tile.columns}
    with np.errstate(over="ignore"):  # what is infinite is refused when the image is whole
        film = [a.astype(np.float32) for a in (rendered.moments.mean, np.sqrt(rendered.moments.m2))]
    return {**where, "rays": dict(rendered.rays)}, {"mean": film[0], "root": film[1], **rendered.sums}


def _pack(about: Mapping[str, Any], arrays: Mapping[str, np.ndarray]) -> bytes:
    file = io.BytesIO()
    np.savez(file, about=np.array(json.dumps(about)), **arrays)  # type: ignore[arg-type]
    data = file.getvalue()
    return b"".join(number.to_bytes(_NUMBER, "little") for number in (len(data), zlib.crc32(data))) + data


def _differences(held: Mapping[str, Any], wanted: Mapping[str, Any], prefix: str = "") -> list[str]:
    """Each difference by name, ``seed is 1 there, and 2 is asked for``."""
    out = []
    for name in sorted({*held, *wanted}):
        there, here = held.get(name), wanted.get(name)
        if isinstance(there, dict) and isinstance(here, dict):
            out += _differences(there, here, f"{prefix}{name}.")
        elif there != here:
            out.append(f"{prefix}{name} is {there} there, and {here} is asked for")
    return out
