"""The doctor's table of shading samples: its columns, its reader, and what the reader refuses (docs/doctor.md).

Rows that both techniques could have drawn are compared, so all of these must be there, or all but those with f = 0.
"""

from __future__ import annotations

import os
import zipfile
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from dmis.base.vectors import Array, Floats
from dmis.bench.samples import SampleTable

LARGE = 2.0**31 - 1
"""Largest number of a pixel or a camera sample."""
FINITE = float(np.finfo(np.float32).max)
"""Largest number that is not infinite."""
UNIT = (-1.01, 1.01)
"""Limits of the coordinates of unit vectors, and 0.01 the largest error of their length."""


class Column(NamedTuple):
    """What a column must be: kind and shape, where R is the number of rows; limits; meaning; what only it can tell."""

    kind: str
    shape: str
    low: float
    high: float
    meaning: str
    tells: str = ""

    def __str__(self) -> str:
        shape = self.shape and f" of shape {self.shape}"
        return f"{self.kind}{shape} from {self.low:,.10g} to {self.high:,.10g}: {self.meaning}"


DRAWN = "how many are drawn for each camera sample; without one technique there is nothing to compare"
DENSITY = "per solid angle, in every row; leave out delta lights and mirrors, which have none"
COLUMNS = {
    "version": Column("a whole number", "", 1, 1, "version of the format"),
    "light_samples": Column("a number", "", 1e-6, FINITE, DRAWN),
    "brdf_samples": Column("a number", "", 1e-6, FINITE, DRAWN),
    "pixel": Column("whole numbers", "(R,)", 0, LARGE, "row x width + column, less than height x width"),
    "camera_sample": Column("whole numbers", "(R,)", 0, LARGE, "number of the camera sample in its pixel, from 0"),
    "technique": Column("whole numbers", "(R,)", -1, 1, "0 light sampling, 1 BRDF sampling, -1 a row to ignore"),
    "f": Column("finite numbers", "(R,) or (R, 3)", -FINITE, FINITE, "BRDF x radiance x cosine x visibility"),
    "p_l": Column("finite numbers", "(R,)", 0, FINITE, DENSITY),
    "p_b": Column("finite numbers", "(R,)", 0, FINITE, DENSITY),
    "light": Column("whole numbers", "(R,)", -LARGE, LARGE, "number of the light", "a fault of one light"),
    "lobe": Column("whole numbers", "(R,)", -LARGE, LARGE, "number of the material", "a fault of one material"),
    "depth": Column("whole numbers", "(R,)", -LARGE, LARGE, "number of the surface on the path", "one of a bounce"),
    "direction": Column("unit vectors", "(R, 3)", *UNIT, "from the surface to the light", "any cosine or sine"),
    "normal": Column("unit vectors", "(R, 3)", *UNIT, "shading normal", "a forgotten cosine of the surface"),
    "geometric_normal": Column("unit vectors", "(R, 3)", *UNIT, "that of the triangle", "confused normals"),
    "light_normal": Column("unit vectors", "(R, 3)", *UNIT, "at the light", "a forgotten cosine of the light"),
    "distance": Column("numbers", "(R,)", 1e-30, np.inf, "to the light, infinite for a sky", "a density per area"),
    "shape": Column("whole numbers", "(2,)", 1, LARGE, "height and width of the image", "a fault in some pixels"),
    "rows": Column("a whole number", "", 0, LARGE, "R, the number of rows"),
    "visible_only": Column("a whole number", "", 0, 1, "1 if rows with f = 0 are not written"),
}
"""All columns: first those that every table has."""
REQUIRED = tuple(COLUMNS)[:9]
GEOMETRY = ("direction", "normal", "geometric_normal", "light_normal", "distance")
LABELS = ("light", "lobe", "depth")
"""Optional columns of whole numbers: which light, which lobe or material, which surface of the path."""


