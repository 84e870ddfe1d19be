"""Batches: camera samples that are shaded together, and the state that the estimator shares while it shades them."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field

import numpy as np

from dmis.base.vectors import Array
from dmis.estimator.allocation import Counts
from dmis.estimator.patterns import LightSubsets
from dmis.estimator.records import Record
from dmis.estimator.settings import Settings
from dmis.intersect import RayCaster
from dmis.samplers.streams import Sampler
from dmis.scene.scene import Scene


@dataclass(eq=False)
class Batch:
    """N camera samples of one tile, and the state that shading them needs.

    Attributes
    ----------
    shares
        Shares w_k of the K techniques, ``(K, N)``, or ``(K, 1)`` if those of all camera samples are the same.
    counts
        How many shading samples of each camera sample go to each technique; falling for the first, so that those with
        the same number are a slice at the first surface, and nothing needs to be gathered.
    tilt
        Shares t_k of the balance heuristic, shaped like `shares`; None: the heuristic uses `shares`.
    rng
        For choices that are not two-dimensional draws.
    rays
        Rays traced so far, by kind.
    records
        Where shading samples are written down for statistics; None: nowhere.
    colour
        Colour of the pixel of each camera sample, ``(N,)``, by which rays are counted as well; None: they are not.
    light_subsets
        Subsets that sample each light at the first surface; None: all camera samples sample all lights.
    subset_radiance
        Weighted radiance from lights that a subset samples, by its sub-blocks, ``(B, 3, N)``.
    """

    scene: Scene
    caster: RayCaster
    settings: Settings
    sampler: Sampler
    rng: np.random.Generator
    shares: Array
    counts: Counts
    tilt: Array | None = None
    rays: Counter[str] = field(default_factory=Counter)
    records: list[Record] | None = None
    colour: np.ndarray | None = None
    light_subsets: LightSubsets | None = None
    subset_radiance: Array | None = None
