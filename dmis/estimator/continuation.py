"""Continuation of paths by the BRDF samples of direct lighting: one ray looks for a light, and goes on.

At each vertex one of the BRDF samples towards one of the lights gives the path's next direction. Its closest hit says
whether the light is occluded, and is the next vertex. The light that it meets is counted at this vertex, with its MIS
weight; what it meets counts no emission. Any of the samples may be the one, because all have the same density. Where a
vertex has none, because all its samples are light samples or its path goes on by a delta lobe, another ray continues
the path.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from dmis.base.vectors import Array, Selection, compose, indices, size, take
from dmis.estimator.batch import Batch, count_rays
from dmis.estimator.path import LobeGroup, Rays, choose, follow, lobe_groups, reflected, roulette
from dmis.samplers.keys import CONTINUE
from dmis.scene.shading_points import ShadingPoints

UNTRACED_DISTANCE = np.float32(-1)
"""Hit distance of samples that continue no path."""


@dataclass(eq=False)
class Onward:
    """Paths at N surface points that go on by one group of lobes.

    Attributes
    ----------
    batch, surface, sample, throughput, depth
        Of the vertices, as in `dmis.estimator.path.Rays`; `surface` is seen from the side of wo.
    group
        What continues the paths.
    waiting
        Whether the path of a vertex goes on by this group and has no direction yet, ``(N,)`` bool.
    over_chance
        1 / probability of the group, ``(N,)``; None: 1.
    rays
        Rays that continue the other paths.
    """

    batch: Batch
    surface: ShadingPoints
    sample: Selection | None
    throughput: Array | None
    depth: int
    group: LobeGroup
    waiting: np.ndarray
    over_chance: Array | None = None
    rays: list[Rays] = field(default_factory=list)

    def sample_index(self, index: Selection | None, count: Array | int) -> Array:
        """Return which BRDF sample continues the path of each of the vertices `index`, ``(n,)``; -1: none.

        It is one of `count` samples, ``(n,)``, all equally likely. Always the first would be a quarter of the points
        of a sequence, those of one corner; a low-discrepancy number picks it, so that the directions stay stratified.
        """
        chosen: Array | int = 0
        if np.max(count) > 1:
            u = self.batch.sampler.draw((CONTINUE,) * (self.depth + 1), compose(self.sample, index))
            chosen = np.minimum((u[0] * count).astype(np.int8), np.maximum(count, 1) - 1)
        return np.where(take(self.waiting, index), chosen, -1)

    def send(self, vertex: Selection | None, origin: Array, wi: Array, factor: Array) -> Array:
        """Continue the paths at the vertices `vertex` along `wi` with ``f_r cos / pdf``, `factor` ``(3, n)``.

        Returns
        -------
        Distances of the first hits, ``(n,)``; `UNTRACED_DISTANCE` where the path ends.
        """
        self.waiting[slice(None) if vertex is None else vertex] = False
        for scale in (self.throughput, self.over_chance):
            factor = factor if scale is None else factor * take(scale, vertex)
        factor, alive = roulette(self.surface.take(vertex), wi, factor, self.depth, self.batch.rng)
        distance = np.full(wi.shape[1], UNTRACED_DISTANCE)
        index = indices(alive)
        if not size(index, 1):
            return distance
        sample = compose(self.sample, compose(vertex, index))
        origin, wi, factor = (take(a, index) for a in (origin, wi, factor))
        hits = self.batch.caster.closest(origin, wi)
        count_rays(self.batch, f"bounce {self.depth + 1}", wi.shape[1], sample)
        distance[slice(None) if index is None else index] = hits.distance
        adds_emission = isinstance(self.group, int)
        index = None if adds_emission else indices(hits.prim >= 0)  # what leaves the scene adds nothing else
        if size(index, 1):
            origin, wi, factor = (take(a, index) for a in (origin, wi, factor))
            sample, hits, path = compose(sample, index), hits.take(index), (CONTINUE,) * (self.depth + 1)
            self.rays.append(Rays(origin, wi, sample, factor, self.depth + 1, path, adds_emission, hits))
        return distance

    def send_samples(self, vertex: Selection | None, surface: ShadingPoints, wi: Array, chosen: np.ndarray) -> Array:
        """Continue the paths at `vertex` by those of N BRDF samples that are `chosen` ``(N,)``; see `send`."""
        distance = np.full(len(chosen), UNTRACED_DISTANCE)
        index = indices(chosen)
        if size(index, 1):
            surface, wi = surface.take(index), take(wi, index)
            sent = self.send(compose(vertex, index), surface.p, wi, reflected(surface, wi))
            distance[slice(None) if index is None else index] = sent
        return distance

    def remainder(self) -> list[Rays]:
        """Return the rays of all paths, after another ray is traced for each path without a BRDF sample."""
        index = indices(self.waiting)
        if size(index, 1):
            u = self.batch.sampler.draw((CONTINUE,) * (self.depth + 1), compose(self.sample, index))
            self.send(index, *follow(self.surface.take(index), self.group, u))
        return self.rays


def onward(
    batch: Batch, depth: int, surface: ShadingPoints, sample: Selection | None, throughput: Array | None
) -> dict[LobeGroup, Onward]:
    """Choose the group of lobes by which each path goes on; returns the paths of each group."""
    n, groups = len(surface.cos_o), lobe_groups(surface)
    paths: dict[LobeGroup, Onward] = {}
    if len(groups) == 1:
        return {groups[0]: Onward(batch, surface, sample, throughput, depth, groups[0], np.ones(n, bool))}
    for group, index, chance in choose(surface, groups, n, batch.rng) if groups else ():
        waiting, over_chance = np.zeros(n, bool), np.ones(n, np.float32)
        at = slice(None) if index is None else index
        waiting[at], over_chance[at] = True, 1 / chance
        paths[group] = Onward(batch, surface, sample, throughput, depth, group, waiting, over_chance)
    return paths
