"""Report of a comparison as one self-contained HTML page: plots, tables, maps, and an image comparer.

The template ``report.html`` beside this module has the style and the script; this module fills in its marks.
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
from dmis.base.atomic_files import replacing
from dmis.base.vectors import Array
from dmis.estimator.presets import PRESETS
from dmis.experiment import alarm
from dmis.experiment.convergence import Axis, Gain, Interval, gains, line, slope
from dmis.experiment.ladder import RUNGS
from dmis.experiment.report.plots import (
    RULE_MARKS,
    error_svg,
    ladder_svg,
    line_style,
    linear_png,
    map_png,
    palette_colours,
    variance_ratio,
)
from dmis.experiment.runs import PINNED
from dmis.experiment.table import COLUMNS, Comparison, cells, run_by_key
from dmis.variance.curves import HALF

LINES_NOTE = """Lines: root of the mean squared error over {seeds}; bands: lowest to highest seed. Dotted: the slope −½
of N<sup>−1/2</sup>.{oracle} Slopes are fitted by least squares, ± one standard error (jackknife over seeds). A rule
with a pilot can be steeper than −½, because the share of the pilot in the time falls."""
BEST_WEIGHTS_NOTE = " Dashed, or ×: the best weights by the oracle, in the time and rays of the balance heuristic."
GAINS_NOTE = """Means over seeds; seconds are medians, from the pilot to the last sample. ± is half of the 95 %
confidence interval. MSE·CPU s / balance: mean squared error times CPU seconds, over that of the balance heuristic, with
the 95 % interval over paired seeds, which includes the scatter of the times; with several rules at one number of
samples the intervals are wider (Holm). Bold: the lowest value, if its interval is below 1. Speed-up at equal
error: seconds in which the balance heuristic reaches this MSE, over the rule's. Error ratio in equal time: MSE over
that of the balance heuristic in the rule's seconds. Both are interpolated on the line of the balance heuristic; †
where it is extrapolated as MSE ∝ 1 / seconds. Pinned: the balance heuristic with preset=thesis, which is one light and
one BRDF sample and independent points, whatever the settings of the others."""
LADDER_NOTE = """Least MSE × time that is possible with one freedom after another, without a pilot, over that of the
balance heuristic with independent samples. Rules, at the largest number of samples: in the lowest rung that their MSE ×
CPU seconds do not exceed. With other points than independent ones that is over the pinned baseline, which has two
shading samples; with another number rules stand nowhere."""
MAPS_NOTE = """Each render estimates its variance from its own samples, in patches of 4×4 pixels. The estimate is noisy
and assumes independent samples. The samples are more even than that, most of all at uneven weights, so that ratios are
too large by up to a factor of two. With optimal weights they are the ratios of the balance heuristic. The errors
in the table do not have this bias."""
REGRET_NOTE = """ Regret of a rule's weights, with the balance heuristic: variance beyond that of the best weight, over
that of w = ½, at equal samples. Saving: variance saved over w = ½, as a share of the saving of the best weights. Harm:
share of lit patches with more than 1.02 times the variance of w = ½."""
NO_REGRET_NOTE = " Maps of regret need an oracle of the scene: render it with compare --oracle-spp."
RUNS_NOTE = f"""mean_z: mean of the image less that of the reference, in standard errors, of the channel where it is
largest. About ±1 is noise; beyond ±{alarm.ALARM_LIMIT:g} the errors above are not noise, and a paragraph above says why
that may be. The other columns are explained in docs/report.md."""
RATIO_LIMIT = 4.0
"""Largest variance ratio of the colour scale, whose smallest is its inverse."""


def write_report(
    comparisons: Sequence[Comparison], path: str | os.PathLike[str], title: str = "Error against time"
) -> None:
    """Write a page that shows `comparisons`, one section each, with an overview if there are several.

    Raises
    ------
    ValueError
        If there is no comparison.
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
    page = files("dmis.experiment.report").joinpath("report.html").read_text("utf-8")
    page = re.sub("|".join(map(re.escape, fill)), lambda mark: fill[mark[0]], page)
    Path(path).parent.mkdir(parents=True, exist_ok=True)
    with replacing(path) as partial:
        partial.write_text(page, "utf-8")


