"""Direct lighting: closed forms, agreement of all ways to estimate it, mirrors, emission, rays by kind."""

from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest
from helpers import Z_LIMIT, images_z_score, mean_and_error, tile_of

from dmis.base.vectors import Array
from dmis.brdf.materials import Material, glass, matte, metal, mirror, plastic, substrate
from dmis.geometry.shapes import quad, sphere
from dmis.light.area import DiskLight, QuadLight, SphereLight
from dmis.light.delta import PointLight
from dmis.light.environment import EnvironmentLight
from dmis.scene.groups import Part
from dmis.testing.scenes import box_scene

SHARES = (0.0, 0.25, 0.5, 1.0)
BLACK = Material(())


# Closed forms -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("albedo", [0.25, 1.0])
def test_furnace(albedo: float) -> None:
    """A white plane under a constant sky reflects albedo times its radiance, sample by sample with cosine sampling.

    Every term cancels, so that only float32 rounding is left.
    """
    scene = box_scene(matte(albedo), (EnvironmentLight(np.full((1, 1, 3), 3.0)),), resolution=(4, 4), fov=20)
    np.testing.assert_allclose(tile_of(scene, w=0.0)[0], 3 * albedo, rtol=1e-5)


@pytest.mark.parametrize("w", SHARES[1:])
@pytest.mark.parametrize("size", [(1, 1, 3), (16, 32, 3)])
def test_furnace_in_the_mean(w: float, size: tuple[int, int, int]) -> None:
    """With light samples in the mixture the same holds in the mean."""
    scene = box_scene(matte(0.5), (EnvironmentLight(np.full(size, 2.0)),), resolution=(40, 40), fov=20)
    mean, error = mean_and_error([tile_of(scene, seed, 8, w)[0] for seed in range(2)])
    assert abs(mean - 1) < Z_LIMIT * error


@pytest.mark.parametrize("w", SHARES)
def test_disk_above_a_plane(w: float) -> None:
    """Under a parallel disk: ``L_r = albedo L sin^2`` of its half angle."""
    light = DiskLight((0, 0, 2), (0, 0, -1), 1.5, (4, 4, 4))
    scene = box_scene(matte(0.5), (light,), resolution=(25, 25), fov=0.01)
    expected = 0.5 * 4 * 1.5**2 / (1.5**2 + 2**2)
    mean, error = mean_and_error([tile_of(scene, seed, 16, w)[0] for seed in range(2)])
    assert abs(mean - expected) < Z_LIMIT * error


def test_point_light_by_hand() -> None:
    """``L_r = albedo / pi * I cos / d^2``, without noise."""
    light = PointLight((0.0, 1.0, 2.0), (10.0, 20.0, 30.0))
    scene = box_scene(matte(0.5), (light,), resolution=(2, 2), fov=1e-3)
    expected = 0.5 / np.pi * np.array([10, 20, 30]) / 5 * (2 / np.sqrt(5))
    # the pixel is 4e-5 of the distance wide
    np.testing.assert_allclose(tile_of(scene)[0], np.broadcast_to(expected, (2, 2, 3)), rtol=1e-4)


# Agreement ----------------------------------------------------------------------------------------------------------

LAMP = QuadLight((-0.7, -0.7, 1.6), (0, 1.4, 0), (1.4, 0, 0), (4, 4, 4))
BALL = Part(
    sphere(0.35, segments=24).transformed([[1, 0, 0, 0.3], [0, 1, 0, 0.1], [0, 0, 1, 0.4], [0, 0, 0, 1]]), plastic()
)
SKY = np.random.default_rng(1).random((8, 16, 3)) ** 4
SCENES = {
    "quad on glossy": box_scene(
        plastic(0.3, 0.4, 0.02), (LAMP,), (Part(quad((-0.7, -0.7, 1.6), (0, 1.4, 0), (1.4, 0, 0)), BLACK, LAMP), BALL)
    ),
    "sphere on metal": box_scene(metal(roughness=0.01), (SphereLight((0.2, 1.2, 1.0), 0.3, (9, 9, 9)),), (BALL,)),
    "sky on substrate": box_scene(substrate(0.4, 0.4, 0.05, 0.2), (EnvironmentLight(SKY),), (BALL,)),
    "three lights": box_scene(
        matte(0.6, 20),
        (LAMP, DiskLight((-2, 0, 1), (1, 0, -0.5), 0.4, (10, 5, 2)), PointLight((1, -1, 2), (3, 3, 3))),
        (BALL,),
    ),
    "glass before the floor": box_scene(
        matte(0.5), (LAMP,), (Part(quad((-1, -1, 0.8), (2, 0, 0), (0, 0.6, 0)), glass()),)
    ),
}
EVERY_WAY = "quad on glossy", "sky on substrate", "three lights"
"""Scenes that are rendered in every way, the others with the shares of the balance heuristic."""
WAYS = {
    "w=0": {"w": 0.0},
    "w=1/4": {"w": 0.25},
    "w=1": {"w": 1.0},
    "w=0.9, three samples": {"w": 0.9, "shading_samples": 3},
    "one-sample": {"allocation": "random", "shading_samples": 1},
    "random 1/4": {"w": 0.25, "allocation": "random"},
    "power": {"combiner": "power"},
    "power 1/4": {"combiner": "power", "w": 0.25},
    "maximum": {"combiner": "maximum"},
    "cutoff": {"combiner": "cutoff-0.3"},
    "one light": {"lights": "one"},
    "stratified": {"sampler": "stratified", "w": 0.25},
    "sobol": {"sampler": "sobol", "w": 0.25},
    "sobol 1/2": {"sampler": "sobol"},
    "low discrepancy, three samples": {"sampler": "lowdiscrepancy", "shading_samples": 3},
    "uniform and brdf": {"techniques": ("uniform", "brdf")},
    "light and uniform": {"techniques": ("light", "uniform")},
}


