"""The anisotropic Phong model of Ashikhmin and Shirley (2000), as pbrt has it and as in the paper."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from dmis.base.vectors import TINY, Array
from dmis.brdf.cosines import MIN_COSINE, Directions
from dmis.brdf.diffuse import CosineLobe
from dmis.brdf.distributions import Distribution, HalfVectorLobe
from dmis.brdf.fresnel import fifth_power
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
        coat = self.distribution.density(directions)
        return schlick * (
            coat / np.maximum(4 * directions.cos_d * np.maximum(directions.cos_i, directions.cos_o), TINY)
        )

    def albedo(self) -> Array:
        return self.specular


@dataclass(frozen=True, eq=False)
class AshikhminShirley(HalfVectorLobe):
    """The glossy half of Ashikhmin and Shirley's model, with the paper's factor; its base is
    `dmis.brdf.ashikhmin_shirley.BlendBase`.

    ``f = F pdf_h / (4 cos_d max(cos_i, cos_o))`` with Schlick's Fresnel of `specular` at normal incidence, where pdf_h
    is the density of half vectors, ``sqrt((n_u+1)(n_v+1))/(2 pi) cos_h^(...)``. So the weight ``f cos_i / pdf`` is
    ``F min(1, cos_i / cos_o)``, never above 1. pbrt (`dmis.brdf.ashikhmin_shirley.BlendCoat`) has ``n + 2`` for the
    paper's ``n + 1``.

    Source: Ashikhmin and Shirley, "An Anisotropic Phong BRDF Model", Journal of Graphics Tools 5(2), 2000.
    """

    specular: Any
    distribution: Distribution
    colours: ClassVar[tuple[str, ...]] = ("specular",)

    def eval(self, directions: Directions) -> Array:
        """Return the BRDF without the cosine; 0 below the shading horizon."""
        schlick = self.specular + fifth_power(1 - directions.cos_d) * (1 - self.specular)
        density = self.distribution.pdf_h(directions) * directions.above
        return schlick * (
            density / np.maximum(4 * directions.cos_d * np.maximum(directions.cos_i, directions.cos_o), MIN_COSINE)
        )
