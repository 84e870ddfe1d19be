"""Surface points: subsets, tangents, sampling of mixtures, and points made from hits."""

from dataclasses import replace

import numpy as np
import pytest

from dmis.base.vectors import dot, normalise
from dmis.brdf.distributions import Isotropic
from dmis.brdf.fresnel import Conductor, ExactConductor
from dmis.brdf.lobe import Directions, Lambert
from dmis.brdf.materials import Material, matte, substrate
from dmis.brdf.microfacet import GGX
from dmis.brdf.specular import SpecularReflection
from dmis.brdf.texture import Image
from dmis.geometry.mesh import Mesh
from dmis.geometry.shapes import quad, sphere
from dmis.light.area import QuadLight
from dmis.scene import shading_points as surfaces
from dmis.scene.camera import Camera
from dmis.scene.groups import Part
from dmis.scene.scene import Scene, SceneWarning
from dmis.scene.shading_points import ShadingPoints
from dmis.testing.scenes import box_scene, surface
from dmis.testing.sphere import polar, uniforms


def random_surface(count: int) -> ShadingPoints:
    rng = np.random.default_rng(8)
    n, wo, dpdu = (normalise(rng.normal(size=(3, count))).astype(np.float32) for _ in range(3))
    wo *= np.sign(dot(n, wo))
    kd = rng.random((3, count)).astype(np.float32)
    return ShadingPoints(
        p=rng.normal(size=(3, count)).astype(np.float32),
        ng=n,
        n=n,
        wo=wo,
        cos_o=dot(n, wo),
        outside=rng.random(count) < 0.5,
        dpdu=dpdu,
        reflection=(Lambert(kd), Lambert(np.float32(0.5))),
        delta=(),
    )


def test_take_of_take_is_take() -> None:
    """A subset of a subset has the attributes at the composed indices; constants stay."""
    whole, a, b = random_surface(50), np.array([4, 9, 30, 31, 2]), np.array([3, 0, 0])
    part = whole.take(a).take(b)
    for name in ("p", "n", "ng", "wo", "cos_o", "outside", "dpdu"):
        np.testing.assert_array_equal(getattr(part, name), getattr(whole, name).take(a.take(b), axis=-1))
    np.testing.assert_array_equal(part.reflection[0].reflectance, whole.reflection[0].reflectance[:, a[b]])
    assert part.reflection[1].reflectance == np.float32(0.5)
    assert part.ng is part.n, "flat surfaces keep one array for both normals"
    assert whole.take(None) is whole
    # a subset of no points can be sampled and evaluated
    part = random_surface(10).take(np.empty(0, np.intp))
    wi = part.sample(np.empty((2, 0), np.float32))
    assert wi.shape == (3, 0) and part.pdf(Directions(part, wi)).shape == (0,)


def test_tangents_are_orthonormal_with_s_along_dpdu() -> None:
    """``s`` is dp/du without its normal part, ``t = n x s``; a few float32 roundings."""
    points = random_surface(200)
    s, t = points.tangents
    for a, b, expected in ((s, s, 1), (t, t, 1), (s, t, 0), (s, points.n, 0), (t, points.n, 0)):
        # dp/du almost along n leaves a short remainder whose direction rounds at eps / its length
        np.testing.assert_allclose(dot(a, b), expected, atol=1e-5)
    np.testing.assert_allclose(np.cross(points.n, s, axis=0), t, atol=1e-6)
    assert (dot(s, points.dpdu) >= 0).all()


def test_each_lobe_gets_its_share_of_u0(monkeypatch: pytest.MonkeyPatch) -> None:
    """``u0`` picks the lobe by its first digit in base k and is stretched back to [0, 1): Lambert in both halves."""
    points, u = surface(Material((Lambert(0.1), Lambert(0.2))), polar(30), 1000), uniforms(1000)
    one = surface(Material((Lambert(0.1),)), polar(30), 1000)
    stretched = np.stack([(u[0] * 2) % 1, u[1]])
    np.testing.assert_allclose(points.sample(u), one.sample(stretched), atol=1e-6)
    # where one lobe picks directions, parameters of the others are left where they are
    points = random_surface(40)
    kd, gathered = points.reflection[0].reflectance, []
    gather = surfaces._gather
    monkeypatch.setattr(surfaces, "_gather", lambda value, index: gathered.append(value) or gather(value, index))
    points.sample(uniforms(40))
    assert sum(value is kd for value in gathered) == 1