def images(name: str, seeds: range, **options: Any) -> list[Array]:
    """Images of a scene, four times as large, so that few seeds are many pixels."""
    scene = SCENES[name]
    large = replace(scene, camera=replace(scene.camera, resolution=(32, 32)))
    return [tile_of(large, seed, 8, **options)[0] for seed in seeds]


@cache
def balanced(name: str) -> list[Array]:
    """Images of w = 1/2 and the balance heuristic, more than are compared with them."""
    return images(name, range(1000, 1030))


@pytest.mark.parametrize(
    "name, way", [(name, way) for name in SCENES for way in WAYS if name in EVERY_WAY or way.startswith("w=")]
)
def test_all_ways_agree(name: str, way: str) -> None:
    """Every mixture, heuristic, allocation, sampler and technique has the same mean, by a z-test."""
    assert abs(images_z_score(images(name, range(8), **WAYS[way]), balanced(name))) < Z_LIMIT


# Mirrors and emission -----------------------------------------------------------------------------------------------


def lamp_part(light: QuadLight, material: Material = BLACK) -> Part:
    return Part(quad(light.corner, light.edge_u, light.edge_v), material, light)


@pytest.mark.parametrize(("integrator", "kind"), [("direct", "specular"), ("path", "bounce 1")])
def test_mirror_shows_the_emitter(integrator: str, kind: str) -> None:
    """A mirror shows the lamp's radiance times the reflectance, and 0 beside it: exactly, for deltas have no noise."""
    lamp = QuadLight((-1, 2, 1), (2, 0, 0), (0, 0, 2), (3, 2, 1))  # a wall behind the mirror, facing -y
    scene = box_scene(mirror((0.5, 0.25, 1.0)), (lamp,), (lamp_part(lamp),), eye=(0, -2, 2), fov=1.0)
    image, rays = tile_of(scene, spp=4, integrator=integrator)
    np.testing.assert_allclose(image, np.broadcast_to([1.5, 0.5, 1.0], image.shape), rtol=1e-6)
    assert rays == {"camera": 16 * 16 * 4, kind: 16 * 16 * 4}
    beside = box_scene(mirror(), (lamp,), (lamp_part(lamp),), eye=(3, -2, 2), target=(3, 0, 0), fov=1.0)
    assert not tile_of(beside, spp=4, integrator=integrator)[0].any()


def test_depth_of_mirrors_and_glass() -> None:
    """A pane of two surfaces before a constant sky: 1 + 2 + ... reflections up to the depth, at most the sky itself."""
    sky = EnvironmentLight(np.ones((1, 1, 3)))
    x, y = (80, 0, 0), (0, 80, 0)
    pane = tuple(Part(quad((-40, -40, z), *sides), glass()) for z, sides in ((1, (x, y)), (0.5, (y, x))))
    scene = replace(box_scene(matte(0), (sky,)), parts=pane)
    image, _ = tile_of(scene, spp=2, max_depth=8)
    assert image.max() <= 1 + 1e-5
    # F = 5 % at 34 degrees: what is still inside after 8 surfaces is less than F^3
    assert image.min() > 0.999
    # with one surface allowed the mirror is black; with two it shows what it faces, not what that reflects
    lamp = QuadLight((-1, 2, 1), (2, 0, 0), (0, 0, 2), (3, 2, 1))
    scene = box_scene(mirror(), (lamp,), (lamp_part(lamp),), eye=(0, -2, 2), fov=1.0)
    assert not tile_of(scene, max_depth=1)[0].any()
    assert tile_of(scene, max_depth=2)[0].all()


@pytest.mark.parametrize(
    "lamp, parts",
    [
        (QuadLight((-1, -1, 1), (2, 0, 0), (0, 2, 0), (5, 5, 5)), ()),  # facing up
        (LAMP, (Part(quad((-4, -4, 1.0), (8, 0, 0), (0, 8, 0)), BLACK),)),
    ],
    ids=["dark side", "occluder"],
)
def test_nothing_arrives(lamp: QuadLight, parts: tuple[Part, ...]) -> None:
    """A floor on a lamp's dark side, or below a black sheet, stays black, whichever technique looks for the lamp."""
    scene = box_scene(matte(0.5), (lamp,), parts, eye=(0, -3, 0.5))
    for w in SHARES:
        assert not tile_of(scene, w=w)[0].any()


