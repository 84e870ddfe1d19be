"""A comparison as one page of HTML that needs nothing else: plots, tables, maps, and an image comparer.

The page's looks and its script are in ``report.html`` beside this module; what is filled in there is made here.
"""

from __future__ import annotations

import html
import json
import os
import re
from collections.abc import Sequence
from importlib.resources import files
from pathlib import Path

import numpy as np

from dmis import __version__
from dmis.compare import Comparison
from dmis.convergence import Axis, Gain, gains, line, slope
from dmis.curves import HALF
from dmis.report_plots import (
    MARKS,
    error_svg,
    linear_png,
    look,
    map_png,
    palette_colours,
    variance_ratio,
)  # fmt: skip
from dmis.results import COLUMNS, cells
from dmis.vec import Array

LINES = """Lines: root of the mean squared error over {seeds}; bands: lowest to highest seed. Dotted: the slope −½ of
N<sup>−1/2</sup>.{oracle} Slopes are fitted by least squares, ± one standard error (jackknife over seeds). A rule that
pays for a pilot first can be steeper than −½ until the pilot is paid."""
BEST_WEIGHTS = " Dashed, or ×: the best weights there are, in the time and rays of the balance heuristic."
GAINS = """Means over seeds; seconds are medians, from the pilot to the last sample. ± is half of the 95 % confidence
interval. Speed-up at equal error: seconds in which the balance heuristic reaches this MSE, over the rule's. Error ratio
in equal time: MSE of the balance heuristic in the rule's seconds, over the rule's. Both are read off the line of the
balance heuristic; † where it is continued as MSE ∝ 1 / seconds. Bold: the most efficient, of rules that are surely
more efficient than the balance heuristic."""
MAPS = """Variance is that which each render estimates of itself, in patches of 4×4 pixels. It is as noisy as the
samples that it is made of, and takes them to be independent: they are more even, most of all at uneven weights, so that
ratios are too large by up to a factor of two; with the combiners optimal they are those of the balance heuristic. The
table knows better."""
REGRET = """ Regret of a rule's weights, with the balance heuristic: variance beyond that of the best weight, over that
of w = ½, at equal samples. Saving: share of what the best weights save over w = ½. Harm: share of lit patches with more
than 1.02 times the variance of w = ½."""
NO_REGRET = " Maps of regret are here if an oracle of this scene is kept or given (compare --oracle-spp)."
RATIO = 4.0
"""Maps of variance ratios go from one over this to this, in steps that double."""


def write_report(
    comparisons: Sequence[Comparison], path: str | os.PathLike[str], title: str = "Error against time"
) -> None:
    """Write a page that shows `comparisons`, one section each, with an overview if there are several.

    Raises
    ------
    ValueError
        If there is nothing to show.
    """
    if not comparisons:
        raise ValueError("comparisons must hold at least one, because a page needs something to show; got none")
    sections = [_section(number, comparison) for number, comparison in enumerate(comparisons)]
    links = "".join(f'<a href="#s{k}">{_text(c.scene)}</a>' for k, c in enumerate(comparisons))
    data = {
        "scenes": [_viewer_data(comparison) for comparison in comparisons],
        "palette": palette_colours("magma"),
    }
    fill = {
        "{{title}}": _text(title),
        "{{links}}": links,
        "{{version}}": __version__,
        "{{overview}}": _overview(comparisons) if len(comparisons) > 1 else "",
        "{{sections}}": "\n".join(sections),
        "{{data}}": json.dumps(data, separators=(",", ":")).replace("<", "\\u003c"),
    }
    page = files("dmis").joinpath("report.html").read_text("utf-8")
    page = re.sub("|".join(map(re.escape, fill)), lambda mark: fill[mark[0]], page)
    partial = Path(f"{os.fspath(path)}.partial")
    partial.parent.mkdir(parents=True, exist_ok=True)
    partial.write_text(page, "utf-8")
    os.replace(partial, path)


