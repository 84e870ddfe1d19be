"""Split triangles that are huge beside small bodies, so that float32 resolves the bodies' shadows.

float32 knows a point of a triangle, and the height of the next ray's origin above it, to a few units in the last place
of the triangle's size: on a triangle 10^6 wide that is 0.1, and the shadow of a body of size 1 is lost. Near the body
the same plane is known to 10^-5 if triangles there are 100 wide. So triangles that are huge beside a body are halved
until each is no larger than `MAX_DIAGONALS` times the body, or than its distance from it. The surface stays the same.

A triangle is halved at the midpoint of its longest edge, together with the triangle on the other side of that edge, so
that no gap opens between them (longest-edge bisection, Rivara 1984). `dmis.scene.rescale` applies this once per
render; scenes without such bodies are not touched.
"""

from __future__ import annotations

import warnings

import numpy as np

from dmis.base.vectors import Floats
from dmis.geometry.mesh import Ints, Mesh

SMALL_RATIO = 250
"""Ratio of sizes from which a body is small beside a scene or a triangle: a ray offset of 10^-6 of the scene is then
more than 1/4000 of the body."""
MAX_DIAGONALS = 64
"""Largest triangle at a small body, in diagonals of the body: rays begin 10^-6 of the triangle above it."""
MAX_SPLIT_TRIANGLES = 2**18
"""Number of triangles of one mesh beyond which it is not split further."""
_PAIRS_PER_BLOCK = 2**20
"""Pairs of triangles and bodies whose distances are computed at a time."""


def bodies(mesh: Mesh) -> Floats:
    """Return the bounds of the bodies that a mesh consists of, least and largest coordinates ``(B, 2, 3)``.

    A mesh whose triangles are alike is one body. Where some are `SMALL_RATIO` times as large as others, as in a file
    that joins a ground with what stands on it, triangles that share corners are a body.
    """
    smallest, largest = mesh.edges
    whole = np.array(mesh.bounds)[None]
    if not largest > SMALL_RATIO * smallest:
        return whole
    from scipy.sparse import coo_array  # only such meshes need it
    from scipy.sparse.csgraph import connected_components

    same = _welded(mesh.vertices)[mesh.faces]
    links = same[:, :2].ravel(), same[:, 1:].ravel()
    count = len(mesh.vertices)
    _, label = connected_components(coo_array((np.ones(len(links[0]), bool), links), (count, count)), directed=False)
    body, of_face = np.unique(label[same[:, 0]], return_inverse=True)
    low, high = (np.full((len(body), 3), sign * np.inf) for sign in (1, -1))
    for corner in range(3):
        np.minimum.at(low, of_face, mesh.vertices[mesh.faces[:, corner]])
        np.maximum.at(high, of_face, mesh.vertices[mesh.faces[:, corner]])
    return np.stack([low, high], axis=1)


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
    if not len(small):
        return mesh
    diagonal = diagonals(small)
    # Every edge that is halved is longer than this, and so is the longest edge of each triangle that has it.
    active = _lengths(mesh.vertices, mesh.faces).max(axis=1) > MAX_DIAGONALS * diagonal.min()
    unsplit, faces = mesh.faces[~active], mesh.faces[active]
    columns = [mesh.vertices, mesh.normals, mesh.uv]
    rows = np.concatenate([column for column in columns if column is not None], axis=1)
    used, faces = np.unique(faces, return_inverse=True)
    near, faces = rows[used], faces.reshape(-1, 3)
    pending = np.ones(len(faces), bool)
    while True:
        large = np.zeros(len(faces), bool)
        large[pending] = _too_large(near[:, :3][faces[pending]], small)
        if not large.any() and len(faces) == np.count_nonzero(active):
            return mesh
        if not large.any():
            break
        if len(faces) > MAX_SPLIT_TRIANGLES:
            warnings.warn(
                f"a mesh has triangles {mesh.edges[1] / diagonal.min():.3g} times as large as the smallest of "
                f"{len(small):,} bodies, and more than {MAX_SPLIT_TRIANGLES:,} triangles would be needed to resolve "
                f"their shadows on it: some are off. Model it with smaller triangles, or leave out what is far away",
                stacklevel=2,
            )
            break
        near, faces, pending = _halve(near, faces, large)
    rows, faces = np.concatenate([rows, near]), np.concatenate([unsplit, faces + len(rows)])
    normals = None if mesh.normals is None else _unit(rows[:, 3:6], near=mesh.normals[0])
    return Mesh(rows[:, :3], faces, normals, None if mesh.uv is None else rows[:, -2:])


