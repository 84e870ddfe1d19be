"""Rule of two rounds: the first, equal for all pixels, decides patterns and numbers of samples of the second.

Samples that are in the image must not decide how many there are: where they happen to be bright their pixel would get
more, and the mean of all would be too dark. So pixels have four colours, 2x2 neighbours having all of them, and the
pattern and the number of samples of a pixel come from the samples of the other colours alone. Then the mean of all its
samples, those of the first round included, is unbiased.

The squared error of n low-discrepancy points falls as ``V n^-a``, with a = 1.4 or so, and a camera sample costs C. At a
given cost of the image its error is least with

    n ~ (V / C)^(1 / (1 + a)),

and of several patterns the one with the least ``V C^a`` is best. V of the first round's pattern is measured at each
pixel: the spread of four sub-blocks of its samples (`dmis.variance.moments.SubBlocks`), averaged over its neighbours.
For another pattern V is scaled by the ratio of variances with independent points,

    V = P + A(w) / S,

of which P comes from the place in the pixel, and A from S shading samples (`dmis.variance.pattern_curves`). A pixel
whose pattern changes may restart its sequence: the first round is then lost, and the new pattern must make up for
that. Or it goes on with another pattern: places in the pixel stay stratified, but light and BRDF samples of
m = n - n_1 later camera samples do not fill the gaps of the n_1 first ones, and the error is

    P n^-a + (m / n)^2 A(w) / S m^-a + (n_1 / n)^2 A(1/2) / 4 n_1^-a.

(A technique with one sample has points n_1 to 2 n_1 - 1 of its sequence twice then, which the formula leaves out.)

The error is the sum over pixels of V q n^-a, where q = 1 / (I^2 + e) and I is the radiance of the pixel whose V it is,
or with ``error=absolute`` q = 1. Neighbours are averaged as V q, because where one of them is bright and another is
black, a mean V over a mean I^2 has the noise of the first and the weight of the second.

V of a few samples is uncertain: where it is large it was partly luck, and its pixel needs fewer samples than V says.
So numbers follow V^t with a confidence t from 0 to 1, the one at which they would have made the error of the first
round least, in pixels of another colour, see `Auto._confidence`.
"""

from __future__ import annotations

from collections.abc import Callable, Generator, Mapping
from dataclasses import KW_ONLY, dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from dmis.base.patches import COLOURS, PATCH, patch_mean, patch_spread, patch_sum, row_blocks
from dmis.base.validate import number, one_of
from dmis.base.vectors import TINY, Array
from dmis.estimator.allocation import shares_of
from dmis.estimator.cost import camera_sample_cost, rays_of_colours
from dmis.estimator.mis import combiner_by_name
from dmis.estimator.patterns import EQUAL, FIRST, PATTERNS, SAMPLES_OF, SHARE_OF, SHARES, PatternMap, separate_lights
from dmis.estimator.records import Statistic
from dmis.filter import gaussian
from dmis.fit.curve_minimum import PatchCurves, allowed_weights
from dmis.fit.pooling import pool
from dmis.fit.round import Budget, Pilot, Round
from dmis.fit.rule import OptionRule
from dmis.fit.sample_numbers import light_halvings, powers_of_two
from dmis.variance.pattern_curves import PatternCurves

HALF = int(np.flatnonzero(SHARES == 0.5)[0])
"""Index of w = 1/2 in `dmis.estimator.patterns.SHARES`."""
EXPONENT = 1.4
"""a of low-discrepancy points; of independent ones it is 1."""
CONFIDENCES = {"absolute": (1.0, 0.75, 0.5, 0.25, 0.0), "relative": (0.75, 0.5, 0.25, 0.0)}
"""Powers of the variance which numbers of samples may follow, by the error that is made least; at 0 they are equal.

At 1 relMSE is larger where dark pixels have rare highlights, as on killeroo-gold, and a little smaller elsewhere.
"""
SPIKES = 0.1
"""Share of the variance of independent points that is added to that of a pixel, against spikes not seen yet."""
DARK = 0.1
"""e in relative errors, over the squared mean radiance of the image: near the .01 of relMSE where that mean is .3."""
LEAST_SPP = 16
"""Budget from which on there is a first round."""
FIRST_ROUNDS = ((32, 4), (64, 8), (256, 16), (1024, 32))
"""Budgets below which a first round is so large: twice the number of its camera samples, which have two pairs."""
LONGEST = 64
"""Size of the first round of all larger budgets."""


