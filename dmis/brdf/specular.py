"""Mirror reflection and refraction: lobes that are Dirac deltas."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from dmis.base.vectors import Array
from dmis.brdf.fresnel import Fresnel, dielectric, relative_ior
from dmis.brdf.lobe import DeltaLobe, LocalFrame


@dataclass(frozen=True, eq=False)
class SpecularReflection(DeltaLobe):
    """A perfect mirror. A delta lobe: it has no pdf, never enters MIS, and is followed as a ray of its own."""

    reflectance: Any
    fresnel: Fresnel | None = None
    factor: ClassVar[str | None] = "reflectance"

    def scatter(self, surface: LocalFrame) -> tuple[Array, Array]:
        wi = surface.n * (2 * surface.cos_o) - surface.wo
        if self.fresnel is None:
            return wi, self.reflectance
        return wi, self.reflectance * self.fresnel.on_side(surface.cos_o, surface.outside)

    def has_sides(self) -> bool:
        return self.fresnel is not None and self.fresnel.has_sides


@dataclass(frozen=True, eq=False)
class SpecularTransmission(DeltaLobe):
    """Perfect refraction into a medium of relative index `eta`, a delta lobe.

    `eta` is inside over outside; ``surface.outside`` tells on which side wo is. Radiance is scaled by 1/eta^2, as
    physics has it, unless `scaled` is False, as in pbrt-v2: then it is the same on both sides.
    """

    transmittance: Any
    eta: float = 1.5
    scaled: bool = True
    factor: ClassVar[str | None] = "transmittance"
    transmissive: ClassVar[bool] = True

    def scatter(self, surface: LocalFrame) -> tuple[Array, Array]:
        """Return directions ``(3, N)`` and factors ``(3, N)``, which are 0 in total internal reflection."""
        eta = relative_ior(self.eta, surface.outside)
        cos_o, ratio = surface.cos_o, 1 / eta
        cos_t = np.sqrt(np.maximum(1 - (1 - cos_o * cos_o) * ratio * ratio, 0))
        wi = surface.n * (ratio * cos_o - cos_t) - surface.wo * ratio
        transmitted = 1 - dielectric(cos_o, eta)
        return wi, self.transmittance * (transmitted * ratio * ratio if self.scaled else transmitted)

    def eta_scale(self) -> float:
        return self.eta if self.scaled else 1.0
