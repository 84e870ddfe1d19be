"""Pictures, maps and captions for figures (needs matplotlib, extra ``plot``).

Weights are red where BRDF sampling gets the samples (w = 0) and blue where light sampling does (w = 1), as in the
thesis.
"""

from __future__ import annotations

import math
import os
import textwrap
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from dmis.base.vectors import Array
from dmis.image import tonemap

try:
    from matplotlib.axes import Axes
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure
    from matplotlib.ticker import FuncFormatter, Locator, LogFormatter, NullFormatter
except ImportError as missing:
    raise ImportError("figures need matplotlib: pip install 'dmis[plot]'") from missing
Window = tuple[tuple[int, int], tuple[int, int]]
"""Part of an image: first and end row, first and end column."""
TICKS = (
    (1, (1, 1.25, 1.5, 2, 2.5, 3, 4, 5, 6, 8)),
    (1, (1, 1.5, 2, 3, 4, 6)),
    (1, (1, 2, 5)),
    (1, (1, 3)),
    *((step, (1,)) for step in (1, 2, 3, 5, 10, 20)),
)
"""Ticks of logarithmic axes, from many to few: every how many powers of ten, and what these are multiplied by."""


def canvas(rows: int, columns: int, width: float, height: float, **options: Any) -> tuple[Figure, Any]:
    """Return a figure of `width` x `height` inches and its axes ``(rows, columns)``, to be written to a file.

    The figure has its own Agg canvas and does not belong to ``pyplot``: the backend of the process, its open figures
    and its settings stay as they are, and the figure is freed with its last reference. A notebook that has imported
    ``pyplot`` shows it by ``display(figure)``.

    Parameters
    ----------
    options
        Those of ``matplotlib.figure.Figure.subplots``.
    """
    figure = Figure(figsize=(width, height), layout="constrained")
    FigureCanvasAgg(figure)
    return figure, figure.subplots(rows, columns, squeeze=False, **options)


def picture(axis: Axes, image: Array, title: str = "", window: Window | None = None, exposure: float = 1.0) -> None:
    """Draw a linear RGB image ``(H, W, 3)``, or the `window` of it, with coordinates in pixels."""
    rows, columns = window or ((0, image.shape[0]), (0, image.shape[1]))
    pixels = tonemap(image[slice(*rows), slice(*columns)], exposure)
    axis.imshow(pixels, extent=_extent(rows, columns), interpolation="nearest")
    _pixels(axis, title)


def heat(axis: Axes, values: Array, title: str = "", window: Window | None = None, **options: Any) -> Any:
    """Draw a map ``(H, W)`` of one value per pixel, or of one per patch if `window` gives the pixels that it covers.

    Returns the mappable for `Figure.colorbar`; `options` are those of ``Axes.imshow``.
    """
    rows, columns = window or ((0, values.shape[0]), (0, values.shape[1]))
    mappable = axis.imshow(values, extent=_extent(rows, columns), interpolation="nearest", **options)
    _pixels(axis, title)
    return mappable


def weights(axis: Axes, w: Array, title: str = "", window: Window | None = None) -> Any:
    """Draw a map ``(H, W)`` of shares w of light samples: red 0 (BRDF only), white 1/2, blue 1 (light only)."""
    return heat(axis, w, title, window, cmap="RdBu", vmin=0, vmax=1)


def weight_bar(figure: Figure, mappable: Any, axes: Any, **options: Any) -> None:
    """Draw the colour bar of `weights` beside `axes`; `mappable` is what `weights` returns."""
    bar = figure.colorbar(mappable, ax=axes, label="share of light samples w", **options)
    bar.set_ticks([0, 0.25, 0.5, 0.75, 1], labels=["0 BRDF", "0.25", "0.5", "0.75", "1 light"])


def mark(axis: Axes, window: Window, colour: str, label: str = "") -> None:
    """Draw a frame around a part of an image."""
    from matplotlib.patches import Rectangle

    (top, bottom), (left, right) = window
    axis.add_patch(Rectangle((left, top), right - left, bottom - top, fill=False, edgecolor=colour, linewidth=2))
    if label:
        axis.annotate(
            label, (right, top), (3, 0), textcoords="offset points", color=colour, weight="bold", va="center",
            bbox={"boxstyle": "round,pad=0.15", "facecolor": "black", "edgecolor": "none", "alpha": 0.6},
        )  # fmt: skip


def shared_scale(maps: Sequence[Array], quantile: float = 0.995) -> float:
    """Return the `quantile` of the values of several maps: an upper end for their colours that ignores outliers."""
    return float(np.quantile(np.concatenate([np.ravel(m) for m in maps]), quantile))