def _section(number: int, c: Comparison) -> str:
    """Return the section of a comparison."""
    height, width = c.reference.first.shape[:2]
    rows = gains(c.runs)
    elements = [
        f'<section id="s{number}"><h2>{_text(c.scene)}</h2>',
        f'<p class="facts">{width}×{height} pixels · {_count(c.seeds, "seed")} · {_text(c.about["parallel"])} · '
        f"{_about_reference(c)}</p>",
        *_alarms(c, rows),
        _verdict(rows),
        f'<div class="plots">{error_svg(c, "seconds")}{error_svg(c, "rays")}</div>',
        _slopes(c),
        "<h3>Efficiency</h3>",
        _efficiency(c, rows),
        *_ladder(c, rows),
        "<h3>Images and errors</h3>",
        f'<div class="viewer" data-scene="{number}" tabindex="0"></div>',
        "<h3>Share maps, variance and regret</h3>",
        _maps(c),
        f'<details><summary>All runs, as in results.csv</summary>{_runs(c)}<p class="note">{RUNS_NOTE}</p></details>',
        "</section>",
    ]
    return "\n".join(elements)


def _about_reference(c: Comparison) -> str:
    """Return a text with the samples and the error of the reference."""
    if c.reference.spp:
        return f"reference of 2 × {c.reference.spp} samples per pixel, standard error {c.reference.standard_error:.2g}"
    return "reference given"


def _alarms(c: Comparison, rows: Sequence[Gain]) -> list[str]:
    """Return a paragraph if the reference is too noisy, and one if the mean of an image is not that of it."""
    noise = alarm.reference_noise(c.reference, (g.mse for g in rows))
    mean = alarm.summary(run for by_seed in c.runs.values() for run in by_seed)
    return [f'<p class="alarm">⚠ {_text(text)}</p>' for text in (noise, mean) if text]


def _verdict(rows: Sequence[Gain]) -> str:
    """Return a sentence that names the most efficient rule at the largest budget, if its interval is below 1."""
    last = [g for g in rows if g.spp == max(g.spp for g in rows) and g.rule != PINNED]
    base = next(g for g in last if g.rule == "balance")
    at = f"At {base.spp} samples per pixel"
    if not base.mse > 0:
        return f"<p>{at} the balance heuristic has no error above that of the reference: rules cannot be compared.</p>"
    best = _best(last)
    if best is None:
        why = ""
        if np.isnan(base.interval):
            why = " One seed shows no scatter of times, so that there is no interval: measure more seeds."
        elif any(np.isnan(g.error_time.high) for g in last if g is not base):
            why = " Rules without an interval have errors below that of the reference, or no CPU seconds."
        return f"<p>{at} no rule has a 95 % interval of error × CPU time below that of the balance heuristic.{why}</p>"
    value, low, high = best.error_time
    winners, rules = sum(g.wins for g in last), len(last) - 1
    among = "" if winners == 1 else f", the lowest of {winners} rules whose interval is below 1"
    corrected = "" if rules == 1 else f", corrected for {rules} rules"
    return (
        f"<p>{at} <b>{_text(best.rule)}</b> is more efficient than the balance heuristic: its error × CPU time is "
        f"{value:.2f} times as large (95 % interval {low:.2f} to {high:.2f}{corrected}){among}, and "
        f"{_ratio(best.error_time_over_pinned.value)} times that of the pinned baseline.</p>"
    )


def _best(rows: Sequence[Gain]) -> Gain | None:
    """Return the most efficient rule at one budget whose interval of error × CPU time is below 1, or None."""
    return min((g for g in rows if g.wins), key=lambda g: g.error_time.value, default=None)


