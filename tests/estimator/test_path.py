"""Path tracing: furnaces with closed forms, a sum over bounces by brute force, all rules, with and without roulette."""

from collections.abc import Mapping
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest
import scipy.stats
from helpers import LEVEL, Z_LIMIT, images_z_score, mean_and_error, z_score

import dmis
from dmis.base.vectors import Array
from dmis.brdf.materials import Material, glass, matte, mirror, plastic
from dmis.estimator import path
from dmis.estimator.settings import Settings
from dmis.fit.round import Fit
from dmis.fit.rule import Rule
from dmis.geometry.shapes import quad, sphere
from dmis.light.area import QuadLight
from dmis.light.delta import PointLight
from dmis.light.environment import EnvironmentLight
from dmis.light.mesh_light import MeshLight
from dmis.scene.camera import Camera
from dmis.scene.groups import Part
from dmis.scene.scene import Scene
from dmis.testing.scenes import box_scene, surface

LAMP = QuadLight((-0.7, -0.7, 1.6), (0, 1.4, 0), (1.4, 0, 0), (4, 4, 4))
WALLS = (
    Part(quad((-4, 1, 0), (8, 0, 0), (0, 0, 4)), matte((0.8, 0.3, 0.2))),
    Part(quad((-1.5, -4, 0), (0, 8, 0), (0, 0, 4)), matte((0.2, 0.7, 0.3))),
)
ROOM = box_scene(plastic(0.5, 0.3, 0.1), (LAMP,), WALLS, resolution=(44, 44))


def images(scene: Scene, rule: Rule | str, seeds: range, spp: int = 16, **settings: object) -> Array:
    chosen = Settings(integrator="path", **settings)
    return np.array([dmis.render(scene, rule, spp, seed=s, settings=chosen, parallel=1).image for s in seeds])


def means(scene: Scene, rule: Rule | str, seeds: range, spp: int = 16, **settings: object) -> Array:
    return images(scene, rule, seeds, spp, **settings).mean(axis=(1, 2, 3))


@cache
def balanced_room(max_depth: int | None) -> Array:
    """Images of the room with the balance heuristic, more than are compared with them."""
    return images(ROOM, "balance", range(100, 104), 32, max_depth=max_depth)


def furnace(albedo: float, extra: tuple[Part, ...] = ()) -> Scene:
    """Inside a white sphere in whose middle a small light without a surface shines equally everywhere."""
    ball = sphere(1.0, segments=64)
    inside = replace(ball, faces=ball.faces[:, ::-1].copy(), normals=None)  # shading normals would lose light
    camera = Camera.look_at((0, 0, 0), (1, 0, 0), fov=60, resolution=(20, 20))
    return Scene(camera, (Part(inside, matte(albedo)), *extra), (PointLight((0, 0, 0), (1.0, 1.0, 1.0)),))


@pytest.mark.parametrize("depth", [1, 2, 5, 40])
def test_furnace(depth: int) -> None:
    """Each bounce sends ``albedo`` of the radiance on: the sum of a geometric series, at every depth.

    Roulette is noise here: the throughput is 0.99 to some power.
    """
    one = means(furnace(0.99), "balance", range(2), max_depth=1).mean()
    found, error = mean_and_error(images(furnace(0.99), "balance", range(2), 32, max_depth=depth))
    expected = one * (1 - 0.99**depth) / 0.01
    # a sphere of flat triangles is not quite even inside: each bounce is right to 1e-3 of itself
    assert abs(found / expected - 1) < 2e-3 + Z_LIMIT * error / expected


def test_depth_one_is_direct_lighting() -> None:
    """To the last bit where no number is drawn for what comes after."""
    path, direct = (
        dmis.render(ROOM, "balance", 8, seed=1, settings=Settings(integrator=integrator, max_depth=1)).image
        for integrator in ("path", "direct")
    )
    np.testing.assert_array_equal(path, direct)
    # rays of each bounce are counted
    rays = dmis.render(ROOM, "balance", 4, settings=Settings(integrator="path", max_depth=3)).rays
    assert set(rays) == {"camera", "bounce 1", "bounce 2", "shadow", "brdf"}
    assert rays["camera"] >= rays["bounce 1"] > rays["bounce 2"] > 0
    # Mirrors that face each other would never end
    with pytest.raises(ValueError, match="max_depth must be a number with integrator direct"):
        Settings(max_depth=None)


@pytest.mark.parametrize(
    "rule",
    [
        *("fixed:0.1", "pbrt", "thesis", "second-moment", "auto", "balance:sampler=lowdiscrepancy"),
        *(pytest.param(rule, marks=pytest.mark.slow) for rule in ("fixed:1", "one-sample")),
    ],
)
def test_rules_agree(rule: str) -> None:
    """A room of colours: the mean stays, whatever the weights, at any depth."""
    for depth in (3, None):
        found = images(ROOM, rule, range(2), 32, max_depth=depth)
        assert abs(images_z_score(found, balanced_room(depth))) < Z_LIMIT


