"""Continuation: how pixels go on after a first round of samples."""

from __future__ import annotations

from dataclasses import dataclass, replace

from dmis.base.vectors import Array
from dmis.estimator.patterns import PatternMap


@dataclass(frozen=True, eq=False)
class Continuation:
    """Pattern and samples of each pixel after the first round.

    A pixel goes on in its sequence, with the pattern of the first round or with another, and all its samples are in the
    image. Or its sequence begins anew with another pattern, and its first round was a pilot only.

    Attributes
    ----------
    patterns
        Patterns, and the number of the sample from which each pixel goes on, ``(H, W)``.
    density
        Camera samples in proportion, not negative, ``(H, W)``.
    cost
        Cost of a camera sample with the pattern of each pixel, ``(H, W)``.
    spent
        Cost of the first round of each pixel in the same units, ``(H, W)``.
    budget
        Cost of a pixel on average, all in all.
    """

    patterns: PatternMap
    density: Array
    cost: Array
    spent: Array
    budget: float

    def of_replicate(self, replicates: int) -> Continuation:
        """Return the plan of one of so many replicates, each of which has an equal part of the samples of a pixel."""
        patterns = replace(self.patterns, begin=self.patterns.begin // replicates)
        return replace(self, patterns=patterns, spent=self.spent / replicates, budget=self.budget / replicates)
