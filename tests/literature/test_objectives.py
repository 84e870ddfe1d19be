"""Objectives of the literature, by planted 1-D problems whose answers are known by quadrature; resampling."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from helpers import LAMP, Z_LIMIT, images_z_score, lamp_images, results_z, z_score
from planted import pilot_of_curves
from scipy.optimize import brentq

import dmis
from dmis.base.vectors import Array, dot
from dmis.brdf.lobe import Directions
from dmis.brdf.materials import plastic
from dmis.estimator.records import Record
from dmis.estimator.settings import Settings
from dmis.fit.registry import about
from dmis.light.area import SphereLight
from dmis.testing.scenes import box_scene, surface
from dmis.testing.sphere import polar
from dmis.variance.curves import GRID

pytestmark = pytest.mark.usefixtures("literature")
NAMES = ("taylor", "inverse-variance", "neyman", "representativity", "kl", "tsallis")
N = 400_000
X = (np.arange(200_000) + 0.5) / 200_000
P_L, P_B = 2 * X, 2 * (1 - X)
Q = (P_L + P_B) / 2


def f(x: Array) -> Array:
    """Follows p_b more than p_l; its ratio to either is bounded, and all divergences have roots of their own."""
    return 6 * x * (1 - x) ** 2 * (1 + 3 * x**4)


def integral(g: Array) -> float:
    return float(np.mean(g))


def variance(g: Array, p: Array) -> float:
    """Of g(x) with x from p."""
    return integral(p * g**2) - integral(p * g) ** 2


def weight(rule: str, cost: tuple[float, float] = (1.0, 1.0)) -> float:
    """The share that follows from what the rule gathers from N camera samples, in one patch."""
    rng = np.random.default_rng(1)
    made = dmis.make_rule(rule)
    statistic = made.statistic(1, 2)
    records = []
    for side in (0, 1):
        x = np.sqrt(rng.random(N))
        x = x if side == 0 else 1 - x
        pdf = np.stack([2 * x, 2 * (1 - x)]).astype(np.float32)
        records.append(Record(side, (0,), 0, None, np.repeat(f(x)[None], 3, axis=0).astype(np.float32), pdf))
    statistic.add(records, np.zeros((3, N), np.float32), N)
    sums = statistic.sums()["values"]
    return float(made.solve(sums[..., None], cost)[0, 0])


def test_moments_of_taylor_and_representativity() -> None:
    """``1/2 - M2'(1/2) / M2''(1/2)``."""
    d = (P_L - P_B) / Q
    slope, bend = (integral(f(X) ** 2 / Q * d**k) for k in (1, 2))
    assert weight("taylor") == pytest.approx(0.5 + slope / (2 * bend), abs=5e-3)
    # ``E[f / p]^2 / E[(f / p)^2]`` of each
    light, brdf = (integral(f(X)) ** 2 / integral(f(X) ** 2 / p) for p in (P_L, P_B))
    assert weight("representativity") == pytest.approx(light / (light + brdf), abs=5e-3)
    # a technique that misses half of f: 1 / 2 against .5^2 / 1
    of_patch = np.array([[1.0, 0.5], [2.0, 1.0]])[..., None, None]
    assert dmis.make_rule("representativity").solve(of_patch, (1.0, 1.0)) == pytest.approx(0.5 / 0.75)


@pytest.mark.parametrize("cost", [(1.0, 1.0), (1.0, 4.0)])
def test_inverse_variance(cost: tuple[float, float]) -> None:
    """``w / (1 - w) = c_b v_b / (c_l v_l)``."""
    light, brdf = cost[1] * variance(f(X) / P_L, P_L), cost[0] * variance(f(X) / P_B, P_B)
    assert weight("inverse-variance", cost) == pytest.approx(brdf / (light + brdf), abs=5e-3)


@pytest.mark.parametrize("cost", [(1.0, 1.0), (1.0, 4.0)])
def test_neyman(cost: tuple[float, float]) -> None:
    """``w / (1 - w) = s_l sqrt(c_b) / (s_b sqrt(c_l))``."""
    light = np.sqrt(variance(f(X) / Q, P_L) / cost[1])
    brdf = np.sqrt(variance(f(X) / Q, P_B) / cost[0])
    assert weight("neyman", cost) == pytest.approx(light / (light + brdf), abs=5e-3)


@pytest.mark.parametrize(
    "rule, gamma", [("kl", 1.0), ("tsallis:gamma=1.5", 1.5), ("tsallis", 2.0), ("tsallis:gamma=3", 3.0)]
)
def test_divergences(rule: str, gamma: float) -> None:
    """The root of xi; for gamma = 2 the minimum of the second moment.

    Between the weights of the grid xi is interpolated, hence 0.01.
    """

    def expected(w: float) -> float:
        p_w = w * P_L + (1 - w) * P_B
        return integral(f(X) ** gamma * (P_L - P_B) / p_w**gamma)

    assert weight(rule) == pytest.approx(brentq(expected, 0.01, 0.99), abs=0.01)


@pytest.mark.parametrize("name", NAMES)
def test_nothing_seen(name: str) -> None:
    """Black patches stay at 1/2."""
    rule = dmis.make_rule(name)
    statistic = rule.statistic(4, 2)
    statistic.add([], np.zeros((3, 8), np.float32), 2)
    assert (rule.solve(statistic.sums()["values"], (1.0, 1.0)) == 0.5).all()
    if name in ("kl", "tsallis"):  # xi falls with w: no root above or below 0
        assert [rule.solve(sign * np.ones((11, 1, 1)), (1.0, 1.0)) for sign in (1, -1)] == [1, 0]


