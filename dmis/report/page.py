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
from dmis.experiment.convergence import Gain, gains, ratio_text
from dmis.experiment.runs import PINNED, fallbacks
from dmis.experiment.table import Comparison
from dmis.report import tables
from dmis.report.comparer import HEAD, HELP, asset, comparer, filled, palette_colours, viewer_data
from dmis.report.plots import error_svg, map_png
from dmis.report.tables import escaped, saving_text
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
        "<h3>Share maps and regret</h3>",
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


REGRET_NOTE = """Regret of a rule's weights, with the balance heuristic: variance beyond that of the best weight, over
that of w = ½, at equal samples. Saving: variance saved over w = ½, as a share of the saving of the best weights, where
that is 1 % or more. Harm: share of lit patches with more than 1.02 times the variance of w = ½. Weights of the
heuristic alone have no regret."""
NO_REGRET_NOTE = "Maps of regret need an oracle of the scene: render it with compare --oracle-spp."


def share_maps(c: Comparison) -> str:
    """Return a row of maps for each rule with an image of the largest budget."""
    largest = max(spp for _, spp in c.runs)
    rules = [rule for rule, spp in c.runs if spp == largest and (rule, spp) in c.pictures]
    height, width = c.reference.first.shape[:2]
    rows = []
    if c.oracle is not None:
        note = f"{c.oracle.spp} samples per pixel; {c.oracle.limit():.2f} times the variance of w = ½"
        lit = c.oracle.variance[HALF] > 0
        best = map_png(np.where(lit, c.oracle.best(), np.nan), "RdBu", 0, 1)
        rows.append(_map_row("oracle", [("best shares", note, best)]))
    for rule in rules:
        layers = c.pictures[rule, largest]
        weight = layers["weight"]
        maps = [("share map", f"mean {weight.mean():.2f}", map_png(weight, "RdBu", 0, 1))]
        light, brdf = layers["light_samples"], layers["brdf_samples"]
        if c.oracle is not None and np.allclose(light, weight * (light + brdf), rtol=1e-3):  # w divides samples
            harm, error = c.oracle.harm(weight)
            figures = f"{saving_text(c.oracle.saving(weight))}, harm in {harm:.1%} ± {error:.1%}"
            maps.append(("regret", figures, map_png(c.oracle.regret(weight), "magma", 0, 1)))
        rows.append(_map_row(rule, maps))
    scales = _scale("share of light samples w", "RdBu", "0 BRDF", "1 light")
    scales += "" if c.oracle is None else _scale("regret", "magma", "0", "V(½)")
    note = NO_REGRET_NOTE if c.oracle is None else REGRET_NOTE
    below = f'<p class="scales">{scales}</p><p class="note">{note}</p>'
    return f'<div class="maps" style="--shape:{width}/{height}">{"".join(rows)}</div>{below}'


def _map_row(name: str, maps: Sequence[tuple[str, str, str]]) -> str:
    """Return a row of maps, each with its title, a note and the URI of its image."""
    figures = "".join(
        f'<figure><img src="{uri}" alt="{escaped(f"{name}: {title}")}"><figcaption>{title}<br><small>{note}</small>'
        "</figcaption></figure>"
        for title, note, uri in maps
    )
    return f'<div class="row"><b>{escaped(name)}</b>{figures}</div>'


def _scale(label: str, palette: str, low: str, high: str) -> str:
    """Return a colour scale with the labels of its ends."""
    stops = ",".join(palette_colours(palette, 9))
    return f'<span>{label}: {low} <i style="background:linear-gradient(90deg,{stops})"></i> {high}</span>'
