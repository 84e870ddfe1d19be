"""Triangle meshes in world space: their normals, transforms and checks.

Tables of points are ``(n, 3)`` float64, because they are gathered row by row. Units are the scene's.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt

from dmis.base.validate import FARTHEST
from dmis.base.vectors import Floats

Ints = npt.NDArray[np.integer[Any]]
_FACES_PER_BLOCK = 2**14
"""Triangles whose edges are measured at a time: their corners stay in the cache."""


@dataclass(frozen=True, eq=False)
class Mesh:
    """Triangles in world space; arrays are checked and kept C-contiguous.

    Parameters
    ----------
    vertices
        Positions, (V, 3) float64, within `FARTHEST` of the origin along each axis.
    faces
        Vertex indices, (F, 3) integers, kept as int32, F >= 1. The geometric normal of a face (a, b, c) is
        (b - a) x (c - a).
    normals
        Shading normals, (V, 3) float64, brought to unit length here; None for flat shading.
    uv
        Texture coordinates, (V, 2) float64, within `FARTHEST` of 0; or None.

    A ValueError on a wrong shape, a number that is not finite or too large, a zero normal, an index without a vertex.
    """

    vertices: Floats
    faces: Ints
    normals: Floats | None = None
    uv: Floats | None = None

    def __post_init__(self) -> None:
        vertices = table("vertices", self.vertices, 3)
        rows = len(vertices)
        faces = np.asarray(self.faces)
        if faces.ndim != 2 or faces.shape[1] != 3 or not len(faces) or not np.issubdtype(faces.dtype, np.integer):
            what = "integers of shape (F, 3), F >= 1, three vertex indices per triangle"
            raise ValueError(f"faces must be {what}; got shape {faces.shape} of {faces.dtype}")
        if faces.min() < 0 or faces.max() >= rows:
            raise ValueError(
                f"faces must be indices from 0 to {rows - 1}, because there are {rows} vertices; "
                f"got {faces.min()} to {faces.max()}"
            )
        normals = None if self.normals is None else table("normals", self.normals, 3, rows)
        if normals is not None:
            length = np.linalg.norm(normals, axis=1, keepdims=True)
            if not length.all():
                row = int(np.argmin(length))
                raise ValueError(f"normals must not be zero, because they give directions; got a zero in row {row}")
            normals = normals / length
        uv = None if self.uv is None else table("uv", self.uv, 2, rows)
        vars(self).update(vertices=vertices, faces=np.ascontiguousarray(faces, np.int32), normals=normals, uv=uv)

    @property
    def triangles(self) -> int:
        """Number of triangles F."""
        return len(self.faces)

    @cached_property
    def bounds(self) -> tuple[Floats, Floats]:
        """Least and largest coordinates of the triangles, (3,) each; vertices without a triangle do not count."""
        used = np.zeros(len(self.vertices), bool)
        used[self.faces] = True
        corners = self.vertices[used]
        return corners.min(axis=0), corners.max(axis=0)

    @cached_property
    def edges(self) -> tuple[float, float]:
        """Smallest and largest of the longest edges of the triangles; points, which have none, do not count."""
        smallest, largest = np.inf, 0.0
        for begin in range(0, len(self.faces), _FACES_PER_BLOCK):
            square = _longest(*(self.vertices[self.faces[begin : begin + _FACES_PER_BLOCK, k]] for k in range(3)))
            largest = max(largest, float(square.max()))
            smallest = min(smallest, float(square.min(initial=np.inf, where=square > 0)))
        return (np.sqrt(smallest), np.sqrt(largest)) if largest else (0.0, 0.0)

    def transformed(self, matrix: npt.ArrayLike) -> Mesh:
        """Move the mesh by an affine 4x4 `matrix`: points by the matrix, normals by its inverse transpose.

        The order of the corners in a face stays, so under a mirror (negative determinant) geometric normals change
        sides and shading normals do not. Where that matters, as in pbrt, reverse the corners: ``faces[:, ::-1]``.
        """
        m = np.asarray(matrix, np.float64)
        if m.shape != (4, 4) or not np.isfinite(m).all() or not np.array_equal(m[3], (0, 0, 0, 1)):
            raise ValueError(f"matrix must be finite, 4x4, with last row 0 0 0 1, an affine map; got {m.tolist()}")
        if np.linalg.cond(m[:3, :3]) > 1e12:
            raise ValueError(f"matrix must be invertible, because normals need the inverse; got {m.tolist()}")
        normals = None if self.normals is None else self.normals @ np.linalg.inv(m[:3, :3])
        return Mesh(self.vertices @ m[:3, :3].T + m[:3, 3], self.faces, normals, self.uv)


def concatenate(meshes: Sequence[Mesh]) -> Mesh:
    """Join `meshes`, at least one. Beside a smooth mesh a flat one gets its face normals; missing uv become 0."""
    if not meshes:
        raise ValueError("meshes must hold at least one mesh, because a mesh has triangles; got none")
    normals = uv = None
    if any(m.normals is not None for m in meshes):
        meshes = [_with_face_normals(m) if m.normals is None else m for m in meshes]
        normals = np.concatenate([m.normals for m in meshes if m.normals is not None])
    if any(m.uv is not None for m in meshes):
        uv = np.concatenate([np.zeros((len(m.vertices), 2)) if m.uv is None else m.uv for m in meshes])
    first = np.cumsum([0, *(len(m.vertices) for m in meshes)])
    faces = np.concatenate([m.faces + start for m, start in zip(meshes, first)])
    return Mesh(np.concatenate([m.vertices for m in meshes]), faces, normals, uv)


def have_area(mesh: Mesh) -> npt.NDArray[np.bool_]:
    """Return whether triangles have an area, up to rounding, (F,): no ray hits others."""
    a, b, c = (mesh.vertices[mesh.faces[:, k]] for k in range(3))
    return np.asarray(np.linalg.norm(np.cross(b - a, c - a), axis=1) > 1e-12 * _longest(a, b, c))


def _longest(a: Floats, b: Floats, c: Floats) -> Floats:
    """Return the squared length of the longest edge of triangles with the corners `a`, `b`, `c` (F, 3), (F,)."""
    return np.maximum.reduce([np.einsum("fc,fc->f", e, e) for e in (b - a, c - b, a - c)])


def _with_face_normals(mesh: Mesh) -> Mesh:
    """Return the mesh with three vertices per triangle and the normals of the faces."""
    corner = mesh.faces.ravel()
    normals = np.repeat(flat_normals(mesh.vertices, mesh.faces), 3, axis=0)
    uv = None if mesh.uv is None else mesh.uv[corner]
    return Mesh(mesh.vertices[corner], np.arange(len(corner)).reshape(-1, 3), normals, uv)


def flat_normals(vertices: Floats, faces: Ints) -> Floats:
    """Return unit geometric normals (F, 3) of `faces` (F, 3); +z for a face without area, which nothing can hit."""
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    return unit(np.cross(b - a, c - a))


def vertex_normals(vertices: Floats, faces: Ints) -> Floats:
    """Return unit normals (V, 3): at each vertex the mean of its faces' normals, weighted by their angles there.

    Faces without area count for nothing. A vertex without any other face gets +z.
    """
    corner = vertices[faces]
    ahead, behind = np.roll(corner, -1, axis=1) - corner, np.roll(corner, 1, axis=1) - corner
    cross = np.cross(ahead[:, 0], behind[:, 0])
    area = np.linalg.norm(cross, axis=1)
    angle = np.arctan2(area[:, None], (ahead * behind).sum(axis=2))
    angle[area <= 1e-14 * (ahead**2).sum(axis=2).max(axis=1)] = 0
    weighted = angle[:, :, None] * unit(cross)[:, None]
    total = [np.bincount(faces.ravel(), weighted[:, :, k].ravel(), len(vertices)) for k in range(3)]
    return unit(np.stack(total, axis=1))


def repair_normals(vertices: Floats, faces: Ints, normals: Floats) -> Floats:
    """Return `normals` (V, 3) with zeros and NaN, which exporters write, replaced by means of the faces' normals.

    The replacements are on the side of the other normals, whatever the winding.
    """
    invalid = np.asarray(~(np.isfinite(normals).all(axis=1) & normals.any(axis=1)))[:, None]
    if not invalid.any():
        return normals
    valid_normals = np.where(invalid, 0, normals)
    against = np.einsum("fkc,fc->f", valid_normals[faces], flat_normals(vertices, faces)) < 0
    return np.where(invalid, vertex_normals(vertices, np.where(against[:, None], faces[:, ::-1], faces)), normals)


def weld(points: Floats) -> npt.NDArray[np.intp]:
    """Return, for each point, the index of the first point at the same place, up to a billionth of their extent."""
    step = max(1.0007e-9 * float(np.ptp(points, axis=0).max()), 1e-300)
    _, first, inverse = np.unique(np.rint(points / step), axis=0, return_index=True, return_inverse=True)
    return first[inverse.ravel()]


def unit(vectors: Floats) -> Floats:
    """Return `vectors` (N, 3) scaled to unit length; zero vectors become +z."""
    length = np.linalg.norm(vectors, axis=1, keepdims=True)
    return np.where(length > 0, vectors / np.where(length > 0, length, 1), (0.0, 0.0, 1.0))


def table(name: str, value: npt.ArrayLike, columns: int, rows: int | None = None) -> Floats:
    """Return `value` as float64 of shape (rows, columns); a ValueError unless all is finite and within `FARTHEST`."""
    table = np.ascontiguousarray(value, np.float64)
    if table.ndim != 2 or table.shape[1] != columns or rows not in (None, len(table)):
        shape = f"(V, {columns})" if rows is None else f"({rows}, {columns}), a row for each vertex"
        raise ValueError(f"{name} must have shape {shape}; got {table.shape}")
    near = (np.abs(table) <= FARTHEST).all(axis=1)
    if not near.all():
        row = int(np.argmin(near))
        rule = f"finite, within {FARTHEST:g} of 0, because they become float32"
        raise ValueError(f"{name} must be {rule}; got {table[row].tolist()} in row {row}")
    return table
