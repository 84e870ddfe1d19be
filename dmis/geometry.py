"""Triangle meshes: read from files, subdivided, tessellated and moved.

Everything that a ray can hit is in the end a :class:`Mesh` in world space. Files come in through trimesh, which is left
behind at once for plain arrays. Smooth surfaces become triangles here: Loop subdivision to its limit surface, bicubic
Bézier patches, and the quadrics of the pbrt format. Rays and materials are elsewhere, and so is the pbrt text; only the
meaning of its transforms and shape parameters is kept, so that a number in a scene file is a number here.

Tables of points are ``(n, 3)`` float64, row after row, because they are gathered by row. Units are the scene's, angles
are degrees.

Sources: C. Loop, *Smooth Subdivision Surfaces Based on Triangles*, 1987; limit and tangent masks of H. Hoppe et al.,
*Piecewise Smooth Surface Reconstruction*, 1994, in the form of M. Pharr and G. Humphreys, *Physically Based Rendering*,
second edition, section 3.7, with the vertex weight 3/(8n).
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt
import scipy.sparse as sp

if TYPE_CHECKING:
    import trimesh

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.integer[Any]]

FORMATS = (".glb", ".obj", ".ply", ".stl")
"""Extensions that :func:`load_mesh` reads."""
MAX_TRIANGLES = 2**24
"""Most triangles that :func:`loop_subdivide` makes: some 8 GB while it works."""


@dataclass(frozen=True, eq=False)
class Mesh:
    """Triangles in world space; arrays are checked and kept C-contiguous.

    Parameters
    ----------
    vertices
        Positions, (V, 3) float64, finite.
    faces
        Vertex indices, (F, 3) integers, kept as int32, F >= 1. The geometric normal of a face (a, b, c) is
        (b - a) x (c - a).
    normals
        Shading normals, (V, 3) float64, brought to unit length here; None for flat shading.
    uv
        Texture coordinates, (V, 2) float64, or None.

    Raises
    ------
    ValueError
        On a wrong shape, a number that is not finite, a zero normal, an index without a vertex.
    """

    vertices: Floats
    faces: Ints
    normals: Floats | None = None
    uv: Floats | None = None

    def __post_init__(self) -> None:
        vertices = _table("vertices", self.vertices, 3)
        rows = len(vertices)
        faces = np.asarray(self.faces)
        if faces.ndim != 2 or faces.shape[1] != 3 or not len(faces) or not np.issubdtype(faces.dtype, np.integer):
            raise ValueError(
                "faces must be integers of shape (F, 3), F >= 1, three vertex indices per triangle; "
                f"got shape {faces.shape} of {faces.dtype}"
            )
        if faces.min() < 0 or faces.max() >= rows:
            raise ValueError(
                f"faces must be indices from 0 to {rows - 1}, because there are {rows} vertices; "
                f"got {faces.min()} to {faces.max()}"
            )
        normals = None if self.normals is None else _table("normals", self.normals, 3, rows)
        if normals is not None:
            length = np.linalg.norm(normals, axis=1, keepdims=True)
            if not length.all():
                row = int(np.argmin(length))
                raise ValueError(f"normals must not be zero, because they give directions; got a zero in row {row}")
            normals = normals / length
        object.__setattr__(self, "vertices", vertices)
        object.__setattr__(self, "faces", np.ascontiguousarray(faces, np.int32))
        object.__setattr__(self, "normals", normals)
        object.__setattr__(self, "uv", None if self.uv is None else _table("uv", self.uv, 2, rows))

    @property
    def triangles(self) -> int:
        """Number of triangles F."""
        return len(self.faces)

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
        meshes = [_faceted(m) if m.normals is None else m for m in meshes]
        normals = np.concatenate([m.normals for m in meshes if m.normals is not None])
    if any(m.uv is not None for m in meshes):
        uv = np.concatenate([np.zeros((len(m.vertices), 2)) if m.uv is None else m.uv for m in meshes])
    first = np.cumsum([0, *(len(m.vertices) for m in meshes)])
    faces = np.concatenate([m.faces + start for m, start in zip(meshes, first)])
    return Mesh(np.concatenate([m.vertices for m in meshes]), faces, normals, uv)


def _faceted(mesh: Mesh) -> Mesh:
    """The same triangles with corners of their own, so that normals can be those of the faces."""
    corner = mesh.faces.ravel()
    normals = np.repeat(flat_normals(mesh.vertices, mesh.faces), 3, axis=0)
    uv = None if mesh.uv is None else mesh.uv[corner]
    return Mesh(mesh.vertices[corner], np.arange(len(corner)).reshape(-1, 3), normals, uv)


# Files


def from_trimesh(mesh: trimesh.Trimesh | trimesh.Scene) -> Mesh:
    """Take the arrays out of a trimesh object; the parts of a scene are placed by its graph and joined.

    Normals are taken only where the file gave them, since trimesh makes up missing ones on demand. Parts that the graph
    mirrors keep their outside, as glTF wants it. ValueError if there are no triangles.
    """
    import trimesh

    if isinstance(mesh, trimesh.Scene):
        parts = []
        for node in mesh.graph.nodes_geometry:
            matrix, name = mesh.graph[node]
            if isinstance(mesh.geometry[name], trimesh.Trimesh):
                part = from_trimesh(mesh.geometry[name]).transformed(matrix)
                mirrored = np.linalg.det(matrix[:3, :3]) < 0
                parts.append(Mesh(part.vertices, part.faces[:, ::-1], part.normals, part.uv) if mirrored else part)
        if not parts:
            raise ValueError("mesh must hold triangles, because only they can be hit; got a scene without any")
        return concatenate(parts)
    if not isinstance(mesh, trimesh.Trimesh) or not len(mesh.faces):
        raise ValueError(f"mesh must be a trimesh.Trimesh with faces, or a Scene of them; got {mesh!r}")
    vertices, faces, normals = np.asarray(mesh.vertices), np.asarray(mesh.faces), None
    if "vertex_normals" in mesh._cache:
        normals = np.array(mesh.vertex_normals)
        lost = ~(np.isfinite(normals).all(axis=1) & normals.any(axis=1))  # written by exporters at a loss
        if lost.any():
            normals[lost] = vertex_normals(vertices, faces)[lost]
    return Mesh(vertices, faces, normals, getattr(mesh.visual, "uv", None))


def load_mesh(path: str | os.PathLike[str], smooth: bool | None = None) -> Mesh:
    """Read a GLB, OBJ, PLY or STL file.

    Parameters
    ----------
    path
        The file; its extension names the format.
    smooth
        None: shading normals if the file has them. True: if it has none, make them, averaged over all faces that meet
        at a *position* (in STL no two faces share a vertex). False: leave them out.

    Raises
    ------
    FileNotFoundError
        If there is no such file.
    ValueError
        If the extension is unknown, or the file cannot be read or holds no triangles. Both messages name the file.
    """
    path = Path(path)
    suffix = path.suffix.lower()
    if suffix not in FORMATS:
        raise ValueError(f"mesh file {path} must have one of the extensions {' '.join(FORMATS)}; got {suffix!r}")
    if not path.is_file():
        raise FileNotFoundError(f"mesh file {path} does not exist")
    import trimesh

    try:
        loaded: Any = trimesh.load(path, process=False)  # process=True would merge and reorder vertices
        mesh = from_trimesh(loaded)
    except Exception as error:  # whatever trimesh's readers meet comes through
        reason = "it is empty" if path.stat().st_size == 0 else f"{type(error).__name__}: {error}"
        raise ValueError(f"mesh file {path} cannot be read as {suffix[1:].upper()}: {reason}") from error
    if smooth is None or smooth == (mesh.normals is not None):
        return mesh
    normals = None
    if smooth:
        same = _weld(mesh.vertices)
        normals = vertex_normals(mesh.vertices, same[mesh.faces])[same]
    return Mesh(mesh.vertices, mesh.faces, normals, mesh.uv)


# Transforms: 4x4 matrices that act on columns (x, y, z, 1)


def translate(offset: npt.ArrayLike) -> Floats:
    """Matrix that moves by `offset` (3,)."""
    m = np.eye(4)
    m[:3, 3] = _vector("offset", offset)
    return m


def scale(factors: npt.ArrayLike) -> Floats:
    """Matrix that scales x, y, z by `factors`, three numbers or one for all."""
    factors = np.asarray(factors, np.float64)
    return np.diag([*_vector("factors", np.full(3, factors) if factors.ndim == 0 else factors), 1.0])


def rotate(degrees: float, axis: npt.ArrayLike) -> Floats:
    """Matrix that turns about `axis` (3,), from x to y about z if `degrees` are positive."""
    x, y, z = a = _direction("axis", axis)
    sin, cos = np.sin(np.radians(degrees)), np.cos(np.radians(degrees))
    m = np.eye(4)
    m[:3, :3] = cos * np.eye(3) + (1 - cos) * np.outer(a, a) + sin * np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return m


def look_at(eye: npt.ArrayLike, at: npt.ArrayLike, up: npt.ArrayLike) -> Floats:
    """Matrix from world to camera, pbrt's ``LookAt``; camera space is x right, y up, z forward: left-handed.

    The columns of its inverse are x = up x z, y = z x x, z = at - eye, all of unit length, and the eye.
    """
    origin = _vector("eye", eye)
    z = _direction("at - eye", _vector("at", at) - origin)
    x = np.cross(_direction("up", up), z)
    if np.linalg.norm(x) < 1e-9:
        raise ValueError(f"up must not be parallel to the line of sight {z.tolist()}; got {up!r}")
    x /= np.linalg.norm(x)
    m = np.eye(4)
    m[:3, :3] = x, np.cross(z, x), z
    m[:3, 3] = -m[:3, :3] @ origin
    return m


# Normals


def flat_normals(vertices: Floats, faces: Ints) -> Floats:
    """Unit geometric normals (F, 3) of `faces` (F, 3); +z for a face without area, which nothing can hit."""
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    return _unit(np.cross(b - a, c - a))


def vertex_normals(vertices: Floats, faces: Ints) -> Floats:
    """Unit normals (V, 3): at each vertex the mean of the face normals, weighted by the angles of the faces there.

    Faces without area count for nothing. A vertex without any other face gets +z.
    """
    corner = vertices[faces]
    ahead, behind = np.roll(corner, -1, axis=1) - corner, np.roll(corner, 1, axis=1) - corner
    cross = np.cross(ahead[:, 0], behind[:, 0])
    area = np.linalg.norm(cross, axis=1)
    angle = np.arctan2(area[:, None], (ahead * behind).sum(axis=2))
    angle[area <= 1e-14 * (ahead**2).sum(axis=2).max(axis=1)] = 0
    weighted = angle[:, :, None] * _unit(cross)[:, None]
    total = [np.bincount(faces.ravel(), weighted[:, :, k].ravel(), len(vertices)) for k in range(3)]
    return _unit(np.stack(total, axis=1))


# Loop subdivision


def loop_subdivide(vertices: npt.ArrayLike, faces: npt.ArrayLike, levels: int) -> Mesh:
    """Refine a cage `levels` times, then push every vertex to the limit surface and give it its limit normal.

    A refinement takes 3/8 of both ends and 1/8 of both opposite corners for a new vertex on an edge, and moves an old
    vertex of valence n towards its ring with weight β for each neighbour: β = 3/(8n), or 3/16 for n = 3. On the
    boundary, a curve of its own, these are 1/2 and 1/8. The limit has weights 1/(n + 3/(8β)); on the boundary it takes
    1/5 of both neighbours as pbrt does, where the exact limit of the curve is 1/6.

    Parameters
    ----------
    vertices
        Control points, (V, 3). The first V vertices of the result are their limits.
    faces
        Triangles, (F, 3): manifolds, with or without boundary, all faces of each wound the same way.
    levels
        Number of refinements, >= 0. The result has F·4^levels triangles, at most ``MAX_TRIANGLES``, wound like `faces`.

    Raises
    ------
    ValueError
        If `levels` is out of range, or the faces are not such manifolds; the message names the edge or the vertex.
    """
    cage = Mesh(np.asarray(vertices, np.float64), np.asarray(faces))
    if cage.triangles * 4 ** _at_least("levels", levels, 0) > MAX_TRIANGLES:
        raise ValueError(
            f"levels must leave at most {MAX_TRIANGLES} triangles, because each makes four of one; "
            f"got {levels} for {cage.triangles} triangles"
        )
    points, net = cage.vertices, _half_edges(cage.faces.astype(np.int64), len(cage.vertices))
    for _ in range(levels):
        rule, net = _refine(net)
        points = rule @ points
    points = _vertex_rule(net, 1 / (net.valence + 3 / (8 * _beta(net.valence))), 1 / 5) @ points
    return Mesh(points, net.faces, _limit_normals(points, net))


@dataclass(frozen=True, eq=False)
class _HalfEdges:
    """Who meets whom. Half-edge 3f + k runs from corner k of face f, its tail, to the next corner, its head.

    Its twin runs back along the same edge in the neighbouring face, and is -1 at the boundary. The valence of a vertex
    is the number of its neighbours; `rim` says which vertices lie on the boundary.
    """

    faces: npt.NDArray[np.int64]
    twin: npt.NDArray[np.int64]
    tail: npt.NDArray[np.int64]
    head: npt.NDArray[np.int64]
    valence: npt.NDArray[np.int64]
    rim: npt.NDArray[np.bool_]

    @classmethod
    def of(cls, faces: npt.NDArray[np.int64], twin: npt.NDArray[np.int64], count: int) -> _HalfEdges:
        """Complete the record for `count` vertices."""
        tail, rim = faces.ravel(), np.zeros(count, np.bool_)
        rim[tail[twin < 0]] = True
        return cls(faces, twin, tail, _turn(faces, 1), np.bincount(tail, minlength=count) + rim, rim)

    def places(self) -> npt.NDArray[np.int64]:
        """Place 0, 1, … of each half-edge among those with its tail, counter-clockwise; -1 in a second fan of faces.

        All vertices turn at once, one half-edge per step. On the boundary the first half-edge has no twin.
        """
        start, edge = np.full(len(self.valence), -1), np.flatnonzero(self.twin < 0)
        start[self.tail] = np.arange(len(self.tail))
        start[self.tail[edge]] = edge
        place, now, step = np.full(len(self.tail), -1), start[start >= 0], 0
        while len(now):
            place[now] = step
            now = self.twin[np.where(now % 3 == 0, now + 2, now - 1)]
            now = now[now >= 0]
            now, step = now[place[now] < 0], step + 1
        return place


def _half_edges(faces: npt.NDArray[np.int64], count: int) -> _HalfEdges:
    """Find the twins of a cage with `count` vertices; refuse what is not an oriented manifold."""
    tail, head = faces.ravel(), _turn(faces, 1)
    if (tail == head).any():
        face = int(np.argmax(tail == head)) // 3
        raise ValueError(f"faces must have three different corners; got {faces[face].tolist()} in face {face}")
    forth, back = tail * count + head, head * count + tail
    order = np.argsort(forth)
    ordered = forth[order]
    twice = ordered[1:][ordered[1:] == ordered[:-1]]
    if len(twice):
        many = np.count_nonzero((forth == twice[0]) | (back == twice[0]))
        raise ValueError(
            f"faces must meet at most two at an edge and run through it in opposite directions, else there is no side; "
            f"got {many} faces at edge {divmod(int(twice[0]), count)}" + (" in one direction" if many == 2 else "")
        )
    found = np.searchsorted(ordered, back).clip(max=len(order) - 1)
    net = _HalfEdges.of(faces, np.where(ordered[found] == back, order[found], -1), count)
    loose = net.places() < 0
    if loose.any():
        vertex = int(tail[np.argmax(loose)])
        raise ValueError(f"faces must form a single fan around a vertex, its ring; got several at vertex {vertex}")
    return net


def _turn(faces: npt.NDArray[np.int64], steps: int) -> npt.NDArray[np.int64]:
    """For each corner of each face, flat, the corner `steps` further."""
    return np.roll(faces, -steps, axis=1).ravel()


def _beta(valence: npt.NDArray[np.int64]) -> Floats:
    """Loop's weight of each neighbour of an interior vertex."""
    return np.where(valence == 3, 3 / 16, 3 / (8 * np.maximum(valence, 1)))