# From hits ----------------------------------------------------------------------------------------------------------


def looking_down(*parts: Part, lights: tuple = ()) -> Scene:
    return Scene(Camera.look_at((0, 0, 5), (0, 0, 0), (0, 1, 0), resolution=(8, 8)), parts, lights)


def shoot(scene: Scene, origin: list[list[float]], direction: list[list[float]]) -> tuple:
    """The surface at the hits of rays, all of one group, and what it emits."""
    o, d = np.array(origin, np.float32).T.copy(), np.array(direction, np.float32).T.copy()
    d = normalise(d)
    hits = scene.intersector.closest(o, d)
    assert (hits.prim >= 0).all()
    group = scene.plan.groups[scene.plan.face_group[hits.prim[0]]]
    return scene.shading_points(group, hits, None, d)


def test_flat_surface_from_both_sides() -> None:
    """Normals turn to the viewer, positions are pushed off the surface to his side, `outside` tells the winding's."""
    scene = box_scene(matte(0.5))
    points, emission = shoot(scene, [[0.3, 0.2, 1], [0.3, 0.2, -1]], [[0.1, 0, -1], [0.1, 0, 1]])
    assert emission is None
    np.testing.assert_allclose(points.n[2], [1, -1])
    np.testing.assert_array_equal(points.outside, [True, False])
    np.testing.assert_allclose(points.p[2], [scene.epsilon, -scene.epsilon], rtol=1e-5)
    np.testing.assert_allclose(points.cos_o, dot(points.n, points.wo), atol=1e-6)
    np.testing.assert_allclose(points.p[:2], [[0.4, 0.4], [0.2, 0.2]], atol=1e-6)
    # a light's surface shines along its winding's normal only
    light = QuadLight((-1, -1, 1), (2, 0, 0), (0, 2, 0), (1, 2, 3))
    scene = looking_down(Part(quad((-1, -1, 1), (2, 0, 0), (0, 2, 0)), matte(0.2), light), lights=(light,))
    _, emission = shoot(scene, [[0.1, 0.2, 2], [0.1, 0.2, 0]], [[0, 0, -1], [0, 0, 1]])
    np.testing.assert_array_equal(emission, [[1, 0], [2, 0], [3, 0]])


def test_smooth_normals_are_unit_and_face_the_viewer() -> None:
    """Interpolated normals of a sphere point out of it; the tessellation of 64 is good to 1e-3."""
    scene = looking_down(Part(sphere(1, segments=64), matte(0.5)))
    rng = np.random.default_rng(9)
    targets = rng.uniform(-0.6, 0.6, (40, 3)) * [1, 1, 0]
    points, _ = shoot(scene, [[0, 0, 5]] * 40, (targets - [0, 0, 5]).tolist())
    np.testing.assert_allclose(dot(points.n, points.n), 1, atol=1e-6)
    np.testing.assert_allclose(points.n, normalise(points.p), atol=2e-3)
    np.testing.assert_allclose(points.cos_o, dot(points.n, points.wo), atol=1e-6)
    assert (points.cos_o > 0).all() and (dot(points.ng, points.wo) > 0).all()


