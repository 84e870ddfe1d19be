"""The tilt of the heuristic: closed forms of mean and variance, agreement with the balance heuristic, refusals."""

from functools import partial

import numpy as np
import pytest
from helpers import Z_LIMIT, image_tile, results_z, shared_scene
from tilt_curves import TiltCurves

import dmis
from dmis.base.patches import patch_mean
from dmis.brdf.materials import matte, plastic
from dmis.estimator.allocation import shares_of
from dmis.fit.round import Budget, Round
from dmis.geometry.shapes import sphere
from dmis.light.area import DiskLight, QuadLight
from dmis.pipeline.tile import render_tile
from dmis.testing.scenes import box_scene
from dmis.variance.curves import GRID

SCENES = {
    "teapot-area-light": (40, 40),
    "killeroo-diffuse": (40, 30),
    "killeroo-gold": (40, 30),
    "tt": (40, 22),
    "veach-mis": (40, 30),
    "ten-lights": (40, 30),
}
QUICK = (("killeroo-gold", "direct"), ("tt", "path"))
"""Scenes and integrators whose agreement is tested in every run."""
WEIGHTS = (0.0, 0.1, 0.5, 0.9, 1.0)
ALBEDO, RADIANCE, HEIGHT, RADIUS = 0.5, 4.0, 1.0, 2.0


def disk() -> dmis.Scene:
    """A matte plane under a parallel disk; all pixels see one point, below the disk's centre."""
    light = DiskLight((0, 0, HEIGHT), (0, 0, -1), RADIUS, (RADIANCE,) * 3)
    return box_scene(matte(ALBEDO), (light,), resolution=(16, 16), fov=0.01)


def disk_moments(w: float) -> tuple[float, float]:
    """Mean and variance of one light and one BRDF sample at the point below the disk, by (8a) and (8b)."""
    step = np.arctan(RADIUS / HEIGHT) / 20_000
    theta = (np.arange(20_000) + 0.5) * step
    solid_angle, cos = 2 * np.pi * np.sin(theta) * step, np.cos(theta)
    p_l, p_b = HEIGHT**2 / (np.pi * RADIUS**2 * cos**3), cos / np.pi
    f_over_p_w = ALBEDO / np.pi * RADIANCE * cos / (w * p_l + (1 - w) * p_b)
    light, brdf = ((t * p * f_over_p_w * solid_angle).sum() for t, p in ((w, p_l), (1 - w, p_b)))
    second = ((w**2 * p_l + (1 - w) ** 2 * p_b) * f_over_p_w**2 * solid_angle).sum()
    return light + brdf, second - light**2 - brdf**2


@pytest.mark.parametrize("w", WEIGHTS)
@pytest.mark.parametrize("pairs", [1, 3])
def test_mean_and_variance_below_a_disk(w: float, pairs: int) -> None:
    """A render has the mean and the variance of the closed forms; of several pairs, their mean."""
    rule, spp = f"fixed:{w},weigh=heuristic", 256
    result = dmis.render(disk(), rule, spp, seed=1, sampler="independent", shading_samples=2 * pairs)
    mean, variance = disk_moments(w)
    assert mean == pytest.approx(ALBEDO * RADIANCE * RADIUS**2 / (RADIUS**2 + HEIGHT**2))
    assert abs(result.image.mean(dtype=float) - mean) < Z_LIMIT * np.sqrt(variance / pairs / spp / 256)
    assert result.variance.mean() * spp == pytest.approx(variance / pairs, rel=0.03)


@pytest.mark.parametrize("integrator", ["direct", "path"])
def test_one_half_is_the_balance_heuristic(integrator: str) -> None:
    scene = shared_scene("killeroo-gold", (40, 30))
    options = {"seed": 2, "sampler": "independent", "integrator": integrator}
    tilted, balance = (dmis.render(scene, rule, 8, **options) for rule in ("fixed:0.5,weigh=heuristic", "balance"))
    np.testing.assert_array_equal(tilted.image, balance.image)
    assert tilted.rays == balance.rays
    shares = shares_of(0.25)[:, None]  # a tilt of uneven shares that equals these changes nothing, either
    rounds = (Round(8, shares, dmis.Settings(integrator=integrator), tilt=tilt) for tilt in (shares, None))
    np.testing.assert_array_equal(*(render_tile(scene, image_tile(scene, 2, round_)).mean for round_ in rounds))