def _section(number: int, c: Comparison) -> str:
    height, width = c.reference.first.shape[:2]
    found = gains(c.runs)
    threads = c.about["threads"]
    parts = [
        f'<section id="s{number}"><h2>{_text(c.scene)}</h2>',
        f'<p class="facts">{width}×{height} pixels · {_count(c.seeds, "seed")} · {_count(threads, "thread")} · '
        f"{_about_reference(c)}</p>",
        _verdict(found),
        f'<div class="plots">{error_svg(c, "seconds")}{error_svg(c, "rays")}</div>',
        _slopes(c),
        "<h3>Efficiency</h3>",
        _efficiency(found),
        "<h3>Look closer</h3>",
        f'<div class="viewer" data-scene="{number}" tabindex="0"></div>',
        "<h3>Where the samples go, and what it brings</h3>",
        _maps(c),
        f"<details><summary>All runs, as they are in results.csv</summary>{_runs(c)}</details>",
        "</section>",
    ]
    return "\n".join(parts)


def _about_reference(c: Comparison) -> str:
    if c.reference.spp:
        return f"reference of 2 × {c.reference.spp} samples per pixel, RMSE {np.sqrt(c.reference.mse):.2g}"
    return "reference given"


def _verdict(found: Sequence[Gain]) -> str:
    """One sentence: which rule is the most efficient at the largest budget."""
    last = [g for g in found if g.spp == max(g.spp for g in found)]
    base = next(g for g in last if g.rule == "balance")
    at = f"At {base.spp} samples per pixel"
    if not base.mse > 0:
        return f"<p>{at} the balance heuristic has no error above that of the reference: nothing can be told.</p>"
    best = _best(last)
    if best is None:
        why = " One seed has no interval." if np.isnan(base.interval) else ""
        return f"<p>{at} no rule is surely more efficient than the balance heuristic.{why}</p>"
    return (
        f"<p>{at} <b>{_text(best.rule)}</b> is surely more efficient than the balance heuristic, and in these runs the "
        f"best of the rules that are: it reaches its error in {1 / best.equal_error:.0%} of the time that the balance "
        f"heuristic needs.</p>"
    )


def _best(found: Sequence[Gain]) -> Gain | None:
    """Of gains at one budget that of the most efficient rule, of those that surely are more efficient than balance."""
    base = next(g for g in found if g.rule == "balance")
    return max((g for g in found if _surely(g, base)), key=_known_efficiency, default=None)


def _surely(gain: Gain, base: Gain) -> bool:
    """Whether error times time is less than that of the balance heuristic beyond the interval of the error."""
    return (gain.over_balance + gain.interval) * gain.seconds < base.seconds


def _slopes(c: Comparison) -> str:
    overs: tuple[Axis, ...] = ("spp", "rays", "seconds")
    rows = []
    for k, rule in enumerate(c.rules):
        told = [_plus_minus(*slope(*line(c.runs, rule, over))) for over in overs]
        colour, mark = look(k)
        swatch = f'<i class="swatch" style="color:{colour}" data-mark="{MARKS[mark]}"></i>'
        rows.append([f"{swatch}{_text(rule)}", *told])
    note = LINES.format(seeds=_count(c.seeds, "seed"), oracle=BEST_WEIGHTS if c.oracle else "")
    head = ["rule", "slope over samples", "over rays", "over seconds"]
    return f'{_table(head, rows, "slopes")}<p class="note">{note}</p>'


def _known_efficiency(gain: Gain) -> float:
    return -1.0 if np.isnan(gain.efficiency) else gain.efficiency


