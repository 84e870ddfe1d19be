"""Bounds of what weights can save: the least error times cost of an image with the best weights of its patches.

A camera sample takes ``n_k = s_k S`` samples of technique k (light, BRDF; s is the *share* of light samples), which the
balance heuristic weighs with a *tilt* t, not necessarily s. With ``X_k = t_k f / (t p_l + (1 - t) p_b)``, of one
sample, and ``m_k(y)`` its mean at the point y that the camera sample meets, its variance is

    V(s, t) = Var_y(I) + sum_k E_y[X_k^2 - m_k^2] / (s_k S) + var(n / S) Var_y(m_l / s_l - m_b / s_b).

`ShareTiltMoments` estimates all terms from one pilot at w = 1/2. Shares are t = s, tilts s = 1/2; both agree with
`dmis.variance.curves.Curves` and `tilt_curves.TiltCurves`.

Patches are drawn from the image at its full size, and at a quarter of its side, with a probability that follows the
variance of a small render, and stand for the image with one over that. Weights are chosen on one half of a patch's
samples and judged on the other, both ways: noise in the choice raises a bound, it does not lower it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from mis_bench_renders import BOUND, load

from dmis.base.atomic_files import replacing
from dmis.base.patches import PATCH, patch_mean
from dmis.base.vectors import Array
from dmis.bench.data import GRID, HALF, path_of
from dmis.estimator.allocation import shares_of
from dmis.estimator.cost import camera_sample_cost
from dmis.estimator.records import Record
from dmis.estimator.settings import Settings
from dmis.experiment.reference import REFERENCE_SEED
from dmis.filter import gaussian
from dmis.fit.fixed import Fixed
from dmis.fit.round import Round, pilot_settings
from dmis.pipeline.job import resolve
from dmis.pipeline.render import render
from dmis.pipeline.tile import Tile, render_tile
from dmis.scene.scene import Scene
from dmis.variance.curves import samples_by_light, share_variance, summed_variance

SIZES = {"full": 1, "quarter": 4}
"""The full size's side is divided by this."""
PATCHES, SPP, GROUPS = 768, 512, 16
"""Patches of a scene and size, camera samples per pixel of both halves together, and groups of the jackknife."""
LEAST_VARIANCE = 1e-3
"""What is added to the variance that numbers of samples follow, over its mean: a patch that shows no variance in one
half of its samples may have some in the other."""
MOST_RATIO = 4.0
"""Tilt over share of a technique, at most, where both may be chosen: beyond, few samples count so much that the noise
of half of the samples decides."""
TERMS = ("A_l", "A_b", "var_l", "var_b", "cov")
"""Terms of V(s, t) at each tilt: ``E_y[X_k^2 - m_k^2]`` of both techniques, and the covariances of m_l and m_b."""


# Moments ------------------------------------------------------------------------------------------------------------


class ShareTiltMoments:
    """Sums over camera samples, per pixel, of the `TERMS` at the tilts of `GRID`, from samples at w = 1/2.

    A `dmis.estimator.records.Statistic` for one batch of camera samples of four shading samples each.
    """

    def __init__(self, pixels: int, shading_samples: int, grid: Array = GRID) -> None:
        if shading_samples != 4:
            raise ValueError(f"shading_samples must be 4, two of each technique; got {shading_samples}")
        self._pixels = pixels
        self._grid = grid
        self._sums: dict[str, Array] = {}

    def add(self, records: Sequence[Record], radiance: Array, count: int) -> None:
        """Add the batch: `count` camera samples of every pixel, sample-major, and their radiance ``(3, N)``."""
        if self._sums:
            raise ValueError("all camera samples of a tile must be in one batch; got a second one")
        lights = [(x, d) for x, d in samples_by_light(records, 4, radiance.shape[1]) if x.any()]
        terms = np.zeros((len(TERMS), len(self._grid), self._pixels))
        for g, t in enumerate(self._grid):
            terms[:, g] = self._terms(lights, t, count)
        half = int(np.flatnonzero(self._grid == 0.5)[0])
        total = summed_variance(radiance, count) / count
        # Var_y(I) = the pilot's variance - sum_k A_k(1/2) / (s_k S),  s_k = 1/2, S = 4
        position = total - (terms[0, half] + terms[1, half]) / 2
        self._sums = {"terms": terms, "position": position}

    def _terms(self, lights: Sequence[tuple[Array, Array]], t: np.float32, count: int) -> Array:
        """Return the `TERMS` at one tilt, ``(5, P)``; X and d of each light are ``(2 pairs, 2, N)``."""
        spread = np.zeros((2, self._pixels))
        means = np.zeros((2, 2, count, self._pixels))
        for x, d in lights:
            ratio = 1 + d, 1 - d  # p_k / q
            weighted = x / (t * ratio[0] + (1 - t) * ratio[1])
            for k, t_k in enumerate((t, 1 - t)):
                value = t_k * weighted
                # E_q[(p_k / q) X_k^2], and m_k from each of two independent pairs
                seen = ratio[k] * value
                second = (seen * value).mean(axis=(0, 1), dtype=np.float64).reshape(count, -1)
                pairs = seen.mean(axis=1, dtype=np.float64).reshape(2, count, -1)
                spread[k] += (second - pairs[0] * pairs[1]).mean(axis=0)
                means[k] += pairs
        deviations = means - means.mean(axis=2, keepdims=True)
        # m_k of different pairs are independent given y: their covariance is that over y
        products = np.einsum("kcp,jcp->kjp", deviations[:, 0], deviations[:, 1]) / (count - 1)
        return np.stack([*spread, products[0, 0], products[1, 1], (products[0, 1] + products[1, 0]) / 2])

    def sums(self) -> dict[str, Array]:
        """Return ``terms`` ``(5, T, P)`` and ``position``, Var_y(I), ``(P,)``."""
        return self._sums


