"""Light samples: directions towards a light with its distance, radiance and pdf; checks of the fields of lights."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from dmis.base import validate
from dmis.base.vectors import TINY, Array, Selection, dot, take
from dmis.brdf.texture import check_values
from dmis.samplers.warp import cone_pdf, square_to_cone, to_world

Rgb = tuple[float, float, float]
INFINITE_DISTANCE = np.float32(1e30)
"""Distance of lights that are infinitely far away."""
ANY_POINT = np.zeros((3, 1), np.float32)
"""Point at which to look up the radiance of a light that emits the same everywhere."""
_BELOW_1 = float(np.nextafter(1, 0))
_MIN_FAR_END = np.float32(1e-12)  # of directions that lead away from a sphere, whose distances are not used


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


def flat_light_sample(to: Array, normal: Array, area: Array | float, radiance: Array) -> LightSample:
    """Return the sample of a flat light along `to`, a point on it minus the receiver; pdf ``d^2 / (area |cos|)``."""
    distance2 = np.maximum(dot(to, to), TINY)
    inverse = 1 / np.sqrt(distance2)
    cos = -dot(normal, to) * inverse
    pdf = distance2 / (np.float32(area) * np.maximum(np.abs(cos), np.float32(1e-12)))
    return LightSample(to * inverse, distance2 * inverse, radiance, pdf, cos > 0)


def flat_light_hit(
    wi: Array, distance: Array, cos: Array, is_hit: Array, area: Array | float, radiance: Array
) -> LightSample:
    """Return the sample of a flat light that directions hit (or not) at `distance`; `cos` = normal . wi."""
    reach = np.where(is_hit, distance, np.float32(0))  # the square of a miss's distance may overflow
    pdf = reach * reach / (np.float32(area) * np.maximum(np.abs(cos), np.float32(1e-12)))
    return LightSample(wi, distance, radiance, pdf, is_hit & (cos < 0))


def sphere_light_sample(to: Array, radius2: Array | np.float32, u: Array, radiance: Array) -> LightSample:
    """Return samples of the cone of a sphere, `to` its centre minus the receiver; none where the receiver is inside."""
    distance2, one_minus_cos, outside = _cone(to, radius2)
    wi = to_world(square_to_cone(u, one_minus_cos), to * (1 / np.sqrt(distance2)))
    return _sphere_light_sample(wi, to, radius2, (distance2, one_minus_cos, outside), radiance)


def sphere_light_hit(wi: Array, to: Array, radius2: Array | np.float32, radiance: Array) -> LightSample:
    """Return what directions see of a sphere, `to` its centre minus the receiver."""
    distance2, one_minus_cos, outside = _cone(to, radius2)
    along = dot(to, wi)
    across = to - wi * along  # |to|^2 - along^2 would cancel for a far light
    inside = outside & (along > 0) & (dot(across, across) < radius2)
    return _sphere_light_sample(wi, to, radius2, (distance2, one_minus_cos, inside), radiance)


def _cone(to: Array, radius2: Array | np.float32) -> tuple[Array, Array, Array]:
    """Return the squared distance of a sphere's centre, 1 - cos of its cone, and whether the receiver is outside."""
    distance2 = np.maximum(dot(to, to), TINY)
    sin2 = np.minimum(radius2 / distance2, 1)  # 1: the receiver is inside
    return distance2, sin2 / (1 + np.sqrt(1 - sin2)), sin2 < 1


def _sphere_light_sample(
    wi: Array, to: Array, radius2: Array | np.float32, cone: tuple[Array, Array, Array], radiance: Array
) -> LightSample:
    distance2, one_minus_cos, is_hit = cone
    along = dot(to, wi)
    across = to - wi * along
    far = along + np.sqrt(np.maximum(radius2 - dot(across, across), 0))
    # the near end is |to|^2 - radius^2 over the far one; their difference would cancel for a large sphere
    near = np.maximum(distance2 - radius2, 0) / np.maximum(far, _MIN_FAR_END)
    return LightSample(wi, near, radiance, cone_pdf(one_minus_cos) * is_hit, is_hit)


def intersect_plane(p: Array, wi: Array, normal: Array) -> tuple[Array, Array, Array]:
    """Return where rays from `p` (relative to the plane) meet a plane: distance, normal . wi, relative point."""
    cos = dot(normal, wi)
    cos = np.copysign(np.maximum(np.abs(cos), np.float32(1e-12)), cos)
    distance = dot(normal, p) / -cos
    return distance, cos, wi * distance + p


def rgb(name: str, value: Rgb) -> Array:
    """Return a colour as ``(3, 1)`` float32; refuse one that is negative or not finite, and call it `name`."""
    numbers = check_values(name, value, "finite, not negative, and below 3.4e38", "it is emitted", image=False)
    return np.broadcast_to(numbers, 3).astype(np.float32)[:, None]


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
    more = "but less than 1, so that light samples reach all of the sky"
    return validate.number("compensation", share, 0, _BELOW_1, more)
