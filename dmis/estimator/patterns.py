"""Patterns: whole numbers of light and BRDF samples, the same for all camera samples of a pixel.

Low-discrepancy points are even only if every camera sample takes the same number of points, and most even if that is a
power of two. So where they are used, a share w of light samples is one of few: that of a pattern ``n_l : n_b``, with
``w = n_l / (n_l + n_b)``.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

ENDS = ((1, 0), (2, 0), (4, 0), (0, 1), (0, 2), (0, 4))
"""Patterns of one technique alone."""
MIXED = ((1, 1), (2, 1), (1, 2), (4, 1), (1, 4), (2, 2), (4, 2), (2, 4), (4, 4))
"""Patterns of both."""
PATTERNS = (*ENDS, *MIXED)
"""Light and BRDF samples ``(n_l, n_b)`` of a camera sample that has two shading samples by its settings."""
FIRST = PATTERNS.index((2, 2))
"""Index of the pattern of a first round: two pairs, which tell the variance at a point from that over the pixel."""
EQUAL = PATTERNS.index((1, 1))
"""Index of the pattern in which budgets count."""
SHARES = np.array(sorted({n_l / (n_l + n_b) for n_l, n_b in PATTERNS}))
"""Shares w of the patterns, ascending, ``(G,)``."""
SHARE_OF = np.array([int(np.argmin(np.abs(SHARES - n_l / (n_l + n_b)))) for n_l, n_b in PATTERNS])
"""Index in `SHARES` of the share of each pattern."""
SAMPLES_OF = np.array([n_l + n_b for n_l, n_b in PATTERNS])
"""Shading samples of each pattern."""


@dataclass(frozen=True, eq=False)
class PatternMap:
    """Pattern of each pixel.

    Attributes
    ----------
    patterns
        Light and BRDF samples ``(n_l, n_b)`` of each pattern.
    pattern
        Index of the pattern of each pixel, ``(H, W)``.
    first
        Light and BRDF samples of the camera samples of earlier rounds.
    """

    patterns: tuple[tuple[int, int], ...]
    pattern: np.ndarray
    first: tuple[int, int]

    def of_area(self, area: tuple[slice, slice]) -> PatternMap:
        """Return the map of an area of the image, as a view."""
        return replace(self, pattern=self.pattern[area])

    def groups(self, samples: np.ndarray) -> Iterator[tuple[np.ndarray, np.ndarray, tuple[int, int]]]:
        """Yield the pixels ``(A,)`` of each pattern that have `samples` ``(P,)``, these, and the pattern."""
        pattern_of_pixel = self.pattern.reshape(-1)
        for number, pattern in enumerate(self.patterns):
            pixels = np.flatnonzero((pattern_of_pixel == number) & (samples > 0))
            if len(pixels):
                yield pixels, samples.take(pixels), pattern

    def shading_samples(self, samples: np.ndarray, before: np.ndarray) -> np.ndarray:
        """Return the light and BRDF samples of each pixel, ``(2, H, W)``.

        `samples` are its camera samples with its pattern, `before` those of earlier rounds, ``(H, W)`` each.
        """
        first, pattern = np.reshape(self.first, (2, 1, 1)), np.transpose(self.patterns)
        return before * first.astype(np.int32) + samples * pattern.astype(np.int32)[:, self.pattern]