@dataclass(frozen=True, eq=False)
class Decision:
    """What is decided for the A x B pixels of one colour.

    Attributes
    ----------
    pattern
        Index of the pattern of each pixel, ``(A, B)``.
    restarts
        Whether its sequence restarts, so that its first round is not in the image, ``(A, B)`` bool.
    density
        Camera samples in proportion, not negative, ``(A, B)``.
    cost
        Cost of a camera sample with each pattern, over that of the pattern 1:1.
    confidence
        Power of the variance that the density follows.
    pattern_of_patch
        Index of the pattern of each patch of the image.
    cost_ratio
        Cost of a camera sample with these halvings over its cost without, ``(A, B)`` or 1.
    halvings
        Halvings of each light, ``(L + 1, A, B)``; None: no halvings (`dmis.estimator.patterns`).
    """

    pattern: np.ndarray
    restarts: np.ndarray
    density: Array
    cost: Array
    confidence: float
    pattern_of_patch: np.ndarray
    cost_ratio: Array | float = 1.0
    halvings: np.ndarray | None = None


@dataclass(frozen=True)
class Auto(OptionRule):
    """Patterns of light and BRDF samples, and numbers of camera samples per pixel, from a first round.

    Parameters
    ----------
    weights
        Whether patterns may have any share of light samples; otherwise w = 1/2, and numbers of samples are learned.
    spp
        Twice the number of camera samples of the first round, a multiple of 4; 0: by the budget. With a budget of less
        than twice as many all pixels have equal numbers.
    exponent
        a; 0: by the sampler.
    filter
        Of the statistics that tell patterns: ``gaussian`` or ``none``; or ``joint``, among neighbours that look alike.
    error
        Error to minimise: ``relative``, the mean of squared errors over I^2 + e, or ``absolute``, the MSE.
    guard
        Leave w = 1/2 only where the gain in variance is more than this many standard errors.
    combiner
        Of the samples: a heuristic.
    sampler, compensation
        See `dmis.fit.pooled_rule.PooledRule`.
    """

    weights: bool = True
    _: KW_ONLY
    spp: int = 0
    exponent: float = 0.0
    filter: str = "joint"
    guard: float = 1.5
    error: str = "relative"
    combiner: str = "balance"
    sampler: str = ""
    compensation: float | None = None

    def __post_init__(self) -> None:
        if self.spp < 0 or self.spp % 4:
            raise ValueError(f"spp of the first round must be a multiple of 4, or 0 to choose it; got {self.spp}")
        if self.exponent:
            number("exponent", self.exponent, 1, 3, "or 0 to choose it")
        number("guard", self.guard, 0, more="in standard errors")
        one_of("filter", self.filter, ("gaussian", "none", "joint"))
        if not combiner_by_name(self.combiner).is_heuristic:
            raise ValueError(
                f"combiner must be a heuristic, such as balance or power, because a pixel's samples are of two rounds; "
                f"got {self.combiner!r}. Use second-moment:combiner={self.combiner}"
            )

    @property
    def pilot(self) -> Mapping[float, int]:
        return {0.5: self.spp or FIRST_ROUNDS[0][1]}

    @property
    def settings(self) -> Mapping[str, Any]:
        return {**super().settings, "reuse_pilot": False}

    @property
    def statistic(self) -> Callable[[int, int], Statistic]:
        return partial(PatternCurves, combiner=self.combiner)

    @property
    def needs_features(self) -> bool:
        return self.filter == "joint"

    @property
    def least_spp(self) -> int:
        """Budget from which on there is a first round."""
        return max(LEAST_SPP, 2 * self.spp)

    def pilot_samples(self, spp: int) -> int:
        """Return twice the number of camera samples of the first round of a budget; 0 if there is none."""
        first = self.spp or next((n for below, n in FIRST_ROUNDS if spp < below), LONGEST)
        return 0 if spp < self.least_spp else first

    def rounds(self, budget: Budget) -> Generator[Round, Pilot, None]:
        """Yield the first round, which is the same for all pixels, and the second one that it decides."""
        exponent = self.exponent or (1.0 if budget.settings.sampler == "independent" else EXPONENT)
        rule = replace(self, exponent=exponent)
        lights = 0 if budget.plan is None else separate_lights(budget.plan, budget.settings)
        statistic = partial(PatternCurves, combiner=self.combiner, lights=lights)
        first_round = budget.pilot(0.5, self.pilot_samples(budget.spp), statistic, self.needs_features)
        # the points of the second round go on from those of the first
        settings = replace(first_round.settings, sampler=budget.settings.sampler)
        first = yield replace(first_round, settings=settings)
        second_round = rule.second_round(first, budget)
        del first  # its statistics are large
        yield second_round

    def second_round(self, first: Pilot, budget: Budget) -> Round:
        """Return patterns and numbers of samples from the first round.

        Its maps are the `pattern` of each patch for the pixels of each colour, the `variance` of each pixel's mean of
        the first round, and the `confidence` of each colour, ``(4,)``.
        """
        n, shape = int(np.max(first.moments.n)), first.moments.mean.shape[:2]
        # variance of each pixel's mean of n samples
        variance = np.einsum("yxc,yxc->yx", first.moments.root, first.moments.root, dtype=np.float64)
        variance /= 3 * n * max(n - 1, 1)
        variance = variance.astype(np.float32)
        pattern, begin, samples = np.empty(shape, np.uint8), np.empty(shape, np.int32), np.empty(shape, np.int32)
        halvings = np.zeros((first.sums["lights"].shape[1], *shape), np.uint8) if "lights" in first.sums else None
        confidence, patches = np.ones(len(COLOURS)), []
        for colour, at in enumerate(COLOURS):
            if not pattern[at].size:
                continue
            decision = self.decide(first, variance, colour)
            pattern[at], begin[at] = decision.pattern, np.where(decision.restarts, 0, n)
            cost = decision.cost[pattern[at]] * decision.cost_ratio
            least = np.where(decision.restarts, 2, n)  # one sample has no variance
            # in units of camera samples of the pattern 1:1; the first round counts as if it had the pixel's own cost
            allowance = (float(budget.spp) - decision.cost[FIRST] * n + begin[at] * cost).sum()
            chance = budget.generator(1).random(shape)[at].copy()  # of the whole image, which is large
            samples[at] = powers_of_two(decision.density, cost, least, allowance, chance) - begin[at]
            confidence[colour] = decision.confidence
            if halvings is not None:
                halvings[:, *at] = decision.halvings
            patches.append(decision.pattern_of_patch)
            del decision, cost, least, chance  # images
        scale = first.shading_samples // int(SAMPLES_OF[FIRST])
        sizes = tuple((n_l * scale, n_b * scale) for n_l, n_b in PATTERNS)
        return Round(
            samples,
            shares_of(0.5),
            budget.settings,
            patterns=PatternMap(sizes, pattern, sizes[FIRST], halvings),
            begin=begin,
            before=first.moments,
            image_weight=budget.spp,
            stage="final",
            maps={"pattern": np.stack(patches), "variance": variance, "confidence": confidence},
        )

    def decide(self, first: Pilot, variance: Array, colour: int) -> Decision:
        """Return patterns and densities of the pixels of one colour, from the samples of the others.

        `variance` is that of each pixel's mean of the first round, ``(H, W)``.
        """
        n, shape, at = int(np.max(first.moments.n)), variance.shape, COLOURS[colour]
        curves, lights = self._curves(first, colour, shape)
        cost, of_lights = _costs(first, colour)
        spikes = SPIKES * (np.maximum(curves.curve[HALF] / 2, 0) + np.maximum(curves.position, 0)) / n
        weight = None
        if self.error == "relative":
            weight, weight_of_patches = _relative_weight(first, colour)
            variance, spikes = variance * weight, spikes * weight_of_patches
        confidence = self._confidence(first, variance, spikes, weight, colour)
        v = _variance(variance, spikes, at)
        v **= confidence
        of_colour = v[at].copy()
        spent = self._spent(v, cost, first.budget, n)
        del v  # an image
        allowed = allowed_weights(curves.curve.sum(axis=(1, 2)))[:, None, None] & self.weights
        # some rows at a time, because there are many patterns
        blocks = [self._best_patterns(curves.rows(r), cost, spent[r], allowed) for r in row_blocks(len(spent), 4)]
        of_patches = [np.concatenate(maps) for maps in zip(*blocks, strict=True)]
        pattern, restarts, ratio = (patch_spread(a, PATCH, shape, at) for a in of_patches)
        cost_ratio: Array | float = 1.0
        halvings = None
        if lights is not None:
            of_light = of_lights[:, of_patches[0]]
            chosen = light_halvings(lights, of_light, cost[of_patches[0]] - of_light.sum(axis=0), self.exponent)
            of_pixels = (patch_spread(a, PATCH, shape, at) for a in (*chosen[0], *chosen[1:]))
            *halving, variance_ratio, cost_ratio = of_pixels
            halvings, ratio = np.stack(halving), ratio * variance_ratio
        density = self._density(of_colour * ratio, cost[pattern] * cost_ratio)
        return Decision(pattern, restarts, density, cost, confidence, of_patches[0], cost_ratio, halvings)

    def _curves(self, first: Pilot, colour: int, shape: tuple[int, int]) -> tuple[PatchCurves, Array | None]:
        """Return the curves of patches at `SHARES`, for two shading samples, from the samples of the other colours.

        And the variance of what is reflected of each light, and of the rest; None if it was not gathered.
        """
        others = [k for k in range(len(COLOURS)) if k != colour]
        pixels = np.ones(shape, np.uint8)
        pixels[COLOURS[colour]] = 0
        number = {"pixels": np.maximum(patch_sum(pixels, PATCH), 1e-9)}
        sigma, features = None if self.filter == "none" else 1.0, first.features if self.needs_features else None
        sums = ((name, sum(a[k] for k in others)) for name, a in first.sums.items() if name != "halves")
        means, effective_number = pool({**dict(sums), **number}, shape, PATCH, sigma, 2, features)
        lights = means.pop("lights", None)
        return PatchCurves(**means, pixels=effective_number, baseline=HALF), lights

    def _confidence(self, first: Pilot, variance: Array, spikes: Array, weight: Array | None, colour: int) -> float:
        """Return the power of the variance that the numbers of samples of a colour follow.

        It is judged at the pixels of the opposite colour in 2x2 neighbours, for which the other two predict V. Numbers
        n_p of them would have the error sum_p v_p n_p^-a. Here v_p comes from the halves of the samples of these
        pixels, summed over those in a patch; only `SPIKES` of the prediction has them, too. (Four parts of few samples
        overrate pixels with an edge, whose error falls fast, and so would agree with what overrates them as well.)
        """
        opposite = len(COLOURS) - 1 - colour
        judge = COLOURS[opposite]
        n = int(np.max(first.moments.n))
        own = patch_spread(first.sums["halves"][opposite], PATCH, variance.shape, judge)
        if weight is not None:
            own = own * weight[judge]
        predicted = _variance(variance, spikes, COLOURS[colour], judge)[judge].copy()
        if not own.any() or not predicted.any():
            return CONFIDENCES[self.error][0]

        def error(confidence: float) -> float:
            number = self._density(predicted**confidence, 1.0)
            number = np.maximum(number * (first.budget / number.mean()), n)
            return float(np.vdot(own, (number / number.mean()) ** -self.exponent))

        return min(CONFIDENCES[self.error], key=error)

    def _density(self, variance: Array, cost: Array | float) -> Array:
        """Return numbers of samples in proportion, ``(V / C)^(1 / (1 + a))``, in the place of `variance`."""
        variance /= cost
        variance **= 1 / (1 + self.exponent)
        return variance

    def _spent(self, variance: Array, cost: Array, budget: int, n: int) -> Array:
        """Return n_1 / n of each patch, if all pixels keep the pattern of the first round; overwrites `variance`."""
        samples = self._density(variance, cost[FIRST])
        mean = samples.mean()
        if mean > 0:
            samples *= budget / cost[FIRST] / mean
        return n / patch_mean(np.maximum(samples, n, out=samples), PATCH)

    def _best_patterns(
        self, curves: PatchCurves, cost: Array, spent: Array, allowed: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, Array]:
        """Return the best pattern of each patch, whether its pixels restart, and V over the first round's.

        `spent` is the share of a patch's samples that the first round is, `allowed` says which shares may be used.
        """
        # V = P + A(w) / S,  A(w) / 2 being the curve
        place = np.maximum(curves.position, 0)
        curve = curves.curve[SHARE_OF] * (2 / SAMPLES_OF[:, None, None])
        variance = np.maximum(place + curve, 0)
        # n_1 of the first round and m later camera samples, for a total cost of 1
        n_1, m = spent / cost[FIRST], np.maximum(1 - spent, 1e-3) / cost[:, None, None]
        n, exponent = n_1 + m, self.exponent
        shading = (m ** (2 - exponent) * curve + n_1 ** (2 - exponent) * curve[FIRST]) / n**2
        error_on = np.maximum(place * n**-exponent + shading, 0)
        error_on[FIRST] = variance[FIRST] * cost[FIRST] ** exponent  # one even sequence
        error_restarted = variance * m**-exponent
        error = np.minimum(error_on, error_restarted)
        # another share than 1/2 only where the gain is certain
        certain = curves.curve - curves.curve[HALF] < -self.guard * curves.gain_error()
        certain &= allowed
        certain[HALF] = True
        error = np.where(certain[SHARE_OF], error, np.inf)
        best = np.where(error[FIRST] <= error.min(axis=0), FIRST, error.argmin(axis=0))[None]
        chosen, on, number, left = (np.take_along_axis(x, best, axis=0)[0] for x in (error, error_on, n, m))
        restarts = chosen < on
        chosen = chosen * np.where(restarts, left, number) ** exponent
        ratio = np.divide(chosen, variance[FIRST], out=np.ones_like(chosen), where=variance[FIRST] > 0)
        return best[0].astype(np.uint8), restarts, ratio


