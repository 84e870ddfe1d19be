"""Weight rules: pilot statistics in, share of light samples out.

A rule names the pilot that it needs (camera samples at given weights) and turns the moments of the pilot's samples into
a map of weights. Here is what all rules share: `Rule`, `Pilot`, `Fit` and their checks. `dmis.fit.registry` has the
names of all rules.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

import numpy as np

from dmis.base.validate import number, whole
from dmis.base.vectors import Array
from dmis.estimator.allocation import shares_of
from dmis.estimator.records import Statistic
from dmis.estimator.settings import Settings, make_settings
from dmis.fit.continuation import Continuation
from dmis.variance.moments import Film

_ROUNDING = 1e-6
Weight = float | tuple[float, ...]
"""Share of the first of two techniques, or shares of all of them."""


@dataclass(frozen=True, eq=False)
class Fit:
    """The result of a rule: shares of samples for each pixel, and how the final samples are taken.

    Attributes
    ----------
    weight
        Shares of samples, in the form that suits the rule. Of two techniques the share of the first, light sampling:
        ``(H, W)``, or one number for the whole image. Of any K techniques all shares: ``(K, H, W)``, or ``(K,)`` for
        the whole image. `shares` are those of all techniques, whichever the form.
    samples
        Camera samples of the final pass in proportion, ``(H, W)``, of any positive scale; None: the same everywhere.
    maps
        Diagnostics by name; those of patches have one value for each in the last two axes.
    continuation
        Patterns and numbers of samples that go on from the pilot, of a rule that `continues`; None: `weight` and
        `samples` divide what the pilot left.
    """

    weight: Array | float
    maps: Mapping[str, np.ndarray] = field(default_factory=dict)
    samples: Array | None = None
    continuation: Continuation | None = None

    @property
    def shares(self) -> Array:
        """Shares of all K techniques, ``(K, H, W)``, or ``(K,)`` for the whole image; float32."""
        return shares_of(self.weight)


@dataclass(frozen=True, eq=False)
class Pilot:
    """The samples of a pilot pass at one weight.

    Attributes
    ----------
    moments
        Moments of the samples of each pixel, mean ``(H, W, 3)``.
    rays
        Rays traced, by kind.
    sums
        Sums of the rule's statistic over patches of `dmis.base.patches.PATCH` pixels,
        ``(..., rows, columns)``.
    shading_samples
        Shading samples of each camera sample.
    features
        Feature buffers of these patches, if the rule has `needs_features`, see `dmis.scene.feature_buffers`.
    techniques
        Names of the techniques that took the samples.
    budget
        Camera samples per pixel of the whole render, the pilot's included.
    replicates
        Independent copies of the samples of each pixel, see `dmis.variance.replicates`, all of which are in `sums`.
    """

    moments: Film
    rays: Mapping[str, int] = field(default_factory=dict)
    sums: Mapping[str, Array] = field(default_factory=dict)
    shading_samples: int = 4
    features: Mapping[str, Array] = field(default_factory=dict)
    techniques: tuple[str, ...] = ("light", "brdf")
    budget: int = 128
    replicates: int = 1

    def __repr__(self) -> str:
        height, width = self.moments.mean.shape[:2]
        spp, techniques, sums = np.mean(self.moments.n), " + ".join(self.techniques), ", ".join(self.sums) or "none"
        return f"Pilot({width}x{height}, {spp:.3g} spp, {techniques}, sums: {sums})"


class Rule:
    """Base class of weight rules: defaults for everything but `fit`.

    A class of one's own derives from it. The names below are class attributes, fields or properties.

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
    shares_only
        Whether the fit decides shares alone, and no numbers of samples. Then the pilot is left out of scenes with
        nothing to mix, see `dmis.scene.plan.Plan.mixable`. Default: False.
    continues
        Whether the final samples go on from the pilot's, in the points of the same sampler: the fit has a
        `dmis.fit.continuation.Continuation`. Default: False.
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
        @property
        def shares_only(self) -> bool: ...
        @property
        def continues(self) -> bool: ...

    else:
        pilot = settings = MappingProxyType({})
        statistic = None
        needs_features = multi_technique = shares_only = continues = False

    def adapted(self, spp: int, sampler: str, replicates: int = 1) -> Rule:
        """Return the rule for a budget of `spp` camera samples, a sampler and a number of replicates of its sequence.

        Here it is the same for all.
        """
        return self

    def fallback(self, spp: int, replicates: int = 1) -> str:
        """Return why `adapted` gives another rule for so few camera samples, and which; empty if it does not."""
        return ""

    def __repr__(self) -> str:
        """Return the name of the class with its attributes, such as ``Quieter(least=0.2)``."""
        return f"{type(self).__name__}({', '.join(f'{name}={value!r}' for name, value in vars(self).items())})"

    def fit(self, pilot: Mapping[Any, Pilot]) -> Fit:
        """Return the weights, from the `Pilot` at each weight of `pilot`."""
        raise NotImplementedError(f"class {type(self).__name__} needs a method fit(self, pilot) that returns a Fit")


def rule_text(rule: Any) -> str:
    """Return the text of a rule for messages, provenance and checkpoints, the same in every process.

    A text is itself, and an object is what its ``__repr__`` returns, without memory addresses.
    """
    return rule if isinstance(rule, str) else re.sub(r" at 0x[0-9a-fA-F]+", "", repr(rule))