def test_headlight_needs_no_shadow_rays() -> None:
    """A point light at the pinhole lights what it lights a little beside it, without the shadow rays."""
    eye = (0.0, -3.0, 2.0)
    images = []
    for x, traced in ((0.0, False), (1e-4, True)):
        light = PointLight((eye[0] + x, *eye[1:]), (10, 10, 10))
        image, rays = tile_of(box_scene(matte(0.5), (light,), (BALL,), eye=eye))
        images.append(image)
        assert (rays["delta"] > 0) == traced and not rays["shadow"]
        path = tile_of(box_scene(matte(0.5), (light,), (BALL,), eye=eye), integrator="path", max_depth=2)[1]
        assert path["delta"] > 0  # at the second surface
    # at the ball's silhouette, moved by 1e-4, some samples of a pixel fall into shadow
    close = np.isclose(*images, rtol=1e-3).all(axis=2)
    assert close.mean() > 0.95
    assert np.mean(images[0]) == pytest.approx(np.mean(images[1]), rel=2e-3)


@pytest.mark.parametrize("height, least, most", [(0.4, 1, 1), (0.55, 0.6, 0.95), (0.72, 0.05, 0.4), (0.8, 0, 0)])
@pytest.mark.parametrize("material", [matte(0.5), plastic(0.3, 0.4, 0.02), substrate(0.2, 0.3, 0.1, 0.1)])
def test_shadow_of_a_point_light_is_sharp(material: Material, height: float, least: float, most: float) -> None:
    """Behind a wall that hides the light from none, few, most or all of the floor, each camera sample has the light
    that it has without the wall, or nothing.
    """
    light = PointLight((3.0, 0.0, 1.0), (10, 10, 10))
    wall = Part(quad((2, -9, 0), (0, 18, 0), (0, 0, height)), BLACK)
    options = {"resolution": (32, 4), "fov": 6, "eye": (0.0, -0.5, 3.0)}
    free, blocked = (tile_of(box_scene(material, (light,), parts, **options), spp=1)[0] for parts in ((), (wall,)))
    assert (free > 0).all()
    lit = blocked[..., 0] > 0
    np.testing.assert_allclose(blocked[lit], free[lit], rtol=1e-4)  # offsets of rays grow with the scene
    assert not blocked[~lit].any() and least <= lit.mean() <= most


# Rays ---------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("w, shadow, brdf", [(1.0, 2, 0), (0.5, 1, 1), (0.0, 0, 2), (0.25, 0.5, 1.5)])
def test_rays_by_kind(w: float, shadow: float, brdf: float) -> None:
    """Under a sky all over the hemisphere each shading sample is one ray, but for what points below the floor.

    The floor is all that the camera sees, so camera rays are its samples; the division is ``2 w : 2 (1 - w)``.
    """
    scene = box_scene(matte(0.5), (EnvironmentLight(np.ones((1, 1, 3))),), fov=20)
    n = 16 * 16 * 64
    rays = tile_of(scene, spp=64, w=w)[1]
    assert rays["camera"] == n and set(rays) <= {"camera", "shadow", "brdf"}
    assert rays["brdf"] == pytest.approx(brdf * n, rel=1e-3)
    # half of the light's samples come from below
    assert rays["shadow"] == pytest.approx(shadow * n / 2, rel=0.03)


def test_directions_that_miss_the_light_cost_no_ray() -> None:
    """BRDF samples towards nothing are not traced: a small lamp costs few rays."""
    scene = box_scene(matte(0.5), (DiskLight((0, 0, 5), (0, 0, -1), 0.1, (9, 9, 9)),), fov=20)
    rays = tile_of(scene, spp=64, w=0.0)[1]
    assert 0 < rays["brdf"] < 0.01 * rays["camera"]


@pytest.mark.parametrize("points", [1, 7, 300])
def test_points_shaded_apart_or_together(points: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """The image does not depend on how many points of a group are shaded at a time: Sobol numbers belong to samples.

    Seven at a time, some batches have one direction that meets a light, and it may be in the ball's shadow.
    """
    lights = QuadLight((-0.5, -0.5, 2), (0, 1, 0), (1, 0, 0), (5, 4, 3)), PointLight((1, -1, 2), (3, 3, 3))
    scene = box_scene(plastic((0.4, 0.3, 0.2), 0.3, 0.1), lights, (Part(sphere(0.5), matte(0.5)),))
    options: dict[str, Any] = {"spp": 4, "w": 0.3, "sampler": "sobol"}
    together = tile_of(scene, **options)[0]
    monkeypatch.setattr("dmis.estimator.trace.POINTS", points)
    np.testing.assert_allclose(tile_of(scene, **options)[0], together, rtol=1e-5)
