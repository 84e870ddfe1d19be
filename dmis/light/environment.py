"""Light from infinitely far away, given by a latitude-longitude map."""

from __future__ import annotations

import os
from copy import copy
from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar, Self

import numpy as np

from dmis.base.color import LUMINANCE
from dmis.base.patches import row_blocks
from dmis.base.validate import one_of
from dmis.base.vectors import Array, Selection, take
from dmis.brdf.texture import Image, Wrap, check_values
from dmis.image_reader import load_image
from dmis.light.light import InfiniteLight
from dmis.light.light_sample import INFINITE_DISTANCE, LightSample, Rgb, check_compensation, rgb
from dmis.samplers.warp import INV_PI, TWO_PI, atan2

INV_TWO_PI = INV_PI / 2
TWO_PI_SQUARED = np.float32(2 * np.pi**2)
LINEAR_STEPS = 8
"""Texels that are tried one by one, from where a guide table points, before a binary search."""
MIN_SIN = np.float32(1e-9)
"""Smallest sin(theta) that a density is divided by."""
MIN_EXCESS = 1e-5
"""Least share of a sky's power above its mean for which samples are compensated; below, it is rounding of float32."""


class EnvironmentSample(LightSample):
    """Light samples of an environment, whose map is looked up only for the directions that need it."""

    def __init__(self, light: EnvironmentLight, wi: Array, s: Array, t: Array, pdf: Array) -> None:
        self.wi, self.pdf, self.emits = wi, pdf, pdf > 0
        self.distance = np.full(1, INFINITE_DISTANCE)
        self._light, self._s, self._t = light, s, t

    def radiance_at(self, index: Selection | None) -> Array:
        return self._light._lookup(take(self._s, index), take(self._t, index))

    @cached_property
    def radiance(self) -> Array:  # type: ignore[override]
        return self.radiance_at(None)