def _vertex_rule(net: _HalfEdges, inside: Floats, boundary: float) -> Any:
    """Sparse (V, V): take `inside` (V,) of each neighbour or, on the boundary, `boundary` of its two; keep the rest."""
    ring, edge, count = ~net.rim[net.tail], net.twin < 0, len(net.valence)
    a, b = net.tail[edge], net.head[edge]
    row, column = np.concatenate([net.tail[ring], a, b]), np.concatenate([net.head[ring], b, a])
    weight = np.concatenate([inside[net.tail[ring]], np.full(2 * len(a), boundary)])
    others = sp.csr_array((weight, (row, column)), (count, count))
    return others + sp.diags_array(1 - others.sum(axis=1))


def _refine(net: _HalfEdges) -> tuple[Any, _HalfEdges]:
    """The sparse matrix (V + E, V) that takes points one level down, and who meets whom there."""
    faces, twin, count, edge = net.faces, net.twin, len(net.valence), net.twin < 0
    owner = edge | (np.arange(len(twin)) < twin)  # one half-edge of each edge, which gets its number from it
    number = np.cumsum(owner) - 1
    number = np.where(owner, number, number[twin])
    edges, ring = int(owner.sum()), ~edge
    row = np.concatenate([number[ring], number[ring], number[edge], number[edge]])
    column = np.concatenate([net.tail[ring], _turn(faces, 2)[ring], net.tail[edge], net.head[edge]])
    weight = np.repeat([3 / 8, 1 / 8, 1 / 2], [ring.sum(), ring.sum(), 2 * edge.sum()])
    on_edges = sp.csr_array((weight, (row, column)), (edges, count))
    rule = sp.vstack([_vertex_rule(net, _beta(net.valence), 1 / 8), on_edges], format="csr")

    # A face with corners v and middles of edges m becomes (v_k, m_k, m_k-1) for k = 0, 1, 2, and (m_0, m_1, m_2).
    middle = (count + number).reshape(-1, 3)
    corner = np.stack([faces, middle, np.roll(middle, 1, axis=1)], axis=2)
    children = np.concatenate([corner, middle[:, None]], axis=1).reshape(-1, 3)
    # Half-edge k was cut into side 0 of child k and side 2 of child k + 1, its twin the other way round;
    # side 1 of child k lies along side k - 1 of the child in the middle.
    first, k = 12 * np.arange(len(faces))[:, None], np.arange(3)
    start, end = (first + 3 * k).ravel(), (first + 3 * ((k + 1) % 3) + 2).ravel()
    inner, outer = (first + 3 * k + 1).ravel(), (first + 9 + (k + 2) % 3).ravel()
    twins = np.empty(4 * len(twin), np.int64)
    twins[start], twins[end] = np.where(edge, -1, end[twin]), np.where(edge, -1, start[twin])
    twins[inner], twins[outer] = outer, inner
    return rule, _HalfEdges.of(children, twins, count + edges)


