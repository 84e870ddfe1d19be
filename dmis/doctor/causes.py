"""Causes of a fault: which column, in which rows, by what factor, so that the table would be right without it.

A cause says that a column is `factor` times too large in some rows, or `factor` times a measure, such as cos/d^2 of a
density per area. With the column divided by it, the misfit Q of `dmis.doctor.evidence` must be small. The
factor is that of the least Q, which is chi-square with J - 1 degrees of freedom for the right cause; its 95 % interval
is where Q exceeds its least value by less than 1.96^2. The share of a cause is in proportion to exp(-Q / 2). Causes
that give the same table, such as p_l times 2 and p_b times 1/2 in all rows, have equal shares.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from dmis.base.vectors import Floats
from dmis.doctor.evidence import EXCHANGED, Evidence, gather, misfit, p_value, solve
from dmis.doctor.means import tests
from dmis.doctor.table import DoctorTable

SCREENED, FITTED = 12_000, 200_000
"""Rows by which all causes are compared, and those by which the best are."""
KEPT = 8
"""Causes that are fitted to more rows: so many of the least misfit, and so many constants."""
SHARE, LESS_LIKELY = 0.02, 0.1
"""Least weight of a cause that is listed; weight of one that is not constant everywhere."""
LOG_FACTORS = np.log(2) * np.array([-3, -2, -1, 1, 2, 3])
"""Logarithms of factors that are tried first: those of two are the commonest."""
STEPS, DELTA = 5, 0.01
"""Steps of the search for a factor, and the difference of its logarithm that a slope is taken over."""
SURE, LEAST_Z = 5.0, 3.0
"""Standard errors of a fault that is surely named; least ones of a cause: by chance, the best of many has 2."""
KINDS = {
    "": (("p_l", "p_b", "f"), ""),
    "light": (("p_l", "f"), ""),
    "lobe": (("p_b",), ""),
    "depth": ((), ""),
    "missing": ((), "not drawn, not written, or p_l in BRDF rows (p_b in light rows) of this light is 0"),
    "ratio": ((EXCHANGED,), "both columns are written in the wrong order, or each branch calls its own density p_l"),
    "pdf": (("f",), "f is divided by a density already, or twice: write BRDF x radiance x cosine x visibility"),
    "cos_light": (("p_l",), "the light's cosine is forgotten, or there twice: p_l = d^2 / (area x cos)"),
    "cos/d^2": (("p_l",), "a density per area beside densities per solid angle: it must be times d^2 / cos"),
    "cos": (("p_b",), "the cosine of the surface is forgotten, or there twice, in this pdf"),
    "normals": (("p_b",), "one pdf uses the shading normal, the other the geometric one"),
    "sin": (("p_l",), "the sine of the polar angle is forgotten: a sky's pdf is that of its image / (2 pi^2 sin)"),
}
"""Columns that may have a constant factor, one of a light or lobe, or one with a measure; hints for measures."""
HINTS = {
    "f": "an emitter or a sky is counted twice, or lost, in one of both branches",
    "all": (
        "drawn directions do not follow a pdf: a lamp drawn on both sides, 1 / N of lights, the probability of a lobe. "
        "To tell p_l from p_b, integrate each pdf over the sphere: it must be at most 1"
    ),
    "": "the pdf of a direction differs between the branch that draws it and the other: 1 / N of lights, a constant",
}
"""Hints for constants: of a column, of rows, or of neither."""


@dataclass(frozen=True)
class Cause:
    """A column that is too large by a factor.

    Attributes
    ----------
    column, rows
        ``p_l``, ``p_b`` or ``f``; ``light``, ``BRDF`` or ``all`` rows.
    measure, power
        Name of the measure that the factor is multiplied by, and its exponent, 1 or -1; empty: it is constant.
    where
        ``light 3``: only there; empty: everywhere.
    factor, low, high
        Factor and its 95 % interval.
    misfit, p
        Q, and the probability of a larger one, or of so large a test of means, if the cause is right.
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

    def __str__(self) -> str:
        rows = "all rows" if self.rows == "all" else f"rows of {self.rows} samples"
        where = f" of {self.where}" if self.where else ""
        if self.measure == "missing":
            technique = "light" if self.rows == "BRDF" else "BRDF"
            return f"{technique} samples{where} are missing, though {self.column} in {rows}{where} is positive"
        if self.column == EXCHANGED:
            return f"{self.column} in {rows} are exchanged"
        measure = f" x {'1 / ' if self.power < 0 else ''}({self.measure})" if self.measure else ""
        factor = f"{self.factor:.3g} ({self.low:.3g} to {self.high:.3g})"
        if self.column == "f" and self.rows == "all":  # both techniques share it
            factor = "a constant"
        return f"{self.column} in {rows}{where} is {factor}{measure} times what it should be"

    @property
    def hint(self) -> str:
        """Where to look."""
        if self.measure:
            return KINDS[self.measure.split(" ")[0]][1]
        return HINTS.get(self.column) or HINTS.get(self.rows) or HINTS[""]


def candidates(evidence: Evidence) -> Iterator[Cause]:
    """Yield all causes in question, see `KINDS`."""
    for name in ("", *evidence.labels, *evidence.measures):
        measure = name if name in evidence.measures else ""
        where = "" if measure else name
        techniques = np.unique(evidence.is_light[evidence.labels.get(name, slice(None))])
        if len(techniques) == 1:  # no factor makes rows disappear
            yield Cause(*(("p_b", "light") if techniques[0] else ("p_l", "BRDF")), "missing", where=name)
            continue
        for column in KINDS[name.split(" ")[0]][0]:
            for rows in ("light", "BRDF") if column == "f" and name != "pdf" else ("light", "BRDF", "all"):
                powers = (1, -1) if measure and column != EXCHANGED else (1,)
                yield from (Cause(column, rows, measure, power, where) for power in powers)


