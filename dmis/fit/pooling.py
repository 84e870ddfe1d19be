"""Statistics pooled over patches and filtered, the minimum of variance curves, and the base class of learning rules."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from dmis.base.patches import PATCH, patch_mean, patch_sum, row_blocks
from dmis.base.validate import number, one_of, positive
from dmis.base.vectors import Array
from dmis.estimator.cost import camera_sample_cost
from dmis.filter import check_taps, effective, gaussian, joint
from dmis.fit.round import Weight
from dmis.fit.rule import Rule
from dmis.scene.feature_buffers import FEATURE_SCALES
from dmis.variance.curves import HALF
from dmis.variance.moments import Film


def pool(
    sums: Mapping[str, Array],
    shape: tuple[int, int],
    patch: int,
    sigma: float | None = None,
    radius: int = 2,
    features: Mapping[str, Array] | None = None,
) -> tuple[dict[str, Array], Array]:
    """Return means over patches of statistics that were summed over patches of `PATCH` pixels.

    Parameters
    ----------
    sums
        By name, ``(..., rows, columns)`` of base patches; ``pixels`` are the pixels in them, if not all.
    shape
        ``(H, W)`` of the image in pixels.
    patch
        Side of the new patches, a multiple of `PATCH`.
    sigma, radius
        Of a Gaussian over the new patches, in patches; None: no filter.
    features
        Feature buffers of base patches, see `dmis.scene.feature_buffers`: the Gaussian is narrowed to neighbours with
        similar features. None: it is not.

    Returns
    -------
    means
        By name, ``(..., rows, columns)`` of the new patches.
    pixels
        Effective number of pixels in each mean, ``(rows, columns)``.
    """
    sums = sums if "pixels" in sums else {"pixels": patch_sum(np.ones(shape), PATCH), **sums}
    coarse = {name: patch_sum(a, patch // PATCH) for name, a in sums.items()}
    del sums  # the filtered ones take the place of sums that the caller does not keep
    patches: Array | float = 1.0  # effective number of patches in each mean
    if sigma is not None and features is not None:
        of_patches = {name: patch_mean(a, patch // PATCH) for name, a in features.items()}
        coarse, patches = _joint(coarse, of_patches, sigma, radius)
    elif sigma is not None:
        for name, a in coarse.items():
            flat = a.reshape(-1, *a.shape[-2:])
            coarse[name] = np.stack([gaussian(values, sigma, radius) for values in flat]).reshape(a.shape)
        patches = effective(coarse["pixels"].shape, sigma, radius)
    pixels = coarse.pop("pixels")
    return {name: coarse.pop(name) / pixels for name in list(coarse)}, pixels * patches


def _joint(
    maps: Mapping[str, Array], features: Mapping[str, Array], sigma: float, radius: int
) -> tuple[dict[str, Array], Array]:
    """Return all maps after the joint filter, and the effective number of patches; computed some rows at a time."""
    filtered = {name: np.empty(a.shape) for name, a in maps.items()}
    rows, columns = maps["pixels"].shape
    patches = np.empty((rows, columns))
    ends = np.cumsum([a[..., 0, 0].size for a in maps.values()])[:-1]
    for block in row_blocks(rows, max(16, 2 * radius)):
        near = slice(max(block.start - radius, 0), min(block.stop + radius, rows))
        flat = np.concatenate([a[..., near, :].reshape(-1, near.stop - near.start, columns) for a in maps.values()])
        flat, entries = joint(flat, {name: g[:, near] for name, g in features.items()}, FEATURE_SCALES, sigma, radius)
        inner = slice(block.start - near.start, block.stop - near.start)
        patches[block] = entries[inner]
        for a, part in zip(filtered.values(), np.split(flat[:, inner], ends), strict=True):
            a[..., block, :] = part.reshape(a[..., block, :].shape)
    return filtered, patches


@dataclass(frozen=True, eq=False)
class PatchCurves:
    """Variance curves V(w), averaged over the pixels of each patch, in any shape ``(...)``.

    Attributes
    ----------
    curve
        Part of the variance of a camera sample that depends on w, at the G shares of the grid, ``(G, ...)``.
    gain_square
        Means over pixels of the square of its difference from the baseline point, for standard errors.
    position
        Var_y(I), the part of the variance that does not depend on w.
    pixels
        Number of pixels in each mean.
    baseline
        Index of the baseline point, which rules leave only for a significant gain: of w = 1/2.
    pattern
        Var_y(D), the variance that uneven numbers of light samples add, ``(G, ...)``; None if it was not gathered.
    """

    curve: Array
    gain_square: Array
    position: Array
    pixels: Array
    baseline: int = HALF
    pattern: Array | None = None

    @property
    def variance(self) -> Array:
        """Variance of a camera sample at each share, ``(G, ...)``.

        An estimate: where the pilot is small it may be negative.
        """
        return self.curve + np.maximum(self.position, 0)

    def rows(self, block: slice) -> PatchCurves:
        """Return the curves of some rows of patches, as views."""
        return replace(self, **{name: a[..., block, :] for name, a in vars(self).items() if np.ndim(a) > 1})

    def gain_error(self) -> Array:
        """Return the standard error of ``curve - curve(1/2)``, ``(G, ...)``."""
        mean = self.curve - self.curve[self.baseline]
        return np.sqrt(np.maximum(self.gain_square - mean * mean, 0) / np.maximum(self.pixels - 1, 1))


def guarded_argmin(curves: PatchCurves, cost: Array, guard: float, allowed: np.ndarray, price: float) -> np.ndarray:
    """Return the index into the grid at which ``V + price C`` is least, ``(rows, columns)``.

    The error of an image times its time is ``sum(V / n) sum(n C)`` over patches. With the same number n of samples in
    all of them that is least where each minimises ``V + price C``, the price being ``sum V / sum C``: dark patches
    had better be cheap.

    Parameters
    ----------
    curves
        Variance V of each patch at the G shares of the grid.
    cost
        Cost C of a camera sample at each share, ``(G,)``.
    guard
        Leave the baseline point only for a gain of more than this many standard errors, in variance alone too: a lower
        cost is always certain, and would decide alone where the pilot has no information.
    allowed
        Shares that may be used, ``(G,)`` bool, see `allowed_weights`.
    price
        Variance that a unit of cost is worth.
    """
    index = np.empty(curves.position.shape, np.intp)
    for rows in row_blocks(len(index)):  # curves are large, and intermediate results are larger
        block = curves.rows(rows)
        objective = block.variance + np.asarray(price * cost[:, None, None], block.variance.dtype)
        error = block.gain_error()
        significant = block.variance - block.variance[curves.baseline] < -guard * error
        significant &= objective - objective[curves.baseline] < -guard * error
        significant &= allowed[:, None, None]
        significant[curves.baseline] = True
        index[rows] = np.where(significant, objective, np.inf).argmin(axis=0)
    return index


def allowed_weights(curve: Array) -> np.ndarray:
    """Return which shares of the grid may be used, ``(G,)`` bool, by the curve of the whole image ``(G,)``.

    At the ends of the grid one technique is left out. Where that fails it fails by rare samples of large value, which
    the pilot of a patch seldom has; that of the image has some. So an end may be used if it is as good for the image
    as its neighbour.
    """
    allowed = np.ones(len(curve), bool)
    allowed[0] = curve[0] <= curve[1]
    allowed[-1] = curve[-1] <= curve[-2]
    return allowed


@dataclass(frozen=True, kw_only=True)
class PooledRule(Rule):
    """Base class of rules that average a pilot's statistics over patches, filter them and minimise on each patch.

    A rule names its `statistic`, such as a `dmis.variance.gather.Gather`, and its `fit` takes the means of patches from
    `pooled` and the cost of a camera sample from `sample_cost`. Statistics are shared between neighbours, decisions are
    not: each patch takes its own minimum.

    Parameters
    ----------
    patch
        Side of a patch in pixels, a multiple of 4.
    spp
        Samples of the pilot at w = 1/2: an even number of at least 4, see `dmis.fit.round.pilot_settings`.
    filter
        Of the statistics: ``gaussian`` or ``none``; or ``joint``, a Gaussian among neighbours that look alike
        (`dmis.filter.joint`, `dmis.scene.feature_buffers`).
    size, sigma
        Taps on a side and standard deviation of the Gaussian, in patches.
    cost
        Whether cost counts; otherwise variance alone.
    guard
        Leave the baseline point only where the gain is more than this many standard errors.
    reuse
        Whether the pilot's samples are part of the image.
    combiner, sampler
        Of the final samples.
    compensation
        Of skies, for pilot and final samples, see `dmis.estimator.settings.Settings`.

    The last four are as the settings say where they are None.

    Examples
    --------
    A rule that divides samples in proportion to the root mean square of what each technique estimates::

        def squares(x, d):
            return x * x


        class Squares(dmis.PooledRule):
            statistic = partial(dmis.Gather, squares)

            def fit(self, pilot):
                means, _ = self.pooled(pilot[0.5])
                light, brdf = np.sqrt(np.maximum(means["values"], 1e-12))
                shape = pilot[0.5].mean.shape[:2]
                return dmis.Fit(patch_spread(light / (light + brdf), self.patch, shape))
    """

    patch: int = 4
    spp: int = 6
    filter: str = "joint"
    size: int = 5
    sigma: float = 1.0
    cost: bool = True
    guard: float = 1.5
    reuse: bool | None = None
    combiner: str | None = None
    sampler: str | None = None
    compensation: float | None = None

    shares_only = True

    def __post_init__(self) -> None:
        if self.spp < 4 or self.spp % 2:
            raise ValueError(
                f"spp of the pilot must be even and at least 4, because curves come from pairs of camera samples with "
                f"twice the shading samples; got {self.spp}"
            )
        if not PATCH <= self.patch <= 65536 or self.patch % PATCH:
            raise ValueError(
                f"patch must be a multiple of {PATCH} pixels, in which curves are kept, of at most 65536; got "
                f"{self.patch}"
            )
        check_taps(self.size)
        positive("sigma", self.sigma)
        number("guard", self.guard, 0, more="in standard errors")
        one_of("filter", self.filter, ("gaussian", "none", "joint"))

    @property
    def needs_features(self) -> bool:
        """Whether the filter compares feature buffers."""
        return self.filter == "joint"

    @property
    def pilot(self) -> Mapping[Weight, int]:
        """Samples of the pilot, at w = 1/2."""
        return {0.5: self.spp}

    def pooled(self, pilot: Film) -> tuple[dict[str, Array], Array]:
        """Return the means of the pilot's sums over patches, filtered, and the effective number of pixels of each."""
        sigma = None if self.filter == "none" else self.sigma
        shape = pilot.mean.shape[:2]
        features = pilot.features if self.needs_features else None
        return pool(pilot.sums, shape, self.patch, sigma, self.size // 2, features)

    def sample_cost(self, pilot: Film, shares: Array) -> Array:
        """Return the cost of a camera sample at `shares` ``(K, G)`` of the techniques, ``(G,)``; 1 if none counts."""
        if not self.cost:
            return np.ones(shares.shape[1])
        s = pilot.shading_samples
        return camera_sample_cost(pilot.rays, shares, s, s // len(shares), pilot.techniques)
