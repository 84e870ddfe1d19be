"""Embree against brute force, and what it refuses."""

import numpy as np
import pytest
from brute_force import BruteForce

from dmis.base.vectors import Array, normalise
from dmis.intersect import Intersector

TRIANGLE = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]]), np.array([[0, 1, 2]])


def soup(seed: int = 1, count: int = 200) -> tuple[Array, np.ndarray]:
    """Random triangles of all sizes in a cube."""
    rng = np.random.default_rng(seed)
    centre, size = rng.uniform(-1, 1, (count, 1, 3)), rng.lognormal(-1.5, 0.8, (count, 1, 1))
    vertices = (centre + rng.normal(size=(count, 3, 3)) * size).reshape(-1, 3).astype(np.float32)
    return vertices, np.arange(3 * count).reshape(-1, 3)


def rays(count: int = 3000, seed: int = 2) -> tuple[Array, Array]:
    rng = np.random.default_rng(seed)
    origin = rng.uniform(-1.5, 1.5, (3, count)).astype(np.float32)
    return origin, normalise(rng.normal(size=(3, count))).astype(np.float32)


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_closest_agrees_with_brute_force(seed: int) -> None:
    """The same triangle, or another one at the same distance; distances and barycentrics to float32 rounding.

    A ray through an edge may be a hit for one and a miss for the other: none or two in three thousand.
    """
    mesh, (origin, direction) = soup(seed), rays(seed=seed + 10)
    a, b = Intersector(*mesh).closest(origin, direction), BruteForce(*mesh).closest(origin, direction)
    assert 0.3 < (a.prim >= 0).mean() < 0.999, "the soup should be hit and missed"
    same = a.prim == b.prim
    near = np.isclose(a.distance, b.distance, rtol=1e-4, atol=1e-5)
    assert (~same & ~near).sum() <= 2
    same_hit = same & (a.prim >= 0)
    assert same_hit.sum() > 900
    np.testing.assert_allclose(a.distance[same_hit], b.distance[same_hit], rtol=1e-4, atol=1e-5)
    # barycentrics divide by the triangle's projected size, and slivers have little
    assert (np.abs(a.u - b.u)[same_hit] < 1e-3).mean() > 0.998 and (np.abs(a.v - b.v)[same_hit] < 1e-3).mean() > 0.998


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_occluded_agrees_with_brute_force(seed: int) -> None:
    """Occlusion by distance is the same but for rays that end within rounding of a triangle."""
    mesh, (origin, direction) = soup(seed), rays(seed=seed + 20)
    distance = np.random.default_rng(seed).uniform(0, 2, origin.shape[1]).astype(np.float32)
    a = Intersector(*mesh).occluded(origin, direction, distance)
    b = BruteForce(*mesh).occluded(origin, direction, distance)
    assert 0.1 < a.mean() < 0.9 and (a != b).sum() <= 2


def test_distances() -> None:
    """Occluded just beyond the closest hit, free just before it."""
    mesh, (origin, direction) = soup(), rays()
    caster = Intersector(*mesh)
    hits = caster.closest(origin, direction)
    hit = hits.prim >= 0
    o, d, t = origin[:, hit].copy(), direction[:, hit].copy(), hits.distance[hit]
    assert caster.occluded(o, d, t * np.float32(1.0001) + np.float32(1e-6)).all()
    assert not caster.occluded(o, d, t * np.float32(0.9999) - np.float32(1e-6)).any()
    # a direction of length 2 halves the distance, for both casters
    origin, direction = np.array([[0.2], [0.2], [4]], np.float32), np.array([[0], [0], [-2]], np.float32)
    for caster in (Intersector(*TRIANGLE), BruteForce(*TRIANGLE)):
        hits = caster.closest(origin, direction)
        assert hits.prim[0] == 0 and hits.distance[0] == pytest.approx(2)
        assert hits.u[0] == pytest.approx(0.2) and hits.v[0] == pytest.approx(0.2)
        assert caster.occluded(origin, direction, np.float32([2.01]))[0]
        assert not caster.occluded(origin, direction, np.float32([1.99]))[0]
    # a distance that rounding has made 0 or less has nothing in it, in Embree as by brute force
    corners, faces = np.array([[-1, -1, 0], [1, -1, 0], [0, 1, 0.0]]), np.array([[0, 1, 2]])
    origin, down = (np.repeat(np.array([[0], [0], [z]], np.float32), 5, axis=1) for z in (1.0, -1.0))
    distance = np.array([-5, -0.5, 0, 0.5, 5], np.float32)
    for caster in (Intersector(corners, faces), BruteForce(corners, faces)):
        np.testing.assert_array_equal(caster.occluded(origin, down, distance), distance > 1)
    assert distance.tolist() == [-5, -0.5, 0, 0.5, 5]  # nothing was written into it, although Embree writes distances


@pytest.mark.parametrize("count", [0, 1, 7])
def test_few_rays(count: int) -> None:
    """No ray, one, and an odd number."""
    origin, direction = rays(count)
    for caster in (Intersector(*soup()), BruteForce(*soup())):
        assert caster.closest(origin, direction).prim.shape == (count,)
        assert caster.occluded(origin, direction, np.ones(count, np.float32)).shape == (count,)


@pytest.mark.parametrize("origin, direction", [((3, 4), (3, 5)), ((4, 3), (4, 3)), ((3,), (3,)), ((3, 1), (3, 4))])
def test_bad_ray_shapes(origin: tuple[int, ...], direction: tuple[int, ...]) -> None:
    """Shapes that differ, rows instead of columns, single vectors; and not one distance for each ray."""
    caster = Intersector(*TRIANGLE)
    o, d = np.zeros(origin, np.float32), np.ones(direction, np.float32)
    with pytest.raises(ValueError, match=r"must both have shape \(3, N\)"):
        caster.closest(o, d)
    with pytest.raises(ValueError, match=r"must both have shape \(3, N\)"):
        caster.occluded(o, d, np.ones(origin[-1], np.float32))
    with pytest.raises(ValueError, match=r"distance must have shape \(4,\)"):
        caster.occluded(np.zeros((3, 4), np.float32), np.ones((3, 4), np.float32), np.ones(5, np.float32))


@pytest.mark.parametrize("which", ["origin", "direction", "distance"])
def test_check_finds_nan(which: str) -> None:
    """With `CHECK_RAYS` a NaN is an error, not a millisecond per ray."""
    shapes = {"origin": (3, 4), "direction": (3, 4), "distance": (4,)}
    arrays = {name: np.ones(shape, np.float32) for name, shape in shapes.items()}
    arrays[which][..., 2] = np.nan
    with pytest.raises(ValueError, match="must not"):
        Intersector(*TRIANGLE).occluded(**arrays)