@dataclass(frozen=True, eq=False)
class EnvironmentLight(InfiniteLight):
    """Light from infinitely far away, from a latitude-longitude map.

    Parameters
    ----------
    texels
        ``(H, W, 3)`` or ``(H, W, 1)`` linear radiance; row 0 is +z, column 0 begins at azimuth 0 (the +x axis),
        bilinear in between. Or the path of an image file, see `dmis.load_image`; a number or an RGB colour for the same
        radiance everywhere. Azimuths grow with the columns, as in pbrt, whose world is left-handed: for no mirrored
        panorama give ``to_world=numpy.diag((1, -1, 1))``.
    to_world
        3x3 rotation from the map's frame to the world.
    scale
        RGB factor.
    compensation
        Share of the light samples, in [0, 1), that are drawn in proportion to what exceeds the sky's mean radiance
        (Karlik et al. 2019); the others are drawn from the plain density below, so that light sampling alone reaches
        every direction. BRDF samples cover the even part of a sky well enough. None: that of the estimator's settings,
        see `dmis.estimator.settings.Settings`. The expected image does not depend on it.
    wrap
        Row with which the first and the last row are interpolated towards the poles: ``clamp``, the same row;
        ``repeat``, the row at the other pole, as in pbrt-v2 and v3.

    Notes
    -----
    Directions are sampled from a piecewise-constant density over texels, proportional to the mean luminance of the
    bilinear interpolant in the texel (its 1/8, 3/4, 1/8 stencil in both directions) times sin(theta): it is positive
    wherever the radiance is. ``p(wi) = p(u, v) / (2 pi^2 sin theta)``.
    """

    texels: Any
    to_world: Array | None = None
    scale: Rgb = (1.0, 1.0, 1.0)
    compensation: float | None = None
    wrap: Wrap = "clamp"
    positions: ClassVar[tuple[str, ...]] = ()
    radiances: ClassVar[tuple[str, ...]] = ("scale",)

    def __post_init__(self) -> None:
        if isinstance(self.texels, str | os.PathLike):
            object.__setattr__(self, "texels", load_image(self.texels))
        elif np.shape(self.texels) in ((), (3,)):
            object.__setattr__(self, "texels", rgb("texels", self.texels).reshape(1, 1, 3))
        check_compensation(self.compensation)
        one_of("wrap", self.wrap, ("clamp", "repeat"))
        _ = self._data

    @cached_property
    def _data(self) -> tuple[Image, Array | None]:
        """The scaled map as a texture; rotation from the map to the world, None if there is nothing to rotate."""
        texels = np.asarray(self.texels, np.float32)
        factor = rgb("scale", self.scale)[:, 0]
        check_values("texels", Image(texels), "finite and not negative", "they are radiance")
        if (factor != 1).any():  # maps are large
            brightest = texels.max(axis=(0, 1)).astype(float) * factor
            if not (brightest <= np.finfo(np.float32).max).all():
                raise ValueError(
                    f"texels times scale must be below 3.4e38, the largest float32; got {brightest.tolist()}"
                )
            texels = texels * factor
        rotation = np.eye(3) if self.to_world is None else np.asarray(self.to_world, float)
        if rotation.shape != (3, 3) or not np.allclose(rotation @ rotation.T, np.eye(3), atol=1e-4):
            raise ValueError(f"to_world must be a 3x3 rotation (or reflection); got {rotation.tolist()}")
        image = Image(texels, wrap=("repeat", self.wrap))
        return image, None if (rotation == np.eye(3)).all() else rotation.astype(np.float32)

    @cached_property
    def _distribution(self) -> tuple[Array, Array]:
        """Cumulative probability at the edges of texels in row order, ``(H * W + 1,)`` float64 from 0 on; texel
        densities over (u, v).
        """
        height, width, _ = self.texels.shape
        rows = self._data[0].texels  # one by one, because maps are large
        luminance = np.array([np.broadcast_to(row.astype(float), (width, 3)) @ LUMINANCE for row in rows])
        around = np.pad(luminance, ((0, 0), (1, 1)), mode="wrap")
        luminance = (around[:, :-2] + 6 * around[:, 1:-1] + around[:, 2:]) / 8
        around = np.pad(luminance, ((1, 1), (0, 0)), mode="wrap" if self.wrap == "repeat" else "edge")
        luminance = (around[:-2] + 6 * around[1:-1] + around[2:]) / 8
        sine = np.sin((np.arange(height) + 0.5) * np.pi / height)[:, None]
        weight = luminance * sine
        total = weight.sum()
        excess = np.maximum(luminance - total / (sine.sum() * width), 0) * sine
        if not total > 0:
            weight, total = np.ones_like(weight), float(weight.size)
        elif self.compensation and excess.sum() > MIN_EXCESS * total:
            # (1 - c) L / sum L + c max(L - mean L, 0) / sum max(L - mean L, 0)   (Karlik et al. 2019, as a mixture)
            weight = (1 - self.compensation) * weight / total + self.compensation * excess / excess.sum()
            total = weight.sum()
        weight = (weight / total).reshape(-1)
        return np.concatenate([[0.0], np.cumsum(weight)]), (weight * weight.size).astype(np.float32)

    def compensated(self, share: float) -> Self:
        """Return the light with `share` as its compensation; the light itself if its compensation is not None.

        There is one such light for each share. It is kept with this light, and pickled with it, so that tiles and
        processes find it; the texels are those of this light.
        """
        if self.compensation is not None or share == 0:
            _ = self._guide
            return self
        kept: dict[float, Any] = vars(self).setdefault("_compensated", {})
        if share not in kept:
            light = copy(self)
            for name in ("_compensated", "_distribution", "_guide"):
                vars(light).pop(name, None)
            vars(light)["compensation"] = check_compensation(share)
            _ = light._guide
            kept[share] = light
        return kept[share]

    def sample(self, p: Array, u: Array) -> LightSample:
        """Sample directions towards bright texels, `u` ``(2, N)``; `p` only matters for its shape."""
        height, width, _ = self.texels.shape
        edges = self._distribution[0]
        # float32 numbers are 2^-24 apart, wider than a dark texel's share: u1 fills the gaps
        u0 = u[0].astype(np.float64) + u[1].astype(np.float64) * 2.0**-24
        texel = self._texel(u0)
        low = edges.take(texel)
        share = edges.take(texel + 1) - low
        within = np.clip((u0 - low) / np.maximum(share, 1e-300), 0, 1).astype(np.float32)
        row = texel // width
        s = ((texel - row * width).astype(np.float32) + within) * np.float32(1 / width)
        t = (row.astype(np.float32) + u[1]) * np.float32(1 / height)
        phi, theta = TWO_PI * s, np.float32(np.pi) * t
        sin = np.sin(theta)
        local = np.stack([sin * np.cos(phi), sin * np.sin(phi), np.cos(theta)])
        density = (share * (height * width)).astype(np.float32)
        return EnvironmentSample(self, self._rotate(local), s, t, density / (TWO_PI_SQUARED * np.maximum(sin, MIN_SIN)))

    def _rotate(self, w: Array, back: bool = False) -> Array:
        """Return directions from the map's frame to the world's, or back."""
        rotation = self._data[1]
        if rotation is None:
            return w
        return (rotation.T if back else rotation) @ w

    @cached_property
    def _guide(self) -> np.ndarray:
        """Return where the search for u may begin: the texel of ``k / n`` for k = 0 ... n - 1, with n texels."""
        cdf = self._distribution[0][1:]
        first = np.empty(len(cdf), np.int32)
        for block in row_blocks(len(cdf), 2**16):
            first[block] = np.searchsorted(cdf, np.arange(block.start, block.stop) / len(cdf), side="right")
        return np.minimum(first, len(cdf) - 1, out=first)

    def _texel(self, u: Array) -> np.ndarray:
        """Return the first texel whose cumulative probability exceeds `u` ``(N,)``, as a binary search would.

        A guide table (Chen and Asau 1974) is within a texel or two of it most of the time, at a fraction of the cost.
        """
        cdf = self._distribution[0][1:]
        last = len(cdf) - 1
        texel = self._guide.take((u * len(cdf)).astype(np.int32))
        behind = np.flatnonzero(cdf.take(texel) <= u)
        for _ in range(LINEAR_STEPS):
            texel[behind] = np.minimum(texel[behind] + 1, last)
            behind = behind[cdf.take(texel.take(behind)) <= u.take(behind)]
        texel[behind] = np.searchsorted(cdf, u.take(behind), side="right")
        return np.minimum(texel, last)

    def hit(self, p: Array, wi: Array) -> LightSample:
        """Return the light samples of unit directions `wi` ``(3, N)``, all of which meet the sky."""
        height, width, _ = self.texels.shape
        s, t, sin = self._coordinates(wi)
        column = np.minimum((s * width).astype(np.int32), width - 1)
        row = np.minimum((t * height).astype(np.int32), height - 1)
        density = self._distribution[1].take(row * width + column)
        return EnvironmentSample(self, wi, s, t, density / (TWO_PI_SQUARED * np.maximum(sin, MIN_SIN)))

    def brightness(self, length: float) -> float:
        texels = np.broadcast_to(np.asarray(self.texels).max(axis=(0, 1)).astype(float), 3)
        return float((texels * self.scale).max())

    def radiance(self, wi: Array) -> Array:
        s, t, _ = self._coordinates(wi)
        return self._lookup(s, t)

    def _lookup(self, s: Array, t: Array) -> Array:
        """Return the radiance ``(3, N)`` at map coordinates."""
        return np.broadcast_to(self._data[0].at(s, t), (3, len(s)))

    def _coordinates(self, wi: Array) -> tuple[Array, Array, Array]:
        """Return map coordinates s, t in [0, 1) and sin(theta)."""
        x, y, z = self._rotate(wi, back=True)
        sin = np.sqrt(x * x + y * y)
        s = atan2(y, x) * INV_TWO_PI
        s = s - np.floor(s)
        return s, atan2(sin, z) * INV_PI, sin
