"""Relief: images that turn shading normals, as heights (bump maps) or as directions (normal maps).

The surface itself stays where it is. Tangents dp/du and dp/dv are those of the triangle, laid upon the shading normal.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from dmis.base.vectors import TINY, Array, dot, normalise
from dmis.brdf.texture import Image


class Relief(Protocol):
    """Protocol of what turns the normals of a material."""

    def normals(self, n: Array, dpdu: Array, dpdv: Array, uv: Array, smooth: bool) -> Array:
        """Return turned unit normals ``(3, N)``.

        `n` are unit shading normals on the outside, `smooth` if they are interpolated between vertices, `dpdu` and
        `dpdv` tangents, ``(3, N)`` each, and `uv` texture coordinates ``(2, N)``.
        """
        ...


@dataclass(frozen=True, eq=False)
class BumpMap:
    """Heights along the outside, in units of the scene: ``n' ~ (dp/du + dh/du n) x (dp/dv + dh/dv n)``, as in pbrt.

    Parameters
    ----------
    image
        One channel.
    unit_tangents
        Whether smooth meshes have tangents of length 1, as in pbrt-v2 and v3; else both are as long as dp/du, as in v4.
        None: dp/du and dp/dv stay, as on spheres and cylinders of all versions.
    """

    image: Image
    unit_tangents: bool | None = False

    def normals(self, n: Array, dpdu: Array, dpdv: Array, uv: Array, smooth: bool) -> Array:
        """See `Relief.normals`; slopes are differences over a texel."""
        s, t = (v - n * dot(n, v) for v in (dpdu, dpdv))
        if smooth and self.unit_tangents is not None:
            s = normalise(s) if self.unit_tangents else s
            t = _beside(n, s, t)
        height, width, _ = self.image.texels.shape
        steps = np.diag([0.5 / (width * self.image.scale[0]), 0.5 / (height * self.image.scale[1])]).astype(np.float32)
        slopes = (self.image(uv + d[:, None])[0] - self.image(uv - d[:, None])[0] for d in steps)
        s, t = (v + n * (slope / (2 * d.sum())) for v, slope, d in zip((s, t), slopes, steps, strict=True))
        return _towards(n, np.cross(s, t, axis=0))


@dataclass(frozen=True, eq=False)
class NormalMap:
    """Directions, ``2 texel - 1`` along dp/du, across it towards dp/dv, and along the outside.

    Parameters
    ----------
    image
        Three channels in [0, 1], linear.
    strength
        Factor of the first two components.
    """

    image: Image
    strength: float = 1.0

    def normals(self, n: Array, dpdu: Array, dpdv: Array, uv: Array, smooth: bool) -> Array:
        """See `Relief.normals`."""
        x, y, z = np.broadcast_to(self.image(uv) * 2 - 1, n.shape)
        s = normalise(dpdu - n * dot(n, dpdu))
        return _towards(n, (s * x + _beside(n, s, dpdv) * y) * np.float32(self.strength) + n * z)


def _beside(n: Array, s: Array, t: Array) -> Array:
    """Return vectors across `n` and `s`, on the side of `t`, ``(3, N)``."""
    across = np.cross(n, s, axis=0)
    return across * np.copysign(np.float32(1), dot(across, t))


def _towards(n: Array, turned: Any) -> Array:
    """Return unit vectors along `turned`, on the side of `n`; `n` where they have no direction."""
    length2 = dot(turned, turned)
    unit = turned * np.copysign(1 / np.sqrt(np.maximum(length2, TINY)), dot(n, turned))
    return np.where(length2 > TINY, unit, n).astype(np.float32)
