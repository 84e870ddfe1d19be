"""Difference of two images that noise of single pixels does not decide."""

import numpy as np

from dmis.base.patches import patch_mean
from dmis.base.vectors import Array


def block_error(image: Array, reference: Array, size: int = 8) -> float:
    """Return the relative L2 difference of the means over blocks, ``sqrt(sum (A - R)^2 / sum R^2)``.

    Ragged borders are left out.
    """
    size = min(size, *image.shape[:2])
    height, width = (n // size * size for n in image.shape[:2])
    whole = (np.moveaxis(np.asarray(x, np.float64)[:height, :width], 2, 0) for x in (image, reference))
    a, r = (patch_mean(x, size) for x in whole)
    return float(np.sqrt(((a - r) ** 2).sum() / (r * r).sum()))
