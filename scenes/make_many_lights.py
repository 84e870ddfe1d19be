"""Make scenes with more lamps than can be sampled one by one: a divided room with 1,000 lamps, and a glowing knot.

`many_lights`: lamps of a few centimetres hang below the ceiling of a room and face anywhere. Their powers are
log-normal with sigma = 1. A wall divides the room, so each lamp is hidden from half of it; columns and boxes hide it
from more. Other seeds have other lamps: constants are chosen on those, and the scene of seed 0 tests them.

`glowing_knot`: one lamp, a knotted tube of 100,000 triangles, between a matte floor and a glossy wall.

Run: python scenes/make_many_lights.py        (renders both to many-lights.exr and glowing-knot.exr, a minute)
"""

from __future__ import annotations

import numpy as np

import dmis
from dmis.geometry.mesh import concatenate
from dmis.geometry.shapes import grid, quad

WIDTH, DEPTH, HEIGHT = 6.0, 5.0, 2.8
"""The room in metres: x from -WIDTH / 2, y from 0, z from 0."""
LOWEST = 1.9
"""Height of the lowest lamps, above the view."""


def box(low: tuple[float, float, float], high: tuple[float, float, float]) -> dmis.Mesh:
    """The four sides and the top of a box that stands on the floor."""
    (x, y, z), (u, v, w) = low, np.subtract(high, low)
    sides = (
        ((x, y, z), (u, 0, 0)),
        ((x + u, y, z), (0, v, 0)),
        ((x + u, y + v, z), (-u, 0, 0)),
        ((x, y + v, z), (0, -v, 0)),
    )
    return concatenate(
        [*(quad(corner, along, (0, 0, w)) for corner, along in sides), quad((x, y, z + w), (u, 0, 0), (0, v, 0))]
    )


def many_lights(seed: int = 0, count: int = 1000, resolution: tuple[int, int] = (320, 200)) -> dmis.Scene:
    """Return the divided room with `count` lamps; the power of all of them is that of 1,000."""
    rng = np.random.default_rng(seed)
    lights = []
    for power in np.exp(rng.normal(size=count)):
        normal = rng.normal(size=3)
        normal /= np.linalg.norm(normal)
        side = rng.uniform(0.01, 0.04)
        along = np.cross(normal, rng.normal(size=3))
        along *= side / np.linalg.norm(along)
        centre = rng.uniform((-WIDTH / 2 + 0.1, 0.1, LOWEST), (WIDTH / 2 - 0.1, DEPTH - 0.1, HEIGHT - 0.1))
        centre[0] += np.copysign(0.1, centre[0]) * (abs(centre[0]) < 0.1)  # not inside of the wall
        tint = np.array((1.0, 0.8, 0.6)) + rng.uniform(-0.2, 0.2) * np.array((-1, 0, 1))
        radiance = tint * power * 0.02 / side**2 * (1000 / count)
        across = np.cross(normal, along)
        lights.append(
            dmis.QuadLight(tuple(centre - (along + across) / 2), tuple(along), tuple(across), tuple(radiance))
        )
    w, d, h = WIDTH, DEPTH, HEIGHT
    white = [quad((-w / 2, d, 0), (w, 0, 0), (0, 0, h)), quad((-w / 2, 0, h), (0, d, 0), (w, 0, 0))]
    white += [quad((-w / 2, 0, 0), (0, d, 0), (0, 0, h)), quad((w / 2, d, 0), (0, -d, 0), (0, 0, h))]
    divider = box((-0.03, 1.2, 0), (0.03, d, h))
    boxes = [box((x, y, 0), (x + 0.5, y + 0.5, z)) for x, y, z in ((-2.3, 3.1, 0.9), (-1.2, 2.2, 0.5), (0.8, 2.6, 0.7))]
    columns = [box((x, y, 0), (x + 0.2, y + 0.2, h)) for x, y in ((-1.6, 4.0), (1.9, 3.6))]
    parts = (
        dmis.Part(quad((-w / 2, 0, 0), (w, 0, 0), (0, d, 0)), dmis.plastic(0.4, 0.2, 0.15)),
        dmis.Part(concatenate([*white, divider, *columns]), dmis.matte(0.6)),
        dmis.Part(concatenate(boxes), dmis.plastic((0.5, 0.2, 0.1), 0.3, 0.08)),
        *(dmis.light_part(light) for light in lights),
    )
    camera = dmis.Camera.look_at((0, -2.6, 1.55), (0, 3, 0.2), fov=31, resolution=resolution)
    return dmis.Scene(camera, parts, tuple(lights), "many-lights")


def glowing_knot(rings: int = 1000, around: int = 50, resolution: tuple[int, int] = (320, 200)) -> dmis.Scene:
    """Return a lamp of ``2 * rings * around`` triangles, a (2, 3) torus knot, above a floor and before a wall."""
    t, a = np.meshgrid(*(np.linspace(0, 2 * np.pi, n + 1) for n in (rings, around)), indexing="ij")

    def curve(t: np.ndarray) -> np.ndarray:
        r = 1 + 0.45 * np.cos(3 * t)
        return np.stack([0.5 * r * np.cos(2 * t), 0.5 * r * np.sin(2 * t) + 0.2, 0.3 * np.sin(3 * t) + 0.9], axis=-1)

    forward = curve(t + 1e-4) - curve(t - 1e-4)
    forward /= np.linalg.norm(forward, axis=-1, keepdims=True)
    side = np.cross(forward, (0, 0, 1))
    side /= np.linalg.norm(side, axis=-1, keepdims=True)
    normal = np.cos(a)[..., None] * side + np.sin(a)[..., None] * np.cross(side, forward)
    tube = grid(curve(t) + 0.05 * normal, normal, np.stack([t, a], axis=-1))
    knot = dmis.MeshLight(tube.vertices, tube.faces, (4, 3, 2))
    parts = (
        dmis.Part(quad((-3, -2, 0), (6, 0, 0), (0, 4, 0)), dmis.matte(0.6)),
        dmis.Part(quad((-3, 1.5, 0), (6, 0, 0), (0, 0, 3)), dmis.plastic(0.3, 0.4, 0.03)),
        dmis.light_part(knot),
    )
    camera = dmis.Camera.look_at((0, -4, 1.6), (0, 0, 0.75), fov=40, resolution=resolution)
    return dmis.Scene(camera, parts, (knot,), "glowing-knot")


if __name__ == "__main__":
    for scene in (many_lights(), glowing_knot()):
        dmis.write_image(f"{scene.name}.exr", dmis.render(scene, "balance", 64, lights="tree"))
