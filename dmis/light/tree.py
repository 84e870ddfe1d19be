"""Selection of one of many lights by a light tree: near, bright pieces that face the receiver are selected most.

A node of the tree bounds the light below it: by a sphere, a cone of normals and an intensity. A light sample descends
from the root and goes to one of four children in proportion to the child's importance for the receiver, a point p with
the normal n, as in Conty Estevez and Kulla 2018, with bounds of the cosines that need no angles::

    I min(x, d) min(y, d) / d^4,    x = max(d s - a . t + r, 0),    y = max(n . t + r, 0)

t leads from p to the centre of the sphere and has the length d, at least the radius r; I is the intensity, a the axis
of the cone and s = 2 sin(h / 2) with its half angle h. For h = r = 0 the two factors are the cosines at the lamp and at
p. A turn by h adds at most s to a cosine, a step by r at most r / d, so a node has the importance 0 only if no light
from it can arrive.

The tree is complete. Pieces that are close and face the same side follow each other in an order whose quarters, their
quarters and so on are its nodes (`dmis.light.triangle_order.halved_order`), so a whole batch descends as many levels,
and the digits of a piece's place to the base 4 are its way from the root. At each level the
uniform number is stretched to the interval of the chosen child, so that low-discrepancy points stay so.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from dmis.base.vectors import TINY, Array, Index, dot
from dmis.light.pieces import SPHERE, Pieces
from dmis.light.triangle_order import halved_order

BLOCK = 8192
"""Points that descend at a time: their arrays stay in the cache."""
MARGIN = 1e-3
"""Relative margin of radii, and margin of cones in radians: rounding must not lose a piece that sends light."""
Bounds = tuple[Array, Array, Array, Array, Array]
"""Bounds of M nodes: least and largest coordinates ``(M, 3)``, axis ``(M, 3)``, half angle and intensity ``(M,)``."""


class TreeSelection:
    """Selection by a light tree, see `dmis.light.selection.Selection`."""

    def __init__(self, pieces: Pieces) -> None:
        bounds = _piece_bounds(pieces)
        count = len(pieces.area)
        order = halved_order((bounds[0] + bounds[1]) / 2, bounds[2], np.ones(count))
        places = 4 ** (((count - 1).bit_length() + 1) // 2)
        self._place = np.empty(count, np.int64)
        self._place[order] = ((np.arange(count) + 0.5) / count * places).astype(np.int64)
        self._piece = np.zeros(places, np.int64)
        self._piece[self._place] = np.arange(count)
        leaves = tuple(np.zeros((places, *values.shape[1:])) for values in bounds)
        for leaf, values in zip(leaves, bounds, strict=True):
            leaf[self._place] = values
        self._levels = list(_tables(leaves))[::-1]  # type: ignore[arg-type]

    def select(self, p: Array, ng: Array | None, u: Array) -> tuple[Index, Array, Array]:
        """See `dmis.light.selection.Selection.select`."""
        place, probability, rest = np.zeros(len(u), np.int64), np.ones(len(u), np.float32), u.copy()
        for block, receiver in _blocks(p, ng, len(u)):
            node, v = place[block], rest[block]
            for table in self._levels:
                edges = _edges(table, node, receiver)
                along = v * edges[4]
                child = (along >= edges[1]).astype(np.int64)
                child += along >= edges[2]
                child += along >= edges[3]
                low, width = _interval(edges, child)
                v[:] = (along - low) / np.maximum(width, TINY)
                probability[block] *= width / np.maximum(edges[4], TINY)
                node *= 4
                node += child
        return self._piece.take(place), probability, rest

    def probability(self, p: Array, ng: Array | None, piece: Index) -> Array:
        """See `dmis.light.selection.Selection.probability`."""
        place, probability = self._place.take(piece), np.ones(len(piece), np.float32)
        for block, receiver in _blocks(p, ng, len(piece)):
            for below, table in zip(range(len(self._levels))[::-1], self._levels, strict=True):
                child = place[block] >> 2 * below
                edges = _edges(table, child >> 2, receiver)
                probability[block] *= _interval(edges, child & 3)[1] / np.maximum(edges[4], TINY)
        return probability


def _blocks(p: Array, ng: Array | None, count: int) -> Iterator[tuple[slice, tuple[Array, Array | None]]]:
    """Yield parts of `count` points, and the points and normals of each, four times in a row: once for each child."""
    for begin in range(0, count, BLOCK):
        block = slice(begin, begin + BLOCK)
        yield block, (p[:, block].repeat(4, axis=1), None if ng is None else ng[:, block].repeat(4, axis=1))


def _edges(table: Array, node: Index, receiver: tuple[Array, Array | None]) -> Array:
    """Return the cumulative importance of the four children of each `node` ``(N,)`` from 0 on, ``(5, N)``."""
    importance = _importance(table.take(node, axis=1).view(np.float32), *receiver).reshape(-1, 4)
    edges = np.zeros((5, len(node)), np.float32)
    for k in range(4):
        np.add(edges[k], importance[:, k], out=edges[k + 1])
    return edges


def _interval(edges: Array, child: Index) -> tuple[Array, Array]:
    """Return the beginning and the width of the interval of a child, ``(N,)`` each."""
    at = child * edges.shape[1] + np.arange(edges.shape[1])
    low = edges.ravel().take(at)
    return low, edges.ravel().take(at + edges.shape[1]) - low


def _piece_bounds(pieces: Pieces) -> Bounds:
    """Return the bounds of pieces; one that emits to all sides has the half angle pi."""
    triangles, owner = pieces.proxies
    low, high = np.full((len(pieces.area), 3), np.inf), np.full((len(pieces.area), 3), -np.inf)
    np.minimum.at(low, owner, triangles.min(axis=1))
    np.maximum.at(high, owner, triangles.max(axis=1))
    everywhere = pieces.two_sided | (pieces.shape == SPHERE)
    axis = np.where(pieces.shape == SPHERE, np.array([[0.0], [0.0], [1.0]]), pieces.rows[9:]).T
    return low, high, axis, np.where(everywhere, np.pi, 0.0), pieces.intensity


def _tables(nodes: Bounds) -> Iterator[Array]:
    """Yield, level by level up to the root, the numbers of the four children of each of M nodes, ``(9, M)``.

    Numbers are the centre, r, a, s and I. Each entry is those of four children, float32, in one of complex128: NumPy
    gathers 16 bytes as fast as 4.
    """
    while len(nodes[0]) > 1:
        low, high, axis, angle, intensity = nodes
        radius = np.maximum((1 + MARGIN) / 2 * np.linalg.norm(high - low, axis=1), 1e-9)
        cone = np.minimum(angle + MARGIN, np.pi)
        rows = np.stack([*((low + high) / 2).T, radius, *axis.T, 2 * np.sin(cone / 2), intensity])
        yield rows.astype(np.float32, order="C").view(np.complex128)
        nodes = _parents(_parents(nodes))


def _parents(nodes: Bounds) -> Bounds:
    """Return the bounds of the parents of nodes, each of which has two that follow each other."""
    empty = nodes[4] == 0
    # an empty node has the bounds of the other one
    first, second = (
        tuple(np.where(_like(empty[k::2], x[k::2]), x[1 - k :: 2], x[k::2]) for x in nodes[:4]) for k in (0, 1)
    )
    cos = np.clip((first[2] * second[2]).sum(axis=1), -1, 1)
    between = np.arccos(cos)
    angle = (first[3] + between + second[3]) / 2
    # the axis of the cone around both, from the first towards the second
    turn, sine = np.clip(angle - first[3], 0, between), np.maximum(np.sin(between), 1e-9)
    axis = (np.sin(between - turn) / sine)[:, None] * first[2] + (np.sin(turn) / sine)[:, None] * second[2]
    for large, small in ((first, second), (second, first)):
        inside = between + small[3] <= large[3]
        axis, angle = np.where(inside[:, None], large[2], axis), np.where(inside, large[3], angle)
    axis = np.where(sine[:, None] > 1e-6, axis, first[2])
    angle = np.where(sine > 1e-6, angle, np.where(cos > 0, np.maximum(first[3], second[3]) + 1e-6, np.pi))
    axis /= np.maximum(np.linalg.norm(axis, axis=1, keepdims=True), 1e-300)
    low, high = np.minimum(first[0], second[0]), np.maximum(first[1], second[1])
    return low, high, axis, np.minimum(angle, np.pi), nodes[4][::2] + nodes[4][1::2]


def _like(mask: Array, values: Array) -> Array:
    """Return a mask ``(M,)`` that broadcasts to `values` ``(M,)`` or ``(M, 3)``."""
    return mask if values.ndim == 1 else mask[:, None]


def _importance(rows: Array, p: Array, ng: Array | None) -> Array:
    """Return the importance of nodes with the numbers `rows` ``(9, M)`` by the formula of this module, ``(M,)``."""
    radius = rows[3]
    to = rows[:3] - p
    distance = np.sqrt(dot(to, to))
    farthest = np.maximum(distance, radius)
    # x
    importance = distance * rows[7]
    importance -= dot(rows[4:7], to)
    importance += radius
    np.maximum(importance, 0, out=importance)
    np.minimum(importance, farthest, out=importance)
    over_square = 1 / (farthest * farthest)
    if ng is None:
        importance *= farthest
    else:
        cosine = dot(ng, to)  # y
        cosine += radius
        np.maximum(cosine, 0, out=cosine)
        np.minimum(cosine, farthest, out=cosine)
        importance *= cosine
    importance *= over_square
    importance *= over_square
    importance *= rows[8]
    return importance
