"""Fresnel terms: dielectrics, conductors (approximate and exact), and Schlick's approximation."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from dmis.base.color import Rgb
from dmis.base.vectors import TINY, Array
from dmis.brdf.lobe import Parameters
from dmis.brdf.texture import FLOAT32_TINY, check_number, check_values


def dielectric(cos: Array, eta: Array | np.float32) -> Array:
    """Return the exact unpolarised Fresnel reflectance at relative index `eta`; 1 in total internal reflection."""
    sin2_t = (1 - cos * cos) / (eta * eta)
    cos_t = np.sqrt(np.maximum(1 - sin2_t, 0))
    a = (eta * cos - cos_t) / (eta * cos + cos_t + TINY)
    b = (cos - eta * cos_t) / (cos + eta * cos_t + TINY)
    return np.maximum((a * a + b * b) / 2, sin2_t >= 1)


def relative_ior(eta: float, outside: Array) -> Array:
    """Return the index of refraction beyond the surface over that on wo's side."""
    return np.where(outside, np.float32(eta), np.float32(1 / eta))


def check_ior(name: str, eta: Any) -> float:
    """Return an index of refraction, inside over outside, as a float; refuse one that is not positive."""
    return float(check_number(name, eta, "positive and finite", "it is a ratio of speeds of light", FLOAT32_TINY))


def check_metal_index(name: str, value: Any) -> Rgb:
    """Return the index of refraction or absorption of a metal as three floats; refuse negative ones."""
    numbers = check_values(name, value, "finite and not negative", "it is part of a metal's index", image=False)
    r, g, b = np.broadcast_to(numbers, 3).tolist()
    return r, g, b


class Fresnel:
    """Fresnel reflectance as a function of the cosine between a direction and the normal of a facet.

    Attributes
    ----------
    has_sides
        Whether it differs between inside and outside of a mesh.
    """

    has_sides: ClassVar[bool] = False

    def __call__(self, cos: Array) -> Array:
        """Return the reflectance at cosines ``(N,)``, one row or three, from outside."""
        raise NotImplementedError

    def on_side(self, cos: Array, outside: Array) -> Array:
        """Return the reflectance where wo is `outside` the mesh, or inside, ``(N,)`` bool."""
        return self(cos)

    def check(self) -> None:
        """Raise a ValueError if a parameter is out of bounds."""


@dataclass(frozen=True)
class Coat(Fresnel):
    """Fresnel reflectance of a coat of index `eta`: from outside, whichever side of the mesh that is."""

    eta: float = 1.5

    def __call__(self, cos: Array) -> Array:
        return dielectric(cos, np.float32(self.eta))

    def check(self) -> None:
        check_ior("eta of fresnel", self.eta)


@dataclass(frozen=True)
class Dielectric(Coat):
    """Fresnel reflectance of a surface whose index, inside over outside, is `eta`."""

    has_sides: ClassVar[bool] = True

    def on_side(self, cos: Array, outside: Array) -> Array:
        return dielectric(cos, relative_ior(self.eta, outside))


@dataclass(frozen=True)
class Conductor(Fresnel, Parameters):
    """Fresnel reflectance of a metal, the approximate form of PBR 8.2.1.

    Index `eta` and absorption `k` are RGB triples; bound to points, ``(1 or 3, N)``.
    """

    eta: Any
    k: Any
    colours: ClassVar[tuple[str, ...]] = ("eta", "k")

    def check(self) -> None:
        check_metal_index("eta of fresnel", self.eta), check_metal_index("k of fresnel", self.k)

    def __call__(self, cos: Array) -> Array:
        eta = as_columns(self.eta)
        k = as_columns(self.k)
        a = eta * eta + k * k
        cos2, twice = cos * cos, 2 * eta * cos
        parallel_base = a * cos2 + 1
        perp_base = a + cos2
        return ((parallel_base - twice) / (parallel_base + twice) + (perp_base - twice) / (perp_base + twice)) / 2


def as_columns(colour: Any) -> Array:
    """Return a triple as ``(3, 1)``, and parameters bound to points, ``(1 or 3, N)``, as they are."""
    values = np.asarray(colour, np.float32)
    return values[:, None] if values.ndim == 1 else values


def fifth_power(x: Array) -> Array:
    """Return ``x^5``, for Schlick's Fresnel."""
    x2 = x * x
    return x2 * x2 * x


@dataclass(frozen=True)
class Schlick(Fresnel, Parameters):
    """Fresnel reflectance from `f0` at normal incidence, a number, an RGB triple or an image, to `f90` at grazing."""

    f0: Any
    f90: Any = 1.0
    colours: ClassVar[tuple[str, ...]] = ("f0",)
    scalars: ClassVar[tuple[str, ...]] = ("f90",)

    def __call__(self, cos: Array) -> Array:
        f0 = as_columns(self.f0)
        return f0 + (self.f90 - f0) * fifth_power(np.maximum(1 - cos, np.float32(0)))


@dataclass(frozen=True)
class ExactConductor(Conductor):
    """Unpolarised Fresnel reflectance of a metal in air, index ``eta + i k`` as RGB triples."""

    def __call__(self, cos: Array) -> Array:
        index = as_columns(self.eta) + np.complex128(1j) * as_columns(self.k)
        cos = np.asarray(cos, np.float64)
        cos_t = np.sqrt(1 - (1 - cos * cos) / (index * index))
        parallel = (index * cos - cos_t) / (index * cos + cos_t + TINY)
        perpendicular = (cos - index * cos_t) / (cos + index * cos_t + TINY)
        return ((np.abs(parallel) ** 2 + np.abs(perpendicular) ** 2) / 2).astype(np.float32)
