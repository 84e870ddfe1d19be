"""The diagnosis of a table: verdict, causes, evidence; `dmis.doctor` makes it."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any

from dmis.experiment.bench.samples import SampleTable
from dmis.experiment.doctor.causes import Cause, joint_test, name_causes, smallest_factors
from dmis.experiment.doctor.cells import FEW, Directions, compare_directions, firefly_share, savings
from dmis.experiment.doctor.means import Test, smallest_visible, tests, z_limit
from dmis.experiment.doctor.table import read_table

JOINT_LEVEL = 0.003
"""Level of the joint test in each of both halves of the camera samples."""
DIRECTION_LEVEL = 0.0005
"""Level of each of both comparisons of directions."""
CELL_ROWS = 2_000_000
"""Rows that are compared in cells of directions, and that fireflies and savings are of."""
SHOWN = 6
"""Tests of parts of the rows that the text shows, those of the largest z."""
HINTS = {
    "cos/d^2": "a density per area beside densities per solid angle: it must be times d^2 / cos",
    "cos": "the cosine of the surface is forgotten, or there twice, in this pdf",
    "normals": "one pdf uses the shading normal, the other the geometric one",
    "sin": "the sine of the polar angle is forgotten, or there twice: a sky's pdf is that of its image / (2 pi^2 sin)",
}
"""What a measure tells."""


@dataclass(frozen=True, eq=False)
class Diagnosis:
    """What `dmis.doctor` finds in a table.

    Attributes
    ----------
    tests, limit
        Tests of means, those first that have all rows; the limit of their ``abs(z)``.
    joint
        Larger p-value of the joint test of two halves, see `dmis.experiment.doctor.causes.joint_test`.
    directions
        Comparison in cells of directions; None if the table does not have them.
    causes
        Causes that explain the table, likeliest first; none if nothing is wrong.
    smallest
        By column and rows, relative error of a constant factor that would be named; none if something is wrong.
    rows
        Numbers of rows that were compared: light samples, BRDF samples.
    notes
        Doubts about the table, and what else is worth knowing.
    """

    tests: tuple[Test, ...]
    limit: float
    joint: float
    directions: Directions | None
    causes: tuple[Cause, ...]
    smallest: Mapping[str, float]
    rows: tuple[int, int]
    notes: tuple[str, ...]

    @property
    def alarms(self) -> list[Test]:
        """Trusted tests beyond the limit, the largest z first."""
        beyond = [test for test in self.tests if test.trusted and abs(test.z) > self.limit]
        return sorted(beyond, key=lambda test: -abs(test.z))

    @property
    def healthy(self) -> bool:
        """Whether no fault was found."""
        if self.directions is not None and (self.directions.missing or min(self.directions.p) < DIRECTION_LEVEL):
            return False
        return not self.alarms and self.joint >= JOINT_LEVEL

    def text(self) -> str:
        """Return a page of text: verdict, causes, evidence, notes."""
        return "\n".join(self._lines())

    def _lines(self) -> Iterator[str]:
        """Yield the lines of the text."""
        light, brdf = self.rows
        verdict = "no fault was found" if self.healthy else "densities or f contradict each other"
        yield f"verdict: {verdict}, in {light:,} light samples and {brdf:,} BRDF samples that both could draw"
        if self.causes:
            best = self.causes[0]
            yield ""
            yield "causes that explain it" + (", which give the same table:" if len(self.causes) > 1 else ":")
            for cause in self.causes:
                yield f"  {cause.share:4.0%}  {describe(cause)}"
            yield f"how sure: z = {best.z:.1f}; {_fit_of(best)}"
            yield from (f"  hint: {hint}" for hint in dict.fromkeys(map(hint_of, self.causes)))
        yield ""
        yield "light samples against BRDF samples, and weights w = 1, 0 against 1/2 (docs/doctor.md):"
        yield f"  {'test':8} {'rows':12} {'difference':>10} {'z':>7}  smallest that would be seen"
        of_all = [test for test in self.tests if test.where == "all rows"]
        of_parts = sorted((t for t in self.tests if t.where != "all rows" and t.trusted), key=lambda t: -abs(t.z))
        for test in (*of_all, *of_parts[:SHOWN]):
            seen = f"{smallest_visible(test, self.limit):.1%}" if test.trusted else "too few samples to tell"
            yield f"  {test.name:8} {test.where:12} {test.difference:+10.2%} {test.z:+7.1f}  {seen}"
        yield f"  limit of abs(z): {self.limit:.1f} for {sum(t.trusted for t in self.tests)} tests"
        yield f"  joint test in two halves: p = {self.joint:.2g}, limit {JOINT_LEVEL:g}"
        if self.directions is not None:
            numbers, ratios = self.directions.p
            yield f"  directions: numbers p = {numbers:.2g}, ratios p = {ratios:.2g}, limit {DIRECTION_LEVEL:g}"
            yield from (f"  {sentence}" for sentence in self.directions.missing)
        if self.smallest:
            factors = ", ".join(f"{name} rows {least:.1%}" for name, least in self.smallest.items())
            yield f"smallest constant errors that would be named: {factors}"
        yield from (f"note: {note}" for note in self.notes)


def doctor(table: str | os.PathLike[str] | Mapping[str, Any] | SampleTable) -> Diagnosis:
    """Return what is wrong with multiple importance sampling in a table of shading samples of any renderer.

    Parameters
    ----------
    table
        An ``.npz`` file, arrays by name, or what `dmis.samples` returns. The page docs/doctor.md has its columns.

    Raises
    ------
    ValueError
        If the table cannot be right; the message says which row, and what is allowed.
    """
    rows = read_table(table)
    results = sorted(tests(rows), key=lambda test: test.where != "all rows")
    limit = z_limit(max(1, sum(test.trusted for test in results)))
    joint = joint_test(rows)
    some = rows.thinned(CELL_ROWS)
    directions = compare_directions(some)
    brdf = int((~rows.is_light).sum())
    counts = len(rows) - brdf, brdf
    notes = [*rows.notes, f"{FEW:.1%} of the camera samples have {firefly_share(some):.0%} of the sum of squares"]
    notes.append(f"the best share of each patch would save {max(0, savings(some)):.0%} of the second moment")
    result = Diagnosis(tuple(results), limit, joint, directions, (), {}, counts, tuple(notes))
    if not result.healthy:
        return replace(result, causes=tuple(name_causes(rows)))
    return replace(result, smallest=smallest_factors(rows))


def describe(cause: Cause) -> str:
    """Return a cause as a sentence: the column, the rows, the factor with its interval."""
    rows = {"light": "rows of light samples", "BRDF": "rows of BRDF samples", "all": "all rows"}[cause.rows]
    where = f" of {cause.where}" if cause.where else ""
    measure = f" x {'1 / ' if cause.power < 0 else ''}({cause.measure})" if cause.measure else ""
    factor = f"{cause.factor:.3g} ({cause.low:.3g} to {cause.high:.3g})"
    return f"{cause.column} in {rows}{where} is {factor}{measure} times what it should be"


def hint_of(cause: Cause) -> str:
    """Return where to look for a cause."""
    if cause.measure:
        return HINTS[cause.measure.split(" ")[0]]
    if cause.column == "f":
        return "an emitter or a sky is counted twice, or lost, in one of both branches"
    if cause.rows == "all":
        return (
            "drawn directions do not follow a pdf: a lamp drawn on both sides, 1 / N of lights, the probability of a "
            "lobe. To tell p_l from p_b, integrate each pdf over the sphere: it must be at most 1"
        )
    return "the pdf of a direction differs between the branch that draws it and the other: 1 / N of lights, a constant"


def _fit_of(cause: Cause) -> str:
    """Return how well a cause explains the table."""
    if cause.p < 1e-3:
        return f"it does not explain all (p = {cause.p:.1g}): expect a second fault, or one of another form"
    return f"nothing else is wrong once it is taken out (p = {cause.p:.2g})"
