"""The optimal combiner: exact where it must be, the balance heuristic where it cannot be fitted."""

import numpy as np
import pytest

import dmis
from dmis.combine import LEAST, Optimal
from dmis.estimator import Record
from dmis.vec import Array

PIXELS = 50


def add_samples(optimal: Optimal, f, w: float, n: int, seed: int = 1, missed: float = 0.0) -> Array:
    """n samples per pixel of p_l = 2 x, p_b = 2 (1 - x), `w` of the first; the plain estimate that they give.

    A share `missed` of either technique's samples meets no light.
    """
    rng = np.random.default_rng(seed)
    plain = np.zeros(PIXELS)
    light = round(w * n)
    pixel = np.tile(np.arange(PIXELS), n)
    first = np.repeat(np.arange(n) < light, PIXELS).astype(np.int8)
    records = []
    for side, chosen in ((0, first == 1), (1, first == 0)):
        index = np.flatnonzero(chosen)
        index = index[rng.random(len(index)) >= missed]
        x = np.sqrt(rng.random(len(index)))
        x = x if side == 0 else 1 - x
        pdf = (1 - missed) * np.stack([2 * x, 2 * (1 - x)])
        value = f(x) / (w * pdf[0] + (1 - w) * pdf[1])
        plain += np.bincount(pixel[index], value, PIXELS) / n
        records.append(Record(side, (0,), 0, index, np.repeat(value[None], 3, axis=0), pdf))
    optimal.add(records, pixel, first, 1)
    return plain


@pytest.mark.parametrize("w", [0.25, 0.5, 0.75])
def test_exact_for_combinations_of_the_densities(w: float) -> None:
    """``f = 3 p_l + 5 p_b`` has the integral 8 for any samples, and no variance."""
    optimal = Optimal(w, np.full(PIXELS, 64))
    plain = add_samples(optimal, lambda x: 3 * 2 * x + 5 * 2 * (1 - x), w, 64)
    answer = plain + optimal.correction()
    np.testing.assert_allclose(answer, 8, rtol=1e-6)
    assert np.ptp(plain) > 0.05


@pytest.mark.parametrize("missed", [0.0, 0.3])
def test_consistent(missed: float) -> None:
    """With many samples the mean is the integral, misses or not, and the spread is below that of balance."""
    optimal = Optimal(0.5, np.full(PIXELS, 4000))
    plain = add_samples(optimal, lambda x: x + 0.25, 0.5, 4000, missed=missed)
    answer = (plain + optimal.correction())[0]
    assert answer.mean() == pytest.approx(0.75, abs=4 * answer.std() / np.sqrt(PIXELS) + 1e-3)
    assert answer.std() < plain.std()


@pytest.mark.parametrize("w, n", [(0.0, 64), (1.0, 64), (0.5, 2 * LEAST - 2), (0.1, 40)])
def test_balance_where_the_fit_is_not_possible(w: float, n: int) -> None:
    """A technique without samples, or with too few: no correction."""
    optimal = Optimal(w, np.full(PIXELS, n))
    add_samples(optimal, lambda x: x + 0.25, w, n)
    assert not optimal.correction().any()


def test_identical_densities() -> None:
    """A singular fit is no fit."""
    rng = np.random.default_rng(1)
    optimal = Optimal(0.5, np.full(1, 64))
    first = np.tile(np.array([1, 0], np.int8), 32)
    for side in (0, 1):
        index = np.flatnonzero(first == 1 - side)
        pdf = np.ones((2, 32))
        optimal.add([Record(side, (0,), 0, index, rng.random((3, 32)), pdf)], np.zeros(64, int), first * (side == 0), 1)
    assert not optimal.correction().any()


def test_renders(box: dmis.Scene) -> None:
    """Less error than balance with the same samples, hardly any bias, and the same for any number of threads."""
    reference = np.mean([dmis.render(box, "balance", 512, seed=s).image for s in range(100, 104)], axis=0)
    errors, means = {}, {}
    for combiner in ("balance", "optimal"):
        images = [dmis.render(box, f"balance:combiner={combiner}", 64, seed=s).image for s in range(6)]
        errors[combiner] = np.mean([dmis.mse(image, reference) for image in images])
        means[combiner] = np.mean(images)
    assert errors["optimal"] < errors["balance"]
    assert means["optimal"] == pytest.approx(reference.mean(), rel=0.01)
    one, two = (dmis.render(box, "auto:combiner=optimal", 64, seed=1, threads=n).image for n in (1, 2))
    assert np.array_equal(one, two)
