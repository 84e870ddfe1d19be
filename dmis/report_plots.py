"""What a report shows: error lines, maps and images, as SVG and as PNG in data URIs (extra ``plot``)."""

from __future__ import annotations

import base64
import html
import io
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from dmis import plot
from dmis.convergence import Axis, line
from dmis.experiment import Budget, Run
from dmis.oracle import Oracle
from dmis.variance import patch_mean
from dmis.vec import Array

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from dmis.compare import Comparison

COLOURS = ("#808080", "#d55e00", "#2b8cd6", "#00a17a", "#c565b0", "#d9a200", "#8a6fd1", "#b0413e", "#4fb3bf", "#7d8f1f")
"""Of rules in their order, the balance heuristic first; they can be told apart on white and on black."""
MARKS = {"o": "●", "s": "■", "^": "▲", "D": "◆"}
"""Of rules: the first for as many as there are colours, then the next. In plots, and as characters."""
INK = "#010203"
"""Stands for the colour of the page's text in drawings of `svg`."""
LABELS: dict[Axis, str] = {"spp": "camera samples per pixel", "rays": "rays", "seconds": "seconds"}


def look(number: int) -> tuple[str, str]:
    """Colour and mark of a rule, by its place in the order of rules."""
    return COLOURS[number % len(COLOURS)], list(MARKS)[number // len(COLOURS) % len(MARKS)]


def error_lines(
    axis: Axes, runs: Mapping[Budget, Sequence[Run]], over: Axis, oracle: Oracle | None = None, ink: str = "0.35"
) -> None:
    """Draw the root mean squared error of every rule over samples, rays or seconds, log-log.

    Lines are the root of the mean over seeds, bands go from the lowest to the highest seed. Dotted: the slope of
    N^-1/2. Dashed: the error of the best weights there are, in the time and rays of the balance heuristic.
    """
    feet = []
    for k, rule in enumerate(dict.fromkeys(rule for rule, _ in runs)):
        x, mse = line(runs, rule, over)
        colour, mark = look(k)
        each = mse.mean(axis=0), mse.min(axis=0), mse.max(axis=0)
        mean, low, high = (np.sqrt(np.where(v > 0, v, np.nan)) for v in each)
        axis.fill_between(x, low, high, color=colour, alpha=0.18, linewidth=0)
        axis.plot(x, mean, color=colour, marker=mark, markersize=4, linewidth=1.6, label=rule)
        feet += [(at, least * np.sqrt(at)) for at, least in zip(x, low, strict=True)]
        if rule == "balance" and oracle is not None:
            mark = "" if len(x) > 1 else "x"  # a single point has no line
            best = mean * np.sqrt(oracle.limit())
            axis.plot(x, best, color=ink, linestyle="--", linewidth=1.1, marker=mark, label="best weights")
    ends = np.array([min(x for x, _ in feet), max(x for x, _ in feet)])
    axis.set_xlabel(LABELS[over])
    axis.set_ylabel("RMSE (linear RGB)")
    if not any(least > 0 for _, least in feet):
        axis.text(0.5, 0.5, "no error above zero", ha="center", transform=axis.transAxes)
        return
    below = 0.8 * min(least for _, least in feet if least > 0) / np.sqrt(ends)
    axis.plot(ends, below, color=ink, linestyle=":", linewidth=1.1, label="N^(-1/2)")
    axis.set_xscale("log")
    axis.set_yscale("log")
    axis.grid(alpha=0.25, which="both", linewidth=0.5)
    _few_ticks(axis)


def _few_ticks(axis: Axes) -> None:
    """Plain numbers at 1, 2 and 5 times powers of ten; at more of them where all is within one."""
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

    def number(value: float, _: int) -> str:
        return f"{value:.3g}".replace("e+0", "e").replace("e+", "e") if value >= 1e4 else f"{value:g}"

    for side, (low, high) in ((axis.xaxis, axis.get_xlim()), (axis.yaxis, axis.get_ylim())):
        times = (1, 2, 5) if high > 10 * low else (1, 1.25, 1.5, 2, 2.5, 3, 4, 5, 6, 8)
        side.set_major_locator(LogLocator(subs=times, numticks=12))
        side.set_major_formatter(FuncFormatter(number))
        side.set_minor_formatter(NullFormatter())


def convergence(comparison: Comparison, path: Path) -> None:
    """The plot of errors over seconds and rays, with its caption, as a PNG file."""
    figure, axes = plot.canvas(1, 2, 12, 5)
    overs: tuple[Axis, ...] = ("seconds", "rays")
    for axis, over in zip(axes[0], overs, strict=True):
        error_lines(axis, comparison.runs, over, comparison.oracle)
    axis.legend(fontsize=8, loc="upper left", bbox_to_anchor=(1.01, 1), borderaxespad=0)  # of both
    plot.save(
        figure,
        path,
        f"{comparison.scene}: error against time and rays",
        f"""Root mean squared error against the reference, mean over {comparison.seeds} seed(s); bands go from the
        lowest to the highest seed. Time is from the pilot to the last sample, fit included. Dotted: N^-1/2. Errors
        below zero, which there are where the reference is as noisy, are left out.""",
    )


def error_svg(comparison: Comparison, over: Axis) -> str:
    """`error_lines` as an SVG element for a page, with the page's colour and fonts."""
    import matplotlib

    sides = ("text.color", "axes.labelcolor", "axes.edgecolor", "xtick.color", "ytick.color", "grid.color")
    style: dict[str, Any] = dict.fromkeys(sides, INK)
    style |= {"svg.fonttype": "none", "svg.hashsalt": f"{comparison.scene} {over}", "font.size": 9.5}
    style |= {"axes.spines.top": False, "axes.spines.right": False}
    with matplotlib.rc_context(style):  # type: ignore[arg-type]
        figure, axes = plot.canvas(1, 1, 5.4, 3.9)
        error_lines(axes[0, 0], comparison.runs, over, comparison.oracle, INK)
        file = io.StringIO()
        figure.savefig(file, format="svg", transparent=True, metadata={"Date": None})
    import matplotlib.pyplot as plt

    plt.close(figure)
    drawing = file.getvalue()
    drawing = drawing[drawing.index("<svg") :]
    drawing = re.sub(r"<metadata>.*?</metadata>", "", drawing, flags=re.S)
    drawing = re.sub(r'\sxmlns(:\w+)?="[^"]*"', "", drawing)  # a page of HTML needs none, and they look like links
    drawing = re.sub(r'<g id="[^"]*"', "<g", drawing)
    about = html.escape(f"Root mean squared error over {LABELS[over]}, {comparison.scene}")
    drawing = re.sub(
        r'<svg[^>]*?viewBox="([^"]*)"[^>]*>',
        lambda found: f'<svg viewBox="{found[1]}" role="img" aria-label="{about}">',
        drawing,
    )
    return drawing.replace(INK, "currentColor")


def png(pixels: Array) -> str:
    """``(H, W, 3)`` or ``(H, W)`` uint8 as a PNG in a data URI."""
    from PIL import Image  # matplotlib needs it too

    file = io.BytesIO()
    Image.fromarray(np.ascontiguousarray(pixels)).save(file, "PNG", optimize=True)
    return "data:image/png;base64," + base64.b64encode(file.getvalue()).decode("ascii")


def linear_png(image: Array) -> str:
    """Linear RGB ``(H, W, 3)`` as a PNG of twice the height: high bytes of its half floats above, low bytes below."""
    bits = np.clip(np.nan_to_num(image), -65504, 65504).astype(np.float16).view(np.uint16)
    return png(np.concatenate([bits >> 8, bits & 255]).astype(np.uint8))


def map_png(values: Array, palette: str, low: float, high: float) -> str:
    """A map ``(H, W)`` in the colours of matplotlib's `palette`; grey where there is no value."""
    import matplotlib

    colours = matplotlib.colormaps[palette].with_extremes(bad="#808080")
    shares = np.ma.masked_invalid((np.asarray(values, np.float64) - low) / (high - low))
    return png(colours(shares, bytes=True)[..., :3])


def palette_colours(palette: str, count: int = 256) -> list[str]:
    """Colours of matplotlib's `palette` from one end to the other, ``#rrggbb``."""
    import matplotlib
    from matplotlib.colors import to_hex

    return [to_hex(colour) for colour in matplotlib.colormaps[palette](np.linspace(0, 1, count))]


def variance_ratio(layers: Mapping[str, Array], baseline: Mapping[str, Array], patch: int = 4) -> Array:
    """Estimated variance of an image over that of another, per patch; NaN where the other has none."""
    mine, base = (patch_mean(image["variance"].astype(np.float64).mean(axis=2), patch) for image in (layers, baseline))
    return np.divide(mine, base, out=np.full_like(base, np.nan), where=base > 0)
