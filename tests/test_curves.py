"""Variance curves from one pilot: closed forms, unbiasedness, and what renders measure."""

import itertools

import numpy as np
import pytest
from helpers import Z_LIMIT

import dmis
from dmis import mis
from dmis.batch import Record
from dmis.curves import GRID, HALF, Curves
from dmis.pooled import Pooled
from dmis.vec import Array

A = 0.25  # p_l = 2 x, p_b = 2 (1 - x) on [0, 1], f = A + (1 + 2 y) x at the point y, uniform in [0, 1]


def f(x: Array, y: Array) -> Array:
    return A + (1 + 2 * y) * x


def exact(w: float, s: int, combiner: str = "balance") -> tuple[float, float]:
    """By quadrature: the variance of a camera sample with s shading samples, and that of I(y)."""
    x = ((np.arange(20_000) + 0.5) / 20_000)[:, None]
    y = (np.arange(50) + 0.5) / 50
    densities, shares = (2 * x, 2 * (1 - x)), (w, 1 - w)
    effective = [share * p for share, p in zip(shares, densities, strict=True)]
    estimates = [f(x, y) * mis.find(combiner)(effective, own) for own in (0, 1)]
    light, brdf = (np.mean(p * c, axis=0) for p, c in zip(densities, estimates, strict=True))
    second_l, second_b = (np.mean(p * c**2, axis=0) for p, c in zip(densities, estimates, strict=True))
    np.testing.assert_allclose(w * light + (1 - w) * brdf, np.mean(f(x, y), axis=0))  # whatever the combiner
    total = 0.0
    for n, share in ((int(w * s), 1 - w * s % 1), (int(w * s) + 1, w * s % 1)):  # light samples of a camera sample
        if share:
            mean = (n * light + (s - n) * brdf) / s
            at_y = n * (second_l - light**2) + (s - n) * (second_b - brdf**2)
            total += share * float(mean.var() + at_y.mean() / s**2)
    return total, float((w * light + (1 - w) * brdf).var())


def pilot(pixels: int, count: int, seed: int, keys: int = 1, s: int = 2, combiner: str = "balance") -> Curves:
    """A 1-D pilot: s samples of each technique for each camera sample, at w = 1/2, from `keys` equal lights."""
    rng = np.random.default_rng(seed)
    curves = Curves(pixels, 2 * s, combiners=combiner.split("+"))
    n = pixels * count
    records, radiance, y = [], np.zeros(n), rng.random(n)
    for key in range(keys):
        for side, turn in itertools.product((0, 1), range(s)):
            x = np.sqrt(rng.random(n))
            x = x if side == 0 else 1 - x
            pdf = np.stack([2 * x, 2 * (1 - x)])
            value = f(x, y) / pdf.mean(axis=0)
            radiance += value / (2 * s)
            value = np.repeat(value[None], 3, axis=0).astype(np.float32)
            records.append(Record(side, (key,), turn, None, value, pdf.astype(np.float32)))
    curves.add(records, np.repeat(radiance[None], 3, axis=0).astype(np.float32), count)
    return curves


@pytest.mark.parametrize("count, s", [(2, 2), (6, 2), (3, 4)])
def test_curve_is_unbiased(count: int, s: int) -> None:
    """What depends on w and what does not, for one light, from 2 and 6 camera samples alike.

    The ends of the grid have no finite variance here (p_l = 0 at one end of the interval), so they are left out.
    """
    sums = pilot(40_000, count, seed=count, s=s).sums()
    assert unbiased(sums["position"], exact(0.5, s)[1])
    for g in range(1, len(GRID) - 1):
        total, position = exact(float(GRID[g]), s)
        values = sums["curve"][g]
        assert unbiased(values, total - position)
        assert values.std() / np.sqrt(len(values)) < 0.05 * exact(0.5, s)[0]


@pytest.mark.parametrize("combiner", ["power", "power-3", "power-9", "maximum", "cutoff-0.5"])
def test_curves_of_other_heuristics(combiner: str) -> None:
    """From the same samples as those of the balance heuristic, as little biased."""
    sums = pilot(40_000, 6, seed=7, combiner=combiner).sums()
    assert unbiased(sums["position"], exact(0.5, 2)[1])
    for g in range(1, len(GRID) - 1):
        total, position = exact(float(GRID[g]), 2, combiner)
        assert unbiased(sums["curve"][g], total - position)


def test_split_curves() -> None:
    """Curves for half and for three times the shading samples, from those for four."""
    sums = pilot(40_000, 4, seed=5, s=4).sums()
    for times in (0.25, 0.5, 3.0):
        pixels = Pooled(**sums, pixels=np.ones(40_000)).split(times, 4)
        for g in range(1, len(GRID) - 1):
            total, position = exact(float(GRID[g]), round(4 * times))
            assert unbiased(pixels.curve[g], total - position)


