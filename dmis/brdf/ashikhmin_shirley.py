"""The anisotropic Phong model of Ashikhmin and Shirley (2000), as pbrt has it and as in the paper."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from dmis.base.vectors import Array
from dmis.brdf.distributions import Distribution, HalfVectorLobe
from dmis.brdf.fresnel import fifth_power
from dmis.brdf.lobe import MIN_COSINE, CosineLobe, Directions
from dmis.samplers.warp import INV_PI


@dataclass(frozen=True, eq=False)
class BlendBase(CosineLobe):
    """The diffuse half of Ashikhmin and Shirley's Fresnel blend (PBR 8.5), dimmed by the coat above it."""

    diffuse: Any
    specular: Any
    colours: ClassVar[tuple[str, ...]] = ("diffuse", "specular")

    def eval(self, directions: Directions) -> Array:
        through = (1 - fifth_power(1 - directions.cos_i / 2)) * (1 - fifth_power(1 - directions.cos_o / 2))
        return self.diffuse * (1 - self.specular) * (np.float32(28 / 23) * INV_PI * through)

    def albedo(self) -> Array:
        return self.diffuse * (1 - self.specular)


@dataclass(frozen=True, eq=False)
class BlendCoat(HalfVectorLobe):
    """The glossy half of Ashikhmin and Shirley's Fresnel blend (PBR 8.5), with Schlick's Fresnel."""

    specular: Any
    distribution: Distribution
    colours: ClassVar[tuple[str, ...]] = ("specular",)

    def eval(self, directions: Directions) -> Array:
        schlick = self.specular + fifth_power(1 - directions.cos_d) * (1 - self.specular)
        larger = np.maximum(directions.cos_i, directions.cos_o)
        return schlick * (self._density(directions) / np.maximum(4 * directions.cos_d * larger, MIN_COSINE))

    def _density(self, directions: Directions) -> Array:
        return self.distribution.density(directions)

    def albedo(self) -> Array:
        return self.specular


class AshikhminShirley(BlendCoat):
    """The glossy half of Ashikhmin and Shirley's model, with the paper's factor; its base is `BlendBase`.

    ``f = F pdf_h / (4 cos_d max(cos_i, cos_o))`` with Schlick's Fresnel of `specular` at normal incidence, where pdf_h
    is the density of half vectors, ``sqrt((n_u+1)(n_v+1))/(2 pi) cos_h^(...)``. So the weight ``f cos_i / pdf`` is
    ``F min(1, cos_i / cos_o)``, never above 1. pbrt (`BlendCoat`) has ``n + 2`` for the paper's ``n + 1``.

    Source: Ashikhmin and Shirley, "An Anisotropic Phong BRDF Model", Journal of Graphics Tools 5(2), 2000.
    """

    def _density(self, directions: Directions) -> Array:
        return self.distribution.pdf_h(directions) * directions.above
