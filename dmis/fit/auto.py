"""Rule of two rounds: the first, equal for all pixels, decides patterns and numbers of samples of the second.

A few samples of each pixel show where the image is noisy, and whether light or BRDF samples make less noise there. The
rest of the budget goes where it lowers the error most, with the pattern that suits the place: see the formulas of
`dmis.fit.best_pattern` and `dmis.fit.sample_density`.

Samples that are in the image must not decide how many there are. Where the first ones happen to hit a lamp, the pixel
looks noisy and gets more, which pull its mean down to the truth; where they miss the lamp, it looks black and even, and
stays so: the mean of all is too dark. So pixels have four *colours*, 2x2 neighbours having all of them, and the pattern
and the number of samples of a pixel come from the samples of the other colours alone. Then the mean of all its samples,
those of the first round included, is unbiased.
"""

from __future__ import annotations

from collections.abc import Generator, Mapping
from dataclasses import KW_ONLY, dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from dmis.base.patches import COLOURS, PATCH, other_colours, patch_spread
from dmis.base.validate import number, one_of
from dmis.estimator.allocation import shares_of
from dmis.estimator.cost import pattern_costs, rays_of_colours
from dmis.estimator.mis import combiner_by_name
from dmis.estimator.patterns import FIRST, PATTERNS, SAMPLES_OF, PatternMap, separate_lights
from dmis.fit.best_pattern import choose_patterns, curves_of_patches
from dmis.fit.round import Budget, Pilot, Round
from dmis.fit.rule import OptionRule
from dmis.fit.sample_density import CONFIDENCES, EXPONENT, sample_density, variance_of_colour, variance_of_mean
from dmis.fit.sample_numbers import FIRST_ROUNDS, LEAST_SPP, powers_of_two
from dmis.variance.pattern_curves import PatternCurves


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
        Of the samples: a heuristic. None: as the settings say.
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
    combiner: str | None = None
    sampler: str | None = None
    compensation: float | None = None
    statistic = PatternCurves

    def __post_init__(self) -> None:
        if self.spp < 0 or self.spp % 4:
            raise ValueError(f"spp of the first round must be a multiple of 4, or 0 to choose it; got {self.spp}")
        if self.exponent:
            number("exponent", self.exponent, 1, 3, "or 0 to choose it")
        number("guard", self.guard, 0, more="in standard errors")
        one_of("filter", self.filter, ("gaussian", "none", "joint"))
        one_of("error", self.error, CONFIDENCES)
        if self.combiner is not None and not combiner_by_name(self.combiner).is_heuristic:
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
    def least_spp(self) -> int:
        """Budget from which on there is a first round."""
        return max(LEAST_SPP, 2 * self.spp)

    def pilot_samples(self, spp: int) -> int:
        """Return twice the number of camera samples of the first round of a budget; 0 if there is none."""
        first = self.spp or next(n for below, n in FIRST_ROUNDS if spp < below)
        return 0 if spp < self.least_spp else first

    def rounds(self, budget: Budget) -> Generator[Round, Pilot, None]:
        """Yield the first round, which is the same for all pixels, and the second one that it decides."""
        exponent = self.exponent or (1.0 if budget.settings.sampler == "independent" else EXPONENT)
        lights = 0 if budget.plan is None else separate_lights(budget.plan, budget.settings)
        statistic = partial(PatternCurves, combiner=budget.settings.combiner, lights=lights)
        first_round = budget.pilot(0.5, self.pilot_samples(budget.spp), statistic, self.filter == "joint")
        # the points of the second round go on from those of the first
        settings = replace(first_round.settings, sampler=budget.settings.sampler)
        first = yield replace(first_round, settings=settings)
        second_round = replace(self, exponent=exponent).second_round(first, budget)
        del first  # its statistics are large
        yield second_round

    def second_round(self, first: Pilot, budget: Budget) -> Round:
        """Return patterns and numbers of samples from the first round.

        Maps: `pattern` of each patch by colour, `variance` of each pixel's mean in the first round, `confidence`.
        """
        n_1 = int(np.max(first.moments.n))
        variance = variance_of_mean(first)
        shape = variance.shape
        pattern = np.empty(shape, np.uint8)
        begin, samples = np.empty((2, *shape), np.int32)
        halvings = np.empty((first.sums["lights"].shape[1] if "lights" in first.sums else 0, *shape), np.uint8)
        confidence = np.ones(len(COLOURS))
        patches = []
        for colour, at in enumerate(COLOURS):
            if not pattern[at].size:
                continue
            curves, lights = curves_of_patches(first, colour, self.filter)
            rays = rays_of_colours(first.rays, other_colours(colour))
            costs = pattern_costs(rays, first.shading_samples, first.techniques, max(len(lights) - 1, 1))
            first_cost = costs[0][FIRST]
            v, first_share, confidence[colour] = variance_of_colour(
                first, variance, curves, first_cost, colour, self.error, self.exponent
            )
            choice = choose_patterns(curves, lights, costs, first_share, self.weights, self.guard, self.exponent)
            del curves, lights, first_share  # as large as an image
            spread = partial(patch_spread, size=PATCH, shape=shape, at=at)
            patches.append(choice.pattern)
            pattern[at] = spread(choice.pattern)
            halvings[:, *at] = spread(choice.halvings)
            begin[at] = np.where(spread(choice.restarts), 0, n_1)
            least = np.where(begin[at], n_1, 2)  # one sample has no variance
            cost = spread(choice.cost)
            density = sample_density(v * spread(choice.variance_ratio), cost, self.exponent)
            # in units of camera samples of the pattern 1:1; the first round counts as if it had the pixel's own cost
            allowance = (float(budget.spp) - first_cost * n_1 + begin[at] * cost).sum()
            chance = budget.generator(1).random(shape)[at].copy()  # of the whole image, which is large
            samples[at] = powers_of_two(density, cost, least, allowance, chance) - begin[at]
            del choice, v, density, least, cost, chance  # images
        scale = first.shading_samples // int(SAMPLES_OF[FIRST])
        sizes = tuple((n_l * scale, n_b * scale) for n_l, n_b in PATTERNS)
        return Round(
            samples,
            shares_of(0.5),
            budget.settings,
            patterns=PatternMap(sizes, pattern, sizes[FIRST], halvings if len(halvings) else None),
            begin=begin,
            before=first.moments,
            image_weight=budget.spp,
            stage="final",
            maps={"pattern": np.stack(patches), "variance": variance, "confidence": confidence},
        )
