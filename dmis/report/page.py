"""Report of a comparison as one page: plots, tables, share maps, and an image comparer.

The template ``report.html`` beside this module has its texts, ``report.css`` the style and ``report.js`` the buttons
that save tables and plots.
"""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from typing import Any

from dmis import __version__, plot
from dmis.base.vectors import Array
from dmis.experiment.convergence import gains
from dmis.experiment.runs import PINNED, fallbacks
from dmis.experiment.table import Comparison
from dmis.report.comparer import comparer_data, viewer_data
from dmis.report.plots import LINES, error_svg, map_png
from dmis.report.tables import overview, report_tables, winners
from dmis.report.templates import filled, write_page


def write_report(
    comparisons: Sequence[Comparison], path: str | os.PathLike[str], title: str = "Error against time"
) -> None:
    """Write a page that shows `comparisons`, one section each, with an overview if there are several; at least one."""
    if not comparisons:
        raise ValueError("comparisons must hold at least one, because a page needs something to show; got none")
    viewers = []
    for c in comparisons:
        images = {f"{rule}, {max(spp for _, spp in c.runs)} spp": of["RGB"] for rule, of in _largest(c).items()}
        viewers.append(viewer_data(c.scene, {"reference": c.reference.mean, **images}))
    page = filled(
        "report.html",
        title=title,
        sections=[_section(c) for c in comparisons],
        overview=overview(comparisons),
        share_colours=plot.palette("RdBu", 9),
        version=__version__,
        data=comparer_data(viewers),
    )
    write_page(path, page)


def _section(c: Comparison) -> dict[str, Any]:
    """Return what the template needs of a comparison."""
    rows = gains(c.runs)
    last = [g for g in rows if g.spp == max(g.spp for g in rows) and g.rule != PINNED]
    return {
        "comparison": c,
        "shape": c.reference.first.shape[:2],
        "fallbacks": fallbacks(c.runs),
        "balance": next(g for g in last if g.rule == "balance"),
        "winners": winners(c, last),
        "rivals": len(last) - 1,
        "plots": [error_svg(c, over, measure) for over, measure in LINES],
        "tables": report_tables(c, rows),
        "maps": share_maps(c),
    }


def _largest(c: Comparison) -> dict[str, Mapping[str, Array]]:
    """Return the layers of the images of the largest budget by rule."""
    largest = max(spp for _, spp in c.runs)
    return {rule: c.pictures[rule, spp] for rule, spp in c.runs if spp == largest and (rule, spp) in c.pictures}


def share_maps(c: Comparison) -> list[tuple[str, str, str]]:
    """Return the share map of each rule: name, note, and the URI of the image."""
    weights = {rule: layers["weight"] for rule, layers in _largest(c).items()}
    return [(rule, f"mean {weight.mean():.2f}", map_png(weight, "RdBu")) for rule, weight in weights.items()]
