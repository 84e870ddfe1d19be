"""A delta lobe of one's own: a coloured mirror.

`scatter` returns a direction for each point, and the factor of its radiance. A lobe that lets light pass through the
surface also sets ``transmissive = True``.
"""

from dataclasses import dataclass
from typing import Any, ClassVar

from dmis.brdf.lobe import DeltaLobe


@dataclass(frozen=True, eq=False)
class Tinted(DeltaLobe):
    tint: Any
    colours: ClassVar = ("tint",)

    def scatter(self, surface):
        return surface.n * (2 * surface.cos_o) - surface.wo, self.tint
