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

from dmis.base.atomic_files import replacing
from dmis.base.vectors import Array
from dmis.base.window import Window, window_area
from dmis.image import tonemap

try:
    from matplotlib import colormaps
    from matplotlib.axes import Axes
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.colors import to_hex
    from matplotlib.figure import Figure
    from matplotlib.patches import Rectangle
    from matplotlib.ticker import FuncFormatter, LogLocator, MaxNLocator, NullFormatter
except ImportError as missing:
    raise ImportError("figures need matplotlib: pip install 'dmis[plot]'") from missing


def canvas(rows: int, columns: int, width: float, height: float, **options: Any) -> tuple[Figure, Any]:
    """Return a figure of `width` x `height` inches and its axes ``(rows, columns)``, to be written to a file.

    It has its own Agg canvas and does not belong to ``pyplot``, whose backend, figures and settings stay as they are. A
    notebook that has imported ``pyplot`` shows it by ``display(figure)``. `options` are those of ``Figure.subplots``.
    """
    figure = Figure(figsize=(width, height), layout="constrained")
    FigureCanvasAgg(figure)
    return figure, figure.subplots(rows, columns, squeeze=False, **options)


def picture(axis: Axes, image: Array, title: str = "", window: Window | None = None, exposure: float = 1.0) -> None:
    """Draw a linear RGB image ``(H, W, 3)``, or the `window` of it; coordinates are pixels, without ticks."""
    pixels = tonemap(image[window_area(window, image.shape[1::-1])], exposure)
    axis.imshow(pixels, extent=_extent(window, image), interpolation="nearest")
    _pixels(axis, title)


def heat(axis: Axes, values: Array, title: str = "", window: Window | None = None, **options: Any) -> Any:
    """Draw a map ``(H, W)`` of one value per pixel, or per patch if `window` gives the pixels that it covers.

    Returns the mappable for `Figure.colorbar`; `options` are those of ``Axes.imshow``.
    """
    mappable = axis.imshow(values, extent=_extent(window, values), interpolation="nearest", **options)
    _pixels(axis, title)
    return mappable


def weights(axis: Axes, w: Array, title: str = "", window: Window | None = None) -> Any:
    """Draw a map ``(H, W)`` of shares w of light samples: red 0 (BRDF only), white 1/2, blue 1 (light only)."""
    return heat(axis, w, title, window, cmap="RdBu", vmin=0, vmax=1)


def weight_bar(
    figure: Figure, mappable: Any, axes: Any, label: str = "share of light samples w", **options: Any
) -> None:
    """Draw the colour bar of `weights` beside `axes`; `mappable` is what `weights` returns."""
    bar = figure.colorbar(mappable, ax=axes, label=label, **options)
    bar.set_ticks([0, 0.25, 0.5, 0.75, 1], labels=["0 BRDF", "0.25", "0.5", "0.75", "1 light"])


def mark(axis: Axes, window: Window, colour: str, width: float = 2, gap: int = 0) -> None:
    """Draw a frame around a part of an image: a line of `width` points, `gap` pixels outside of the part."""
    x0, y0, x1, y1 = window
    corner, sides = (x0 - gap, y0 - gap), (x1 - x0 + 2 * gap, y1 - y0 + 2 * gap)
    axis.add_patch(Rectangle(corner, *sides, fill=False, edgecolor=colour, linewidth=width))


def shared_scale(maps: Sequence[Array], quantile: float = 0.995) -> float:
    """Return the `quantile` of the values of several maps: an upper end for their colours that ignores outliers."""
    return float(np.quantile(np.concatenate([np.ravel(m) for m in maps]), quantile))


def palette(name: str, count: int = 256) -> list[str]:
    """Return colours of matplotlib's palette of a name from one end to the other, ``#rrggbb``."""
    return [to_hex(colour) for colour in colormaps[name](np.linspace(0, 1, count))]


def save(figure: Figure, path: str | os.PathLike[str], title: str, caption: str) -> None:
    """Write a figure as a PNG with its title above and its caption below, which the file's metadata repeat."""
    figure.suptitle(title, fontsize=13, weight="bold", parse_math=False)  # a scene may have any name
    width = figure.get_size_inches()[0]
    lines = textwrap.fill(" ".join(caption.split()), int(width * 13))
    figure.text(0.01, -0.01, lines, ha="left", va="top", fontsize=9.5, parse_math=False)
    Path(path).parent.mkdir(parents=True, exist_ok=True)
    metadata = {"Title": title, "Description": caption, "Software": "dmis"}
    with replacing(path) as partial:
        figure.savefig(partial, format="png", dpi=100, bbox_inches="tight", metadata=metadata)


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
    """Label a logarithmic ``Axis`` at round numbers, few enough to have room in its present range."""
    low, high = side.get_view_interval()
    decades = math.log10(high / low)
    powers = LogLocator(subs=(1, 3) if decades < 3 else (1,), numticks=7)
    side.set_major_locator(MaxNLocator(3, steps=[1, 2, 5, 10]) if decades < 1 else powers)
    side.set_major_formatter(FuncFormatter(tick_text))
    side.set_minor_formatter(NullFormatter())


def tick_text(value: float, _: int = 0) -> str:
    """Return the label of a tick: 1e-5, and no ten to a raised -5."""
    text = f"{value:.3g}" if value >= 1e4 else f"{value:g}"
    return text.replace("e+0", "e").replace("e+", "e").replace("e-0", "e-")


def _extent(window: Window | None, values: Array) -> tuple[float, float, float, float]:
    """Return the extent of a window for ``Axes.imshow``, with y downwards; without one that of the array."""
    x0, y0, x1, y1 = window or (0, 0, values.shape[1], values.shape[0])
    return x0, x1, y1, y0


def _pixels(axis: Axes, title: str) -> None:
    """Leave out ticks, and write the title."""
    axis.set(xticks=[], yticks=[])
    axis.set_title(title, fontsize="medium")
