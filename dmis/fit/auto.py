"""Rule of three rounds: a pilot decides patterns of samples, a first round numbers of samples, a second has the rest.

A few samples of each pixel show whether light or BRDF samples make less noise there, and where the image is noisy. The
budget goes where it lowers the error most, with the pattern that suits the place: see the formulas of
`dmis.fit.best_pattern` and `dmis.fit.sample_density`. What does not pay is left out: then the image has the samples of
the rule ``balance``.

The pilot's samples are not in the image, and so few that they cost little. Those of the first round are, and samples
that are in the image must not decide how many there are. Where the first ones happen to hit a lamp, the pixel looks
noisy and gets more, which pull its mean down to the truth; where they miss the lamp, it looks black and even, and stays
so: the mean of all is too dark. So pixels have four *colours*, 2x2 neighbours having all of them, and the number of
samples of a pixel comes from the samples of the other colours alone. Then the mean of all its samples, those of the
first round included, is unbiased.
"""

from __future__ import annotations

from collections.abc import Generator, Mapping
from dataclasses import KW_ONLY, dataclass, replace
from functools import partial
from types import MappingProxyType

import numpy as np

from dmis.base.patches import COLOURS, PATCH, patch_spread
from dmis.base.validate import number, one_of
from dmis.base.vectors import Array
from dmis.estimator.mis import combiner_by_name
from dmis.estimator.patterns import EQUAL, SAMPLES_OF, separate_lights
from dmis.fit.best_pattern import PatternChoice, decide_one_pattern, decide_patterns, error_of_numbers, looks_at
from dmis.fit.round import Budget, Fit, Round
from dmis.fit.rule import Rule
from dmis.fit.sample_density import (
    EXPONENT,
    FIRST_ROUNDS,
    LEAST_SPP,
    PATH_PRICE,
    FirstRound,
    density_of_colour,
    powers_of_two,
    sample_costs,
    sample_variance,
    variance_of_mean,
)
from dmis.variance.curves import PatternCurves
from dmis.variance.moments import Film

LOOK, LOOK_PATHS = 16, 128
"""Budgets for which the pilot has one camera sample, of direct lighting and of paths."""
PATHS_LOOK_AT = 2
"""The pilot of paths looks at one of so many patches."""
EXPONENTS = {"direct": EXPONENT, "path": 1.2}
"""a of low-discrepancy points: more dimensions of a path are left to luck."""