def _variance(variance: Array, spikes: Array, *colours: tuple[slice, slice]) -> Array:
    """Return V n^-a of the first round around each pixel, from pixels of other `colours`, ``(H, W)``.

    `spikes` is added to the pixels of each patch, see `SPIKES`.
    """
    others = np.ones(variance.shape, bool)
    for colour in colours:
        others[colour] = False
    if not others.any():
        return np.ones(variance.shape)
    v = patch_spread(spikes, PATCH, variance.shape)
    for rows in row_blocks(len(v), 64):
        near = slice(max(rows.start - 2, 0), rows.stop + 2)
        smooth = gaussian(np.where(others[near], variance[near], np.nan), 1.0, 2)
        v[rows] += np.maximum(smooth[rows.start - near.start :][: rows.stop - rows.start], 0)
    return v


def _relative_weight(first: Pilot, colour: int) -> tuple[Array, Array]:
    """Return the weight 1 / (I^2 + e) of each pixel, ``(H, W)``, and its mean over pixels of other colours by patch.

    I is the mean of the channels, and e is `DARK` times the square of its mean over these pixels, so that an image that
    is ten times brighter has the same numbers of samples.
    """
    radiance = first.moments.mean.mean(axis=2)
    others = np.ones(radiance.shape, np.float32)
    others[COLOURS[colour]] = 0
    count = max(float(others.sum()), 1.0)
    bound = DARK * (float(np.vdot(others, radiance)) / count) ** 2
    weight = 1 / (radiance**2 + np.float32(max(bound, float(TINY))))
    return weight, patch_sum(weight * others, PATCH) / np.maximum(patch_sum(others, PATCH), 1)


def _costs(first: Pilot, colour: int) -> tuple[Array, Array]:
    """Return the cost of a camera sample with each pattern over the cost with `EQUAL`, for pixels of a colour.

    And the part of each light in it, delta lights together in the last place, ``(L + 1, patterns)``. Rays are counted
    in the other colours, so that a pixel's own samples do not decide how many it gets.
    """
    rays = rays_of_colours(first.rays, [k for k in range(len(COLOURS)) if k != colour])
    shares = np.array([SHARES[SHARE_OF], 1 - SHARES[SHARE_OF]])
    samples = SAMPLES_OF * (first.shading_samples // int(SAMPLES_OF[FIRST]))
    lights = len(first.sums["lights"][0]) - 1 if "lights" in first.sums else 1

    every, unlit, without_deltas = (
        camera_sample_cost(kinds, shares, first.shading_samples, s, first.techniques, lights)
        for kinds, s in ((rays, samples), (rays, 0 * samples), ({**rays, "delta": 0}, 0 * samples))
    )
    of_lights = np.stack([*[(every - unlit) / lights] * lights, unlit - without_deltas])
    return every / every[EQUAL], of_lights / every[EQUAL]
