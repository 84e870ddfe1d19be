"""Selection of one of many lights by nodes of a light tree: near, bright ones that face the receiver are selected most.

Pieces that are close and face the same side follow each other in an order whose halves, quarters and so on are the
nodes of a tree (`dmis.light.triangle_order.halved_order`). A light sample selects one of up to `NODES` nodes of one
level, and then one of its pieces in proportion to intensity. A node bounds the light of its pieces: by a sphere, a cone
of normals and an intensity. Its importance for receivers around a point p with normals around n is, as in Conty Estevez
and Kulla 2018, with bounds of the cosines that need no angles::

    I min(x, d) min(y, d) / d^4,    x = max(d s - a . t + r, 0),    y = max(n . t + r, 0)

t leads from p to the centre of the sphere and has the length d, at least r, the sum of the radii of the sphere and of
the receivers; I is the intensity, a the axis of the cone and s = 2 sin(h / 2) with its half angle h. For h = r = 0 the
two factors are the cosines at the lamp and at p. A turn by h adds at most s to a cosine, a step by r at most r / d, so
a node has the importance 0 only if no light from it can arrive.

All receivers in a cell of space and a bin of normals use the same importances, as in pbrt-v3 all in a voxel do. They
are computed when a receiver is in the cell for the first time, and kept as a table of slots, each of which belongs to a
node. A uniform number picks a slot; the probability of a node is its share of the slots, rounded but never to 0. Slots
of a node are neighbours, so low-discrepancy points stay so. A selection takes the same time for any number of nodes,
where a descent of the tree takes longer for more of them, and chooses worse near the root, whose bounds are wide.
"""

from __future__ import annotations

import threading
from collections.abc import Iterator

import numpy as np

from dmis.base.vectors import Array, Index, dot
from dmis.light.pieces import SPHERE, Pieces
from dmis.light.triangle_order import halved_order

NODES = 4096
"""Largest number of nodes; a table of as many takes 40 kB."""
MOST_TABLES = 2**13
"""Number of tables above which all are forgotten, and made again as needed."""
BLOCK = 4096
"""Receivers whose tables are looked up at a time."""
CELLS = 32
"""Cells along each axis: half of them divide the box around the lights, the others grow with the distance from it."""
BINS = 3
"""Bins of normals along each axis: a component is near -1, 0 or 1. A receiver without a normal is in bin (0, 0, 0)."""
BIN_FACTOR = np.float32(1.49)
"""Factor of a normal's components before they are rounded, for which the 26 bins of unit vectors have similar sizes."""
BIN_RADIUS = 0.54
"""Largest distance of a unit vector from the centre of its bin."""
BACK_WEIGHT = 0.1
"""Weight of light that arrives behind a surface with the normal at the centre of a bin, but before others of the bin.
"""
MARGIN = 1e-3
"""Relative margin of radii, and margin of cones in radians: rounding must not lose a piece that sends light."""
Tables = tuple[Array, Array]
"""M distributions of K outcomes: the outcome of each of S slots, ``(M, S)``, and outcomes' first slots, ``(M, K + 1)``.
"""


