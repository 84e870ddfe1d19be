"""The figure of why a pixel is noisy; ``why`` is always a `dmis.experiment.explain.Explanation`."""

from __future__ import annotations

from typing import Any

import numpy as np

from dmis import plot
from dmis.base.vectors import TINY, Array, dot, frame
from dmis.brdf.cosines import Directions
from dmis.estimator.direct import SHADOW_END
from dmis.scene.scene import Scene
from dmis.scene.shading_points import ShadingPoints
from dmis.variance.curves import GRID, HALF

SIDE = 220
"""Pixels on a side of a hemisphere."""
DECADES = 4
"""Powers of ten below the largest value that the colours of a hemisphere tell apart."""
SHOWN, BARS = 200, 8
"""Numbers of samples of a technique, and of sources, that are drawn."""


def pixel_figure(why: Any, w: float) -> Any:
    """Return the figure: f, p_l, p_b, and f / p_w at `w` over directions with the samples, V(w), sources of V."""
    figure, axes = plot.canvas(2, 3, 12, 7.5)
    if why.vertex is None:
        for axis in (*axes[0], axes[1, 0]):
            axis.set_axis_off()
        axes[0, 0].set_title("no sample meets a light")
    else:
        surface, light, directions = why.vertex
        f, p_l, p_b = hemisphere(surface, light, why.job.scene)
        names = [f"$p_{name[0]}$, and {name.replace('brdf', 'BRDF')} samples" for name in why.job.settings.techniques]
        _hemisphere(figure, axes[0, 0], f, "f = light that is reflected")
        for axis, values, name, wi in zip(axes[0, 1:], (p_l, p_b), names, directions, strict=True):
            _hemisphere(figure, axis, values, name)
            x, y = _place(surface, wi[:, :SHOWN])
            axis.scatter(x, y, s=4, color="red", linewidths=0)
        p_w = w * p_l + (1 - w) * p_b
        _hemisphere(figure, axes[1, 0], f / np.maximum(p_w, TINY), f"$f / p_w$ at w = {w:.2g}")
    _curve(axes[1, 1], why, w)
    _bars(axes[1, 2], why)
    return figure


def hemisphere(surface: ShadingPoints, light: Any, scene: Scene) -> tuple[Array, Array, Array]:
    """Return f, p_l and p_b towards one light over the directions at one surface point, ``(SIDE, SIDE)`` each.

    Equal areas are equal solid angles; the normal is in the middle. NaN outside of the hemisphere. f is the mean of the
    channels.
    """
    across = np.linspace(-1, 1, SIDE, dtype=np.float32)
    x, y = (a.reshape(-1) for a in np.meshgrid(across, -across))
    r2 = np.minimum(x * x + y * y, np.float32(1))
    points = surface.take(np.zeros(len(x), int))
    s, t = frame(points.n)
    wi = (s * x + t * y) * np.sqrt(2 - r2) + points.n * (1 - r2)
    p = np.broadcast_to(points.p, wi.shape)
    sample, directions = light.seen_from(points.ng).hit(p, wi), Directions(points, wi)
    far = np.broadcast_to(sample.distance * SHADOW_END, x.shape)
    lit = sample.emits & points.same_side(wi) & ~scene.intersector.occluded(p, wi, far)
    f = (points.eval(directions) * directions.cos_i * sample.radiance * lit).mean(axis=0)
    outside = x * x + y * y > 1
    f, p_l, p_b = (np.where(outside, np.nan, a).reshape(SIDE, SIDE) for a in (f, sample.pdf, points.pdf(directions)))
    return f, p_l, p_b


def _place(surface: ShadingPoints, wi: Array) -> Array:
    """Return where directions ``(3, N)`` are in a hemisphere's picture, ``(2, N)``."""
    n = surface.n[:, :1]
    s, t = frame(n)
    return np.stack([dot(s, wi), dot(t, wi)]) / np.sqrt(1 + dot(n, wi))


def _hemisphere(figure: Any, axis: Any, values: Array, title: str) -> None:
    """Draw values over the hemisphere, on a logarithmic scale."""
    most = max(float(np.nanmax(values)), 1e-30)
    logarithms = np.log10(np.maximum(values / most, 10.0**-DECADES))
    image = axis.imshow(logarithms, extent=(-1, 1, -1, 1), cmap="magma", vmin=-DECADES, vmax=0)
    bar = figure.colorbar(image, ax=axis, shrink=0.7)
    bar.set_ticks([-DECADES, 0], labels=[f"{most * 10.0**-DECADES:.1e}", f"{most:.2g}"])
    axis.set_title(title, fontsize="medium")
    axis.set_axis_off()


def _curve(axis: Any, why: Any, w: float) -> None:
    """Draw V(w) over V(1/2), with the shares of the rules."""
    half = float(why.variance[HALF])
    if not half > 0:
        axis.set_title("no variance", fontsize="medium")
        return
    axis.semilogy(GRID, why.variance / half, ".-", color="black")
    axis.axvline(w, color="grey", linewidth=0.7)
    for (name, share), marker in zip(why.marks.items(), "os^D*vXP", strict=False):
        axis.plot(share, np.interp(share, GRID, why.variance) / half, marker, markersize=9, label=name, alpha=0.7)
    axis.set_title("V(w) / V(1/2), variance of a camera sample", fontsize="medium")
    axis.set_xlabel("share of light samples w")
    axis.legend(fontsize="small")


def _bars(axis: Any, why: Any) -> None:
    """Draw the largest sources of the variance, each with its part among places."""
    largest = sorted(why.sources.items(), key=lambda item: item[1][0])[-BARS:]
    names = [" ".join(map(str, source)).removesuffix("  0") for source, _ in largest]
    axis.barh(names, [v for _, (v, _) in largest], color="tab:blue", label="at a place")
    axis.barh(names, [p for _, (_, p) in largest], color="tab:grey", label="among places")
    axis.set_title("sources of V(1/2): light, technique, surface", fontsize="medium")
    axis.tick_params(axis="y", labelsize="x-small")
    axis.legend(fontsize="small", loc="lower right")
