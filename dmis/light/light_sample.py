"""Light samples: directions towards a light with its distance, radiance and pdf; checks of the fields of lights."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from dmis.base import validate
from dmis.base.vectors import TINY, Array, Selection, dot, take

Rgb = tuple[float, float, float]
INFINITE_DISTANCE = np.float32(1e30)
"""Distance of lights that are infinitely far away."""
ANY_POINT = np.zeros((3, 1), np.float32)
"""Point at which to look up the radiance of a light that emits the same everywhere."""
_FLOAT32_MAX = 3.4e38


@dataclass(eq=False)
class LightSample:
    """N directions towards one light, sampled or given.

    Attributes
    ----------
    wi
        Unit directions towards the light, ``(3, N)``.
    distance
        To the light, ``(N,)``; `INFINITE_DISTANCE` if it is infinitely far away.
    radiance
        ``(3, 1)`` or ``(3, N)``, as if every entry was emitted towards the receiver.
    pdf
        Density of the light's own sampling at wi, ``(N,)``; 0 where wi misses the light. 1 for delta lights.
    emits
        Whether wi meets the light's bright side, ``(N,)`` bool.
    """

    wi: Array
    distance: Array
    radiance: Array
    pdf: Array
    emits: Array

    def radiance_at(self, index: Selection | None) -> Array:
        """Return the radiance along the directions `index`, ``(3, 1)`` or ``(3, K)``."""
        return take(self.radiance, index)


def flat_light_sample(to: Array, normal: Array, area: float, radiance: Array) -> LightSample:
    """Return the sample of a flat light along `to`, a point on it minus the receiver; pdf ``d^2 / (area |cos|)``."""
    distance2 = np.maximum(dot(to, to), TINY)
    inverse = 1 / np.sqrt(distance2)
    cos = -dot(normal, to) * inverse
    pdf = distance2 / (np.float32(area) * np.maximum(np.abs(cos), np.float32(1e-12)))
    return LightSample(to * inverse, distance2 * inverse, radiance, pdf, cos > 0)


def flat_light_hit(wi: Array, distance: Array, cos: Array, is_hit: Array, area: float, radiance: Array) -> LightSample:
    """Return the sample of a flat light that directions hit (or not) at `distance`; `cos` = normal . wi."""
    reach = np.where(is_hit, distance, np.float32(0))  # the square of a miss's distance may overflow
    pdf = reach * reach / (np.float32(area) * np.maximum(np.abs(cos), np.float32(1e-12)))
    return LightSample(wi, distance, radiance, pdf, is_hit & (cos < 0))


def rgb(name: str, value: Rgb) -> Array:
    """Return a colour as ``(3, 1)`` float32; refuse one that is negative or not finite, and call it `name`."""
    out = np.asarray(value, np.float64).reshape(-1)
    if out.shape == (1,):
        out = np.repeat(out, 3)
    if out.shape != (3,) or not (out <= _FLOAT32_MAX).all() or (out < 0).any():
        raise ValueError(f"{name} must be three finite non-negative numbers (linear RGB) below 3.4e38; got {value}")
    return out.astype(np.float32)[:, None]


def point(name: str, value: Rgb) -> Array:
    """Return a position as ``(3, 1)`` float32; refuse one that is not finite or too far, and call it `name`."""
    out = validate.vector(name, value)
    if np.abs(out).max() > validate.FARTHEST:
        raise ValueError(
            f"{name} must be within {validate.FARTHEST:g} of the origin along each axis; got {out.tolist()}"
        )
    return out.astype(np.float32)[:, None]


def direction(name: str, value: Rgb) -> Array:
    """Return a unit vector along `value` as ``(3, 1)`` float32; refuse zero or not finite, and call it `name`."""
    return validate.direction(name, value).astype(np.float32)[:, None]


def check_compensation(share: Any) -> float | None:
    """Return the compensation of a sky as a float or None; raise a ValueError unless it is in [0, 1)."""
    if share is None:
        return None
    if isinstance(share, bool) or not isinstance(share, int | float | np.number) or not 0 <= share < 1:
        raise ValueError(f"compensation must be in [0, 1), so that light samples reach all of the sky; got {share!r}")
    return float(share)
