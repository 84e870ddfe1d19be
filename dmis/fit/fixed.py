"""Rules without a pilot: fixed shares, the same for the whole image, and maps that the user brings."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from dmis.base.validate import number
from dmis.base.vectors import Array
from dmis.fit.round import Fit, Weight
from dmis.fit.rule import Rule
from dmis.variance.moments import Film


@dataclass(frozen=True)
class Fixed(Rule):
    """Take the same share w of light samples everywhere, without a pilot: ``fixed:0.3``.

    Parameters
    ----------
    w
        Share of the first of two techniques; of more techniques the shares of all, of sum 1. Text gives a share of each
        by name: ``fixed:light=0.5,brdf=0.3,uniform=0.2``.
    techniques
        Names of the techniques.
    combiner, allocation, sampler, compensation
        See `dmis.estimator.settings.Settings`.
    weigh
        What w is: ``samples``, the share of the samples; or ``heuristic``, the share that the heuristic uses, while all
        techniques take the same number of samples (docs/theory.md, Eq. 8a).

    Options that are None are as the settings say.
    """

    w: Weight = 0.5
    combiner: str | None = None
    techniques: tuple[str, ...] | None = None
    allocation: str | None = None
    sampler: str | None = None
    compensation: float | None = None
    weigh: str = "samples"

    def __post_init__(self) -> None:
        if isinstance(self.w, tuple):
            if not all(0 <= share <= 1 for share in self.w) or abs(sum(self.w) - 1) > 1e-6:
                raise ValueError(
                    f"shares must be in [0, 1] and add up to 1, because they divide samples; got "
                    f"{' + '.join(f'{share:g}' for share in self.w)} = {sum(self.w):g}"
                )
            return
        number("w", self.w, 0, 1, "the share of light samples")

    @property
    def multi_technique(self) -> bool:
        """Whether w is the shares of all techniques."""
        return isinstance(self.w, tuple)

    def fit(self, pilot: Mapping[float, Film]) -> Fit:
        """Return the given shares; there is no pilot."""
        return Fit(np.array(self.w) if isinstance(self.w, tuple) else self.w)


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

    def fit(self, pilot: Mapping[Any, Film]) -> Fit:
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
