"""Ray intersection: Embree behind two calls, ``closest`` and ``occluded``.

All triangles of a scene are one Embree mesh, so a hit's primitive number is the row of every per-triangle table.
Rays come as float32 ``(3, N)``; the transposed view goes to Embree without a copy. A ray begins exactly at its
origin (Embree's near distance is fixed at 0): the caller offsets origins, see `dmis.scene.rescale.ray_offsets`.
"""

from __future__ import annotations

import sys
from collections import Counter
from concurrent.futures import CancelledError
from dataclasses import dataclass
from threading import Event
from time import thread_time
from typing import Protocol

import numpy as np

from dmis.base.malloc import keep
from dmis.base.validate import check_package
from dmis.base.vectors import Array, Index, Selection, take

UNTRACED = "untraced"
"""Beside the kinds of rays: camera samples of pixels that no triangle covers, for which no ray is traced."""
CHECK_RAYS = sys.flags.dev_mode
"""Whether rays are tested for NaN: in Python's development mode (``python -X dev``), and in the tests. One NaN makes
Embree walk its whole tree, about 1 ms per ray, which looks like a hang."""

NO_EMBREE = (
    "pip install embreex. Where it has no wheel, as on Linux and Windows on ARM, build it from source; dmis.score "
    "needs no rays"
)
"""What to do where embreex is missing."""


@dataclass(eq=False)
class Hits:
    """Closest hits of N rays.

    Attributes
    ----------
    prim
        Triangle number ``(N,)`` int32; -1 for a miss.
    u, v
        Barycentrics of vertices 1 and 2, ``(N,)``.
    distance
        In units of the direction's length, ``(N,)``; 1e37 for a miss.
    """

    prim: np.ndarray
    u: Array
    v: Array
    distance: Array

    def take(self, index: np.ndarray) -> Hits:
        """Return the hits `index`."""
        return Hits(*(a.take(index) for a in (self.prim, self.u, self.v, self.distance)))

    def replace(self, index: np.ndarray, hits: Hits) -> None:
        """Put `hits` in the place of the hits `index`."""
        for name in ("prim", "u", "v", "distance"):
            getattr(self, name)[index] = getattr(hits, name)


class RayCaster(Protocol):
    """Protocol of `Intersector` and of what wraps it."""

    def closest(self, origin: Array, direction: Array) -> Hits: ...

    def occluded(self, origin: Array, direction: Array, distance: Array) -> np.ndarray: ...


class Intersector:
    """Embree intersector of one triangle mesh; it is built at once, where Embree would wait for the first query.

    Parameters
    ----------
    vertices, faces
        ``(V, 3)`` and ``(F, 3)``, at least one face, as a `dmis.Mesh` has checked them: Embree does not.
    """

    def __init__(self, vertices: Array, faces: np.ndarray) -> None:
        check_package("embreex", "a render, which traces rays,", NO_EMBREE)
        from embreex import rtcore_scene  # imported where used: rules are scored without Embree
        from embreex.mesh_construction import TriangleMesh

        keep()  # Embree's threads would have an arena of their own
        self._scene = rtcore_scene.EmbreeScene(robust=True)
        self._mesh = TriangleMesh(
            self._scene, vertices.astype(np.float32, copy=False), faces.astype(np.int32, copy=False)
        )
        self.occluded(*(np.zeros((3, 1), np.float32),) * 2, np.zeros(1, np.float32))

    def closest(self, origin: Array, direction: Array) -> Hits:
        """Return the first hits of rays from `origin` along `direction`, both ``(3, N)`` float32."""
        o, d = self._rays(origin, direction)
        hits = self._scene.run(o, d, query="INTERSECT", output=True)
        return Hits(hits["primID"], hits["u"], hits["v"], hits["tfar"])

    def occluded(self, origin: Array, direction: Array, distance: Array) -> np.ndarray:
        """Return whether anything lies between `origin` and `distance` ``(N,)`` along `direction`, ``(N,)`` bool."""
        o, d = self._rays(origin, direction)
        if distance.shape != (len(o),):
            raise ValueError(f"distance must have shape ({len(o)},), one for each ray; got {distance.shape}")
        if CHECK_RAYS and np.isnan(distance).any():
            raise ValueError("distance must not be NaN, because Embree would walk the whole tree")
        # a copy, because Embree writes into it; not below 0, where it would call everything occluded
        dists = np.maximum(distance, np.float32(0)).astype(np.float32, copy=False)
        return np.equal(self._scene.run(o, d, dists=dists, query="OCCLUDED"), 0)

    def _rays(self, origin: Array, direction: Array) -> tuple[Array, Array]:
        """Return origins and directions as float32 ``(N, 3)`` views; raise a ValueError on other shapes or a NaN."""
        if origin.shape != direction.shape or origin.ndim != 2 or origin.shape[0] != 3:
            raise ValueError(
                f"origin and direction must both have shape (3, N), because Embree does not check lengths; "
                f"got {origin.shape} and {direction.shape}"
            )
        o, d = origin.astype(np.float32, copy=False), direction.astype(np.float32, copy=False)
        if CHECK_RAYS and (np.isnan(o).any() or np.isnan(d).any()):
            raise ValueError("rays must not contain NaN, because Embree would walk the whole tree")
        return o.T, d.T


