"""What a lobe is: the directions that it is a function of, the classes that it derives from, and the diffuse lobes.

A lobe is a frozen dataclass that derives from `Lobe` or `DeltaLobe` and inherits their defaults; its fields may have
any names. `Lambert` is the shortest one. `LocalFrame` is what a lobe reads of shading points, and `Directions` has the
cosines that it depends on.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar, Protocol

import numpy as np

from dmis.base.plugins import locked
from dmis.base.validate import check_array, check_directions
from dmis.base.vectors import TINY, Array, dot, normalise
from dmis.brdf.texture import Image
from dmis.samplers.warp import INV_PI, power, square_to_sphere

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


class Parameters:
    """A frozen dataclass, a lobe or what is nested in one, some of whose fields differ from point to point.

    Attributes
    ----------
    colours
        Fields that are numbers, RGB triples or images; bound to N points ``(1 or 3, N)`` or ``(1 or 3, 1)``.
    scalars
        Fields that are numbers or images; bound to points ``(N,)`` or one number.
    anisotropic
        Whether tangents are needed.

    Fields that hold `Parameters` are bound, too. Other fields are the same for all points of a batch, and hashable:
    surfaces that differ in one of them are batches of their own.
    """

    colours: ClassVar[tuple[str, ...]] = ()
    scalars: ClassVar[tuple[str, ...]] = ()
    anisotropic: ClassVar[bool] = False


class Lobe(Parameters):
    """A lobe of a BSDF that is a function, and takes part in MIS.

    Attributes
    ----------
    colours, scalars
        The fields that may differ from point to point, see `Parameters`; `factor` is added to `colours`.
    factor
        The colour that the lobe is in proportion to: a lobe for which it is 0 is left out, a mixture scales it, and
        `albedo` returns it. None: there is no such field.
    delta
        Whether the lobe is a Dirac delta, see `DeltaLobe`.
    transmissive
        Whether light comes through the surface; then `sample` is called with the normal on the side of wi.
    """

    factor: ClassVar[str | None] = None
    delta: ClassVar[bool] = False
    transmissive: ClassVar[bool] = False

    def __init_subclass__(cls) -> None:
        super().__init_subclass__()
        if cls.factor is not None and cls.factor not in cls.colours:
            cls.colours = (*cls.colours, cls.factor)

    def eval(self, directions: Directions) -> Array:
        """Return the BSDF without the cosine, ``(1, N)``, ``(3, 1)`` or ``(3, N)``."""
        raise NotImplementedError

    def pdf(self, directions: Directions) -> Array:
        """Return the density of `sample` per solid angle, ``(N,)``."""
        raise NotImplementedError

    def sample(self, surface: LocalFrame, u: Array) -> Array:
        """Sample directions ``(3, N)`` with uniform numbers `u` ``(2, N)``."""
        raise NotImplementedError

    def weight(self) -> Any:
        """Return ``f cos_i / pdf`` if it is the same for all directions above the surface, else None."""
        return None

    def is_black(self) -> bool:
        """Return whether the lobe reflects nothing, whatever the directions; it is left out of a scene's plan."""
        colour = 1.0 if self.factor is None else getattr(self, self.factor)
        return not isinstance(colour, Image) and not np.any(colour)

    def albedo(self) -> Array:
        """Return the nominal reflectance ``(3, N)``, ``(3, 1)`` or ``(1,)``: it tells surfaces apart in filters.

        Default: `factor`, times what a field `fresnel` reflects at normal incidence.
        """
        colour = np.zeros(1, np.float32) if self.factor is None else getattr(self, self.factor)
        fresnel = getattr(self, "fresnel", None)
        return colour if fresnel is None else colour * fresnel(np.ones(1, np.float32))

    def has_sides(self) -> bool:
        """Return whether the lobe is different inside and outside, so that the winding of a mesh matters."""
        return self.transmissive

    def eta_scale(self) -> float:
        """Return the index, inside over outside, by whose square transmitted radiance is divided; 1: it is not."""
        return 1.0

    def transmitted_share(self, surface: LocalFrame) -> Array:
        """Return the share of light that a transmissive lobe lets through, ``(N,)``, by which paths pick a lobe."""
        return np.full(len(surface.cos_o), np.float32(0.5))


class DeltaLobe(Lobe):
    """A lobe of a single direction: it has no pdf, never enters MIS, and is followed as a ray of its own."""

    delta: ClassVar[bool] = True

    def scatter(self, surface: LocalFrame) -> tuple[Array, Array]:
        """Return directions ``(3, N)`` and factors (BSDF times cosine over probability), ``(3, N)`` or ``(3, 1)``."""
        raise NotImplementedError


