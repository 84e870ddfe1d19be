"""Files of MIS-Bench (docs/mis-bench.md): pilots of a scene and seed, and converged curves of a scene.

Each is an ``.npz`` of plain arrays and a JSON text, ``header``, with a checksum; benchmarks/mis_bench.py makes them.
"""

from __future__ import annotations

import csv
import json
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from dmis.base.patches import PATCH
from dmis.base.validate import number, one_of, pair, whole
from dmis.base.vectors import Array
from dmis.bench.samples import SampleTable
from dmis.experiment.reference import cache_folder

VERSION = 2
"""Version of format and data, raised when either changes: scores of different data are not comparable."""
SCENES: tuple[str, ...] = (
    "teapot-area-light", "killeroo-diffuse", "killeroo-gold", "tt", "veach-mis", "ten-lights", "many-lights",
    "cornell-path",
)  # fmt: skip
"""Scenes of the benchmark."""
FULL = tuple(f"full-{name}" for name in SCENES)
"""The same scenes at the size at which they are meant, as blocks of pixels of the image, see `Truth`."""
GROUPS = 12
"""Groups of blocks, each of every twelfth, whose scatter is the uncertainty due to the choice of blocks."""
SMALL = "small"
"""A scene beside them that comes with dmis, to try a rule out: the teapot in 24x18 pixels, seed 0."""
PACKAGED = (SMALL, "small-killeroo-gold", "small-tt", "small-cornell-path")
"""Scenes that come with dmis: `SMALL`, and three of `SCENES` in 48x36 pixels, seed 0."""
GRID = np.array([0.002, 0.01, 0.03, 0.08, 0.16, 0.27, 0.38], np.float32)
GRID = np.concatenate([GRID, [0.5], 1 - GRID[::-1]]).astype(np.float32)
"""Shares w, and tilts, of the converged curves, ``(G,)``; shares beyond them count as the nearest. One technique alone
may miss a light: that is bias, which no variance tells.
"""
HALF = len(GRID) // 2
"""Index of w = 1/2 in `GRID`."""


@dataclass(frozen=True, eq=False)
class Truth:
    """Converged variance and cost of a camera sample in each patch of `dmis.base.patches.PATCH` pixels.

    Attributes
    ----------
    variance
        By measure, absolute and relative to ``I^2 + 0.01``; by what w is, a share of samples or a tilt of the
        heuristic; and by `GRID`: ``(2, 2, G, rows, columns)``.
    power
        Of one light and one BRDF sample with the power heuristic, by measure, ``(2, rows, columns)``.
    cost
        At the shares of the grid, ``(G, rows, columns)``; at every tilt it is that of w = 1/2.
    shape
        ``(H, W)`` of the image.
    weight
        Pixels that each patch stands for, ``(rows, columns)``: 0 is context, which filters may use; None: its own.
    blocks
        Number of blocks of equal height that are stacked to this image, each cut from a larger one; 1, or a multiple
        of `GROUPS`.
    """

    variance: Array
    power: Array
    cost: Array
    shape: tuple[int, int]
    weight: Array | None = None
    blocks: int = 1

    def split(self) -> list[Truth]:
        """Return the truth of each block, without `weight`."""
        variance, power, cost = (np.split(a, self.blocks, axis=-2) for a in (self.variance, self.power, self.cost))
        shape = self.shape[0] // self.blocks, self.shape[1]
        return [Truth(v, p, c, shape) for v, p, c in zip(variance, power, cost, strict=True)]

    def leave_one_out(self) -> list[Truth]:
        """Return truths without the weight of one of `GROUPS` groups of blocks each; without blocks, itself."""
        if self.weight is None or self.blocks == 1:
            return [self]
        group = np.arange(len(self.weight)) * self.blocks // len(self.weight) % GROUPS
        return [replace(self, weight=self.weight * (group != k)[:, None]) for k in range(GROUPS)]