def _too_large(corners: Floats, small: Floats) -> np.ndarray:
    """Return whether triangles ``(F, 3, 3)`` are too large beside a body, (F,).

    They are if they are larger than `MAX_DIAGONALS` diagonals of the body and than their distance from it.
    """
    size = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(axis=1)
    low, high = corners.min(axis=1), corners.max(axis=1)
    fine = MAX_DIAGONALS * diagonals(small)
    large = np.zeros(len(corners), bool)
    step = max(1, _PAIRS_PER_BLOCK // max(1, len(small)))
    for begin in range(0, len(corners), step):
        block = slice(begin, begin + step)
        gap = np.maximum(small[:, 0] - high[block, None], low[block, None] - small[:, 1])
        distance = np.linalg.norm(np.maximum(gap, 0), axis=2)
        large[block] = (size[block, None] > np.maximum(fine, distance)).any(axis=1)
    return large


def _halve(rows: Floats, faces: Ints, large: np.ndarray) -> tuple[Floats, Ints, np.ndarray]:
    """Halve the triangles `large` (F,), and the neighbours at the edges that this halves.

    Returns the rows, the faces, and whether each face is new.
    """
    same = _welded(rows[:, :3])[faces].astype(np.int64)
    ahead = np.roll(same, -1, axis=1)
    edge = np.minimum(same, ahead) * len(rows) + np.maximum(same, ahead)  # a number for each pair of places
    length = _lengths(rows[:, :3], faces)
    # Of edges equally long the one of the largest number, so that both triangles at it agree.
    first = np.where(length == length.max(axis=1, keepdims=True), edge, -1).argmax(axis=1)
    turn = (first[:, None] + np.arange(3)) % 3
    edge = np.take_along_axis(edge, turn, axis=1)
    marked = large[:, None] & (np.arange(3) == 0)
    while True:  # a triangle that loses any edge to a neighbour is halved at its longest edge, too
        halved = np.unique(edge[marked])
        more = np.isin(edge, halved)
        more[:, 0] |= more.any(axis=1)
        if (more == marked).all():
            break
        marked = more
    split = marked[:, 0]
    corner, marked = np.take_along_axis(faces, turn, axis=1)[split], marked[split]
    ends = np.stack([corner, np.roll(corner, -1, axis=1)], axis=2)  # of the three edges
    pairs, middle = np.unique(np.sort(ends[marked], axis=1), axis=0, return_inverse=True)
    new = np.full(corner.shape, -1, faces.dtype)
    new[marked] = len(rows) + middle.ravel()
    rows = np.concatenate([rows, rows[pairs].mean(axis=1)])
    (a, b, c), (ab, bc, ca) = corner.T, new.T
    pieces = []
    for half, point, on in (((ab, b, c), bc, marked[:, 1]), ((ab, c, a), ca, marked[:, 2])):
        m, begin, end = half  # the edge from begin to end may be halved at `point`
        pieces.append(np.stack([m, begin, np.where(on, point, end)], axis=1))
        pieces.append(np.stack([m, point, end], axis=1)[on])
    fresh = np.concatenate(pieces)
    faces = np.concatenate([faces[~split], fresh])
    return rows, faces, np.arange(len(faces)) >= len(faces) - len(fresh)


def _lengths(vertices: Floats, faces: Ints) -> Floats:
    """Return the lengths of the three edges of each face, corner k to corner k + 1, (F, 3)."""
    corners = vertices[faces]
    return np.asarray(np.linalg.norm(corners - np.roll(corners, -1, axis=1), axis=2))


def _welded(points: Floats) -> Ints:
    """Return the index of the first point at exactly the same place, for each point."""
    _, first, inverse = np.unique(points, axis=0, return_index=True, return_inverse=True)
    return first[inverse.ravel()]


def _unit(normals: Floats, near: Floats) -> Floats:
    """Return `normals` scaled to unit length; zeros, the means of opposite normals, become `near`."""
    length = np.linalg.norm(normals, axis=1, keepdims=True)
    return np.where(length > 1e-12, normals / np.maximum(length, 1e-12), near)
