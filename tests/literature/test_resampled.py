"""Resampling: one sample out of M has the right mean, and a nearly constant factor where nothing is in between."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from helpers import LAMP, Z_LIMIT, images_z_score, lamp_images, results_z, z_score

import dmis
from dmis.base.vectors import dot
from dmis.brdf.lobe import Directions
from dmis.brdf.materials import plastic
from dmis.estimator.settings import Settings
from dmis.light.area import SphereLight
from dmis.testing.scenes import box_scene, surface
from dmis.testing.sphere import polar

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
