"""Loop subdivision to the limit surface: one sparse matrix per level, no loop over vertices.

Sources: C. Loop, *Smooth Subdivision Surfaces Based on Triangles*, 1987; limit and tangent masks of H. Hoppe et al.,
*Piecewise Smooth Surface Reconstruction*, 1994, in the form of M. Pharr and G. Humphreys, *Physically Based Rendering*,
second edition, section 3.7, with the vertex weight 3/(8n).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from dmis.base.validate import whole
from dmis.base.vectors import Floats
from dmis.geometry.mesh import Mesh, unit, vertex_normals

MAX_SUBDIVIDED = 2**24
"""Most triangles that :func:`loop_subdivide` makes: it needs some 8 GB for them."""


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
        Number of refinements, >= 0. The result has F·4^levels triangles, at most `MAX_SUBDIVIDED`, wound like `faces`.

    A ValueError if `levels` is out of range, or the faces are not such manifolds; it names the edge or the vertex.
    """
    cage = Mesh(np.asarray(vertices, np.float64), np.asarray(faces))
    levels = whole("levels", levels, 0)
    if levels > 12 or cage.triangles * 4**levels > MAX_SUBDIVIDED:  # 4**12 is the limit
        rule = f"at most {MAX_SUBDIVIDED} triangles, because each makes four of one"
        raise ValueError(f"levels must leave {rule}; got {levels} for {cage.triangles} triangles")
    points = cage.vertices
    net = _half_edges(cage.faces.astype(np.int64), len(cage.vertices))
    for _ in range(levels):
        rule, net = _refine(net)
        points = rule @ points
    points = _vertex_rule(net, 1 / (net.valence + 3 / (8 * _beta(net.valence))), 1 / 5) @ points
    return Mesh(points, net.faces, _limit_normals(points, net))


@dataclass(frozen=True, eq=False)
class _HalfEdges:
    """Half-edges of a mesh: half-edge 3f + k runs from corner k of face f, its tail, to the next corner, its head.

    Its twin runs back along the same edge in the neighbouring face, and is -1 at the boundary. The valence of a vertex
    is the number of its neighbours; `rim` says which vertices lie on the boundary.
    """

    faces: npt.NDArray[np.int64]
    twin: npt.NDArray[np.int64]
    tail: npt.NDArray[np.int64]
    head: npt.NDArray[np.int64]
    valence: npt.NDArray[np.int64]
    rim: npt.NDArray[np.bool_]

    def places(self) -> npt.NDArray[np.int64]:
        """Return the place 0, 1, … of each half-edge about its tail, counter-clockwise; -1 in a second fan of faces.

        All vertices turn at once, one half-edge per step. On the boundary the first half-edge has no twin.
        """
        start = np.full(len(self.valence), -1)
        edge = np.flatnonzero(self.twin < 0)
        start[self.tail] = np.arange(len(self.tail))
        start[self.tail[edge]] = edge
        place = np.full(len(self.tail), -1)
        now = start[start >= 0]
        step = 0
        while len(now):
            place[now] = step
            now = self.twin[np.where(now % 3 == 0, now + 2, now - 1)]
            now = now[now >= 0]
            now, step = now[place[now] < 0], step + 1
        return place


def _half_edges(faces: npt.NDArray[np.int64], count: int) -> _HalfEdges:
    """Build the half-edges of `faces` between `count` vertices; raise a ValueError if it is no oriented manifold."""
    tail, head = faces.ravel(), _turn(faces, 1)
    if (tail == head).any():
        face = int(np.argmax(tail == head)) // 3
        raise ValueError(f"faces must have three different corners; got {faces[face].tolist()} in face {face}")
    forth, back = tail * count + head, head * count + tail
    order = np.argsort(forth)
    ordered = forth[order]
    twice = ordered[1:][ordered[1:] == ordered[:-1]]
    if len(twice):
        edge = divmod(int(twice[0]), count)
        rule = "meet at most two at an edge, and run through it in opposite directions"
        raise ValueError(f"faces must {rule}; not so at edge {edge}")
    place = np.searchsorted(ordered, back).clip(max=len(order) - 1)
    twin = np.where(ordered[place] == back, order[place], -1)
    rim = np.zeros(count, np.bool_)
    rim[tail[twin < 0]] = True
    net = _HalfEdges(faces, twin, tail, head, np.bincount(tail, minlength=count) + rim, rim)
    loose = net.places() < 0
    if loose.any():
        vertex = int(tail[np.argmax(loose)])
        raise ValueError(f"faces must form a single fan around a vertex, its ring; got several at vertex {vertex}")
    return net


def _turn(faces: npt.NDArray[np.int64], steps: int) -> npt.NDArray[np.int64]:
    """Return the corner that is `steps` further in its face, for each corner of all faces, (3F,)."""
    return np.roll(faces, -steps, axis=1).ravel()


def _beta(valence: npt.NDArray[np.int64]) -> Floats:
    """Return Loop's weight of each neighbour of an interior vertex."""
    return np.where(valence == 3, 3 / 16, 3 / (8 * np.maximum(valence, 1)))


