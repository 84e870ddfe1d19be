"""The rule ``thesis`` by name: `dmis.fit.thesis.ThesisRule` with options for what the thesis leaves open.

With the defaults the rule has the steps of `dmis.fit.thesis` and no others.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from dmis.base.validate import one_of, positive, whole
from dmis.base.vectors import Array
from dmis.filter import check_taps
from dmis.fit.thesis import ThesisRule


@dataclass(frozen=True)
class Thesis(ThesisRule):
    """Choose weights by a parabola through three pilot variances per patch: Seo's thesis (2014), Sec. 3.

    Parameters
    ----------
    patch
        Side of a patch in pixels (the thesis tries 4 to 32).
    spp
        Pilot samples at each of the three weights, at least 2 (the thesis: 2 or 4).
    channels
        Variance that is fitted: of ``luminance``, or ``rgb``, the mean of the three.
    filter, size, sigma
        ``gaussian`` or ``none``; taps on a side, odd, and standard deviation of the Gaussian, in patches.
    no_signal, ragged
        What the Gaussian does with patches without a signal: ``half``, they enter it as w = 1/2, or ``skip``, it leaves
        them out; and with patches that the border cuts: ``equal``, they count as the others do, or ``area``, by their
        pixels. By the defaults all patches count the same, as in the thesis.
    reuse
        Whether the pilot's samples are part of the image. None: as the settings say, and no by default.
    combiner, sampler
        Of the final samples. None: as the settings say.
    weigh
        What w is: the share that the ``heuristic`` uses, with as many light as BRDF samples at every vertex
        (docs/theory.md, Eq. 8a), or the share of light ``samples``. Empty: the first, unless the preset is
        ``thesis-shares`` or the combiner is not ``balance``.

    Notes
    -----
    The maps of its `Fit` are ``status`` (see `dmis.fit.thesis.STATUS`), ``raw`` and ``filtered``, the weights before
    and after the filter, and ``variances``, those of the pilot, ``(3, rows, columns)``.
    """

    patch: int | Literal["auto"] = 16  # type: ignore[assignment]  # auto was one, and is refused with advice
    channels: str = "luminance"
    filter: str = "gaussian"
    no_signal: str = "half"
    ragged: str = "equal"
    reuse: bool | None = None
    combiner: str | None = None
    sampler: str | None = None
    weigh: str = ""

    def __post_init__(self) -> None:
        whole("patch", self.patch, 1, 65535, "in pixels; the plug-in patch_size has thesis-by-pilot, which chooses it")
        whole("spp of the pilot", self.spp, 2, more="because a variance needs two samples")
        one_of("channels", self.channels, ("luminance", "rgb"))
        one_of("filter", self.filter, ("gaussian", "none"))
        one_of("no_signal", self.no_signal, ("half", "skip"))
        one_of("ragged", self.ragged, ("equal", "area"))
        check_taps(self.size)
        positive("sigma", self.sigma)

    def grey(self, variance: Array) -> Array:
        return variance.mean(axis=-1) if self.channels == "rgb" else super().grey(variance)

    def smooth(self, raw: Array, status: np.ndarray, area: Array) -> Array:
        return raw if self.filter == "none" else super().smooth(raw, status, area)

    def counts(self, status: np.ndarray, area: Array) -> Array:
        """Return 1 for each patch, or the share of it that is inside of the image; or 0 without a signal."""
        count = np.ones(status.shape) if self.ragged == "equal" else area / area.max()
        return count * (status != 3) if self.no_signal == "skip" else count
