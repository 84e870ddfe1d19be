"""Evidence of a table: sums that are 0 if nothing is wrong, or if a cause is taken out, with their covariance.

Equation (1) of `dmis.doctor.means` must hold for all functions g at once; here these are `J` bounded ones of
the densities, of f, of the geometry and of labels. With the sums m of their differences and the covariance C of m, the
misfit is ``Q = m^T C^-1 m``, chi-square with J degrees of freedom if nothing is wrong (Hansen 1982: generalised method
of moments).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from dmis.base.vectors import Array, Floats
from dmis.doctor.means import LEAST_ROWS, TINIEST, expected_rows
from dmis.doctor.table import GEOMETRY, DoctorTable

JOINT = 400_000
"""Rows of each half that is tested."""
SMALLEST = 1e-5
"""Least variance of a principal component that is tested, and what is added to all variances in a fit."""
LIGHT_ROWS = 6
"""Light samples kept for each BRDF sample: more would not make differences more certain."""
EXCHANGED = "p_l and p_b"
"""What stands for a column if both densities are exchanged: p_l is lowered by a shift, and p_b raised."""
MOST_MASKS = 4
"""Most lights, lobes or depths that have a mask: those of the most rows, but first any that one technique lacks."""


@dataclass(frozen=True, eq=False)
class Evidence:
    """Rows of a table: the first row of each camera sample, then the second rows, and so on.

    `blocks` are the numbers of first, second, ... rows; camera samples with more rows come first. `logs` has
    logarithms of densities (times numbers of samples) and of f, `measures` those of measures by name, and `labels`
    masks by names such as ``light 3``; ``(R,)`` each. `table` has the same rows.
    """

    table: DoctorTable
    is_light: Array
    blocks: Array
    logs: dict[str, Floats]
    measures: dict[str, Floats]
    labels: dict[str, Array]

    @cached_property
    def _fixed(self) -> Floats:
        """Functions of the direction that no factor changes: measures without outliers, and labels."""
        of_direction = (m for name, m in self.measures.items() if name not in ("pdf", "ratio"))
        measures = [np.clip(m - np.median(m), -3, 3) for m in of_direction]
        # the first label may be 1 less the others
        return np.array([*measures, *[*self.labels.values()][1:]]).reshape(-1, len(self.is_light))

    def shifted(self, column: str, shift: Floats | float) -> dict[str, Floats]:
        """Return `logs` with those of a column lowered by `shift`."""
        if column == EXCHANGED:
            return self.logs | {"p_l": self.logs["p_l"] - shift, "p_b": self.logs["p_b"] + shift}
        return self.logs | ({column: self.logs[column] - shift} if column else {})

    def functions(self, column: str = "", shift: Floats | float = 0.0) -> tuple[Floats, Floats]:
        """Return the functions g, ``(J, R)``, with the logarithm of a column lowered by `shift`, and h, ``(R,)``."""
        logs = self.shifted(column, shift)
        x = np.tanh((logs["p_l"] - logs["p_b"]) / 2)  # (a_l - a_b) / (a_l + a_b)
        # max(a_l, a_b) = (a_l + a_b) (1 + |x|) / 2: its logarithm takes a quarter of the time of logaddexp
        estimate = logs["f"] - np.maximum(logs["p_l"], logs["p_b"]) + np.log((1 + np.abs(x)) / 2)
        lit = np.isfinite(estimate)
        middle = estimate[lit].mean() if lit.any() else 0.0
        bounded = 1 / (1 + np.exp(middle - estimate))
        g = np.stack([np.ones_like(x), x, x * x, bounded, bounded * x, bounded * bounded, *self._fixed])
        return g, (1 - x) / 2

    def terms(self, column: str = "", shift: Floats | float = 0.0) -> Floats:
        """Return the terms of the sums m, ``(J, R)``, for the same column and shift."""
        terms, h = self.functions(column, shift)
        terms *= np.where(self.is_light, h, h - 1)
        return terms

    def moments(self, column: str = "", shift: Floats | float = 0.0) -> tuple[Floats, Floats]:
        """Return the sums m of the terms, ``(J,)``, and their covariance C."""
        sums, *blocks = np.split(self.terms(column, shift), np.cumsum(self.blocks)[:-1], axis=1)
        for block in blocks:  # sums over camera samples, in place: several times as fast as np.add.reduceat
            sums[:, : block.shape[1]] += block
        total = sums.sum(axis=1)
        covariance = sums @ sums.T - np.outer(total, total) / sums.shape[1]
        return total, covariance

    def p_value(self) -> float:
        """Return the p-value of Q if nothing is wrong, NaN if too few rows are expected.

        Q is the sum of squares of principal components of m. Only those count that expect `LEAST_ROWS` rows: the
        smallest, differences of functions that are nearly the same, may be decided by a few.
        """
        if self.blocks[0] < LEAST_ROWS:
            return float("nan")
        m, covariance = self.moments()
        error = np.sqrt(np.maximum(np.diag(covariance), TINIEST))
        sizes, axes = np.linalg.eigh(covariance / np.outer(error, error))
        axes /= error[:, None]
        g, h = self.functions()
        expected = [expected_rows(h, component, self.is_light.astype(np.intp), 1)[0] for component in axes.T @ g]
        kept = (np.array(expected) >= LEAST_ROWS) & (sizes > SMALLEST)
        q = float(((axes.T @ m)[kept] ** 2 / sizes[kept]).sum())
        return p_value(int(kept.sum()), q) if kept.any() else float("nan")


def solve(covariance: Floats, m: Floats) -> Floats:
    """Return ``C^-1 m``, with a little added to the diagonal: a function may be nearly a sum of others."""
    error = np.sqrt(np.maximum(np.diag(covariance), 1e-30))
    correlation = covariance / np.outer(error, error) + SMALLEST * np.eye(len(error))
    return np.asarray(np.linalg.solve(correlation, m / error) / error)


def misfit(m: Floats, covariance: Floats) -> float:
    """Return Q."""
    return float(m @ solve(covariance, m))


def p_value(degrees: int, q: float) -> float:
    """Return the probability that chi-square exceeds q."""
    from scipy.special import chdtrc  # imported where used: it takes longer than the rest

    return float(chdtrc(degrees, q))


def joint_test(table: DoctorTable, seed: int = 0) -> float:
    """Return the larger of the p-values that two halves of the camera samples have if nothing is wrong.

    A few large samples, to which Q is not chi-square, are in one half only. NaN if a half expects too few rows to tell.
    """
    return float(np.max([gather(table, JOINT, seed, half).p_value() for half in (0, 1)]))


def gather(table: DoctorTable, most: int, seed: int, half: int | None = None) -> Evidence:
    """Return about `most` rows at most: some camera samples, with `LIGHT_ROWS` light rows for each BRDF row.

    The rest is as if so many fewer light samples were drawn. With a `half`, 0 or 1, rows are of either half of the
    camera samples.
    """
    rng = np.random.default_rng(seed)
    brdf = len(table) - np.count_nonzero(table.is_light)
    keep = min(1.0, LIGHT_ROWS * brdf / (len(table) - brdf))
    share = min(1.0, most / (brdf + keep * (len(table) - brdf)))
    chosen = rng.random(int(table.sample[-1]) + 1) < share
    if half is not None:  # at random: a renderer may draw BRDF samples for every other camera sample alone
        chosen &= (rng.random(len(chosen)) < 0.5) == bool(half)
    rows = np.flatnonzero(chosen[table.sample] & (~table.is_light | (rng.random(len(table)) < keep)))
    starts = np.flatnonzero(np.diff(table.sample[rows], prepend=-1))
    counts = np.diff(starts, append=len(rows))
    rank = np.arange(len(rows)) - np.repeat(starts, counts)  # 0 for the first row of a camera sample
    rows = rows[np.lexsort((-np.repeat(counts, counts), rank))]
    some = table.take(rows)
    is_light, a_l, a_b = some.is_light, keep * some.a_l, some.a_b
    h = a_b / (a_l + a_b)
    labels: dict[str, Array] = {}
    for name, column in some.labels.items():
        values, part = np.unique(column, return_inverse=True)
        side = 2 * part + is_light
        counts = np.bincount(side, minlength=2 * len(values)).reshape(-1, 2)
        last = np.lexsort((counts.sum(axis=1), counts.min(axis=1) == 0))
        enough = expected_rows(h, 1, side, len(values)) >= LEAST_ROWS
        for k in last[enough[last]][-MOST_MASKS:] if len(values) > 1 else ():
            labels[f"{name} {values[k]}"] = part == k
    with np.errstate(divide="ignore"):  # f may be 0
        logs = {"p_l": np.log(a_l), "p_b": np.log(a_b), "f": np.log(some.f)}
    return Evidence(some, is_light, np.bincount(rank, minlength=1), logs, dict(measures(some)), labels)


def measures(table: DoctorTable) -> Iterator[tuple[str, Floats]]:
    """Yield logarithms of what formulas of densities have, by name, as far as the table has columns for it.

    ``pdf`` of the technique that drew the row; ``ratio`` of the densities; ``cos_light`` and ``cos/d^2`` of the light,
    1 of skies; ``cos`` of the shading normal; ``normals``, the geometric normal's cosine over that; ``sin z``, the
    sine of the angle between the direction and an axis, 1 of lights that are not skies.
    """
    log_p_l, log_p_b = (np.log(np.asarray(table.given(name), float)) for name in ("p_l", "p_b"))
    yield "pdf", np.where(table.is_light, log_p_l, log_p_b)
    yield "ratio", log_p_l - log_p_b
    direction, normal, geometric, of_light, distance = map(table.given, GEOMETRY)
    if direction is None:
        return
    sky = np.ones(len(table), bool) if distance is None else np.isinf(distance)
    if distance is not None and of_light is not None and not sky.all():
        cos = np.where(sky, 0, _log_cos(of_light, direction))
        yield "cos_light", cos
        yield "cos/d^2", cos - 2 * np.log(np.where(sky, 1, distance))
    if normal is not None:
        yield "cos", _log_cos(normal, direction)
    if normal is not None and geometric is not None and (normal != geometric).any():
        yield "normals", _log_cos(geometric, direction) - _log_cos(normal, direction)
    for k, axis in enumerate("xyz" if sky.any() else ""):
        yield f"sin {axis}", np.where(sky, np.log(np.maximum(1 - direction[:, k] ** 2, 1e-6)) / 2, 0)


def _log_cos(a: Array, b: Array) -> Floats:
    """Return the logarithm of the absolute cosine between unit vectors, ``(R,)``."""
    return np.log(np.maximum(np.abs(np.einsum("rc,rc->r", a, b, dtype=float)), 1e-6))
