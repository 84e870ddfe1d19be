"""Make the vase of the scene `cornell.pbrt`: the file `scenes/geometry/cornell-vase.ply`.

What: a slender vase, turned on a lathe, standing on z = 0: one binary PLY file with vertices, exact unit normals and
triangles, wound so that the outside is outside.

How: one cubic Bézier curve after the other, (radius, height) from the foot up the outside, over the lip and down the
inside, swept through a full turn. Normals are those of the curve, turned with it.

Why: light that comes by way of a polished curved surface is what the scene is for: it reaches the walls after the first
bounce and is found by BRDF sampling, where all else is better lit by light sampling.

Run: python scenes/make_cornell.py        (deterministic, a second, needs dmis itself)
"""

from pathlib import Path

import numpy as np
import trimesh

from dmis.base.vectors import Floats

FILE = Path(__file__).parent / "geometry" / "cornell-vase.ply"
TURNS, STEPS = 96, 10
"""Segments around the axis, and of each curve."""

# Each curve begins where the one before ends.
FOOT = (0, 0), (0.1, 0), (0.21, 0), (0.21, 0.02)
BELLY = (0.21, 0.02), (0.21, 0.14), (0.36, 0.3), (0.36, 0.5)
SHOULDER = (0.36, 0.5), (0.36, 0.72), (0.12, 0.74), (0.12, 0.92)
NECK = (0.12, 0.92), (0.12, 0.99), (0.15, 1.03), (0.2, 1.06)
LIP = (0.2, 1.06), (0.215, 1.07), (0.205, 1.085), (0.19, 1.08)
INSIDE = (0.19, 1.08), (0.1, 1.04), (0.095, 0.95), (0.0, 0.8)


def profile() -> tuple[Floats, Floats]:
    """Points (radius, height) ``(K, 2)`` and outward unit normals of the whole curve."""
    points, tangents = [], []
    for curve in (FOOT, BELLY, SHOULDER, NECK, LIP, INSIDE):
        p = np.array(curve, float)
        t = np.linspace(0, 1, STEPS + 1)[:, None]
        s = 1 - t
        points.append(s**3 * p[0] + 3 * s**2 * t * p[1] + 3 * s * t**2 * p[2] + t**3 * p[3])
        tangents.append(s**2 * (p[1] - p[0]) + 2 * s * t * (p[2] - p[1]) + t**2 * (p[3] - p[2]))
    tangent = np.concatenate(tangents)
    normal = np.stack([tangent[:, 1], -tangent[:, 0]], axis=1)
    return np.concatenate(points), normal / np.linalg.norm(normal, axis=1, keepdims=True)


def lathe(points: Floats, normals: Floats) -> trimesh.Trimesh:
    """The surface that a curve makes in a full turn."""
    angle = np.linspace(0, 2 * np.pi, TURNS, endpoint=False)
    around = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    swept = [
        np.concatenate([a[:, None, :1] * around, np.repeat(a[:, None, 1:], TURNS, axis=1)], axis=2).reshape(-1, 3)
        for a in (points, normals)
    ]
    row, column = (a.reshape(-1) for a in np.mgrid[: len(points) - 1, :TURNS])
    following = (column + 1) % TURNS
    a, b, c, d = (r * TURNS + k for r, k in ((row, column), (row, following), (row + 1, following), (row + 1, column)))
    faces = np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)])
    corners = swept[0][faces]
    area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    return trimesh.Trimesh(swept[0], faces[area > 1e-9], vertex_normals=swept[1], process=False)


def main() -> None:
    """Sweep and write."""
    vase = lathe(*profile())
    FILE.parent.mkdir(exist_ok=True)
    FILE.write_bytes(trimesh.exchange.ply.export_ply(vase, vertex_normal=True))
    print(f"{FILE.name}: {len(vase.faces)} triangles, {FILE.stat().st_size / 1e6:.2f} MB")


if __name__ == "__main__":
    main()
