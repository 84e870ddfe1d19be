"""Tests of means: what light samples and BRDF samples must agree on if f and both densities are right.

Of n_l light samples and n_b BRDF samples of a camera sample, with ``a_l = n_l p_l`` and ``a_b = n_b p_b``, light
samples count ``a_b / (a_l + a_b)`` times and BRDF samples ``a_l / (a_l + a_b)`` times. Both kinds then have the same
density, ``a_l a_b / (a_l + a_b)``, so that for any function g of the direction::

    E sum g a_b / (a_l + a_b) over light samples = E sum g a_l / (a_l + a_b) over BRDF samples         (1)

g = 1 compares numbers of samples, ``g = (a_l - a_b) / (a_l + a_b)`` ratios of densities, and
``g = f / (a_l + a_b)`` the balance heuristic's estimates. The usual test of MIS, that a mean does not depend on the
weight w, is (1) with ``g = f / a_l`` and ``f / a_b``: w = 1 and w = 0 against w = 1/2. There rows count in which one
density is at most `SPAN` times the other, because a technique alone does not converge in the rest.

Sums over camera samples are independent with mean 0, so that their squares add up to the variance of the total. Few
large ones skew it: z has Hall's correction (Hall, "On the Removal of Skewness by Transformation", 1992, Eq. 2.3).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from statistics import NormalDist
from typing import NamedTuple

import numpy as np

from dmis.base.vectors import Array, Floats
from dmis.experiment.doctor.table import LABELS, Table

LEVEL = 0.01
"""Probability that any test of a right table alarms."""
POWER = 0.9
"""Probability with which the smallest fault is found that a test is said to see."""
SPAN = 8.0
"""Largest ratio of the densities in the tests of w = 0 and w = 1."""
LEAST_SAMPLES = 50.0
"""Least effective number of rows of each technique in a test: of fewer, the sum is not normal."""
LABELS_TESTED, BLOCKS = 8, 4
"""Lights, lobes and depths that are tested apart, those of the most rows; blocks of pixels across and down."""
TINIEST = 1e-100
"""Smallest divisor."""


@dataclass(frozen=True)
class Test:
    """Comparison of light samples with BRDF samples by (1), or of two weights w.

    Attributes
    ----------
    name, where
        What is compared, and in which rows: ``all``, ``light 3``, ``block 1, 2``.
    difference
        Light samples' sum minus that of BRDF samples, over their mean; or that of w = 1 or 0 minus that of w = 1/2.
    error
        Its standard error.
    rows
        Number of rows.
    effective
        Effective number of rows of the technique that has fewer, ``(sum x)^2 / sum x^2`` of the sizes x of its terms.
    skewness
        Of the sum of the differences.
    """

    name: str
    where: str
    difference: float
    error: float
    rows: int
    effective: float
    skewness: float

    @property
    def z(self) -> float:
        """The difference in standard errors, corrected for skewness."""
        t, s = self.difference / self.error, self.skewness
        return t + s * t**2 / 3 + s**2 * t**3 / 27 + s / 6

    @property
    def trusted(self) -> bool:
        """Whether few samples do not decide it."""
        return self.effective >= LEAST_SAMPLES


def z_limit(tests: int) -> float:
    """Return the limit of ``|z|`` of each of so many tests."""
    return -NormalDist().inv_cdf(-np.expm1(np.log1p(-LEVEL) / tests) / 2)


def smallest_visible(test: Test, limit: float) -> float:
    """Return the relative difference that the test finds with probability `POWER`."""
    return (limit + NormalDist().inv_cdf(POWER)) * test.error


def differences(table: Table) -> Iterator[tuple[str, Floats, Floats]]:
    """Yield by test the signed terms of the rows, whose expected sum is 0, and their sizes, ``(R,)`` each."""
    is_light, total = table.is_light, table.a_l + table.a_b
    sign = np.where(is_light, 1.0, -1.0)
    share = np.where(is_light, table.a_b, table.a_l)
    share /= total
    yield "numbers", sign * share, share
    ratio = (table.a_l - table.a_b) / total * share
    yield "ratios", sign * ratio, np.abs(ratio)
    f = table.f / total  # estimate of the balance heuristic
    yield "f", sign * share * f, share * f
    f *= (table.a_l <= SPAN * table.a_b) & (table.a_b <= SPAN * table.a_l)
    # f / a_l - f / (a_l + a_b) = f / (a_l + a_b) a_b / a_l
    for name, drawn, own in (("w = 1", is_light, table.a_l), ("w = 0", ~is_light, table.a_b)):
        alone = np.where(drawn, f * total / own, 0)
        yield name, alone - f, alone + f


def tests(table: Table) -> list[Test]:
    """Return the tests of all rows, of lights, lobes and depths, and of blocks of pixels."""
    groups = [Group("all rows", slice(None), *_sides(table, slice(None))), *_groups(table), *_blocks(table)]
    result = []
    for name, signed, sizes in differences(table):
        result += [_test(name, group, signed[group.rows], sizes[group.rows]) for group in groups]
    return result


class Group(NamedTuple):
    """Rows that are tested apart: name, rows, first rows of camera samples, and 1 for light samples."""

    where: str
    rows: Array | slice
    starts: Array
    is_light: Floats


def _sides(table: Table, rows: Array | slice) -> tuple[Array, Floats]:
    """Return the first rows of camera samples, and 1 for light samples, of some rows."""
    return np.flatnonzero(np.diff(table.sample[rows], prepend=-1)), table.is_light[rows].astype(float)


def _test(name: str, group: Group, signed: Floats, sizes: Floats) -> Test:
    """Return the test of a group's rows."""
    d = np.add.reduceat(signed, group.starts)
    squares = float(d @ d) + TINIEST
    total = float(d.sum())
    size = float(sizes.sum()) / 2 + TINIEST
    error = np.sqrt(max(squares - total**2 / len(d), TINIEST)) / size
    # (sum x)^2 / sum x^2 of light samples, and of BRDF samples: 0 without any
    square = sizes * sizes
    effective = min(
        float(sizes @ side) ** 2 / (float(square @ side) + TINIEST) for side in (group.is_light, 1 - group.is_light)
    )
    skewness = float((d * d) @ d) / squares**1.5
    return Test(name, group.where, total / size, float(error), len(sizes), effective, skewness)


def _groups(table: Table) -> Iterator[Group]:
    """Yield the rows of each light, lobe or depth."""
    for label in LABELS:
        if label in table.labels:
            values, counts = np.unique(table.labels[label], return_counts=True)
            for value in values[np.argsort(-counts, kind="stable")[:LABELS_TESTED]] if len(values) > 1 else ():
                rows = np.flatnonzero(table.labels[label] == value)
                yield Group(f"{label} {value}", rows, *_sides(table, rows))


def _blocks(table: Table) -> Iterator[Group]:
    """Yield the rows of each block of pixels; none without a shape of the image."""
    if table.shape is None:
        return
    height, width = table.shape
    row, column = np.divmod(table.pixel, width)
    block = (row * BLOCKS // height * BLOCKS + column * BLOCKS // width).astype(np.int8)
    for number in np.unique(block):
        rows = np.flatnonzero(block == number)
        yield Group(f"block {number // BLOCKS + 1}, {number % BLOCKS + 1}", rows, *_sides(table, rows))