def smallest_factors(table: DoctorTable, seed: int = 0) -> dict[str, float]:
    """Return relative errors that would be named, `SURE` standard errors of a constant factor, by column and rows."""
    evidence = gather(table, FITTED, seed)
    everywhere = (cause for cause in candidates(evidence) if not cause.measure and not cause.where)
    return {f"{cause.column} of {cause.rows}": SURE / _newton(evidence, cause)[2] ** 0.5 for cause in everywhere}


def name_causes(table: DoctorTable, seed: int = 0) -> list[Cause]:
    """Return the causes that explain a table, likeliest first; none if no factor is `LEAST_Z` from 1."""
    few, evidence = gather(table, SCREENED, seed), gather(table, FITTED, seed)
    screened = {}
    for cause in candidates(evidence):
        if cause.where not in ("", *few.labels):
            continue
        q = [misfit(*few.moments(cause.column, _shift(few, cause, log_factor))) for log_factor in LOG_FACTORS]
        screened[cause] = _fit(few, cause, [0, LOG_FACTORS[np.argmin(q)]])
    best = sorted(screened, key=lambda cause: screened[cause].misfit)[:KEPT]
    # small faults show in many rows only: gains are by how much a small factor lowers Q
    steps = {cause: _newton(evidence, cause) for cause in candidates(evidence) if not cause.measure}
    gains = {cause: step**2 * curvature for cause, (_, step, curvature) in steps.items()}
    small = sorted(gains, key=lambda cause: -gains[cause])[:KEPT]
    starts = {cause: np.log(screened.get(cause, cause).factor) for cause in (*best, *small)}
    right = misfit(*evidence.moments())
    fitted = (_fit(evidence, cause, [start]) for cause, start in starts.items())
    causes = [cause for cause in fitted if cause.misfit < right - LEAST_Z**2]

    prior = np.array([LESS_LIKELY if cause.measure or cause.where else 1.0 for cause in causes])
    least = min((cause.misfit for cause in causes), default=0)
    share = prior * np.exp([(least - cause.misfit) / 2 for cause in causes])
    weighed = [
        replace(cause, share=s, z=(right - cause.misfit) ** 0.5, p=_p_value(evidence, cause))
        for cause, s in zip(causes, (share / share.sum()).tolist(), strict=True)
        if s >= SHARE
    ]
    return sorted(weighed, key=lambda cause: -cause.share)


def _p_value(evidence: Evidence, cause: Cause) -> float:
    """Return the probability of the misfit once a cause is taken out, or of the largest test of means if it is less."""
    shifted = evidence.shifted(cause.column, _shift(evidence, cause, np.log(cause.factor)))
    f, a_l, a_b = (np.exp(shifted[name]) for name in ("f", "p_l", "p_b"))
    mended = replace(evidence.table, f=f, a_l=a_l, a_b=a_b)
    results = tests(mended.take(np.argsort(mended.sample, kind="stable")))
    sizes = [abs(test.z) for test in results if test.trusted]
    of_largest = p_value(1, max(sizes, default=0) ** 2)
    degrees = len(evidence.functions()[0]) - 1
    return min(len(sizes) * of_largest, p_value(degrees, cause.misfit))


def _shift(evidence: Evidence, cause: Cause, log_factor: float) -> Floats:
    """Return the logarithm by which a cause raises its column, ``(R,)``."""
    shift = np.full(len(evidence.is_light), log_factor, float)
    if cause.measure == "missing":
        shift += 50  # a factor so large takes rows out
    elif cause.measure:
        shift += cause.power * evidence.measures[cause.measure]
    if cause.where:
        shift *= evidence.labels[cause.where]
    if cause.rows != "all":
        shift *= evidence.is_light == (cause.rows == "light")
    return shift


def _newton(evidence: Evidence, cause: Cause, log_factor: float = 0) -> tuple[float, float, float]:
    """Return Q with a factor, the step of its logarithm towards the least Q, and half the second derivative of Q."""
    m, covariance = evidence.moments(cause.column, _shift(evidence, cause, log_factor))
    slope = (evidence.terms(cause.column, _shift(evidence, cause, log_factor + DELTA)).sum(axis=1) - m) / DELTA
    towards = solve(covariance, slope)
    curvature = max(float(towards @ slope), 1e-6)
    return misfit(m, covariance), -float(towards @ m) / curvature, curvature


def _fit(evidence: Evidence, cause: Cause, starts: Iterable[float]) -> Cause:
    """Return the cause with the factor of the least misfit, by Gauss's and Newton's method from each start."""
    tried = []
    for log_factor in starts:
        for _ in range(STEPS):
            q, step, curvature = _newton(evidence, cause, log_factor)
            tried.append((q, log_factor, curvature))
            log_factor += float(np.clip(step, -0.5, 0.5))
    q, log_factor, curvature = min(tried)
    # Q(log factor) ~ least + curvature (log factor - best)^2
    half = 1.96 / np.sqrt(curvature)
    factor, low, high = np.exp(np.clip([log_factor, log_factor - half, log_factor + half], -50, 50)).tolist()
    return replace(cause, factor=factor, low=low, high=high, misfit=q)