def _limit_normals(points: Floats, net: _HalfEdges) -> Floats:
    """Unit normals S x T (V, 3) at the limit `points` (V, 3); one complex sparse matrix times these is S + i T."""
    edge = net.twin < 0
    a, b = net.tail[edge], net.head[edge]  # a ends the ring of b, but no half-edge of b goes there
    row, column = np.concatenate([net.tail, b]), np.concatenate([net.head, a])
    place = np.concatenate([net.places(), net.valence[b] - 1])
    weight = _tangent_masks(int(net.valence.max()))[net.rim[row].astype(np.int64), net.valence[row], place]
    rule = sp.csr_array((weight, (row, column)), (len(points), len(points)))
    tangents = rule @ points - rule.sum(axis=1)[:, None] * points
    normals = np.cross(tangents.real, tangents.imag)
    lost = np.linalg.norm(normals, axis=1) <= 1e-9 * (np.abs(tangents) ** 2).sum(axis=1)  # a ring without extent
    if lost.any():
        normals[lost] = vertex_normals(points, net.faces)[lost]
    return _unit(normals)


def _tangent_masks(valence: int) -> npt.NDArray[np.complex128]:
    """Weights S + i T of ring points r_k: [0, n, k] inside and [1, n, k] on the boundary, n up to `valence`.

    Inside they are cos(2πk/n) and sin(2πk/n). On the boundary r_0 and r_n-1 are the boundary neighbours; S is along it,
    T points inwards. What is missing to a sum of 0 is the weight of the vertex itself.
    """
    n, k = np.arange(valence + 1)[:, None], np.arange(valence + 1)
    inside = np.exp(2j * np.pi * k / np.maximum(n, 1))
    theta, end = np.pi / np.maximum(n - 1, 1), (k == 0) | (k == n - 1)
    inwards = np.where(end, -np.sin(theta), 2 * (1 - np.cos(theta)) * np.sin(k * theta))
    for few, at_end, between in ((2, 1, 0), (3, 0, 1), (4, -1, 2)):
        inwards[few : few + 1] = np.where(end, at_end, between)[few : few + 1]
    return np.stack([inside, (k == 0) * 1.0 - (k == n - 1) + 1j * inwards])


