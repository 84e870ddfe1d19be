"""The material of glTF: a metal, or a diffuse base under a dielectric coat, both rough, and anything in between.

With metalness m, base colour b and half vector h,
``f = (1 - m) b / pi (1 - F(cos_i)) (1 - F(cos_o)) / (1 - F') + F(wi.h) D G2 / (4 cos_i cos_o)``, where F is Schlick's
Fresnel term: from f0 to ``1 - 0.9 alpha`` in the base, from ``(1 - m) f0 + m b`` to 1 in the facets. Sources: Khronos
Group, *glTF 2.0 Specification*, appendix B; for the base Kelemen and Szirmay-Kalos 2001, because the specification's
``1 - F(wi.h)`` lets a white surface of roughness 0.1 reflect 1.7 times the light. F' is the mean of F, so that such
a surface reflects all of it; with 0.9 alpha, for rough facets shadow each other, no white one reflects more than 1.01.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from dmis.base.vectors import Array
from dmis.brdf.fresnel import Schlick, check_ior
from dmis.brdf.lobe import ONE, CosineLobe, Directions, Lambert, Lobe
from dmis.brdf.materials import Material, is_black
from dmis.brdf.microfacet import GGX
from dmis.brdf.models import facet_roughness
from dmis.brdf.specular import SpecularTransmission
from dmis.brdf.texture import check_number, check_values, combine, reads_images, scale
from dmis.samplers.warp import INV_PI

MIN_ROUGHNESS = 0.03
"""Least roughness, the root of alpha; what is smoother is rendered so, because light samples must find highlights."""


@dataclass(frozen=True, eq=False)
class UnderCoat(CosineLobe):
    """A Lambertian base under a `coat` of one Fresnel term: the light that it gets and gives crosses the coat.

    ``f = reflectance / pi (1 - F(cos_i)) (1 - F(cos_o)) / (1 - F')``, with F' the mean of F over the cosine:
    ``f0 + (f90 - f0) / 21`` for Schlick's.
    """

    reflectance: Any
    coat: Schlick
    factor: ClassVar[str | None] = "reflectance"

    def eval(self, directions: Directions) -> Array:
        through = (ONE - self.coat(directions.cos_i)) * (ONE - self.coat(directions.cos_o))
        mean = self.coat.f0 + (self.coat.f90 - self.coat.f0) / np.float32(21)
        return self.reflectance * (through * (INV_PI / (ONE - mean)))


@reads_images
def metallic_roughness(
    base: Any = 0.8,
    metallic: Any = 0.0,
    roughness: Any = 0.5,
    specular: float = 1.0,
    eta: float = 1.5,
    opacity: float = 1.0,
) -> Material:
    """Make the metallic-roughness material of glTF; images that are given together are placed alike.

    Parameters
    ----------
    base
        Reflectance of the diffuse base, or of the metal: a number, an RGB triple or an `Image`, from 0 to 1.
    metallic
        0 for a dielectric, 1 for a metal: a number or an `Image`.
    roughness
        Root of the alpha of GGX, from 0 to 1: a number or an `Image`; at least `MIN_ROUGHNESS` is rendered.
    specular, eta
        The coat of a dielectric: a factor from 0, without a coat, to 1; and its index of refraction.
    opacity
        Share of light that meets the surface; the rest goes straight through.
    """
    is_black("base", base)
    metallic = check_number("metallic", metallic, "in [0, 1]", "it is a share", 0, 1, image=True)
    roughness = check_number("roughness", roughness, "in [0, 1]", "it is the root of alpha", 0, 1, image=True)
    specular = check_number("specular", specular, "in [0, 1]", "it is a share of the coat", 0, 1)
    opacity = check_number("opacity", opacity, "in [0, 1]", "the rest goes straight through", 0, 1)
    index = check_ior("eta", eta)
    f0 = specular * ((index - 1) / (index + 1)) ** 2
    diffuse = scale(combine(lambda b, m: b * (1 - m), base, metallic), opacity)
    normal = f0 if metallic == 0 else combine(lambda b, m: f0 * (1 - m) + b * m, base, metallic)
    grazing = 1.0 if specular == 1 else combine(lambda m: specular * (1 - m) + m, metallic)
    alpha = combine(lambda r: np.maximum(r, MIN_ROUGHNESS) ** 2, roughness)
    coat = Schlick(f0, number_of(combine(lambda a: np.maximum(specular * (1 - 0.9 * a), f0), alpha)))
    lobes: list[Lobe] = [SpecularTransmission((1 - opacity,), 1.0)] if opacity < 1 else []
    if check_values("base", diffuse, "finite", "it is a reflectance").any():
        lobes.append(UnderCoat(diffuse, coat) if specular else Lambert(diffuse))
    if check_values("base", normal, "finite", "it is a reflectance").any():
        lobes.append(GGX(opacity, facet_roughness(number_of(alpha)), Schlick(normal, number_of(grazing))))
    return Material(tuple(lobes), "metallicroughness")


def number_of(value: Any) -> Any:
    """Return a parameter of one channel, a number in place of a tuple of one."""
    return value[0] if isinstance(value, tuple) else value
