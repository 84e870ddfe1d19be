"""Feature buffers: what the camera sees, and the rules that ask for it."""

from dataclasses import replace
from typing import ClassVar

import numpy as np
import pytest

import dmis
from dmis.base.patches import PATCH
from dmis.base.vectors import Array
from dmis.brdf.lobe import Lobe
from dmis.filter import joint
from dmis.fit.pooling import pool
from dmis.fit.registry import make_rule
from dmis.geometry import shapes
from dmis.scene import feature_buffers
from dmis.scene.feature_buffers import FEATURE_SCALES, render_feature_buffers, render_pixel_features
from dmis.testing.scenes import box_scene

WALL = shapes.quad((0, -4, 0.5), (8, 0, 0), (0, 8, 0))
"""Half a unit above the right half of the floor."""


def seen(material: dmis.Material, resolution: tuple[int, int] = (16, 12), **options: object) -> dict[str, Array]:
    """A white floor, whose right half, seen from above, lies under something of `material`."""
    scene = box_scene(dmis.matte(0.9), (), (dmis.Part(WALL, material),), resolution, eye=(0, 1e-6, 9), **options)
    return render_feature_buffers(scene)[0]


def test_what_is_seen() -> None:
    """Normals, albedos and materials of two halves; one ray for each block of 2x2 pixels."""
    red = dmis.matte((0.5, 0.2, 0.1))
    scene = box_scene(dmis.matte(0.9), (), (dmis.Part(WALL, red),), (16, 12), eye=(0, 1e-6, 9), fov=20)
    found, rays = render_feature_buffers(scene)
    assert rays == 8 * 6
    assert found["normal"].shape == found["albedo"].shape == (3, 3, 4) and found["material"].shape == (2, 3, 4)
    np.testing.assert_allclose(
        found["normal"], np.array([0, 0, 1.0])[:, None, None].repeat(3, 1).repeat(4, 2), atol=1e-6
    )
    halves = {tuple(a) for a in found["albedo"].astype(float).reshape(3, -1).T.round(3)}
    assert halves == {(0.9, 0.9, 0.9), (0.5, 0.2, 0.1)}
    assert {tuple(a) for a in found["material"].reshape(2, -1).T} == {(1, 0), (0, 1)}


def test_material_alone() -> None:
    """Materials of the same colour, in the same group or not, are told apart; nothing is one of them."""
    for material in (dmis.matte(0.9), dmis.plastic(0.45, 0.45, 0.1)):
        assert len(seen(material, fov=20)["material"]) == 2
    beyond = seen(dmis.matte(0.9), fov=120)
    assert len(beyond["material"]) == 3
    nothing = beyond["albedo"].sum(axis=0) == 0
    assert nothing[0, 0] and (beyond["normal"][:, nothing] == 0).all()
    np.testing.assert_allclose(beyond["material"].sum(axis=0), 1)

    # Lobes need no attribute called reflectance: without it they count as black
    class Own(Lobe):
        """Neither a colour nor anything else."""

    assert not Own().albedo().any()


@pytest.mark.parametrize(
    "material, expected",
    [
        (dmis.matte(0.3, 20.0), 0.3),
        (dmis.plastic(0.3, 0.5, 0.1, eta=1.5), 0.3 + 0.5 * 0.04),
        (dmis.substrate(0.5, 0.2), 0.5 * 0.8 + 0.2),
        (dmis.mirror(0.7), 0.7),
        (dmis.glass(1.0, 0.8), 0.04 + 0.8),
        (dmis.shiny_metal(0.5, 0.25), 0.75),
        (dmis.matte(dmis.Image(np.full((2, 2, 1), 0.6))), 0.6),
        (dmis.matte(0.0), None),
    ],
)
def test_albedo(material: dmis.Material, expected: float | None) -> None:
    """Colours of the lobes, times Fresnel's reflectance at normal incidence; a black surface is nothing."""
    found = seen(material, fov=20)
    values = np.unique(found["albedo"].round(4))
    np.testing.assert_allclose(values, sorted([0.9, expected or 0.0]), atol=1e-4)


