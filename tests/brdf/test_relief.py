"""Bump and normal maps: normals of a height field in closed form, sides, frames, and renders of the surface itself."""

from dataclasses import replace

import numpy as np
import pytest

import dmis
from dmis.brdf.relief import BumpMap, NormalMap
from dmis.geometry.mesh import Mesh
from dmis.geometry.shapes import quad
from dmis.image import encode_png
from dmis.intersect import Hits
from dmis.scene.groups import Part
from dmis.testing.scenes import box_scene

SIDE = 96
MIDDLES = (np.arange(SIDE) + 0.5) / SIDE


def waves(uv):
    """Heights and their slopes along u and v."""
    u, v = 2 * np.pi * np.asarray(uv, float)
    return 0.01 * np.sin(u) * np.cos(2 * v), np.stack([np.cos(u) * np.cos(2 * v), -2 * np.sin(u) * np.sin(2 * v)]) * (
        0.01 * 2 * np.pi
    )


HEIGHTS = dmis.Image(waves(np.meshgrid(MIDDLES, MIDDLES))[0][..., None] + 0.5)


def normals_at(relief, uv, mesh=None, below=False):
    """Shading normals at texture coordinates of a unit square, seen from above or below."""
    mesh = mesh or quad((0, 0, 0), (1, 0, 0), (0, 1, 0))
    scene = box_scene(extra=(Part(mesh, replace(dmis.matte(), relief=relief)),))
    first = len(scene.parts[0].mesh.faces)
    lower = uv[0] >= uv[1]  # the triangle (0, 0), (1, 0), (1, 1), or the other one
    u, v = np.where(lower, [uv[0] - uv[1], uv[1]], [uv[0], uv[1] - uv[0]]).astype(np.float32)
    prim = (first + ~lower).astype(np.int32)
    direction = np.repeat(np.float32([[0.1], [0.2], [0.9 if below else -0.9]]), len(u), axis=1)
    direction /= np.linalg.norm(direction, axis=0)
    hits = Hits(prim, u, v, np.ones_like(u))
    group = next(group for group in scene.plan.groups if group.relief is not None)
    points, _ = scene.shading_points(group, hits, None, direction)
    np.testing.assert_allclose(np.linalg.norm(points.n, axis=0), 1, atol=1e-5)
    np.testing.assert_allclose(points.cos_o, (points.n * points.wo).sum(axis=0), atol=1e-6)
    return points.n


UV = np.random.default_rng(1).uniform(0.02, 0.98, (2, 400))


@pytest.mark.parametrize("below", [False, True])
def test_bumps_are_the_normals_of_the_height_field(below):
    """Of heights h over a plane the normal is (-dh/dx, -dh/dy, 1); from below it is the opposite one."""
    _, (slope_u, slope_v) = waves(UV)
    expected = np.stack([-slope_u, -slope_v, np.ones_like(slope_u)])
    expected /= np.linalg.norm(expected, axis=0) * (-1 if below else 1)
    np.testing.assert_allclose(normals_at(BumpMap(HEIGHTS), UV, below=below), expected, atol=2e-3)


def test_bumps_follow_the_scale_of_texture_coordinates():
    """A square twice as large has half the slope along each side; the texture's own scale multiplies it."""
    large = quad((0, 0, 0), (2, 0, 0), (0, 4, 0))
    _, (slope_u, slope_v) = waves(UV)
    n = normals_at(BumpMap(HEIGHTS), UV, large)
    np.testing.assert_allclose(n[:2] / n[2], [-slope_u / 2, -slope_v / 4], atol=2e-3)
    scale = np.array([[0.5], [4.0]])
    n = normals_at(BumpMap(replace(HEIGHTS, scale=tuple(scale[:, 0]))), UV)
    np.testing.assert_allclose(n[:2] / n[2], -waves(UV * scale)[1] * scale, atol=2e-3)


@pytest.mark.parametrize("unit, length", [(True, -1.0), (False, 3.0)])
def test_tangents_of_smooth_meshes_are_those_of_pbrt(unit, length):
    """v2 and v3 bring them to length 1 and turn them back, v4 has both as long as dp/du."""
    flat = quad((0, 0, 0), (3, 0, 0), (0, 5, 0))
    smooth = Mesh(flat.vertices, flat.faces, np.tile([0.0, 0, 1], (4, 1)), flat.uv)
    n = normals_at(BumpMap(HEIGHTS, unit), UV, smooth)
    np.testing.assert_allclose(n[:2] / n[2], -waves(UV)[1] / length, atol=2e-3)


@pytest.mark.parametrize("mirrored", [False, True])
def test_normal_maps_are_in_the_frame_of_the_texture(mirrored):
    """Red is along dp/du, green towards dp/dv, blue outwards, whatever the handedness of the coordinates."""
    flat = quad((0, 0, 0), (1, 0, 0), (0, 1, 0))
    mesh = Mesh(flat.vertices, flat.faces, None, flat.uv * [-1, 1] if mirrored else flat.uv)
    local = np.array([0.3, -0.2, np.sqrt(1 - 0.13)])
    image = dmis.Image((local + 1).reshape(1, 1, 3) / 2)
    expected = local * [-1, 1, 1] if mirrored else local
    np.testing.assert_allclose(normals_at(NormalMap(image), UV[:, :5], mesh).T, [expected] * 5, atol=1e-5)
    weak = expected * [0.5, 0.5, 1]
    n = normals_at(NormalMap(image, 0.5), UV[:, :5], mesh)
    np.testing.assert_allclose(n.T, [weak / np.linalg.norm(weak)] * 5, atol=1e-5)


def test_scenes_with_bump_maps():
    """Under an even sky a white bumped square reflects no more than 1, and little less."""
    sky = (dmis.EnvironmentLight(np.ones((4, 8, 3))),)
    square = Part(quad((-4, -4, 1), (8, 0, 0), (0, 8, 0)), replace(dmis.matte(1.0), relief=BumpMap(HEIGHTS)))
    scene = box_scene(lights=sky, extra=(square,))
    image = dmis.render(scene, "balance", 64, integrator="path", max_depth=4, parallel=1).image
    assert 0.97 < image.mean() < 1.005
    # extreme scenes with bump maps are refused
    large = Part(quad((0, 0, 0), (1e9, 0, 0), (0, 1e9, 0)), replace(dmis.matte(), relief=BumpMap(HEIGHTS)))
    scene = replace(box_scene(), parts=(large,), lights=(dmis.DistantLight((0, 0, 1), (1, 1, 1)),))
    with pytest.raises(ValueError, match="a scene with bump maps, whose heights are lengths, must have"):
        dmis.render(scene, "balance", 1, parallel=1)


def test_images_from_files_are_data(tmp_path):
    """Numbers of a file are not decoded from sRGB, its first row is the top; what is no image is refused by name."""
    pytest.importorskip("OpenImageIO")
    pixels = np.random.default_rng(3).integers(0, 256, (2, 3, 3)).astype(np.uint8)
    (tmp_path / "n.png").write_bytes(encode_png(pixels))
    for relief in (NormalMap(tmp_path / "n.png"), BumpMap(str(tmp_path / "n.png"))):
        np.testing.assert_allclose(relief.image.texels, pixels[::-1] / 255, atol=1e-6)
    with pytest.raises(ValueError, match=r"image of a bump map must be an Image, or the path of an image file; got 3"):
        BumpMap(3)
