"""Camera rays that begin on a surface: a hit at distance 0 is no hit, as in pbrt.

Embree does not leave out hits at distance 0, so a camera that stands on a floor would see nothing but that floor. Rays
that begin on triangles therefore begin a few units in the last place of float32 away from their planes, on the side to
which they go. This is the rounding of positions, not a share of the scene: whatever is further away than that is seen.
Of a camera that is on no triangle nothing changes.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from dmis.base.vectors import Array, Floats, dot
from dmis.geometry.mesh import Mesh

ULP = 2.0**-24
"""Relative rounding of float32."""
_TRIANGLES_PER_BLOCK = 2**16
"""Triangles looked at together."""


def offsets(position: Array, meshes: Iterable[Mesh]) -> Array:
    """Return by how much rays from `position` ``(3,)`` float64 must begin off the triangles that it is on: normals of
    their planes times lengths, ``(K, 3)`` float32; K = 0 if it is on none.

    Embree computes the height of a triangle with corners v over the origin o as ``n . (v - o)``. Its rounding, and that
    of v and o, add up to less than ``4 ULP sum_i |n_i| (|o_i| + max |v_i - o_i|)``; rays begin twice that away.
    """
    rows = [np.zeros((0, 3))]
    for mesh in meshes:
        room = 16 * ULP * max(np.abs(mesh.bounds).max(), np.abs(position).max())
        if (mesh.bounds[0] > position + room).any() or (mesh.bounds[1] < position - room).any():
            continue
        for first in range(0, len(mesh.faces), _TRIANGLES_PER_BLOCK):
            corners = mesh.vertices[mesh.faces[first : first + _TRIANGLES_PER_BLOCK]]
            near = ((corners.min(axis=1) <= position + room) & (corners.max(axis=1) >= position - room)).all(axis=1)
            if near.any():
                rows.append(_touched(position, corners[near]))
    planes = np.concatenate(rows)
    length = np.linalg.norm(planes, axis=1, keepdims=True)
    unit = planes / np.maximum(length, 1e-300)
    unit *= np.where(unit[np.arange(len(unit)), np.abs(unit).argmax(axis=1)] < 0, -1, 1)[:, None]
    # triangles of one plane count once, with the largest offset
    _, plane = np.unique(np.rint(unit * 1e4), axis=0, return_inverse=True)
    largest = [np.flatnonzero(plane.ravel() == k) for k in range(plane.max(initial=-1) + 1)]
    return planes[[index[length[index, 0].argmax()] for index in largest]].astype(np.float32).reshape(-1, 3)


def ray_origins(origin: Array, planes: Array, direction: Array) -> Array:
    """Return the origins ``(3, N)`` of rays from `origin` ``(3, 1)`` along `direction` ``(3, N)``; see `offsets`."""
    out = np.repeat(origin, direction.shape[1], axis=1)
    for plane in planes:
        column = plane[:, None]
        out += column * np.sign(dot(column, direction))
    return out


def _touched(position: Floats, corners: Floats) -> Floats:
    """Return offsets from the triangles ``(F, 3, 3)`` that `position` is on, ``(K, 3)``."""
    to = corners - position
    edges = np.roll(corners, -1, axis=1) - corners
    normal = np.cross(edges[:, 0], edges[:, 1])
    area = np.linalg.norm(normal, axis=1)
    to, edges, normal = (a[area > 0] for a in (to, edges, normal))
    normal /= area[area > 0, None]
    reach = np.abs(to).max(axis=1)
    inwards = np.cross(normal[:, None], edges)  # of each edge, in the plane
    inwards /= np.linalg.norm(inwards, axis=2, keepdims=True)
    room = 4 * ULP * (np.abs(position) + reach).max(axis=1)
    inside = (inwards * -to).sum(axis=2).min(axis=1) >= -room
    # on the plane up to the rounding of the position to float32, and of the plane to float64
    weight = np.abs(normal)
    height = np.abs((normal * to[:, 0]).sum(axis=1))
    on = inside & (height <= 4 * ULP * (weight @ np.abs(position)) + 2.0**-44 * reach.max(axis=1))
    error = 4 * ULP * (weight * (np.abs(position) + reach)).sum(axis=1)
    # a plane through 0 along the axes has no error at all, and the offset must not be 0
    return normal[on] * np.maximum(2 * error, ULP * ULP * reach.max(axis=1))[on, None]
