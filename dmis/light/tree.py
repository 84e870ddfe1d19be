"""Selection of one of many lights by a light tree: near, bright pieces that face the receiver are selected most.

A node of the binary tree bounds the light below it: by a sphere, a cone of normals and an intensity. A light sample
descends from the root and goes to either child in proportion to the child's importance for the receiver, a point p with
the normal n, as in Conty Estevez and Kulla 2018, with bounds of the cosines that need no angles::

    I min(x, d) min(y, d) / d^4,    x = max(d s - a . t + r, 0),    y = max(n . t + r, 0)

t leads from p to the centre of the sphere and has the length d, at least the radius r; I is the intensity, a the axis
of the cone and s = 2 sin(h / 2) with its half angle h. For h = r = 0 the two factors are the cosines at the lamp and at
p. A turn by h adds at most s to a cosine, a step by r at most r / d, so a node has the importance 0 only if no light
from it can arrive.

The tree is complete. Pieces that are close and face the same side follow each other in an order whose halves, quarters
and so on are its nodes (`dmis.light.triangle_order.halved_order`), so a whole batch descends as many levels, both
children of a node are one row of a table, and the bits of a piece's place are its way from the root. At each level the
uniform number is stretched to the interval of the chosen child, so that low-discrepancy points stay so.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from dmis.base.vectors import TINY, Array, Index, columns
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
        depth = (count - 1).bit_length()
        self._place = np.empty(count, np.int64)
        self._place[order] = ((np.arange(count) + 0.5) / count * 2**depth).astype(np.int64)
        self._piece = np.zeros(2**depth, np.int64)
        self._piece[self._place] = np.arange(count)
        leaves = tuple(np.zeros((2**depth, *values.shape[1:])) for values in bounds)
        for leaf, values in zip(leaves, bounds, strict=True):
            leaf[self._place] = values
        self._levels = list(_tables(leaves))[::-1]  # type: ignore[arg-type]

    def select(self, p: Array, ng: Array | None, u: Array) -> tuple[Index, Array, Array]:
        """See `dmis.light.selection.Selection.select`."""
        place, probability, rest = np.zeros(len(u), np.int64), np.ones(len(u), np.float32), u.copy()
        for begin in range(0, len(u), BLOCK):
            block = slice(begin, begin + BLOCK)
            node, v, receiver = place[block], rest[block], (p[:, block], None if ng is None else ng[:, block])
            for table in self._levels:
                left, total = _left_and_total(table, node, receiver)
                below = v * total
                right = (below >= left) & (left < total)
                # the child's interval is [0, left) or [left, total)
                below -= left * right
                width = np.where(right, total - left, left)
                v[:] = below / np.maximum(width, TINY)
                probability[block] *= width / np.maximum(total, TINY)
                node += node
                node += right
        return self._piece.take(place), probability, rest

    def probability(self, p: Array, ng: Array | None, piece: Index) -> Array:
        """See `dmis.light.selection.Selection.probability`."""
        place, probability = self._place.take(piece), np.ones(len(piece), np.float32)
        for begin in range(0, len(piece), BLOCK):
            block = slice(begin, begin + BLOCK)
            receiver = (p[:, block], None if ng is None else ng[:, block])
            for above, table in zip(range(len(self._levels))[::-1], self._levels, strict=True):
                left, total = _left_and_total(table, place[block] >> (above + 1), receiver)
                width = np.where((place[block] >> above) & 1, total - left, left)
                probability[block] *= width / np.maximum(total, TINY)
        return probability


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
    """Yield, level by level up to the root, the rows of both children of each node, ``(M, 18)`` float32.

    A row has the centre and r of the left child, a, s and I; then those of the right one.
    """
    while len(nodes[0]) > 1:
        low, high, axis, angle, intensity = nodes
        radius = (1 + MARGIN) / 2 * np.linalg.norm(high - low, axis=1)
        cone = np.minimum(angle + MARGIN, np.pi)
        numbers = (np.maximum(radius, 1e-9), *axis.T, 2 * np.sin(cone / 2), intensity)
        table = np.stack([*((low + high) / 2).T, *numbers], axis=1).astype(np.float32)
        yield table.reshape(-1, 18)
        nodes = _parents(nodes)


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


def _left_and_total(table: Array, node: Index, receiver: tuple[Array, Array | None]) -> tuple[Array, Array]:
    """Return the importance of the left child of each `node` ``(N,)``, and of both children, ``(N,)``."""
    left, right = _importance(table, node, *receiver)
    return left, left + right


def _importance(table: Array, node: Index, p: Array, ng: Array | None) -> Array:
    """Return the importance of both children of each `node` ``(N,)``, ``(2, N)``: by the formula of this module."""
    rows = (columns(table, node) if len(table) > 1 else table.T).reshape(2, 9, -1)
    radius = rows[:, 3]
    to = rows[:, :3] - p
    distance2 = _dot(to, to)
    distance = np.sqrt(distance2)
    farthest = np.maximum(distance, radius)
    # x
    importance = distance * rows[:, 7]
    importance -= _dot(rows[:, 4:7], to)
    importance += radius
    np.maximum(importance, 0, out=importance)
    np.minimum(importance, farthest, out=importance)
    over_square = 1 / (farthest * farthest)
    if ng is None:
        importance *= farthest
    else:
        cosine = _dot(ng, to)  # y
        cosine += radius
        np.maximum(cosine, 0, out=cosine)
        np.minimum(cosine, farthest, out=cosine)
        importance *= cosine
    importance *= over_square
    importance *= over_square
    importance *= rows[:, 8]
    return importance


def _dot(a: Array, b: Array) -> Array:
    """Return the dot products of vectors ``(2, 3, N)`` or ``(3, N)`` and `b` ``(2, 3, N)``, ``(2, N)``."""
    product = a[..., 0, :] * b[:, 0]
    product += a[..., 1, :] * b[:, 1]
    product += a[..., 2, :] * b[:, 2]
    return product
