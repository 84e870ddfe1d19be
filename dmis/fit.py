"""Weight rules: pilot statistics in, share of light samples out.

A rule says which pilot it needs (camera samples at given weights) and turns the moments that the pilot brings into a
map of weights. Here are weights that are given, and the thesis's; `dmis.learned` and `dmis.simplex` have the others,
and `dmis.rules` the names of all.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any, Protocol, runtime_checkable

import numpy as np

from dmis.filter import gaussian
from dmis.mis import FROZEN
from dmis.settings import Settings
from dmis.variance import Film, luminance, patch_mean, patch_spread
from dmis.vec import Array

_ROUNDING = 1e-6
Weight = float | tuple[float, ...]
"""Share of the first of two techniques, or shares of all of them."""


@dataclass(frozen=True, eq=False)
class Fit:
    """What a rule found.

    Attributes
    ----------
    weight
        Share of light samples: ``(H, W)``, or one number for the whole image. Of K > 2 techniques the shares of all:
        ``(K, H, W)``, or ``(K,)`` for the whole image.
    samples
        Camera samples of the final pass in proportion, ``(H, W)``, of any positive scale; None: the same everywhere.
    maps
        Diagnostics by name, in the last two axes one value per patch.
    split
        Final camera samples have this many times the shading samples, and are as many times fewer; a whole number
        of shading samples.
    later
        `weight` at the surfaces that a path meets after the first, for the pixel that it comes from; None: the same.
    combiner
        Heuristic of the final samples; None: that of the rule's `settings`.
    """

    weight: Array | float
    maps: Mapping[str, np.ndarray] = field(default_factory=dict)
    samples: Array | None = None
    split: float = 1
    later: Array | float | None = None
    combiner: str | None = None


@dataclass(frozen=True, eq=False)
class Pilot:
    """What a pilot pass at one weight brought.

    Attributes
    ----------
    moments
        Of the samples of each pixel, mean ``(H, W, 3)``.
    rays
        Traced, by kind.
    sums
        What the rule's statistic found, summed over patches of `dmis.tile.BASE` pixels, ``(..., rows, columns)``.
    shading_samples
        Of each camera sample.
    guides
        What the camera sees in these patches, if the rule is `guided`, see `dmis.guides`.
    techniques
        Whose samples these are.
    """

    moments: Film
    rays: Mapping[str, int] = field(default_factory=dict)
    sums: Mapping[str, Array] = field(default_factory=dict)
    shading_samples: int = 4
    guides: Mapping[str, Array] = field(default_factory=dict)
    techniques: tuple[str, ...] = ("light", "brdf")


@runtime_checkable
class Rule(Protocol):
    """What `dmis.render.render` asks of a rule. `settings` are changes to `dmis.settings.Settings` that belong to
    it. A rule may also have a `statistic`, see `dmis.tile.Statistic`, that is gathered in its pilot; be `guided`: then
    its pilot brings guides, see `dmis.guides`; be `separate`: then its statistic is told to make 2 `classes`, see
    `dmis.curves.Curves`, where paths go on; and be for `several` techniques, as `dmis.simplex.Simplex` is: then its
    weights are shares of all, and its statistic does without their densities.
    """

    @property
    def pilot(self) -> Mapping[Any, int]:
        """Camera samples per pixel by weight, rendered before the fit."""
        ...

    @property
    def settings(self) -> Mapping[str, Any]: ...

    def fit(self, pilot: Mapping[Any, Pilot]) -> Fit:
        """Weights from what the pilot brought at each of its weights."""
        ...


def settle(rule: Rule, text: str, asked: Settings) -> Settings:
    """`asked` with the rule's own settings; refused are a rule of one's own whose settings or pilot are none, and
    settings that it would replace unasked.

    Parameters
    ----------
    text
        The rule in messages.
    asked
        What the caller gave.

    Raises
    ------
    ValueError
        If a name is no setting, a pilot's number of samples is not whole or its shares are not in [0, 1], `asked`
        differs both from the default and from the rule, or the two do not go together.
    """
    usual = Settings()
    for name, own in rule.settings.items():
        if not hasattr(usual, name):
            raise ValueError(f"rule {text} must have settings that dmis.Settings has; got {name!r}")
        if getattr(asked, name) not in (getattr(usual, name), own):
            raise ValueError(
                f"settings ask for {name} {getattr(asked, name)}, but rule {text} has {own}; a rule takes its own by "
                f"option, such as balance:combiner=power or second-moment:reuse=no"
            )
    for w, n in rule.pilot.items():
        shares = w if isinstance(w, tuple) else (w,)
        if not all(0 <= share <= 1 for share in shares) or n < 1 or n != int(n):
            raise ValueError(
                f"the pilot of rule {text} must have whole numbers of samples at shares in [0, 1]; got {n} at {w}"
            )
    return replace(asked, **rule.settings)


def check_fit(fit: Fit, shape: tuple[int, int], techniques: int) -> None:
    """Refuse what a rule found if it is not shares of that many `techniques` for an image of `shape`: a NaN, which a
    ratio of two variances that are 0 is, or a share outside [0, 1] would not stop the image, but spoil it.

    Raises
    ------
    ValueError
        If a weight is not in [0, 1], or is not finite, or shares do not add up to 1; if numbers of samples are
        negative, not finite or all 0; or if either has another shape.
    """
    if not isinstance(fit, Fit):
        raise ValueError(f"what a rule fits must be a dmis.fit.Fit; got {type(fit).__name__}")
    of_all = (techniques,) if techniques > 2 else ()
    for name, value in (("weight", fit.weight), ("later", fit.later)):
        if value is None:
            continue
        found = np.asarray(value, np.float64)
        if found.shape not in (of_all, (*of_all, *shape)):
            raise ValueError(
                f"a rule's {name} must be of shape {of_all} or {(*of_all, *shape)}, for the image or for each pixel; "
                f"got {found.shape}"
            )
        inside = (found >= -_ROUNDING) & (found <= 1 + _ROUNDING)
        if not inside.all():
            raise ValueError(
                f"a rule's {name} must be in [0, 1], a share of the samples; got {found[~inside][0]} in "
                f"{np.mean(~inside):.3g} of {'the image' if found.ndim > len(of_all) else 'all pixels'}"
            )
        if of_all and np.abs(found.sum(axis=0) - 1).max() > 1e-3:
            raise ValueError(f"a rule's {name}s must add up to 1, because they divide samples")
    if fit.samples is not None:
        samples = np.asarray(fit.samples)
        if samples.shape != shape or not (np.isfinite(samples).all() and (samples >= 0).all() and samples.any()):
            raise ValueError(
                f"a rule's samples must be finite, not negative, not all 0, and of shape {shape}; got shape "
                f"{samples.shape} from {samples.min():g} to {samples.max():g}"
            )


def check_taps(size: int) -> None:
    """Refuse a filter of an even number of taps, or of very many."""
    if not 1 <= size <= 1001 or size % 2 == 0:
        raise ValueError(f"size must be odd, 1 to 1001, taps on a side of the filter; got {size}")


def of_final(sampler: str, reuse: bool | None = None) -> dict[str, Any]:
    """The settings that a rule's own `sampler` and `reuse` of the pilot make; none of what is empty or None."""
    return ({"sampler": sampler} if sampler else {}) | ({} if reuse is None else {"reuse_pilot": reuse})