@dataclass(frozen=True, eq=False)
class Pilots:
    """Pilot tables of one seed by their share w, 0, 1/2 and 1, and feature buffers (`dmis.scene.feature_buffers`)."""

    tables: Mapping[float, SampleTable]
    features: Mapping[str, Array]

    def split(self, blocks: int) -> list[Pilots]:
        """Return the pilots of each of some blocks of equal height, see `Truth`; all have the rays of the mean."""
        features = {name: np.split(values, blocks, axis=1) for name, values in self.features.items()}
        parts = []
        for k in range(blocks):
            tables = {w: _block(table, k, blocks) for w, table in self.tables.items()}
            parts.append(Pilots(tables, {name: values[k] for name, values in features.items()}))
        return parts


def _block(table: SampleTable, k: int, blocks: int) -> SampleTable:
    """Return the rows of one of some blocks of equal height."""
    height, width = table.shape
    pixels = height * width // blocks
    part = table.rows(table.pixel // pixels == k)
    rays = {kind: number // blocks for kind, number in table.rays.items()}
    return replace(part, pixel=part.pixel - k * pixels, shape=(height // blocks, width), rays=rays)


def path_of(scene: str, seed: int | None = None) -> Path:
    """Return the file of a scene's truth, or of its pilots with a seed.

    A scene is a name of `SCENES`, `FULL` or `PACKAGED`, or the path ``NAME.npz`` of the truth of another one, whose
    pilots are in ``NAME-SEED.npz`` beside it. A ValueError for others.
    """
    ending = "" if seed is None else f"-{seed}"
    if scene.endswith(".npz"):
        path = Path(scene)
        return path.with_name(f"{path.stem}{ending}.npz")
    if scene not in (*SCENES, *FULL, *PACKAGED):
        raise ValueError(
            f"scene must be one of {', '.join((*SCENES, *FULL, *PACKAGED))}, or the path of a file NAME.npz "
            f"(docs/mis-bench.md); got {scene!r}"
        )
    folder = Path(__file__).parent if scene in PACKAGED else cache_folder() / f"mis-bench-{VERSION}"
    return folder / f"{scene}{ending}.npz"


def seeds_of(scene: str, seeds: Iterable[int]) -> list[int]:
    """Return the `seeds` of a scene's pilots; except for the benchmark's scenes, only those whose files exist."""
    known = [seed for seed in seeds if scene in SCENES or path_of(scene, seed).exists()]
    if not known:
        raise ValueError(
            f"scene {scene} must have pilots of at least one seed, such as {path_of(scene, 0)}; no file has one of "
            f"the given seeds"
        )
    return known


def read_pilots(path: Path, shape: tuple[int, int] | None = None) -> Pilots:
    """Return the pilots in a file; `shape` is that of the `Truth`, None if there is none.

    A ValueError if the file is not there, damaged, of another version, or a number or an array in it is not right.
    """
    tables = {}
    with _content(path) as (about, arrays):
        for of_pilot in about:
            w, rays, size = number("w", of_pilot["w"], 0, 1), of_pilot["rays"], pair("shape", of_pilot["shape"], whole)
            spp, s = (whole(name, of_pilot[name], 1) for name in ("spp", "shading_samples"))
            # files of earlier commits have rays of colours beside all rays
            rays = {kind: whole(kind, n, 0) for kind, n in rays.items() if " of colour " not in kind}
            whole("number of camera rays", rays["camera"], 1)
            shape = one_of("shape of all pilots and of the converged variances", size, [shape or size])
            ends = {"w": float(np.float32(w)), "last camera sample": spp - 1, "last shading sample": s - 1}
            columns: dict[str, Any] = _checked("pilot", arrays, shape, ends, f"{w} ")
            tables[w] = SampleTable(**columns, shape=shape, spp=spp, shading_samples=s, rays=rays)
        if not shape or not tables:
            raise ValueError(f"about must be a list with an entry for each pilot; got {about}")
        buffers = _checked("features", arrays, shape)
    return Pilots(tables, {name.removeprefix("feature "): a.astype(np.float32) for name, a in buffers.items()})


def read_truth(path: Path) -> Truth:
    """Return the converged curves in a file; errors are those of `read_pilots`."""
    with _content(path) as (about, arrays):
        height, width = pair("the first two numbers of about, H and W,", about[:2], partial(whole, least=1))
        blocks = whole("the third number of about, blocks,", about[2] if len(about) > 2 else 1, 1)
        if blocks > 1 and (blocks % GROUPS or height % (blocks * PATCH)):
            raise ValueError(
                f"blocks must be 1, or a multiple of {GROUPS}, {PATCH} n pixels high; got {blocks} in {height}"
            )
        curves: dict[str, Any] = _checked("curves", arrays, (height, width))
        free = (curves["cost"] == 0).any(axis=0) & (curves.get("weight", 1) > 0)
        if free.any():
            y, x = np.argwhere(free)[0].tolist()
            raise ValueError(f"array 'cost' must be above 0 in patches of a weight above 0; got 0 in patch ({y}, {x})")
    return Truth(**{name: a.astype(np.float64) for name, a in curves.items()}, shape=(height, width), blocks=blocks)


@contextmanager
def _content(path: Path) -> Iterator[tuple[Any, dict[str, np.ndarray]]]:
    """Give what the header of a file says about its arrays, and these; errors that come from them name the file."""
    if not path.exists():
        make = "Make it in a checkout of dmis: python benchmarks/mis_bench.py (ten minutes)"
        raise ValueError(f"there is no {path}. {make}, or try --scenes {SMALL}")
    try:
        with open(path, "rb") as file, np.load(file, allow_pickle=False) as archive:
            arrays = dict(archive)
        header = json.loads(str(arrays.pop("header")))
        about = header["about"]
        intact = header["mis-bench"] == VERSION and header["checksum"] == checksum(arrays)
    except Exception:  # a damaged archive may raise anything
        intact = False
    if not intact:
        reason = "it is damaged, or its SHA-256 is not that in its header"
        raise ValueError(f"{path} must be a file of MIS-Bench {VERSION}; {reason}. Remove it and make it again")
    try:
        yield about, arrays
    except (ValueError, TypeError, KeyError, AttributeError) as error:
        reason = str(error) if isinstance(error, ValueError) else f"its header lacks something ({error!r})"
        raise ValueError(f"{path}: {reason}; docs/mis-bench.md lists what a file must hold") from error


def _checked(
    part: str, arrays: Mapping[str, Array], shape: tuple[int, int], ends: Mapping[str, float] = {}, prefix: str = ""
) -> dict[str, Array]:
    """Return the arrays of a part of a file, as the table ``arrays.csv`` has them.

    Parameters
    ----------
    part
        Of the table: ``curves``, ``features`` or ``pilot``.
    shape
        ``(H, W)`` of the image. Letters are sizes: R, C those of its patches, G that of `GRID`, others any.
    ends
        Values of names in the columns ``least`` and ``largest``.
    prefix
        Of the names of the arrays in the file.

    Raises
    ------
    ValueError
        If an array is missing, or its shape, kind or range is not that of the table.
    """
    (height, width), checked = shape, {}
    ends = {**ends, "last pixel": height * width - 1}
    sizes = {"2": 2, "3": 3, "G": len(GRID), "R": -(-height // PATCH), "C": -(-width // PATCH)}
    for row in csv.DictReader(Path(__file__).with_name("arrays.csv").read_text("utf-8").splitlines()):
        name, letters = prefix + row["array"], row["shape"].split()
        if row["part"] != part or (row["optional"] and name not in arrays):
            continue
        array = arrays.get(name, np.zeros(0))
        sizes = dict(zip(letters, array.shape, strict=False)) | sizes
        expected = tuple(sizes.get(letter) for letter in letters)
        low, high = (float(ends.get(end, end)) for end in (row["least"], row["largest"]))
        fits = array.size > 0 and array.shape == expected and np.issubdtype(array.dtype, getattr(np, row["numbers"]))
        least, largest = (float(array.min()), float(array.max())) if fits else (np.nan, np.nan)
        if not (low <= least and largest <= high and np.isfinite(largest - least)):
            raise ValueError(
                f"array {name!r} must have shape ({row['shape']}) = {expected} and finite {row['numbers']} values from "
                f"{low:g} to {high:g}; got shape {array.shape}, {array.dtype}, from {least:g} to {largest:g}"
            )
        checked[row["array"]] = array
    return checked


def checksum(arrays: Mapping[str, np.ndarray]) -> str:
    """Return the SHA-256 of the names and bytes of arrays, in the order of their names."""
    import hashlib  # imported where used: it brings OpenSSL

    return hashlib.sha256(b"".join(name.encode() + arrays[name].tobytes() for name in sorted(arrays))).hexdigest()