class CountingCaster:
    """Ray caster of a tile: it passes queries on, counts their rays by kind, and adds up the CPU seconds they take.

    Parameters
    ----------
    caster, stop
        Answers the queries; once set, ends them by a CancelledError, so that threads end soon after an interrupt.
    of_pixels
        Closest hits and occlusion rays of each pixel of the tile, ``(2, P)`` or more rows, added to; None: they are not
        counted.

    Attributes
    ----------
    pixel
        Pixels of the camera samples of the batch that is traced, ``(N,)``.
    rays
        Rays traced so far, by kind, see `dmis.pipeline.result.Result.rays`.
    seconds
        CPU seconds of the queries so far.
    """

    def __init__(self, caster: RayCaster, of_pixels: Array | None = None, stop: Event | None = None) -> None:
        self._caster, self._of_pixels, self._stop = caster, of_pixels, stop
        self.pixel = np.empty(0, np.int64)
        self.rays = Counter(camera=0)
        self.seconds = 0.0

    def closest(self, kind: str, origin: Array, direction: Array, sample: Selection | None) -> Hits:
        """Return the first hits of rays of a kind, one for each of the camera samples `sample` (None: all).

        See `Intersector.closest`.
        """
        self.rays[kind] += direction.shape[1]
        self._count_by_pixel(0, sample)
        begin = thread_time()
        hits = self._caster.closest(origin, direction)
        self.seconds += thread_time() - begin
        return hits

    def occluded(
        self, kind: str, origin: Array, direction: Array, distance: Array, sample: Selection | None
    ) -> np.ndarray:
        """Return whether rays of a kind are occluded, see `closest` and `Intersector.occluded`."""
        self.rays[kind] += direction.shape[1]
        self._count_by_pixel(1, sample)
        begin = thread_time()
        occluded = self._caster.occluded(origin, direction, distance)
        self.seconds += thread_time() - begin
        return occluded

    def skip(self, kind: str, sample: Index) -> None:
        """Count rays that need not be traced, because nothing is there; among the closest hits of pixels, too."""
        self.rays[kind] += len(sample)
        self._count_by_pixel(0, sample)

    def _count_by_pixel(self, query: int, sample: Selection | None) -> None:
        """Count a ray of each of the camera samples `sample`."""
        if self._stop is not None and self._stop.is_set():
            raise CancelledError
        if self._of_pixels is not None:
            pixels = self._of_pixels[query]
            pixels += np.bincount(take(self.pixel, sample), minlength=len(pixels))
