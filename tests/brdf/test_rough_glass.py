"""Rough glass: what its facets let through, against densities, closed forms, its smooth limit, and in renders."""

from dataclasses import replace

import numpy as np
import pytest
from helpers import Z_LIMIT, image_tile, images_z_score, means, pixel_shares, z_score

import dmis
from dmis.base.vectors import Array
from dmis.brdf.materials import glass
from dmis.estimator.settings import Settings
from dmis.fit.round import Round
from dmis.geometry.shapes import sphere
from dmis.light.area import QuadLight
from dmis.light.environment import EnvironmentLight
from dmis.pipeline.tile import render_tile
from dmis.scene.groups import Part
from dmis.scene.scene import Scene
from dmis.testing.scenes import FLOOR, box_scene

# Scenes -------------------------------------------------------------------------------------------------------------

ABOVE = QuadLight((-0.7, -0.7, 1.6), (0, 1.4, 0), (1.4, 0, 0), (4, 4, 4))
BELOW = QuadLight((-0.7, -0.7, -1.6), (1.4, 0, 0), (0, 1.4, 0), (4, 2, 1))


@pytest.fixture(scope="module")
def balanced() -> tuple[Scene, Array]:
    """A pane between two lamps, and images by the balance heuristic."""
    scene = box_scene(dmis.rough_glass(alpha=0.2), (ABOVE, BELOW), resolution=(36, 36))
    return scene, np.array([dmis.render(scene, "balance", 16, seed=900 + k, parallel=1).image for k in range(2)])


@pytest.mark.parametrize(
    "rule",
    [
        "auto",
        "thesis:patch=4",
        "second-moment:combiner=optimal",
        "fixed:0.3,combiner=power",
        "fixed:light=0.3,brdf=0.4,uniform=0.3",
    ],
)
def test_rules_are_unbiased(rule: str, balanced: tuple[Scene, Array]) -> None:
    """Learned weights, counts and combiners with light from both sides of a surface."""
    scene, others = balanced
    combined = [dmis.render(scene, rule, 16, seed=k, parallel=1).image for k in range(2)]
    assert abs(images_z_score(combined, others)) < Z_LIMIT


def test_light_from_both_sides_adds_up() -> None:
    """What two lights send is the sum of what each sends alone, with all lights or with one picked."""
    make = [box_scene(dmis.rough_glass(alpha=0.3), lights, resolution=(8, 8)) for lights in ((ABOVE,), (BELOW,))]
    both = box_scene(dmis.rough_glass(alpha=0.3), (ABOVE, BELOW), resolution=(8, 8))
    apart = means(make[0], range(30), 16) + means(make[1], range(100, 130), 16)
    assert abs(z_score(means(both, range(200, 230), 16), apart)) < Z_LIMIT
    assert abs(z_score(means(both, range(300, 330), 16, lights="one"), apart)) < Z_LIMIT
    # the plan says what light comes through; other scenes have no such lobes
    assert not any(group.transmission for group in box_scene(glass()).plan.groups)
    scene = box_scene(dmis.rough_glass(alpha=0.3), (BELOW,), (Part(FLOOR, dmis.ggx(alpha=0.2)),))
    assert [len(group.transmission) for group in scene.plan.groups] == [1, 0]
    assert "RoughReflection + RoughTransmission" in scene.describe()


@pytest.mark.parametrize("roughness, least", [(0.02, 0.995), (0.3, 0.85)])
def test_a_ball_in_an_even_sky_is_the_sky(roughness: float, least: float) -> None:
    """The furnace: light that enters leaves again, however often it is mirrored inside; facets mask the rest."""
    ball = sphere(0.9, segments=48)
    sky = EnvironmentLight(np.ones((2, 4, 3), np.float32))
    camera = box_scene(glass(), eye=(0, -6, 0), resolution=(8, 8)).camera
    scene = Scene(camera, (Part(ball, dmis.rough_glass(alpha=roughness)),), (sky,))
    values = means(scene, range(12), 16, integrator="path", max_depth=100)
    assert least < values.mean() < 1 + 4 * values.std() / np.sqrt(len(values))


def test_smooth_glass_in_an_even_sky_has_no_noise() -> None:
    """Whichever way a path goes, its throughput is 1 where it leaves, and roulette never ends it."""
    camera = box_scene(glass(), eye=(0, -6, 0), resolution=(8, 8)).camera
    ball = replace(sphere(0.9, segments=48), normals=None)  # at edges, light refracted about others may not get in
    scene = Scene(camera, (Part(ball, glass()),), (EnvironmentLight(np.ones((2, 4, 3), np.float32)),))
    round_ = Round(64, pixel_shares(0.5), Settings(integrator="path", max_depth=None))
    rendered = render_tile(scene, image_tile(scene, 0, round_))
    np.testing.assert_allclose(rendered.mean, 1, atol=2e-4)
    np.testing.assert_allclose(rendered.root**2 / 63, 0, atol=1e-6)