def _slopes(c: Comparison) -> str:
    """Return the table of the slopes of all rules, which is also the legend of the plots."""
    overs: tuple[Axis, ...] = ("spp", "rays", "seconds")
    rows = []
    for k, rule in enumerate(c.rules):
        slopes = [_plus_minus(*slope(*line(c.runs, rule, over))) for over in overs]
        colour, mark = line_style(k)
        swatch = f'<i class="swatch" style="color:{colour}" data-mark="{RULE_MARKS[mark]}"></i>'
        rows.append([f"{swatch}{_text(rule)}", *slopes])
    note = LINES_NOTE.format(seeds=_count(c.seeds, "seed"), oracle=BEST_WEIGHTS_NOTE if c.oracle else "")
    head = ["rule", "slope over samples", "over rays", "over seconds"]
    return f'{_table(head, rows, "slopes")}<p class="note">{note}</p>'


def _efficiency(c: Comparison, gains_of_budgets: Sequence[Gain]) -> str:
    """Return the table of errors, times and efficiencies of all rules and budgets, with rungs if there is a ladder."""
    alarmed = {budget for budget, by_seed in c.runs.items() if any(map(alarm.raises_alarm, by_seed))}
    head = [
        "spp", "rule", "MSE", "MSE / balance", "relMSE", "seconds", "CPU s", "MSE·CPU s / balance",
        "pilot + fit", "Mrays", "1 / (MSE·s)", "speed-up at equal error", "error ratio in equal time",
        *(["rung"] if c.ladder else []), "MSE / pinned", "MSE·CPU s / pinned",
    ]  # fmt: skip
    budgets = {g.spp for g in gains_of_budgets}
    best = {spp: _best([g for g in gains_of_budgets if g.spp == spp]) for spp in budgets}
    rows, marks = [], []
    for g in gains_of_budgets:
        first = g.rule == "balance"
        dagger = "†" if g.extrapolated and not first and np.isfinite(g.equal_error) else ""
        name = _text(g.rule) + (" ⚠" if (g.rule, g.spp) in alarmed else "")
        interval = "" if np.isnan(g.interval) or first else f" ± {g.interval:.3f}"
        rows.append(
            [
                str(g.spp) if first else "", name, f"{g.mse:.4g}", f"{_ratio(g.over_balance)}{interval}",
                f"{g.relmse:.4g}", f"{g.seconds:.2f}", f"{g.cpu_seconds:.2f}", _interval(g.error_time),
                f"{g.overhead:.0%}", f"{g.rays / 1e6:.2f}", f"{g.efficiency:.4g}",
                f"{_times(g.equal_error)}{dagger}", f"{_ratio(g.equal_time)}{dagger}",
                *([c.ladder.reached(_over_independent(c, g)) or "–"] if c.ladder else []),
                _ratio(g.over_pinned), _interval(g.error_time_over_pinned),
            ]
        )  # fmt: skip
        marks.append(" ".join((["group"] if first else []) + (["best"] if g is best[g.spp] else [])))
    return f'{_table(head, rows, "efficiency", marks)}<p class="note">{GAINS_NOTE}</p>'


def _over_independent(c: Comparison, g: Gain) -> float:
    """Return a rule's error times CPU seconds over that of the balance heuristic with independent samples, or NaN.

    With another sampler that is the pinned baseline, if it has as many shading samples.
    """
    if c.about["sampler"] == "independent":
        return g.error_time.value
    same = c.about["shading_samples"] == PRESETS["thesis"].values["shading_samples"]
    return g.error_time_over_pinned.value if same else float("nan")


