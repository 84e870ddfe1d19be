"""Rules: what they ask the renderer for, and the settings that they need or leave to the caller.

A rule yields rounds. Most name a pilot (camera samples at given weights) and turn its film into shares of samples for
the final pass. Here is what all rules share. `dmis.fit.registry` has the names of all rules.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Generator, Mapping
from dataclasses import fields, is_dataclass, replace
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

import numpy as np

from dmis.base.plugins import is_shipped, reraise
from dmis.base.validate import number, whole
from dmis.estimator.mis import technique_by_name
from dmis.estimator.records import Statistic
from dmis.estimator.settings import DEFAULTS, PRESETS, Settings, given_values
from dmis.fit.round import Budget, Fit, Round, check_weigh, pilot_settings
from dmis.scene.scene import Scene
from dmis.scene.suggestions import Suggestions
from dmis.variance.moments import Film


class Rule:
    """Base class of weight rules: defaults for everything but `fit`.

    A class of one's own derives from it. The names below are class attributes, fields or properties. A rule that needs
    more than pilot, fit and final pass overrides `rounds` in place of `fit`.

    Attributes
    ----------
    pilot
        Camera samples per pixel by weight, rendered before the fit, such as ``{0.0: 2, 1.0: 2}``. Default: no pilot.
    settings
        Values of `dmis.estimator.settings.Settings` that the rule needs; all others are the caller's, unless the rule
        has an option for them, see `OPTIONS`. Default: none.
    statistic
        Makes the `dmis.estimator.records.Statistic` that the pilot gathers, such as `dmis.variance.curves.Curves`;
        with it, a pilot sample of K techniques has K times the shading samples. Default: None, moments of pixels alone.
    needs_features
        Whether the pilot brings feature buffers, see `dmis.scene.feature_buffers`: True, of patches; or ``"pixels"``.
        Default: False.
    multi_technique
        Whether the rule divides samples between any number of techniques, as examples/literature/simplex.py does; then
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
        def needs_features(self) -> bool | str: ...
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

    def rounds(self, budget: Budget) -> Generator[Round, Film, None]:
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

    def filled(self, settings: Settings) -> Rule:
        """Return the rule with the values of `settings` for options that are None, see `OPTIONS`."""
        open_options = {name: option for name, option in OPTIONS.items() if getattr(self, option, "") is None}
        if not open_options or not is_dataclass(self):
            return self
        return replace(self, **{option: getattr(settings, name) for name, option in open_options.items()})

    def __repr__(self) -> str:
        """Return the name of the class with its attributes, such as ``Quieter(least=0.2)``."""
        return f"{type(self).__name__}({', '.join(f'{name}={value!r}' for name, value in vars(self).items())})"

    def fit(self, pilot: Mapping[Any, Film]) -> Fit:
        """Return the weights, from the `Film` at each weight of `pilot`."""
        raise NotImplementedError(f"class {type(self).__name__} needs a method fit(self, pilot) that returns a Fit")


OPTIONS = {name: name for name in ("combiner", "techniques", "allocation", "sampler", "compensation")}
OPTIONS["reuse_pilot"] = "reuse"
"""Settings, and the attributes of rules that are options for them. None leaves a setting to the caller."""


def needed_settings(rule: Rule) -> dict[str, Any]:
    """Return the settings that a rule needs, by its options and its `Rule.settings`."""
    values = {name: getattr(rule, option, None) for name, option in OPTIONS.items()}
    return {name: value for name, value in values.items() if value is not None} | dict(rule.settings)


def next_round(rounds: Generator[Round, Film, None], film: Film | None, rule: Rule | None = None) -> Round | None:
    """Send a rule the film of its last round, None before the first; return its next one, None if there is none.

    A ValueError if `Rule.rounds` is no generator, yields no `Round`, or raises an exception; it names an own `rule`.
    """
    if not isinstance(rounds, Generator):
        raise ValueError(f"rounds of a rule must be a generator, which yields Rounds; got {type(rounds).__name__}")
    try:
        requested = rounds.send(film)  # type: ignore[arg-type]
    except StopIteration:
        return None
    except Exception as error:
        reraise(error, "" if rule is None or is_shipped(type(rule)) else type(rule).__name__)
    if not isinstance(requested, Round):
        raise ValueError(f"a rule must yield Rounds, such as budget.final(fit); got {type(requested).__name__}")
    return requested


def rule_text(rule: Any) -> str:
    """Return the text of a rule for messages, provenance and checkpoints, the same in every process.

    A text is itself, and an object is what its ``__repr__`` returns, without memory addresses.
    """
    return rule if isinstance(rule, str) else re.sub(r" at 0x[0-9a-fA-F]+", "", repr(rule))


def check_form(rule: Rule) -> None:
    """Raise a ValueError unless pilot and settings of a rule are dictionaries, and the latter of fields of settings."""
    for name, example in (("pilot", "{0.5: 2}, camera samples by weight"), ("settings", "{'reuse_pilot': False}")):
        if not isinstance(value := getattr(rule, name), Mapping):
            raise ValueError(
                f"{name} of rule {rule_text(rule)} must be a dict such as {example}; got {value!r}. Or leave it out"
            )
    known = [field.name for field in fields(Settings)]
    if unknown := [name for name in rule.settings if name not in known]:
        raise ValueError(
            f"settings of rule {rule_text(rule)} must be fields of dmis.Settings; got {unknown[0]!r}. "
            f"Fields are {', '.join(known)}"
        )