def test_what_counts_nothing_is_not_traced() -> None:
    """At w = 0 and 1 the other technique traces no ray; w is in the result, and so are the numbers of samples."""
    scene = shared_scene("killeroo-gold", (40, 30))
    half = dmis.render(scene, "balance", 4, integrator="direct").rays
    for w, kind, other in ((0, "brdf", "shadow"), (1, "shadow", "brdf")):
        result = dmis.render(scene, f"fixed:{w},weigh=heuristic", 4, integrator="direct")
        assert other not in result.rays and result.rays[kind] == half[kind]
        assert (result.weight == w).all()
        assert (result.light_samples == 4).all() and (result.brdf_samples == 4).all()
    weight = np.zeros((30, 40))
    weight[:, 20:] = 1
    rays = dmis.render(scene, dmis.Given(weight, weigh="heuristic"), 4, integrator="direct").rays
    assert 0 < rays["shadow"] < half["shadow"] and 0 < rays["brdf"] < half["brdf"]


def test_pilots_and_final_pass_are_tilted() -> None:
    """All rounds of `thesis` have equal shares, and its weights as their tilt."""
    scene = shared_scene("tt", (40, 22))
    rule = dmis.make_rule("thesis:weigh=heuristic")
    budget = Budget(16, (22, 40), dmis.Settings(), weigh=rule.weigh)
    rounds = [budget.pilot(weight, 2) for weight in rule.pilot]
    assert [tuple(round_.tilt) for round_ in rounds] == [(0, 1), (0.5, 0.5), (1, 0)]
    assert all((round_.shares == 0.5).all() for round_ in rounds)
    result = dmis.render(scene, rule, 16, seed=1)
    assert np.ptp(result.weight) > 0.1 and (result.light_samples == 16).all()


def test_curves_of_a_disk() -> None:
    """From samples of the balance heuristic, the curves have the closed form at every w, also of several pairs."""
    for pairs in (1, 3):
        settings = dmis.Settings(sampler="independent", shading_samples=2 * pairs)
        round_ = Round(512, shares_of(0.5)[:, None], settings, TiltCurves)
        curve = render_tile(disk(), image_tile(disk(), 1, round_)).sums["curve"].sum(axis=(1, 2)) / 256
        expected = [disk_moments(float(w))[1] / pairs for w in GRID]
        np.testing.assert_allclose(curve, expected, rtol=0.03)


@pytest.mark.parametrize("integrator", ["direct", "path"])
def test_curves_predict_renders(integrator: str) -> None:
    """Where edges and a texture are inside of pixels, curves have the variance of tilted renders in every patch.

    The scene is grey, so that the variance of a channel is that of their mean.
    """
    checks = dmis.Image(np.random.default_rng(1).choice([0.1, 0.9], (32, 32, 1)).repeat(3, axis=2).astype(np.float32))
    ball = dmis.Part(sphere(0.7, segments=16), plastic(0.3, 0.3, 0.02))
    lamp = QuadLight((-1, -1, 2), (0, 2, 0), (2, 0, 0), (4, 4, 4))
    scene = box_scene(matte(checks), (lamp,), (ball,), resolution=(16, 12))
    options = {"integrator": integrator, "max_depth": 3, "sampler": "independent"}
    # along paths the tail of the weights at w = 1 is too heavy for samples at 1/2 in a patch of 16 pixels
    tilts = ("0.1", "0.9", "1" if integrator == "direct" else "0.97")
    statistic = partial(TiltCurves, grid=np.float32(tilts))
    round_ = Round(4096, shares_of(0.5)[:, None], dmis.Settings(**options), statistic)
    curve = render_tile(scene, image_tile(scene, 9, round_)).sums["curve"] / 16
    for predicted, w in zip(curve, tilts, strict=True):
        result = dmis.render(scene, f"fixed:{w},weigh=heuristic", 4096, seed=1, **options)
        measured = patch_mean(result.variance[..., 0] * 4096, 4)
        np.testing.assert_allclose(measured, predicted, rtol=0.2)
        assert measured.mean() == pytest.approx(predicted.mean(), rel=0.03)


@pytest.mark.parametrize(
    "name, integrator",
    [
        pytest.param(name, way, marks=() if (name, way) in QUICK else pytest.mark.slow)
        for name in SCENES
        for way in ("direct", "path")
    ],
)
def test_every_tilt_agrees_with_balance(name: str, integrator: str) -> None:
    """The image's mean is that of the balance heuristic at every w; w = 0 has more samples, for its rare hits."""
    options = {"integrator": integrator, "max_depth": 3, "sampler": "independent"}
    rules = {"balance": 128} | {f"fixed:{w},weigh=heuristic": 128 if w else 1024 for w in WEIGHTS}
    balance, *others = (
        dmis.render(shared_scene(name, SCENES[name]), rule, spp, seed=seed, **options)
        for seed, (rule, spp) in enumerate(rules.items())
    )
    scores = {w: results_z(result, balance) for w, result in zip(WEIGHTS, others, strict=True)}
    assert max(map(abs, scores.values())) < Z_LIMIT, scores
