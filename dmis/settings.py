"""How direct lighting is estimated: what can be chosen, and what goes together."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from dmis import mis, technique
from dmis.checks import number, whole
from dmis.samplers import KINDS, Kind

MOST = 100
"""Shading samples of a camera sample."""
DEEPEST = 10_000
"""Surfaces that a camera sample visits."""
DEPTH = 5
"""The same where nobody says."""
_FLOAT32 = np.finfo(np.float32)


@dataclass(frozen=True)
class Settings:
    """How direct lighting is estimated.

    Parameters
    ----------
    shading_samples
        S, light or BRDF samples per camera sample and light.
    techniques
        The techniques that share them, two or more; of two, w is the share of the first.
    combiner
        Heuristic that weights them, see `dmis.mis.find`.
    allocation
        ``systematic`` or ``random``, see `dmis.mis`.
    lights
        ``all``: every light is sampled at every point; ``one``: one light, picked uniformly.
    integrator
        ``direct``: light that reaches surfaces from the lights, seen through mirrors and glass; ``path``: light that
        has been scattered by other surfaces too; ``auto``: what the scene asks for, or else what its plan recommends,
        see `dmis.plan.Plan.settle`.
    max_depth
        Of ``direct``: surfaces that a camera sample may visit through mirrors and glass. Of ``path``: surfaces that
        may scatter light on its way from a light to the camera, 1 being direct lighting; None: any number, ended by
        Russian roulette. ``auto``: what the scene asks for, or else `DEPTH`.
    sampler
        ``independent``, ``stratified`` or ``sobol``, for the final pass; see `dmis.samplers`.
    reuse_pilot
        Whether the samples of a rule's pilot are part of the image, each with the same weight as a final sample. None:
        if the final samples are independent, as the pilot's are; the others are more even, and a few independent ones
        among them cost more than they bring.
    clamp
        Radiance that no channel of a camera sample may exceed: **biased**, see `dmis.fireflies`. None: any.
    """

    shading_samples: int = 2
    techniques: tuple[str, ...] = ("light", "brdf")
    combiner: str = "balance"
    allocation: str = "systematic"
    lights: str = "all"
    integrator: str = "auto"
    max_depth: int | str | None = "auto"
    sampler: Kind = "independent"
    reuse_pilot: bool | None = None
    clamp: float | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "shading_samples", whole("shading_samples", self.shading_samples, 1, MOST))
        if len(self.techniques) < 2:
            raise ValueError(f"techniques must be at least two names, which share the samples; got {self.techniques}")
        techniques = [technique.find(name) for name in self.techniques]
        mis.find(self.combiner)
        if len(techniques) > 2 and self.combiner.startswith(("optimal", "controlled", "frozen")):
            raise ValueError(
                f"combiner {self.combiner} needs two techniques; got {len(techniques)}: {', '.join(self.techniques)}"
            )
        if not all(t.exact for t in techniques) and self.combiner.startswith(("optimal", "controlled")):
            raise ValueError(
                f"combiner {self.combiner} needs densities that are known, which those of technique resampled are not"
            )
        for option, value, allowed in (
            ("integrator", self.integrator, ("auto", "direct", "path")),
            ("allocation", self.allocation, ("systematic", "random")),
            ("lights", self.lights, ("all", "one")),
            ("sampler", self.sampler, KINDS),
        ):
            if value not in allowed:
                raise ValueError(f"{option} must be {' or '.join(allowed)}; got {value!r}")
        if self.combiner.startswith("optimal") and self.lights != "all":
            raise ValueError(
                f"combiner {self.combiner} needs lights all, because its fit is over all samples of each light"
            )
        if self.combiner == "optimal-progressive" and self.sampler != "independent":
            raise ValueError(
                f"combiner optimal-progressive needs sampler independent, because structured samples depend on earlier "
                f"ones, and so on the fit to these; got {self.sampler!r}"
            )
        if self.reuse_pilot not in (None, True, False):
            raise ValueError(f"reuse_pilot must be True, False or None; got {self.reuse_pilot!r}")
        if self.reuse_pilot is not None:
            object.__setattr__(self, "reuse_pilot", bool(self.reuse_pilot))
        if self.clamp is not None:
            least, most = float(_FLOAT32.tiny), float(_FLOAT32.max)
            clamp = number("clamp", self.clamp, least, most, "a radiance that float32 holds in full, or None")
            object.__setattr__(self, "clamp", clamp)
        if self.clamp is not None and self.combiner.startswith("optimal"):
            raise ValueError(f"clamp needs a combiner that adds up camera samples; {self.combiner} fits them together")
        if self.max_depth is None and self.integrator != "path":
            raise ValueError(
                "max_depth must be a number with integrator direct or auto, because mirrors may face each other"
            )
        if self.max_depth not in (None, "auto"):
            object.__setattr__(self, "max_depth", whole("max_depth", self.max_depth, 1, DEEPEST, "auto or None"))

    @property
    def deepest(self) -> float:
        """`max_depth` as a number that depths compare with; infinite for None. It must not be ``auto`` any more."""
        return math.inf if self.max_depth is None else int(self.max_depth)
