"""Causes of a fault: which column, in which rows, by what factor, so that the table would be right without it.

A cause says that a column is `factor` times too large in some rows, or `factor` times a measure, such as cos/d^2 of a
density per area. With the column divided by it, Equation (1) of `dmis.experiment.doctor.means` must hold for all
functions g at once; here these are `J` bounded ones of the densities, of f, of the geometry and of labels. With the
sums m of their differences and the covariance C of m, the misfit of a cause is::

    Q = min over factor of  m^T C^-1 m                  (Hansen 1982: generalised method of moments)

which is chi-square with J - 1 degrees of freedom for the right one; a factor's 95 % interval is where Q exceeds its
least value by less than `Q_95`. Causes are weighed by exp(-Q / 2) and by how natural they are, `_prior`.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from dmis.base.vectors import Array, Floats
from dmis.experiment.doctor.means import LEAST_SAMPLES
from dmis.experiment.doctor.table import LABELS, Table

SCREENED, FITTED, JOINT = 12_000, 200_000, 400_000
"""Rows by which all causes are compared, those by which the best are, and those of each half that is tested."""
LIGHT_ROWS = 6
"""Light samples kept for each BRDF sample: more would not make differences more certain."""
KEPT = 6
"""Causes that are fitted to more rows: so many of the least misfit, and so many constants."""
SHARE = 0.02
"""Least weight of a cause that is listed."""
LOG_FACTORS = np.log(2) * np.array([0, -1, 1, -2, 2, -3, 3])
"""Logarithms of the factors that are tried first: those of two are the commonest."""
STEPS, DELTA = 4, 0.01
"""Steps of the search for a factor, and the difference of its logarithm that a slope is taken over."""
SURE = 5.0
"""Standard errors of a fault that is sure to be named."""
Q_95 = 3.84
"""95 % quantile of chi-square with one degree of freedom."""
NATURAL = {"cos/d^2": "p_l", "sin": "p_l", "cos": "p_b", "normals": "p_b", "light": "p_l", "lobe": "p_b"}
"""Column whose formula has the measure, or is made for each light or lobe."""


@dataclass(frozen=True)
class Cause:
    """A column that is too large by a factor.

    Attributes
    ----------
    column
        ``p_l``, ``p_b`` or ``f``.
    rows
        ``light``, ``BRDF`` or ``all`` rows.
    measure
        Name of the measure that the factor is multiplied by, see `measures`; empty: it is constant.
    power
        Exponent of the measure, 1 or -1.
    where
        ``light 3``: only there; empty: everywhere.
    factor, low, high
        Factor and its 95 % interval.
    misfit, p
        Q, and the probability of a larger one if the cause is right.
    z
        Root of the difference to Q of no cause: by how many standard errors the cause is there.
    share
        Weight of the cause among all.
    """

    column: str
    rows: str
    measure: str = ""
    power: int = 1
    where: str = ""
    factor: float = 1.0
    low: float = 0.0
    high: float = np.inf
    misfit: float = np.inf
    p: float = 0.0
    z: float = 0.0
    share: float = 0.0


@dataclass(frozen=True, eq=False)
class Evidence:
    """Rows of a table, in the order of the camera samples.

    Attributes
    ----------
    is_light, log_a_l, log_a_b, f, weight, starts
        As in the table; how many rows each stands for; first rows of the camera samples.
    measures
        Logarithms of measures by name, ``(R,)``.
    labels
        Masks of rows by names such as ``light 3``, ``(R,)``.
    """

    is_light: Array
    log_a_l: Floats
    log_a_b: Floats
    f: Floats
    weight: Floats
    starts: Array
    measures: dict[str, Floats]
    labels: dict[str, Array]

    def moments(self, cause: Cause | None, log_factor: float = 0) -> tuple[Floats, Floats]:
        """Return the sums m ``(J,)`` of a table without the cause, and their covariance C."""
        log_a_l, log_a_b, f = self.log_a_l, self.log_a_b, self.f
        if cause is not None:
            shift = self._shift(cause, log_factor)
            log_a_l = log_a_l - shift if cause.column == "p_l" else log_a_l
            log_a_b = log_a_b - shift if cause.column == "p_b" else log_a_b
            f = f * np.exp(-shift) if cause.column == "f" else f
        x = np.tanh((log_a_l - log_a_b) / 2)  # (a_l - a_b) / (a_l + a_b)
        estimate = f * np.exp(-np.logaddexp(log_a_l, log_a_b))
        bounded = estimate / (1 + estimate)
        functions = [np.ones_like(x), x, x * x, bounded, bounded * x, bounded * bounded]
        functions += [np.clip(m - np.median(m), -3, 3) for m in self.measures.values()]
        functions += [mask for mask in self.labels.values() if not mask.all()][1:]  # the first may be 1 less the others
        # a_b / (a_l + a_b) of light samples, -a_l / (a_l + a_b) of BRDF samples
        signed = np.where(self.is_light, 1 - x, -1 - x) * (self.weight / 2)
        d = np.add.reduceat(np.stack(functions) * signed, self.starts, axis=1)
        total = d.sum(axis=1)
        covariance = d @ d.T - np.outer(total, total) / d.shape[1]
        return total, covariance

    def misfit(self, cause: Cause | None, log_factor: float = 0) -> float:
        """Return Q of a cause with a factor; None: of no cause."""
        m, covariance = self.moments(cause, log_factor)
        return float(m @ _solve(covariance, m))

    def _shift(self, cause: Cause, log_factor: float) -> Floats:
        """Return the logarithm of what the column of a cause is too large by, in each row."""
        shift = np.full(len(self.f), log_factor)
        if cause.measure:
            shift += cause.power * self.measures[cause.measure]
        if cause.rows != "all":
            shift *= self.is_light if cause.rows == "light" else ~self.is_light
        return shift * self.labels[cause.where] if cause.where else shift


def joint_test(table: Table, seed: int = 0) -> float:
    """Return the larger of the p-values that two halves of the camera samples have if nothing is wrong.

    A few large samples, to which Q is not chi-square, are in one half only.
    """
    values = []
    for half in (0, 1):
        m, covariance = gather(table, JOINT, seed, half).moments(None)
        values.append(p_value(len(m), float(m @ _solve(covariance, m))))
    return max(values)


def smallest_factors(table: Table, seed: int = 0) -> dict[str, float]:
    """Return relative errors that would be named, `SURE` standard errors of a constant factor, by column and rows."""
    evidence = gather(table, FITTED, seed)
    m, covariance = evidence.moments(None)
    result = {}
    for cause in candidates(evidence):
        if not cause.measure and not cause.where:
            slope = (evidence.moments(cause, DELTA)[0] - m) / DELTA
            result[f"{cause.column} of {cause.rows}"] = SURE / (float(slope @ _solve(covariance, slope)) + 1e-30) ** 0.5
    return result


def name_causes(table: Table, seed: int = 0) -> list[Cause]:
    """Return the causes that explain a table, likeliest first."""
    few, evidence = gather(table, SCREENED, seed), gather(table, FITTED, seed)
    screened = []
    for cause in candidates(few):
        start = min(LOG_FACTORS, key=lambda log_factor: few.misfit(cause, log_factor))
        screened.append(_fit(few, cause, start))
    screened.sort(key=lambda cause: cause.misfit)
    causes = screened[:KEPT]
    # small faults show in many rows only
    constant = [cause for cause in candidates(evidence) if not cause.measure]
    constant.sort(key=lambda cause: -_score(evidence, cause))
    kinds = [(cause.column, cause.rows, cause.measure, cause.power, cause.where) for cause in causes]
    causes += [c for c in constant[:KEPT] if (c.column, c.rows, c.measure, c.power, c.where) not in kinds]
    causes = [_fit(evidence, cause, np.log(cause.factor)) for cause in causes]
    causes += [mirrored for cause in causes for mirrored in _mirrored(cause)]
    values = max(1, len(evidence.labels))
    weight = np.array([np.log(_prior(cause, values)) - cause.misfit / 2 for cause in causes])
    share = np.exp(weight - weight.max())
    right = evidence.misfit(None)
    weighed = [
        replace(cause, share=float(s), z=float(np.sqrt(max(right - cause.misfit, 0))))
        for cause, s in zip(causes, share / share.sum(), strict=True)
    ]
    return sorted((cause for cause in weighed if cause.share >= SHARE), key=lambda cause: -cause.share)


def gather(table: Table, most: int, seed: int, half: int | None = None) -> Evidence:
    """Return about `most` rows at most: some camera samples, with `LIGHT_ROWS` light rows for each BRDF row.

    With a `half`, 0 or 1, they are of every other camera sample.
    """
    rng = np.random.default_rng(seed)
    brdf = len(table) - np.count_nonzero(table.is_light)
    keep = min(1.0, LIGHT_ROWS * brdf / (len(table) - brdf))
    share = min(1.0, most / (brdf + keep * (len(table) - brdf)))
    chosen = rng.random(int(table.sample[-1]) + 1) < share
    if half is not None:
        chosen[1 - half :: 2] = False
    rows = np.flatnonzero(chosen[table.sample] & (~table.is_light | (rng.random(len(table)) < keep)))
    is_light, f, a_l, a_b = (a[rows] for a in (table.is_light, table.f, table.a_l, table.a_b))
    labels: dict[str, Array] = {}
    for label in LABELS:
        if label in table.labels:
            values, counts = np.unique(table.labels[label][rows], return_counts=True)
            for value in values[np.argsort(-counts, kind="stable")][:4] if len(values) > 1 else ():
                of_value = table.labels[label][rows] == value
                if min(np.bincount(is_light[of_value], minlength=2)) >= LEAST_SAMPLES:
                    labels[f"{label} {value}"] = of_value
    estimate = f / (a_l + a_b)
    middle = np.median(estimate[estimate > 0]) if estimate.any() else 1.0
    weight = np.where(is_light, 1 / keep, 1.0)
    starts = np.flatnonzero(np.diff(table.sample[rows], prepend=-1))
    logs = np.log(a_l), np.log(a_b)
    return Evidence(is_light, *logs, f / middle, weight, starts, dict(measures(table, rows)), labels)


def measures(table: Table, rows: Array) -> Iterator[tuple[str, Floats]]:
    """Yield logarithms of what formulas of densities have, by name, as far as the table has columns for it.

    ``cos/d^2`` of the light, 1 of skies; ``cos`` of the shading normal; ``normals``, the geometric normal's cosine
    over that; ``sin z``, the sine of the angle between the direction and an axis, 1 of lights that are not skies.
    """
    direction = table.geometry("direction", rows)
    if direction is None:
        return
    columns = {name: table.geometry(name, rows) for name in ("normal", "geometric_normal", "distance", "light_normal")}
    normal, geometric, distance, of_light = columns.values()
    sky = np.ones(len(rows), bool) if distance is None else np.isinf(distance)
    if distance is not None and of_light is not None and not sky.all():
        yield "cos/d^2", np.where(sky, 0, _log_cos(of_light, direction) - 2 * np.log(np.where(sky, 1, distance)))
    if normal is not None:
        yield "cos", _log_cos(normal, direction)
    if normal is not None and geometric is not None and (normal != geometric).any():
        yield "normals", _log_cos(geometric, direction) - _log_cos(normal, direction)
    for k, axis in enumerate("xyz" if sky.any() else ""):
        yield f"sin {axis}", np.where(sky, np.log(np.maximum(1 - direction[:, k] ** 2, 1e-6)) / 2, 0)


def _log_cos(a: Array, b: Array) -> Floats:
    """Return the logarithm of the absolute cosine between unit vectors, ``(R,)``."""
    return np.log(np.maximum(np.abs(np.einsum("rc,rc->r", a, b, dtype=float)), 1e-6))


def candidates(evidence: Evidence) -> Iterator[Cause]:
    """Yield all causes but those of `_mirrored`, which give the same table as another."""
    for column, rows in (("p_l", "light"), ("p_l", "BRDF"), ("p_l", "all"), ("p_b", "light"), ("p_b", "BRDF")):
        yield Cause(column, rows)
        for measure in evidence.measures:
            yield Cause(column, rows, measure, 1)
            yield Cause(column, rows, measure, -1)
        yield from (Cause(column, rows, where=where) for where in evidence.labels)
    yield from (Cause("f", "BRDF", where=where) for where in ("", *evidence.labels))


def _mirrored(cause: Cause) -> Iterator[Cause]:
    """Yield the cause that gives the same table."""
    inverse = replace(cause, power=-cause.power, factor=1 / cause.factor, low=1 / cause.high, high=1 / cause.low)
    if (cause.column, cause.rows) == ("p_l", "all"):
        yield replace(inverse, column="p_b")
    elif cause.column == "f":
        yield replace(inverse, rows="light")


def p_value(degrees: int, q: float) -> float:
    """Return the probability that chi-square exceeds q."""
    from scipy.special import chdtrc  # imported where used: it takes longer than the rest

    return float(chdtrc(degrees, q))


def _score(evidence: Evidence, cause: Cause) -> float:
    """Return by how much a small factor can lower Q, ``(s^T C^-1 m)^2 / s^T C^-1 s`` with the slope s of m."""
    m, covariance = evidence.moments(None)
    slope = (evidence.moments(cause, DELTA)[0] - m) / DELTA
    towards = _solve(covariance, slope)
    return float(towards @ m) ** 2 / (float(towards @ slope) + 1e-30)


def _solve(covariance: Floats, m: Floats) -> Floats:
    """Return ``C^-1 m``, with a little added to the diagonal: a function may be nearly a sum of others."""
    error = np.sqrt(np.maximum(np.diag(covariance), 1e-30))
    correlation = covariance / np.outer(error, error) + 1e-5 * np.eye(len(error))
    return np.asarray(np.linalg.solve(correlation, m / error) / error)


def _fit(evidence: Evidence, cause: Cause, log_factor: float) -> Cause:
    """Return the cause with the factor of the least misfit, by Gauss's and Newton's method."""
    tried: list[tuple[float, float, float]] = []
    for _ in range(STEPS):
        m, covariance = evidence.moments(cause, log_factor)
        slope = (evidence.moments(cause, log_factor + DELTA)[0] - m) / DELTA
        towards = _solve(covariance, slope)
        curvature = max(float(towards @ slope), 1e-6)
        tried.append((float(m @ _solve(covariance, m)), log_factor, curvature))
        log_factor += float(np.clip(-float(towards @ m) / curvature, -0.5, 0.5))
    tried.append((evidence.misfit(cause, log_factor), log_factor, curvature))
    misfit, log_factor, curvature = min(tried)
    # Q(log factor) ~ least + curvature (log factor - best)^2
    half = np.sqrt(Q_95 / curvature)
    p = p_value(len(m) - 1, misfit)
    factor, low, high = np.exp(np.clip([log_factor, log_factor - half, log_factor + half], -50, 50)).tolist()
    return replace(cause, factor=factor, low=low, high=high, misfit=misfit, p=p)


def _prior(cause: Cause, labels: int) -> float:
    """Return how natural a cause is, 1 if it is a constant everywhere."""
    prior = 1.0
    for kind in filter(None, (cause.measure, cause.where)):
        prior *= 1.0 if NATURAL.get(kind.split(" ")[0]) == cause.column else 0.1
    return prior * (0.1 if cause.measure else 1.0) / (labels if cause.where else 1)
