"""Bounds of what weights can save: moments against curves of shares and tilts, planted patches, and their choice."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from tilt_curves import TiltCurves
from weight_bounds import BOUNDS, Bounds, ShareTiltMoments, bounds, draw, patch_probabilities, variance

from dmis.base.vectors import Array
from dmis.bench.data import GRID, HALF
from dmis.estimator.allocation import shares_of
from dmis.estimator.settings import Settings
from dmis.fit.fixed import Fixed
from dmis.fit.round import Round, pilot_settings
from dmis.pipeline.job import resolve
from dmis.pipeline.tile import Tile, render_tile
from dmis.variance.curves import Curves
from tests.helpers import shared_scene


@pytest.mark.parametrize(
    ("name", "integrator"), [("teapot-area-light", "direct"), ("veach-mis", "direct"), ("cornell", "path")]
)
def test_moments_are_the_curves(name: str, integrator: str) -> None:
    """At equal shares and tilts V(s, t) is the curve of shares, from the same samples; at s = 1/2 that of tilts."""
    settings = Settings(sampler="independent", compensation=0, integrator=integrator)
    job = resolve(shared_scene(name, (24, 18)), Fixed(0.5), 8, 1, settings)

    def sums(make: object, settings: Settings, spp: int) -> dict[str, Array]:
        statistics = []

        def keep(pixels: int, shading_samples: int) -> object:
            statistics.append(make(pixels, shading_samples))  # type: ignore[operator]
            return statistics[-1]

        round_ = Round(spp, shares_of(0.5), settings, statistic=keep)  # type: ignore[arg-type]
        render_tile(job.scene, Tile(1, 0, 0, (slice(8, 12), slice(8, 12)), round_))
        return statistics[0].sums()  # type: ignore[no-any-return]

    paired = pilot_settings(job.settings, paired=True)
    spp = 64 if name == "veach-mis" else 512
    moments = sums(ShareTiltMoments, paired, spp)
    v = variance(moments["terms"], moments["position"])
    curves = sums(partial(Curves, grid=np.array([0, *GRID, 1], np.float32)), paired, spp)
    of_shares = curves["curve"][1:-1] + curves["position"]
    np.testing.assert_allclose(np.einsum("ggp->gp", v), of_shares, rtol=0.01, atol=1e-3 * of_shares.max())
    if spp == 512 and integrator == "direct":
        tilts = sums(partial(TiltCurves, grid=GRID), job.settings, 2048)["curve"].mean(axis=1)
        np.testing.assert_allclose(v[HALF].mean(axis=1)[2:-2], tilts[2:-2], rtol=0.15)


def planted(noise: float = 0.0) -> Bounds:
    """Patches of which half are best at a tilt and share of 0.84, half at 0.16, with n_k X_k^2 alike; no cost of w."""
    rng = np.random.default_rng(0)
    t = GRID[:, None].astype(float)
    best = np.where(np.arange(64) % 2, 0.84, 0.16)
    of_light, of_brdf = 0.2 + (t - best) ** 2, 0.2 + (t - best) ** 2
    terms = np.stack([of_light, of_brdf, *[np.zeros_like(of_light)] * 3]) * np.ones((2, 2, 1, 1, 1))
    terms[:, :, :2] *= 1 + noise * rng.standard_normal((2, 1, 2, len(GRID), 64))
    cost = np.ones((len(GRID), 64))
    return Bounds(terms, np.zeros((2, 2, 64)), cost, np.ones(64), np.zeros((64, 2), int))


def test_bounds_of_planted_patches() -> None:
    """One tilt saves nothing between two kinds of patches, a tilt for each what the formula says; more choice, less."""
    every = np.arange(64)
    value = dict(zip(BOUNDS, bounds(planted(), 0, every), strict=True))
    at_half = 0.2 + 0.34**2
    assert value["one tilt"] == pytest.approx(1) and value["one share"] == pytest.approx(1)
    assert value["tilt per patch"] == pytest.approx(0.2 / at_half)
    # at t = s, A / s + A / (1 - s) over twice 2 A
    share = min((0.2 + (s - 0.84) ** 2) * (1 / s + 1 / (1 - s)) / 4 for s in GRID.astype(float))
    assert value["share per patch"] == pytest.approx(share / at_half, rel=1e-5)
    assert value["share and tilt"] == pytest.approx(0.2 / at_half)
    assert value["counts"] == pytest.approx(1)


def test_noise_does_not_flatter() -> None:
    """What one half of the samples chooses looks better to itself than to the other half, which is above the truth."""
    every, name = np.arange(64), list(BOUNDS).index("tilt per patch")
    true, crossed = (bounds(data, 0, every)[name] for data in (planted(), planted(0.5)))
    flattered = bounds(planted(0.5), 0, every, judged=0)[name]
    assert flattered < 0.8 * true < true < crossed


def test_patches_stand_for_the_image() -> None:
    """Weighted sums over the drawn patches are those over the image, on average; likely patches stand for fewer."""
    scene = shared_scene("teapot-area-light", (80, 64))
    probability = patch_probabilities(scene, Settings(sampler="independent"))
    assert probability.shape == (16, 20) and probability.sum() == pytest.approx(1) and probability.min() > 0.3 / 320
    values = np.random.default_rng(2).random((16, 20)) * probability
    sums, numbers = [], []
    for seed in range(400):
        places, weight = draw(probability, 8, seed)
        sums.append((values[tuple(places.T)] * weight).sum())
        numbers.append(weight.sum())
        assert np.allclose(weight * probability[tuple(places.T)], 1 / 8)
    for drawn, expected in ((sums, values.sum()), (numbers, 320)):
        assert abs(np.mean(drawn) - expected) < 4 * np.std(drawn) / 20
    assert np.std(sums) < 0.5 * values.sum()
    larger = replace(scene, camera=replace(scene.camera, resolution=(83, 67)))
    assert patch_probabilities(larger, Settings(sampler="independent"), 16).shape == (4, 5)
