"""Multiple importance sampling: techniques, heuristics that weigh their samples, and combiners by name.

A *technique* is a pair of functions with the same leading arguments: ``sample`` picks directions at surface points and
returns their light samples; ``pdf`` is the density, per solid angle, with which it would pick given directions,
or, where that is not known, what stands in for it in MIS weights (examples/literature/resampled.py).
Two techniques or more are mixed in `dmis.estimator.direct`; anything that has these two functions can be one of them.

A *heuristic* takes the effective densities ``a_j = w_j p_j`` and returns ``W / a_k``, where W is the MIS weight of a
sample of technique k: the factor that multiplies ``f`` in its estimate. With the balance heuristic it is
``1 / sum a_j``, the reciprocal of the mixture density. Source: Veach and Guibas 1995; Veach 1997, chapter 9.

A *combiner* makes one estimate of the shading samples of all techniques. A heuristic is all of it, but for one that
needs all samples of a pixel: that observes their records and corrects the pixel afterwards (`Combiner.collector`). What
a combiner needs of the settings is in its attributes, so that no other module depends on its name.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, fields
from functools import reduce
from typing import Any

import numpy as np

from dmis.base.plugins import Later, Registry, guarded, is_shipped
from dmis.base.validate import check_array, number, positive, whole
from dmis.base.vectors import TINY, Array
from dmis.brdf.lobe import Directions
from dmis.light.light import SampledLight as SampledLight
from dmis.light.light import check_light_sample
from dmis.light.light_sample import LightSample
from dmis.samplers.warp import TWO_PI, square_to_hemisphere, to_world
from dmis.scene.shading_points import ShadingPoints

SHADING = 0.25
"""Cost of a light or BRDF sample before its ray."""


def _check_sample(call: str, light_sample: Any, surface: ShadingPoints, light: SampledLight, u: Array) -> None:
    """Raise a ValueError unless light samples are right."""
    check_light_sample(call, light_sample, light, u, u, surface)


def _check_pdf(call: str, pdf: Any, surface: ShadingPoints, directions: Directions, light_pdf: Array) -> None:
    """Raise a ValueError unless densities are right above the surface."""
    check_array(call, pdf, len(light_pdf), "(N,)", where=lambda: directions.above)


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

    def __post_init__(self) -> None:
        """Guard functions that are not shipped: what they return is checked."""
        for name, check in (("sample", _check_sample), ("pdf", _check_pdf)):
            if callable(function := getattr(self, name)) and not is_shipped(function):
                object.__setattr__(self, name, guarded(f"{name} of technique {self.name}", function, check))

    def __reduce__(self) -> Any:
        """Return what is pickled: the name of a registered technique; of others, the functions and what they hold."""
        if TECHNIQUES.get(self.name) is self:
            return technique_by_name, (self.name,)
        values = (getattr(self, field.name) for field in fields(self))
        return Technique, tuple(getattr(value, "__wrapped__", value) for value in values)


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
    """Raise a ValueError if a technique cannot be registered beside the others.

    Its name must be right (`dmis.base.plugins.Registry.check`); its kind of rays must not be that of other rays;
    sample and pdf must be functions, and it needs 2 to 4 uniform numbers.
    """
    if not isinstance(technique, Technique):
        raise ValueError(f"a technique must be a dmis.Technique; got {technique!r}")
    name = technique.name
    rays = technique.rays
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


def technique_by_name(name: Technique | str) -> Technique:
    """Return the technique called `name`; a technique is returned as it is.

    A ValueError if there is none of that name.
    """
    if isinstance(name, Technique):
        return name
    if name not in TECHNIQUES:
        raise TECHNIQUES.unknown(name)
    return TECHNIQUES[name]


# Heuristics and combiners ---------------------------------------------------------------------------------------------


Heuristic = Callable[[Sequence[Array], int], Array]
"""``(a, k) -> W / a[k]``; k breaks ties, so that the weights of all techniques sum to 1."""
LARGEST_EXPONENT = 1e8
"""Exponent above which two float32 densities that differ have the weights 1 and 0 to float32's precision."""


def balance(a: Sequence[Array], k: int) -> Array:
    """``W = a_k / sum a``."""
    return 1 / np.maximum(_total(a), TINY)


def power(beta: float) -> Heuristic:
    """``W = a_k^beta / sum a^beta``, written with the ratios to a_k so that nothing overflows.

    From `LARGEST_EXPONENT` on it is `maximum`, its limit.
    """
    positive("the exponent of the power heuristic", beta)
    if beta > LARGEST_EXPONENT:
        return maximum
    least = np.float32(1e-18 ** min(1, 2 / beta))  # of a ratio; below it W is 0 to any float

    def raised(a: Array, b: Array) -> Array:
        ratio = b / np.maximum(np.maximum(a, b * least), TINY)
        return ratio * ratio if beta == 2 else ratio ** np.float32(beta)

    def heuristic(a: Sequence[Array], k: int) -> Array:
        others = _total(raised(a[k], b) for j, b in enumerate(a) if j != k)
        return 1 / (np.maximum(a[k], TINY) * (1 + others))

    return heuristic


