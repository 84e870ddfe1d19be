"""Sampling techniques: ways to pick a direction for direct lighting.

Each technique is a pair of functions with the same leading arguments: ``sample`` picks directions at surface points and
tells what they see of a light; ``pdf`` is the density, per solid angle, with which it would pick given directions,
or, where that is not known, what stands in for it in MIS weights (`dmis.resampling`).
Two techniques or more are mixed by `dmis.mis`; anything that has these two functions can be one of them.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from dmis.light import AreaLight as _AreaLight
from dmis.light import EnvironmentLight, Seen
from dmis.pair import Pair
from dmis.resampling import resampled
from dmis.surface import Surface
from dmis.vec import Array
from dmis.warp import TWO_PI, square_to_hemisphere, to_world

SampledLight = _AreaLight | EnvironmentLight


@dataclass(frozen=True)
class Technique:
    """A way to pick directions.

    Attributes
    ----------
    name
        Its name in options and tables.
    rays
        The kind under which its occlusion rays are counted.
    sample
        ``(surface, light, u) -> Seen``, `u` ``(numbers, N)``.
    pdf
        ``(surface, pair, light_pdf) -> (N,)``.
    numbers
        How many uniform numbers a sample needs, 2 to 4.
    exact
        Whether `pdf` is the density of `sample`, and no stand-in.
    """

    name: str
    rays: str
    sample: Callable[[Surface, SampledLight, Array], Seen]
    pdf: Callable[[Surface, Pair, Array], Array]
    numbers: int = 2
    exact: bool = True


def _light_sample(surface: Surface, light: SampledLight, u: Array) -> Seen:
    return light.sample(surface.p, u)


def _light_pdf(surface: Surface, pair: Pair, light_pdf: Array) -> Array:
    return light_pdf


def _brdf_sample(surface: Surface, light: SampledLight, u: Array) -> Seen:
    return light.hit(surface.p, surface.sample(u))


def _brdf_pdf(surface: Surface, pair: Pair, light_pdf: Array) -> Array:
    return surface.pdf(pair)


def _uniform_sample(surface: Surface, light: SampledLight, u: Array) -> Seen:
    return light.hit(surface.p, to_world(square_to_hemisphere(u), surface.n))


def _uniform_pdf(surface: Surface, pair: Pair, light_pdf: Array) -> Array:
    return pair.above / TWO_PI


LIGHT = Technique("light", "shadow", _light_sample, _light_pdf)
BRDF = Technique("brdf", "brdf", _brdf_sample, _brdf_pdf)
UNIFORM = Technique("uniform", "uniform", _uniform_sample, _uniform_pdf)
RESAMPLED = Technique("resampled", "resampled", resampled, _light_pdf, numbers=3, exact=False)

TECHNIQUES = {technique.name: technique for technique in (LIGHT, BRDF, UNIFORM, RESAMPLED)}
"""By name. `UNIFORM`, equal density over the hemisphere, is for teaching: importance sampling improves on it."""


def find(name: str) -> Technique:
    """The technique called `name`.

    Raises
    ------
    ValueError
        If there is none of that name.
    """
    try:
        return TECHNIQUES[name]
    except KeyError:
        raise ValueError(f"technique must be one of {', '.join(TECHNIQUES)}; got {name!r}") from None
