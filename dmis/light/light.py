"""Protocols of lights: what the estimator samples, and what a scene's plan asks a light.

A light is a frozen dataclass that derives from `AreaLight`, `InfiniteLight` or `DeltaLight` and inherits their
defaults. Every test of a kind of light is a call of one of these methods, so that lights can be written outside the
package.
"""

from __future__ import annotations

from typing import Any, ClassVar, Protocol, Self, runtime_checkable

import numpy as np

from dmis.base.validate import check_methods
from dmis.base.vectors import Array
from dmis.geometry.mesh import Mesh
from dmis.light.coincident import Coincident
from dmis.light.light_sample import LightSample, Rgb, rgb


@runtime_checkable
class Light(Protocol):
    """A light of any kind; the methods have defaults, but for `sample`.

    Attributes
    ----------
    delta
        Whether no direction can meet the light by chance: it has no pdf and takes no part in MIS.
    infinite
        Whether rays that leave the scene see it; such a light is an `InfiniteLight`.
    """

    delta: ClassVar[bool] = False
    infinite: ClassVar[bool] = False

    def sample(self, p: Array, u: Array) -> LightSample:
        """Sample directions from the points `p` ``(3, N)`` towards the light with uniform numbers `u` ``(2, N)``."""
        raise NotImplementedError

    def brightness(self, length: float) -> float:
        """Return the largest radiance; of a point of light, the largest irradiance at the distance `length`.

        It decides whether the light has power, and in which units float32 holds it. Default: 1, an ordinary light.
        """
        return 1.0

    def has_power(self) -> bool:
        """Return whether the light emits anything; a light without power is left out of a scene's plan."""
        return self.brightness(1.0) > 0

    def extent(self) -> float | None:
        """Return the radius, or the root of the area, in units of the scene; None for lights without any."""
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
            By default, because only the light knows which of its numbers are lengths.
        """
        raise ValueError(
            f"a scene far from its origin, or very large, small, bright or dark, needs lights that can be rescaled; "
            f"{type(self).__name__} has no method rescaled(origin, length, gain). Define it, or use ordinary units"
        )

    def mesh(self) -> Mesh | None:
        """Return the visible surface, whose winding shows the bright side; None for lights without any."""
        return None

    def hides_itself(self) -> bool:
        """Return whether a part of the light may stand in front of another, so that its mesh must be in the scene."""
        return False


class SampledLight(Light, Protocol):
    """A light that takes part in MIS: directions towards it are sampled, and given directions may meet it."""

    def hit(self, p: Array, wi: Array) -> LightSample:
        """Return the light samples of given unit directions `wi` ``(3, N)`` from the points `p` ``(3, N)``.

        `LightSample.pdf` is the density of `sample` at wi, per solid angle.
        """
        raise NotImplementedError


class InfiniteLight(SampledLight, Protocol):
    """Light from infinitely far away, at `INFINITE_DISTANCE`: all rays that leave the scene see it."""

    infinite: ClassVar[bool] = True

    def radiance(self, wi: Array) -> Array:
        """Return the radiance ``(3, 1)`` or ``(3, N)`` from unit directions `wi` ``(3, N)``, that of `hit`."""
        return self.hit(np.zeros_like(wi), wi).radiance_at(None)


class AreaLight(SampledLight, Protocol):
    """A surface that emits on one side.

    Attributes
    ----------
    radiance
        Emitted in every direction of the bright side, linear RGB; a light without it defines `emission` and
        `brightness`.
    textured
        Whether `emission` differs from point to point.
    """

    radiance: Any
    textured: ClassVar[bool] = False

    def emission(self, p: Array) -> Array:
        """Return the radiance emitted from points `p` ``(3, N)`` of the bright side, ``(3, 1)`` or ``(3, N)``.

        Camera rays see it where they meet the light's part, and `sample` and `hit` report it, as one function.
        """
        return rgb("radiance", self.radiance)

    def brightness(self, length: float) -> float:
        """Return the largest radiance."""
        return float(np.max(self.radiance))

    @property
    def overlaps(self) -> Coincident | None:
        """Triangles of the light that overlap others of it in one plane; None: there are none."""
        return None

    @property
    def doubled_triangles(self) -> tuple[int, int] | None:
        """The first two triangles that overlap in one plane and face the same side; None: there are none."""
        return None


class DeltaLight(Light, Protocol):
    """A light that each point sees in a single direction, outside MIS; `sample` ignores `u`, its pdf is 1."""

    delta: ClassVar[bool] = True

    def sample(self, p: Array, u: Array | None = None) -> LightSample:
        """Return the direction of the light from the points `p` ``(3, N)``."""
        raise NotImplementedError

    def is_at(self, point: Array, tolerance: float) -> bool:
        """Return whether the light stands at `point` ``(3,)``, so that all that is seen from there is unshadowed."""
        return False


def check_light(light: Light) -> None:
    """Raise a ValueError if a light lacks a method that has no default."""
    if light.delta:
        check_methods(light, DeltaLight, ["sample"])
        return
    check_methods(light, InfiniteLight if light.infinite else AreaLight, ["sample", "hit"])
    if not light.infinite and not hasattr(light, "radiance"):
        check_methods(light, AreaLight, ["emission", "brightness"])


def moved(position: Rgb | Array, origin: Array, length: float) -> Any:
    """Return positions in other units, see `Light.rescaled`."""
    return (np.asarray(position, np.float64) - origin) / length


def scaled(value: Any, unit: float) -> Any:
    """Return vectors, colours or a number in another unit."""
    out = np.asarray(value, np.float64) / unit
    return out if out.ndim else float(out)
