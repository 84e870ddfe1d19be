"""Base classes of lights: what the estimator samples, and what a scene's plan asks a light.

A light is a frozen dataclass that derives from `AreaLight`, `InfiniteLight` or `DeltaLight` and inherits their
defaults. Every test of a kind of light is a call of one of these methods, so that lights can be written outside the
package.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any, ClassVar, Self

import numpy as np

from dmis.base.plugins import checked, is_shipped
from dmis.base.validate import check_array, check_directions, check_form, check_methods, number
from dmis.base.vectors import Array
from dmis.brdf.texture import Image
from dmis.geometry.mesh import Mesh
from dmis.light.light_sample import LightSample, rgb
from dmis.light.pieces import Pieces


class Light:
    """A light of any kind; the methods have defaults, but for `sample`.

    Attributes
    ----------
    delta
        Whether no direction can meet the light by chance: it has no pdf and takes no part in MIS.
    infinite
        Whether rays that leave the scene see it; such a light is an `InfiniteLight`.
    positions, lengths, radiances, intensities
        Fields that have these units (an intensity is power per solid angle); others have none. `positions` is None if
        the light does not say.
    """

    delta: ClassVar[bool] = False
    infinite: ClassVar[bool] = False
    positions: ClassVar[tuple[str, ...] | None] = None
    lengths: ClassVar[tuple[str, ...]] = ()
    radiances: ClassVar[tuple[str, ...]] = ()
    intensities: ClassVar[tuple[str, ...]] = ()

    def sample(self, p: Array, u: Array) -> LightSample:
        """Sample directions from the points `p` ``(3, N)`` towards the light with uniform numbers `u` ``(2, N)``."""
        raise NotImplementedError

    def brightness(self, length: float) -> float:
        """Return the largest radiance; of a point of light, the largest irradiance at the distance `length`.

        A light of 0 is left out of a scene's plan; float32 must hold the brightness of the others. Default: that of
        the fields `radiances` and `intensities`; 1, an ordinary light, if there are none.
        """
        radiances = (getattr(self, name) for name in self.radiances)
        values = [np.max(value.texels if isinstance(value, Image) else value) for value in radiances]
        values += [np.max(getattr(self, name)) / length**2 for name in self.intensities]
        return float(max(values, default=1.0))

    def extent(self) -> float | None:
        """Return the root of the area, or another length of its size, in units of the scene; None if there is none."""
        return None

    def rescaled(self, origin: Array, length: float, gain: float) -> Self:
        """Return the light in other units, which scenes need whose numbers float32 does not hold.

        Parameters
        ----------
        origin
            The new origin, ``(3,)``: positions become ``(x - origin) / length``.
        length
            The new unit of length.
        gain
            The new unit of radiance; that of intensity is ``gain * length**2``.

        Raises
        ------
        ValueError
            If the light does not say which of its fields are positions.
        """
        if self.positions is None:
            raise ValueError(
                f"a scene far from its origin, or very large, small, bright or dark, needs lights to be rescaled. "
                f"{type(self).__name__} has no method rescaled(origin, length, gain), and no positions = (...), which "
                f"names its fields that are. Define one of them, or use ordinary units"
            )
        changes: dict[str, Any] = {}
        units = ((self.positions, length), (self.lengths, length), (self.radiances, gain))
        for names, unit in (*units, (self.intensities, gain * length**2)):
            for name in names:
                value = getattr(self, name)
                if isinstance(value, Image):
                    changes[name] = replace(value, texels=value.texels / unit)
                    continue
                value = np.asarray(value, np.float64) - (origin if name in self.positions else 0.0)
                changes[name] = value / unit if value.ndim else float(value) / unit
        return replace(self, **changes)  # type: ignore[type-var]

    def mesh(self) -> Mesh | None:
        """Return the visible surface, whose winding shows the bright side; None for lights without any."""
        return None

    def hides_itself(self) -> bool:
        """Return whether a part of the light may stand in front of another, so that its mesh must be in the scene."""
        return False


class SampledLight(Light):
    """A light that takes part in MIS: directions towards it are sampled, and given directions may meet it.

    Attributes
    ----------
    needs_normals
        Whether its density depends on the normals of the receiving points. Then it has a method ``seen_from(ng)``,
        which returns the light for points of unit normals `ng` ``(3, N)``.
    """

    needs_normals: ClassVar[bool] = False

    def hit(self, p: Array, wi: Array) -> LightSample:
        """Return the light samples of given unit directions `wi` ``(3, N)`` from the points `p` ``(3, N)``.

        `LightSample.pdf` is the density of `sample` at wi, per solid angle.
        """
        raise NotImplementedError


class InfiniteLight(SampledLight):
    """Light from infinitely far away, at `INFINITE_DISTANCE`: all rays that leave the scene see it."""

    infinite: ClassVar[bool] = True

    def radiance(self, wi: Array) -> Array:
        """Return the radiance ``(3, 1)`` or ``(3, N)`` from unit directions `wi` ``(3, N)``, that of `hit`."""
        return self.hit(np.zeros_like(wi), wi).radiance_at(None)

    def compensated(self, share: float) -> Self:
        """Return the light that draws this share of its samples from what exceeds its mean radiance.

        See `dmis.light.environment.EnvironmentLight.compensated`. Default: the light as it is.
        """
        return self


class AreaLight(SampledLight):
    """A surface that emits on one side.

    Attributes
    ----------
    radiance
        Emitted in every direction of the bright side, linear RGB; a light without it defines `emission`, and
        `brightness` or the fields that `radiances` names.
    textured
        Whether `emission` differs from point to point.
    """

    radiance: Any
    radiances: ClassVar[tuple[str, ...]] = ("radiance",)
    textured: ClassVar[bool] = False

    def emission(self, p: Array) -> Array:
        """Return the radiance emitted from points `p` ``(3, N)`` of the bright side, ``(3, 1)`` or ``(3, N)``.

        Camera rays see it where they meet the light's part, and `sample` and `hit` report it, as one function.
        """
        return rgb("radiance", self.radiance)

    def pieces(self) -> Pieces | None:
        """Return what the light consists of, so that it can be one of many; None: it is sampled by itself."""
        return None

    def extent(self) -> float | None:
        pieces = self.pieces()
        return None if pieces is None else float(np.sqrt(pieces.area.sum()))


class DeltaLight(Light):
    """A light that each point sees in a single direction, outside MIS; `sample` ignores `u`, its pdf is 1."""

    delta: ClassVar[bool] = True

    def is_at(self, point: Array, tolerance: float) -> bool:
        """Return whether the light stands at `point` ``(3,)``, so that all that is seen from there is unshadowed."""
        return False


def check_light_methods(light: Any) -> None:
    """Raise a ValueError if a light that is not shipped lacks a method that has no default, or a brightness."""
    if is_shipped(type(light)):
        return
    if light.delta:
        check_methods(light, DeltaLight, ["sample"])
    else:
        check_methods(light, InfiniteLight if light.infinite else AreaLight, ["sample", "hit"])
        if not light.infinite and not hasattr(light, "radiance"):
            default = all(hasattr(light, name) for name in light.radiances)
            check_methods(light, AreaLight, ["emission"] if default else ["emission", "brightness"])
    number(f"{type(light).__name__}.brightness(length)", checked(light, LIGHT_CHECKS).brightness(1.0), 0)


def check_light_sample(
    call: str, light_sample: Any, _: Any, points: Array, numbers: Array | None = None, surface: Any = None
) -> None:
    """Raise a ValueError unless a call with points, and uniform numbers or directions, returned right light samples.

    With the `surface` of a technique, lengths of directions that leave its back do not matter.
    """
    if not isinstance(light_sample, LightSample):
        raise ValueError(
            f"{call} must return a LightSample of dmis.light.light_sample; got {type(light_sample).__name__}. Write "
            f"LightSample(wi, distance, radiance, pdf, emits)"
        )
    wi = light_sample.wi
    emits = light_sample.emits
    pdf = light_sample.pdf
    distance = light_sample.distance
    count = points.shape[1]
    if not isinstance(emits, np.ndarray) or emits.dtype != bool or emits.shape != (count,):
        got = f"{np.asarray(emits).dtype} of shape {np.shape(emits)}"
        raise ValueError(f"{call}: emits must be bool of shape (N,), such as cos > 0; got {got} for N = {count}")
    if wi is not numbers:  # given ones are right
        check_directions(f"{call}: wi", wi, count, lambda: emits if surface is None else emits & surface.same_side(wi))
    if type(light_sample) is LightSample:  # that of a sky is looked up where it is visible alone
        check_array(f"{call}: radiance", light_sample.radiance, count, *RADIANCE_SHAPES, where=lambda: emits)
    check_array(f"{call}: distance", distance, count, "(N,)", "(1,)", where=lambda: emits & ~np.isposinf(distance))
    if numbers is not None:  # a delta light's is not read
        check_array(f"{call}: pdf", pdf, count, "(N,)", where=lambda: emits | np.isnan(pdf))


RADIANCE_SHAPES = "(3, 1)", "(3, N)"
LIGHT_CHECKS: dict[str, Any] = {
    "sample": check_light_sample,
    "hit": check_light_sample,
    "radiance": lambda call, radiance, _, wi: check_array(call, radiance, wi.shape[1], *RADIANCE_SHAPES),
    "emission": lambda call, radiance, _, p: check_form(call, radiance, p.shape[1], *RADIANCE_SHAPES),
    **dict.fromkeys(("brightness", "extent", "mesh", "hides_itself", "pieces", "is_at", "seen_from")),
}
"""Checks of what the methods of lights return, see `dmis.base.plugins.checked`."""
