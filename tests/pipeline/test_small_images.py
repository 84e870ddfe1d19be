"""Means of rules that learn, on images of 1 to 16 pixels, where a pixel's own samples could decide the most."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest

import dmis
from dmis.geometry.shapes import quad

LAMP = np.array([(-0.5, -0.5, 3.0), (0.7, -0.5, 3.0), (0.7, 0.5, 3.0), (-0.5, 0.5, 3.0)])
Z_LIMIT = 4.5


def lit_floor(resolution: tuple[int, int], fov: float = 1e-3, width: float = 8) -> dmis.Scene:
    """Return a matte floor under a lamp of radiance 1; with a small `fov` all pixels see the point (0, 0, 0)."""
    floor = dmis.Part(quad((-4, -4, 0), (width, 0, 0), (0, 8, 0)), dmis.matte(0.5))
    lamp = dmis.QuadLight(LAMP[0], LAMP[3] - LAMP[0], LAMP[1] - LAMP[0], (1, 1, 1))
    camera = dmis.Camera.look_at((0, 0.01, 2), (0, 0, 0), fov=fov, resolution=resolution)
    return dmis.Scene(camera, (floor,), (lamp,), "floor", dmis.Suggestions("direct"))


def radiance_of_floor() -> float:
    """Return the reflected radiance at (0, 0, 0): Lambert's formula for the irradiance of a polygon, over pi."""
    corners = LAMP / np.linalg.norm(LAMP, axis=1)[:, None]
    edges = [(np.cross(a, b), np.arccos(a @ b)) for a, b in zip(corners, np.roll(corners, -1, axis=0))]
    return 0.5 / np.pi * abs(sum(angle * normal[2] / np.linalg.norm(normal) for normal, angle in edges)) / 2


def z_of_mean(scene: dmis.Scene, exact: float, rule: str, spp: int, sampler: str, seeds: int) -> float:
    """Return by how many standard errors the mean of so many renders is off."""
    means = [
        dmis.render(scene, rule, spp, seed=k, parallel=1, sampler=sampler).image.mean(dtype=float) for k in range(seeds)
    ]
    return (np.mean(means) - exact) / (np.std(means, ddof=1) / np.sqrt(seeds))


@pytest.mark.slow
@pytest.mark.parametrize("rule", ["auto", "counts", "second-moment", "thesis"])
def test_means_agree_with_the_closed_form(rule: str) -> None:
    """Single pixels, strips of odd length and blocks, at budgets that are no powers of two."""
    exact = radiance_of_floor()
    resolutions, samplers = ((1, 1), (2, 1), (1, 3), (5, 3), (16, 1)), ("independent", "sobol")
    for resolution, sampler, spp in product(resolutions, samplers, (24, 50)):
        z = z_of_mean(lit_floor(resolution), exact, rule, spp, sampler, seeds=60)
        assert abs(z) < Z_LIMIT, (resolution, sampler, spp, z)


@pytest.mark.slow
def test_rays_of_a_pixel_do_not_decide_its_samples() -> None:
    """A pixel half of which sees the floor, at budgets where few rays more make half the samples: z 5 if they did."""
    scene = lit_floor((1, 1), fov=30, width=3.75)
    exact = np.mean([dmis.render(scene, "balance", 2**14, seed=k).image.mean(dtype=float) for k in range(4)])
    for spp in (22, 45, 90):
        assert abs(z_of_mean(scene, exact, "auto", spp, "independent", seeds=1500)) < Z_LIMIT