def merge_settings(rule: Rule, text: str, settings: Settings) -> Settings:
    """Return the caller's `settings` with the rule's own, after a check of these and of the rule's pilot.

    Parameters
    ----------
    text
        The rule's text in messages.
    settings
        The settings that the caller gave.

    Raises
    ------
    ValueError
        If pilot or settings are no mapping, a name is no setting, a pilot's number of samples is not whole or its
        shares are not in [0, 1], a name of `settings` differs both from its default and from the rule's, or the two
        are incompatible.
    """
    for name, value, example in (
        ("pilot", rule.pilot, "{0.5: 2}, camera samples by weight"),
        ("settings", rule.settings, "{'reuse_pilot': False}"),
    ):
        if not isinstance(value, Mapping):
            raise ValueError(
                f"{name} of rule {text} must be a dict such as {example}; got {value!r}. Without one, leave it out"
            )
    defaults = make_settings(preset=settings.preset)
    for name, value in rule.settings.items():
        if not hasattr(defaults, name):
            raise ValueError(
                f"settings of rule {text} must be fields of dmis.Settings; got {name!r}. Fields are "
                f"{', '.join(vars(defaults))}"
            )
        if getattr(settings, name) not in (getattr(defaults, name), value):
            raise ValueError(
                f"conflicting {name}: Settings has {getattr(settings, name)!r}, rule {text} uses {value!r}. "
                f"{_advice(rule, text, name, getattr(settings, name))}"
            )
    for w, n in rule.pilot.items():
        whole(f"samples of the pilot of rule {text} at {w!r}", n, 1)
        for share in w if isinstance(w, tuple) else (w,):
            number(f"shares of the pilot of rule {text}", share, 0, 1)
    return replace(settings, **rule.settings)


def _advice(rule: Rule, text: str, name: str, value: Any) -> str:
    """Return how a rule gets the `value` of a setting that it has an option for, or that it has none."""
    option = {"reuse_pilot": "reuse"}.get(name, name)
    if option == "techniques" and hasattr(rule, option):
        shares = ",".join(f"{name}={1 / len(value):.3g}" for name in value)
        return f'Write rule="simplex:{shares}" with your shares, or rule="simplex:{"+".join(value)}" to learn them'
    if not hasattr(rule, option):
        return f"The rule has no option {option}: leave it out of the settings, or use another rule"
    if "(" in text:
        return f"Make the rule with {option}={value!r}"
    rule_name, _, rest = text.partition(":")
    others = [item for item in rest.split(",") if item and not item.startswith(f"{option}=")]
    word = ("no", "yes")[value] if isinstance(value, bool) else value
    return f'Write rule="{rule_name}:{",".join([*others, f"{option}={word}"])}"'


def check_fit(fit: Fit, shape: tuple[int, int], techniques: int) -> None:
    """Raise a ValueError unless a rule's fit has shares of that many `techniques` for an image of `shape`.

    A NaN, such as the ratio of two variances that are 0, or a share outside [0, 1] would not stop the render, but make
    the image wrong.

    Raises
    ------
    ValueError
        If a weight is not in [0, 1], or is not finite, or shares do not add up to 1; if numbers of samples are
        negative, not finite or all 0; or if either has another shape.
    """
    if not isinstance(fit, Fit):
        raise ValueError(f"a rule's fit must be a dmis.Fit; got {type(fit).__name__}. Return dmis.Fit(weight=...)")
    weight = np.asarray(fit.weight, np.float64)
    allowed = [*([(), shape] if techniques == 2 else []), (techniques,), (techniques, *shape)]
    if weight.shape not in allowed:
        raise ValueError(
            f"a rule's weight must be of shape {', '.join(map(str, allowed[:-1]))} or {allowed[-1]}, for the image or "
            f"for each pixel (height, width); got {weight.shape}"
        )
    check_shares("a rule's weight", weight)
    if np.abs(fit.shares.sum(axis=0) - 1).max() > 1e-3:
        raise ValueError(
            f"a rule's weights must add up to 1 over the techniques, because they divide samples; got sums from "
            f"{fit.shares.sum(axis=0).min():g} to {fit.shares.sum(axis=0).max():g}"
        )
    if fit.samples is not None:
        check_samples("a rule's samples", np.asarray(fit.samples), shape)


def check_shares(name: str, weight: Array) -> None:
    """Raise a ValueError that calls them `name` unless shares are in [0, 1], up to rounding."""
    inside = (weight >= -_ROUNDING) & (weight <= 1 + _ROUNDING)
    if not inside.all():
        where = f" in {np.sum(~inside):,} of {weight.size:,} values" if weight.ndim > 1 else ""
        raise ValueError(f"{name} must be in [0, 1], a share of the samples; got {weight[~inside][0]:g}{where}")


def check_samples(name: str, samples: Array, shape: tuple[int, ...]) -> None:
    """Raise a ValueError that calls them `name` unless numbers of samples in proportion are right, of that `shape`."""
    if samples.shape != shape or not (np.isfinite(samples).all() and (samples >= 0).all() and samples.any()):
        raise ValueError(
            f"{name} must be finite, not negative, not all 0, and of shape {shape}; got shape {samples.shape} from "
            f"{samples.min():g} to {samples.max():g}"
        )


def final_settings(sampler: str, reuse: bool | None = None, compensation: float | None = None) -> dict[str, Any]:
    """Return the settings of these options of a rule; none of an option that is empty or None."""
    options = {"sampler": sampler or None, "reuse_pilot": reuse, "compensation": compensation}
    return {name: value for name, value in options.items() if value is not None}
