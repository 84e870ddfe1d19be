"""The diagnosis of a table: verdict, causes, evidence; `dmis.diagnose` makes it, as text and as a page."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from html import escape
from statistics import NormalDist
from typing import Any

import numpy as np

from dmis.bench.samples import SampleTable
from dmis.doctor.causes import Cause, name_causes, smallest_factors
from dmis.doctor.evidence import joint_test
from dmis.doctor.means import LEAST_ROWS, LEVEL, Test, tests
from dmis.doctor.table import read_table

UNEXPLAINED = 1e-3
"""Probability of a misfit below which a cause does not explain a table."""
BEYOND = "drawn directions that do not follow their pdf, such as radius = u for sqrt(u) on a disk, "
BEYOND += "a factor in some materials or in one lobe of a mixture, or two faults"
"""Faults that no single factor explains."""
WEIGHTS_UNSEEN = "the renderer's own weights are not seen: the doctor computes weights itself"
JOINT_LEVEL = 0.003
"""Level of the joint test in each of both halves of the camera samples."""
SHOWN, SHOWN_ON_PAGE = 6, 60
"""Tests of parts of the rows that the text shows, and the page, those of the largest z."""
STYLE = "body{font:15px sans-serif;max-width:60em;margin:2em auto}td,th{padding:2px 9px;text-align:left}"
STYLE += "pre{white-space:pre-wrap}.bad{background:#c33}.ok{background:#693}.few{background:#aaa}"


@dataclass(frozen=True, eq=False)
class Diagnosis:
    """What `dmis.diagnose` finds in a table.

    Attributes
    ----------
    tests, limit
        Tests of means, those first that have all rows; the limit of their ``abs(z)``.
    joint
        Larger p-value of two halves, see `dmis.doctor.evidence.joint_test`; NaN if they are too small.
    rows
        Numbers of rows that were compared: light samples, BRDF samples.
    notes
        Doubts about the table, and what absent columns would tell.
    causes
        Causes that explain the table, likeliest first; none if nothing is wrong, or if no factor explains it.
    smallest
        By column and rows, relative error of a constant factor that would be named; none if something is wrong.
    """

    tests: tuple[Test, ...]
    limit: float
    joint: float
    rows: tuple[int, int]
    notes: tuple[str, ...]
    causes: tuple[Cause, ...] = ()
    smallest: Mapping[str, float] = field(default_factory=dict)

    @property
    def healthy(self) -> bool:
        """Whether no fault was found."""
        beyond = any(test.trusted and abs(test.z) > self.limit for test in self.tests)
        return not (beyond or self.joint < JOINT_LEVEL)

    def largest(self, count: int) -> list[Test]:
        """Return the tests of all rows, and so many trusted ones of parts, those of the largest z."""
        of_parts = (test for test in self.tests if test.trusted and test.where != "all rows")
        of_all = [test for test in self.tests if test.where == "all rows"]
        return of_all + sorted(of_parts, key=lambda test: -abs(test.z))[:count]

    def text(self) -> str:
        """Return a page of text: verdict, causes, evidence, notes."""
        light, brdf = self.rows
        verdict = "no fault was found" if any(test.trusted for test in self.tests) else "too few rows to tell"
        if not self.healthy:
            unknown = not self.causes or self.causes[0].p < UNEXPLAINED
            verdict = f"{'no single factor explains it: ' * unknown}densities or f contradict each other"
        first = f"verdict: {verdict}, in {light:,} light samples and {brdf:,} BRDF samples that both could draw"
        notes = (f"note: {note}" for note in self.notes)
        return "\n".join([first, *self._explanation(), "", *self._evidence(), *notes])

    def _explanation(self) -> Iterator[str]:
        """Yield lines about the causes."""
        if not self.causes:
            yield WEIGHTS_UNSEEN if self.healthy else f"  hint: {BEYOND}; or a fault too small to be named"
            return
        best = self.causes[0]
        head = f"causes that explain it{', which give the same table' * (len(self.causes) > 1)}:"
        fit = f"nothing else is wrong once it is taken out (p = {best.p:.2g})"
        if best.p < UNEXPLAINED:
            head = "the nearest causes:"
            fit = f"it does not explain all (p = {best.p:.1g}): expect {BEYOND}"
        yield from ("", head, *(f"  {cause.share:4.0%}  {cause}" for cause in self.causes))
        yield f"how sure: z = {best.z:.1f}; {fit}"
        yield from (f"  hint: {hint}" for hint in dict.fromkeys(cause.hint for cause in self.causes))

    def _evidence(self) -> Iterator[str]:
        """Yield lines about the tests."""
        yield "light samples against BRDF samples, and weights w = 1, 0 against 1/2 (docs/doctor.md):"
        yield f"  {'test':8} {'rows':18} {'difference':>10} {'z':>7}"
        for test in self.largest(SHOWN):
            note = "" if test.trusted else "  too few samples to tell"
            if test.trusted and abs(test.difference) == 2:
                note = f"  {'BRDF' if test.difference > 0 else 'light'} sampling never draws these, though its pdf does"
            yield f"  {test.name:8} {test.where:18} {test.difference:+10.2%} {test.z:+7.1f}{note}"
        few = f"fewer than {LEAST_ROWS:.0f} rows of a technique expected"
        count = sum(test.trusted for test in self.tests)
        yield f"  limit of abs(z): {self.limit:.1f} for {count} tests; {len(self.tests) - count} left out: {few}"
        joint = f"left out: {few}" if np.isnan(self.joint) else f"p = {self.joint:.2g}, limit {JOINT_LEVEL:g}"
        yield f"  joint test in two halves: {joint}"
        if self.smallest:
            factors = ", ".join(f"{name} rows {least:.1%}" for name, least in self.smallest.items())
            yield f"smallest constant errors that would be named: {factors}"


def diagnose(table: str | os.PathLike[str] | Mapping[str, Any] | SampleTable) -> Diagnosis:
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
    results = tests(rows)
    brdf = int((~rows.is_light).sum())
    count = max(1, sum(test.trusted for test in results))
    limit = -NormalDist().inv_cdf(-np.expm1(np.log1p(-LEVEL) / count) / 2)
    result = Diagnosis(tuple(results), limit, joint_test(rows), (len(rows) - brdf, brdf), rows.notes)
    if not result.healthy:
        return replace(result, causes=tuple(name_causes(rows)))
    return replace(result, smallest=smallest_factors(rows))


def page(diagnosis: Diagnosis, name: str) -> str:
    """Return the HTML of a diagnosis: its text, and a bar of z for each test; `name` is the table's."""
    rows = []
    for test in diagnosis.largest(SHOWN_ON_PAGE):
        kind = "few" if not test.trusted else "bad" if abs(test.z) > diagnosis.limit else "ok"
        width = min(300.0, 12 * abs(test.z))
        bar = f'<div class="{kind}" style="width:{width:.0f}px;height:10px"></div>'
        cells = (test.name, test.where, f"{test.difference:+.2%}", f"{test.z:+.1f}", f"{test.rows:,}")
        rows.append("<tr>" + "".join(f"<td>{escape(cell)}</td>" for cell in cells) + f"<td>{bar}</td></tr>")
    head = "".join(f"<th>{title}</th>" for title in ("test", "rows", "difference", "z", "number", "abs(z)"))
    return (
        f'<!doctype html><html lang="en"><meta charset="utf-8"><title>{escape(name)}</title><style>{STYLE}</style>'
        f"<h1>{escape(name)}</h1><pre>{escape(diagnosis.text())}</pre>"
        f"<table><tr>{head}</tr>{''.join(rows)}</table></html>\n"
    )