def test_costs_of_a_pilot_by_hand() -> None:
    """The pilot's light samples, 4 of 8, trace rays: 1 + 4 (.25 + .4 w) is 3.6 at w = 1 and 2 at w = 0."""
    film = pilot_of_curves(np.ones((len(GRID), 1, 1)), shape=(4, 5))[0.5]
    film = replace(film, rays={"camera": 100, "shadow": 400}, shading_samples=8)
    film = replace(film, sums={"values": np.array([[[16.0, 4.0]]] * 2)})
    np.testing.assert_allclose(dmis.make_rule("inverse-variance:filter=none").fit({0.5: film}).weight, 2 / (2 + 3.6))
    # the order of the divergence; each rule has a sentence
    with pytest.raises(ValueError, match="gamma must be positive and finite; got inf"):
        dmis.make_rule("tsallis:gamma=1e400")
    assert len({about(name) for name in NAMES}) == len(NAMES) and all("Choose shares" in about(n) for n in NAMES)


# The technique resampled ----------------------------------------------------------------------------------------------

pytestmark = pytest.mark.usefixtures("literature")
RULES = (
    "resampled:1",
    "resampled:0.5",
    "resampled:w=0.25,sampler=sobol",
    "fixed:light=0.3,resampled=0.7,sampler=stratified",
    "fixed:brdf=0.25,resampled=0.75,combiner=power",
)


@pytest.mark.parametrize("rule", RULES)
@pytest.mark.parametrize("roughness", [0.01, 0.1, 1.0])
def test_it_is_unbiased(rule: str, roughness: float) -> None:
    """Against light and BRDF samples with the balance heuristic."""
    assert abs(images_z_score(lamp_images(rule, 0, roughness), lamp_images("balance", 500, roughness))) < Z_LIMIT


@pytest.mark.parametrize("roughness", [0.1, 1.0])
def test_it_follows_the_product(literature: Any, roughness: float) -> None:
    """At one point, whose light nothing hides: the mean of light samples, and of their variance a quarter at most."""
    n = 40_000
    point = surface(plastic(0.3, 0.3, roughness), polar(40), n)
    u = np.random.default_rng(3).random((3, n), dtype=np.float32)
    values = []
    for light_sample in (LAMP.sample(point.p, u[:2]), literature.resampled.resampled(point, LAMP, u)):
        directions = Directions(point, light_sample.wi)
        f = (point.eval(directions) * light_sample.radiance_at(None)).mean(axis=0) * directions.cos_i
        values.append(np.where(light_sample.emits, f / np.maximum(light_sample.pdf, 1e-9), 0))
    light, one_of_many = values
    assert abs(z_score(one_of_many, light)) < Z_LIMIT
    assert one_of_many.var() < light.var() / 4


def test_rules_without_densities_are_refused() -> None:
    """Their stand-in would make wrong curves and wrong controls."""
    settings = Settings(techniques=("resampled", "brdf"))
    scene = box_scene(plastic(0.3, 0.3, 0.1), (LAMP,), resolution=(8, 8))
    message = "needs the pdf of every technique, but 'resampled' has none"
    with pytest.raises(ValueError, match=f"rule second-moment {message}"):
        dmis.render(scene, "second-moment", 16, settings=settings)
    with pytest.raises(ValueError, match=f"combiner optimal {message}"):
        Settings(techniques=("resampled", "brdf"), combiner="optimal")
    assert np.isfinite(dmis.render(scene, "thesis:patch=8", 16, settings=settings).image).all()


def test_resampling_takes_no_candidate_between_the_horizons(literature: Any) -> None:
    """It would reflect nothing: of the candidates in a lamp, some below the horizon, those chosen are above both."""
    points = surface(dmis.matte(0.5), (0, 0, 1), 4096)
    points.n = np.repeat(np.array([[np.sin(0.4)], [0], [np.cos(0.4)]], np.float32), 4096, axis=1)
    points.cos_o = dot(points.n, points.wo)
    lamp = dmis.QuadLight((-4, -1, 0.2), (0, 2, 0), (0, 0, 3), (1, 1, 1))
    u = np.random.default_rng(4).random((3, 4096), dtype=np.float32)
    assert 0.2 < points.same_side(lamp.sample(points.p, u[:2]).wi).mean() < 0.9
    chosen = literature.resampled.resampled(points, lamp, u)
    assert chosen.emits.any() and points.same_side(chosen.wi)[chosen.emits].all()


@pytest.mark.parametrize("material", ["bump map", "rough glass"])
def test_renders_with_shading_normals_and_two_sides(material: str) -> None:
    """Light that comes through a surface, and normals that leave the triangle's."""
    bumps = dmis.BumpMap(dmis.Image(np.random.default_rng(2).random((16, 16, 1)) * 0.3))
    of = replace(dmis.matte(0.8), relief=bumps) if material == "bump map" else dmis.rough_glass(alpha=0.4)
    scene = box_scene(of, (LAMP, SphereLight((0.3, 0.2, -2.0), 0.7, (3.0, 4.0, 5.0))))
    settings = Settings(sampler="independent")
    a, b = (dmis.render(scene, rule, 64, seed=1, settings=settings) for rule in ("resampled:1", "balance"))
    assert abs(results_z(a, b)) < Z_LIMIT
