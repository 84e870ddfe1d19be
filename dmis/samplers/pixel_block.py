"""The pixels of one sampler."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

MORE = -1
"""Mark of the second pair of numbers of a shading sample."""
CONTINUE = -2
"""Mark of the direction in which a path goes on; the key of a path's vertex has as many as the path has bounces."""
ROUNDING = -3
"""Mark of the numbers, and of the order, by which counts of shading samples are rounded up or down."""
LENS = -4
"""Mark of the point on the lens of a camera."""

PICK = -5
"""Mark of the number that picks one of several lights."""


@dataclass(frozen=True, eq=False)
class PixelBlock:
    """Pixels of a tile, which one sampler serves, and the sizes and random stream that the sampler needs.

    Attributes
    ----------
    rng
        Random stream of this tile in this pass. Numbers from it depend on which pixels are a tile.
    seed
        Seed of the image. A sampler whose numbers are functions of it and of `pixels` gives the same ones in every
        tile and pass.
    pixels
        Numbers ``y width + x`` of the P pixels in the image, ``(P,)`` whole numbers.
    stops
        Numbers of camera samples after which some pixels stop, ascending; all stop at the last.
    shading_samples
        Shading samples per camera sample.
    """

    rng: np.random.Generator
    seed: int
    pixels: np.ndarray
    stops: Sequence[int]
    shading_samples: int
