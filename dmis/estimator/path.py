"""Rays that go on from a surface: through mirrors and glass, or along a path that a BRDF scatters.

*Direct lighting* follows every delta lobe of a surface, each as a batch of its own. *Path tracing* continues with one
direction per point, picked among the lobes, so that paths do not branch; all that go on from one depth are one batch.
Light is gathered at each surface by the same mixture of techniques (next-event estimation with MIS), so what a
continued ray meets counts as emission only if a delta lobe sent it: other directions had it in their mixture.

A path's throughput is ``f_r cos / pdf`` multiplied along it. From depth `ROULETTE` on it survives with the probability
q of its largest throughput, at most 1, and counts 1 / q times (Russian roulette, Arvo and Kirk 1990): unbiased, because
its contribution is right in the mean whatever q is. Inside of glass throughput is divided by eta^2, which it gets back
where it leaves; so q takes it times eta^2 there.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from dmis.base.vectors import Array, Selection, compose, dot, indices, take
from dmis.brdf.fresnel import relative_ior
from dmis.brdf.lobe import Directions
from dmis.samplers.pixel_block import CONTINUE
from dmis.scene.shading_points import ShadingPoints

LobeGroup = int | Literal["reflection", "transmission"]
"""What continues a path: one of the delta lobes, by its number, or all other lobes of reflection or of transmission."""
ROULETTE = 4
"""Depth from which on paths of little throughput are ended at random: see docs/does-not-pay.md for others."""


@dataclass(eq=False)
class Rays:
    """Rays in flight.

    Attributes
    ----------
    sample
        Camera sample numbers, ``(N,)``; None: all, in order.
    throughput
        What they will be multiplied by, ``(3, N)``; None: nothing.
    depth
        Surfaces that scattered them.
    path
        What led here, to tell random numbers apart.
    adds_emission
        Whether lights that they meet count, ``(N,)`` bool, or one for all.
    """

    origin: Array
    direction: Array
    sample: Selection | None
    throughput: Array | None
    depth: int
    path: tuple[int, ...]
    adds_emission: np.ndarray | bool = True


def scatter(surface: ShadingPoints, lobe: Any) -> tuple[Array, Array, Array]:
    """Return origins, directions and factors, each ``(3, N)``, of rays that a delta lobe sends on.

    Factors are 0 where the shading normal turns a mirrored ray into the surface, or a refracted one out of it.
    """
    wi, factor = lobe.scatter(surface)
    if lobe.transmissive:
        # p lies on wo's side of the surface; what goes through begins on the other
        origin, possible = surface.p - surface.ng * (2 * surface.epsilon), surface.same_side(-wi)
    else:
        origin, possible = surface.p, surface.same_side(wi)
    return origin, wi, np.broadcast_to(factor * possible, wi.shape)


def bounce(
    surface: ShadingPoints,
    sample: Selection | None,
    throughput: Array | None,
    depth: int,
    u: Array,
    rng: np.random.Generator,
    last: bool = False,
) -> Rays | None:
    """Continue the paths at N points, each in one direction; None if none goes on.

    Parameters
    ----------
    sample, throughput, depth
        Of the rays that came here.
    u
        Uniform numbers for directions, ``(2, N)``.
    rng
        For the choice among lobes, and for roulette.
    last
        Whether only lights that a delta lobe shows still count.
    """
    n = len(surface.cos_o)
    groups: list[LobeGroup] = list(range(len(surface.delta)))
    groups += ["reflection"] if surface.reflection else []
    groups += ["transmission"] if surface.transmission else []
    if not groups:
        return None
    if len(groups) == 1:  # nothing to choose, nothing to put together
        origin, direction, factor = _follow(surface, groups[0], u)
        adds_emission: np.ndarray | bool = isinstance(groups[0], int)
    else:
        origin, direction, factor = np.empty((3, 3, n), np.float32)
        adds_emission = np.zeros(n, bool)
        for group, index, chance in _choose(surface, groups, n, rng):
            at: Any = slice(None) if index is None else index
            p, wi, group_factor = _follow(surface.take(index), group, take(u, index))
            for out, value in zip((origin, direction, factor), (p, wi, group_factor / chance), strict=True):
                out[:, at] = value
            adds_emission[at] = isinstance(group, int)
    if throughput is not None:
        factor = factor * throughput
    largest = factor.max(axis=0)
    alive = largest > 0
    if depth + 1 >= ROULETTE:
        survival = np.minimum(largest * _scaled(surface, direction), np.float32(1))
        alive &= rng.random(n, dtype=np.float32) < survival
        factor = factor / np.maximum(survival, np.float32(1e-30))
    if last:
        alive &= adds_emission
    index = indices(alive)
    if index is not None and len(index) == 0:
        return None
    origin, direction, factor = (take(a, index) for a in (origin, direction, factor))
    adds_emission = adds_emission if isinstance(adds_emission, bool) else take(adds_emission, index)
    return Rays(origin, direction, compose(sample, index), factor, depth + 1, (CONTINUE,) * (depth + 1), adds_emission)


def _scaled(surface: ShadingPoints, direction: Array) -> Array | np.float32:
    """Return eta^2 by which the throughput of rays in `direction` was divided inside of glass; 1 outside."""
    scales = (lobe.eta_scale() for lobe in (*surface.transmission, *surface.delta))
    eta = next((eta for eta in scales if eta != 1), None)
    if eta is None:
        return np.float32(1)
    inside = surface.outside == (dot(surface.ng, direction) < 0)
    return np.where(inside, np.float32(eta * eta), np.float32(1))


def _follow(surface: ShadingPoints, group: LobeGroup, u: Array) -> tuple[Array, Array, Array]:
    """Return origins, directions and factors, each ``(3, N)``, of rays that a group of lobes sends on."""
    if isinstance(group, int):
        return scatter(surface, surface.delta[group])
    if group == "transmission":
        surface = surface.beyond()
    wi = surface.sample(u)
    return surface.p, wi, _reflected(surface, wi)


def merge(parts: Sequence[Rays], samples: int) -> Rays:
    """Return rays of one depth as one batch, part after part; there are `samples` camera samples."""
    if len(parts) == 1:
        return parts[0]
    every = np.arange(samples)
    sample = np.concatenate([take(every, p.sample) for p in parts])
    throughputs = (np.ones_like(p.origin) if p.throughput is None else p.throughput for p in parts)
    fields = zip(*((p.origin, p.direction) for p in parts), strict=True)
    origin, direction, throughput = (np.concatenate(list(f), axis=1) for f in (*fields, throughputs))
    adds_emission = parts[0].adds_emission
    if not isinstance(adds_emission, bool) or any(p.adds_emission is not adds_emission for p in parts):
        adds_emission = np.concatenate([np.broadcast_to(p.adds_emission, p.origin.shape[1]) for p in parts])
    return Rays(origin, direction, sample, throughput, parts[0].depth, parts[0].path, adds_emission)


def _reflected(surface: ShadingPoints, wi: Array) -> Array:
    """Return ``f_r |n.wi| / pdf``, ``(3, N)``; 0 for directions that the surface rejects."""
    possible = surface.same_side(wi)
    if len(surface.reflection) == 1 and (weight := surface.reflection[0].weight()) is not None:
        return np.broadcast_to(weight * possible.astype(np.float32), wi.shape)
    directions = Directions(surface, wi)
    pdf = surface.pdf(directions)
    accepted = (pdf > 0) & possible
    factor = directions.cos_i / np.where(accepted, pdf, 1) * accepted
    return np.broadcast_to(surface.eval(directions) * factor, wi.shape)


def _choose(
    surface: ShadingPoints, groups: list[LobeGroup], n: int, rng: np.random.Generator
) -> Iterator[tuple[LobeGroup, Selection | None, Array]]:
    """Divide the points among the groups of lobes; yields each group with its points and its probability.

    Delta lobes are picked in proportion to the power that they reflect or transmit; the other lobes share the
    remainder to 1, and get at least a tenth. Of that, the share that a smooth surface would transmit goes to the lobes
    of transmission.
    """
    power = np.zeros((len(groups), n), np.float32)
    for k, lobe in enumerate(surface.delta):
        power[k] = np.asarray(lobe.scatter(surface)[1]).mean(axis=0)
        if (eta := lobe.eta_scale()) != 1:  # radiance is divided by eta^2, power is not
            power[k] *= relative_ior(eta, surface.outside) ** 2
    remainder = np.maximum(1 - power.sum(axis=0), np.float32(0.1))
    if surface.transmission:
        transmitted = np.clip(surface.transmission[0].transmitted_share(surface), np.float32(0.1), np.float32(0.9))
        power[-1] = remainder * transmitted if surface.reflection else remainder
        remainder = remainder * (1 - transmitted)
    if surface.reflection:
        power[groups.index("reflection")] = remainder
    cumulative = np.cumsum(power, axis=0)
    total = np.maximum(cumulative[-1], np.float32(1e-30))
    chosen = np.minimum((cumulative <= rng.random(n, dtype=np.float32) * total).sum(axis=0), len(groups) - 1)
    for k, group in enumerate(groups):
        index = indices(chosen == k)
        if index is None or len(index):
            yield group, index, np.maximum(take(power[k] / total, index), np.float32(1e-30))
