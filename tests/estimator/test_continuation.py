"""BRDF samples of direct lighting continue paths: the same image in the mean as with rays of their own, fewer rays."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from helpers import Z_LIMIT, images_z_score, shared_scene, z_score

import dmis
from dmis.base.vectors import Array
from dmis.brdf.materials import Material, matte, mirror, plastic
from dmis.estimator.continuation import Onward
from dmis.geometry.shapes import quad, sphere
from dmis.samplers.keys import CONTINUE
from dmis.testing.scenes import box_scene

LAMP = dmis.QuadLight((-0.7, -0.7, 1.6), (0, 1.4, 0), (1.4, 0, 0), (4, 4, 4))
WALLS = (
    dmis.Part(quad((-4, 1, 0), (8, 0, 0), (0, 0, 4)), matte((0.8, 0.3, 0.2))),
    dmis.Part(quad((-1.5, -4, 0), (0, 8, 0), (0, 0, 4)), plastic((0.2, 0.7, 0.3), 0.4, 0.05)),
)
ROOM = box_scene(plastic(0.5, 0.3, 0.1), (LAMP,), WALLS, resolution=(24, 24))
SMALL = {"cornell": (24, 24), "killeroo-gold": (28, 21), "tt": (30, 16), "ten-lights": (20, 15)}


def image(scene: dmis.Scene, continuation: str, seed: int, rule: str = "balance", spp: int = 16, **options) -> Array:
    options = {"integrator": "path", "parallel": 1, **options}
    return dmis.render(scene, rule, spp, seed=seed, continuation=continuation, **options).image


def differences(scene: dmis.Scene, seeds: int, **options) -> Array:
    """Shared less own mean radiance by seed; camera samples are the same, so that what they add cancels."""
    ways = ([image(scene, way, seed, **options).mean() for seed in range(seeds)] for way in ("shared", "own"))
    return np.subtract(*map(np.array, ways))


def scene_of_everything() -> dmis.Scene:
    """A mirror under a rough coat, a ball of rough glass, and a sky, a lamp and a point of light."""
    sky = dmis.EnvironmentLight(np.random.default_rng(1).random((4, 8, 3)))
    coated = Material((*mirror(0.3).lobes, *plastic(0.4, 0.2, 0.1).lobes))
    ball = dmis.Part(sphere(0.5, segments=16), dmis.rough_glass(alpha=0.3))
    lights = (LAMP, sky, dmis.PointLight((0, 0, 1.5), (1, 1, 1)))
    return box_scene(coated, lights, (*WALLS, ball), resolution=(24, 24))


@pytest.mark.parametrize("depth", [2, None, *(pytest.param(d, marks=pytest.mark.slow) for d in (3, 5))])
@pytest.mark.parametrize("name", SMALL)
def test_shipped_scenes_agree(name: str, depth: int | None) -> None:
    found = differences(shared_scene(name, SMALL[name]), 8, max_depth=depth)
    assert abs(z_score(found, 0.0)) < Z_LIMIT


@pytest.mark.parametrize(
    ("rule", "options"),
    [
        ("balance", {"lights": "one", "max_depth": 4}),
        ("fixed:0.2", {"shading_samples": 5, "max_depth": 4}),
        ("fixed:0.3", {"max_depth": None, "sampler": "independent"}),
        ("fixed:0.8,weigh=heuristic", {"max_depth": 4}),
        ("fixed:0.5,allocation=random", {"max_depth": 4}),
        ("simplex:light=0.3,brdf=0.3,uniform=0.4", {"max_depth": 4}),
        ("auto", {"spp": 32, "max_depth": 4}),
    ],
)
def test_all_lobes_and_lights_agree(rule: str, options: dict) -> None:
    """Delta lobes, reflection and transmission on one surface; lights that have BRDF samples and one that has none."""
    found = differences(scene_of_everything(), 8, rule=rule, **options)
    assert abs(z_score(found, 0.0)) < Z_LIMIT


def test_many_lights_as_one_agree() -> None:
    """The one BRDF sample that may meet any of the lamps goes on."""
    found = differences(shared_scene("ten-lights", SMALL["ten-lights"]), 8, lights="tree", max_depth=4)
    assert abs(z_score(found, 0.0)) < Z_LIMIT


@pytest.mark.parametrize(("rule", "shading_samples"), [("fixed:1", 1), ("fixed:0.2", 5)])
def test_indirect_light_does_not_depend_on_the_pattern(rule: str, shading_samples: int) -> None:
    """1:0 and 1:4 have the indirect light of 1:1: a ray of its own, or one of four BRDF samples, goes on."""

    def indirect(seeds: range, rule: str, s: int) -> Array:
        deep, direct = (
            np.array([image(ROOM, "shared", seed, rule, max_depth=depth, shading_samples=s) for seed in seeds])
            for depth in (4, 1)
        )
        return deep - direct

    found, expected = indirect(range(6), rule, shading_samples), indirect(range(10, 16), "balance", 2)
    assert abs(images_z_score(found, expected)) < Z_LIMIT


def test_light_samples_alone_have_rays_of_their_own() -> None:
    """Without BRDF samples both ways are one, to the last bit; at a tilt of weight 0 their samples are not taken."""
    for rule in ("fixed:1", "fixed:1,weigh=heuristic"):
        a, b = (image(ROOM, way, 1, rule, shading_samples=2, max_depth=4) for way in ("shared", "own"))
        np.testing.assert_array_equal(a, b)


def test_one_ray_finds_the_light_and_goes_on() -> None:
    """Only the last surfaces, and paths that roulette ends, still have rays of BRDF samples."""
    room = replace(ROOM, lights=(*ROOM.lights, dmis.EnvironmentLight(np.ones((1, 1, 3)))))
    counts = []
    for way in ("shared", "own"):
        options = {"integrator": "path", "max_depth": 2, "continuation": way, "parallel": 1}
        counts.append(dmis.render(room, "fixed:0", 16, shading_samples=1, **options).rays)
    shared, own = counts
    assert shared["bounce 1"] == pytest.approx(own["bounce 1"], rel=0.02)
    assert own["brdf"] - shared["brdf"] > 0.9 * 16 * 24 * 24  # all that the camera sees sends one to the sky


def test_all_brdf_samples_continue_equally_often() -> None:
    """Where several can continue a path, each does as often; where none may, none does."""
    rng = np.random.default_rng(0)
    keys = []

    def draw(key: tuple[int, ...], index: None) -> Array:
        keys.append(key)
        return rng.random((2, 40_000), dtype=np.float32)

    batch = SimpleNamespace(sampler=SimpleNamespace(draw=draw))
    waiting = np.arange(40_000) % 8 > 0
    paths = Onward(batch, None, None, None, 1, "reflection", waiting)  # type: ignore[arg-type]
    assert (paths.sample_index(None, 1) == np.where(waiting, 0, -1)).all() and not keys
    count = np.repeat([4, 0], 20_000)
    index = paths.sample_index(None, count)
    assert keys == [(CONTINUE, CONTINUE)] and (index[~waiting] == -1).all()
    share = np.bincount(index[:20_000][waiting[:20_000]]) / waiting[:20_000].sum()
    np.testing.assert_allclose(share, 0.25, atol=Z_LIMIT * np.sqrt(0.25 * 0.75 / 17_500))
