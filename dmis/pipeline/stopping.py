"""Rounds until an image is good enough: a rule's own, then its last one again and again, each time doubled.

A round that goes on takes the next samples of each pixel's sequence, as many as the pixel has, with the shares and
patterns that the rule chose. So all rounds together have the points of one long one, while the mean of independent
renders has a larger error (docs/sampling.md); and a checkpoint has one more round, whatever decides to go on.

Let m' and m be a pixel before and after a doubling, with errors of variance V n^-a and V (2n)^-a. Either half of the
samples has the error V n^-a, so that

    E[(m - m')^2] = V n^-a - V (2n)^-a = (2^a - 1) V (2n)^-a.

Before the first doubling there is the variance by sub-blocks, (4^a - 1) / 3 times too large (`dmis.variance.moments`).
If a share r of the samples is of an earlier round, it is too large by r^(2-a) + (1-r)^(2-a) as well, because the rounds
are joined as if their points did not go on from each other.

All pixels stop at once, by a mean over the image of which each pixel is a small part. What bias is left is measured in
tests/pipeline/test_stopping.py.
"""

from __future__ import annotations

import time
import warnings
from collections.abc import Generator
from dataclasses import replace
from math import inf, isnan, nan, sqrt
from typing import Any

import numpy as np

from dmis.base.validate import number
from dmis.base.vectors import Array
from dmis.fit.round import Round
from dmis.fit.rule import next_round
from dmis.pipeline.job import Job, budget_of
from dmis.samplers.streams import is_sequence
from dmis.scene.scene import SceneWarning
from dmis.variance.moments import Film

EXPONENT = 1.3
"""a of low-discrepancy points, for the relative error of whole images: 1.2 to 1.6 on five scenes."""
EPSILON = 0.01
"""Bound of the denominator of relative errors, as of `dmis.experiment.metrics.relmse`."""


class Stop:
    """When a render ends, and its rounds until then; arguments and errors are those of `dmis.pipeline.render.render`.

    Attributes
    ----------
    job
        The job with the samples that were spent, and with the number of rounds and the estimated noise in its notes.
    final
        The rule's last round, with all samples that went on behind it.
    """

    job: Job
    final: Round

    def __init__(self, noise: float | None = None, seconds: float | None = None) -> None:
        self._noise = -inf if noise is None else number("noise", noise, 0)
        self._limit = inf if seconds is None else number("seconds", seconds, 0)

    def rounds(self, job: Job) -> Generator[Round, Film, None]:
        """Yield the rounds of a job, and be sent the film of each: those of its rule, then the last one, doubled."""
        began, own, count, film = time.perf_counter(), job.rule.rounds(budget_of(job)), 0, None
        self.job = job
        while (requested := next_round(own, film)) is not None:
            self.final, film = requested, None  # its statistics are large
            film = yield requested
            count, self._seconds = count + 1, time.perf_counter() - began
        if self._limit < self._seconds:
            text = f"the first rounds alone took {self._seconds:.2g} s, more than seconds={self._limit:g}"
            warnings.warn(SceneWarning(f"{text}; write a smaller spp or resolution"), stacklevel=5)
        if film is None:
            return
        final, n = self.final, film.n
        a = EXPONENT if is_sequence(final.settings.sampler) else 1.0
        variance = film.variance() / n if np.min(n) > 1 else np.array(nan)  # one sample has none
        of_earlier = np.asarray(final.begin)[..., None] / n
        variance = variance / (of_earlier ** (2 - a) + (1 - of_earlier) ** (2 - a))
        noise = sqrt(self._relative(variance, film.mean) * 3 / (4**a - 1))
        while self._goes_on(noise):
            before, n = film.mean.copy(), film.n
            n = n if isinstance(n, int) else n[..., 0]
            weight = 2 * self.final.image_weight
            film = yield replace(final, spp=n, begin=n, before=film.moments, image_weight=weight)
            count, self._seconds = count + 1, time.perf_counter() - began
            noise = sqrt(self._relative(np.square(film.mean - before), film.mean) / (2**a - 1))
            self.final = replace(final, spp=2 * n - final.begin, image_weight=weight)
            self.job = replace(job, spp=job.spp + weight - final.image_weight)
        notes: dict[str, Any] = {"rounds": count, "noise": None if isnan(noise) else noise}
        self.job = replace(self.job, notes={**job.notes, **notes})

    def _goes_on(self, noise: float) -> bool:
        """Return whether to double once more: it takes as long as all rounds before, and as many samples."""
        in_time = 2 * self._seconds <= self._limit
        return in_time and self.job.spp + self.final.image_weight <= self.job.most and not noise <= self._noise

    def _relative(self, square: Array, mean: Array) -> float:
        """Return the mean of squares over those of a mean, in units of the given scene."""
        gain2 = self.job.gain**2
        return float(np.mean(square * gain2 / (np.square(mean, dtype=np.float64) * gain2 + EPSILON), dtype=np.float64))
