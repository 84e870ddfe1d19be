"""Replicates: independent copies of a sequence of points, whose spread is an unbiased estimate of the error.

The samples of a pixel that fill each other's gaps say too much of the error of their mean, and so do parts of their
sequence (`dmis.variance.sub_blocks`). R copies of the sequence with random shifts of their own are independent, so the
mean of their means m_r has the variance

    v = sum_r (m_r - m)^2 / (R (R - 1)),

without bias for any points and any n. It has R - 1 degrees of freedom in each pixel. The price is that n / R points
in R copies are less even than n points: with an error that falls as n^-a, by a factor of R^(a - 1).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from dmis.variance.moments import Film


def replicate_seed(seed: int, replicate: int) -> int:
    """Return the seed of the random numbers of a replicate; the first one has that of the image."""
    if replicate == 0:
        return seed
    return int(np.random.SeedSequence(seed, spawn_key=(replicate,)).generate_state(1, np.uint64)[0])


def mean_of_replicates(films: Sequence[Film], exact: bool) -> Film:
    """Return the mean of R films of equal numbers of samples, and the sum of their n; one film is returned as it is.

    The variance of the mean is that of the spread of the films if `exact`, else the mean of those that they have, over
    R: conservative if theirs are, but with less noise.
    """
    if len(films) == 1:
        return films[0]
    n = films[0].n * len(films)
    image_mean, image_root = (np.empty_like(films[0].mean) for _ in range(2))
    for row in range(len(image_mean)):  # some rows at a time, because images are large
        means = np.stack([film.mean[row] for film in films]).astype(np.float64)
        if exact:
            v = means.var(axis=0, ddof=1) / len(films)
        else:
            # v_r = m2 / (n_r - 1) / n_r
            v = sum(_variance_of_mean(film, row) for film in films) / len(films) ** 2
        n_row = n if isinstance(n, int) else n[row]
        # the m2 that independent samples of the variance v would have
        image_mean[row], image_root[row] = means.mean(axis=0), np.sqrt(v * n_row * (n_row - 1))
    return Film(n, image_mean, image_root)


def _variance_of_mean(film: Film, row: int) -> np.ndarray:
    """Return the estimated variance of the means of a row of pixels, ``(W, 3)``; 0 where there is one sample."""
    n = film.n if isinstance(film.n, int) else film.n[row]
    return np.square(film.root[row], dtype=np.float64) / (np.maximum(n - 1, 1) * n)