class TreeSelection:
    """Selection by nodes of a light tree, see `dmis.light.selection.FixedSelection`."""

    def __init__(self, pieces: Pieces) -> None:
        low, high, axis, angle = _piece_bounds(pieces)
        count = len(low)
        self._order = halved_order((low + high) / 2, axis, np.ones(count))
        nodes = min(count, NODES)
        node = ((np.arange(count) + 0.5) * nodes / count).astype(np.int64)
        self._first = np.flatnonzero(np.diff(node, prepend=-1))
        place = np.arange(count) - self._first[node]
        self._rows = _node_rows((low, high, axis, angle, pieces.intensity), self._order, self._first, node)
        self._node, self._place = np.empty((2, count), np.int64)
        self._node[self._order], self._place[self._order] = node, place
        weight = np.zeros((nodes, place.max() + 1))
        weight[node, place] = pieces.intensity[self._order]
        self._within = _slot_tables(weight, max(64, 4 * weight.shape[1]))
        box = low.min(axis=0), high.max(axis=0)
        self._centre = ((box[0] + box[1])[:, None] / 2).astype(np.float32)
        self._half = max(float((box[1] - box[0]).max()) / 2, 1e-15)
        self._lock = threading.Lock()
        self._forget()

    def select(self, p: Array, ng: Array | None, u: Array) -> tuple[Index, Array, Array]:
        """See `dmis.light.selection.FixedSelection.select`."""
        piece = np.empty(len(u), np.int64)
        probability = np.empty(len(u), np.float32)
        rest = np.empty(len(u))
        for block, cell, tables in self._cells(p, ng, len(u)):
            node, of_node, v = _pick(tables, cell, u[block])
            place, within, rest[block] = _pick(self._within, node, v)
            piece[block] = self._order.take(self._first.take(node) + place)
            probability[block] = of_node * within
        return piece, probability, rest

    def probability(self, p: Array, ng: Array | None, piece: Index) -> Array:
        """See `dmis.light.selection.FixedSelection.probability`."""
        node = self._node.take(piece)
        probability = np.empty(len(piece), np.float32)
        for block, cell, tables in self._cells(p, ng, len(piece)):
            probability[block] = _interval(tables, cell, node[block])[1] / np.float32(tables[0].shape[1])
        width = _interval(self._within, node, self._place.take(piece))[1]
        return probability * (width / np.float32(self._within[0].shape[1]))

    def _forget(self) -> None:
        """Begin without tables."""
        self._table = np.zeros((CELLS * BINS) ** 3, np.int32)  # number of each cell's table; 0: there is none yet
        self._tables = _slot_tables(np.zeros((1, len(self._first))), max(4096, 4 * len(self._first)))
        self._count = 1

    def _cells(self, p: Array, ng: Array | None, count: int) -> Iterator[tuple[slice, Index, Tables]]:
        """Yield parts of `count` receivers, the numbers of their tables, and all tables."""
        for begin in range(0, count, BLOCK):
            block = slice(begin, begin + BLOCK)
            cell = self._cell(p[:, block], None if ng is None else ng[:, block])
            with self._lock:
                table = self._table.take(cell)
                if not table.all():
                    new = np.unique(cell[table == 0])
                    if self._count + len(new) > MOST_TABLES:
                        self._forget()
                        new = np.unique(cell)
                    self._add(new)
                    table = self._table.take(cell)
                tables = self._tables
            yield block, table.astype(np.int64), tables

    def _cell(self, p: Array, ng: Array | None) -> Index:
        """Return the cells of receivers: of space, by ``z / (1 + |z|)`` in half sizes of the box, and of normals."""
        z = (p - self._centre) * np.float32(1 / self._half)
        z /= np.abs(z) + 1
        z *= np.float32(0.49999 * CELLS)
        z += np.float32(0.5 * CELLS)
        n = np.zeros((3, 1), np.float32) if ng is None else np.rint(ng * BIN_FACTOR)
        cell = np.zeros(p.shape[1], np.float32)
        for digits, base in ((np.floor(z), CELLS), (n + BINS // 2, BINS)):
            for digit in digits:
                cell *= base
                cell += digit
        return cell.astype(np.int64)

    def _add(self, cells: Index) -> None:
        """Add the tables of cells."""
        end = self._count + len(cells)
        if end > len(self._tables[0]):
            self._tables = tuple(  # type: ignore[assignment]
                np.concatenate([x, np.empty((min(2 * end, MOST_TABLES) - len(x), x.shape[1]), x.dtype)])
                for x in self._tables
            )
        for begin in range(0, len(cells), 16):
            part = cells[begin : begin + 16]
            new = _slot_tables(self._importance(part), self._tables[0].shape[1])
            for x, values in zip(self._tables, new, strict=True):
                x[self._count + begin : self._count + begin + len(part)] = values
        self._table[cells] = np.arange(self._count, end)
        self._count = end

    def _importance(self, cells: Index) -> Array:
        """Return the importance of K nodes for receivers of M cells, ``(M, K)``, by the formula of this module."""
        place = np.array(np.unravel_index(cells, 3 * (CELLS,) + 3 * (BINS,)), float)[..., None]
        q = (place[:3] + [0, 1] - 0.5 * CELLS) / (0.49999 * CELLS)
        q = np.clip(q, 1e-6 - 1, 1 - 1e-6)
        corners = q / (1 - np.abs(q)) * self._half + self._centre[..., None]
        size = np.linalg.norm(corners[..., 1] - corners[..., 0], axis=0)[:, None] / 2
        n = place[3:] - BINS // 2
        length = np.linalg.norm(n, axis=0)
        centre = self._rows[:3, None]
        axis = self._rows[3:6, None]
        radius, s, intensity = self._rows[6:]
        radius = radius + (1 + MARGIN) * size
        to = centre - corners.mean(axis=2, keepdims=True)
        distance = np.sqrt(dot(to, to))
        farthest = np.maximum(distance, radius)
        x = distance * s - dot(axis, to) + radius
        y = dot(n / np.maximum(length, 1), to) + radius
        # the cosine at a normal n' of the bin is n' . t / d <= n . t / d + |n' - n|; without a normal, all light counts
        y = np.maximum(y, np.where(length > 0, BACK_WEIGHT * (y + BIN_RADIUS * distance), distance))
        return intensity * np.clip(x, 0, farthest) * np.clip(y, 0, farthest) / farthest**4


def _slot_tables(weight: Array, slots: int) -> Tables:
    """Return distributions in proportion to weights ``(M, K)``, rounded; each that is not 0 has a slot at least."""
    positive = weight > 0
    total = np.maximum(weight.sum(axis=1, keepdims=True), 1e-300)
    shared = (slots - positive.sum(axis=1, keepdims=True)) / total
    first = np.zeros((len(weight), weight.shape[1] + 1), np.int64)
    first[:, 1:] = np.floor(np.cumsum(weight, axis=1) * shared + 0.5) + np.cumsum(positive, axis=1)
    number = np.diff(first)
    number[:, -1] += slots - first[:, -1]  # where all weights are 0, the slots are of an outcome of probability 0
    outcome = np.repeat(np.tile(np.arange(weight.shape[1]), len(weight)), number.ravel())
    return outcome.reshape(-1, slots).astype(np.uint16), first.astype(np.uint16)


def _pick(tables: Tables, table: Index, u: Array) -> tuple[Index, Array, Array]:
    """Return outcomes by the numbers `u` ``(N,)``, their probabilities, and the numbers stretched to [0, 1) again."""
    outcomes = tables[0].ravel()
    slots = tables[0].shape[1]
    along = u * slots
    outcome = outcomes.take(table * slots + along.astype(np.int64)).astype(np.int64)
    first, number = _interval(tables, table, outcome)
    # below 1, also where the probability is 0
    rest = np.minimum((along - first) / np.maximum(number, 1), 1 - 2.0**-40)
    return outcome, number * np.float32(1 / slots), rest


def _interval(tables: Tables, table: Index, outcome: Index) -> tuple[Array, Array]:
    """Return the first slots and the numbers of slots of outcomes, ``(N,)`` each."""
    first = tables[1].ravel()
    at = table * tables[1].shape[1] + outcome
    begin = first.take(at)
    return begin, first.take(at + 1) - begin


def _piece_bounds(pieces: Pieces) -> tuple[Array, Array, Array, Array]:
    """Return least and largest coordinates ``(F, 3)``, axis ``(F, 3)`` and half angle ``(F,)`` of pieces.

    One that emits to all sides has the half angle pi.
    """
    triangles, owner = pieces.proxies
    low, high = np.full((len(pieces.area), 3), np.inf), np.full((len(pieces.area), 3), -np.inf)
    np.minimum.at(low, owner, triangles.min(axis=1))
    np.maximum.at(high, owner, triangles.max(axis=1))
    everywhere = pieces.two_sided | (pieces.shape == SPHERE)
    axis = np.where(pieces.shape == SPHERE, np.array([[0.0], [0.0], [1.0]]), pieces.rows[9:]).T
    return low, high, axis, np.where(everywhere, np.pi, 0.0)


def _node_rows(bounds: tuple[Array, ...], order: Index, first: Index, node: Index) -> Array:
    """Return centre, axis, radius, s and intensity of nodes, ``(9, K)``, from the bounds and intensities of pieces.

    A node has the pieces from `first` ``(K,)`` on in their `order` ``(F,)``; `node` ``(F,)`` has the node of each.
    """
    low, high, axis, angle, intensity = (values[order] for values in bounds)
    low, high = np.minimum.reduceat(low, first), np.maximum.reduceat(high, first)
    middle = np.add.reduceat(axis, first)
    middle /= np.maximum(np.linalg.norm(middle, axis=1, keepdims=True), 1e-300)
    angle = angle + np.arccos(np.clip((axis * middle[node]).sum(axis=1), -1, 1))
    cone = np.minimum(np.maximum.reduceat(angle, first) + MARGIN, np.pi)
    radius = np.maximum((1 + MARGIN) / 2 * np.linalg.norm(high - low, axis=1), 1e-9)
    total = np.add.reduceat(intensity, first)
    return np.stack([*((low + high) / 2).T, *middle.T, radius, 2 * np.sin(cone / 2), total])
