"""The rule of a map that the user brings: shares and numbers of samples for each pixel, without a pilot."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from dmis.base.vectors import Array
from dmis.fit.round import Fit, Pilot
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

    `render` refuses maps that are not of the shape of the image, shares that are not in [0, 1], and numbers of samples
    that are not positive and finite.
    """

    weight: Array | float = 0.5
    samples: Array | None = None
    weigh: str = "samples"

    def __post_init__(self) -> None:
        for name, values in (("weight", self.weight), ("samples", self.samples)):
            if values is not None:
                if np.asarray(values).dtype.kind not in "fiu":
                    raise ValueError(f"{name} of Given must be a number or an array of numbers; got {values!r}")
                copied = np.array(values, np.float64)
                copied.flags.writeable = False
                object.__setattr__(self, name, copied if copied.ndim else float(copied))

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