def _efficiency(found: Sequence[Gain]) -> str:
    head = [
        "spp", "rule", "MSE", "MSE / balance", "relMSE", "seconds", "CPU s", "pilot + fit", "Mrays",
        "1 / (MSE·s)", "speed-up at equal error", "error ratio in equal time",
    ]  # fmt: skip
    best = {spp: _best([g for g in found if g.spp == spp]) for spp in {g.spp for g in found}}
    rows, marks = [], []
    for g in found:
        first = g.rule == "balance"
        dagger = "†" if g.extrapolated and not first and np.isfinite(g.equal_error) else ""
        interval = "" if np.isnan(g.interval) or first else f" ± {g.interval:.3f}"
        rows.append(
            [
                str(g.spp) if first else "", _text(g.rule), f"{g.mse:.4g}", f"{_ratio(g.over_balance)}{interval}",
                f"{g.relmse:.4g}", f"{g.seconds:.2f}", f"{g.cpu_seconds:.2f}", f"{g.overhead:.0%}",
                f"{g.rays / 1e6:.2f}", f"{g.efficiency:.4g}", f"{_times(g.equal_error)}{dagger}",
                f"{_times(g.equal_time)}{dagger}",
            ]
        )  # fmt: skip
        marks.append(" ".join((["group"] if first else []) + (["best"] if g is best[g.spp] else [])))
    return f'{_table(head, rows, "efficiency", marks)}<p class="note">{GAINS}</p>'


def _overview(comparisons: Sequence[Comparison]) -> str:
    """Speed-ups at equal error of all rules on all scenes, each at its largest budget."""
    tables = []
    for c in comparisons:
        found = gains(c.runs)
        tables.append({g.rule: g for g in found if g.spp == max(g.spp for g in found)})
    rules = list(dict.fromkeys(rule for table in tables for rule in table))
    rows = []
    for rule in rules:
        shown = [_times(table[rule].equal_error) if rule in table else "–" for table in tables]
        rows.append([_text(rule), *shown])
    head = ["rule", *(_text(c.scene) for c in comparisons)]
    note = (
        "Speed-up over the balance heuristic at equal error, at the largest number of samples. More than 1 is better."
    )
    return f'<h2>Overview</h2>{_table(head, rows, "overview")}<p class="note">{note}</p>'


def _viewer_data(c: Comparison) -> dict[str, object]:
    """Images of the largest budget, the reference first; the error that the error view shows in its last colour."""
    largest = max(spp for _, spp in c.runs)
    images = {
        rule: c.pictures[rule, spp]["RGB"] for rule, spp in c.runs if spp == largest and (rule, spp) in c.pictures
    }
    truth = c.reference.mean
    height, width = truth.shape[:2]
    scale = 1.0
    if "balance" in images:
        scale = float(np.quantile(_pixel_error(images["balance"], truth), 0.98)) or 1.0
    shown = [{"label": "reference", "png": linear_png(truth)}]
    shown += [{"label": f"{rule}, {largest} spp", "png": linear_png(image)} for rule, image in images.items()]
    return {"scene": c.scene, "width": width, "height": height, "scale": scale, "images": shown}


def _pixel_error(image: Array, truth: Array) -> Array:
    """Root of the mean over channels of the squared error, ``(H, W)``, as the page's script computes it."""
    return np.sqrt(((image - truth) ** 2).mean(axis=2))


