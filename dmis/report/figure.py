"""Figure of a comparison for a paper: the image with frames, and crops of each rule beside those of the reference.

The figure is drawn at the width that it has on the page, with a text of 7 points. In a PDF text and frames are vectors,
and images have their own pixels.
"""

from __future__ import annotations

import re
import textwrap
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine

from dmis import plot
from dmis.base.atomic_files import replacing
from dmis.base.validate import one_of
from dmis.base.vectors import Array
from dmis.base.window import Window, window_area
from dmis.experiment.convergence import METRICS, Gain
from dmis.experiment.metrics import flip, relative_error, squared_error
from dmis.experiment.reference import Reference
from dmis.experiment.table import Comparison
from dmis.report.comparer import show
from dmis.report.tables import chosen_gains

FRAMES = "#e8590c", "#1c7ed6", "#2f9e44", "#ae3ec9"
"""Colours of the frames of crops."""
CROP = 1 / 6
"""Side of an automatic crop over that of the image."""
NARROW = 5.0
"""Width in inches below which the whole image is above the crops, not beside them."""
GAP, LETTER = 0.04, 0.056
"""Space between panels and width of a letter, in inches."""
POINTS = 7
"""Size of the text."""


@dataclass(frozen=True, eq=False)
class Contestant:
    """A rule in a figure: linear RGB of the first seed ``(H, W, 3)``, its errors ``(H, W)``, and lines below."""

    rule: str
    image: Array
    errors: Array
    lines: tuple[str, ...]


def contestants(comparison: Comparison, rules: Sequence[str] = (), metric: str = "relmse") -> list[Contestant]:
    """Return `rules` in their order (`dmis.report.tables.chosen_gains`) at the largest budget of a comparison.

    The error that is written below each is by `metric`, one of `METRICS`.
    """
    spp = max(n for _, n in comparison.runs)
    by_rule = {g.rule: g for g in chosen_gains(comparison, rules, spp)}
    chosen = []
    for rule in rules or by_rule:
        image = comparison.pictures[rule, spp]["RGB"]
        errors = error_map(image, comparison.reference, metric)
        chosen.append(Contestant(rule, image, errors, _lines(by_rule[rule], metric, errors)))
    return chosen


def error_map(image: Array, reference: Reference | Array, metric: str = "relmse") -> Array:
    """Return the error of each pixel by a measure of `METRICS`, ``(H, W)``.

    By MSE and relMSE single values may be below 0, because the halves of a reference have noise of their own.
    """
    errors: dict[str, Any] = {"relmse": relative_error, "mse": squared_error, "flip": flip}
    values: Array = errors[one_of("metric", metric, errors)](image, reference)
    return values


def _lines(gain: Gain, metric: str, errors: Array) -> tuple[str, ...]:
    """Return what is written below a rule: its error, that over balance's with its interval, and CPU seconds."""
    seconds = f"{gain.cpu_seconds:.3g} CPU s"
    if metric == "flip":
        return f"FLIP {errors.mean():.3f}", seconds
    measure = gain.relmse if metric == "relmse" else gain.mse
    value, low, high = measure.over_balance
    over = [] if gain.rule == "balance" else [f"{value:.2f}×"]
    if over and np.isfinite(high) and not measure.over_balance.is_wide:
        over.append(f"({low:.2f}–{high:.2f})")
    return (f"{METRICS[metric]} {measure.error:.2e}".replace("e-0", "e-"), *over, seconds)