@dataclass(frozen=True)
class Fixed:
    """The same weight everywhere and no pilot. w = 1/2 with the balance heuristic is the classic estimator.

    For more than two `techniques` w is the shares of all of them.
    """

    w: Weight = 0.5
    combiner: str = "balance"
    techniques: tuple[str, ...] = ("light", "brdf")
    allocation: str = "systematic"
    sampler: str = ""

    def __post_init__(self) -> None:
        if isinstance(self.w, tuple):
            if len(self.w) != len(self.techniques):
                raise ValueError(f"w must have a share for each of {', '.join(self.techniques)}; got {self.w}")
            if not all(0 <= share <= 1 for share in self.w) or abs(sum(self.w) - 1) > 1e-6:
                raise ValueError(
                    f"shares must be in [0, 1] and add up to 1, because they divide samples; got "
                    f"{' + '.join(f'{share:g}' for share in self.w)} = {sum(self.w):g}"
                )
            return
        if not 0 <= self.w <= 1:
            raise ValueError(f"w must be in [0, 1], the share of light samples; got {self.w}")
        if self.combiner == "frozen" and not FROZEN[0] <= self.w <= FROZEN[1]:
            raise ValueError(
                f"w must be from {FROZEN[0]:g} to {FROZEN[1]:g} with combiner frozen, which gives each technique its "
                f"part of f at any share; got {self.w:g}"
            )

    @property
    def several(self) -> bool:
        """Whether w is the shares of all techniques."""
        return isinstance(self.w, tuple)

    @property
    def pilot(self) -> Mapping[float, int]:
        return {}

    @property
    def settings(self) -> Mapping[str, Any]:
        own = {"combiner": self.combiner, "techniques": self.techniques, "allocation": self.allocation}
        return own | of_final(self.sampler)

    def fit(self, pilot: Mapping[float, Pilot]) -> Fit:
        return Fit(np.array(self.w) if isinstance(self.w, tuple) else self.w)


