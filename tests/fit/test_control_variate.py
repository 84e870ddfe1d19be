"""The control variate: the regression that it rests on, exactness, unbiasedness, and what it does to the error."""

import itertools
from dataclasses import replace

import numpy as np
import pytest
from helpers import Z_LIMIT, images_z_score, pixel_shares

import dmis
from dmis.base.patches import patch_sum
from dmis.base.vectors import Array
from dmis.estimator.allocation import shares_of
from dmis.estimator.records import Record
from dmis.fit.control_variate import SUM_NAMES, WEIGHTS, Controls, coefficients
from dmis.fit.rule import Pilot
from dmis.pipeline.tile import Tile, render_tile
from dmis.testing.scenes import box_scene
from dmis.testing.statistics import z_score
from dmis.variance.moments import Moments


class Nothing:
    """The statistic of a rule that gathers none."""

    def __init__(self, pixels: int, shading_samples: int) -> None: ...

    def add(self, records: list[Record], radiance: Array, count: int) -> None: ...

    def sums(self) -> dict[str, Array]:
        """None."""
        return {}


def planted(f, missed: float = 0.0, pixels: int = 40_000, count: int = 3, keys: int = 1) -> dict[str, Array]:
    """Sums of a 1-D pilot: p_l = 2 x, p_b = 2 (1 - x), `f` of x and of the point y, 2 samples of each technique.

    A share `missed` of either technique's samples meets no light.
    """
    rng = np.random.default_rng(1)
    controls, n = Controls(Nothing, pixels, 4), pixels * count
    y, records = rng.random(n), []
    for key, side, turn in itertools.product(range(keys), (0, 1), range(2)):
        index = np.flatnonzero(rng.random(n) >= missed)
        x = np.sqrt(rng.random(len(index)))
        x = x if side == 0 else 1 - x
        pdf = (1 - missed) * np.stack([2 * x, 2 * (1 - x)])
        value = np.array([[1.0], [2.0], [3.0]]) / 2 * f(x, y[index]) / pdf.mean(axis=0)
        records.append(Record(side, (key,), turn, index, value.astype(np.float32), pdf.astype(np.float32)))
    controls.add(records, np.zeros((3, n), np.float32), count)
    return controls.sums()


# The regression -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("missed", [0.0, 0.3])
@pytest.mark.parametrize("keys", [1, 2])
def test_regression_of_combinations(missed: float, keys: int) -> None:
    """For ``f = (1 + y) (3 p_l + 5 p_b)`` beta is ``3/2 (3 - 8 w)`` at every w: ``f / p_w = I + beta g``.

    A z-test of ``product - beta square`` over pixels, and the light of each channel, 8 times the mass of the densities.
    With misses f is no such combination: it is 0 where they are.
    """
    sums = planted(lambda x, y: (1 + y) * (1 - missed) * (3 * 2 * x + 5 * 2 * (1 - x)), missed, keys=keys)
    for k, w in enumerate(WEIGHTS.astype(float)):
        product, square = sums["control_product"][k], sums["control_square"][k]
        if missed == 0:
            assert abs(z_score(product - 1.5 * (3 - 8 * w) * square, 0.0)) < Z_LIMIT
            assert product.mean() / square.mean() == pytest.approx(1.5 * (3 - 8 * w), abs=0.2)
        assert square.mean() > 0
    expected = keys * 12 * (1 - missed) * np.array([1, 2, 3]) / 2
    np.testing.assert_allclose(sums["control_light"].mean(axis=1), expected, rtol=0.01)


@pytest.mark.parametrize("w", [0.08, 0.27, 0.5, 0.84])
@pytest.mark.parametrize("missed", [0.0, 0.3])
def test_regression_minimises_the_variance(w: float, missed: float) -> None:
    """f = x^4 is no combination of the densities. With fixed counts the variance of ``f / p_w - beta g`` is a parabola
    in beta, whose minimum, measured from samples at w, is what the pilot at 1/2 says.
    """
    k = int(np.abs(WEIGHTS - w).argmin())
    sums = planted(lambda x, y: x**4, missed)
    found = sums["control_product"][k].mean() / sums["control_square"][k].mean()
    rng, n = np.random.default_rng(2), 400_000
    moments = []  # of each technique: variance of h, its covariance with g, variance of g
    for side in (0, 1):
        x = np.sqrt(rng.random(n))
        x = x if side == 0 else 1 - x
        hit = rng.random(n) >= missed
        pdf = np.where(hit, (1 - missed) * np.stack([2 * x, 2 * (1 - x)]), [[1 - side], [side]])
        mixture = w * pdf[0] + (1 - w) * pdf[1]
        moments.append(np.cov(np.where(hit, x**4, 0) / mixture, (pdf[0] - pdf[1]) / mixture))
    light, brdf = moments
    both = w * light + (1 - w) * brdf
    assert found == pytest.approx(both[0, 1] / both[1, 1], abs=0.01)


def pilot(sums: dict[str, Array], shape: tuple[int, int]) -> Pilot:
    """A pilot with the given sums per pixel."""
    found = {name: patch_sum(a.reshape(*a.shape[:-1], *shape), 4) for name, a in sums.items()}
    return Pilot(Moments(6, np.ones((*shape, 3)), np.ones((*shape, 3))), {}, found)


