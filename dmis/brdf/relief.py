"""Relief: images that turn shading normals, as heights (bump maps) or as directions (normal maps).

The surface itself stays where it is. Tangents dp/du and dp/dv are those of the triangle, laid upon the shading normal.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from dmis.base.vectors import TINY, Array, dot, normalise
from dmis.brdf.texture import image_of_data


@dataclass(frozen=True, eq=False)
class BumpMap:
    """Heights along the outside, in units of the scene: ``n' ~ (dp/du + dh/du n) x (dp/dv + dh/dv n)``, as in pbrt.

    Parameters
    ----------
    image
        An `Image` of one channel, or the path of an image file, whose numbers are heights.
    unit_tangents
        Of smooth meshes in pbrt. True: both tangents have length 1 and point backwards, as in v2 and v3, so that
        heights turn normals the other way. False: the second is n x dp/du, as in v4. None: dp/du and dp/dv stay, as on
        spheres and cylinders of all versions.
    """

    image: Any
    unit_tangents: bool | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "image", image_of_data("image of a bump map", self.image))

    def normals(self, n: Array, dpdu: Array, dpdv: Array, uv: Array, smooth: bool) -> Array:
        """Return turned unit normals ``(3, N)``; slopes are differences over a texel.

        `n` are unit shading normals on the outside, `smooth` if they are interpolated between vertices, `dpdu` and
        `dpdv` tangents, ``(3, N)`` each, and `uv` texture coordinates ``(2, N)``.
        """
        s, t = (v - n * dot(n, v) for v in (dpdu, dpdv))
        if smooth and self.unit_tangents is not None:
            s = -normalise(s) if self.unit_tangents else s
            t = np.cross(n, s, axis=0)
        height, width, _ = self.image.texels.shape
        steps = np.diag([0.5 / (width * self.image.scale[0]), 0.5 / (height * self.image.scale[1])]).astype(np.float32)
        slopes = (self.image(uv + d[:, None])[0] - self.image(uv - d[:, None])[0] for d in steps)
        s, t = (v + n * (slope / (2 * d.sum())) for v, slope, d in zip((s, t), slopes, steps, strict=True))
        return _towards(n, np.cross(s, t, axis=0))


@dataclass(frozen=True, eq=False)
class NormalMap:
    """Directions, ``2 texel - 1`` along dp/du, across it, and along the outside.

    Parameters
    ----------
    image
        An `Image` of three channels in [0, 1], or the path of an image file, which is not decoded from sRGB.
    strength
        Factor of the first two components.
    towards_dpdv
        Whether the second axis is on the side of dp/dv, as in glTF; else it is n x dp/du, as in pbrt-v4.
    """

    image: Any
    strength: float = 1.0
    towards_dpdv: bool = True

    def __post_init__(self) -> None:
        object.__setattr__(self, "image", image_of_data("image of a normal map", self.image))

    def normals(self, n: Array, dpdu: Array, dpdv: Array, uv: Array, smooth: bool) -> Array:
        """Return turned unit normals ``(3, N)``, see `BumpMap.normals`."""
        x, y, z = np.broadcast_to(self.image(uv) * 2 - 1, n.shape)
        s = normalise(dpdu - n * dot(n, dpdu))
        t = np.cross(n, s, axis=0)
        if self.towards_dpdv:
            t *= np.copysign(np.float32(1), dot(t, dpdv))
        return _towards(n, (s * x + t * y) * np.float32(self.strength) + n * z)


Relief = BumpMap | NormalMap
"""What turns the normals of a material."""


def _towards(n: Array, turned: Any) -> Array:
    """Return unit vectors along `turned`, on the side of `n`; `n` where they have no direction."""
    length2 = dot(turned, turned)
    unit = turned * np.copysign(1 / np.sqrt(np.maximum(length2, TINY)), dot(n, turned))
    return np.where(length2 > TINY, unit, n).astype(np.float32)
