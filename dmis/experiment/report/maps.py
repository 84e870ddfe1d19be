"""Share maps, variance ratios and regret of a report, as rows of pictures."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from dmis.experiment.report.comparer import palette_colours
from dmis.experiment.report.plots import map_png, variance_ratio
from dmis.experiment.report.tables import escaped, share_text
from dmis.experiment.table import Comparison
from dmis.variance.curves import HALF

MAPS_NOTE = """Each render estimates its variance from its own samples, in patches of 4×4 pixels. The estimate is noisy
and assumes independent samples. The samples are more even than that, most of all at uneven weights, so that ratios are
too large by up to a factor of two. With optimal weights they are the ratios of the balance heuristic. The errors
in the table do not have this bias."""
REGRET_NOTE = """ Regret of a rule's weights, with the balance heuristic: variance beyond that of the best weight, over
that of w = ½, at equal samples. Saving: variance saved over w = ½, as a share of the saving of the best weights. Harm:
share of lit patches with more than 1.02 times the variance of w = ½. Weights of the heuristic alone have no regret."""
NO_REGRET_NOTE = " Maps of regret need an oracle of the scene: render it with compare --oracle-spp."
RATIO_LIMIT = 4.0
"""Largest variance ratio of the colour scale, whose smallest is its inverse."""


def share_maps(c: Comparison) -> str:
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
        light, brdf = layers["light_samples"], layers["brdf_samples"]
        if c.oracle is not None and np.allclose(light, weight * (light + brdf), rtol=1e-3):  # w divides samples
            harm, error = c.oracle.harm(weight)
            figures = f"saving {share_text(c.oracle.saving(weight))}, harm in {harm:.1%} ± {error:.1%}"
            maps.append(("regret", figures, map_png(c.oracle.regret(weight), "magma", 0, 1)))
        rows.append(_map_row(rule, maps))
    scales = _scale("share of light samples w", "RdBu", "0 BRDF", "1 light")
    scales += _scale("variance / balance", "PuOr_r", f"1/{RATIO_LIMIT:g} less", f"{RATIO_LIMIT:g}× more")
    scales += "" if c.oracle is None else _scale("regret", "magma", "0", "V(½)")
    note = MAPS_NOTE + (NO_REGRET_NOTE if c.oracle is None else REGRET_NOTE)
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
