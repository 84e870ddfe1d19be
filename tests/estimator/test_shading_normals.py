"""Shading normals that leave the triangle's: f is one function, whichever technique, light or lobe looks at it."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import trimesh
from helpers import Z_LIMIT, results_z, tile_of

import dmis
from dmis.base.vectors import dot
from dmis.brdf.lobe import LambertTransmission
from dmis.brdf.materials import Material
from dmis.brdf.specular import SpecularTransmission
from dmis.estimator.path import scatter
from dmis.light.delta import DistantLight
from dmis.testing.scenes import FLOOR, TURNED, UNIFORM_SKY, box_scene, surface

SKY = dmis.EnvironmentLight(0.2 + np.random.default_rng(1).random((8, 16, 3)) ** 2)
ROUGH = np.random.default_rng(2).random((16, 16, 1))
LAMP = dmis.QuadLight((-3, -1, 0.5), (0, 0, 1), (0, 2, 0), (9, 8, 7))
"""A lamp beside the floor, low above it: much of it is between the two horizons."""
TECHNIQUES = ("fixed:0", "fixed:0.5", "fixed:1", "uniform")


def ball(material: Material, level: int = 0) -> dmis.Part:
    """Return a sphere of 20, 80 or 320 triangles with vertex normals, half sunk into the floor."""
    sphere = trimesh.creation.icosphere(level)
    return dmis.Part(dmis.Mesh(sphere.vertices, sphere.faces, sphere.vertices), material)


def leaning(degrees: float) -> dmis.Mesh:
    """Return the floor with one shading normal that leans away from its own towards +x."""
    angle = np.radians(degrees)
    normal = np.array([np.sin(angle), 0.0, np.cos(angle)])
    return replace(FLOOR, normals=np.repeat(normal[None], len(FLOOR.vertices), axis=0))


def relief(material: Material, of: Any) -> Material:
    return replace(material, relief=of)


BUMPS = dmis.BumpMap(dmis.Image(ROUGH * 0.3))
DENTS = dmis.NormalMap(dmis.Image(0.5 + 0.5 * np.random.default_rng(3).uniform(-0.8, 0.8, (8, 8, 3))))
SCENES = {
    "bump map": box_scene(relief(dmis.matte(0.8), BUMPS), (SKY, LAMP)),
    "normal map": box_scene(relief(dmis.plastic(0.3, 0.5, 0.1), DENTS), (SKY, LAMP)),
    "coarse ball": box_scene(None, (UNIFORM_SKY,), (ball(dmis.matte(0.8)),), fov=20),
    "glossy coarse ball": box_scene(None, (SKY,), (ball(dmis.plastic(0.2, 0.6, 0.2), 1),), fov=20),
    "normals that lean": box_scene(dmis.matte(0.7, 20), (SKY, LAMP), floor=TURNED),
    "seen from below": box_scene(dmis.substrate(0.4, 0.4, 0.1, 0.2), (SKY,), eye=(0, -3, -1), floor=TURNED),
    "rough glass": box_scene(None, (SKY,), (ball(dmis.rough_glass(alpha=0.4)),), fov=20),
    "paper": box_scene(Material((LambertTransmission(0.6), *dmis.matte(0.3).lobes)), (SKY,), floor=TURNED),
    "smooth glass": box_scene(None, (SKY,), (ball(dmis.glass()),), fov=20),
    "mirror": box_scene(relief(dmis.mirror(0.9), DENTS), (SKY, LAMP), (ball(dmis.matte(0.5), 2),)),
}


@pytest.mark.parametrize("integrator", ["direct", "path"])
@pytest.mark.parametrize("name", SCENES)
def test_techniques_agree(name: str, integrator: str) -> None:
    """Every technique alone, and light and BRDF samples together, have one mean by z-tests."""
    settings = dmis.Settings(integrator=integrator, max_depth=4, sampler="independent")
    results = [dmis.render(SCENES[name], rule, 64, seed=k, settings=settings) for k, rule in enumerate(TECHNIQUES)]
    z = [results_z(result, results[1]) for result in results]
    assert np.abs(z).max() < Z_LIMIT, dict(zip(TECHNIQUES, z, strict=True))


@pytest.mark.parametrize("rule", ["fixed:0", "fixed:0.3", "fixed:1", "uniform"])
@pytest.mark.parametrize("degrees", [0, 20, 60])
def test_light_between_the_horizons_is_lost(degrees: float, rule: str) -> None:
    """Under an even sky a matte surface reflects ``albedo (1 + cos) / 2``: what comes from above both planes."""
    scene = box_scene(dmis.matte(0.8), (UNIFORM_SKY,), fov=1, floor=leaning(degrees))
    result = dmis.render(scene, rule, 256, seed=1, integrator="direct")
    expected = 0.4 * (1 + np.cos(np.radians(degrees)))
    error = np.sqrt(result.variance.mean(dtype=float) / result.image[..., 0].size)
    assert abs(result.image.mean(dtype=float) - expected) < Z_LIMIT * error + 1e-4


@pytest.mark.parametrize("low", [True, False])
@pytest.mark.parametrize("degrees", [0, 50])
def test_delta_lights_shine_above_both_planes_only(degrees: float, low: bool) -> None:
    """A distant light 20 degrees above the floor and below the horizon of the shading normal lights nothing."""
    elevation = np.radians(20 if low else 70)
    light = DistantLight((-np.cos(elevation), 0, np.sin(elevation)), (1.0, 1.0, 1.0))
    image = tile_of(box_scene(dmis.matte(0.8), (light,), fov=1, floor=leaning(degrees)))[0]
    cosine = np.sin(elevation - np.radians(degrees))
    np.testing.assert_allclose(image, 0.8 / np.pi * max(cosine, 0), rtol=1e-3)


@pytest.mark.parametrize("integrator", ["direct", "path"])
@pytest.mark.parametrize("degrees, expected", [(40, 0.9), (50, 0)])
def test_a_mirror_sends_nothing_into_its_surface(degrees: float, expected: float, integrator: str) -> None:
    """Seen from above, a normal that leans by more than 45 degrees mirrors rays into the floor, where they end."""
    scene = box_scene(dmis.mirror(0.9), (UNIFORM_SKY,), eye=(0, -0.1, 3), fov=1, floor=leaning(degrees))
    image = dmis.render(scene, "balance", 4, integrator=integrator).image
    np.testing.assert_allclose(image, expected, atol=1e-5)


@pytest.mark.parametrize("degrees", [0, 40, 90, 127, -50])
def test_delta_lobes_leave_on_their_side(degrees: float) -> None:
    """Factors are 0 unless wi is on the side of the triangle on which the lobe sends light."""
    angle = np.radians(degrees)
    for material in (dmis.mirror(0.9), dmis.Material((SpecularTransmission(1.0),))):
        points = surface(material, (0, 0.97, np.sqrt(1 - 0.97**2)))  # a low viewer, towards whom or away n leans
        n = np.array([[0], [np.sin(angle)], [np.cos(angle)]], np.float32)
        points.n = n * np.copysign(np.float32(1), dot(n, points.wo))
        points.cos_o = dot(points.n, points.wo)
        _, wi, factor = scatter(points, lobe := points.delta[0])
        assert (factor > 0).all() == ((wi[2, 0] < 0) == lobe.transmissive)