# Diffuse lobes --------------------------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class Lambert(Lobe):
    """``f = reflectance / pi``, sampled with density cos/pi."""

    reflectance: Any
    factor: ClassVar[str | None] = "reflectance"

    def eval(self, directions: Directions) -> Array:
        return self.reflectance * INV_PI

    def pdf(self, directions: Directions) -> Array:
        return np.maximum(directions.cos_i_signed, 0) * INV_PI

    def sample(self, surface: LocalFrame, u: Array) -> Array:
        """Sample directions with density ``cos/pi``: the unit sphere on the surface needs no frame."""
        return normalise(surface.n + square_to_sphere(u))

    def weight(self) -> Any:
        """Return the reflectance: the density is that of f with the cosine."""
        return self.reflectance


class CosineLobe(Lobe):
    """A lobe that is sampled by the cosine, as Lambert's is."""

    pdf = Lambert.pdf
    sample = Lambert.sample


@dataclass(frozen=True, eq=False)
class LambertTransmission(CosineLobe):
    """Light that comes through a thin sheet and leaves it evenly: ``f = transmittance / pi``, from either side."""

    transmittance: Any
    factor: ClassVar[str | None] = "transmittance"
    transmissive: ClassVar[bool] = True

    def eval(self, directions: Directions) -> Array:
        return self.transmittance * INV_PI

    def weight(self) -> Any:
        """Return the transmittance: the density is that of f with the cosine."""
        return self.transmittance

    def has_sides(self) -> bool:
        return False


@dataclass(frozen=True, eq=False)
class OrenNayar(CosineLobe):
    """Rough diffuse reflection (Oren and Nayar 1994, PBR 8.4.1), `sigma` in degrees; sampled like `Lambert`."""

    reflectance: Any
    sigma: float
    factor: ClassVar[str | None] = "reflectance"

    def eval(self, directions: Directions) -> Array:
        s2 = np.radians(self.sigma) ** 2
        a = np.float32(1 - s2 / (2 * (s2 + 0.33)))
        b = np.float32(0.45 * s2 / (s2 + 0.09))
        # max(0, cos(phi_i - phi_o)) sin(alpha) tan(beta), with no azimuth: the sines cancel against the cosine's
        across = np.maximum(directions.cos_io - directions.cos_i_signed * directions.cos_o, 0)
        larger = np.maximum(np.maximum(directions.cos_i, directions.cos_o), TINY)
        return self.reflectance * (INV_PI * (a + b * across / larger))


# What a lobe of one's own must return ---------------------------------------------------------------------------------


def _check_scatter(call: str, rays: Any, _: Lobe, surface: LocalFrame) -> None:
    """Raise a ValueError unless directions are unit ones where a factor is not 0."""
    if not isinstance(rays, tuple) or len(rays) != 2:
        raise ValueError(f"{call} must return directions and factors; got {type(rays).__name__}")
    wi, factor = rays
    check_array(f"{call}, factors,", factor, len(surface.cos_o), *_COLOURS)
    check_directions(f"{call}, directions,", wi, len(surface.cos_o), lambda: factor.any(axis=0))


def _check_weight(call: str, weight: Any, _: Lobe) -> None:
    """Raise a ValueError unless a weight is None, a number or colours."""
    values = np.atleast_2d(np.asarray(0.0 if weight is None else weight, float))
    check_array(call, values, values.shape[1], *_COLOURS)


_COLOURS = "(3, N)", "(3, 1)", "(1, N)", "(1, 1)"
LOBE_CHECKS: dict[str, Any] = {
    "eval": lambda call, f, _, d: check_array(call, f, d.wi.shape[1], *_COLOURS, where=lambda: d.above),
    "pdf": lambda call, pdf, _, d: check_array(call, pdf, d.wi.shape[1], "(N,)", where=lambda: d.above),
    "sample": lambda call, wi, _, s, u: check_directions(call, wi, u.shape[1], lambda: dot(s.n, wi) > 0),
    "scatter": _check_scatter,
    "weight": _check_weight,
    "transmitted_share": lambda call, share, _, s: check_array(call, share, len(s.cos_o), "(N,)"),
    **dict.fromkeys(("is_black", "albedo", "has_sides", "eta_scale")),
}
"""Checks of what the methods of lobes return, see `dmis.base.plugins.checked`."""