def test_texture_coordinates() -> None:
    """A mesh's uv reach the texture: a ramp in u over a quad is the ramp."""
    ramp = Image(np.linspace(0, 1, 64, dtype=np.float32)[None, :, None], wrap="clamp")
    scene = looking_down(Part(quad((0, 0, 0), (1, 0, 0), (0, 1, 0)), matte(ramp)))
    x = np.linspace(0.1, 0.9, 9)
    points, _ = shoot(scene, [[a, 0.3, 1] for a in x], [[0, 0, -1]] * 9)
    # texel centres are half a texel inside: value = (64 x - .5) / 63
    np.testing.assert_allclose(points.reflection[0].reflectance[0], (64 * x - 0.5) / 63, atol=1e-5)
    # a triangle without uv has (0,0), (1,0), (1,1) at its corners, as in pbrt; dp/du is then its first edge
    mesh = Mesh(np.array([[0.0, 0, 0], [2, 0, 0], [2, 1, 0]]), np.array([[0, 1, 2]]))
    ramp = Image(np.linspace(0, 1, 64, dtype=np.float32)[None, :, None], wrap="clamp")
    with pytest.warns(SceneWarning, match="no texture coordinates"):
        scene = looking_down(Part(mesh, substrate(ramp, 0.5, 0.1, 0.2)))
    points, _ = shoot(scene, [[1.0, 0.25, 1]], [[0, 0, -1]])
    np.testing.assert_allclose(points.reflection[0].diffuse[0], (64 * 0.5 - 0.5) / 63, atol=1e-5)
    np.testing.assert_allclose(points.dpdu[:, 0], [2, 0, 0], atol=1e-6)
    # dp/du is the direction in which u grows, whatever the edges are
    mesh = Mesh(
        np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]]), np.array([[0, 1, 2]]), uv=np.array([[0.0, 0], [0, 1], [1, 0]])
    )
    scene = looking_down(Part(mesh, substrate(0.5, 0.5, 0.1, 0.2)))
    points, _ = shoot(scene, [[0.2, 0.2, 1]], [[0, 0, -1]])
    np.testing.assert_allclose(points.dpdu[:, 0], [0, 1, 0], atol=1e-6)


def test_materials_of_one_kind_share_a_group() -> None:
    """Two mattes are one batch, and each point has its own material's reflectance."""
    red, blue = matte((1, 0, 0)), matte((0, 0, 1))
    scene = looking_down(
        Part(quad((0, 0, 0), (1, 0, 0), (0, 1, 0)), red), Part(quad((2, 0, 0), (1, 0, 0), (0, 1, 0)), blue)
    )
    assert len(scene.plan.groups) == 1
    points, _ = shoot(scene, [[0.5, 0.4, 1], [2.5, 0.4, 1]], [[0, 0, -1]] * 2)
    np.testing.assert_array_equal(points.reflection[0].reflectance, [[1, 0], [0, 0], [0, 1]])


@pytest.mark.parametrize("kind", [Conductor, ExactConductor])
def test_metals_share_a_group(kind: type[Conductor]) -> None:
    """Mirrors and rough surfaces of several metals: each point has its own metal's reflectance."""
    gold, grey = kind((0.1, 0.4, 1.4), (4.0, 2.4, 1.6)), kind((2.0, 2.0, 2.0), (3.0, 3.0, 3.0))
    fields = [quad((2 * k, 0, 0), (1, 0, 0), (0, 1, 0)) for k in range(2)]
    for lobe in (GGX(0.5, Isotropic(0.3), gold), SpecularReflection(0.5, gold)):
        lobes = [replace(lobe, fresnel=metal) for metal in (gold, grey)]
        parts = [Part(mesh, Material((lobe,))) for mesh, lobe in zip(fields, lobes, strict=True)]
        scene = looking_down(*parts)
        assert len(scene.plan.groups) == 1
        rays = [[0.5, 0.4, 1], [2.5, 0.4, 1]], [[0.3, 0, -1]] * 2
        together, _ = shoot(scene, *rays)
        for k, part in enumerate(parts):
            alone, _ = shoot(looking_down(part), *([ray[k]] for ray in rays))
            mixed = together.take(np.array([k]))
            if isinstance(lobe, GGX):
                wi = normalise(np.array([[0.2], [0.1], [0.9]], np.float32))
                found, expected = (points.eval(Directions(points, wi)) for points in (mixed, alone))
            else:
                found, expected = (points.delta[0].scatter(points)[1] for points in (mixed, alone))
            assert expected.any()
            np.testing.assert_allclose(*np.broadcast_arrays(found, expected), rtol=1e-6)
