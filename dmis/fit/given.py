"""The rule of a map that the user brings: shares and numbers of samples for each pixel, without a pilot."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from dmis.base.vectors import Array
from dmis.fit.round import Fit, Pilot, check_samples, check_shares
from dmis.fit.rule import Rule


@dataclass(frozen=True, eq=False, repr=False)
class Given(Rule):
    """Use the given shares of light samples, and camera samples in the given proportion.

    The combiner and everything else are those of the `dmis.estimator.settings.Settings` that `render` is given.

    Parameters
    ----------
    weight
        Share of light samples in [0, 1]: one number, or ``(H, W)`` for each pixel of the image, row 0 on top.
    samples
        Camera samples of each pixel in proportion, ``(H, W)``, of any positive scale; the mean over the image is the
        `spp` of `render`. None: the same everywhere.
    weigh
        What `weight` is, see `dmis.fit.round.WEIGH`.

    Raises
    ------
    ValueError
        If a share is not in [0, 1], numbers of samples are negative, not finite or all 0, or the two maps differ in
        shape. `render` refuses maps that are not of the shape of the image.
    """

    weight: Array | float = 0.5
    samples: Array | None = None
    weigh: str = "samples"

    def __post_init__(self) -> None:
        weight = np.array(self.weight, np.float64)
        if weight.ndim not in (0, 2):
            raise ValueError(f"weight must be one number or of shape (height, width); got shape {weight.shape}")
        check_shares("weight", weight)
        weight.flags.writeable = False
        object.__setattr__(self, "weight", weight if weight.ndim else float(weight))
        if self.samples is not None:
            samples = np.array(self.samples, np.float64)
            if samples.ndim != 2:
                raise ValueError(f"samples must be of shape (height, width); got shape {samples.shape}")
            check_samples("samples", samples, weight.shape or samples.shape)
            samples.flags.writeable = False
            object.__setattr__(self, "samples", samples)

    def fit(self, pilot: Mapping[Any, Pilot]) -> Fit:
        """Return the given maps; there is no pilot."""
        return Fit(self.weight, samples=self.samples)

    def __repr__(self) -> str:
        weigh = "" if self.weigh == "samples" else f", weigh={self.weigh!r}"
        return f"Given(weight={_short(self.weight)}, samples={_short(self.samples)}{weigh})"


def _short(value: Array | float | None) -> str:
    """Return a number as it is, and shape and range of a map."""
    if isinstance(value, np.ndarray):
        return f"<{' x '.join(map(str, value.shape))}, {value.min():g} to {value.max():g}>"
    return repr(value)