# Settings of a rule and its caller ------------------------------------------------------------------------------------


def _samples_alone(rule: Rule) -> bool:
    """Return whether a technique is alone, in a pilot of the rule or at its fixed share."""
    return any(share in (0, 1) for weight in (*rule.pilot, getattr(rule, "w", 0.5)) for share in np.ravel(weight))


def merge_settings(
    settings: Settings, scene: Scene | None = None, rule: Rule | None = None, text: str = "", equal: bool = False
) -> tuple[Settings, dict[str, str]]:
    """Return the settings of a render, with a value in place of each that is not given, and who decided each.

    The last of these that names a value decides: ``default``, ``scene`` (its file), ``preset``, ``rule`` and
    ``caller``. `text` is the rule's in messages; `equal` says that equal shares are rendered in place of its own.
    Without a rule ``reuse_pilot`` and ``compensation``, whose defaults depend on it, may stay None, and
    ``lights="auto"`` always, which the scene's plan decides (`dmis.scene.plan.Plan.selection`).

    A ValueError if rule and caller name different values, or the preset does not allow the rule's.
    """
    given, needs = settings.explicit, given_values({} if rule is None else needed_settings(rule))
    for name, value in needs.items():
        if rule is not None and given.get(name, value) != value:
            advice = _advice(rule, text, name, given[name])
            raise ValueError(f"conflicting {name}: Settings has {given[name]!r}, rule {text} uses {value!r}. {advice}")
    preset = given_values(PRESETS[settings.preset].values) if settings.preset else {}
    named, suggested = {**preset, **needs, **given}, scene.suggested if scene else Suggestions()
    of_file: dict[str, Any] = {"integrator": suggested.integrator} if suggested.integrator else {}
    if suggested.max_depth and suggested.integrator in (None, named.get("integrator", suggested.integrator)):
        of_file["max_depth"] = suggested.max_depth
    defaults = {**DEFAULTS, "reuse_pilot": named.get("sampler") == "independent"}
    if rule is None:
        defaults |= {"reuse_pilot": None, "compensation": None}
    elif not equal and _samples_alone(rule):
        # a few samples of one technique may have many times the error of a mixture; nothing covers what they leave out
        defaults |= {"reuse_pilot": False, "compensation": 0.0}
    tiers = {"default": defaults, "scene": of_file, "preset": preset, "rule": needs, "caller": given}
    sources = {name: source for source, values in tiers.items() for name in values}
    return Settings(**{**defaults, **of_file, **named}), sources


def _advice(rule: Rule, text: str, name: str, value: Any) -> str:
    """Return how a rule gets the `value` of a setting that it has an option for, or that it has none."""
    option = OPTIONS.get(name, name)
    if option == "techniques" and hasattr(rule, option):
        shares = ",".join(f"{name}={1 / len(value):.3g}" for name in value)
        return f'Write rule="fixed:{shares}" with your shares'
    if not hasattr(rule, option):
        return f"The rule has no option {option}: leave {name} out of the settings, or use another rule"
    if "(" in text:
        return f"Make the rule with {option}={value!r}"
    rule_name, _, rest = text.partition(":")
    others = [item for item in rest.split(",") if item and not item.startswith(f"{option}=")]
    word = ("no", "yes")[value] if isinstance(value, bool) else value
    return f'Write rule="{rule_name}:{",".join([*others, f"{option}={word}"])}"'


def check_settings(rule: Rule, text: str, settings: Settings) -> None:
    """Raise a ValueError if the pilot of a rule is not right, or it cannot render with settings."""
    check_weigh(rule.weigh or settings.weigh, settings.combiner)
    for weight, n in rule.pilot.items():
        whole(f"samples of the pilot of rule {text} at {weight!r}", n, 1)
        for share in weight if isinstance(weight, tuple) else (weight,):
            number(f"shares of the pilot of rule {text}", share, 0, 1)
    names = settings.techniques
    if len(names) > 2 and not rule.multi_technique:
        raise ValueError(
            f"rule {text} needs two techniques; got {len(names)}: {', '.join(names)}. "
            f"Use rule fixed:{'=...,'.join(names)}=... with a share of each"
        )
    if rule.statistic is not None:
        _check_statistic(rule, text, settings)


def _check_statistic(rule: Rule, text: str, settings: Settings) -> None:
    """Raise a ValueError if the statistic of a rule cannot be gathered with settings.

    It is of the densities of all techniques, unless the rule is for any number of these; and of pairs of samples at
    fixed shares.
    """
    without = [repr(name) for name in settings.techniques if not technique_by_name(name).exact]
    if without and not rule.multi_technique:
        raise ValueError(
            f"rule {text} needs the pdf of every technique, but {', '.join(without)} has none. Use thesis or fixed "
            f"weights"
        )
    if settings.allocation == "random":
        raise ValueError(
            f"rule {text} needs allocation systematic, because it learns variances at fixed shares; got random. Use "
            f"thesis or fixed weights, which go with it"
        )
    of_pilot = [("pilot samples", n) for n in rule.pilot.values()]
    for name, n in (("shading_samples", settings.shading_samples), *of_pilot):
        if n % 2:
            raise ValueError(
                f"{name} must be even for rule {text}, which learns from two halves of them; got {n}. Use {n + 1}, or "
                f"rule thesis"
            )
        if n % len(settings.techniques) and name == "pilot samples":
            raise ValueError(f"{name} must be a multiple of {len(settings.techniques)} techniques; got {n}")
    pilot_settings(settings, paired=True)  # refuses too many shading samples
