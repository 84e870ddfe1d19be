"""Report of a comparison as one self-contained HTML page: plots, tables, share maps, and an image comparer.

The template ``report.html`` beside this module has its elements, ``report.css`` the style and ``report.js`` the buttons
that save tables and plots; this module fills in the template's marks.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from dmis import __version__
from dmis.base.atomic_files import replacing
from dmis.base.vectors import Array
from dmis.experiment.convergence import Gain, gains, ratio_text
from dmis.experiment.runs import PINNED, fallbacks
from dmis.experiment.table import Comparison
from dmis.report import tables
from dmis.report.comparer import HEAD, HELP, asset, comparer, filled, palette_colours, viewer_data
from dmis.report.plots import error_svg, map_png
from dmis.report.tables import escaped
from dmis.variance.curves import HALF


def write_report(
    comparisons: Sequence[Comparison], path: str | os.PathLike[str], title: str = "Error against time"
) -> None:
    """Write a page that shows `comparisons`, one section each, with an overview if there are several; at least one."""
    if not comparisons:
        raise ValueError("comparisons must hold at least one, because a page needs something to show; got none")
    sections = [_section(number, comparison) for number, comparison in enumerate(comparisons)]
    links = "".join(f'<a href="#s{k}">{escaped(c.scene)}</a>' for k, c in enumerate(comparisons))
    fill = {
        "title": escaped(title),
        "links": links,
        "version": __version__,
        "overview": tables.overview_table(comparisons) if len(comparisons) > 1 else "",
        "sections": "\n".join(sections),
        "style": asset("comparer.css") + asset("report.css"),
        "help": HELP,
        "comparer": comparer([_viewer_data(comparison) for comparison in comparisons]),
        "script": asset("report.js"),
    }
    Path(path).parent.mkdir(parents=True, exist_ok=True)
    with replacing(path) as partial:
        partial.write_text(filled(HEAD + asset("report.html"), fill), "utf-8")


def _section(number: int, c: Comparison) -> str:
    """Return the section of a comparison."""
    height, width = c.reference.first.shape[:2]
    rows = gains(c.runs)
    elements = [
        f'<section id="s{number}"><h2>{escaped(c.scene)}</h2>',
        f'<p class="facts">{width}×{height} pixels · seeds: {c.seeds} · '
        f"{escaped(c.about['parallel'])} · {escaped(c.reference.text())}</p>",
        *(f'<p class="alarm">⚠ {escaped(text)}</p>' for text in c.alarms() if text),
        *(f'<p class="note">{escaped(text)}</p>' for text in fallbacks(c.runs)),
        _verdict(c, rows),
        *(f"<p>{escaped(text)}</p>" for text in [c.few_pixels()] if text),
        f'<div class="plots">{error_svg(c, "seconds", "relmse")}{error_svg(c, "seconds")}{error_svg(c, "rays")}</div>',
        f'<p class="note">{tables.LINES_NOTE}</p>',
        "<h3>Efficiency</h3>",
        tables.efficiency_table(c, rows),
        "<h3>Costs</h3>",
        tables.costs_table(rows),
        "<h3>Images and errors</h3>",
        f'<div class="viewer" data-scene="{number}" tabindex="0"></div>',
        "<h3>Share maps</h3>",
        share_maps(c),
        f"<details><summary>All runs, as in results.csv</summary>{tables.runs_table(c)}",
        f'<p class="note">{tables.RUNS_NOTE}</p></details>',
        "</section>",
    ]
    return "\n".join(elements)


def _verdict(c: Comparison, rows: Sequence[Gain]) -> str:
    """Return a sentence that names the most efficient rule at the largest budget, if its interval is below 1."""
    last = [g for g in rows if g.spp == max(g.spp for g in rows) and g.rule != PINNED]
    base = next(g for g in last if g.rule == "balance")
    at = f"At {base.spp} samples per pixel"
    if not base.relmse.error > 0:
        return f"<p>{at} the balance heuristic has no error above that of the reference: rules cannot be compared.</p>"
    if "relmse" in c.concentrated:
        return f"<p>{at} no rule is named the most efficient one, because few pixels have most of the error.</p>"
    winners = tables.winners(c, last)
    if not winners:
        why = " One seed shows no scatter of times: measure more seeds." if c.seeds < 2 else ""
        return f"<p>{at} no rule has a 95 % interval of error × CPU time below that of the balance heuristic.{why}</p>"
    best, rules = winners[0], len(last) - 1
    value, low, high = best.relmse.error_time
    among = "" if len(winners) == 1 else f", the lowest of {len(winners)} rules whose interval is below 1"
    corrected = "" if rules == 1 else f", corrected for {rules} rules"
    return (
        f"<p>{at} <b>{escaped(best.rule)}</b> is more efficient than the balance heuristic: its error × CPU time is "
        f"{value:.2f} times as large (95 % interval {low:.2f} to {high:.2f}{corrected}){among}, and "
        f"{ratio_text(best.relmse.error_time_over_pinned.value)} times that of the pinned baseline. By MSE "
        f"they are {ratio_text(best.mse.error_time.value)} and {ratio_text(best.mse.error_time_over_pinned.value)}.</p>"
    )


def _viewer_data(c: Comparison) -> dict[str, object]:
    """Return the data of the image comparer: the reference, and the images of the largest budget."""
    largest = max(spp for _, spp in c.runs)
    budgets = [(rule, spp) for rule, spp in c.runs if spp == largest and (rule, spp) in c.pictures]
    images = {f"{rule}, {spp} spp": c.pictures[rule, spp]["RGB"] for rule, spp in budgets}
    return viewer_data(c.scene, images, c.reference.mean)


def share_maps(c: Comparison) -> str:
    """Return a map for the oracle, and for each rule with an image of the largest budget."""
    largest = max(spp for _, spp in c.runs)
    height, width = c.reference.first.shape[:2]
    maps = []
    if c.oracle is not None:
        note = f"{c.oracle.spp} samples per pixel; {c.oracle.limit():.2f} times the variance of w = ½"
        maps.append(_map("oracle", note, np.where(c.oracle.variance[HALF] > 0, c.oracle.best(), np.nan)))
    for rule in (rule for rule, spp in c.runs if spp == largest and (rule, spp) in c.pictures):
        weight = c.pictures[rule, largest]["weight"]
        maps.append(_map(rule, f"mean {weight.mean():.2f}", weight))
    scale = _scale("share of light samples w", "RdBu", "0 BRDF", "1 light")
    return f'<div class="maps" style="--shape:{width}/{height}">{"".join(maps)}</div><p class="scales">{scale}</p>'


def _map(name: str, note: str, weight: Array) -> str:
    """Return the figure of a share map, with a note."""
    image = f'<img src="{map_png(weight, "RdBu", 0, 1)}" alt="share map of {escaped(name)}">'
    return f'<div class="row"><b>{escaped(name)}</b><figure>{image}<figcaption>{note}</figcaption></figure></div>'


def _scale(label: str, palette: str, low: str, high: str) -> str:
    """Return a colour scale with the labels of its ends."""
    stops = ",".join(palette_colours(palette, 9))
    return f'<span>{label}: {low} <i style="background:linear-gradient(90deg,{stops})"></i> {high}</span>'