def test_coefficients() -> None:
    """Of pixels alike: beta of each channel at its weight, bounded, and 0 where one technique is alone."""
    sums = planted(lambda x, y: 3 * 2 * x + 5 * 2 * (1 - x), pixels=80 * 80)
    weight = np.repeat([0.0, 0.27, 0.5, 0.97, 1.0], 16)[None] * np.ones((80, 1))
    beta = coefficients(pilot(sums, (80, 80)), shares_of(weight))
    assert beta.shape == (80, 80, 3)
    assert not beta[:, :16].any() and not beta[:, 64:].any()
    for columns, w in ((slice(16, 32), 0.27), (slice(32, 48), 0.5), (slice(48, 64), 0.97)):
        mean = beta[:, columns].mean(axis=(0, 1))
        np.testing.assert_allclose(mean, (3 - 8 * w) * np.array([0.5, 1, 1.5]), rtol=0.05, atol=0.05)
    mixed = np.where(np.arange(80) % 2, 0.0, 0.54) * np.ones((80, 1))  # the mean of a patch is not its pixels' weight
    beta = coefficients(pilot(sums, (80, 80)), shares_of(mixed))
    assert not beta[:, 1::2].any() and beta[:, ::2].any()
    sharp = planted(lambda x, y: 1000.0 * (x > 0.99), pixels=80 * 80)
    beta = coefficients(pilot(sharp, (80, 80)), shares_of(0.5)).mean(axis=2)
    assert beta.max() <= 0.5 * sharp["control_light"].max()


def test_black_pilot() -> None:
    """Where nothing was seen there is no control; nor where the techniques never meet."""
    zeros = {name: np.zeros((3 if name == SUM_NAMES[2] else len(WEIGHTS), 64)) for name in SUM_NAMES}
    assert not coefficients(pilot(zeros, (8, 8)), shares_of(0.5)).any()
    apart = {**zeros, SUM_NAMES[0]: zeros[SUM_NAMES[0]] + 1, SUM_NAMES[2]: zeros[SUM_NAMES[2]] + 1}
    assert not coefficients(pilot(apart, (8, 8)), shares_of(0.5)).any()


# The estimator ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("w", [0.25, 0.5, 0.9])
@pytest.mark.parametrize("allocation", ["systematic", "random"])
def test_exact(w: float, allocation: str) -> None:
    """On a white floor under a constant sky ``f = I p_b``, so ``beta = -w I`` leaves no variance.

    Half of the light's samples come from below the floor: they count with ``g = 1 / w``.
    """
    scene = box_scene(dmis.matte(0.5), (dmis.EnvironmentLight(np.full((1, 1, 3), 2.0)),), resolution=(4, 4), fov=20)
    scene.prepare()
    settings = dmis.Settings(allocation=allocation)
    plain, controlled = (
        render_tile(scene, Tile(1, 0, 0, (0, 4), (0, 4), 8, pixel_shares(w), settings, None, control)).moments.mean
        for control in (None, np.full((3, 16), -w, np.float32))
    )
    assert np.ptp(plain) > 0.05
    np.testing.assert_allclose(controlled, 1, rtol=1e-4)


@pytest.fixture(scope="module")
def balanced(box: dmis.Scene) -> tuple[dmis.Scene, list[Array]]:
    """The box with four times the pixels, and images of it by the balance heuristic."""
    large = box.changed(camera=replace(box.camera, resolution=(64, 48)))
    return large, [dmis.render(large, "balance", 96, seed=s, parallel=1).image for s in range(100, 106)]


@pytest.mark.parametrize("rule", ["second-moment:guard=0", "second-moment:reuse=no", "kl:patch=8"])
def test_renders_without_bias(balanced: tuple[dmis.Scene, list[Array]], rule: str) -> None:
    """The mean of balance, by a z-test, and the same for any number of threads."""
    scene, expected = balanced
    rule += ("," if ":" in rule else ":") + "cost=no,combiner=controlled"
    images = [dmis.render(scene, rule, 24, seed=s, parallel=1).image for s in range(6)]
    assert abs(images_z_score(images, expected)) < Z_LIMIT
    assert np.array_equal(images[1], dmis.render(scene, rule, 24, seed=1, parallel=2).image)


def test_error(box: dmis.Scene) -> None:
    """Never much above balance at the same weights, and below it where these are not at an end."""
    reference = np.mean([dmis.render(box, "balance", 512, seed=s, parallel=1).image for s in range(100, 104)], axis=0)
    for options, limit in (("cost=no", 1.02), ("objective=neyman", 0.97)):
        name, _, value = options.partition("=")
        rule = f"{value}:" if name == "objective" else f"second-moment:{options},"
        errors = [
            np.mean([dmis.mse(dmis.render(box, f"{rule}combiner={c}", 64, seed=s).image, reference) for s in range(8)])
            for c in ("controlled", "balance")
        ]
        assert errors[0] < limit * errors[1]


@pytest.mark.parametrize("rule", ["balance:combiner=controlled", "thesis:combiner=controlled"])
def test_needs_a_pilot(box: dmis.Scene, rule: str) -> None:
    """Said before anything is rendered."""
    with pytest.raises(ValueError, match="combiner controlled needs a rule that learns"):
        dmis.render(box, rule, 16)
