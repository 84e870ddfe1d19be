"""Weight rules: pilot statistics in, share of light samples out.

A rule names the pilot that it needs (camera samples at given weights) and turns the moments of the pilot's samples into
a map of weights. Here is what all rules share: `Rule`, `Pilot`, `Fit` and their checks. `dmis.fit.registry` has the
names of all rules.
"""

from __future__ import annotations

import reprlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

import numpy as np

from dmis.base.vectors import Array
from dmis.estimator.allocation import shares_of
from dmis.estimator.records import Statistic
from dmis.estimator.settings import Settings, make_settings
from dmis.variance.moments import Film

_ROUNDING = 1e-6
Weight = float | tuple[float, ...]
"""Share of the first of two techniques, or shares of all of them."""


@dataclass(frozen=True, eq=False)
class Fit:
    """What a rule found.

    Attributes
    ----------
    weight
        Shares of samples, in the form that suits the rule. Of two techniques the share of the first, light sampling:
        ``(H, W)``, or one number for the whole image. Of any K techniques all shares: ``(K, H, W)``, or ``(K,)`` for
        the whole image. `shares` are those of all techniques, whichever the form.
    samples
        Camera samples of the final pass in proportion, ``(H, W)``, of any positive scale; None: the same everywhere.
    maps
        Diagnostics by name, in the last two axes one value per patch.
    split
        Final camera samples have this many times the shading samples, and are as many times fewer; a whole number
        of shading samples.
    combiner
        Heuristic of the final samples; None: that of the rule's `settings`.
    """

    weight: Array | float
    maps: Mapping[str, np.ndarray] = field(default_factory=dict)
    samples: Array | None = None
    split: float = 1
    combiner: str | None = None

    @property
    def shares(self) -> Array:
        """Shares of all K techniques, ``(K, H, W)``, or ``(K,)`` for the whole image; float32."""
        return shares_of(self.weight)


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
        What the rule's statistic found, summed over patches of `dmis.base.patches.PATCH` pixels,
        ``(..., rows, columns)``.
    shading_samples
        Of each camera sample.
    guides
        Feature buffers of these patches, if the rule has `needs_features`, see `dmis.scene.feature_buffers`.
    techniques
        Whose samples these are.
    """

    moments: Film
    rays: Mapping[str, int] = field(default_factory=dict)
    sums: Mapping[str, Array] = field(default_factory=dict)
    shading_samples: int = 4
    guides: Mapping[str, Array] = field(default_factory=dict)
    techniques: tuple[str, ...] = ("light", "brdf")

    def __repr__(self) -> str:
        height, width = self.moments.mean.shape[:2]
        spp, techniques, sums = np.mean(self.moments.n), " + ".join(self.techniques), ", ".join(self.sums) or "none"
        return f"Pilot({width}x{height}, {spp:.3g} spp, {techniques}, sums: {sums})"


class Rule:
    """Base class of weight rules: defaults for everything but `fit`.

    A class of one's own derives from it, or is a plain class with the same names: `complete_rule` gives it the
    defaults. The names below are class attributes, fields or properties.

    Attributes
    ----------
    pilot
        Camera samples per pixel by weight, rendered before the fit, such as ``{0.0: 2, 1.0: 2}``. Default: no pilot.
    settings
        Changes to `dmis.estimator.settings.Settings` that belong to the rule. Default: none.
    statistic
        Makes the `dmis.estimator.records.Statistic` that the pilot gathers, such as `dmis.variance.curves.Curves`;
        with it, pilot samples come in pairs. Default: None, the moments of pixels alone.
    needs_features
        Whether the pilot brings feature buffers, see `dmis.scene.feature_buffers`. Default: False.
    multi_technique
        Whether the rule divides samples between any number of techniques, as `dmis.fit.simplex.Simplex` does; then
        the statistic does without their densities. Default: False, two techniques.
    """

    if TYPE_CHECKING:  # read-only, so that rules may have a field or a property of the name

        @property
        def pilot(self) -> Mapping[Any, int]: ...
        @property
        def settings(self) -> Mapping[str, Any]: ...
        @property
        def statistic(self) -> Callable[..., Statistic] | None: ...
        @property
        def needs_features(self) -> bool: ...
        @property
        def multi_technique(self) -> bool: ...

    else:
        pilot = settings = MappingProxyType({})
        statistic = None
        needs_features = multi_technique = False

    def fit(self, pilot: Mapping[Any, Pilot]) -> Fit:
        """Return the weights, from the `Pilot` at each weight of `pilot`."""
        raise NotImplementedError(f"class {type(self).__name__} needs a method fit(self, pilot) that returns a Fit")


@dataclass(frozen=True)
class _Completed(Rule):
    """A rule of a plain class, with the defaults of `Rule` for the names that the class does not have."""

    rule: Any

    def _attribute(self, name: str) -> Any:
        return getattr(self.rule, name, getattr(Rule, name))

    @property
    def pilot(self) -> Mapping[Any, int]:
        return self._attribute("pilot")

    @property
    def settings(self) -> Mapping[str, Any]:
        return self._attribute("settings")

    @property
    def statistic(self) -> Callable[..., Statistic] | None:
        return self._attribute("statistic")

    @property
    def needs_features(self) -> bool:
        return self._attribute("needs_features")

    @property
    def multi_technique(self) -> bool:
        return self._attribute("multi_technique")

    def fit(self, pilot: Mapping[Any, Pilot]) -> Fit:
        return self.rule.fit(pilot)


def complete_rule(rule: Any) -> Rule:
    """Return an object as a rule: as it is if its class derives from `Rule`, else with the defaults of `Rule`.

    Raises
    ------
    ValueError
        If it is a class in place of an object, or has no method ``fit``.
    """
    must = f"rule must be a rule, or text such as thesis:patch=16; got {reprlib.repr(rule)}"
    if isinstance(rule, type):
        raise ValueError(f"{must}. Make an object of the class: {rule.__name__}()")
    if not callable(getattr(rule, "fit", None)) or getattr(type(rule), "fit", None) is Rule.fit:
        raise ValueError(
            f"{must}, which has no method fit. Add it to class {type(rule).__name__}: "
            f"def fit(self, pilot): return dmis.Fit(weight=0.5); or give a map of weights as dmis.Given(weight=...)"
        )
    return rule if isinstance(rule, Rule) else _Completed(rule)


def settle(rule: Rule, text: str, asked: Settings) -> Settings:
    """Return `asked` with the rule's own settings, after a check of these and of the rule's pilot.

    Parameters
    ----------
    text
        The rule in messages.
    asked
        What the caller gave.

    Raises
    ------
    ValueError
        If pilot or settings are no mapping, a name is no setting, a pilot's number of samples is not whole or its
        shares are not in [0, 1], `asked` differs both from the default and from the rule, or the two do not go
        together.
    """
    for name, value, example in (
        ("pilot", rule.pilot, "{0.5: 2}, camera samples by weight"),
        ("settings", rule.settings, "{'reuse_pilot': False}"),
    ):
        if not isinstance(value, Mapping):
            raise ValueError(
                f"{name} of rule {text} must be a dict such as {example}; got {value!r}. Without one, leave it out"
            )
    usual = make_settings(preset=asked.preset)
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
    """Refuse the fit of a rule that is not shares of that many `techniques` for an image of `shape`.

    A NaN, such as the ratio of two variances that are 0, or a share outside [0, 1] would not stop the image, but spoil
    it.

    Raises
    ------
    ValueError
        If a weight is not in [0, 1], or is not finite, or shares do not add up to 1; if numbers of samples are
        negative, not finite or all 0; or if either has another shape.
    """
    if not isinstance(fit, Fit):
        raise ValueError(
            f"what a rule fits must be a dmis.fit.rule.Fit; got {type(fit).__name__}. Return dmis.Fit(weight=...)"
        )
    weight = np.asarray(fit.weight, np.float64)
    allowed = [*([(), shape] if techniques == 2 else []), (techniques,), (techniques, *shape)]
    if weight.shape not in allowed:
        raise ValueError(
            f"a rule's weight must be of shape {', '.join(map(str, allowed[:-1]))} or {allowed[-1]}, for the image or "
            f"for each pixel (height, width); got {weight.shape}"
        )
    inside = (weight >= -_ROUNDING) & (weight <= 1 + _ROUNDING)
    if not inside.all():
        raise ValueError(
            f"a rule's weight must be in [0, 1], a share of the samples; got {weight[~inside][0]} in "
            f"{np.mean(~inside):.3g} of {'the image' if weight.ndim > 1 else 'all pixels'}"
        )
    if np.abs(fit.shares.sum(axis=0) - 1).max() > 1e-3:
        raise ValueError(
            f"a rule's weights must add up to 1 over the techniques, because they divide samples; got sums from "
            f"{fit.shares.sum(axis=0).min():g} to {fit.shares.sum(axis=0).max():g}"
        )
    if fit.samples is not None:
        samples = np.asarray(fit.samples)
        if samples.shape != shape or not (np.isfinite(samples).all() and (samples >= 0).all() and samples.any()):
            raise ValueError(
                f"a rule's samples must be finite, not negative, not all 0, and of shape {shape}; got shape "
                f"{samples.shape} from {samples.min():g} to {samples.max():g}"
            )


def of_final(sampler: str, reuse: bool | None = None) -> dict[str, Any]:
    """The settings that a rule's own `sampler` and `reuse` of the pilot make; none of what is empty or None."""
    return ({"sampler": sampler} if sampler else {}) | ({} if reuse is None else {"reuse_pilot": reuse})
