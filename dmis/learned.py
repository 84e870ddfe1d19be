"""Rules that learn weights, and numbers of samples, from one pilot at w = 1/2.

Statistics are shared between neighbours, decisions are not: what was gathered is averaged over patches and filtered,
then each patch takes its own minimum.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from dmis.choice import SIDE, check_choice, choose
from dmis.cost import camera_sample, surface_points
from dmis.curves import GRID, HALF, Curves
from dmis.fit import Fit, Pilot, of_final
from dmis.objectives import objective
from dmis.pooled import Pooled, allowed, least
from dmis.quadtree import adaptive_patches
from dmis.settings import MOST
from dmis.sharing import check_sharing, pool
from dmis.shrinkage import shrink
from dmis.tile import BASE, Statistic
from dmis.variance import patch_mean, patch_spread, patch_sum, row_blocks
from dmis.vec import Array

SPLITS = (1, 0.5, 2, 4, 8)
"""Times the shading samples that camera samples may have."""


@dataclass(frozen=True)
class Learned:
    """Weights that minimise an objective per patch.

    The objective ``second-moment`` is variance and cost, V(w) and C(w), weighed such that the image's error times its
    time is least (`dmis.pooled.weighed`): the pilot gives unbiased curves V(w) (`dmis.curves`), which are averaged over
    patches, filtered, weighed with the cost of a camera sample at w (`dmis.cost`) and minimised on a grid of weights.
    The others, ``taylor``, ``inverse-variance``, ``neyman``, ``representativity``, ``kl``, ``tsallis`` and ``linear``,
    are those of the literature (`dmis.objectives`).

    Parameters
    ----------
    objective
        Name of what is minimised.
    patch
        Side of a patch in pixels, a multiple of 4.
    spp
        Samples of the pilot, at w = 1/2: an even number of at least 4, see `dmis.render.pilot_settings`.
    filter
        Of the statistics: ``gaussian`` or ``none``; ``joint``, a Gaussian among neighbours that look alike
        (`dmis.filter.joint`, `dmis.guides`); or ``quadtree``, patches of `patch` pixels that are joined with their
        neighbours unless they surely differ (second-moment, see `dmis.quadtree`).
    size, sigma
        Of the Gaussian, in patches.
    shrink
        Whether each patch's curve is moved towards that of its kind by as much as it is uncertain, after the filter
        (second-moment, see `dmis.shrinkage`). Kinds are materials if the filter is ``joint``, else there is but one.
    cost
        Whether cost counts; otherwise variance alone.
    guard
        Leave w = 1/2 only where the gain is more than this many standard errors (second-moment).
    split
        Whether camera samples may have 2, 4 or 8 times the shading samples, and be fewer for it, or half of them, and
        be more, if that is best for the image (second-moment, and only if cost counts).
    bounces
        In path tracing, ``shared``: one weight for all surfaces of a path; ``separate``: one for the first surface
        and one for all behind it (second-moment, not with filter quadtree), which was not better in any scene that
        was measured, see ``docs/paths.md``.
    counts
        Whether patches get different numbers of samples, in proportion to ``sqrt(V / C)`` (second-moment).
    floor
        Least number of samples of a patch, as a share of the mean.
    count_sigma
        Of the Gaussian over the variances that set the numbers of samples, in patches. Less than `sigma`, because a
        number of samples that is a little off costs little, and highlights are small.
    gamma
        Order of the divergence (tsallis); 1 is Kullback-Leibler, 2 the second moment.
    reuse
        Whether the pilot's samples are part of the image. None: as the settings say, and if these do not, where the
        final samples are independent too.
    combiner, sampler
        Of the final samples. Curves are those of the combiner if it is a heuristic (second-moment); of balance if not,
        and with ``frozen``. Of several heuristics, joined by ``+``, the pilot chooses the one that is best for the
        image, see `dmis.choice`.
    """

    objective: str = "second-moment"
    patch: int = 4
    spp: int = 6
    filter: str = "joint"
    size: int = 5
    sigma: float = 1.0
    shrink: bool = True
    cost: bool = True
    guard: float = 1.5
    split: bool = False
    bounces: str = "shared"
    counts: bool = False
    floor: float = 0.1
    count_sigma: float = 0.4
    gamma: float = 2.0
    reuse: bool | None = None
    combiner: str = "balance"
    sampler: str = ""

    def __post_init__(self) -> None:
        check_sharing(self.patch, self.size, self.sigma, self.guard)
        if self.spp < 4 or self.spp % 2:
            raise ValueError(
                f"spp of the pilot must be even and at least 4, because curves come from pairs of camera samples with "
                f"twice the shading samples; got {self.spp}"
            )
        if self.filter not in ("gaussian", "none", "joint", "quadtree"):
            raise ValueError(f"filter must be gaussian, none, joint or quadtree; got {self.filter!r}")
        if self.bounces not in ("shared", "separate"):
            raise ValueError(f"bounces must be shared or separate; got {self.bounces!r}")
        for name, value in (("count_sigma", self.count_sigma), ("gamma", self.gamma)):
            if not 0 < value < np.inf:
                raise ValueError(f"{name} must be positive and finite; got {value}")
        if not 0 < self.floor <= 1:
            raise ValueError(f"floor must be in (0, 1], a share of the mean number of samples; got {self.floor}")
        if self.objective != "second-moment":
            for name, chosen in (
                ("filter quadtree", self.filter == "quadtree"),
                ("shrink", self.shrink),
                ("split", self.split),
                ("counts", self.counts),
                (f"combiner {self.combiner}", "+" in self.combiner),
            ):
                if chosen:
                    raise ValueError(f"{name} needs variances, which the objective {self.objective} does not estimate")
        if "+" in self.combiner:
            check_choice(self.combiners)
        if self.filter == "gaussian" or (self.counts and not self.guided):
            import scipy.ndimage  # noqa: F401  what the filter needs: a fit should not take the time of an import

    @property
    def pilot(self) -> Mapping[float, int]:
        return {0.5: self.spp}

    @property
    def settings(self) -> Mapping[str, Any]:
        return {"combiner": self.combiners[0]} | of_final(self.sampler, self.reuse)

    @property
    def combiners(self) -> tuple[str, ...]:
        """Those that the pilot chooses from."""
        return tuple(self.combiner.split("+"))

    @property
    def guided(self) -> bool:
        """Whether the pilot should bring guides."""
        return self.filter == "joint"

    @property
    def separate(self) -> bool:
        """Whether first and later surfaces of paths should have curves of their own."""
        return self.bounces == "separate" and self.objective == "second-moment" and self.filter != "quadtree"

    @property
    def statistic(self) -> Callable[[int, int], Statistic]:
        """What is gathered in the pilot."""
        if self.objective != "second-moment":
            return objective(self.objective, self.gamma).statistic
        return partial(Curves, combiners=self.combiners)

    def fit(self, pilot: Mapping[float, Pilot]) -> Fit:
        found, combiner = pilot[0.5], None
        shape = found.moments.mean.shape[:2]
        if len(self.combiners) > 1:
            found, combiner = self._choose(found, shape)
        means, pixels = self._pool(found, shape, self.sigma)
        if self.objective != "second-moment":
            s, pair = found.shading_samples, [1.0, 1.0]
            if self.cost:
                pair = camera_sample(found.rays, np.array([0, 1]), s, s // 2, found.techniques).tolist()
            weight = np.clip(objective(self.objective, self.gamma).solve(means, (pair[0], pair[1])), 0, 1)
            return Fit(patch_spread(weight, self.patch, shape), {"patch": weight})
        parts = _by_class(means, pixels)
        area = patch_sum(np.ones(shape), self.patch)  # not `pixels`, which says how sure means are
        times, costs = self._split(parts, area, found)
        prepare = self._prepare(times, found)
        maps = {}
        curves = _joined([prepare(part) for part in parts])
        variances = [part.variance for part in curves]
        half = (np.maximum(variances[0][HALF], 0) * area).sum() / area.sum()
        price = None if self.counts else half / costs[0][HALF]
        if self.filter == "quadtree":
            sums = {name: a * pixels for name, a in means.items()}
            index, maps["size"] = adaptive_patches(sums, pixels, costs[0], self.guard, prepare, price)
            best = [index]
        else:
            best = [self._least(part, area, c, price) for part, c in zip(curves, costs, strict=True)]
        weights = [GRID[index] for index in best]
        del means, parts, curves  # they are large
        samples = None
        if self.counts:
            guides = found.guides if self.guided else None
            errors = ("square", "cross")  # which numbers of samples do without
            known = {name: a for name, a in found.sums.items() if name not in errors}
            sharp, n = pool(known, shape, self.patch, self.count_sigma, self.size // 2, guides)
            sharp |= dict.fromkeys(errors, np.broadcast_to(0.0, sharp["curve"].shape))
            v, c = _at(_by_class(sharp, n), costs, times, found.shading_samples // 2, best)
            samples = self._shares(np.sqrt(v / c), shape)
        maps |= {"patch": weights[0], "variance": _together(variances, best)}
        maps["variances"] = variances[0] if len(variances) == 1 else np.stack(variances)
        later = None
        if len(weights) > 1:
            maps["later"], later = weights[1], patch_spread(weights[1], self.patch, shape)
        return Fit(patch_spread(weights[0], self.patch, shape), maps, samples, times, later, combiner)

    def _choose(self, pilot: Pilot, shape: tuple[int, int]) -> tuple[Pilot, str]:
        """The best combiner for the image, and what the pilot says of it."""
        each = [
            {name: a if name == "position" else a[k] for name, a in pilot.sums.items()}
            for k in range(len(self.combiners))
        ]
        area, found = patch_sum(np.ones(shape), SIDE), []
        for sums in each:
            parts = _by_class(*pool(sums, shape, SIDE))
            times, costs = self._split(parts, area, pilot)
            found.append(_at(parts, costs, times, pilot.shading_samples // 2))
        variance, cost = (np.stack(a) for a in zip(*found, strict=True))
        k = choose(variance, cost, area, self.counts)
        return replace(pilot, sums=each[k]), self.combiners[k]

    def _prepare(self, times: float, pilot: Pilot) -> Callable[[Pooled], Pooled]:
        """What is done with curves before weights are chosen."""
        s = pilot.shading_samples // 2
        if not self.shrink:
            return lambda curves: curves.split(times, s)
        material = pilot.guides.get("material") if self.guided else None
        kinds = None if material is None else patch_mean(material, self.patch // BASE)
        again = self.filter == "quadtree"  # curves are needed once more
        return lambda curves: shrink(curves, kinds, lambda part: part.split(times, s), in_place=not again)

    def _split(self, parts: list[Pooled], area: Array, pilot: Pilot) -> tuple[float, list[Array]]:
        """How many times the shading samples are best for the image, and what camera samples with them cost, where
        the weight of one class leaves 1/2.
        """
        found = []
        s = pilot.shading_samples // 2
        for times in (t for t in SPLITS if t == 1 or (self.split and self.cost and s * t <= MOST)):
            costs = [np.ones(len(GRID)) for _ in parts]
            if self.cost:
                cost = camera_sample(pilot.rays, GRID, pilot.shading_samples, s * times, pilot.techniques)
                first = 1 / surface_points(pilot.rays)
                shares = (first, 1 - first) if len(parts) > 1 else (1.0,)
                costs = [cost[HALF] + share * (cost - cost[HALF]) for share in shares]
            v, c = _at(parts, costs, times, s)
            total = (np.sqrt(v * c) * area).sum() ** 2
            if not self.counts:
                total = (v * area).sum() * (c * area).sum()
            found.append((total, times, costs))
        return min(found, key=lambda one: one[:2])[1:]

    def _pool(self, pilot: Pilot, shape: tuple[int, int], sigma: float) -> tuple[dict[str, Array], Array]:
        guides = pilot.guides if self.guided else None
        wide = sigma if self.filter in ("gaussian", "joint") else None
        return pool(pilot.sums, shape, self.patch, wide, self.size // 2, guides)

    def _least(self, curves: Pooled, area: Array, cost: Array, price: float | None) -> np.ndarray:
        may = allowed(np.einsum("gyx,yx->g", curves.curve, area))
        blocks = (curves.rows(rows) for rows in row_blocks(len(area)))
        return np.concatenate([least(block, cost, self.guard, may, price) for block in blocks])

    def _shares(self, wanted: Array, shape: tuple[int, int]) -> Array:
        """Numbers of samples in proportion to `wanted`, not below the floor."""
        wanted = wanted.astype(np.float32)
        least = self.floor * wanted.mean()
        return patch_spread(np.maximum(wanted, least) if least > 0 else np.ones_like(wanted), self.patch, shape)


def _by_class(means: Mapping[str, Any], pixels: Array) -> list[Pooled]:
    """The curves of each class of surfaces: one, or the first and all others, see `dmis.curves.Curves`."""
    if means["curve"].ndim == 3:
        return [Pooled(**means, pixels=pixels)]
    own = {name: a for name, a in means.items() if name != "position"}
    count = len(means["curve"])
    return [
        Pooled(**{name: a[k] for name, a in own.items()}, position=means["position"], pixels=pixels)
        for k in range(count)
    ]


def _joined(parts: list[Pooled]) -> list[Pooled]:
    """Curves of classes such that the variance of each is that of a camera sample, the others being at w = 1/2."""
    half = sum(part.curve[HALF] for part in parts)
    return [replace(part, position=np.maximum(part.position, 0) + half - part.curve[HALF]) for part in parts]


def _at(
    parts: list[Pooled],
    costs: list[Array],
    times: float,
    shading_samples: int,
    best: Sequence[np.ndarray] | None = None,
) -> tuple[Array, Array]:
    """Variance and cost of camera samples with `times` the `shading_samples`, with every class at its index into the
    grid; `best` is None: where variance times cost is least. Some rows at a time.
    """
    found = []
    for rows in row_blocks(len(parts[0].position)):
        joined = _joined([part.rows(rows).split(times, shading_samples) for part in parts])
        variances = [np.maximum(part.variance, 0) for part in joined]
        if best is None:
            index = [(v * c[:, None, None]).argmin(axis=0) for v, c in zip(variances, costs, strict=True)]
        else:
            index = [b[rows] for b in best]
        found.append((_together(variances, index), _together(costs, index)))
    v, c = (np.concatenate(a) for a in zip(*found, strict=True))
    return v, c


def _together(curves: Sequence[Array], best: Sequence[np.ndarray]) -> Array:
    """Variance or cost with every class at its index into the grid, not below 0: that at w = 1/2, and what each class
    of `curves` ``(G, ...)`` changes. One class that changes alone has its own.
    """
    at = [c.take(i) if c.ndim == 1 else np.take_along_axis(c, i[None], axis=0)[0] for c, i in zip(curves, best)]
    return np.maximum(at[0] + sum(own - curve[HALF] for own, curve in zip(at[1:], curves[1:])), 0)