def maximum(a: Sequence[Array], k: int) -> Array:
    """``W = 1`` for the technique with the largest density, 0 for the others."""
    wins = reduce(np.logical_and, (a[k] > b if j < k else a[k] >= b for j, b in enumerate(a) if j != k))
    return wins / np.maximum(a[k], TINY)


def cutoff(alpha: float) -> Heuristic:
    """Balance among the techniques whose density is at least `alpha` times the largest."""
    number("the threshold of the cutoff heuristic", alpha, 0, 1, "a share of the maximum")

    def heuristic(a: Sequence[Array], k: int) -> Array:
        threshold = np.float32(alpha) * reduce(np.maximum, a)
        return (a[k] >= threshold) / np.maximum(_total(b * (b >= threshold) for b in a), TINY)

    return heuristic


def _total(a: Iterable[Array]) -> Array:
    return reduce(np.add, a)


@dataclass(frozen=True)
class Combiner:
    """A combiner of MIS samples; with the defaults, a heuristic at the shares that samples were taken with.

    Attributes
    ----------
    name
        Its name in options and tables.
    heuristic
        Weights the samples; variance curves are those of this heuristic.
    collector
        From shares ``(2, P)`` or ``(2, 1)`` and numbers of samples ``(P,)`` makes the sums that correct pixels
        (`dmis.estimator.optimal_mis.Optimal`). It needs all samples of each light, which therefore have one share and
        known densities, of two techniques. None: it is a heuristic, whose weights are all there is.
    """

    name: str
    heuristic: Heuristic = balance
    collector: Callable[[Array, Array], Any] | None = None


FAMILIES: dict[str, tuple[Callable[[float], Heuristic], float]] = {"power": (power, 2.0), "cutoff": (cutoff, 0.1)}
"""Heuristics of a parameter, by name, and its default."""
COMBINERS: Registry[Combiner] = Registry(
    "combiner",
    {
        "balance": Combiner("balance"),
        "maximum": Combiner("maximum", maximum),
        "optimal": Later("dmis.estimator.optimal_mis", "OPTIMAL"),
    },
    reserved=dict.fromkeys(FAMILIES, "dmis has it for heuristics of a parameter"),
    source=lambda combiner: combiner.heuristic,
)
"""Combiners without a parameter, by name; `register_heuristic` adds to it."""


def register_heuristic(name: str, heuristic: Heuristic) -> None:
    """Make a heuristic of one's own known by its name, as in ``combiner=NAME`` of settings and rules.

    Parameters
    ----------
    name
        Letters and digits, words joined by ``_``.
    heuristic
        ``(a, k) -> W / a[k]``: from the effective densities ``a_j = w_j p_j``, K arrays ``(N,)``, the weight W of a
        sample of technique k over its own effective density, ``(N,)``. It is tried at some densities of two to four
        techniques, equal ones among them.

    Raises
    ------
    ValueError
        If the name is not right or taken, or the weights of all techniques are not finite, ``(N,)`` and of sum 1: an
        estimate with other weights has another mean.
    """
    COMBINERS.check(name, Combiner(name, heuristic))
    heuristic = guarded(f"heuristic {name}", heuristic, _check_over)
    rng = np.random.default_rng(1)
    for techniques, n in ((2, 1000), (3, 1000), (4, 8)):
        a = list(rng.exponential(size=(techniques, n)).astype(np.float32) ** 4)
        a[0][: n // 4] = 0  # a technique that does not reach the direction
        for density in a:
            density[n // 2 :] = rng.integers(1, 4, n // 2)  # equal ones among them
        with np.errstate(all="ignore"):  # what is not finite is refused
            total = sum(a[k] * heuristic(a, k) for k in range(techniques))
        wrong = ~(np.abs(total - 1) < 1e-3)  # of a NaN, too
        if wrong.any():
            raise ValueError(
                f"weights W of heuristic {name} must add up to 1 over the techniques; got {total[wrong][0]:.4g} for "
                f"the effective densities {', '.join(f'{density[wrong][0]:.4g}' for density in a)}. It must return "
                f"W / a[k], not W, and where densities are equal, k must break the tie"
            )
    COMBINERS[name] = Combiner(name, heuristic)


def _check_over(call: str, over: Any, a: Sequence[Array], k: int) -> None:
    """Raise a ValueError unless W / a[k] is right where a[k] is not 0."""
    check_array(call, over, a[k].size, str(a[k].shape), where=lambda: a[k] > 0)


def combiner_by_name(name: str) -> Combiner:
    """Return a combiner of `COMBINERS`, or of `FAMILIES`: ``power`` (exponent 2), ``power-3``, ``cutoff-0.5``.

    A ValueError if there is none of that name, or its number is out of range.
    """
    if name in COMBINERS:
        return COMBINERS[name]
    kind, dash, text = name.partition("-")
    try:
        heuristic, default = FAMILIES[kind]
        parameter = float(text) if dash else default
    except (KeyError, ValueError):
        from dmis.base.synonyms import COMBINERS as OLD
        from dmis.base.synonyms import advice

        raise COMBINERS.unknown(name, ", power[-EXPONENT], cutoff[-THRESHOLD]", advice(name, OLD, COMBINERS)) from None
    return Combiner(name, heuristic(parameter))