STATUS = {0: "minimum", 1: "clipped", 2: "not convex", 3: "no signal"}
"""What happened in a patch: the parabola's minimum was used; it lay outside [0, 1]; there is no minimum, so the best
pilot weight was used; the variances were zero, equal or not finite, so w = 1/2 was used.
"""


@dataclass(frozen=True)
class Thesis:
    """The rule of Seo's thesis (2014), Sec. 3: a parabola through three pilot variances per patch.

    Render `spp` camera samples with each of BRDF sampling, light sampling and the balance heuristic (w = 0, 1, 1/2);
    average the pixels' sample variances over square patches; put a least-squares parabola ``a2 w^2 + a1 w + a0``
    through the three points (Eqs. 3.2-3.4); take its minimum ``-a1 / (2 a2)`` (Eq. 3.5); filter the weights of
    patches with a 5x5 Gaussian (Sec. 3.4).

    Parameters
    ----------
    patch
        Side of a patch in pixels (the thesis tries 4 to 32).
    spp
        Pilot samples of each strategy, at least 2 (the thesis takes 2 or 4).
    strategies
        Number of pilot weights, evenly spaced from 0 to 1; odd and at least 3 (the thesis takes 3).
    channels
        Which variance is fitted: ``luminance`` (see `dmis.variance.luminance`) or ``rgb``, the mean of the three.
    filter
        ``gaussian`` or ``none``.
    size, sigma
        Of the Gaussian, in patches: taps on a side, odd; standard deviation.
    reuse
        Whether the pilot's samples are part of the image.
    combiner
        Heuristic of the final samples.
    sampler
        Of the final samples; empty: as the settings say.

    Notes
    -----
    The maps of its `Fit` are ``status`` (see `STATUS`), ``raw`` and ``patch``, the weights before and after the
    filter, and ``variances``, those of the pilot, ``(strategies, rows, columns)``.

    Eqs. 3.2-3.4 call v_i the variance and y_i the value; by Eq. 3.5 v_i must be the weight and y_i the variance. The
    text does not say what happens where the parabola has no minimum or has it outside [0, 1]. Here: the best of the
    pilot weights, and the nearer end; see `STATUS`. Nor does it say which variance of a colour is meant, what the
    sigma of the Gaussian is, or whether the pilot's samples enter the image: hence the options. Their defaults
    are those that give the thesis's Table 4.1, see ``docs/reproduction.md``.
    """

    patch: int = 16
    spp: int = 2
    strategies: int = 3
    channels: str = "luminance"
    filter: str = "gaussian"
    size: int = 5
    sigma: float = 1.0
    reuse: bool = False
    combiner: str = "balance"
    sampler: str = ""

    def __post_init__(self) -> None:
        if not 1 <= self.patch <= 65535:
            raise ValueError(f"patch must be 1 to 65535 pixels; got {self.patch}")
        if self.spp < 2:
            raise ValueError(
                f"spp of the pilot must be at least 2, because a variance needs two samples; got {self.spp}"
            )
        if not 3 <= self.strategies <= 101 or self.strategies % 2 == 0:
            raise ValueError(
                f"strategies must be odd, at least 3 and at most 101, because a parabola has three coefficients and "
                f"w = 1/2 is among them; got {self.strategies}"
            )
        if self.channels not in ("luminance", "rgb"):
            raise ValueError(f"channels must be luminance or rgb; got {self.channels!r}")
        if self.filter not in ("gaussian", "none"):
            raise ValueError(f"filter must be gaussian or none; got {self.filter!r}")
        check_taps(self.size)
        if not 0 < self.sigma < np.inf:
            raise ValueError(f"sigma must be positive and finite; got {self.sigma}")
        if self.filter == "gaussian":
            import scipy.ndimage  # noqa: F401  what the filter needs: a fit should not take the time of an import

    @property
    def pilot(self) -> Mapping[float, int]:
        return {k / (self.strategies - 1): self.spp for k in range(self.strategies)}

    @property
    def settings(self) -> Mapping[str, Any]:
        return {"combiner": self.combiner} | of_final(self.sampler, self.reuse)

    def fit(self, pilot: Mapping[float, Pilot]) -> Fit:
        moments = [p.moments for p in pilot.values()]
        shape = moments[0].mean.shape[:2]
        variances = np.stack([patch_mean(self._grey(m.variance()), self.patch) for m in moments])
        freedom = np.array([float(np.mean(m.n)) - 1 for m in moments])
        raw, status = parabola_minimum(np.array(list(pilot)), variances, freedom)
        weight = gaussian(raw, self.sigma, self.size // 2) if self.filter == "gaussian" else raw
        maps = {"status": status, "raw": raw, "patch": weight, "variances": variances}
        return Fit(patch_spread(weight, self.patch, shape), maps)

    def _grey(self, variance: Array) -> Array:
        return luminance(variance) if self.channels == "luminance" else variance.mean(axis=-1)


def parabola_minimum(w: Array, variance: Array, trust: Array | None = None) -> tuple[Array, np.ndarray]:
    """Minimum over [0, 1] of the weighted least-squares parabola through (w, variance): thesis Eqs. 3.2-3.5.

    Parameters
    ----------
    w
        At least three distinct weights, ``(n,)``; three points are met exactly.
    variance
        ``(n, ...)``.
    trust
        Positive weights of the points in the fit, ``(n,)``, such as the degrees of freedom of the variances; None:
        all equal.

    Returns
    -------
    weight
        In [0, 1], shape ``variance.shape[1:]``.
    status
        int8, see `STATUS`.
    """
    if len(np.unique(w)) < 3:
        raise ValueError(f"a parabola needs at least three distinct weights; got {w.tolist()}")
    trust = np.ones(len(w)) if trust is None else np.asarray(trust, float)
    if trust.shape != np.shape(w) or not (trust > 0).all():
        raise ValueError(f"trust must hold one positive number for each of {len(w)} weights; got {trust.tolist()}")
    values = variance.reshape(len(w), -1)
    usable = np.isfinite(values).all(axis=0)
    scale = np.where(usable, np.abs(values).max(axis=0), 0)
    with np.errstate(invalid="ignore"):  # infinite variances are not usable already; their range is NaN
        usable &= np.ptp(values, axis=0) > 1e-12 * scale
    values = np.where(usable, values / np.where(usable, scale, 1), 0)
    centred, root = w - 0.5, np.sqrt(trust / trust.max())[:, None]
    powers = np.stack([centred**2, centred, np.ones_like(centred)], axis=1)
    (a2, a1, _), *_ = np.linalg.lstsq(root * powers, root * values, rcond=None)
    convex = usable & (a2 > 1e-12)
    minimum = 0.5 - a1 / np.where(convex, 2 * a2, 1)
    best = w[values.argmin(axis=0)]
    weight = np.where(convex, np.clip(minimum, 0, 1), np.where(usable, best, 0.5))
    outside = convex & ((minimum < 0) | (minimum > 1))
    status = np.select([~usable, ~convex, outside], [3, 2, 1], 0).astype(np.int8)
    return weight.reshape(variance.shape[1:]), status.reshape(variance.shape[1:])