def variance(terms: Array, position: Array, shading_samples: int = 2, grid: Array = GRID) -> Array:
    """Return V(s, t) at all shares and tilts of a grid, ``(s, t, ...)``, from terms ``(5, t, ...)``."""
    s = grid.astype(np.float64).reshape(-1, 1, *[1] * position.ndim)
    of_light, of_brdf, var_l, var_b, cov = terms
    counts = share_variance(shading_samples, grid).reshape(s.shape)
    shifted = var_l / s**2 + var_b / (1 - s) ** 2 - 2 * cov / (s * (1 - s))
    return np.asarray(position + (of_light / s + of_brdf / (1 - s)) / shading_samples + counts * shifted)


# Patches of an image ------------------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class Bounds:
    """Moments of a sample of the patches of an image.

    Attributes
    ----------
    terms
        Of both halves of the samples, absolute and relative, ``(2, 2, 5, T, patches)``; see `TERMS`.
    position
        Var_y(I), ``(2, 2, patches)``.
    cost
        Of a camera sample at the shares of the grid, ``(G, patches)``.
    weight
        Patches of the image that each stands for, ``(patches,)``.
    places
        Row and column of each in patches, ``(patches, 2)``.
    """

    terms: Array
    position: Array
    cost: Array
    weight: Array
    places: Array


