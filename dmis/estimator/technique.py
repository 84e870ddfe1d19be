"""Sampling techniques: ways to pick a direction for direct lighting.

Each technique is a pair of functions with the same leading arguments: ``sample`` picks directions at surface points and
returns their light samples; ``pdf`` is the density, per solid angle, with which it would pick given directions,
or, where that is not known, what stands in for it in MIS weights (examples/literature/resampled.py).
Two techniques or more are mixed in `dmis.estimator.direct`; anything that has these two functions can be one of them.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields, replace
from typing import Any

from dmis.base.plugins import Registry, guarded, is_shipped
from dmis.base.validate import check_array, number, whole
from dmis.base.vectors import Array
from dmis.brdf.cosines import Directions
from dmis.light.light import SampledLight as SampledLight
from dmis.light.light import check_light_sample
from dmis.light.light_sample import LightSample
from dmis.samplers.warp import TWO_PI, square_to_hemisphere, to_world
from dmis.scene.shading_points import ShadingPoints

SHADING = 0.25
"""Cost of a light or BRDF sample before its ray."""


@dataclass(frozen=True)
class Technique:
    """A way to pick directions.

    It is a value: `sample` and `pdf` may be methods of an object that holds what a pilot taught, such as a table of
    directions, and a round takes it as it is (`dmis.fit.round.Round.techniques`). With worker processes it is pickled,
    so they must be of a module that these import, such as a plug-in.

    Attributes
    ----------
    name
        Its name in options and tables.
    rays
        The kind under which its occlusion rays are counted.
    sample
        ``(surface, light, u) -> LightSample``, `u` ``(numbers, N)``.
    pdf
        ``(surface, directions, light_pdf) -> (N,)``.
    numbers
        How many uniform numbers a sample needs, 2 to 4.
    exact
        Whether `pdf` is the density of `sample`, and no stand-in.
    cost
        Cost of a sample before its ray, in the units of `dmis.estimator.cost`.
    """

    name: str
    rays: str
    sample: Callable[[ShadingPoints, SampledLight, Array], LightSample]
    pdf: Callable[[ShadingPoints, Directions, Array], Array]
    numbers: int = 2
    exact: bool = True
    cost: float = SHADING

    def __reduce__(self) -> Any:
        """Return what is pickled: the name of a registered technique; of others, the functions and what they hold."""
        if TECHNIQUES.get(self.name) is self:
            return technique_by_name, (self.name,)
        return Technique, tuple(getattr(self, field.name) for field in fields(self))


LIGHT = Technique(
    "light",
    "shadow",
    lambda surface, light, u: light.sample(surface.p, u),
    lambda surface, directions, light_pdf: light_pdf,
)
BRDF = Technique(
    "brdf",
    "brdf",
    lambda surface, light, u: light.hit(surface.p, surface.sample(u)),
    lambda surface, directions, light_pdf: surface.pdf(directions),
)
UNIFORM = Technique(
    "uniform",
    "uniform",
    lambda surface, light, u: light.hit(surface.p, to_world(square_to_hemisphere(u), surface.n)),
    lambda surface, directions, light_pdf: directions.above / TWO_PI,
)
TECHNIQUES: Registry[Technique] = Registry(
    "technique",
    {technique.name: technique for technique in (LIGHT, BRDF, UNIFORM)},
    source=lambda technique: technique.sample,
)
"""Techniques by name. `UNIFORM`, of equal density over the hemisphere, is for teaching."""
_OTHER_RAYS = frozenset({"camera", "delta", "specular", "guide"})
"""Kinds of rays that are not of a technique, see `dmis.pipeline.result.Result.rays`."""


def register_technique(technique: Technique) -> None:
    """Add a technique by its name, as in the rule ``fixed:light=0.5,NAME=0.5``.

    A ValueError if it is not right, see `check_technique_form`.
    """
    check_technique_form(technique)
    TECHNIQUES[technique.name] = technique


def check_technique_form(technique: Technique) -> None:
    """Raise a ValueError if a technique cannot be one beside those that are registered.

    Its name must be right (`dmis.base.plugins.Registry.check`); its kind of rays must not be that of other rays;
    sample and pdf must be functions, and it needs 2 to 4 uniform numbers.
    """
    if not isinstance(technique, Technique):
        raise ValueError(f"a technique must be a dmis.Technique; got {technique!r}")
    name, rays = technique.name, technique.rays
    for part in ("sample", "pdf"):
        if not callable(function := getattr(technique, part)):
            raise ValueError(f"technique {name}: {part} must be a function; got {function!r}")
    TECHNIQUES.check(name, technique)
    taken = sorted(_OTHER_RAYS | {other.rays for other in TECHNIQUES.values() if other.name != name})
    if not isinstance(rays, str) or rays in taken or rays.startswith("bounce"):
        example = f"{name}_rays" if name in taken else name
        raise ValueError(
            f"technique {name}: rays must be a word under which its rays alone are counted, such as {example!r}; not "
            f"one of {', '.join(taken)}, nor one that begins with bounce; got {rays!r}"
        )
    whole(f"numbers of technique {name}", technique.numbers, 2, 4)
    number(f"cost of technique {name}", technique.cost, 0)


def checked_technique(technique: Technique) -> Technique:
    """Return a technique whose functions check what they return, see `dmis.base.plugins`; one of dmis as it is."""
    if is_shipped(technique.sample) and is_shipped(technique.pdf):
        return technique
    of = f"of technique {technique.name}"
    sample = guarded(f"sample {of}", technique.sample, _check_sample)
    return replace(technique, sample=sample, pdf=guarded(f"pdf {of}", technique.pdf, _check_pdf))


def _check_sample(call: str, light_sample: Any, surface: ShadingPoints, light: SampledLight, u: Array) -> None:
    """Raise a ValueError unless light samples are right."""
    check_light_sample(call, light_sample, light, u, u, surface)


def _check_pdf(call: str, pdf: Any, surface: ShadingPoints, directions: Directions, light_pdf: Array) -> None:
    """Raise a ValueError unless densities are right above the surface."""
    check_array(call, pdf, len(light_pdf), "(N,)", where=lambda: directions.above)


def technique_by_name(name: Technique | str) -> Technique:
    """Return the technique called `name`; a technique is returned as it is.

    A ValueError if there is none of that name.
    """
    if isinstance(name, Technique):
        return name
    if name not in TECHNIQUES:
        raise TECHNIQUES.unknown(name)
    return TECHNIQUES[name]