def automatic_crops(maps: Sequence[Array], number: int = 2) -> list[Window]:
    """Return the windows in which the rules' errors ``(H, W)`` differ most, and which do not touch.

    Of each window the root of its mean error by each rule is taken, without the 0.1 % of the pixels of largest error;
    of a single rule the windows have its largest errors. Each has a sixth of the image's sides, and at least 8 pixels:
    a small image may have less than `number` of them.
    """
    from scipy.ndimage import uniform_filter  # imported where used: it takes a quarter of a second

    height, width = maps[0].shape
    h, w = (min(n, max(8, round(n * CROP))) for n in (height, width))
    blurred = [uniform_filter(np.clip(m, 0, np.quantile(m, 0.999)), (h, w), mode="nearest") for m in maps]
    roots = np.sqrt(np.maximum(blurred, 0))
    difference = np.ptp(roots, axis=0) if len(maps) > 1 else roots[0]
    # corners of windows that lie in the image
    difference = difference[h // 2 : height - h + h // 2 + 1, w // 2 : width - w + w // 2 + 1].copy()
    windows: list[Window] = []
    for _ in range(number):
        y, x = np.unravel_index(int(difference.argmax()), difference.shape)
        if difference[y, x] < 0:
            break
        windows.append((int(x), int(y), int(x) + w, int(y) + h))
        difference[max(0, y - h) : y + h + 1, max(0, x - w) : x + w + 1] = -1
    return windows


def check_crops(crops: Sequence[Window], shape: tuple[int, int]) -> None:
    """Raise a ValueError unless windows lie in an image of `shape` (height, width), have one size, and are few."""
    if len(crops) > len(FRAMES):
        raise ValueError(f"a figure has at most {len(FRAMES)} crops; got {len(crops)}")
    for crop in crops:
        window_area(crop, shape[::-1])
    sizes = [f"{x1 - x0}x{y1 - y0}" for x0, y0, x1, y1 in crops]
    if len(set(sizes)) > 1:
        raise ValueError(f"crops of a figure must have one size; got {', '.join(sizes)}")


def draw(
    comparison: Comparison,
    shown: Sequence[Contestant],
    windows: Sequence[Window],
    *,
    exposure: float = 1.0,
    width: float = 7.0,
    errors: bool = False,
) -> Figure:
    """Return the figure: the reference with frames, and a row of crops for each of the windows.

    `exposure` is the factor of all images, `width` that of the figure in inches: 7 on a page, 3.33 in one of two
    columns. With `errors` a row of error maps of one scale follows each row of crops.
    """
    truth = comparison.reference.mean
    x0, y0, x1, y1 = windows[0]
    aspect, ratio = truth.shape[1] / truth.shape[0], (y1 - y0) / (x1 - x0)
    columns, rows = len(shown) + 1, len(windows) * (1 + errors)
    grid: list[Any] = [[f"{row} {k}" for k in range(columns)] for row in range(rows)]
    for names in grid[1::2] if errors else ():
        names[-1] = "."  # no panel: the reference has no errors
    crop, high = width / columns - GAP, rows * ratio  # width of a crop, and height of the panels over it
    if width >= NARROW:  # the whole image is as high as all rows of crops
        crop = (width - (columns + 1) * GAP - (rows - 1) * GAP * aspect) / (columns + high * aspect)
        whole = (high * crop + (rows - 1) * GAP) * aspect
        grid, sides = [["whole", *row] for row in grid], {"width_ratios": [whole, *[crop] * columns]}
    else:
        whole = (width - GAP) / aspect
        grid, sides = [["whole"] * columns, *grid], {"height_ratios": [whole, *[crop * ratio] * rows]}
        high += whole / crop
    layout = ConstrainedLayoutEngine(w_pad=GAP / 2, h_pad=GAP / 2, wspace=0, hspace=0)
    figure = Figure(figsize=(width, high * crop + 2), layout=layout)
    FigureCanvasAgg(figure)
    axes = figure.subplot_mosaic(grid, gridspec_kw=sides)
    roots = [np.sqrt(np.maximum(of.errors, 0)) for of in shown]
    scale = plot.shared_scale(roots) or 1.0
    plot.picture(axes["whole"], truth, exposure=exposure)
    for row, (window, colour) in enumerate(zip(windows, FRAMES, strict=False)):
        plot.mark(axes["whole"], window, colour, 1.5)
        for k, image in enumerate([*(of.image for of in shown), truth]):
            axis = axes[f"{row * (1 + errors)} {k}"]
            plot.picture(axis, image, window=window, exposure=exposure)
            plot.mark(axis, window, colour, 3)
        for k, root in enumerate(roots if errors else ()):
            part = root[window_area(window, root.shape[::-1])]
            plot.heat(axes[f"{2 * row + 1} {k}"], part, window=window, cmap="inferno", vmin=0, vmax=scale)
    _write_texts(
        shown, [axes[f"0 {k}"] for k in range(columns)], [axes[f"{rows - 1} {k}"] for k in range(columns - 1)], crop
    )
    for axis in axes.values():
        axis.set_aspect("auto")
        axis.spines[:].set_visible(False)
    figure.draw_without_rendering()
    panel = axes["0 0"].get_window_extent()  # as wide as it will be; the figure's height makes its pixels square
    figure.set_figheight(figure.get_figheight() + high * (panel.width - panel.height / ratio) / figure.dpi)
    figure.draw_without_rendering()
    return figure


def _write_texts(shown: Sequence[Contestant], top: Sequence[Axes], bottom: Sequence[Axes], crop: float) -> None:
    """Write names of rules above the panels at the `top`, and their lines below those at the `bottom`.

    Words stay whole: the text is smaller if one is wider than a `crop`, in inches.
    """
    wrap = partial(textwrap.wrap, width=int(crop / LETTER), break_long_words=False)
    style: dict[str, Any] = {"fontsize": POINTS, "parse_math": False}
    names = [*(wrap(re.sub("([:,])", r"\1 ", of.rule)) for of in shown), ["reference"]]
    texts = [axis.set_title("\n".join(name), pad=2, **style) for axis, name in zip(top, names, strict=True)]
    for axis, of in zip(bottom, shown, strict=True):
        lines = [part for line in of.lines for part in wrap(line)]
        texts.append(axis.set_xlabel("\n".join(lines), labelpad=2, **style))
    widest = max(text.get_window_extent().width for text in texts) / top[0].figure.dpi
    for text in texts:
        text.set_fontsize(POINTS * min(1, crop / widest))


def write_figure(
    comparison: Comparison,
    path: Path,
    rules: Sequence[str] = (),
    crops: Sequence[Window] = (),
    metric: str = "relmse",
    **options: Any,
) -> list[Window]:
    """Write a figure as pdf, png, svg, or html, which is the image comparer of reports, and return its windows.

    Parameters
    ----------
    path
        Its extension tells the format.
    rules, metric
        See `contestants`.
    crops
        Windows of one size, at most four; none: `automatic_crops`.
    options
        See `draw`.

    Raises
    ------
    ValueError
        If an argument does not fit the comparison.
    """
    shown = contestants(comparison, rules, metric)
    maps = [of.errors for of in shown]
    check_crops(crops, maps[0].shape)
    windows = list(crops) or automatic_crops(maps)
    if path.suffix.lower() == ".html":
        images = {f"{of.rule}: {', '.join(of.lines)}": of.image for of in shown}
        show(images, comparison.reference, comparison.scene).save(path)
        return windows
    figure = draw(comparison, shown, windows, **options)
    form = path.suffix.lower()[1:]
    metadata = {"pdf": {"CreationDate": None}, "svg": {"Date": None}}.get(form, {})
    path.parent.mkdir(parents=True, exist_ok=True)
    with replacing(path) as partial:
        figure.savefig(partial, format=form, dpi=300, metadata=metadata)
    return windows


def write_error_map(image: Array, reference: Reference, metric: str, path: Path) -> None:
    """Write a PNG file with the map of the errors of an image by a measure of `METRICS`.

    FLIP as it is, the others by their roots; the colours end where 0.5 % of the pixels are beyond.
    """
    one_of("extension of a map", path.suffix.lower(), (".png",))
    errors = error_map(image, reference, metric)
    values = errors if metric == "flip" else np.sqrt(np.maximum(errors, 0))
    figure, axes = plot.canvas(1, 1, 7, 1 + 6 * errors.shape[0] / errors.shape[1])
    drawn = plot.heat(axes[0, 0], values, cmap="inferno", vmin=0, vmax=plot.shared_scale([values]) or 1.0)
    name = METRICS[metric]
    figure.colorbar(drawn, ax=axes[0, 0], label=name if metric == "flip" else f"root of the pixel's {name}")
    plot.save(figure, path, f"{name} {errors.mean():.4g}", "Error of each pixel; 0.5 % of the pixels are clipped.")
