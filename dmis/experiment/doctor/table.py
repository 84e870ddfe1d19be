"""The doctor's table of shading samples: its columns, its reader, and what the reader refuses (docs/doctor.md).

Rows that both techniques could have drawn are compared, so all of these must be there, or all but those with f = 0.
"""

from __future__ import annotations

import os
import zipfile
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from dmis.base.vectors import Array, Floats
from dmis.experiment.bench.samples import SampleTable

VERSION = 1
"""Version of the format."""
COLUMNS = ("pixel", "camera_sample", "technique", "f", "p_l", "p_b")
"""Columns that every table has."""
LABELS = ("light", "lobe", "depth")
"""Optional columns of whole numbers: which light, which lobe or material, which surface of the path."""
MOST_MASS = 3.0
"""Estimated probability, at most 1 but for noise, above which a unit is doubted."""


@dataclass(frozen=True, eq=False)
class Table:
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

    def thinned(self, most: int) -> Table:
        """Return the rows of every k-th camera sample, numbered anew, k so that they are about `most` at most."""
        k = max(1, -(-len(self) // most))
        kept = np.flatnonzero(self.sample % k == 0)
        columns = {name: getattr(self, name)[kept] for name in ("is_light", "f", "a_l", "a_b", "pixel", "index")}
        labels = {name: label[kept] for name, label in self.labels.items()}
        return replace(self, sample=self.sample[kept] // k, labels=labels, **columns)

    def geometry(self, name: str, rows: Array | slice = slice(None)) -> Array | None:
        """Return a column of geometry in some rows, as it was given; None if the table does not have it."""
        return np.asarray(self.source[name])[self.index[rows]] if name in self.source else None


def read_table(source: str | os.PathLike[str] | Mapping[str, Any] | SampleTable) -> Table:
    """Return the table of an ``.npz`` file, of arrays by name, or of `dmis.samples`.

    Raises
    ------
    ValueError
        If something is missing or cannot be right; the message says which row, and what to write in its place.
    """
    if isinstance(source, SampleTable):
        w, s = float(source.w[0]), source.shading_samples
        of_header = {"version": VERSION, "light_samples": w * s, "brdf_samples": (1 - w) * s, "shape": source.shape}
        names = (*COLUMNS, "light")
        return _table({name: getattr(source, name) for name in names} | of_header)
    if isinstance(source, Mapping):
        return _table(source)
    try:
        return _table(np.load(source, allow_pickle=False))
    except (zipfile.BadZipFile, EOFError, ValueError, TypeError) as error:
        raise ValueError(f"{source}: {error}. A table is an .npz file, see docs/doctor.md") from error


def _table(source: Mapping[str, Any]) -> Table:
    """Return the table of arrays by name."""
    if missing := [name for name in ("version", "light_samples", "brdf_samples", *COLUMNS) if name not in source]:
        raise ValueError(f"columns {', '.join(missing)} are missing; there are {', '.join(source) or 'none'}")
    if int(source["version"]) != VERSION:
        raise ValueError(f"version must be {VERSION}; got {source['version']}")
    n_l, n_b = float(source["light_samples"]), float(source["brdf_samples"])
    if not (0 < n_l < np.inf and 0 < n_b < np.inf):
        raise ValueError(
            f"light_samples and brdf_samples, drawn for each camera sample, must be positive: without one there is "
            f"nothing to compare; got {n_l:g} and {n_b:g}"
        )
    columns = {name: np.asarray(source[name]) for name in (*COLUMNS, *LABELS) if name in source}
    _check_lengths(columns, source)
    technique, f, p_l, p_b = (columns[name] for name in ("technique", "f", "p_l", "p_b"))
    f = f if f.ndim == 1 else f.mean(axis=1)
    _check_values(technique, f, p_l, p_b)
    common = (technique >= 0) & (p_l > 0) & (p_b > 0)
    occluded = np.bincount(technique[common & (f == 0)], minlength=2)
    visible_only = bool(source["visible_only"]) if "visible_only" in source else not occluded.all()
    # whether f is positive is a function of the direction, so that rows with f = 0 may be left out of all tests
    rows = np.flatnonzero(common & (f > 0) if visible_only else common)
    lights = np.count_nonzero(technique[rows] == 0)
    if lights in (0, len(rows)):
        raise ValueError(
            f"the table must have light samples and BRDF samples in directions that both can draw; of {len(f):,} rows "
            f"{lights:,} light samples and {len(rows) - lights:,} BRDF samples have p_l > 0 and p_b > 0. Write both "
            f"densities into every row"
        )
    key = columns["pixel"][rows] * np.int64(1 + columns["camera_sample"].max()) + columns["camera_sample"][rows]
    if (np.diff(key) < 0).any():
        order = np.argsort(key, kind="stable")
        rows, key = rows[order], key[order]
    sample = np.concatenate([[0], np.cumsum(np.diff(key) > 0, dtype=np.int32)])
    a_l, a_b = n_l * p_l[rows].astype(float), n_b * p_b[rows].astype(float)
    labels = {name: columns[name][rows] for name in LABELS if name in columns}
    shape = (int(source["shape"][0]), int(source["shape"][1])) if "shape" in source else None
    f, pixel = f[rows].astype(np.float32), columns["pixel"][rows]
    table = Table(technique[rows] == 0, f, a_l, a_b, sample, pixel, labels, source, rows, shape)
    _check_counts(table, n_l, n_b)
    notes = list(_doubts(table))
    if visible_only and occluded.any():
        notes.append("rows with f = 0 are left out: one technique has none, or the table says visible_only")
    return replace(table, notes=tuple(notes))


def _check_lengths(columns: Mapping[str, Array], source: Mapping[str, Any]) -> None:
    """Raise a ValueError if columns are not of one length, which is `rows` if that is given."""
    lengths = {name: len(column) if column.ndim else 0 for name, column in columns.items()}
    rows = int(source["rows"]) if "rows" in source else lengths["pixel"]
    if wrong := {name: length for name, length in lengths.items() if length != rows}:
        counts = ", ".join(f"{name} has {length:,}" for name, length in wrong.items())
        raise ValueError(f"all columns must have {rows:,} rows; {counts}. Was the file closed by the renderer?")


def _check_values(technique: Array, f: Array, p_l: Array, p_b: Array) -> None:
    """Raise a ValueError that names the first row with values that no renderer may have."""
    own = np.where(technique == 1, p_b, p_l)
    drawn = technique >= 0
    for wrong, text in (
        (~np.isin(technique, (-1, 0, 1)), "technique must be 0 (light), 1 (BRDF) or -1 (ignored)"),
        (~np.isfinite(f), "f must be a number: a NaN or infinity in a sample spoils its pixel"),
        (~np.isfinite(p_l + p_b), "densities must be numbers; leave out delta lights and mirrors, which have none"),
        ((p_l < 0) | (p_b < 0), "densities must not be negative"),
        (f < 0, "f, the mean of its channels, must not be negative"),
        (drawn & (own <= 0) & (f > 0), "the technique drew a direction whose density it calls 0, with f > 0"),
    ):
        if wrong.any():
            row = int(np.argmax(wrong))
            raise ValueError(
                f"{text}; row {row:,} is the first of {np.count_nonzero(wrong):,}: technique {technique[row]}, "
                f"f {f[row]:.4g}, p_l {p_l[row]:.4g}, p_b {p_b[row]:.4g}"
            )


def _check_counts(table: Table, n_l: float, n_b: float) -> None:
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


def _doubts(table: Table) -> Iterator[str]:
    """Yield what may be wrong with the table itself, as sentences."""
    lights = len(np.unique(table.labels["light"])) if "light" in table.labels else 1
    draws = lights * (int(table.sample[-1]) + 1)
    ratio = table.a_b / table.a_l
    for drawn, terms, name in ((table.is_light, ratio, "p_b / p_l"), (~table.is_light, 1 / ratio, "p_l / p_b")):
        # E[p_b / p_l] of a light sample = probability that a BRDF sample is one that light sampling can draw <= 1
        mass = terms[drawn].sum() / draws
        if mass > MOST_MASS:
            yield (
                f"the mean of {name} over the rows of the technique below is a probability, but it is {mass:.3g}: is "
                f"one density not per solid angle, or has it a factor too many?"
            )