def _vertex_rule(net: _HalfEdges, inside: Floats, boundary: float) -> Any:
    """Return the sparse matrix (V, V) that weights neighbours by `inside` (V,), two on the boundary by `boundary`."""
    import scipy.sparse as sp  # imported where used: it takes a third of a second

    ring = ~net.rim[net.tail]
    edge = net.twin < 0
    count = len(net.valence)
    a, b = net.tail[edge], net.head[edge]
    row, column = np.concatenate([net.tail[ring], a, b]), np.concatenate([net.head[ring], b, a])
    weight = np.concatenate([inside[net.tail[ring]], np.full(2 * len(a), boundary)])
    others = sp.csr_array((weight, (row, column)), (count, count))
    return others + sp.diags_array(1 - others.sum(axis=1))


def _refine(net: _HalfEdges) -> tuple[Any, _HalfEdges]:
    """Return the sparse matrix (V + E, V) from points to those of the next level, and the half-edges of that level."""
    import scipy.sparse as sp  # imported where used: it takes a third of a second

    faces = net.faces
    twin = net.twin
    count = len(net.valence)
    edge = net.twin < 0
    owner = edge | (np.arange(len(twin)) < twin)  # one half-edge of each edge, which gets its number from it
    number = np.cumsum(owner) - 1
    number = np.where(owner, number, number[twin])
    edges = int(owner.sum())
    ring = ~edge
    row = np.concatenate([number[ring], number[ring], number[edge], number[edge]])
    column = np.concatenate([net.tail[ring], _turn(faces, 2)[ring], net.tail[edge], net.head[edge]])
    weight = np.repeat([3 / 8, 1 / 8, 1 / 2], [ring.sum(), ring.sum(), 2 * edge.sum()])
    on_edges = sp.csr_array((weight, (row, column)), (edges, count))
    rule = sp.vstack([_vertex_rule(net, _beta(net.valence), 1 / 8), on_edges], format="csr")

    # A face with corners v and middles of edges m becomes (v_k, m_k, m_k-1) for k = 0, 1, 2, and (m_0, m_1, m_2).
    middle = (count + number).reshape(-1, 3)
    corner = np.stack([faces, middle, np.roll(middle, 1, axis=1)], axis=2)
    children = np.concatenate([corner, middle[:, None]], axis=1).reshape(-1, 3)
    valence = np.concatenate([net.valence, np.where(edge[owner], 4, 6)])
    rim = np.concatenate([net.rim, edge[owner]])
    return rule, _HalfEdges(children, _twins_of_children(twin), children.ravel(), _turn(children, 1), valence, rim)


def _twins_of_children(twin: npt.NDArray[np.int64]) -> npt.NDArray[np.int64]:
    """Return the twins (12F,) of the half-edges of the four children of each face, of the twins (3F,) of the faces.

    Half-edge h = 3f + k has two halves: half-edge 0 of child k, and half-edge 2 of child k + 1 of face f. In between,
    half-edge 1 of child k + 1 is the twin of half-edge k of child 3.
    """
    face, k = np.divmod(np.arange(len(twin)), 3)
    first, second = 12 * face + 3 * k, 12 * face + 3 * ((k + 1) % 3) + 2
    inner, centre = second - 1, 12 * face + 9 + k
    twins = np.full(4 * len(twin), -1)
    twins[inner], twins[centre] = centre, inner
    shared = twin >= 0
    twins[first[shared]], twins[second[shared]] = second[twin[shared]], first[twin[shared]]
    return twins


def _limit_normals(points: Floats, net: _HalfEdges) -> Floats:
    """Return unit normals S x T (V, 3) at the limit `points` (V, 3); S + i T is a sparse matrix times `points`."""
    import scipy.sparse as sp  # imported where used: it takes a third of a second

    edge = net.twin < 0
    a, b = net.tail[edge], net.head[edge]  # a ends the ring of b, but no half-edge of b goes there
    row, column = np.concatenate([net.tail, b]), np.concatenate([net.head, a])
    place = np.concatenate([net.places(), net.valence[b] - 1])
    weight = _tangent_masks(int(net.valence.max()))[net.rim[row].astype(np.int64), net.valence[row], place]
    rule = sp.csr_array((weight, (row, column)), (len(points), len(points)))
    tangents = rule @ points - rule.sum(axis=1)[:, None] * points
    normals = np.cross(tangents.real, tangents.imag)
    flat = np.linalg.norm(normals, axis=1) <= 1e-9 * (np.abs(tangents) ** 2).sum(axis=1)  # a ring without extent
    if flat.any():
        normals[flat] = vertex_normals(points, net.faces)[flat]
    return unit(normals)


def _tangent_masks(valence: int) -> npt.NDArray[np.complex128]:
    """Return weights S + i T of ring points r_k: [0, n, k] inside and [1, n, k] on the boundary, n up to `valence`.

    Inside they are cos(2πk/n) and sin(2πk/n). On the boundary r_0 and r_n-1 are the boundary neighbours; S is along it,
    T points inwards. What is missing to a sum of 0 is the weight of the vertex itself.
    """
    n, k = np.arange(valence + 1)[:, None], np.arange(valence + 1)
    inside = np.exp(2j * np.pi * k / np.maximum(n, 1))
    theta = np.pi / np.maximum(n - 1, 1)
    end = (k == 0) | (k == n - 1)
    inwards = np.where(end, -np.sin(theta), 2 * (1 - np.cos(theta)) * np.sin(k * theta))
    for few, at_end, between in ((2, 1, 0), (3, 0, 1), (4, -1, 2)):
        inwards[few : few + 1] = np.where(end, at_end, between)[few : few + 1]
    return np.stack([inside, (k == 0) * 1.0 - (k == n - 1) + 1j * inwards])
