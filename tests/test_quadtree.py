"""Adaptive patches: joined where curves agree, apart where they surely differ."""

import numpy as np

from dmis.curves import GRID, HALF
from dmis.quadtree import LARGEST, adaptive_patches
from dmis.vec import Array

ONE = np.ones(len(GRID))


def sums(best: Array, noise: float = 0.02, seed: int = 1) -> tuple[dict[str, Array], Array]:
    """Base patches of 16 pixels whose curves are parabolas about the weights `best` ``(rows, columns)``."""
    rng = np.random.default_rng(seed)
    curve = (GRID[:, None, None] - best) ** 2 + 0.1
    pixels = np.full(best.shape, 16.0)
    samples = curve[..., None] + noise * 4 * rng.normal(size=(*curve.shape, 16))
    cross = samples * samples[HALF]
    found = {"curve": samples.sum(-1), "square": (samples**2).sum(-1), "cross": cross.sum(-1)}
    return {**found, "pattern": np.zeros((len(GRID), *best.shape)), "position": np.zeros(best.shape)}, pixels


def test_agreement_makes_one_patch() -> None:
    """The same curve everywhere: the largest patches, and its best weight."""
    index, size = adaptive_patches(*sums(np.full((32, 32), 0.84)), ONE, 3.0)
    assert (size == 32).all()
    assert np.abs(GRID[index] - 0.84).max() < 0.13


def test_an_edge_stays() -> None:
    """Two halves that differ: no patch reaches over the edge, and both find their weight."""
    best = np.where(np.arange(32) < 12, 0.08, 0.92)[None].repeat(32, 0)
    index, size = adaptive_patches(*sums(best), ONE, 3.0)
    np.testing.assert_allclose(GRID[index], best, atol=0.12)
    assert size[:, 8:16].max() <= 4 and size[:, 16:].max() == 16


def test_noise_alone_does_not_split() -> None:
    """Flat curves under noise: nearly nothing leaves 1/2 by more than the guard allows, and patches are large."""
    found, pixels = sums(np.full((32, 32), 0.5), noise=1.0)
    index, size = adaptive_patches(found, pixels, ONE, 3.0)
    assert np.mean(size >= 8) > 0.9
    assert np.mean(index == HALF) > 0.9


def test_ragged_borders_and_limits() -> None:
    """Any shape works; patches grow to the limit and no further."""
    for shape in ((1, 1), (3, 5), (2 * LARGEST + 1, LARGEST)):
        index, size = adaptive_patches(*sums(np.full(shape, 0.27)), ONE, 3.0)
        assert index.shape == size.shape == shape
        assert size.max() <= LARGEST


def test_a_black_image_stays_at_one_half() -> None:
    """Nothing to learn."""
    zero = np.zeros((len(GRID), 8, 8))
    index, _ = adaptive_patches(
        {"curve": zero, "square": zero, "cross": zero, "pattern": zero, "position": zero[0]}, np.ones((8, 8)), ONE, 3.0
    )
    assert (index == HALF).all()
