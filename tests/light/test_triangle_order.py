"""Triangles of mesh lights in an order that keeps Sobol points even."""

import numpy as np
import pytest
import trimesh

from dmis.base.vectors import Array
from dmis.light.mesh_light import MeshLight
from dmis.light.triangle_order import compact_order, shortest_edge_last
from dmis.samplers.pixel_block import PixelBlock
from dmis.samplers.sobol import Sobol
from dmis.samplers.streams import stream

SEEDS = 48


def tube(sectors: int = 256) -> trimesh.Trimesh:
    """A cylinder of radius .02 and height 1.2, without caps, of 2 long triangles for each sector."""
    angle = np.linspace(0, 2 * np.pi, sectors, endpoint=False)
    ring = np.stack([0.02 * np.cos(angle), 0.02 * np.sin(angle), 0 * angle], axis=1)
    i, j = np.arange(sectors), (np.arange(sectors) + 1) % sectors
    lower, upper = np.stack([i, j, i + sectors], axis=1), np.stack([j, j + sectors, i + sectors], axis=1)
    return trimesh.Trimesh(np.concatenate([ring, ring + [0, 0, 1.2]]), np.stack([lower, upper], 1).reshape(-1, 3))


def ball() -> trimesh.Trimesh:
    """An icosphere of 1,280 triangles."""
    return trimesh.creation.icosphere(subdivisions=3)


def variance(light: MeshLight, p: Array, n: int, sobol: bool) -> float:
    """Relative variance of the mean of n light samples at a point that faces up."""
    means = []
    for seed in range(SEEDS):
        if sobol:
            sampler = Sobol(PixelBlock(stream(3, 0, 0), 3, np.array([seed]), [n], 2))
            sampler.start(np.zeros(n, np.int64), np.arange(n))
            u = sampler.draw((0, 0), None)
        else:
            u = np.random.default_rng(seed).random((2, n), dtype=np.float32)
        sample = light.sample(np.tile(p, (1, n)), u)
        values = sample.radiance[0] * np.abs(sample.wi[2]) / np.maximum(sample.pdf, 1e-30)
        means.append(np.where(sample.emits, values, 0).mean())
    return np.var(means) / np.mean(means) ** 2


@pytest.mark.parametrize(
    ("mesh", "p", "least"),
    [(tube(), [0.6, -0.5, 0.2], 200), (tube(), [-0.4, 0.3, -0.5], 200), (ball(), [3, 1, -2], 10)],
)
def test_even_points_stay_even_on_a_mesh_light(mesh: trimesh.Trimesh, p: list[float], least: float) -> None:
    light = MeshLight(np.asarray(mesh.vertices), np.asarray(mesh.faces), (1, 1, 1))
    point = np.array(p, np.float32)[:, None]
    independent, even = (variance(light, point, 256, sobol) for sobol in (False, True))
    assert independent / even > least, f"256 samples: independent {independent:.2e}, Sobol {even:.2e}"


def test_order_is_a_permutation_of_compact_parts() -> None:
    mesh = ball()
    triangles = mesh.triangles[np.random.default_rng(0).permutation(len(mesh.faces))]
    order = compact_order(triangles)
    assert (np.sort(order) == np.arange(len(order))).all()

    def widths(triangles: Array) -> list[float]:
        area = trimesh.triangles.area(triangles)
        part = (16 * (np.cumsum(area) - area / 2) / area.sum()).astype(int)
        return [float(np.linalg.norm(np.ptp(triangles[part == k].mean(axis=1), axis=0))) for k in range(16)]

    assert max(widths(triangles[order])) < 2 < 3 < min(widths(triangles))  # diagonals of bounds, of a sphere's 3.5


@pytest.mark.parametrize("triangles", [np.zeros((5, 3, 3)), np.eye(3)[None]])
def test_few_and_degenerate_triangles_have_an_order(triangles: Array) -> None:
    assert sorted(compact_order(triangles)) == list(range(len(triangles)))


def test_shortest_edge_is_turned_last_and_winding_kept() -> None:
    vertices = np.random.default_rng(1).random((30, 3))
    faces = np.arange(30).reshape(10, 3)
    turned = shortest_edge_last(vertices, faces)
    a, b, c = np.moveaxis(vertices[turned], 1, 0)
    assert (np.linalg.norm(a - c, axis=1) <= np.minimum(*(np.linalg.norm(x - b, axis=1) for x in (a, c)))).all()
    before, after = (np.cross(v[:, 1] - v[:, 0], v[:, 2] - v[:, 0]) for v in (vertices[faces], vertices[turned]))
    np.testing.assert_allclose(after, before, atol=1e-12)
