"""Pictures, maps and captions for figures (needs matplotlib, extra ``plot``).

Weights are red where BRDF sampling gets the samples (w = 0) and blue where light sampling does (w = 1), as in the
thesis.
"""

from __future__ import annotations

import os
import textwrap
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from dmis.image import tonemap
from dmis.vec import Array

try:
    import matplotlib
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
except ImportError as missing:
    raise ImportError("figures need matplotlib: pip install 'dmis[plot]'") from missing

Window = tuple[tuple[int, int], tuple[int, int]]
"""Rows and columns, first and end."""


def canvas(rows: int, columns: int, width: float, height: float, **options: Any) -> tuple[Figure, Any]:
    """A figure of `width` x `height` inches and its axes ``(rows, columns)``, without a window on the screen."""
    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(rows, columns, figsize=(width, height), layout="constrained", squeeze=False, **options)
    return figure, axes


def picture(axis: Axes, image: Array, title: str = "", window: Window | None = None, exposure: float = 1.0) -> None:
    """Show linear RGB, or the part of it in `window`, with coordinates in pixels."""
    rows, columns = window or ((0, image.shape[0]), (0, image.shape[1]))
    part = tonemap(image[slice(*rows), slice(*columns)], exposure)
    axis.imshow(part, extent=_extent(rows, columns), interpolation="nearest")
    _pixels(axis, title)


def heat(axis: Axes, values: Array, title: str = "", window: Window | None = None, **options: Any) -> Any:
    """Show a map ``(H, W)`` of one value per pixel, or of one per patch if `window` says which pixels it covers.

    Returns what `Figure.colorbar` needs; `options` are those of ``Axes.imshow``.
    """
    rows, columns = window or ((0, values.shape[0]), (0, values.shape[1]))
    shown = axis.imshow(values, extent=_extent(rows, columns), interpolation="nearest", **options)
    _pixels(axis, title)
    return shown


def weights(axis: Axes, w: Array, title: str = "", window: Window | None = None) -> Any:
    """Show shares of light samples: red 0 (BRDF only), white 1/2, blue 1 (light only)."""
    return heat(axis, w, title, window, cmap="RdBu", vmin=0, vmax=1)


def weight_bar(figure: Figure, shown: Any, axes: Any, **options: Any) -> None:
    """The colour bar of `weights`."""
    bar = figure.colorbar(shown, ax=axes, label="share of light samples w", **options)
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
    """An upper end for the colours of several maps, which a few spikes do not set."""
    return float(np.quantile(np.concatenate([np.ravel(m) for m in maps]), quantile))


def save(figure: Figure, path: str | os.PathLike[str], title: str, caption: str) -> None:
    """Write a PNG with its title above and its caption below; both are also in the file's metadata."""
    figure.suptitle(title, fontsize=13, weight="bold", parse_math=False)  # a scene may have any name
    width = figure.get_size_inches()[0]
    lines = textwrap.fill(" ".join(caption.split()), int(width * 13))
    figure.text(0.01, -0.01, lines, ha="left", va="top", fontsize=9.5, parse_math=False)
    Path(path).parent.mkdir(parents=True, exist_ok=True)
    metadata = {"Title": title, "Description": caption, "Software": "dmis"}
    figure.savefig(path, dpi=100, bbox_inches="tight", metadata=metadata)
    import matplotlib.pyplot as plt

    plt.close(figure)


def show(stem: str, folder: str | os.PathLike[str] = "figures/tutorials") -> list[Path]:
    """Show all open figures in windows; where there is no screen, write them to ``<stem>-1.png``, ``<stem>-2.png``, ...
    in `folder`, close them, and return the files.
    """
    import matplotlib.pyplot as plt

    if matplotlib.get_backend().lower() != "agg":
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


def _extent(rows: tuple[int, int], columns: tuple[int, int]) -> tuple[float, float, float, float]:
    return columns[0], columns[1], rows[1], rows[0]


def _pixels(axis: Axes, title: str) -> None:
    from matplotlib.ticker import MaxNLocator

    for side in (axis.xaxis, axis.yaxis):
        side.set_major_locator(MaxNLocator(4, integer=True))
    axis.tick_params(labelsize=7)
    axis.set_xlabel("x (pixels)", fontsize=8)
    axis.set_ylabel("y (pixels)", fontsize=8)
    axis.set_title(title, fontsize=10)