def _ladder(c: Comparison, rows: Sequence[Gain]) -> list[str]:
    """Return the plot of the scene's ladder with the rules at the largest budget, and its table; empty if none."""
    if c.ladder is None:
        return []
    largest = max(g.spp for g in rows)
    errors = {g.rule: _over_independent(c, g) for g in rows if g.spp == largest}
    head = ["rung", "what may be chosen", "error in equal time", "rules"]
    reached = {rule: c.ladder.reached(error) for rule, error in errors.items()}
    lines = [
        [name, _text(RUNGS[name]), f"{value:.3g}", _text(", ".join(r for r, rung in reached.items() if rung == name))]
        for name, value in c.ladder.rungs.items()
    ]
    return [
        "<h3>Ladder of bounds</h3>",
        f'<div class="plots">{ladder_svg(c.ladder, errors, c.scene)}</div>',
        f'{_table(head, lines, "ladder")}<p class="note">{LADDER_NOTE}</p>',
    ]


def _overview(comparisons: Sequence[Comparison]) -> str:
    """Return the table of speed-ups at equal error of all rules on all scenes, each at its largest budget."""
    tables = []
    for c in comparisons:
        gains_of_budgets = gains(c.runs)
        largest = max(g.spp for g in gains_of_budgets)
        tables.append({g.rule: g for g in gains_of_budgets if g.spp == largest})
    rules = list(dict.fromkeys(rule for table in tables for rule in table))
    rows = []
    for rule in rules:
        speed_ups = [_times(table[rule].equal_error) if rule in table else "–" for table in tables]
        rows.append([_text(rule), *speed_ups])
    head = ["rule", *(_text(c.scene) for c in comparisons)]
    note = (
        "Speed-up over the balance heuristic at equal error, at the largest number of samples. More than 1 is better."
    )
    return f'<h2>Overview</h2>{_table(head, rows, "overview")}<p class="note">{note}</p>'


def _viewer_data(c: Comparison) -> dict[str, object]:
    """Return the data of the image comparer: images of the largest budget, the reference first, and the error scale."""
    largest = max(spp for _, spp in c.runs)
    images = {
        rule: c.pictures[rule, spp]["RGB"] for rule, spp in c.runs if spp == largest and (rule, spp) in c.pictures
    }
    truth = c.reference.mean
    height, width = truth.shape[:2]
    scale = 1.0
    if "balance" in images:
        scale = float(np.quantile(_pixel_error(images["balance"], truth), 0.98)) or 1.0
    entries = [{"label": "reference", "png": linear_png(truth)}]
    entries += [{"label": f"{rule}, {largest} spp", "png": linear_png(image)} for rule, image in images.items()]
    return {"scene": c.scene, "width": width, "height": height, "scale": scale, "images": entries}


def _pixel_error(image: Array, truth: Array) -> Array:
    """Return the root of the mean over channels of the squared error, ``(H, W)``, as the page's script does."""
    return np.sqrt(((image - truth) ** 2).mean(axis=2))


def _maps(c: Comparison) -> str:
    """Return a row of maps for each rule with an image of the largest budget."""
    largest = max(spp for _, spp in c.runs)
    rules = [rule for rule, spp in c.runs if spp == largest and (rule, spp) in c.pictures]
    baseline = c.pictures.get(("balance", largest))
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
        if baseline is not None:
            ratios = variance_ratio(layers, baseline)
            middle = np.nanmedian(ratios) if np.isfinite(ratios).any() else np.nan
            with np.errstate(divide="ignore"):  # a ratio of 0 is at the end of the scale
                ratio_map = map_png(np.log2(ratios), "PuOr_r", -np.log2(RATIO_LIMIT), np.log2(RATIO_LIMIT))
            maps.append(("variance / balance", f"median {middle:.2f}", ratio_map))
        if c.oracle is not None:
            harm, error = c.oracle.harm(weight)
            figures = f"saving {_share(c.oracle.saving(weight))}, harm in {harm:.1%} ± {error:.1%}"
            maps.append(("regret", figures, map_png(c.oracle.regret(weight), "magma", 0, 1)))
        rows.append(_map_row(rule, maps))
    scales = [
        _scale("share of light samples w", "RdBu", "0 BRDF", "1 light"),
        _scale("variance / balance", "PuOr_r", f"1/{RATIO_LIMIT:g} less", f"{RATIO_LIMIT:g}× more"),
    ]
    if c.oracle is not None:
        scales.append(_scale("regret", "magma", "0", "V(½)"))
    note = MAPS_NOTE + (NO_REGRET_NOTE if c.oracle is None else REGRET_NOTE)
    shape = f'style="--shape:{width}/{height}"'
    below = f'<p class="scales">{"".join(scales)}</p><p class="note">{note}</p>'
    return f'<div class="maps" {shape}>{"".join(rows)}</div>{below}'


