"""Options and steps that rules share if they pool a pilot's statistics over patches and minimise variance and cost."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from dmis.base.patches import PATCH, patch_mean
from dmis.base.vectors import Array
from dmis.filter import check_taps
from dmis.fit.pooling import pool
from dmis.fit.rule import Pilot, Rule


@dataclass(frozen=True, kw_only=True)
class PooledRule(Rule):
    """Base class of rules that average a pilot's statistics over patches, filter them and minimise on each patch.

    Parameters
    ----------
    patch
        Side of a patch in pixels, a multiple of 4.
    spp
        Samples of the pilot.
    filter
        Of the statistics: ``gaussian`` or ``none``; or ``joint``, a Gaussian among neighbours that look alike
        (`dmis.filter.joint`, `dmis.scene.feature_buffers`).
    size, sigma
        Taps on a side and standard deviation of the Gaussian, in patches.
    shrink
        Whether each patch's curve is moved towards that of its kind by as much as it is uncertain, after the filter
        (`dmis.fit.shrinkage`). Kinds are materials if the filter is ``joint``, else there is but one.
    cost
        Whether cost counts; otherwise variance alone.
    guard
        Leave the baseline point only where the gain is more than this many standard errors.
    reuse
        Whether the pilot's samples are part of the image. None: as the settings say, and if these do not, where the
        final samples are independent too.
    combiner, sampler
        Of the final samples; an empty sampler is that of the settings.
    compensation
        Of skies, for pilot and final samples, see `dmis.estimator.settings.Settings`. None: as the settings say.
    """

    patch: int = 4
    spp: int = 6
    filter: str = "joint"
    size: int = 5
    sigma: float = 1.0
    shrink: bool = True
    cost: bool = True
    guard: float = 1.5
    reuse: bool | None = None
    combiner: str = "balance"
    sampler: str = ""
    compensation: float | None = None

    def __post_init__(self) -> None:
        if not PATCH <= self.patch <= 65536 or self.patch % PATCH:
            raise ValueError(
                f"patch must be a multiple of {PATCH} pixels, in which curves are kept, of at most 65536; got "
                f"{self.patch}"
            )
        check_taps(self.size)
        if not 0 < self.sigma < np.inf:
            raise ValueError(f"sigma must be positive and finite; got {self.sigma}")
        if not self.guard >= 0:
            raise ValueError(f"guard must not be negative, standard errors; got {self.guard}")
        if self.filter not in ("gaussian", "none", "joint"):
            raise ValueError(f"filter must be gaussian, none or joint; got {self.filter!r}")

    @property
    def needs_features(self) -> bool:
        """Whether the filter compares feature buffers."""
        return self.filter == "joint"

    def _features(self, pilot: Pilot) -> Mapping[str, Array] | None:
        """Return the feature buffers that the filter compares; None if it compares none."""
        return pilot.features if self.needs_features else None

    def _pool(self, pilot: Pilot) -> tuple[dict[str, Array], Array]:
        """Return the means of the pilot's sums over patches, filtered, and the effective number of pixels of each."""
        sigma = None if self.filter == "none" else self.sigma
        shape = pilot.moments.mean.shape[:2]
        return pool(pilot.sums, shape, self.patch, sigma, self.size // 2, self._features(pilot))

    def _kinds(self, pilot: Pilot) -> Array | None:
        """Return the shares of the materials in each patch, ``(M, rows, columns)``; None if they are not known."""
        material = (self._features(pilot) or {}).get("material")
        return None if material is None else patch_mean(material, self.patch // PATCH)