def test_lights_add_up() -> None:
    """Curves of two equal lights are twice that of one, and their radiance varies together over the pixel."""
    sums = pilot(40_000, 6, seed=2, keys=2).sums()
    total, position = exact(0.5, 2)
    assert unbiased(sums["curve"][HALF], 2 * (total - position)) and unbiased(sums["position"], 4 * position)


def unbiased(values: Array, expected: float) -> bool:
    """A z-test of the mean."""
    return abs(values.mean() - expected) < Z_LIMIT * values.std(ddof=1) / np.sqrt(len(values))


def test_standard_error_of_the_gain() -> None:
    """From the sums over pixels, as from the pixels themselves."""
    sums = pilot(500, 6, seed=4).sums()
    cost = np.linspace(1, 1.5, len(GRID))
    pooled = Pooled(**{name: a.mean(axis=-1) for name, a in sums.items()}, pixels=np.array(500))
    gain = sums["curve"] * cost[:, None] - sums["curve"][HALF] * cost[HALF]
    np.testing.assert_allclose(pooled.gain_error(cost), gain.std(axis=1, ddof=1) / np.sqrt(500), rtol=1e-5)
    assert pooled.gain_error(cost)[HALF] == pytest.approx(0, abs=1e-9)


def test_black_pixels() -> None:
    """No record, no variance."""
    curves = Curves(4, 4)
    curves.add([], np.zeros((3, 8), np.float32), 2)
    assert all((a == 0).all() for a in curves.sums().values())


def test_one_sample_is_too_few() -> None:
    """A variance needs two."""
    with pytest.raises(ValueError, match="at least two camera samples"):
        Curves(4, 4).add([], np.zeros((3, 4), np.float32), 1)


def test_odd_shading_samples_have_no_pairs(box: dmis.Scene) -> None:
    """Said clearly, before anything is rendered."""
    with pytest.raises(ValueError, match="shading_samples must be even"):
        dmis.render(box, "second-moment", 16, settings=dmis.Settings(shading_samples=3))


@pytest.mark.parametrize("w, combiner", [*((w, "balance") for w in (0.08, 0.27, 0.5, 0.84)), (0.27, "power")])
def test_curve_predicts_renders(box: dmis.Scene, w: float, combiner: str) -> None:
    """The variance of rendered images at w, over many seeds, is what pilots at 1/2 say.

    In the mean over a part of the floor, where nothing but the shading samples brings variance.
    """
    from dmis.learned import Learned
    from dmis.render import render

    floor = box.crop((18, 24), (0, 10))
    rule = Learned(patch=32, spp=256, filter="none", shrink=False, combiner=combiner)
    fits = [render(floor, rule, 257, seed=s).maps["variances"].mean(axis=(1, 2)) for s in range(6)]
    predicted = np.mean(fits, axis=0)[list(GRID).index(np.float32(w))]
    images = np.array(
        [render(floor, f"fixed:{w},combiner={combiner}", 64, seed=s).image.mean(axis=2) for s in range(96)]
    )
    measured = images.var(axis=0, ddof=1).mean() * 64
    assert measured == pytest.approx(predicted, rel=0.08)  # four standard errors of both


def test_all_in_shadow() -> None:
    """Where all that was seen of a light is in shadow, in a whole tile, there is nothing to be worked out."""
    record = Record(0, (0,), 0, np.arange(6), np.zeros((3, 6), np.float32), np.ones((2, 6), np.float32))
    curves = Curves(2, 4, combiners=("balance", "power"))
    curves.add([record], np.zeros((3, 6), np.float32), 3)
    assert all(not values.any() for values in curves.sums().values())


@pytest.mark.parametrize("lights", [1, 2])
def test_dark_pixels_are_left_out(lights: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """Where nothing is lit nothing is worked out, and the sums of all pixels are the same, to the last bit."""
    rng = np.random.default_rng(4)
    pixels, count = 300, 3
    sample = np.flatnonzero(np.tile(rng.random(pixels) < 0.3, count))
    records = []
    for key, side, turn in itertools.product(range(lights), (0, 1), (0, 1)):
        value = rng.random((3, len(sample))).astype(np.float32) * (rng.random(len(sample)) < 0.5)
        pdf = rng.random((2, len(sample))).astype(np.float32)
        records.append(Record(side, (key,), turn, sample, value.astype(np.float32), pdf))
    found = []
    for least, together in ((0, 2**16), (1, 2**16), (1, 200)):
        monkeypatch.setattr("dmis.curves.GATHERED", least)
        monkeypatch.setattr("dmis.curves.TOGETHER", together)
        curves = Curves(pixels, 4, combiners=("balance", "power"))
        curves.add(records, np.ones((3, pixels * count), np.float32), count)
        found.append(curves.sums())
    assert 0 < np.count_nonzero(found[0]["curve"][0, 1]) < 0.4 * pixels
    for other in found[1:]:
        for name, values in found[0].items():
            np.testing.assert_array_equal(other[name], values)
