"""Figure of a comparison for a paper: the image with frames, and crops of each rule beside those of the reference.

The figure is drawn at the width that it has on the page, with a text of 7 points. In a PDF text and frames are vectors,
and images have their own pixels.
"""

from __future__ import annotations

import re
import textwrap
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from dmis import plot
from dmis.base.atomic_files import replacing
from dmis.base.validate import did_you_mean, one_of
from dmis.base.vectors import Array
from dmis.base.window import Window, window_area
from dmis.experiment.convergence import METRICS, Gain, gains
from dmis.experiment.metrics import flip, relative_error, squared_error
from dmis.experiment.reference import Reference
from dmis.experiment.runs import PINNED
from dmis.experiment.table import Comparison
from dmis.image import tonemap
from dmis.report.comparer import show

FRAMES = "#e8590c", "#1c7ed6", "#2f9e44", "#ae3ec9"
"""Colours of the frames of crops."""
CROP = 1 / 6
"""Side of an automatic crop over that of the image."""
WIDTHS = (2.0, 20.0)
"""Least and largest width of a figure, in inches."""
NARROW = 5.0
"""Width in inches below which the whole image is above the crops, not beside them."""
GAP, LINE, LETTER, POINTS = 0.04, 0.125, 0.056, 7
"""Space between panels, height of a line of text and width of a letter, in inches; size of the text."""


@dataclass(frozen=True, eq=False)
class Contestant:
    """A rule in a figure.

    Attributes
    ----------
    rule
        Its name, above its crops.
    image
        ``(H, W, 3)`` linear RGB, of the first seed.
    errors
        Of each pixel, ``(H, W)``.
    lines
        What is written below.
    """

    rule: str
    image: Array
    errors: Array
    lines: tuple[str, ...]


def contestants(comparison: Comparison, rules: Sequence[str] = (), metric: str = "relmse") -> list[Contestant]:
    """Return the rules of a figure, at the largest budget of a comparison.

    Parameters
    ----------
    comparison
        See `dmis.experiment.table.read_comparison`.
    rules
        Names among its rules; none: all but the pinned baseline.
    metric
        What is written below each: one of `METRICS`.

    Raises
    ------
    ValueError
        If a rule is not among those of the comparison.
    """
    spp = max(n for _, n in comparison.runs)
    by_rule = {g.rule: g for g in gains(comparison.runs) if g.spp == spp}
    names = list(rules) or [rule for rule in by_rule if rule != PINNED]
    for name in names:
        if name not in by_rule:
            raise ValueError(
                f"rules of a figure must be among those of the comparison at {spp} samples per pixel, "
                f"{', '.join(by_rule)}; got {name!r}{did_you_mean(name, by_rule)}"
            )
    found = []
    for name in names:
        image = comparison.pictures[name, spp]["RGB"]
        errors = error_map(image, comparison.reference, metric)
        found.append(Contestant(name, image, errors, _lines(by_rule[name], metric, errors[comparison.area])))
    return found


def error_map(image: Array, reference: Reference | Array, metric: str = "relmse") -> Array:
    """Return the error of each pixel by a measure of `METRICS`, ``(H, W)``.

    By MSE and relMSE single values may be below 0, because the halves of a reference have noise of their own.
    """
    one_of("metric", metric, METRICS)
    if metric == "flip":
        return flip(image, reference)
    return relative_error(image, reference) if metric == "relmse" else squared_error(image, reference)


def _lines(gain: Gain, metric: str, errors: Array) -> tuple[str, ...]:
    """Return what is written below a rule: its error, that over balance's with its interval, and CPU seconds."""
    seconds = f"{gain.cpu_seconds:.3g} CPU s"
    if metric == "flip":
        return f"FLIP {errors.mean():.3f}", seconds
    measure = gain.relmse if metric == "relmse" else gain.mse
    lines = [f"{METRICS[metric]} {measure.error:.2e}".replace("e-0", "e-")]
    if gain.rule != "balance":
        lines += [f"{measure.over_balance.value:.2f}×"]
        low, high = measure.over_balance[1:]
        lines += [] if np.isnan(high) else [f"({low:.2f}–{high:.2f})"]
    return (*lines, seconds)