def _map_row(name: str, maps: Sequence[tuple[str, str, str]]) -> str:
    """Return a row of maps, each with its title, a note and the URI of its image."""
    figures = "".join(
        f'<figure><img src="{uri}" alt="{_text(f"{name}: {title}")}"><figcaption>{title}<br><small>{note}</small>'
        "</figcaption></figure>"
        for title, note, uri in maps
    )
    return f'<div class="row"><b>{_text(name)}</b>{figures}</div>'


def _scale(label: str, palette: str, low: str, high: str) -> str:
    """Return a colour scale with the labels of its ends."""
    stops = ",".join(palette_colours(palette, 9))
    return f'<span>{label}: {low} <i style="background:linear-gradient(90deg,{stops})"></i> {high}</span>'


def _runs(c: Comparison) -> str:
    """Return the table of all runs, cell by cell as in ``results.csv``."""
    runs = run_by_key(run for by_seed in c.runs.values() for run in by_seed)
    rows = [[_text(value) for value in cells(c.scene, run, runs)] for run in runs.values()]
    return _table(COLUMNS, rows, "runs")


def _table(head: Sequence[str], rows: Sequence[Sequence[str]], kind: str, marks: Sequence[str] | None = None) -> str:
    """Return a table of the class `kind`; `marks` are the classes of its rows."""
    titles = "".join(f'<th scope="col">{title}</th>' for title in head)
    lines = [
        f'<tr class="{mark}">' + "".join(f"<td>{value}</td>" for value in row) + "</tr>"
        for row, mark in zip(rows, marks or [""] * len(rows), strict=True)
    ]
    content = f"<thead><tr>{titles}</tr></thead><tbody>{''.join(lines)}</tbody>"
    return f'<div class="wide"><table class="{kind}">{content}</table></div>'


def _plus_minus(value: float, error: float) -> str:
    """Return a value with its standard error, a dash for NaN."""
    if np.isnan(value):
        return "–"
    text = f"{value:.3f}".replace("-", "−")
    return text if np.isnan(error) else f"{text} ± {error:.3f}"


def _ratio(value: float) -> str:
    """Return a ratio with three decimals, or three digits below 0.1; a dash for NaN."""
    return "–" if np.isnan(value) else f"{value:.3f}" if value >= 0.1 else f"{value:#.3g}"


def _interval(interval: Interval) -> str:
    """Return a ratio with the ends of its interval, if these are known."""
    value, low, high = interval
    return _ratio(value) if np.isnan(high) else f"{_ratio(value)} ({_ratio(low)} – {_ratio(high)})"


def _share(value: float) -> str:
    """Return a share in percent, a dash for NaN."""
    return "–" if np.isnan(value) else f"{value:.0%}"


def _times(value: float) -> str:
    """Return a factor, a dash for NaN."""
    return "–" if np.isnan(value) else f"{value:.2f}×"


def _count(number: int, noun: str) -> str:
    """Return a number with its noun, in the plural unless the number is 1."""
    return f"{number} {noun}{'' if number == 1 else 's'}"


def _text(value: object) -> str:
    """Return a value as text with HTML's special characters escaped."""
    return html.escape(str(value))