@dataclass(frozen=True, eq=False)
class DoctorTable:
    """Shading samples that both techniques could have drawn, those of a camera sample one after the other.

    Arrays are ``(R,)``: whether light sampling drew the row; f, the mean of its channels; densities times numbers of
    samples, ``a_l = n_l p_l`` and ``a_b = n_b p_b``; numbers of the camera sample, never falling, and of the pixel;
    those of `LABELS` that the table has. `source` has the arrays as they were given, `index` their rows that are here;
    `shape` is ``(H, W)`` of the image, and `notes` are what the reader doubts.
    """

    is_light: Array
    f: Array
    a_l: Floats
    a_b: Floats
    sample: Array
    pixel: Array
    labels: Mapping[str, Array]
    source: Mapping[str, Any]
    index: Array
    shape: tuple[int, int] | None
    notes: tuple[str, ...] = ()

    def __len__(self) -> int:
        return len(self.f)

    def take(self, rows: Array) -> DoctorTable:
        """Return some rows, by their numbers."""
        names = ("is_light", "f", "a_l", "a_b", "sample", "pixel", "index")
        columns = {name: getattr(self, name)[rows] for name in names}
        labels = {name: label[rows] for name, label in self.labels.items()}
        return replace(self, labels=labels, **columns)

    def thinned(self, most: int) -> DoctorTable:
        """Return the rows of every k-th camera sample, numbered anew, k so that they are about `most` at most."""
        k = max(1, -(-len(self) // most))
        some = self.take(np.flatnonzero(self.sample % k == 0))
        return replace(some, sample=some.sample // k)

    def given(self, name: str) -> Array | None:
        """Return a column as it was given; None if the table does not have it."""
        return np.asarray(self.source[name])[self.index] if name in self.source else None


def read_table(source: str | os.PathLike[str] | Mapping[str, Any] | SampleTable) -> DoctorTable:
    """Return the table of an ``.npz`` file, of arrays by name, or of `dmis.samples`.

    Raises
    ------
    ValueError
        If something is missing or cannot be right; the message says which row, and what to write in its place.
    """
    if isinstance(source, SampleTable):
        w, s = float(source.w[0]), source.shading_samples
        of_header = {"version": 1, "light_samples": w * s, "brdf_samples": (1 - w) * s, "shape": source.shape}
        names = (*REQUIRED[3:], "light")
        return _table({name: getattr(source, name) for name in names} | of_header)
    if isinstance(source, Mapping):
        return _table(source)
    try:
        zipfile.ZipFile(source).close()  # numpy would call any other file a pickle
        return _table(np.load(source, allow_pickle=False))
    except (zipfile.BadZipFile, ValueError) as error:
        raise ValueError(f"{source}: {error}. A table is an .npz file of numpy.savez, see docs/doctor.md") from error


def _table(source: Mapping[str, Any]) -> DoctorTable:
    """Return the table of arrays by name."""
    if missing := [name for name in REQUIRED if name not in source]:
        raise ValueError(f"columns {', '.join(missing)} are missing; there are {', '.join(source) or 'none'}")
    count = int(_column(source, "rows")) if "rows" in source else np.size(source["pixel"])
    n_l, n_b, _ = (float(_column(source, name)) for name in ("light_samples", "brdf_samples", "version"))
    columns = {name: _column(source, name, count) for name in REQUIRED[3:]}
    shape = tuple(_column(source, "shape").tolist()) if "shape" in source else None
    if shape is not None and columns["pixel"].max(initial=0) >= shape[0] * shape[1]:
        raise ValueError(f"pixel must be {COLUMNS['pixel']}; got {columns['pixel'].max():,} with shape {shape}")
    technique, f, p_l, p_b = (columns[name] for name in ("technique", "f", "p_l", "p_b"))
    f = f if f.ndim == 1 else f.mean(axis=1)
    _check_values(technique, f, p_l, p_b)
    notes = []
    if unknown := [name for name in source if name not in COLUMNS]:
        notes.append(f"ignored: {', '.join(unknown)}")
    if alone := np.count_nonzero((technique == 1) & (f > 0) & (p_l == 0)):
        notes.append(f"{alone:,} BRDF samples have f > 0 and p_l = 0: right if light sampling cannot draw them")
    common = (technique >= 0) & (p_l > 0) & (p_b > 0)
    occluded = np.bincount(technique[common & (f == 0)], minlength=2)
    visible_only = bool(_column(source, "visible_only")) if "visible_only" in source else not occluded.all()
    # whether f is positive is a function of the direction, so that rows with f = 0 may be left out of all tests
    rows = np.flatnonzero(common & (f > 0) if visible_only else common)
    lights = np.count_nonzero(technique[rows] == 0)
    if lights in (0, len(rows)):
        raise ValueError(
            f"the table must have light samples and BRDF samples in directions that both can draw; of {len(f):,} rows "
            f"{lights:,} light samples and {len(rows) - lights:,} BRDF samples have p_l > 0 and p_b > 0. Write both "
            f"densities into every row"
        )
    columns |= {name: _column(source, name, count, rows) for name in LABELS if name in source}
    for name in filter(source.__contains__, GEOMETRY):
        _column(source, name, count, rows)  # not kept: it is large
    camera_samples = 1 + int(columns["camera_sample"].max())
    key = columns["pixel"][rows].astype(np.int64) * camera_samples + columns["camera_sample"][rows]
    if (np.diff(key) < 0).any():
        order = np.argsort(key, kind="stable")
        rows, key = rows[order], key[order]
    sample = np.concatenate([[0], np.cumsum(np.diff(key) > 0, dtype=np.int32)])
    a_l, a_b = n_l * p_l[rows].astype(float), n_b * p_b[rows].astype(float)
    labels = {name: columns[name][rows] for name in LABELS if name in columns}
    f, pixel = f[rows].astype(np.float32), columns["pixel"][rows]
    table = DoctorTable(technique[rows] == 0, f, a_l, a_b, sample, pixel, labels, source, rows, shape)
    _check_counts(table, n_l, n_b)
    if visible_only and occluded.any():
        notes.append("rows with f = 0 are left out: one technique has none, or the table says visible_only")
    absent = [f"{name} ({column.tells})" for name, column in COLUMNS.items() if column.tells and name not in source]
    if absent:
        notes.append(f"columns that are absent, and what they would tell: {', '.join(absent)}")
    return replace(table, notes=tuple(notes))


def _column(source: Mapping[str, Any], name: str, count: int = 0, rows: Array | slice = slice(None)) -> Array:
    """Return a column of a table of `count` rows; raise a ValueError unless some `rows` are what `COLUMNS` says."""
    column, values = COLUMNS[name], np.asarray(source[name])
    must = f"{name} must be {column}; got"
    if str(values.shape) not in (column.shape or "()").replace("R", str(count)).split(" or "):
        raise ValueError(f"{must} shape {values.shape}, R = {count:,}. Was the file closed by the renderer?")
    if values.dtype.kind not in "biuf":
        raise ValueError(f"{must} values of type {values.dtype}")
    some = np.atleast_1d(values)[rows]
    wrong = np.asarray(~((column.low <= some) & (some <= column.high)))  # and so is NaN
    if "whole" in column.kind:
        wrong |= some != np.floor(some)
    if "unit" in column.kind:
        wrong |= np.abs(np.linalg.norm(some, axis=1, keepdims=True) - 1) > 0.01
    if wrong.any():
        k = int(np.argmax(wrong.reshape(len(some), -1).any(axis=1)))
        row = f" in row {np.arange(count)[rows][k]:,}" if "R" in column.shape else ""
        raise ValueError(f"{must} {some[k]}{row}")
    return values.astype(np.int64) if "whole" in column.kind and values.dtype.kind != "i" else values


def _check_values(technique: Array, f: Array, p_l: Array, p_b: Array) -> None:
    """Raise a ValueError that names the first row with values that contradict each other."""
    own = np.where(technique == 1, p_b, p_l)
    drawn = technique >= 0
    for wrong, text in (
        (f < 0, "f, the mean of its channels, must not be negative"),
        (drawn & (own <= 0) & (f > 0), "the technique drew a direction whose density it calls 0, with f > 0"),
    ):
        if wrong.any():
            row = int(np.argmax(wrong))
            raise ValueError(
                f"{text}; row {row:,} is the first of {np.count_nonzero(wrong):,}: technique {technique[row]}, "
                f"f {f[row]:.4g}, p_l {p_l[row]:.4g}, p_b {p_b[row]:.4g}"
            )


def _check_counts(table: DoctorTable, n_l: float, n_b: float) -> None:
    """Raise a ValueError if a camera sample has more samples of one technique than the header says."""
    some = [table.is_light, table.sample, *(table.labels[name] for name in ("light", "depth") if name in table.labels)]
    rows, counts = np.unique(np.stack([a[: 2**17] for a in some], axis=1), axis=0, return_counts=True)
    for kind, name, n in ((1, "light_samples", n_l), (0, "brdf_samples", n_b)):
        most = counts[rows[:, 0] == kind].max(initial=0)
        if most > np.ceil(n):
            raise ValueError(
                f"{name} is {n:g}, but a camera sample has {most} such rows. Write how many are drawn, count camera "
                f"samples anew in each pixel, and name light and depth if a camera sample has several"
            )