def save(figure: Figure, path: str | os.PathLike[str], title: str, caption: str) -> None:
    """Write a figure as a PNG with its title above and its caption below, which the file's metadata repeat."""
    figure.suptitle(title, fontsize=13, weight="bold", parse_math=False)  # a scene may have any name
    width = figure.get_size_inches()[0]
    lines = textwrap.fill(" ".join(caption.split()), int(width * 13))
    figure.text(0.01, -0.01, lines, ha="left", va="top", fontsize=9.5, parse_math=False)
    Path(path).parent.mkdir(parents=True, exist_ok=True)
    metadata = {"Title": title, "Description": caption, "Software": "dmis"}
    figure.savefig(path, dpi=100, bbox_inches="tight", metadata=metadata)


def show(stem: str, folder: str | os.PathLike[str] = "figures/tutorials") -> list[Path]:
    """Show all open figures of ``pyplot`` in windows or in the notebook; without a screen, write them to files.

    The files are ``<stem>-1.png``, ``<stem>-2.png``, ... in `folder`. They are returned, and the figures closed.
    """
    import matplotlib.pyplot as plt

    if plt.get_backend().lower() != "agg":
        plt.show()
        return []
    paths = []
    for k, number in enumerate(plt.get_fignums(), 1):
        path = Path(folder) / f"{stem}-{k}.png"
        path.parent.mkdir(parents=True, exist_ok=True)
        plt.figure(number).savefig(path, dpi=100)
        paths.append(path)
    plt.close("all")
    return paths


def round_ticks(side: Any) -> None:
    """Label a logarithmic ``Axis`` at round numbers, as many as have room."""
    side.set_major_locator(_RoundTicks())
    side.set_major_formatter(FuncFormatter(_number))
    side.set_minor_formatter(NullFormatter())


def plain_exponents(figure: Figure) -> None:
    """Write 1e-5 in place of ten to a small raised -5 at the logarithmic axes and colour bars of a figure."""
    for axes in figure.axes:
        for side in (axes.xaxis, axes.yaxis):
            if isinstance(side.get_major_formatter(), LogFormatter):
                side.set_major_formatter(_PlainLogFormatter())
            if isinstance(side.get_minor_formatter(), LogFormatter):
                side.set_minor_formatter(_PlainLogFormatter())


class _PlainLogFormatter(LogFormatter):
    """The tick labels of `LogFormatter`, written by `_number`."""

    def __call__(self, value: float, pos: int | None = None) -> str:
        """Return the label of a tick; empty where `LogFormatter` has none."""
        return _number(value) if super().__call__(value, pos) else ""


class _RoundTicks(Locator):
    """Ticks at round numbers of a logarithmic axis, as many as their labels have room."""

    def __call__(self) -> list[float]:
        """Return the ticks of the axis's present range."""
        axis: Any = self.axis
        return self.tick_values(*axis.get_view_interval())

    def tick_values(self, vmin: float, vmax: float) -> list[float]:
        """Return the ticks of a range: the densest of `TICKS` whose labels do not touch each other."""
        low, high = sorted((vmin, vmax))
        ticks: list[float] = []
        for step, digits in TICKS:
            decades = range(step * math.floor(math.log10(low) / step), math.ceil(math.log10(high)) + 1, step)
            ticks = [value for k in decades for digit in digits if low <= (value := digit * 10.0**k) <= high]
            if self._has_room(ticks, math.log10(high / low)):
                break
        return ticks

    def _has_room(self, ticks: Sequence[float], decades: float) -> bool:
        """Whether the labels of `ticks` do not touch on an axis of so many decades."""
        axis: Any = self.axis
        points, box = 72 / axis.axes.figure.dpi, axis.axes.get_window_extent()
        size = axis.majorTicks[0].label1.get_fontsize()
        if axis.axis_name == "x":
            length, extents = box.width, [(0.65 * len(_number(tick)) + 0.8) * size for tick in ticks]
        else:
            length, extents = box.height, [1.5 * size] * len(ticks)
        places = np.log10(ticks) / decades * length * points
        return bool((np.diff(places) > (np.array(extents[1:]) + extents[:-1]) / 2).all())


def _number(value: float, _: int = 0) -> str:
    """Return a tick label."""
    text = f"{value:.3g}" if value >= 1e4 else f"{value:g}"
    return text.replace("e+0", "e").replace("e+", "e").replace("e-0", "e-")


def _extent(rows: tuple[int, int], columns: tuple[int, int]) -> tuple[float, float, float, float]:
    """Return the extent of an image for ``Axes.imshow``, with y downwards."""
    return columns[0], columns[1], rows[1], rows[0]


def _pixels(axis: Axes, title: str) -> None:
    """Label both axes in pixels, and write the title."""
    from matplotlib.ticker import MaxNLocator

    for side in (axis.xaxis, axis.yaxis):
        side.set_major_locator(MaxNLocator(4, integer=True))
    axis.tick_params(labelsize="x-small")
    axis.set_xlabel("x (pixels)", fontsize="small")
    axis.set_ylabel("y (pixels)", fontsize="small")
    axis.set_title(title, fontsize="medium")
