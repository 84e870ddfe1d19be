"""Phong lobes: Lafortune's normalised Phong and Blinn–Phong."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from dmis.base.vectors import TINY, Array, dot, normalise
from dmis.brdf.distributions import Blinn, HalfVectorLobe
from dmis.brdf.lobe import MAX_COSINE_EXPONENT, MIN_COSINE, Directions, Lobe, LocalFrame
from dmis.samplers.warp import TWO_PI, power, square_to_power, to_world

_NEARLY_1 = np.float32(1 - 1e-6)


@dataclass(frozen=True, eq=False)
class Lafortune(Lobe):
    """A generalised cosine lobe, ``f = R (n+2)/(2 pi) max(0, C wo . wi)^n``; Phong's is that of ``C = (-1, -1, 1)``.

    C multiplies the tangential part of wo by `c_t`, its normal part by `c_n`: the lobe lies about C wo, which need not
    be the mirror direction. It is sampled with the power cosine about C wo, and is a power cosine itself: what is left
    in the weight is the cosine, and ``|C wo|^n``. Reflects at most R as long as \\|c_t\\| and c_n are at most 1.

    Sources: Phong 1975; Lafortune and Willems, "Using the Modified Phong Reflectance Model for Physically Based
    Rendering", 1994 (the factor); Lafortune, Foo, Torrance and Greenberg 1997 (C).
    """

    reflectance: Any
    exponent: Any
    c_t: float = -1.0
    c_n: float = 1.0
    scalars: ClassVar[tuple[str, ...]] = ("exponent",)
    factor: ClassVar[str | None] = "reflectance"

    def eval(self, directions: Directions) -> Array:
        lobe = self._lobe(directions, True) * directions.above
        return self.reflectance * ((self.exponent + 2) / TWO_PI * lobe)

    def pdf(self, directions: Directions) -> Array:
        return (self.exponent + 1) / TWO_PI * self._lobe(directions, False) * directions.above

    def sample(self, surface: LocalFrame, u: Array) -> Array:
        return to_world(square_to_power(u, self.exponent), normalise(self._towards(surface)))

    def _towards(self, surface: LocalFrame) -> Array:
        """Return C wo, ``(3, N)``, kept from vanishing, which it would at the horizon if c_t = 0."""
        return surface.wo * self.c_t + surface.n * ((self.c_n - self.c_t) * np.maximum(surface.cos_o, MIN_COSINE))

    def _lobe(self, directions: Directions, scaled: bool) -> Array:
        """Return the cosine of C wo and wi to the exponent; times that power of \\|C wo\\| if `scaled`, ``(N,)``."""
        tangential = self.c_t * self.c_t - 1
        normal = self.c_n * self.c_n - 1
        cos2_o = directions.cos_o * directions.cos_o
        beyond = tangential * (1 - cos2_o) + normal * cos2_o  # |C wo|^2 - 1
        if np.max(self.exponent) <= MAX_COSINE_EXPONENT:
            across = directions.cos_io - directions.cos_i_signed * directions.cos_o
            cos = np.clip(self.c_t * across + self.c_n * (directions.cos_i_signed * directions.cos_o), 0, 1)
            base = cos if scaled else cos / np.sqrt(np.maximum(1 + beyond, TINY))
            return power(base, self.exponent) * (cos > 0)  # `power` of 0 is above 0 where the exponent is near 0
        # a cosine near 1 is rounded by more than the lobe's width (`Directions.power_h`): 1 - cos = |a - b|^2 / 2
        away = normalise(self._towards(directions.surface)) - directions.wi
        log_cos = np.log1p(-np.minimum(dot(away, away) / 2, _NEARLY_1))
        return np.exp((log_cos + np.log1p(np.maximum(beyond, -_NEARLY_1)) / 2 if scaled else log_cos) * self.exponent)


@dataclass(frozen=True, eq=False)
class BlinnPhong(HalfVectorLobe):
    """``f = R c cos_h^n``, with c such that a white one reflects everything at normal incidence.

    ``c = (n+2)(n+4) / (8 pi (n + 2^(-n/2)))``; often rounded to ``(n+8) / (8 pi)``. Away from the normal it darkens,
    as the square of the cosine for large n: it lacks the microfacets' ``1 / (4 cos_i cos_o)``. Sampled through half
    vectors with ``(n+1)/(2 pi) cos_h^n``.

    Source: Blinn 1977.
    """

    reflectance: Any
    distribution: Blinn
    factor: ClassVar[str | None] = "reflectance"

    def eval(self, directions: Directions) -> Array:
        n = self.distribution.exponent
        scale = (n + 2) * (n + 4) / (4 * TWO_PI * (n + np.exp2(-n / 2)))
        return self.reflectance * (scale * directions.power_h(n) * directions.above)