@pytest.mark.parametrize("resolution", [(1, 1), (5, 3), (17, 22)])
def test_any_size(resolution: tuple[int, int]) -> None:
    """One entry for each base patch, the last ones smaller."""
    found = seen(dmis.matte(0.2), resolution)
    shape = -(-resolution[1] // PATCH), -(-resolution[0] // PATCH)
    assert all(a.shape[1:] == shape for a in found.values())
    assert set(found) == set(FEATURE_SCALES)


@pytest.mark.parametrize("unit", [1.0, 2.0**30, 2.0**-40])
def test_pixels_by_hand(unit: float, monkeypatch: pytest.MonkeyPatch) -> None:
    """A floor at 0, a slope z = x over a part of it, and nothing around them, from 9 above, in units of any length.

    Each pixel has what is at its centre, so none has a mean over an edge.
    """
    monkeypatch.setattr(feature_buffers, "RAYS_PER_BATCH", 300)  # more than one batch
    floor = shapes.quad((-4 * unit, -4 * unit, 0), (8 * unit, 0, 0), (0, 8 * unit, 0))
    slope = shapes.quad((0, -4 * unit, 0), (0, 8 * unit, 0), (3 * unit, 0, 3 * unit))  # its winding looks down
    camera = dmis.Camera.look_at((0, 0, 9 * unit), (0, 0, 0), (0, 1, 0), fov=60, resolution=(32, 22))
    parts = (dmis.Part(floor, dmis.matte(0.6)), dmis.Part(slope, dmis.plastic((0.5, 0.2, 0.1), 0.5, 0.1, eta=1.5)))
    features, rays = render_pixel_features(dmis.Scene(camera, parts, (dmis.PointLight((0, 0, 9 * unit), (1, 1, 1)),)))
    row, column = np.mgrid[:22, :32]
    pixel = 2 * np.tan(np.radians(30)) / 22
    x, y = (column + 0.5 - 32 / 2) * pixel, (22 / 2 - row - 0.5) * pixel  # of rays along (x, y, -1)
    on_slope = (x > 0) & (9 * x / (1 + x) < 3) & (np.abs(9 * y / (1 + x)) < 4)
    nothing = ~on_slope & ((np.abs(9 * x) > 4) | (np.abs(9 * y) > 4))
    along = np.where(nothing, np.inf, np.where(on_slope, 9 / (1 + x), 9))
    assert rays == 22 * 32 and all(image.dtype == np.float32 for image in features.values())
    assert on_slope.any() and nothing.any() and (~on_slope & ~nothing).any()
    np.testing.assert_allclose(features["depth"][0], along * np.sqrt(1 + x**2 + y**2) * unit, rtol=2e-6)
    for name, of_floor, of_slope in (
        ("normal", (0, 0, 1), (-np.sqrt(0.5), 0, np.sqrt(0.5))),
        ("albedo", (0.6, 0.6, 0.6), (0.52, 0.22, 0.12)),
    ):
        of_floor, of_slope = (np.reshape(value, (3, 1, 1)) for value in (of_floor, of_slope))
        expected = np.where(nothing, 0, np.where(on_slope, of_slope, of_floor))
        np.testing.assert_allclose(features[name], expected, atol=1e-6)


def test_pool() -> None:
    """Patches of several base patches, and edges that are not crossed; pixels say what the means are worth."""
    material = np.zeros((2, 8, 8))
    material[0, :, :4] = material[1, :, 4:] = 1
    sums = {"a": 16 * np.where(material[0] > 0, 1.0, 3.0)[None], "b": 16 * np.ones((8, 8))}
    for patch, rows in ((4, 8), (8, 4)):
        means, pixels = pool(sums, (32, 32), patch, 1.0, 2, {"material": material})
        assert means["a"].shape == (1, rows, rows) and means["b"].shape == pixels.shape == (rows, rows)
        half = rows // 2
        np.testing.assert_allclose(means["a"][0, :, :half], 1, atol=0.05)
        np.testing.assert_allclose(means["a"][0, :, half:], 3, atol=0.05)
        np.testing.assert_allclose(means["b"], 1)
        assert (pixels > 2 * patch**2).all() and (pixels < 13 * patch**2).all()


@pytest.mark.parametrize("radius", [1, 2, 9])
def test_pool_some_rows_at_a_time(radius: int) -> None:
    """It is the filter of the whole image, to the bit."""
    rng = np.random.default_rng(1)
    sums = {"a": rng.random((2, 70, 9)), "b": rng.random((70, 9))}
    normal = rng.random((3, 70, 9)).astype(np.float32)
    means, pixels = pool(sums, (280, 36), 4, 1.0, radius, {"normal": normal})
    flat = np.concatenate([sums["a"], sums["b"][None], np.full((1, 70, 9), 16.0)])
    whole, worth = joint(flat, {"normal": normal}, FEATURE_SCALES, 1.0, radius)
    np.testing.assert_array_equal(means["a"], whole[:2] / whole[3])
    np.testing.assert_array_equal(means["b"], whole[2] / whole[3])
    np.testing.assert_array_equal(pixels, whole[3] * worth)


def test_joint_rules_render(box: dmis.Scene) -> None:
    """They bring feature buffers, count their rays, and do not depend on threads; others have none."""
    for rule in ("second-moment:filter=joint", "auto"):
        one, two = (dmis.render(box, rule, 16, seed=1, parallel=n) for n in (1, 2))
        np.testing.assert_array_equal(one.image, two.image)
        assert one.rays["guide"] == 16 * 12 and (one.weight != 0.5).any()
    plain = dmis.render(box, "second-moment:filter=gaussian", 16, seed=1)
    assert "guide" not in plain.rays
    assert plain.rays["camera"] == dmis.render(box, "second-moment:filter=joint", 16, seed=1).rays["camera"]
    assert (
        not make_rule("second-moment:filter=gaussian").needs_features
        and make_rule("second-moment:filter=joint").needs_features
    )


def test_a_rule_looks_at_pixels(box: dmis.Scene) -> None:
    """Its pilot has their features, one ray each; a black surface is nothing."""
    films = []

    class Looks(dmis.Rule):
        pilot: ClassVar = {0.5: 2}
        needs_features = "pixels"

        def fit(self, pilot):
            films.append(pilot[0.5])
            return dmis.Fit(0.5)

    black = replace(box, parts=(replace(box.parts[0], material=dmis.matte(0)), *box.parts[1:]))
    result = dmis.render(black, Looks(), 4, seed=1)
    assert result.rays["guide"] == 32 * 24
    shapes = {name: image.shape for name, image in films[0].features.items()}
    assert shapes == {"normal": (3, 24, 32), "albedo": (3, 24, 32), "depth": (1, 24, 32)}
    nothing = ~np.isfinite(films[0].features["depth"][0])
    assert nothing.any() and not nothing.all()
    np.testing.assert_array_equal(nothing, (films[0].features["albedo"] == 0).all(axis=0))
    np.testing.assert_allclose(np.linalg.norm(films[0].features["normal"], axis=0), ~nothing, atol=1e-6)