def resized(scene: Scene, divisor: int) -> Scene:
    """Return a scene whose image has the same view and a side that is divided by a number."""
    width, height = scene.camera.resolution
    return replace(scene, camera=replace(scene.camera, resolution=(width // divisor, height // divisor)))


def patch_probabilities(scene: Scene, settings: Settings, side: int = PATCH, divisor: int = PATCH) -> Array:
    """Return the probability of each whole patch of `side` pixels to be drawn, ``(rows, columns)``.

    A third each is in proportion to absolute variance, to relative variance, and the same for all patches. Variances
    are those of a render whose side is divided by `divisor`. Pixels beyond the last whole patch have none.
    """
    small = render(resized(scene, divisor), "balance", 32, seed=REFERENCE_SEED + 6, settings=settings)
    grey = small.image.mean(axis=2)
    absolute = small.variance.mean(axis=2)
    maps = np.stack([absolute, absolute / (grey**2 + BOUND), np.ones_like(grey)])
    maps[:2] = [gaussian(a, sigma=1.0) for a in maps[:2]]
    rows, columns = (n // side for n in scene.camera.resolution[::-1])
    # the small image's pixel under the middle of each patch, or the mean of those inside of it
    inside = side // divisor
    if inside > 1:
        maps = np.stack([patch_mean(a, inside) for a in maps])
    maps = maps[:, np.minimum(np.arange(rows), maps.shape[1] - 1)][
        :, :, np.minimum(np.arange(columns), maps.shape[2] - 1)
    ]
    return np.asarray((maps / maps.sum(axis=(1, 2), keepdims=True)).mean(axis=0))


def draw(probability: Array, number: int, seed: int) -> tuple[np.ndarray, Array]:
    """Return places ``(number, 2)`` drawn systematically along a curve through the image, and what each stands for.

    Sums over the image are estimated without bias by weighted sums over the sample.
    """
    rows, columns = np.indices(probability.shape).reshape(2, -1)
    bits = np.arange(12)
    # Morton order: neighbours along it are neighbours in the image, so that the sample is stratified
    key = sum(((rows >> b & 1) << 2 * b + 1) + ((columns >> b & 1) << 2 * b) for b in bits)
    order = np.argsort(key)
    ends = np.cumsum(probability.reshape(-1)[order])
    points = (np.arange(number) + np.random.default_rng(seed).random()) / number * ends[-1]
    chosen = order[np.minimum(np.searchsorted(ends, points, "right"), len(order) - 1)]
    weight = ends[-1] / (number * probability.reshape(-1)[chosen])
    return np.stack([rows[chosen], columns[chosen]], axis=1), weight


def measure_bounds(scene: Scene, settings: Settings, patches: int = PATCHES, spp: int = SPP) -> Bounds:
    """Return moments of some patches of the image of a scene."""
    probability = patch_probabilities(scene, settings)
    places, weight = draw(probability, patches, REFERENCE_SEED)
    job = resolve(scene, Fixed(0.5), spp, REFERENCE_SEED + 7, settings)
    job.scene.prepare()
    paired = pilot_settings(job.settings, paired=True)
    n = job.settings.shading_samples
    shares = np.stack([GRID, 1 - GRID])
    values, costs = [], []
    for number, (y, x) in enumerate(places.tolist()):
        area = slice(y * PATCH, (y + 1) * PATCH), slice(x * PATCH, (x + 1) * PATCH)
        sums, films = [], []
        for half in range(2):
            statistics: list[ShareTiltMoments] = []

            def keep(pixels: int, s: int, statistics: list[ShareTiltMoments] = statistics) -> ShareTiltMoments:
                statistics.append(ShareTiltMoments(pixels, s))
                return statistics[-1]

            round_ = Round(spp // 2, shares_of(0.5), paired, statistic=keep)
            films.append(render_tile(job.scene, Tile(job.seed, half, number, area, round_)))
            sums.append(statistics[0].sums())
        radiance = np.mean([film.mean.mean(axis=2).reshape(-1) for film in films], axis=0) * job.gain
        weights = np.stack([np.ones(radiance.size), 1 / (radiance**2 + BOUND)]) * job.gain**2 / radiance.size
        # absolute and relative means over the patch's pixels
        terms = np.stack([np.einsum("mp,atp->mat", weights, of_half["terms"]) for of_half in sums])
        position = np.stack([weights @ of_half["position"] for of_half in sums])
        values.append((terms, position))
        kinds = {kind for film in films for kind in film.rays}
        rays = {kind: sum(film.rays.get(kind, 0) for film in films) for kind in kinds}
        costs.append(camera_sample_cost(rays, shares, 2 * n, n, job.settings.techniques))
    terms, position = (np.stack(arrays, axis=-1) for arrays in zip(*values, strict=True))
    return Bounds(terms, position, np.stack(costs, axis=-1), weight, places)


# Bounds -------------------------------------------------------------------------------------------------------------

Choice = Callable[[Array, Array, Array], tuple[Array, Array]]
"""Choose from V(s, t) ``(G, T, P)``, costs ``(G, 1, P)`` and weights ``(P,)`` the places in the grid ``(P,)`` of
``G T``, and numbers of samples."""


def _one(v: Array, cost: Array, weight: Array, allowed: np.ndarray) -> tuple[Array, Array]:
    """Return the best of the allowed places of the grid for the whole image."""
    products = (v @ weight) * (np.broadcast_to(cost, v.shape) @ weight)
    best = np.where(allowed, products, np.inf).argmin()
    return np.full(len(weight), best), np.ones(len(weight))


def _per_patch(v: Array, cost: Array, weight: Array, allowed: np.ndarray) -> tuple[Array, Array]:
    """Return the best of the allowed places of each patch, at equal numbers of samples."""
    cost = np.broadcast_to(cost, v.shape)
    best = np.full(len(weight), v[..., 0].size // 2)
    for _ in range(8):  # the price of cost depends on the choice: a fixed point
        price = (_at(v, best) @ weight) / (_at(cost, best) @ weight)
        best = _least(v + price * cost, allowed)
    return best, np.ones(len(weight))


def _with_counts(v: Array, cost: Array, weight: Array, allowed: np.ndarray) -> tuple[Array, Array]:
    """Return the best of the allowed places of each patch, and its number of samples, ``sqrt(V / C)``."""
    v = np.maximum(v, 0) + LEAST_VARIANCE * (v[HALF, HALF] @ weight) / weight.sum()
    cost = np.broadcast_to(cost, v.shape)
    best = _least(v * cost, allowed)
    return best, np.sqrt(_at(v, best) / _at(cost, best))


def _least(values: Array, allowed: np.ndarray) -> np.ndarray:
    flat = np.where(allowed[..., None], values, np.inf).reshape(-1, values.shape[-1])
    return flat.argmin(axis=0)


def _at(values: Array, best: np.ndarray) -> Array:
    flat = values.reshape(-1, values.shape[-1])
    return np.asarray(flat[best, np.arange(len(best))])


_RATIOS = [np.divide.outer(a, b) for a, b in ((GRID, GRID), (1 - GRID, 1 - GRID))]
_ALL = np.max(_RATIOS, axis=0).T <= MOST_RATIO
_HALF = np.zeros_like(_ALL)
_HALF[HALF, HALF] = True
_TILT = np.zeros_like(_ALL)
_TILT[HALF] = True
_SHARE = np.eye(len(GRID), dtype=bool)
BOUNDS = {
    "one tilt": (_one, _TILT),
    "tilt per patch": (_per_patch, _TILT),
    "one share": (_one, _SHARE),
    "share per patch": (_per_patch, _SHARE),
    "share and tilt": (_per_patch, _ALL),
    "counts": (_with_counts, _HALF),
    "counts and shares": (_with_counts, _SHARE),
    "counts, shares and tilts": (_with_counts, _ALL),
}
"""What may be chosen, by the names of bounds."""


def bounds(data: Bounds, measure: int, keep: np.ndarray, judged: int = 1) -> Array:
    """Return the error times cost of each of `BOUNDS` over that of balance; measure 0 is absolute, 1 relative.

    `judged` is 1 if the other half of the samples judges, and 0 if the same does, which flatters.
    """
    curves = [variance(data.terms[h, measure], data.position[h, measure])[..., keep] for h in range(2)]
    cost, weight = data.cost[:, None, keep], data.weight[keep]
    weight = weight / weight.sum()
    whole = np.broadcast_to(cost, curves[0].shape)
    balance = sum(v[HALF, HALF] @ weight for v in curves) * (cost[HALF, 0] @ weight)
    values = []
    for choose, allowed in BOUNDS.values():
        total = 0.0
        for h in range(2):
            best, n = choose(curves[h], cost, weight, allowed)
            # mean(V / n) mean(n C)
            total += (_at(curves[(h + judged) % 2], best) / n) @ weight * ((_at(whole, best) * n) @ weight)
        values.append(total / balance)
    return np.array(values)


def one_of_image(data: Bounds, kind: str) -> float:
    """Return the best tilt or share for the absolute error of the whole image; `kind` is a name of `BOUNDS`."""
    choose, allowed = BOUNDS[kind]
    curves = variance(data.terms[:, 0].mean(axis=0), data.position[:, 0].mean(axis=0))
    best, _ = choose(curves, data.cost[:, None], data.weight, allowed)
    # of a share, places of the grid are equal; of a tilt, the first is 1/2
    return float(GRID[best[0] % len(GRID)])


def with_interval(estimate: Callable[[np.ndarray], Array], patches: int, groups: int = GROUPS) -> tuple[Array, Array]:
    """Return an estimate and half of its 95 % interval, from estimates that leave out one group of patches each."""
    from scipy.stats import t

    numbers = np.arange(patches)
    left = np.stack([estimate(numbers[numbers % groups != g]) for g in range(groups)])
    error = np.sqrt((groups - 1) / groups * np.square(left - left.mean(axis=0)).sum(axis=0))
    return estimate(numbers), t.ppf(0.975, groups - 1) * error


# Files --------------------------------------------------------------------------------------------------------------


def path_of_bounds(name: str, size: str) -> Path:
    """Return the file of a scene's bounds."""
    return path_of(name).with_name(f"bounds-{name}-{size}.npz")


def read_bounds(name: str, size: str) -> Bounds:
    """Return the moments of a scene at a size of `SIZES`, measured at the first call."""
    path = path_of_bounds(name, size)
    if not path.exists():
        print(path, flush=True)
        scene, settings = load(f"full-{name}")
        data = measure_bounds(resized(scene, SIZES[size]), settings)
        path.parent.mkdir(parents=True, exist_ok=True)
        with replacing(path) as partial_path, open(partial_path, "wb") as file:
            np.savez_compressed(file, allow_pickle=False, **vars(data))
    with np.load(path, allow_pickle=False) as arrays:
        return Bounds(**arrays)