def _maps(c: Comparison) -> str:
    """A row of maps for each rule that has a picture of the largest budget."""
    largest = max(spp for _, spp in c.runs)
    have = [rule for rule, spp in c.runs if spp == largest and (rule, spp) in c.pictures]
    baseline = c.pictures.get(("balance", largest))
    height, width = c.reference.first.shape[:2]
    rows = []
    if c.oracle is not None:
        note = f"{c.oracle.spp} samples: {c.oracle.limit():.2f} of the variance of w = ½"
        lit = c.oracle.variance[HALF] > 0
        best = map_png(np.where(lit, c.oracle.best(), np.nan), "RdBu", 0, 1)
        rows.append(_map_row("oracle", [("best weights", note, best)]))
    for rule in have:
        layers = c.pictures[rule, largest]
        weight = layers["weight"]
        maps = [("weight", f"mean {weight.mean():.2f}", map_png(weight, "RdBu", 0, 1))]
        if baseline is not None:
            ratios = variance_ratio(layers, baseline)
            middle = np.nanmedian(ratios) if np.isfinite(ratios).any() else np.nan
            with np.errstate(divide="ignore"):  # a ratio of 0 is at the end of the scale
                drawn = map_png(np.log2(ratios), "PuOr_r", -np.log2(RATIO), np.log2(RATIO))
            maps.append(("variance / balance", f"median {middle:.2f}", drawn))
        if c.oracle is not None:
            harm, error = c.oracle.harm(weight)
            told = f"saving {_share(c.oracle.saving(weight))}, harm in {harm:.1%} ± {error:.1%}"
            maps.append(("regret", told, map_png(c.oracle.regret(weight), "magma", 0, 1)))
        rows.append(_map_row(rule, maps))
    scales = [
        _scale("share of light samples w", "RdBu", "0 BRDF", "1 light"),
        _scale("variance / balance", "PuOr_r", f"1/{RATIO:g} less", f"{RATIO:g}× more"),
    ]
    if c.oracle is not None:
        scales.append(_scale("regret", "magma", "0", "V(½)"))
    note = MAPS + (NO_REGRET if c.oracle is None else REGRET)
    shape = f'style="--shape:{width}/{height}"'
    below = f'<p class="scales">{"".join(scales)}</p><p class="note">{note}</p>'
    return f'<div class="maps" {shape}>{"".join(rows)}</div>{below}'


def _map_row(name: str, maps: Sequence[tuple[str, str, str]]) -> str:
    shown = "".join(
        f'<figure><img src="{uri}" alt="{_text(f"{name}: {title}")}"><figcaption>{title}<br><small>{told}</small>'
        "</figcaption></figure>"
        for title, told, uri in maps
    )
    return f'<div class="row"><b>{_text(name)}</b>{shown}</div>'


def _scale(label: str, palette: str, low: str, high: str) -> str:
    stops = ",".join(palette_colours(palette, 9))
    return f'<span>{label}: {low} <i style="background:linear-gradient(90deg,{stops})"></i> {high}</span>'


def _runs(c: Comparison) -> str:
    base = {(run.spp, run.seed): run for (rule, _), of in c.runs.items() if rule == "balance" for run in of}
    rows = [[_text(v) for v in cells(c.scene, run, base[run.spp, run.seed])] for of in c.runs.values() for run in of]
    return _table(COLUMNS, rows, "runs")


def _table(head: Sequence[str], rows: Sequence[Sequence[str]], kind: str, marks: Sequence[str] | None = None) -> str:
    titles = "".join(f'<th scope="col">{title}</th>' for title in head)
    lines = [
        f'<tr class="{mark}">' + "".join(f"<td>{value}</td>" for value in row) + "</tr>"
        for row, mark in zip(rows, marks or [""] * len(rows), strict=True)
    ]
    inside = f"<thead><tr>{titles}</tr></thead><tbody>{''.join(lines)}</tbody>"
    return f'<div class="wide"><table class="{kind}">{inside}</table></div>'


def _plus_minus(value: float, error: float) -> str:
    if np.isnan(value):
        return "–"
    text = f"{value:.3f}".replace("-", "−")
    return text if np.isnan(error) else f"{text} ± {error:.3f}"


def _ratio(value: float) -> str:
    return "–" if np.isnan(value) else f"{value:.3f}"


def _share(value: float) -> str:
    return "–" if np.isnan(value) else f"{value:.0%}"


def _times(value: float) -> str:
    return "–" if np.isnan(value) else f"{value:.2f}×"


def _count(number: int, noun: str) -> str:
    return f"{number} {noun}{'' if number == 1 else 's'}"


def _text(value: object) -> str:
    return html.escape(str(value))
