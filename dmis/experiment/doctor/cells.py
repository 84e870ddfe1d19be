"""What a table tells beside its means: directions, fireflies, and what other shares of samples would save."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dmis.base.vectors import Array, Floats
from dmis.experiment.doctor.causes import p_value
from dmis.experiment.doctor.means import LEAST_SAMPLES
from dmis.experiment.doctor.table import Table

ROWS, COLUMNS = 8, 16
"""Cells of directions: of equal steps of z, and of the angle about z."""
LEAST_SUM = 25.0
"""Weighted rows of one technique in a cell where the other has none, from which on that is no accident."""
PATCH = 8
"""Side of the patches of pixels whose shares could differ."""
TILTS = np.linspace(0.05, 0.95, 19)
"""Shares of light samples that are tried, 1/2 standing for the numbers of samples of the table."""
FEW = 0.001
"""Share of the camera samples that count as fireflies, those of the largest squares."""


@dataclass(frozen=True)
class Directions:
    """Light samples against BRDF samples in cells of directions.

    Attributes
    ----------
    p
        Of chi-square over cells: numbers of rows, and ratios of densities, weighted as in the tests of means.
    missing
        Sentences about cells where one technique has no row though it should.
    """

    p: tuple[float, float]
    missing: tuple[str, ...]


def compare_directions(table: Table) -> Directions | None:
    """Return the comparison of directions; None if the table does not have them."""
    direction = table.geometry("direction")
    if direction is None:
        return None
    row = np.clip((direction[:, 2] + 1) * ROWS / 2, 0, ROWS - 1).astype(np.int64)
    angle = np.arctan2(direction[:, 1], direction[:, 0]) / (2 * np.pi) + 0.5
    cell = row * COLUMNS + np.clip(angle * COLUMNS, 0, COLUMNS - 1).astype(np.int64)
    total = table.a_l + table.a_b
    share = np.where(table.is_light, table.a_b, table.a_l) / total
    ratio = (table.a_l - table.a_b) / total
    p_values = tuple(_chi_square(table, cell, share, weight) for weight in (np.ones_like(ratio), ratio))
    sums = np.stack([_sums(cell, share * side) for side in (table.is_light, ~table.is_light)])
    missing = []
    for k, name in enumerate(("light sampling", "BRDF sampling")):
        for number in np.flatnonzero((sums[k] == 0) & (sums[1 - k] > LEAST_SUM)):
            z, turn = (number // COLUMNS + 0.5) * 2 / ROWS - 1, (number % COLUMNS + 0.5) * 360 / COLUMNS - 180
            missing.append(
                f"{name} never draws directions about z = {z:+.2f}, {turn:+.0f} degrees, though its pdf does"
            )
    return Directions((p_values[0], p_values[1]), tuple(missing))


def _chi_square(table: Table, cell: Array, share: Floats, weight: Floats) -> float:
    """Return the p-value of the sums over cells; a cell's number of rows is Poisson, so that squares are variances."""
    signed = np.where(table.is_light, share, -share) * weight
    difference, variance = _sums(cell, signed), _sums(cell, signed * signed)
    effective = [
        _sums(cell, share * side) ** 2 / np.maximum(_sums(cell, share * share * side), 1e-30)
        for side in (table.is_light, ~table.is_light)
    ]
    trusted = np.minimum(*effective) >= LEAST_SAMPLES
    q = (difference[trusted] ** 2 / variance[trusted]).sum()
    return p_value(int(trusted.sum()), float(q)) if trusted.any() else 1.0


def _sums(cell: Array, values: Floats) -> Floats:
    """Return the sums of values over cells."""
    return np.bincount(cell, values, ROWS * COLUMNS).astype(float)


def firefly_share(table: Table) -> float:
    """Return the part of the sum of squared estimates that the largest `FEW` of the camera samples have."""
    starts = np.flatnonzero(np.diff(table.sample, prepend=-1))
    estimates = np.add.reduceat(table.f / (table.a_l + table.a_b), starts) ** 2
    few = max(1, round(FEW * len(estimates)))
    return float(np.partition(estimates, -few)[-few:].sum() / max(estimates.sum(), 1e-30))


def savings(table: Table) -> float:
    """Return what the best share of each patch would save of the second moment of estimates, judged on other samples.

    The second moment with share t is the sum of ``f^2 / ((t a_l + (1 - t) a_b) (a_l + a_b))``; t is chosen by every
    other camera sample and judged by the rest.
    """
    patch = np.zeros(len(table), np.int64)
    if table.shape is not None:
        row, column = np.divmod(table.pixel.astype(np.int64), table.shape[1])
        patch = row // PATCH * (table.shape[1] // PATCH + 1) + column // PATCH
    patches = int(patch.max()) + 1
    square = table.f.astype(float) ** 2 / (table.a_l + table.a_b)
    halves = patch + patches * (np.unique(table.sample, return_inverse=True)[1] % 2)
    moments = [
        np.bincount(halves, square / (t * table.a_l + (1 - t) * table.a_b), 2 * patches).reshape(2, patches)
        for t in TILTS
    ]
    chosen, judged = np.stack(moments, axis=1)
    best = judged[chosen.argmin(axis=0), np.arange(patches)].sum()
    return float(1 - best / max(judged[len(TILTS) // 2].sum(), 1e-30))