# Tessellation


def bezier_patches(control: npt.ArrayLike, divisions: int = 16) -> Mesh:
    """Tessellate bicubic Bézier patches, with analytic normals.

    Parameters
    ----------
    control
        Control points of P patches, (P, 4, 4, 3). u runs along axis 1, v along axis 2, and dp/du x dp/dv is outside.
    divisions
        Quads along a side of a patch, >= 1.

    Returns
    -------
    Mesh
        P·2·divisions² triangles, less those without area; uv are each patch's (u, v). Patches that share a boundary
        curve share its points to the last bit. Where a tangent vanishes, at a pole, the normal is the limit inside.
    """
    net = np.asarray(control, np.float64)
    if net.ndim != 4 or net.shape[1:] != (4, 4, 3) or not len(net) or not np.isfinite(net).all():
        raise ValueError(f"control must be finite, of shape (P, 4, 4, 3), P >= 1, 16 points a patch; got {net.shape}")
    t = np.linspace(0, 1, _at_least("divisions", divisions, 1) + 1)
    cubic = np.array([[1, 0, 0, 0], [-3, 3, 0, 0], [3, -6, 3, 0], [-1, 3, -3, 1]])  # Bernstein, row i for t^i
    power = np.vander(t, 4, increasing=True)
    basis = power @ cubic, power[:, :3] @ (cubic[1:] * [[1], [2], [3]]), power[:, :2] @ (cubic[2:] * [[2], [6]])

    def derivative(i: int, j: int) -> Floats:
        return np.einsum("ui,vj,pijk->puvk", basis[i], basis[j], net, optimize=True)

    pu, pv, puv = derivative(1, 0), derivative(0, 1), derivative(1, 1)
    normal = np.cross(pu, pv)
    # Where that vanishes, the direction in which it grows towards the inside of the patch.
    sign = np.where(t < 0.5, 1.0, -1.0)[:, None]
    growth = sign[:, None] * (np.cross(derivative(2, 0), pv) + np.cross(pu, puv))
    growth += sign * (np.cross(puv, pv) + np.cross(pu, derivative(0, 2)))
    length = np.linalg.norm(normal, axis=3, keepdims=True)
    least = 1e-9 * length.max(axis=(1, 2), keepdims=True)
    normal = np.where(length > least, normal, growth)
    normal[np.linalg.norm(normal, axis=3) <= least[..., 0]] = 0
    return _grid(derivative(0, 0), normal, np.stack(np.broadcast_arrays(t[:, None], t), axis=2))


