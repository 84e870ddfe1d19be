"""Local frames of shading points, and the cosines of directions about them, which lobes are functions of."""

from __future__ import annotations

from functools import cached_property
from typing import Any, Protocol

import numpy as np

from dmis.base.plugins import locked
from dmis.base.vectors import TINY, Array, dot
from dmis.samplers.warp import power

ONE = np.float32(1)
MAX_COSINE_EXPONENT = 1e3
"""Largest exponent for which a power of float32 cosines is right: their rounding times this is 1e-4 of the lobe."""
MAX_LOBE_EXPONENT = 1e12
"""Largest exponent of a lobe that is a power of a cosine: a lobe of 1e-6 rad, of which float32 directions resolve one
digit."""
MIN_COSINE = np.float32(1e-10)
"""Smallest cosine, or product of two, that is divided by: they are 0 at the horizon."""
MIN_DIVISOR = np.float32(1e-12)
"""Smallest square of a cosine, or product of cosines and lengths, that is divided by."""


class LocalFrame(Protocol):
    """The attributes of N shading points that a lobe reads.

    Unit ``n`` and ``wo`` ``(3, N)``, ``cos_o`` ``(N,)``; ``outside`` ``(N,)`` bool (where light is refracted);
    ``tangents``, two ``(3, N)`` (anisotropic lobes only).
    """

    n: Array
    wo: Array
    cos_o: Array
    outside: Array

    @property
    def tangents(self) -> tuple[Array, Array]: ...


class Directions:
    """Unit directions wo and `wi` ``(3, N)`` about a batch of shading points, as the cosines that lobes depend on.

    Arrays are read-only, because all lobes share them.
    """

    def __init__(self, surface: LocalFrame, wi: Array) -> None:
        self.surface, self.wi = surface, locked(wi.view())
        self.cos_o = surface.cos_o
        self.cos_i_signed = locked(dot(surface.n, wi))

    @cached_property
    def cos_i(self) -> Array:
        """``|n.wi|``, ``(N,)``."""
        return locked(np.abs(self.cos_i_signed))

    @cached_property
    def above(self) -> Array:
        """Whether wi is on wo's side of the shading normal, ``(N,)`` bool."""
        return locked(self.cos_i_signed > 0)

    @cached_property
    def cos_io(self) -> Array:
        """wi.wo, ``(N,)``."""
        return locked(dot(self.surface.wo, self.wi))

    @cached_property
    def cos_d(self) -> Array:
        """Cosine between wo and the half vector: ``|wo + wi| / 2``.

        ``sqrt((1 + wi.wo) / 2)`` is the same, but cancels at grazing angles: at 89 degrees and exponent 10000 its
        rounding is a tenth of the lobe.
        """
        h = self.surface.wo + self.wi
        return locked(np.sqrt(np.maximum(dot(h, h), TINY)) / 2)

    @cached_property
    def cos_h(self) -> Array:
        """Cosine between n and the half vector, without the half vector itself."""
        return locked(np.minimum(np.abs(self.cos_i_signed + self.cos_o) / (2 * self.cos_d), ONE))

    @cached_property
    def tan2_h(self) -> Array:
        """Squared tangent of the angle between n and the half vector, ``(N,)``.

        From the tangential part of the half vector itself: ``1 - cos_h^2`` cancels where a narrow lobe is.
        """
        normal = self.cos_i_signed + self.cos_o
        across = self.surface.wo + self.wi - self.surface.n * normal
        return locked(dot(across, across) / np.maximum(normal * normal, MIN_DIVISOR))

    def power_h(self, exponent: Any) -> Array:
        """Return ``cos_h ** exponent``, ``(N,)``.

        Large exponents take the tangent: the rounding of a cosine near 1 is multiplied by the exponent, and from 1e7 on
        it is larger than the lobe.
        """
        if np.max(exponent) <= MAX_COSINE_EXPONENT:
            return power(self.cos_h, exponent)
        return np.exp(np.log1p(self.tan2_h) * (exponent * np.float32(-0.5)))

    @cached_property
    def half(self) -> tuple[Array, Array]:
        """Tangential coordinates of the half vector, for anisotropic lobes."""
        s, t = self.surface.tangents
        h = (self.surface.wo + self.wi) / (2 * self.cos_d)
        return locked(dot(s, h)), locked(dot(t, h))