@dataclass(frozen=True)
class Auto(Rule):
    """Choose shares per pixel from a pilot, and numbers of camera samples per pixel from a first round.

    Parameters
    ----------
    weights
        Whether there is a pilot that chooses patterns; otherwise all are 1:1, and numbers of samples are learned.
    spp
        Camera samples of the first round, a power of two from 4 on; 0: by the budget. With a budget of less than twice
        as many all pixels have equal numbers.
    exponent
        a; 0: by sampler and integrator, see `EXPONENTS`.
    error
        Error to minimise: ``relative``, the mean of squared errors over I^2 + e, or ``absolute``, the MSE.
    guard
        Leave w = 1/2 only where the gain in variance is more than this many standard errors.
    combiner
        Of the samples: a heuristic. None: as the settings say.
    sampler, compensation
        See `dmis.fit.pooling.PooledRule`.
    """

    weights: bool = True
    _: KW_ONLY
    spp: int = 0
    exponent: float = 0.0
    guard: float = 1.5
    error: str = "relative"
    combiner: str | None = None
    sampler: str | None = None
    compensation: float | None = None
    statistic = PatternCurves
    pilot = MappingProxyType({0.5: 2})
    settings = MappingProxyType({"reuse_pilot": False})

    def __post_init__(self) -> None:
        if self.spp and (self.spp < 4 or self.spp & (self.spp - 1)):
            raise ValueError(
                f"spp of the first round must be a power of two from 4 on, or 0 to choose it; got {self.spp}"
            )
        if self.exponent:
            number("exponent", self.exponent, 1, 3, "or 0 to choose it")
        number("guard", self.guard, 0, more="in standard errors")
        one_of("error", self.error, ("absolute", "relative"))
        if self.combiner is not None and combiner_by_name(self.combiner).collector:
            raise ValueError(
                f"combiner must be a heuristic, such as balance or power, because a pixel's samples are of two rounds; "
                f"got {self.combiner!r}. Use second-moment:combiner={self.combiner}"
            )

    @property
    def least_spp(self) -> int:
        """Budget from which on there is a first round."""
        return max(LEAST_SPP, 2 * self.spp)

    def pilot_samples(self, spp: int) -> int:
        """Return the number of camera samples of the first round of a budget; 0 if there is none."""
        first = self.spp or next(n for below, n in FIRST_ROUNDS if spp < below)
        return 0 if spp < self.least_spp else first

    def looks(self, budget: Budget) -> int:
        """Return the number of camera samples of the pilot; 0 where no pattern can pay, or the budget is too small."""
        mixable = budget.plan is None or budget.plan.mixable
        if not self.weights or not mixable or few(budget):
            return 0
        return max(2, budget.spp // (LOOK_PATHS if on_paths(budget) else LOOK))

    def rounds(self, budget: Budget) -> Generator[Round, Film, None]:
        """Yield the pilot, the first round, which is the same for all pixels, and the second one that it decides.

        On paths the pilot also tells whether uneven numbers may pay. If not, the rest is one round of equal numbers.
        """
        independent = budget.settings.sampler == "independent"
        a = self.exponent or (1.0 if independent else EXPONENTS[budget.settings.integrator])
        n_1 = self.pilot_samples(budget.spp)
        choice: PatternChoice | None = None
        maps: dict[str, np.ndarray] = {}
        features: Mapping[str, Array] = {}
        # what so few samples of paths teach costs more than it saves
        equal = self.weights and not self.spp and on_paths(budget) and few(budget)
        if samples := self.looks(budget):
            path = on_paths(budget)
            lights = 0 if budget.plan is None else separate_lights(budget.plan, budget.settings)
            statistic = partial(PatternCurves, combiner=budget.settings.combiner, lights=lights)
            pilot_round = budget.pilot(0.5, 2 * samples, statistic, not path)
            pilot = yield replace(pilot_round, spp=samples * looks_at(budget.shape, PATHS_LOOK_AT if path else 1))
            if path:
                choice, error = decide_one_pattern(pilot, self.error)
                number_error = error_of_numbers(pilot, self.error, a, n_1)
                equal = number_error >= PATH_PRICE
                maps = {"number_error": np.array([number_error])}
            else:
                choice, error = decide_patterns(pilot, self.error, self.guard, a)
            features = pilot.features
            del pilot  # its statistics are large
            maps |= {"pattern_error": np.array([error])}
        patterns = None if choice is None else choice.of_pixels(budget.shape, budget.settings.shading_samples)
        only = replace(budget.final(Fit(0.5)), patterns=patterns, maps=maps)
        if equal:
            yield only
            return
        first_round = replace(only, spp=n_1, statistic=FirstRound, needs_features=not features)
        first_round = replace(first_round, image_weight=n_1, stage="first")
        first = yield first_round
        first = replace(first, features=features or first.features)
        yield replace(self, exponent=a).second_round(first_round, first, budget, choice, maps)

    def second_round(
        self,
        first_round: Round,
        first: Film,
        budget: Budget,
        choice: PatternChoice | None,
        maps: Mapping[str, np.ndarray],
    ) -> Round:
        """Return the second round: the numbers of samples that the first one decides, with the same patterns.

        Maps: `variance` of each pixel's mean in the first round, and by colour `confidence` and `number_error`, t and
        predicted error of `dmis.fit.sample_density.density_of_colour`.
        """
        n_1, path = int(first_round.spp), on_paths(budget)
        variance, independent = variance_of_mean(first), sample_variance(first)
        shape = variance.shape
        samples = np.full(shape, budget.spp - n_1, np.int32)
        confidence, number_error = np.ones((2, len(COLOURS)))
        lights = 1 if budget.plan is None else max(len(budget.plan.sampled), 1)
        of_equal = budget.settings.shading_samples
        shading_samples = of_equal if choice is None else SAMPLES_OF[choice.pattern] * of_equal / SAMPLES_OF[EQUAL]
        # of the pattern 1:1, in which budgets count, over that of the chosen one
        over_pattern = np.ones(1) if choice is None else 1 / patch_spread(choice.cost, PATCH, shape)
        over_pattern = np.broadcast_to(over_pattern, shape)
        for colour, at in enumerate(COLOURS):
            if not samples[at].size:
                continue
            cost = sample_costs(first, shading_samples, lights, colour)
            density, confidence[colour], number_error[colour] = density_of_colour(
                first, variance, independent, cost, colour, self.error, self.exponent, path
            )
            if confidence[colour] or over_pattern.min() < 1:
                chance = budget.generator(1).random(shape)[at].copy()  # of the whole image, which is large
                allowance = budget.spp * (cost[at] * over_pattern[at]).sum()
                least = np.full(chance.shape, n_1)
                samples[at] = powers_of_two(density, cost[at], least, allowance, chance) - n_1
        return replace(
            first_round,
            spp=samples if (samples != samples.flat[0]).any() else budget.spp - n_1,
            statistic=None,
            needs_features=False,
            begin=n_1,
            before=first.moments,
            image_weight=budget.spp,
            stage="final",
            maps={**maps, "variance": variance, "confidence": confidence, "number_error": number_error},
        )


def on_paths(budget: Budget) -> bool:
    """Return whether a budget is spent on paths of several surfaces."""
    return budget.settings.integrator == "path"


def few(budget: Budget) -> bool:
    """Return whether a budget is too small for a pilot."""
    return budget.spp < (2 if on_paths(budget) else 1) * LEAST_SPP
