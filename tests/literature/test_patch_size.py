"""Patch size by cross-validation: planted maps of variances, and the mean of the score."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from helpers import Z_LIMIT, z_score

from dmis.base.patches import patch_mean, patch_spread
from dmis.base.vectors import Array
from dmis.fit.registry import Thesis
from dmis.fit.thesis import parabola_minimum
from dmis.variance.moments import Film, Moments

pytestmark = pytest.mark.usefixtures("literature")
SIZES = (4, 8, 16, 32)
W = np.array([0.0, 0.5, 1.0])


def parabolas(minimum: Array, floor: float) -> Array:
    """Variances of the pixels at `W`, ``(3, H, W)``: parabolas with the given minima ``(H, W)``."""
    return np.stack([(w - minimum) ** 2 + floor for w in W])


def sampled(variance: Array, seed: int) -> Array:
    """Estimates of the variances from two samples of a normal distribution each."""
    return variance * np.random.default_rng(seed).chisquare(1, variance.shape)


def checkers(side: int, size: int = 128) -> Array:
    """Minima 0.1 and 0.9 in a checkerboard of squares of that `side`."""
    row, column = np.mgrid[:size, :size] // side
    return np.where((row + column) % 2, 0.1, 0.9)


def fit_patches(y: Array, area: Array) -> Array:
    """The parabola's minimum in each patch, without a filter."""
    return parabola_minimum(W, y)[0]


@pytest.mark.parametrize("floor", [0.05, 1.0])
@pytest.mark.parametrize("side", SIZES)
def test_planted_patterns(literature: Any, side: int, floor: float) -> None:
    """Squares of a checkerboard are found, from two samples at each share, although the noise is as large as V."""
    sizes = [
        literature.patch_size.choose_patch(W, sampled(parabolas(checkers(side), floor), seed), fit_patches)[0]
        for seed in range(5)
    ]
    assert np.mean(np.array(sizes) == side) >= 0.8


@pytest.mark.parametrize(("side", "floor", "smallest"), [(16, 0.05, True), (999, 1.0, False)])
def test_the_filter_is_part_of_the_choice(literature: Any, side: int, floor: float, smallest: bool) -> None:
    """With the 5x5 Gaussian, squares of 16 pixels need the smallest patches; a constant map still large ones."""
    sizes = []
    for seed in range(5):
        spread = np.sqrt(sampled(parabolas(checkers(side), floor), seed))[..., None].repeat(3, axis=-1)
        pilot = {w: Film.of(Moments(2, np.ones_like(s), s * s)) for w, s in zip(W, spread, strict=True)}
        fit = literature.patch_size.ThesisByPilot().fit(pilot)
        chosen = SIZES[int(fit.maps["sizes"][1].argmin())]
        np.testing.assert_array_equal(fit.weight, Thesis(chosen).fit(pilot).weight)
        sizes.append(chosen)
    assert np.mean([size == SIZES[0] if smallest else size > SIZES[1] for size in sizes]) >= 0.8


def scores_and_truth(choose_patch: Any, seed: int, fit: Callable[[Array, Array], Array]) -> tuple[Array, Array, Array]:
    """The scores of the sizes, the variance that the maps of the folds have, and the score of a fit without folds."""
    minimum = np.random.default_rng(1).uniform(0, 1, (32, 40))
    s2 = sampled(parabolas(minimum, 0.2), seed)
    maps: list[Array] = []

    def recorded(y: Array, area: Array) -> Array:
        maps.append(fit(y, area))
        return maps[-1]

    _, scores = choose_patch(W, s2, recorded)
    row, column = np.mgrid[:32, :40] % 2
    truth, naive = np.zeros((2, len(SIZES)))
    basis = np.linalg.inv(np.vander(W, 3))  # coefficients of the parabola through three points
    for k, size in enumerate(SIZES):
        for fold in range(4):
            w = patch_spread(maps[4 * k + fold], size, minimum.shape)
            truth[k] += (((w - minimum) ** 2 + 0.2) * (2 * row + column == fold)).mean()
        w = patch_spread(fit(np.stack([patch_mean(v, size) for v in s2]), row), size, minimum.shape)
        naive[k] = (np.stack([w**2, w, np.ones_like(w)]) * np.tensordot(basis, s2, axes=1)).sum(axis=0).mean()
    return scores, truth, naive


def test_scores_have_the_mean_of_the_true_variance(literature: Any) -> None:
    """Held out, unbiased by a z-test at every size; a score of the pixels that made the fit is too good."""
    scores, truth, naive = np.array(
        [scores_and_truth(literature.patch_size.choose_patch, seed, fit_patches) for seed in range(200)]
    ).swapaxes(0, 1)
    for k in range(len(SIZES)):
        assert abs(z_score(scores[:, k] - truth[:, k], 0.0)) < Z_LIMIT
    assert z_score(naive[:, 0] - truth[:, 0], 0.0) < -2 * Z_LIMIT


@pytest.mark.parametrize("shape", [(1, 1), (3, 50), (33, 17), (128, 5)])
def test_any_resolution(literature: Any, shape: tuple[int, int]) -> None:
    """Ragged patches, folds without a pixel, black and infinite pixels: a size, finite scores, no warning."""
    variance = parabolas(np.full(shape, 0.3), 0.1)
    variance[:, ::2] = 0
    variance[0, 0, 0] = np.inf
    size, scores = literature.patch_size.choose_patch(W, variance, fit_patches)
    assert size in SIZES and np.isfinite(scores).all()


def test_black_pilot(literature: Any) -> None:
    """Of equal scores the largest size is taken."""
    assert literature.patch_size.choose_patch(W, np.zeros((3, 64, 64)), fit_patches) == (
        SIZES[-1],
        pytest.approx(np.zeros(4)),
    )