def sphere(
    radius: float = 1,
    zmin: float | None = None,
    zmax: float | None = None,
    phimax: float = 360,
    segments: int = 256,
) -> Mesh:
    """The part of a sphere about the origin between heights `zmin` and `zmax`, up to azimuth `phimax`; normals out.

    `segments` quads go around a full circle. The heights default to the poles and are clamped to them. uv are pbrt's:
    azimuth, and polar angle from `zmin` to `zmax`.
    """
    low, high = -_positive("radius", radius) if zmin is None else zmin, radius if zmax is None else zmax
    bottom, top = (np.arccos(np.clip(z / radius, -1, 1)) for z in (low, high))
    if not bottom > top:
        raise ValueError(f"zmin must be below zmax on a sphere of radius {radius}, else it is empty; got {low}, {high}")
    phi, uv = _sweep(phimax, segments, max(1, segments // 2))
    theta = bottom + uv[..., 1] * (top - bottom)
    normal = np.stack([np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)], axis=2)
    return _grid(radius * normal, normal, uv)


def cylinder(radius: float = 1, zmin: float = -1, zmax: float = 1, phimax: float = 360, segments: int = 256) -> Mesh:
    """An open cylinder about the z axis, up to azimuth `phimax`; normals outwards; uv are pbrt's: azimuth, height."""
    _positive("radius", radius)
    if not zmin < zmax:
        raise ValueError(f"zmin must be below zmax, else the cylinder is empty; got {zmin}, {zmax}")
    phi, uv = _sweep(phimax, segments, 1)
    normal = np.stack([np.cos(phi), np.sin(phi), 0 * phi], axis=2)
    return _grid(radius * normal + [0, 0, zmin] + [0, 0, zmax - zmin] * uv[..., 1:], normal, uv)


def disk(
    height: float = 0, radius: float = 1, innerradius: float = 0, phimax: float = 360, segments: int = 256
) -> Mesh:
    """A flat disk or ring at z = `height`, up to azimuth `phimax`; normal +z; uv are pbrt's: azimuth, rim to centre."""
    if not 0 <= innerradius < _positive("radius", radius):
        raise ValueError(f"innerradius must be at least 0 and less than the radius {radius}; got {innerradius}")
    phi, uv = _sweep(phimax, segments, 1)
    r = radius + uv[..., 1] * (innerradius - radius)
    return _grid(np.stack([r * np.cos(phi), r * np.sin(phi), 0 * r + height], axis=2), None, uv)


def quad(corner: npt.ArrayLike, u: npt.ArrayLike, v: npt.ArrayLike) -> Mesh:
    """A flat parallelogram with sides `u`, `v` (3,) from `corner` (3,); normal u x v; uv (1, 1) is opposite."""
    corner, u, v = _vector("corner", corner), _vector("u", u), _vector("v", v)
    _direction("u x v", np.cross(u, v))
    uv = np.array([[[0.0, 0.0], [0.0, 1.0]], [[1.0, 0.0], [1.0, 1.0]]])
    return _grid(corner + uv[..., :1] * u + uv[..., 1:] * v, None, uv)


def _sweep(phimax: float, segments: int, rows: int) -> tuple[Floats, Floats]:
    """Azimuth (A, B) in radians and uv (A, B, 2) of a grid turned about the z axis."""
    if not 0 < phimax <= 360:
        raise ValueError(f"phimax must be above 0 and at most 360 degrees; got {phimax}")
    columns = int(np.ceil(_at_least("segments", segments, 3) * phimax / 360))
    uv = np.stack(np.meshgrid(np.linspace(0, 1, columns + 1), np.linspace(0, 1, rows + 1), indexing="ij"), axis=2)
    return np.radians(phimax) * uv[..., 0], uv


def _grid(points: Floats, normals: Floats | None, uv: Floats) -> Mesh:
    """Triangulate a grid of points (A, B, 3), or P of them (P, A, B, 3); outside is the first axis times the second.

    Points equal up to rounding become equal, so that nothing shines through; triangles that lose their area are
    dropped. A zero normal is replaced by that of the triangles.
    """
    index = np.arange(points.size // 3).reshape(-1, *uv.shape[:2])
    a, b, c, d = index[:, :-1, :-1], index[:, 1:, :-1], index[:, 1:, 1:], index[:, :-1, 1:]
    faces = np.stack([a, b, c, a, c, d], axis=3).reshape(-1, 3)
    points = points.reshape(-1, 3)
    same = _weld(points)
    corner = same[faces]
    faces = faces[(corner != np.roll(corner, 1, axis=1)).all(axis=1)]
    if normals is not None:
        normals = normals.reshape(-1, 3)
        normals = np.where(normals.any(axis=1, keepdims=True), normals, vertex_normals(points, faces))
    return Mesh(points[same], faces, normals, np.tile(uv.reshape(-1, 2), (len(index), 1)))


def _weld(points: Floats) -> npt.NDArray[np.intp]:
    """For each point the first one at the same place, up to a billionth of their extent."""
    step = max(1.0007e-9 * float(np.ptp(points, axis=0).max()), 1e-300)
    _, first, inverse = np.unique(np.rint(points / step), axis=0, return_index=True, return_inverse=True)
    return first[inverse.ravel()]


# Checks


def _unit(vectors: Floats) -> Floats:
    """Rows brought to unit length; zeros become +z."""
    length = np.linalg.norm(vectors, axis=1, keepdims=True)
    return np.where(length > 0, vectors / np.where(length > 0, length, 1), (0.0, 0.0, 1.0))


def _table(name: str, value: npt.ArrayLike, columns: int, rows: int | None = None) -> Floats:
    table = np.ascontiguousarray(value, np.float64)
    if table.ndim != 2 or table.shape[1] != columns or rows not in (None, len(table)):
        shape = f"(V, {columns})" if rows is None else f"({rows}, {columns}), a row for each vertex"
        raise ValueError(f"{name} must have shape {shape}; got {table.shape}")
    finite = np.isfinite(table).all(axis=1)
    if not finite.all():
        row = int(np.argmin(finite))
        raise ValueError(
            f"{name} must be finite, because Embree does not check; got {table[row].tolist()} in row {row}"
        )
    return table


def _vector(name: str, value: npt.ArrayLike) -> Floats:
    vector = np.array(value, np.float64)
    if vector.shape != (3,) or not np.isfinite(vector).all():
        raise ValueError(f"{name} must be three finite numbers; got {vector.tolist()}")
    return vector


def _direction(name: str, value: npt.ArrayLike) -> Floats:
    vector = _vector(name, value)
    if not vector.any():
        raise ValueError(f"{name} must not be zero, because it gives a direction; got {vector.tolist()}")
    return vector / np.linalg.norm(vector)


def _positive(name: str, value: float) -> float:
    if not 0 < value < np.inf:
        raise ValueError(f"{name} must be positive and finite; got {value}")
    return value


def _at_least(name: str, value: int, least: int) -> int:
    if not isinstance(value, int | np.integer) or value < least:
        raise ValueError(f"{name} must be an integer, at least {least}; got {value!r}")
    return int(value)
