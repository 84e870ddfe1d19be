"""Patterns: whole numbers of light and BRDF samples, the same for all camera samples of a pixel.

Low-discrepancy points are even only if every camera sample takes the same number of points, and most even if that is a
power of two. So where they are used, a share w of light samples is one of few: that of a pattern ``n_l : n_b``, with
``w = n_l / (n_l + n_b)``.

Of several lights, weak and smooth ones need fewer samples. With e *halvings* only the first ``m' = m / 2^e`` of the m
camera samples of a round sample a light, eight at least, which are as evenly distributed as all m. Their weight is
``m / m'``. They are divided into sub-blocks, as the m are (`dmis.variance.moments`), to estimate the variance of their
mean.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace

import numpy as np

from dmis.base.vectors import Array, Selection, take
from dmis.estimator.records import BLOCKS
from dmis.estimator.settings import Settings
from dmis.scene.plan import Plan

ENDS = ((1, 0), (2, 0), (4, 0), (0, 1), (0, 2), (0, 4))
"""Patterns of one technique alone."""
MIXED = ((1, 1), (2, 1), (1, 2), (4, 1), (1, 4), (2, 2), (4, 2), (2, 4), (4, 4))
"""Patterns of both."""
PATTERNS = (*ENDS, *MIXED)
"""Light and BRDF samples ``(n_l, n_b)`` of a camera sample that has two shading samples by its settings."""
FIRST = PATTERNS.index((2, 2))
"""Index of the pattern of a pilot: two pairs, which tell the variance at a point from that over the pixel."""
EQUAL = PATTERNS.index((1, 1))
"""Index of the pattern in which budgets count."""
SHARES = np.array(sorted({n_l / (n_l + n_b) for n_l, n_b in PATTERNS}))
"""Shares w of the patterns, ascending, ``(G,)``."""
SHARE_OF = np.array([int(np.argmin(np.abs(SHARES - n_l / (n_l + n_b)))) for n_l, n_b in PATTERNS])
"""Index in `SHARES` of the share of each pattern."""
SAMPLES_OF = np.array([n_l + n_b for n_l, n_b in PATTERNS])
"""Shading samples of each pattern."""

MOST_HALVINGS = 3
"""Largest number of halvings: at least one camera sample in eight samples a light."""
LEAST_LOOKS = 8
"""Camera samples of a pixel and a round that sample every light, whatever its halvings, or all if there are fewer.

So with a budget N the second moment of a pixel is at most N / 8 times that of equal numbers, however rare its bright
samples are. On veach-mis at 128 samples 8 costs 3 % of relMSE times CPU seconds, 16 would cost 7 %.
"""
FEW_LIGHTS = 32
"""Largest number of lights for which halvings are chosen, because each light needs statistics in memory."""


def separate_lights(plan: Plan, settings: Settings) -> int:
    """Return L, the number of lights with two techniques for which halvings are chosen; 0: no halvings.

    There are none with a single light, nor for paths, where later surfaces have most of the variance and of the cost.
    """
    lights = len(plan.sampled_lights(settings.lights, settings.sky_compensation))
    several = lights <= FEW_LIGHTS and lights + len(plan.deltas) > 1
    return lights if several and settings.integrator == "direct" and not settings.one_light else 0


@dataclass(frozen=True, eq=False)
class PatternMap:
    """Pattern of each pixel.

    Attributes
    ----------
    patterns
        Light and BRDF samples ``(n_l, n_b)`` of each pattern.
    pattern
        Index of the pattern of each pixel, ``(H, W)``.
    halvings
        Halvings of each light, ``(L + 1, H, W)`` uint8, delta lights together in the last place; None: all camera
        samples sample all lights.
    """

    patterns: tuple[tuple[int, int], ...]
    pattern: np.ndarray
    halvings: np.ndarray | None = None

    def of_area(self, area: tuple[slice, slice]) -> PatternMap:
        """Return the map of an area of the image, as a view."""
        halvings = None if self.halvings is None else self.halvings[:, *area]
        return replace(self, pattern=self.pattern[area], halvings=halvings)

    def groups(self, samples: np.ndarray) -> Iterator[tuple[np.ndarray, np.ndarray, tuple[int, int]]]:
        """Yield the pixels ``(A,)`` of each pattern that have `samples` ``(P,)``, these, and the pattern."""
        pattern_of_pixel = self.pattern.reshape(-1)
        for number, pattern in enumerate(self.patterns):
            pixels = np.flatnonzero((pattern_of_pixel == number) & (samples > 0))
            if len(pixels):
                yield pixels, samples.take(pixels), pattern

    def shading_samples(self, samples: np.ndarray) -> np.ndarray:
        """Return the light and BRDF samples of pixels of so many camera `samples` ``(H, W)``, ``(2, H, W)``."""
        return samples * np.transpose(self.patterns).astype(np.int32)[:, self.pattern]


@dataclass(eq=False)
class LightSubsets:
    """Subsets of the N camera samples of a batch that sample each light.

    Attributes
    ----------
    halvings
        As in `PatternMap`, ``(L + 1, N)``.
    number
        Number of each camera sample within its pixel and the round, ``(N,)``.
    samples
        m, camera samples of its pixel in the round, ``(N,)``.
    radiance
        Weighted radiance from lights that a subset samples, by its sub-blocks, ``(B, 3, N)``, added to.
    """

    halvings: np.ndarray
    number: np.ndarray
    samples: np.ndarray
    radiance: Array = field(init=False)

    def __post_init__(self) -> None:
        self.radiance = np.zeros((BLOCKS, 3, len(self.number)), np.float32)

    def of_light(self, light: int, sample: Selection | None) -> tuple[np.ndarray, Array, np.ndarray] | None:
        """Return the subset of the camera samples `sample` for a light, its weights, and its sub-blocks, ``(M,)`` each.

        None if the subset is all of them, with weight 1.
        """
        halvings, m, number = (take(a, sample) for a in (self.halvings[light], self.samples, self.number))
        blocks = np.minimum(m, BLOCKS)
        m_light = np.maximum(-(-m >> halvings), np.minimum(m, LEAST_LOOKS))  # m / 2^e, rounded up
        if (m_light == m).all():
            return None
        subset = np.flatnonzero(number < m_light)
        m, number, blocks, m_light = (a.take(subset) for a in (m, number, blocks, m_light))
        return subset, (m / m_light).astype(np.float32), number * blocks // m_light
