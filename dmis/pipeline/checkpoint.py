"""Checkpoints: the finished tiles of an image in a folder, so that an interrupted render can be resumed.

Each tile is a file of its own, an ``.npz`` archive (arrays and JSON, no pickles) that appears in one step. A process
that is killed loses only the tiles that it had not finished. A tile file that cannot be read is rendered again. Several
processes may share a checkpoint, because a tile has the same bits whichever process renders it.
"""

from __future__ import annotations

import io
import json
import os
import re
import shutil
from collections.abc import Iterator, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np

from dmis.base.atomic_files import check_writable, naming, partial_path, replacing
from dmis.pipeline.tile import Tile
from dmis.variance.moments import Film

KEY = "dmis-checkpoint-5.json"
"""File of a checkpoint that says which image its tiles belong to; 5 is the version of the files."""
_OUR_NAMES = re.compile(rf"{re.escape(KEY)}|\d+-\d+\.npz|\.[0-9a-f]+\.partial")


class UnusableCheckpoint(ValueError):
    """A checkpoint from which a render cannot be resumed: damaged, of another version, or of a different image."""


class Store:
    """Writes the finished tiles of all passes into a folder, and reads them back.

    Parameters
    ----------
    path
        The folder, which is made if it does not exist.
    key
        JSON data: everything that the tiles depend on, which must be the key of the checkpoint.
    size
        Bytes that the tiles may need on the disk.

    Raises
    ------
    UnusableCheckpoint
        If the path is no checkpoint, or a checkpoint of another version or another image.
    OSError
        If the folder cannot be written.
    """

    def __init__(self, path: str | os.PathLike[str], key: Mapping[str, Any], size: int = 0) -> None:
        self._folder, self._key = Path(path).resolve(), json.loads(json.dumps(key))
        check_writable(self._folder / KEY if self._folder.is_dir() else self._folder, size)
        self._create()
        if differences := _differences(self._stored_key(), self._key):
            raise UnusableCheckpoint(
                f"checkpoint {self._folder} belongs to a different image; remove it, or use the same arguments: "
                + "; ".join(differences)
            )

    def finished_tiles(self, pass_: int) -> Iterator[tuple[int, Film]]:
        """Yield the numbers and films of the tiles of a pass that are in the folder, but for damaged ones."""
        for path in sorted(self._folder.glob(f"{pass_}-*.npz")):
            with suppress(Exception):  # of zipfile, zlib, json or NumPy, as the damage has it
                yield int(path.stem.partition("-")[2]), _read_film(path)

    def append(self, tile: Tile, film: Film) -> None:
        """Write the film of a tile into the folder, unless another process has finished the image and removed it."""
        about_text = np.array(json.dumps({"rays": film.rays, "sums": list(film.sums)}))
        archive = io.BytesIO()
        np.savez(archive, about=about_text, n=film.n, mean=film.mean, root=film.root, **film.sums)  # type: ignore[arg-type]
        path = self._folder / f"{tile.pass_}-{tile.number}.npz"
        with suppress(FileNotFoundError), replacing(path, f"checkpoint {self._folder}") as partial:
            partial.write_bytes(archive.getbuffer())

    def _create(self) -> None:
        """Make the folder with its key in one step, unless there is something at its path."""
        partial = partial_path(self._folder)
        try:
            with naming(f"checkpoint {self._folder}"):
                partial.mkdir()
                (partial / KEY).write_text(json.dumps(self._key), "utf-8")
            with suppress(OSError):  # a file, or a folder that is not empty: `_stored_key` looks into it
                partial.rename(self._folder)
        finally:
            shutil.rmtree(partial, ignore_errors=True)

    def _stored_key(self) -> dict[str, Any]:
        """Return the key of the checkpoint at the path."""
        try:
            return dict(json.loads((self._folder / KEY).read_text("utf-8")))
        except (OSError, ValueError, TypeError) as error:
            raise UnusableCheckpoint(
                f"{self._folder} is not a checkpoint of this version of dmis, which is a folder with the file {KEY}, "
                f"or is damaged ({error}). Remove it to begin again, or name a path where there is nothing yet"
            ) from error


def remove_checkpoint(path: str | os.PathLike[str]) -> None:
    """Delete a checkpoint, because its image is written; do nothing if there is none.

    Raises
    ------
    ValueError
        If there is something else at the path, or the folder has other files in it: everything is left as it is.
    OSError
        If it cannot be deleted.
    """
    folder, removed = Path(path).resolve(), partial_path(path)
    with suppress(FileNotFoundError):  # another process that shared it has removed it
        names = [] if folder.is_file() else os.listdir(folder)
        if KEY not in names or not all(map(_OUR_NAMES.fullmatch, names)):
            raise ValueError(f"{folder} is not removed: it is not a checkpoint, or has other files in it; remove it")
        folder.rename(removed)  # in one step: a process that shares it writes nothing into it any more
        for _ in range(2):  # a file that such a process was just opening may have been missed
            shutil.rmtree(removed, ignore_errors=True)


def _read_film(path: Path) -> Film:
    """Return the film of a file; raise an exception if it is damaged."""
    with open(path, "rb") as file, np.load(file, allow_pickle=False) as archive:
        arrays = dict(archive)  # which compares checksums
    about = json.loads(str(arrays["about"]))
    sums = {name: arrays[name] for name in about["sums"]}
    n = arrays["n"] if arrays["n"].ndim else int(arrays["n"])
    return Film(n, arrays["mean"], arrays["root"], about["rays"], sums)


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