@pytest.mark.parametrize(
    "rule", ["fixed:0", "fixed:1", "fixed:0.3", "balance", "pbrt", "one-sample", "thesis", "second-moment", "auto"]
)
def test_furnace_of_an_emitting_sphere(rule: str) -> None:
    """Inside a wall that emits 1 and reflects a, the radiance is 1 + a + ... + a^D: every sample meets the light."""
    ball = sphere(1.0, segments=16)
    inside = replace(ball, faces=ball.faces[:, ::-1].copy(), normals=None)
    light = MeshLight(inside.vertices, inside.faces, (1.0, 1.0, 1.0))
    camera = Camera.look_at((0.2, 0, 0), (1, 0.3, 0), fov=60, resolution=(20, 16))
    scene = Scene(camera, (Part(inside, matte(0.6), light),), (light,))
    for depth in (1, 2, 5, None):
        expected = (1 - 0.6 ** (np.inf if depth is None else depth + 1)) / 0.4
        found = images(scene, rule, range(1), 16, max_depth=depth).mean(axis=-1, dtype=float).reshape(-1)
        # all pixels have the same mean; a technique alone has no noise here at one bounce, but that of rounding
        limit = scipy.stats.t.isf(LEVEL / 2, len(found) - 1)
        assert abs(found.mean() - expected) < limit * found.std(ddof=1) / np.sqrt(len(found)) + 1e-5 * expected


def test_roulette_is_unbiased(monkeypatch: pytest.MonkeyPatch) -> None:
    found = []
    for first in (0, 10**9):
        monkeypatch.setattr(path, "ROULETTE", first)
        found.append(images(ROOM, "balance", range(3), max_depth=6))
    assert abs(images_z_score(*found)) < Z_LIMIT
    # a throughput of 2 stays as it is; of those of 1/4 a quarter goes on, with 1
    points, rng = surface(matte(0.5), (0, 0, 1), 4000), np.random.default_rng(1)
    u = rng.random((2, 4000), np.float32)
    for before, after, share in ((4.0, 2.0, 1.0), (0.5, 1.0, 0.25)):
        rays = path.bounce(points, None, np.full((3, 4000), before, np.float32), path.ROULETTE, u, rng)
        assert rays is not None
        np.testing.assert_allclose(rays.throughput, after, rtol=1e-6)
        assert abs(rays.origin.shape[1] / 4000 - share) < Z_LIMIT * np.sqrt(share * (1 - share) / 4000) + 1e-9


@pytest.mark.parametrize("material", [mirror(0.8), glass(), Material((*mirror(0.4).lobes, *matte(0.4).lobes))])
def test_one_lobe_of_many(material: Material) -> None:
    """Paths take one lobe at random, direct lighting all: with black walls around, the same image in the mean."""
    black = tuple(replace(part, material=matte(0.0)) for part in WALLS)
    floor = Part(quad((-1, -1, 0.3), (2, 0, 0), (0, 2, 0)), material)
    scene = box_scene(matte(0.0), (LAMP,), (*black, floor), resolution=(12, 12))
    settings = (Settings(integrator=kind, max_depth=4) for kind in ("path", "direct"))
    by_path, direct = (
        [dmis.render(scene, "balance", 32, seed=30 * k + s, settings=of, parallel=1).image.mean() for s in range(30)]
        for k, of in enumerate(settings)
    )
    if np.std(by_path) == np.std(direct) == 0:
        assert by_path == direct
    else:
        assert abs(z_score(by_path, direct)) < Z_LIMIT


@pytest.mark.parametrize(("reflected", "albedo"), [(0.95, 0.05), (1.0, 0.2)])
def test_probabilities_of_lobes_add_up_to_one(reflected: float, albedo: float) -> None:
    """A mirror has more than .9 of the power: under a white sky the radiance is the sum of what both lobes reflect."""
    floor = Material((*mirror(reflected).lobes, *matte(albedo).lobes))
    scene = box_scene(floor, (EnvironmentLight(np.ones((1, 1, 3))),), resolution=(24, 24), fov=20)
    found, error = mean_and_error(images(scene, "balance", range(2), 32, max_depth=4))
    assert abs(found - reflected - albedo) < Z_LIMIT * error and error < 0.005
    # at the last surface only what the mirror shows is left to be traced; the other lobe has a tenth of the power
    rays = dmis.render(scene, "balance", 32, integrator="path", max_depth=1, parallel=1).rays
    assert rays["bounce 1"] == pytest.approx(rays["camera"] * reflected / (reflected + 0.1), rel=0.01)


def test_lamp_that_is_met_does_not_count() -> None:
    """What a BRDF sample meets has been counted where it was drawn; the lamp reflects nothing."""
    lamp = QuadLight((-1, 2, 1), (2, 0, 0), (0, 0, 2), (3, 2, 1))
    shape = Part(quad(lamp.corner, lamp.edge_u, lamp.edge_v), Material(()), lamp)
    floor = box_scene(matte(0.5), (lamp,), (shape,))
    a, b = (means(floor, "balance", range(k, k + 40), max_depth=depth) for k, depth in ((0, 1), (100, 8)))
    assert abs(z_score(a, b)) < Z_LIMIT


class Checkered(dmis.Rule):
    """Every other pixel has nearly all light samples, the rest nearly none."""

    def fit(self, pilot: Mapping[float, Any]) -> Fit:
        height, width = ROOM.camera.resolution
        return Fit((0.1 + 0.8 * (np.indices((height, width)).sum(axis=0) % 2)).astype(np.float32))


def test_shares_stay_with_their_paths() -> None:
    """Where rays of several groups have become one batch, each still divides its shading samples as its pixel does."""
    found = images(ROOM, Checkered(), range(2), 32, max_depth=3)
    assert abs(images_z_score(found, balanced_room(3))) < Z_LIMIT
