"""Base classes of lobes: what the estimator calls, and what a scene's plan asks a lobe.

A lobe is a frozen dataclass that derives from `Lobe` or `DeltaLobe` and inherits their defaults; its fields may have
any names.
"""

from __future__ import annotations

from typing import Any, ClassVar

import numpy as np

from dmis.base.validate import check_array, check_directions
from dmis.base.vectors import Array, dot
from dmis.brdf.cosines import Directions, LocalFrame
from dmis.brdf.texture import Image


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
