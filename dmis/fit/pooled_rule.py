"""The base class of rules that learn shares from one pilot, whose statistics are pooled over patches."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from dmis.base.patches import PATCH
from dmis.base.validate import number, one_of, positive
from dmis.base.vectors import Array
from dmis.estimator.cost import camera_sample_cost
from dmis.filter import check_taps
from dmis.fit.pooling import pool
from dmis.fit.round import Pilot, Weight
from dmis.fit.rule import OptionRule


@dataclass(frozen=True, kw_only=True)
class PooledRule(OptionRule):
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
                shape = pilot[0.5].moments.mean.shape[:2]
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

    def pooled(self, pilot: Pilot) -> tuple[dict[str, Array], Array]:
        """Return the means of the pilot's sums over patches, filtered, and the effective number of pixels of each."""
        sigma = None if self.filter == "none" else self.sigma
        shape = pilot.moments.mean.shape[:2]
        features = pilot.features if self.needs_features else None
        return pool(pilot.sums, shape, self.patch, sigma, self.size // 2, features)

    def sample_cost(self, pilot: Pilot, shares: Array) -> Array:
        """Return the cost of a camera sample at `shares` ``(K, G)`` of the techniques, ``(G,)``; 1 if none counts."""
        if not self.cost:
            return np.ones(shares.shape[1])
        s = pilot.shading_samples
        return camera_sample_cost(pilot.rays, shares, s, s // len(shares), pilot.techniques)
