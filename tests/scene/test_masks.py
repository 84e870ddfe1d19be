"""Masks: holes against meshes without the triangles there, partial transparency, and what is refused."""

from dataclasses import replace

import numpy as np
import pytest
from helpers import Z_LIMIT, pickled

import dmis
from dmis.base.vectors import normalise
from dmis.geometry.mesh import Mesh, concatenate
from dmis.geometry.shapes import quad
from dmis.intersect import Intersector
from dmis.scene.feature_buffers import render_feature_buffers
from dmis.scene.groups import Part
from dmis.scene.masks import Mask, MaskedCaster
from dmis.testing.scenes import ABOVE, box_scene

BOARD = dmis.Image(np.array([[[1.0], [0.0]], [[0.0], [1.0]]]), scale=(2, 2), nearest=True)
"""Four by four squares, of which every other one is there."""
CUT = quad((-1, -1, 1), (2, 0, 0), (0, 2, 0))
SQUARES = concatenate(
    [
        quad((-1 + i / 2, -1 + j / 2, 1), (0.5, 0, 0), (0, 0.5, 0))
        for i in range(4)
        for j in range(4)
        if (i + j) % 2 == 0
    ]
)


def board(masked=True, material=None, **changes):
    """A board of squares between the floor and the lamp: a masked square, or the squares themselves."""
    material = material or dmis.matte(0.5)
    part = Part(CUT, material, mask=Mask(BOARD)) if masked else Part(SQUARES, material)
    return box_scene(extra=(part,), eye=(1.5, -2.5, 2.2), **changes)


def rays(count=4000):
    rng = np.random.default_rng(1)
    origin = rng.uniform(-1.5, 1.5, (3, count)) + [[0], [0], [1]]
    return origin.astype(np.float32), normalise(rng.normal(size=(3, count))).astype(np.float32)


def test_rays_pass_holes_as_if_there_were_no_triangles():
    origin, direction = rays()
    distance = np.random.default_rng(2).uniform(0, 2, len(origin[0])).astype(np.float32)
    cut, squares = (board(masked).intersector for masked in (True, False))
    assert isinstance(cut, MaskedCaster) and isinstance(squares, Intersector)
    a, b = cut.closest(origin, direction), squares.closest(origin, direction)
    assert (~np.isclose(a.distance, b.distance, rtol=1e-4, atol=1e-5)).sum() <= 2  # rays along edges
    blocked = [caster.occluded(origin, direction, distance) for caster in (cut, squares)]
    assert 0.1 < blocked[0].mean() < 0.9 and (blocked[0] != blocked[1]).sum() <= 2
    # a ray passes hundreds of sheets and meets what is behind them, at its distance from the ray's origin
    sheets = concatenate([*(quad((-1, -1, k / 100), (2, 0, 0), (0, 2, 0)) for k in range(300))])
    wall = quad((-1, -1, 4), (2, 0, 0), (0, 2, 0))
    nothing = Mask(dmis.Image(np.zeros((1, 1, 1))))
    scene = box_scene(extra=(Part(sheets, dmis.matte(), mask=nothing), Part(wall, dmis.matte())))
    origin, up = np.array([[0.1], [0.2], [-1.0]], np.float32), np.array([[0.0], [0], [1]], np.float32)
    hits = scene.intersector.closest(origin + 1.5 * up, up)
    np.testing.assert_allclose(hits.distance, 3.5, rtol=1e-5)
    assert not scene.intersector.occluded(origin + 1.5 * up, up, np.array([3.4], np.float32))[0]
    # half of the rays along a sheet of opacity 1/2 pass: a ray begun again that meets it again is not drawn again
    origin, direction, square = slanted_rays(0.05)
    sheet = Part(square(0), dmis.matte(), mask=Mask(dmis.Image(np.full((1, 1, 1), 0.5)), None))
    scene = dmis.Scene(box_scene().camera, (sheet,), (dmis.EnvironmentLight(1),))
    hits = scene.intersector.closest(origin, direction)
    assert abs((hits.prim < 0).mean() - 0.5) < Z_LIMIT * np.sqrt(0.25 / len(hits.prim))


def slanted_rays(slope, count=20_000):
    """Return rays of this slope towards points of a slanted square, and a function: the square, so far above."""
    rng = np.random.default_rng(0)
    x, y = rng.uniform(-0.9, 0.9, (2, count))
    normal = normalise(np.array([[-0.05], [-0.25], [1]]))
    across = rng.normal(size=(3, count))
    direction = normalise(normalise(across - normal * (normal * across).sum(axis=0)) - slope * normal)
    origin = np.stack([x, y, 1 + 0.05 * x + 0.25 * y]) - direction * rng.uniform(0.5, 2, count)
    return (
        *(a.astype(np.float32) for a in (origin, direction)),
        lambda z: quad((-1, -1, 0.7 + z), (2, 0, 0.1), (0, 2, 0.5)),
    )


HOLE, WHOLE = (Mask(dmis.Image(np.full((1, 1, 1), value))) for value in (0.0, 1.0))


