"""Tests of means: what light samples and BRDF samples must agree on if f and both densities are right.

Of n_l light samples and n_b BRDF samples of a camera sample, with ``a_l = n_l p_l`` and ``a_b = n_b p_b``, light
samples count ``a_b / (a_l + a_b)`` times and BRDF samples ``a_l / (a_l + a_b)`` times. Both kinds then have the same
density, ``a_l a_b / (a_l + a_b)``, so that for any function g of the direction::

    E sum g a_b / (a_l + a_b) over light samples = E sum g a_l / (a_l + a_b) over BRDF samples         (1)

g = 1 compares numbers of samples, ``g = (a_l - a_b) / (a_l + a_b)`` ratios of densities, and
``g = f / (a_l + a_b)`` the balance heuristic's estimates. The usual test of MIS, that a mean does not depend on the
weight w, is (1) with ``g = f / a_l`` and ``f / a_b``: w = 1 and w = 0 against w = 1/2. There rows count in which one
density is at most `SPAN` times the other, because a technique alone does not converge in the rest.

(1) also holds for the rows of each light, lobe, depth, block of pixels, and cell of directions.

Sums over camera samples are independent with mean 0, so that their squares add up to the variance of the total. Few
large ones skew it: z has Hall's correction (Hall, "On the Removal of Skewness by Transformation", 1992, Eq. 2.3).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import NamedTuple

import numpy as np

from dmis.base.vectors import Array
from dmis.doctor.table import DoctorTable

LEVEL = 0.01
"""Probability that any test of a right table alarms."""
SPAN = 8.0
"""Largest ratio of the densities in the tests of w = 0 and w = 1."""
LEAST_ROWS = 50.0
"""Rows of each technique, and camera samples, that a test must expect at least: of fewer, the sum is not normal."""
BLOCKS = 4
"""Blocks of pixels across and down."""
MOST = 2_000_000
"""Rows of parts that are tested, of every k-th camera sample."""
TURNS, HEIGHTS = 16, 8
"""Cells of directions: of equal angles about the axis z, and of equal steps of z."""
TINIEST = 1e-100
"""Smallest divisor."""


class Test(NamedTuple):
    """Comparison of light samples with BRDF samples by (1).

    `difference` is light samples' sum minus that of BRDF samples over their mean, `error` its standard error, and `z`
    their ratio, corrected for skewness. `expected` is the least of `expected_rows` and the number of camera samples.
    """

    name: str
    where: str
    difference: float
    error: float
    z: float
    rows: int
    expected: float

    @property
    def trusted(self) -> bool:
        """Whether few samples do not decide it."""
        return self.expected >= LEAST_ROWS


def expected_rows(h: Array, g: Array | float, side: Array, parts: int) -> Array:
    """Return the effective number of rows that a test expects of the technique that has fewer, by part, ``(parts,)``.

    It is ``(E sum x)^2 / E sum x^2`` of the terms ``x = g h`` of light samples, ``h = a_b / (a_l + a_b)``, or ``x =
    g (1 - h)`` of BRDF samples. Rows of each technique estimate E sum x^2 of the other, by the sum of
    ``g^2 h (1 - h)``, and so tell of rare rows that did not occur: the largest of all sums counts. `side` is twice the
    part, and 1 more of light samples.
    """
    x = g * np.where(side % 2, h, 1 - h)
    columns = (np.abs(x), x * x, g * g * h * (1 - h))
    sums, own, other = (np.bincount(side, column, 2 * parts).reshape(-1, 2).max(axis=1) for column in columns)
    return np.asarray(sums**2 / (np.maximum(own, other) + TINIEST))


def functions(table: DoctorTable) -> Iterator[tuple[str, Array]]:
    """Yield by test the function g of (1) in each row, ``(R,)``."""
    total = table.a_l + table.a_b
    yield "numbers", np.ones(len(table))
    yield "ratios", (table.a_l - table.a_b) / total
    yield "f", table.f / total  # estimate of the balance heuristic
    near = (table.a_l <= SPAN * table.a_b) & (table.a_b <= SPAN * table.a_l)
    yield "w = 1", np.divide(table.f, table.a_l, out=np.zeros(len(table)), where=near)
    yield "w = 0", np.divide(table.f, table.a_b, out=np.zeros(len(table)), where=near)


def parts(table: DoctorTable) -> Iterator[tuple[list[str], Array]]:
    """Yield names of parts, and the part of each row, ``(R,)``, as far as the table has columns for it."""
    for label, column in table.labels.items():
        values = np.unique(column)
        part = np.searchsorted(values, column)
        yield [f"{label} {value}" for value in values], part.astype(np.min_scalar_type(len(values)))
    if table.shape is not None:
        height, width = table.shape
        row, column = np.divmod(table.pixel, width)
        names = [f"block {i + 1}, {j + 1}" for i in range(BLOCKS) for j in range(BLOCKS)]
        yield names, (row * BLOCKS // height * BLOCKS + column * BLOCKS // width).astype(np.int16)
    direction = table.given("direction")
    if direction is not None:
        x, y, z = direction.T
        step = np.clip((z + 1) / 2 * HEIGHTS, 0, HEIGHTS - 1).astype(np.int16)
        turn = np.clip((np.arctan2(y, x) / (2 * np.pi) + 0.5) * TURNS, 0, TURNS - 1).astype(np.int16)
        heights = (np.arange(HEIGHTS) + 0.5) * 2 / HEIGHTS - 1
        degrees = (np.arange(TURNS) + 0.5) * 360 / TURNS - 180
        yield [f"z {h:+.2f}, {t:+.0f} deg" for h in heights for t in degrees], step * TURNS + turn


def tests(table: DoctorTable) -> list[Test]:
    """Return the tests of all rows, and then of parts: lights, lobes, depths, blocks of pixels, cells of directions."""
    found = list(_tests(table, dict(functions(table)), ["all rows"], np.zeros(len(table), np.int16)))
    some = table.thinned(MOST)
    of_rows = dict(functions(some))
    return found + [test for names, part in parts(some) for test in _tests(some, of_rows, names, part)]


def _tests(table: DoctorTable, of_rows: Mapping[str, Array], names: list[str], part: Array) -> Iterator[Test]:
    """Yield the tests of parts of the rows."""
    order = np.argsort(part, kind="stable")
    part, sample = part[order], table.sample[order]
    starts = np.flatnonzero((np.diff(sample, prepend=-1) != 0) | (np.diff(part, prepend=-1) != 0))
    rows, samples = (np.bincount(a, minlength=len(names)) for a in (part, part[starts]))
    is_light, h = table.is_light[order], (table.a_b / (table.a_l + table.a_b))[order]
    side, signed = 2 * part.astype(np.intp) + is_light, np.where(is_light, h, h - 1)
    for name, function in of_rows.items():
        g = function[order]
        x = g * signed
        d = np.add.reduceat(x, starts)  # of a camera sample in a part
        total, squares, cubes = (np.bincount(part[starts], power, len(names)) for power in (d, d * d, d * d * d))
        expected = np.minimum(samples, expected_rows(h, g, side, len(names)))
        mean = np.bincount(part, np.abs(x), len(names)) / 2 + TINIEST
        error = np.sqrt(np.maximum(squares - total**2 / (table.sample[-1] + 1), TINIEST))
        t, s = total / error, cubes / (squares + TINIEST) ** 1.5
        z = t + s * t**2 / 3 + s**2 * t**3 / 27 + s / 6
        columns = (total / mean, error / mean, z, rows, expected)
        yield from (Test(name, names[k], *(column[k].item() for column in columns)) for k in np.flatnonzero(rows))
