"""Weight rules: pilot statistics in, share of light samples out.

A rule names the pilot that it needs (camera samples at given weights) and turns the moments of the pilot's samples into
a map of weights. Here is what all rules share. `dmis.fit.registry` has the names of all rules.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Generator, Mapping
from dataclasses import replace
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

from dmis.base.validate import number, whole
from dmis.estimator.records import Statistic
from dmis.estimator.settings import Settings, make_settings
from dmis.fit.round import Budget, Fit, Pilot, Round, check_weigh


class Rule:
    """Base class of weight rules: defaults for everything but `fit`.

    A class of one's own derives from it. The names below are class attributes, fields or properties. A rule that needs
    more than pilot, fit and final pass overrides `rounds` in place of `fit`.

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
    least_spp
        Camera samples per pixel from which on the rule learns; smaller budgets are rendered with equal shares.
        Default: 0.
    weigh
        What weights are, see `dmis.fit.round.WEIGH`; empty: what the preset says. Default: shares of the samples.
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
        def least_spp(self) -> int: ...
        @property
        def weigh(self) -> str: ...

    else:
        pilot = settings = MappingProxyType({})
        statistic = None
        needs_features = multi_technique = shares_only = False
        least_spp = 0
        weigh = "samples"

    def rounds(self, budget: Budget) -> Generator[Round, Pilot, None]:
        """Yield the rounds to render, one after the other, and be sent the film of each: pilot, fit, final pass.

        Rounds come from ``budget.pilot(...)`` and ``budget.final(...)``, or are changed copies of these
        (`dataclasses.replace`). What decides the samples of a pixel in the image must come from samples that are not in
        it, or from other pixels, or the image is biased. A later round of a sequence such as Sobol's goes on with
        `Round.begin`; from 0 on it would repeat the points.
        """
        pilot = {}
        for weight, spp in sorted(self.pilot.items()):
            pilot[weight] = yield budget.pilot(weight, spp, self.statistic, self.needs_features)
        fit = self.fit(pilot)
        pilot.clear()  # statistics are large, and the final pass needs none
        yield budget.final(fit, spent=sum(self.pilot.values()))

    def pilot_samples(self, spp: int) -> int:
        """Return the camera samples per pixel that the rounds before the final pass take of a budget."""
        return 0 if spp < self.least_spp else sum(self.pilot.values())

    def fallback(self, spp: int) -> str:
        """Return why a budget is rendered with equal shares, for people to read; empty if it is not."""
        small = f"fewer than {self.least_spp} samples per pixel, rendered with w = 1/2"
        return small if spp < self.least_spp else ""

    def __repr__(self) -> str:
        """Return the name of the class with its attributes, such as ``Quieter(least=0.2)``."""
        return f"{type(self).__name__}({', '.join(f'{name}={value!r}' for name, value in vars(self).items())})"

    def fit(self, pilot: Mapping[Any, Pilot]) -> Fit:
        """Return the weights, from the `Pilot` at each weight of `pilot`."""
        raise NotImplementedError(f"class {type(self).__name__} needs a method fit(self, pilot) that returns a Fit")


OPTIONS = {name: name for name in ("combiner", "techniques", "allocation", "sampler", "compensation")}
OPTIONS["reuse_pilot"] = "reuse"
"""Settings that rules have options for, and the names of the options."""


class OptionRule(Rule):
    """Base class of rules whose `settings` are its attributes named in `OPTIONS`, but for those None or empty."""

    @property
    def settings(self) -> Mapping[str, Any]:
        values = {name: getattr(self, option, None) for name, option in OPTIONS.items()}
        return {name: value for name, value in values.items() if value not in (None, "")}


def next_round(rounds: Generator[Round, Pilot, None], film: Pilot | None) -> Round | None:
    """Send a rule the film of its last round, None before the first; returns its next one, None if there is none.

    A ValueError if the rule's `Rule.rounds` is no generator, or yields something else than a `Round`.
    """
    if not isinstance(rounds, Generator):
        raise ValueError(f"rounds of a rule must be a generator, which yields Rounds; got {type(rounds).__name__}")
    try:
        requested = rounds.send(film)  # type: ignore[arg-type]
    except StopIteration:
        return None
    if not isinstance(requested, Round):
        raise ValueError(f"a rule must yield Rounds, such as budget.final(fit); got {type(requested).__name__}")
    return requested


def rule_text(rule: Any) -> str:
    """Return the text of a rule for messages, provenance and checkpoints, the same in every process.

    A text is itself, and an object is what its ``__repr__`` returns, without memory addresses.
    """
    return rule if isinstance(rule, str) else re.sub(r" at 0x[0-9a-fA-F]+", "", repr(rule))


def merge_settings(rule: Rule, text: str, settings: Settings) -> Settings:
    """Return the caller's `settings` with the rule's own, after a check of these and of the rule's pilot.

    `text` is the rule's in messages. A ValueError if pilot or settings are not of the right form, or a setting of the
    caller differs both from its default and from the rule's.
    """
    for name, example in (("pilot", "{0.5: 2}, camera samples by weight"), ("settings", "{'reuse_pilot': False}")):
        if not isinstance(value := getattr(rule, name), Mapping):
            raise ValueError(f"{name} of rule {text} must be a dict such as {example}; got {value!r}. Or leave it out")
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
    merged = replace(settings, **rule.settings)
    check_weigh(rule.weigh or merged.weigh, merged.combiner)
    return merged


def _advice(rule: Rule, text: str, name: str, value: Any) -> str:
    """Return how a rule gets the `value` of a setting that it has an option for, or that it has none."""
    option = OPTIONS.get(name, name)
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
