"""Exact Fresnel reflectance of metals; `dmis.brdf.Conductor` is the approximation that pbrt-v2 has.

Source: E. Hecht, *Optics*, the reflection coefficients for a complex index of refraction.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dmis.brdf import Conductor, per_point
from dmis.vec import TINY, Array


@dataclass(frozen=True)
class ExactConductor(Conductor):
    """Unpolarised Fresnel reflectance of a metal in air, index ``eta + i k`` as RGB triples."""

    def __call__(self, cos: Array) -> Array:
        index = per_point(self.eta) + np.complex128(1j) * per_point(self.k)
        cos = np.asarray(cos, np.float64)
        cos_t = np.sqrt(1 - (1 - cos * cos) / (index * index))
        parallel = (index * cos - cos_t) / (index * cos + cos_t + TINY)
        perpendicular = (cos - index * cos_t) / (cos + index * cos_t + TINY)
        return ((np.abs(parallel) ** 2 + np.abs(perpendicular) ** 2) / 2).astype(np.float32)
