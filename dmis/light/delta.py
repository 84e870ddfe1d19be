"""Lights: plain data with ``sample`` and ``hit``, for batches of receiving points.

``sample(p, u)`` samples directions towards the light, ``hit(p, wi)`` evaluates given directions; both return a
`LightSample`, so an estimator treats a light sample and a BRDF sample alike, and traces a shadow ray only where
`LightSample.emits`. Visibility is never tested here. pdfs are per solid angle and belong to ``sample``.

Here are the lights with a single direction; those with an area are in `dmis.light.area`, the sky is in
`dmis.light.environment`. Point, spot and distant lights are deltas: they have no pdf, take no part in MIS, and
``sample`` ignores `u`.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

import numpy as np

from dmis.base.vectors import TINY, Array, dot
from dmis.light.light import DeltaLight
from dmis.light.light_sample import INFINITE_DISTANCE, LightSample, Rgb, direction, point, rgb


@dataclass(frozen=True, eq=False)
class PointLight(DeltaLight):
    """A point that emits equally in all directions. A delta light: it takes no part in MIS.

    Parameters
    ----------
    position
        Three numbers, in units of the scene.
    intensity
        Power per solid angle, linear RGB: at the distance d a surface that faces the point gets ``intensity / d^2``.
    """

    position: Rgb
    intensity: Rgb
    positions: ClassVar[tuple[str, ...]] = ("position",)
    intensities: ClassVar[tuple[str, ...]] = ("intensity",)

    def __post_init__(self) -> None:
        _ = self._data

    @cached_property
    def _data(self) -> tuple[Array, Array]:
        return point("position", self.position), rgb("intensity", self.intensity)

    def sample(self, p: Array, u: Array | None = None) -> LightSample:
        position, intensity = self._data
        to = position - p
        inverse2 = 1 / np.maximum(dot(to, to), TINY)
        inverse = np.sqrt(inverse2)
        one = np.ones_like(inverse)
        return LightSample(to * inverse, 1 / inverse, intensity * inverse2, one, one > 0)

    def is_at(self, point: Array, tolerance: float) -> bool:
        """Return whether the light stands at `point` ``(3,)``, up to rounding or `tolerance`."""
        return np.allclose(self.position, point, rtol=1e-6, atol=tolerance)


@dataclass(frozen=True, eq=False)
class SpotLight(DeltaLight):
    """A point light that shines along `direction`, full inside of a cone, dark outside of another. A delta light.

    In between the falloff is ``d^4``, d linear in the cosine, as in pbrt-v2 and v3.

    Parameters
    ----------
    position
        Three numbers, in units of the scene.
    direction
        Where it shines; of any length but 0.
    intensity
        Power per solid angle on the axis, linear RGB.
    outer, inner
        Half angles of the cones in degrees, ``0 <= inner <= outer <= 180``.
    smooth
        Whether the falloff is ``3 d^2 - 2 d^3``, as in pbrt-v4.
    """

    position: Rgb
    direction: Rgb
    intensity: Rgb
    outer: float = 30.0
    inner: float = 25.0
    smooth: bool = False
    positions: ClassVar[tuple[str, ...]] = ("position",)
    intensities: ClassVar[tuple[str, ...]] = ("intensity",)

    def __post_init__(self) -> None:
        if not 0 <= self.inner <= self.outer <= 180:
            raise ValueError(f"need 0 <= inner <= outer <= 180 degrees; got inner {self.inner}, outer {self.outer}")
        _ = self._data

    @cached_property
    def _data(self) -> tuple[Array, Array, Array, np.float32, np.float32]:
        outer, inner = (np.float32(2 * np.sin(np.radians(a) / 2) ** 2) for a in (self.outer, self.inner))
        axis = direction("direction", self.direction)
        return point("position", self.position), axis, rgb("intensity", self.intensity), outer, inner

    def sample(self, p: Array, u: Array | None = None) -> LightSample:
        position, axis, intensity, outer, inner = self._data
        to = position - p
        inverse2 = 1 / np.maximum(dot(to, to), TINY)
        inverse = np.sqrt(inverse2)
        to *= inverse
        off = to + axis
        versine = dot(off, off) / 2  # 1 - cos, which has all its digits in a narrow cone
        d = np.clip((outer - versine) / max(outer - inner, np.float32(1e-30)), 0, 1)
        falloff = d * d * (3 - 2 * d) if self.smooth else (d * d) ** 2
        radiance = intensity * (inverse2 * falloff)
        return LightSample(to, 1 / inverse, radiance, np.ones_like(inverse), versine < outer)


@dataclass(frozen=True, eq=False)
class DistantLight(DeltaLight):
    """Parallel light from one direction. A delta light: it takes no part in MIS.

    Parameters
    ----------
    direction
        Towards the light, from where it comes; of any length but 0.
    radiance
        Linear RGB; times a BRDF and a cosine it is what a surface reflects (an irradiance, in other words).
    """

    direction: Rgb
    radiance: Rgb
    positions: ClassVar[tuple[str, ...]] = ()
    radiances: ClassVar[tuple[str, ...]] = ("radiance",)

    def __post_init__(self) -> None:
        _ = self._data

    @cached_property
    def _data(self) -> tuple[Array, Array]:
        return direction("direction", self.direction), rgb("radiance", self.radiance)

    def sample(self, p: Array, u: Array | None = None) -> LightSample:
        """Return the direction of the light, the same ``(3, 1)`` for all points `p` ``(3, N)``."""
        axis, radiance = self._data
        one = np.ones(p.shape[1], np.float32)
        return LightSample(np.repeat(axis, p.shape[1], axis=1), one * INFINITE_DISTANCE, radiance, one, one > 0)