@pytest.mark.parametrize("slope", [1, 0.05])
@pytest.mark.parametrize(("gap", "mask"), [(0, None), (1e-7, None), (1e-6, None), (1e-6, WHOLE)])
def test_surface_close_behind_a_hole_is_met(gap, mask, slope):
    """However close it is; behind a mask, too, if floats tell the two apart."""
    origin, direction, square = slanted_rays(slope)
    parts = Part(square(gap), dmis.matte(), mask=HOLE), Part(square(0), dmis.matte(), mask=mask)
    scene = box_scene(extra=parts)
    last = sum(len(part.mesh.faces) for part in scene.parts) - 2
    hits = scene.intersector.closest(origin, direction)
    assert (hits.prim >= last).all() and (hits.distance < 2.001).all()
    assert scene.intersector.occluded(origin, direction, hits.distance * np.float32(1.01)).all()
    assert not scene.intersector.occluded(origin, direction, hits.distance * np.float32(0.99)).any()


def z_of(a, b):
    """Normal deviates of 4x4 blocks of the difference of two results."""

    def blocks(image):
        return image.mean(axis=2).reshape(4, image.shape[0] // 4, 4, -1).mean(axis=(1, 3))

    count = a.image.size / 3 / 16
    error = np.sqrt((blocks(a.variance) + blocks(b.variance)) / count)
    return (blocks(a.image) - blocks(b.image)) / np.maximum(error, 1e-9)


@pytest.mark.parametrize("rule", ["fixed:1", "fixed:0", "balance"])
@pytest.mark.parametrize("integrator", ["direct", "path"])
def test_renders_of_holes_and_of_squares_agree(rule, integrator):
    options = {"integrator": integrator, "max_depth": 3, "parallel": 1}
    a, b = (dmis.render(board(masked), rule, 64, seed=seed, **options) for seed, masked in enumerate((True, False)))
    assert np.abs(z_of(a, b)).max() < Z_LIMIT


def test_glass_and_features_have_holes():
    a, b = (board(masked, dmis.glass()) for masked in (True, False))
    results = [dmis.render(scene, "balance", 64, seed=k, parallel=1) for k, scene in enumerate((a, b))]
    assert np.abs(z_of(*results)).max() < Z_LIMIT
    left, right = (render_feature_buffers(scene)[0] for scene in (a, b))
    np.testing.assert_allclose(left["albedo"], right["albedo"], atol=1e-5)
    # scenes with masks are pickled and rescaled
    scene = board()
    images = [dmis.render(one, "balance", 4, parallel=1).image for one in (scene, pickled(scene))]
    assert np.array_equal(*images)
    large = [Mesh(part.mesh.vertices * 1e9, part.mesh.faces, None, part.mesh.uv) for part in scene.parts]
    far = tuple(replace(part, mesh=mesh) for part, mesh in zip(scene.parts, large, strict=True))
    camera = replace(scene.camera, to_world=np.diag([1e9, 1e9, 1e9, 1]) @ scene.camera.to_world)
    scaled = scene.changed(parts=far, camera=camera).in_float32[0]
    assert scaled.parts[1].mask is scene.parts[1].mask


def test_partial_transparency():
    """Of a sheet that is there with probability a above a black floor, a point lamp lights a share a; light through
    it is 1 - a; both for one constant direction of a distant light, too."""
    sheet = quad((-4, -4, 1), (8, 0, 0), (0, 8, 0))
    for light in (dmis.PointLight((0, 0, 3), (9, 9, 9)), dmis.DistantLight((0, 0, 1), (3, 3, 3))):

        def mean(reflects, floor, mask, light=light):
            parts = (Part(sheet, dmis.matte(reflects), mask=mask),)
            scene = replace(box_scene(dmis.matte(floor), (light,), eye=(0, -0.5, 2)), name="sheet")
            result = dmis.render(scene.changed(parts=scene.parts + parts), "balance", 400, parallel=1)
            return result.image.mean(), np.sqrt(result.variance.mean() / result.image.size * 3)

        half, there, gone = (Mask(dmis.Image(np.full((1, 1, 1), a)), None) for a in (0.3, 1.0, 0.0))
        for reflects, floor, share, whole in ((0.5, 0, 0.3, there), (0, 0.5, 0.7**2, gone)):
            (value, error), (full, _) = mean(reflects, floor, half), mean(reflects, floor, whole)
            assert abs(value - share * full) < Z_LIMIT * error + 1e-4 * full


def test_what_is_refused():
    with pytest.raises(ValueError, match="image of a mask must be a number or an image of one channel"):
        Mask(dmis.Image(np.random.default_rng(0).random((2, 2, 3))))
    with pytest.raises(ValueError, match="image of a mask must be from 0 to 1"):
        Mask(dmis.Image(np.full((2, 2, 1), 1.5)))
    with pytest.raises(ValueError, match="cutoff of a mask must be a number"):
        Mask(BOARD, 0)
    with pytest.raises(ValueError, match=r"image of a mask must be an Image; got 'leaf.png'"):
        Mask("leaf.png")
    with pytest.raises(ValueError, match="a part with a light must not have a mask"):
        Part(CUT, dmis.matte(), ABOVE, mask=Mask(BOARD))
