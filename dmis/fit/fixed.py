"""Fixed shares: the same for the whole image, without a pilot."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from dmis.base.validate import number
from dmis.estimator.mis import combiner_by_name
from dmis.estimator.settings import DEFAULTS
from dmis.fit.round import Fit, Pilot, Weight
from dmis.fit.rule import OptionRule


@dataclass(frozen=True)
class Fixed(OptionRule):
    """Take the same share w of light samples everywhere, without a pilot: ``fixed:0.3``.

    For more than two `techniques` w is the shares of all of them. With ``weigh="heuristic"`` w is the share that the
    heuristic uses, and all techniques take the same number of samples (docs/theory.md, Eq. 8a). Options that are None
    are as the settings say.
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
        combiner = self.combiner or DEFAULTS["combiner"]
        share_range = combiner_by_name(combiner).share_range
        number("w", self.w, *share_range, f"the share of light samples, with combiner {combiner}")

    @property
    def multi_technique(self) -> bool:
        """Whether w is the shares of all techniques."""
        return isinstance(self.w, tuple)

    def fit(self, pilot: Mapping[float, Pilot]) -> Fit:
        return Fit(np.array(self.w) if isinstance(self.w, tuple) else self.w)