def automatic_crops(maps: Sequence[Array], number: int = 2) -> list[Window]:
    """Return the windows in which the rules' errors ``(H, W)`` differ most, and which do not touch.

    Of each window the root of its mean error by each rule is taken, without the 0.1 % of the pixels of largest error.

    Parameters
    ----------
    maps
        Errors of each rule; of a single one the windows have its largest errors.
    number
        Of windows, each of a sixth of the image's sides and at least 8 pixels. A small image may have fewer.
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


def given_crops(crops: Sequence[Sequence[int]], shape: tuple[int, int]) -> list[Window]:
    """Return the windows ``(x0, y0, x1, y1)`` of an image of `shape` (height, width).

    A ValueError if one is not inside of the image, or if their sizes differ: panels of a figure have one shape.
    """
    areas = [window_area(crop, shape[::-1]) for crop in crops]
    sizes = [f"{columns.stop - columns.start}x{rows.stop - rows.start}" for rows, columns in areas]
    if len(set(sizes)) > 1:
        raise ValueError(f"crops of a figure must have one size; got {', '.join(sizes)}")
    return [(columns.start, rows.start, columns.stop, rows.stop) for rows, columns in areas]


@dataclass(frozen=True)
class _Layout:
    """Places of a figure's panels, in inches from the top left.

    Attributes
    ----------
    width, height
        Of the figure.
    whole
        Width of the whole image, which is beside the crops in wide figures, and above them in narrow ones.
    crop
        Width and height of a crop.
    left, top
        Of the first crop.
    aspect
        Width of the whole image over its height.
    """

    width: float
    height: float
    whole: float
    crop: tuple[float, float]
    left: float
    top: float
    aspect: float

    @classmethod
    def of(cls, width: float, columns: int, rows: int, aspect: float, ratio: float, lines: tuple[int, int]) -> _Layout:
        """Return the layout of crops whose height over width is `ratio`, with `lines` of text above and below."""
        head, foot = 2 * GAP + LINE * lines[0], GAP + LINE * lines[1]
        if width >= NARROW:  # the image is as high as all rows
            crop = (width - columns * GAP - (rows - 1) * GAP * aspect) / (columns + rows * ratio * aspect)
            block = rows * crop * ratio + (rows - 1) * GAP
            return cls(
                width, head + block + foot, block * aspect, (crop, crop * ratio), block * aspect + GAP, head, aspect
            )
        crop = (width - (columns - 1) * GAP) / columns
        block = rows * crop * ratio + (rows - 1) * GAP
        top = width / aspect + GAP + head
        return cls(width, top + block + foot, width, (crop, crop * ratio), 0.0, top, aspect)

    def panel(self, figure: Figure, x: float, y: float, size: tuple[float, float]) -> Any:
        """Return axes without ticks."""
        w, h = size
        axis = figure.add_axes((x / self.width, 1 - (y + h) / self.height, w / self.width, h / self.height))
        axis.set_axis_off()
        return axis

    def crop_at(self, figure: Figure, column: int, row: int) -> Any:
        """Return the axes of a crop."""
        x, y = self.left + column * (self.crop[0] + GAP), self.top + row * (self.crop[1] + GAP)
        return self.panel(figure, x, y, self.crop)

    def text(self, figure: Figure, column: int, y: float, lines: Sequence[str]) -> None:
        """Write lines in the middle of a column, from `y` downwards."""
        x = self.left + column * (self.crop[0] + GAP) + self.crop[0] / 2
        for k, line in enumerate(lines):
            place = x / self.width, 1 - (y + k * LINE) / self.height
            figure.text(*place, line, fontsize=POINTS, ha="center", va="top", parse_math=False)


def draw(
    comparison: Comparison,
    shown: Sequence[Contestant],
    windows: Sequence[Window],
    *,
    exposure: float = 1.0,
    width: float = 7.0,
    errors: bool = False,
) -> Figure:
    """Return the figure: the reference with frames, and a row of crops for each window.

    Parameters
    ----------
    shown, windows
        See `contestants`, and `automatic_crops` or `given_crops`.
    exposure
        Factor of all images.
    width
        Of the figure in inches: 7 is that of a page, 3.33 that of one of two columns.
    errors
        Whether a row of error maps follows each row of crops; all have one scale.
    """
    if not WIDTHS[0] <= width <= WIDTHS[1]:
        raise ValueError(f"width of a figure must be from {WIDTHS[0]:g} to {WIDTHS[1]:g} inches; got {width:g}")
    truth = comparison.reference.mean
    columns, rows = len(shown) + 1, len(windows) * (1 + errors)
    x0, y0, x1, y1 = windows[0]
    size = width, columns, rows, truth.shape[1] / truth.shape[0], (y1 - y0) / (x1 - x0)
    letters = int(_Layout.of(*size, (1, 1)).crop[0] / LETTER)
    wrap = partial(textwrap.wrap, width=letters, break_long_words=False)
    above = [*(wrap(re.sub("([:,])", r"\1 ", of.rule)) for of in shown), ["reference"]]
    below = [[part for line in of.lines for part in wrap(line)] for of in shown]
    lines = max(map(len, above)), max(map(len, below))
    layout = _Layout.of(*size, lines)
    figure = Figure(figsize=(width, layout.height))
    FigureCanvasAgg(figure)
    y = layout.top if width >= NARROW else 0.0
    whole = layout.panel(figure, 0, y, (layout.whole, layout.whole / layout.aspect))
    plot.picture(whole, truth, exposure=exposure)
    whole.set_aspect("auto")
    for window, colour in zip(windows, FRAMES, strict=False):
        plot.mark(whole, window, colour, 1.5)
    end = layout.top + rows * (layout.crop[1] + GAP)
    for k, name in enumerate(above):
        layout.text(figure, k, layout.top - GAP / 2 - LINE * len(name), name)
        image = truth if k == len(shown) else shown[k].image
        for row, (window, colour) in enumerate(zip(windows, FRAMES, strict=False)):
            pixels = tonemap(image[window_area(window, image.shape[1::-1])], exposure)
            _pixels(layout.crop_at(figure, k, row * (1 + errors)), pixels, colour)
    roots = [np.sqrt(np.maximum(of.errors, 0)) for of in shown]
    scale = plot.shared_scale(roots) or 1.0
    for k, root in enumerate(roots):
        layout.text(figure, k, end, below[k])
        for row, window in enumerate(windows if errors else ()):
            part = root[window_area(window, root.shape[::-1])]
            _pixels(layout.crop_at(figure, k, 2 * row + 1), part, cmap="inferno", vmin=0, vmax=scale)
    widest = max(text.get_window_extent().width for text in figure.texts) / figure.dpi
    for text in figure.texts:
        text.set_fontsize(POINTS * min(1, (layout.crop[0] + GAP / 2) / widest))
    return figure


def _pixels(axis: Any, values: Array, colour: str = "", **options: Any) -> None:
    """Fill a panel with pixels, and with a frame of a `colour`."""
    axis.imshow(values, interpolation="nearest", aspect="auto", **options)
    if colour:
        height, width = values.shape[:2]
        frame = Rectangle((-0.5, -0.5), width, height, fill=False, edgecolor=colour, linewidth=3)
        axis.add_patch(frame)


def write_figure(
    comparison: Comparison,
    path: Path,
    rules: Sequence[str] = (),
    crops: Sequence[Sequence[int]] = (),
    metric: str = "relmse",
    **options: Any,
) -> list[Window]:
    """Write a figure as PDF, PNG, or as a page with linked zoom (.html), and return its windows.

    Parameters
    ----------
    path
        Its extension tells the format. The page is the image comparer of reports, and has no crops.
    rules, metric
        See `contestants`.
    crops
        See `given_crops`; none: `automatic_crops`.
    options
        See `draw`.

    Raises
    ------
    ValueError
        If the extension is another one, or an argument does not fit.
    """
    one_of("extension of a figure", path.suffix.lower(), (".pdf", ".png", ".html"))
    shown = contestants(comparison, rules, metric)
    if len(crops) > len(FRAMES):
        raise ValueError(f"a figure has at most {len(FRAMES)} crops; got {len(crops)}")
    maps = [of.errors for of in shown]
    windows = given_crops(crops, maps[0].shape) if crops else automatic_crops(maps)
    path.parent.mkdir(parents=True, exist_ok=True)
    if path.suffix.lower() == ".html":
        images: Mapping[str, Array] = {f"{of.rule}: {', '.join(of.lines)}": of.image for of in shown}
        show(images, comparison.reference, comparison.scene).save(path)
        return windows
    figure = draw(comparison, shown, windows, **options)
    form = path.suffix.lower()[1:]
    metadata = {"CreationDate": None} if form == "pdf" else {}
    with replacing(path) as partial:
        figure.savefig(partial, format=form, dpi=300, metadata=metadata)
    return windows


def write_error_map(image: Array, reference: Reference, metric: str, path: Path) -> None:
    """Write the map of the errors of an image by a measure of `METRICS`.

    FLIP as it is, the others by their roots; the colours end where 0.5 % of the pixels are beyond.

    Parameters
    ----------
    path
        A PNG file.
    """
    one_of("extension of a map", path.suffix.lower(), (".png",))
    errors = error_map(image, reference, metric)
    values = errors if metric == "flip" else np.sqrt(np.maximum(errors, 0))
    figure, axes = plot.canvas(1, 1, 7, 1 + 6 * errors.shape[0] / errors.shape[1])
    drawn = plot.heat(axes[0, 0], values, cmap="inferno", vmin=0, vmax=plot.shared_scale([values]) or 1.0)
    name = METRICS[metric]
    figure.colorbar(drawn, ax=axes[0, 0], label=name if metric == "flip" else f"root of the pixel's {name}")
    plot.save(figure, path, f"{name} {errors.mean():.4g}", "Error of each pixel; 0.5 % of the pixels are clipped.")
