"""Vertex attributes as rows per triangle, one gather per hit.

Each table is built when it is first read, so a scene without textures never has texture coordinates.
"""

from __future__ import annotations

from functools import cached_property

import numpy as np

from dmis.base.patches import row_blocks
from dmis.base.vectors import Array
from dmis.scene.groups import Part


class Tables:
    """Tables of all triangles of `parts`, in order."""

    def __init__(self, parts: tuple[Part, ...]) -> None:
        self.parts = parts

    @cached_property
    def corners(self) -> Array:
        """Per triangle: first vertex, two edges, unit normal, as rows ``(T, 12)``, one gather per hit."""
        rows = np.empty((sum(len(part.mesh.faces) for part in self.parts), 12), np.float32)
        start = 0
        for part in self.parts:
            for block in row_blocks(len(part.mesh.faces), 2**14):  # in float64 they are large
                a, b, c = (part.mesh.vertices[part.mesh.faces[block, k]] for k in range(3))
                edge_u, edge_v = b - a, c - a
                normal = np.cross(edge_u, edge_v)
                normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-300)
                np.concatenate([a, edge_u, edge_v, normal], axis=1, out=rows[start : start + len(a)])
                start += len(a)
        return rows

    @cached_property
    def normals(self) -> Array:
        """Per triangle: normal of the first vertex and the differences of the others to it, ``(T, 9)``."""
        rows = np.empty((len(self.corners), 3, 3), np.float32)
        start = 0
        for part in self.parts:
            stop = start + len(part.mesh.faces)
            if part.mesh.normals is None:
                rows[start:stop] = self.corners[start:stop, None, 9:]
            else:
                rows[start:stop] = part.mesh.normals[part.mesh.faces]
            start = stop
        rows[:, 1:] -= rows[:, :1]
        return rows.reshape(-1, 9)

    @cached_property
    def uv(self) -> Array:
        """Per triangle: texture coordinates of the first vertex and the two differences, ``(T, 6)``.

        A mesh without coordinates has (0,0), (1,0), (1,1) at the corners of each triangle, as in pbrt.
        """
        default = np.array([[0, 0], [1, 0], [1, 1]], np.float32)
        rows = np.concatenate(
            [
                np.broadcast_to(default, (len(part.mesh.faces), 3, 2))
                if part.mesh.uv is None
                else part.mesh.uv[part.mesh.faces].astype(np.float32)
                for part in self.parts
            ]
        )
        rows[:, 1:] -= rows[:, :1]
        return rows.reshape(-1, 6)

    @cached_property
    def tangents(self) -> tuple[Array, Array]:
        """Per triangle: dp/du and dp/dv, ``(T, 3)`` each; the first edge and across it for degenerate coordinates."""
        du1, dv1, du2, dv2 = self.uv[:, 2:].T[:, :, None]
        edge_u, edge_v = self.corners[:, 3:6], self.corners[:, 6:9]
        determinant = du1 * dv2 - du2 * dv1
        degenerate = np.abs(determinant) < 1e-20
        divisor = np.where(degenerate, 1, determinant)
        dpdu = np.where(degenerate, edge_u, (dv2 * edge_u - dv1 * edge_v) / divisor)
        across = np.cross(self.corners[:, 9:], dpdu)
        return dpdu, np.where(degenerate, across, (du1 * edge_v - du2 * edge_u) / divisor)
