"""A lobe seen from one angle: samples, densities and integrals that the checks of `dmis.testing.lobe` share."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from dmis.base.vectors import Array
from dmis.brdf.cosines import Directions
from dmis.brdf.materials import Material
from dmis.scene.shading_points import ShadingPoints
from dmis.testing.chi_square import Density, DensityComparison, compare_directions
from dmis.testing.density import DensityView
from dmis.testing.scenes import surface
from dmis.testing.sphere import polar, uniforms

COUNT = 2**16
"""Sampled directions."""


@dataclass(frozen=True, eq=False)
class Reflected:
    """Integrals over the side of a lobe.

    Attributes
    ----------
    albedo, error
        Of f cos, the share of light that is reflected, and its error, ``(3,)``.
    missed
        Of f cos where the pdf is 0.
    square
        Of (f cos)^2 / pdf, the second moment of f cos / pdf.
    """

    albedo: Array
    error: Array
    missed: float
    square: float


@dataclass(frozen=True, eq=False)
class LobeView(DensityView):
    """A lobe seen from one angle: samples and quadrature, computed once for all checks."""

    material: Material
    degrees: float
    outside: bool = True
    _points: dict[int, ShadingPoints] = field(default_factory=dict)
    _reflected: dict[bool, Reflected] = field(default_factory=dict)

    @property
    def title(self) -> str:  # type: ignore[override]
        """The lobe, for figures."""
        return type(self.material.lobes[0]).__name__

    @property
    def place(self) -> str:
        """The angle, for messages."""
        return f"wo at {self.degrees:g}°{'' if self.outside else ' inside'}"

    @property
    def reflects(self) -> bool:
        """Whether the lobe is on wo's side."""
        return not self.material.lobes[0].transmissive

    def points(self, count: int) -> ShadingPoints:
        """Return `count` surface points, those beyond the surface for a lobe that transmits."""
        if count not in self._points:
            points = surface(self.material, polar(self.degrees), count, outside=self.outside)
            self._points[count] = points if self.reflects else points.beyond()
        return self._points[count]

    @cached_property
    def wi(self) -> Array:
        """Sampled directions, ``(3, COUNT)``, independent of those from other angles."""
        return self.points(COUNT).sample(uniforms(COUNT, round(self.degrees) + 90 * self.outside))

    @cached_property
    def accepted(self) -> Array:
        """Which of them are on the side of the lobe, ``(COUNT,)``; a lobe that transmits may refuse some more."""
        points = self.points(COUNT)
        directions = Directions(points, self.wi)
        return directions.above if self.reflects else directions.above & (points.pdf(directions) > 0)

    def pdf(self, w: Array) -> Array:
        """Return the pdf of directions ``(3, M)``."""
        points = self.points(w.shape[1])
        return points.pdf(Directions(points, w))

    def laws(self) -> dict[str, Density]:
        """Return eval times the cosine, and the cosine alone, on the side of the lobe."""

        def cosine(w: Array) -> Array:
            directions = Directions(self.points(w.shape[1]), w)
            return (directions.cos_i * directions.above).astype(float)

        def reflected(w: Array) -> Array:
            points = self.points(w.shape[1])
            value = np.atleast_2d(points.eval(Directions(points, w))).max(axis=0)
            return np.broadcast_to(value, w.shape[1:]) * cosine(w)

        return {"eval times the cosine": reflected, "the cosine": cosine}

    @cached_property
    def comparison(self) -> DensityComparison:
        """Samples against pdf."""
        return compare_directions(self.wi, self.pdf, accepted=self.accepted)

    def reflected(self, fine: bool = False) -> Reflected:
        """Return what the lobe reflects, by quadrature; `fine`: by many more nodes."""
        if fine not in self._reflected:
            cells = self.comparison.cells.finer() if fine else self.comparison.cells
            points = self.points(cells.nodes.shape[1])
            directions = Directions(points, cells.nodes)
            cos, pdf = (directions.cos_i * directions.above).astype(float), points.pdf(directions)
            values = np.atleast_2d(points.eval(directions)) * cos
            sums = np.array([[part.sum() for part in cells.integrate(value)] for value in values])
            value = values.max(axis=0)
            ratio = np.divide(value**2, pdf, out=np.zeros_like(value), where=pdf > 0)
            missed, square = (cells.integrate(part)[0].sum() for part in (value * (pdf <= 0), ratio))
            albedo, error = np.broadcast_to(sums, (3, 2)).T
            self._reflected[fine] = Reflected(albedo, error, missed, square)
        return self._reflected[fine]

    @cached_property
    def eta2(self) -> float:
        """Square of the relative index by which transmitted radiance is divided."""
        eta = self.material.lobes[0].eta_scale()
        return eta**2 if self.outside else eta**-2
