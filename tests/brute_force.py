"""Intersection without Embree, against which it is tested."""

import numpy as np

from dmis.base.vectors import Array
from dmis.intersect import Hits


class BruteForce:
    """Intersector of every ray with every triangle in NumPy, float64, against which Embree is tested.

    For N rays and F triangles time and memory are of order ``N * F``. Intersection after Moeller and Trumbore 1997.
    """

    def __init__(self, vertices: Array, faces: np.ndarray) -> None:
        corners = np.asarray(vertices, np.float64)[faces]
        self._corner = corners[:, 0]
        self._edges = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]

    def closest(self, origin: Array, direction: Array) -> Hits:
        """See `Intersector.closest`."""
        t, u, v = self._all(origin, direction)
        prim = t.argmin(axis=1)
        rows = np.arange(len(prim))
        t, u, v = t[rows, prim], u[rows, prim], v[rows, prim]
        hit = np.isfinite(t)
        distance = np.where(hit, t, 1e37).astype(np.float32)
        return Hits(np.where(hit, prim, -1).astype(np.int32), u.astype(np.float32), v.astype(np.float32), distance)

    def occluded(self, origin: Array, direction: Array, distance: Array) -> np.ndarray:
        """See `Intersector.occluded`."""
        t, _, _ = self._all(origin, direction)
        return np.any(t < np.asarray(distance)[:, None], axis=1)

    def _all(self, origin: Array, direction: Array) -> tuple[Array, Array, Array]:
        """Return the distances (infinite for a miss) and barycentrics of all rays and triangles, ``(N, F)``."""
        o, d = origin.T.astype(np.float64)[:, None], direction.T.astype(np.float64)[:, None]
        edge_u, edge_v = self._edges
        across = np.cross(d, edge_v)
        volume = (across * edge_u).sum(-1)
        with np.errstate(divide="ignore", invalid="ignore"):  # rays in the plane of a triangle do not meet it
            inverse = 1 / volume
            offset = o - self._corner
            u = (offset * across).sum(-1) * inverse
            around = np.cross(offset, edge_u)
            v = (around * d).sum(-1) * inverse
            t = (around * edge_v).sum(-1) * inverse
            hit = (volume != 0) & (u >= 0) & (v >= 0) & (u + v <= 1) & (t >= 0)
        return np.where(hit, t, np.inf), u, v
