"""Split triangles that are huge beside small bodies, so that float32 resolves the bodies' shadows.

float32 knows a point of a triangle, and the height of the next ray's origin above it, to a few units in the last place
of the triangle's size: on a triangle 10^6 wide that is 0.1, and the shadow of a body of size 1 is lost. So triangles
are cut in four until each is no larger than `MAX_DIAGONALS` times the body, or than its distance from it. The surface
stays the same; beside a coarser neighbour an edge is off by the rounding of a midpoint.
"""

from __future__ import annotations

import numpy as np

from dmis.base.vectors import Floats
from dmis.geometry.mesh import Mesh

SMALL_RATIO = 250
"""Ratio of sizes from which a body is small beside a scene or a triangle: a ray offset of 10^-6 of the scene is then
more than 1/4000 of the body."""
MAX_DIAGONALS = 64
"""Largest triangle at a small body, in diagonals of the body: rays begin 10^-6 of the triangle above it."""
MAX_SPLIT_TRIANGLES = 2**18
"""Number of triangles of one mesh beyond which it is not split further."""
_BODIES_PER_BLOCK = 16
"""Bodies whose distances from all triangles are computed at a time."""


def bodies(mesh: Mesh) -> Floats:
    """Return the bounds of the bodies that a mesh consists of, least and largest coordinates ``(B, 2, 3)``.

    A mesh whose triangles are alike is one body. Where some are `SMALL_RATIO` times as large as others, as in a file
    that joins a ground with what stands on it, triangles that share corners are a body.
    """
    smallest, largest = mesh.edges
    if not largest > SMALL_RATIO * smallest:
        return np.array(mesh.bounds)[None]
    from trimesh.graph import connected_component_labels  # only such meshes need it

    corner = np.unique(mesh.vertices, axis=0, return_inverse=True)[1].ravel()[mesh.faces]
    label = connected_component_labels(np.concatenate([corner[:, :2], corner[:, 1:]]))[corner[:, 0]]
    order = np.argsort(label, kind="stable")
    triangles = mesh.vertices[mesh.faces[order]]
    first = np.unique(label[order], return_index=True)[1]
    low, high = triangles.min(axis=1), triangles.max(axis=1)
    return np.stack([np.minimum.reduceat(low, first), np.maximum.reduceat(high, first)], axis=1)


def diagonals(boxes: Floats) -> Floats:
    """Return the diagonals ``(B,)`` of bounds ``(B, 2, 3)``."""
    return np.asarray(np.linalg.norm(boxes[:, 1] - boxes[:, 0], axis=1))


def small_beside(size: float, boxes: Floats) -> Floats:
    """Return the bounds out of `boxes` ``(B, 2, 3)`` that are small beside `size`, without those of no extent."""
    diagonal = diagonals(boxes)
    return boxes[(diagonal > 0) & (diagonal * SMALL_RATIO < size)]


def refine_near_bodies(mesh: Mesh, boxes: Floats) -> Mesh:
    """Split the huge triangles of `mesh` near the bodies in `boxes` ``(B, 2, 3)``; return `mesh` if there are none."""
    small = small_beside(mesh.edges[1], boxes)
    if not len(small) or not _too_large(mesh.vertices[mesh.faces], small).any():
        return mesh
    from trimesh.remesh import subdivide

    columns = [mesh.vertices, mesh.normals, mesh.uv]
    rows = np.concatenate([column for column in columns if column is not None], axis=1)
    faces = mesh.faces
    while len(faces) <= MAX_SPLIT_TRIANGLES:
        large = _too_large(rows[:, :3][faces], small)
        if not large.any():
            break
        rows, faces = subdivide(rows, faces, np.flatnonzero(large))
    normals = None if mesh.normals is None else rows[:, 3:6]
    uv = None if mesh.uv is None else rows[:, -2:]
    return Mesh(rows[:, :3], faces, normals, uv)


def _too_large(corners: Floats, small: Floats) -> np.ndarray:
    """Return whether triangles ``(F, 3, 3)`` are larger than `MAX_DIAGONALS` of a body and than its distance, (F,)."""
    size = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(axis=1)
    low, high = corners.min(axis=1)[:, None], corners.max(axis=1)[:, None]
    fine = MAX_DIAGONALS * diagonals(small)
    large = np.zeros(len(corners), bool)
    for k in range(0, len(small), _BODIES_PER_BLOCK):
        body = small[k : k + _BODIES_PER_BLOCK]
        gap = np.linalg.norm(np.maximum(np.maximum(body[:, 0] - high, low - body[:, 1]), 0), axis=2)
        large |= (size[:, None] > np.maximum(fine[k : k + _BODIES_PER_BLOCK], gap)).any(axis=1)
    return large
