"""A batch: camera samples that are shaded together, what they need for it, and what is written down of them."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field

import numpy as np

from dmis.intersect import RayCaster
from dmis.mis import Counts
from dmis.samplers import Sampler
from dmis.scene import Scene
from dmis.settings import Settings
from dmis.vec import Array, Selection


@dataclass(eq=False)
class Batch:
    """One block of camera samples of one tile, and what is needed to shade it.

    Attributes
    ----------
    w
        Share of the first technique, ``(N,)`` or one number; of K > 2 techniques all shares, ``(K, N)`` or ``(K, 1)``.
    counts
        How many shading samples of each camera sample go to each technique; falling for the first, so that those with
        the same number are a slice at the first surface, and nothing needs to be gathered.
    rng
        For choices that are not two-dimensional draws.
    rays
        Rays traced so far, by kind.
    records
        Where shading samples are written down for statistics; None: nowhere.
    control
        Coefficient of the control variate, ``(3, N)``, see `dmis.control`; None: there is none.
    later
        `w` and `counts` of all surfaces but the first, whose counts are in no order; None: the same.
    """

    scene: Scene
    caster: RayCaster
    settings: Settings
    sampler: Sampler
    rng: np.random.Generator
    w: Array
    counts: Counts
    rays: Counter[str] = field(default_factory=Counter)
    records: list[Record] | None = None
    control: Array | None = None
    later: tuple[Array, Counts] | None = None

    def division(self, path: tuple[int, ...]) -> tuple[Array, Counts]:
        """Shares and counts at the surfaces that `path` led to."""
        return (self.w, self.counts) if self.later is None or not path else self.later


@dataclass(frozen=True, eq=False)
class Record:
    """Shading samples of one technique whose directions meet a light.

    Attributes
    ----------
    side
        Number of the technique, 0 for the first.
    key
        Which light, in the last place, counted on for light that comes through a rough surface; before it, by way of
        which delta lobes, or in path tracing the number of surfaces before.
    turn
        Which of the camera sample's samples of this technique it is, from 0.
    sample
        Numbers of their camera samples, ``(N,)``, each at most once; None: all, in order.
    value
        What each would estimate alone, ``W f / (share p_own)``, with the throughput of its path, ``(3, N)``; 0 where
        something is in between.
    pdf
        Densities of all techniques in its direction, ``(K, N)``.
    """

    side: int
    key: tuple[int, ...]
    turn: int
    sample: Selection | None
    value: Array
    pdf: Array

    @property
    def depth(self) -> int:
        """In path tracing, surfaces that the path had met before."""
        return self.key[0] if len(self.key) > 1 else 0
