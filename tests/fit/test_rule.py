"""The base class of rules: defaults, names, errors; texts that name rules."""

import re
from typing import Any

import numpy as np
import pytest

import dmis
from dmis.fit.registry import RULES, Thesis, make_rule
from dmis.fit.round import Budget
from dmis.fit.rule import rule_text
from dmis.report.compare import parse_rules
from dmis.variance.curves import Curves


class Constant(dmis.Rule):
    """A rule with nothing but a fit, whose options are the arguments of its constructor."""

    def __init__(self, w: float = 0.25, name: str = "", steep: bool = False, table: tuple = ()) -> None:
        self.w, self.name, self.steep, self.table = w, name, steep, table

    def fit(self, pilot: object) -> dmis.Fit:
        return dmis.Fit(weight=self.w)


class Plain:
    """A class that does not derive from `dmis.Rule`."""

    fit = Constant.fit


class NoFit(dmis.Rule):
    pass


class Stubborn(Constant):
    """A rule that has a setting and no option for it."""

    settings = {"combiner": "balance"}  # noqa: RUF012


OUT_OF_RANGE = """
fixed:w=1.5 fixed:w=nan auto:spp=6 auto:spp=2 auto:exponent=0.5 auto:error=mse auto:guard=-1 thesis:patch=0
thesis:patch=99999999999999999999 thesis:spp=1 thesis:no_signal=zero thesis:ragged=cut thesis:channels=red
thesis:filter=box thesis:size=4 thesis:size=999999999 thesis:sigma=0 thesis:sigma=nan thesis:sigma=inf
second-moment:filter=box second-moment:size=4 second-moment:size=999999999 second-moment:sigma=0
second-moment:sigma=nan second-moment:sigma=inf second-moment:patch=6 second-moment:patch=2 second-moment:spp=2
second-moment:patch=99999999999999999996 second-moment:spp=7 second-moment:guard=-1
"""


def test_only_fit_must_be_given(box: dmis.Scene) -> None:
    """Everything else has a default; the image is that of the weight."""
    rule = make_rule(Constant())
    assert dict(rule.pilot) == dict(rule.settings) == {}
    assert rule.statistic is None and not rule.needs_features and not rule.multi_technique
    fixed = dmis.render(box, "fixed:0.25", 8, seed=1)
    np.testing.assert_array_equal(dmis.render(box, rule, 8, seed=1).image, fixed.image)
    rule.pilot = {0.5: 2}  # type: ignore[misc]
    assert dmis.render(box, rule, 8, seed=1).provenance["pilot_rays"]


def test_rounds_of_a_budget() -> None:
    """6 pilot samples of three techniques are 2 with 6 shading samples each; decisions depend on seed and round."""
    settings = dmis.Settings(techniques=("light", "brdf", "uniform"), reuse_pilot=True)
    budgets = [Budget(16, (4, 4), settings, seed) for seed in (1, 2)]
    pilot, final = budgets[0].pilot((1 / 3,) * 3, 6, Curves), budgets[0].final(dmis.Fit((1 / 3,) * 3), 6)
    assert (pilot.spp, pilot.image_weight, pilot.settings.shading_samples) == (2, 2, 6)
    assert (final.spp, final.image_weight, final.settings.shading_samples) == (10, 10, 2)
    assert len({budget.generator(k).random() for budget in budgets for k in (0, 1)}) == 4


@pytest.mark.parametrize(
    "rules, message",
    [
        # no rule
        ([Plain()], r"Derive its class from dmis\.Rule: class Plain\(dmis\.Rule\)"),
        ([NoFit()], r"(?s)has no method fit. Add it to class NoFit: def fit\(self, pilot\)"),
        ([Constant], r"Make an object of the class: Constant\(\)"),
        ([None, np.zeros((2, 2))], r"got .*A map of weights is dmis.Given\(weight=...\)"),
        (["", "best", "Balance"], "rule must be one of balance.*; got '{rule}'"),
        ([0.5, "0.5"], "got '0.5', did you mean 'fixed:0.5'?"),
        (["power"], "got 'power', did you mean 'pbrt'?"),
        (["brdf"], "got 'brdf', did you mean 'fixed:0'?"),
        # no option
        (["balance:w=0.3", "fixed:techniques=a", "thesis:shape=3", "counts:weights=yes"], "has the options .*; got '"),
        # no value of an option
        (["fixed:x"], "option w of rule fixed must be of type float; got 'x'"),
        (["thesis:patch=4.5", "thesis:patch=small"], "option patch of rule thesis must be of type int or auto; got '"),
        (["thesis:spp=auto"], "option spp of rule thesis must be of type int; got 'auto'"),
        (["thesis:reuse=maybe"], "option reuse of rule thesis must be yes or no; got 'maybe'"),
    ],
)
def test_non_rules_are_refused(rules: list[Any], message: str) -> None:
    """Errors name the rule or option, what it allows, and the value; or what was meant."""
    for rule in rules:
        with pytest.raises(ValueError, match=message.replace("{rule}", str(rule))):
            make_rule(rule)


@pytest.mark.parametrize("text", OUT_OF_RANGE.split())
def test_options_out_of_range_are_refused(text: str) -> None:
    """Errors name the option, what it allows, and the value."""
    option, value = text.partition(":")[2].split("=")
    with pytest.raises(ValueError, match=rf"^{option} (of .* )?must be .+; got '?{value}"):
        make_rule(text)


NO_NUMBER = "(samples|shares) of the pilot of rule .* must be a .*number .*; got "


@pytest.mark.parametrize(
    "name, value, message",
    [
        ("pilot", None, r"pilot of rule .* must be a dict such as \{0.5: 2\}.*; got None. Or leave it out"),
        ("settings", {"sampling": "sobol"}, "must be fields of dmis.Settings; got 'sampling'"),
        *(("pilot", pilot, NO_NUMBER) for pilot in ({0.5: 2.5}, {0.5: "2"}, {(0.5, "b"): 2}, {float("nan"): 2})),
        ("settings", [1], r"settings of rule .* must be a dict .*; got \[1\]"),
    ],
)
def test_bad_parts_are_named(box: dmis.Scene, name: str, value: object, message: str) -> None:
    """Before anything is rendered."""
    rule = Constant()
    setattr(rule, name, value)
    with pytest.raises(ValueError, match=message):
        dmis.render(box, rule, 8)


@pytest.mark.parametrize(
    ("rule", "text"),
    [
        ("thesis:patch=8", "thesis:patch=8"),
        (dmis.Given(0.25), "Given(weight=0.25, samples=None)"),
        (Constant(table=(Constant.fit,)), "Constant(w=0.25, name='', steep=False, table=(<function Constant.fit>,))"),
    ],
)
def test_text_of_a_rule(rule: object, text: str) -> None:
    """Text as it is, the class's own ``__repr__``, or the class with its attributes; no memory address."""
    assert rule_text(rule) == text


@pytest.mark.parametrize(
    ("rule", "setting", "advice"),
    [
        ("balance", {"combiner": "power"}, 'Write rule="balance:combiner=power"'),
        ("thesis:8,combiner=balance", {"combiner": "power"}, 'Write rule="thesis:8,combiner=power"'),
        ("thesis:reuse=no", {"reuse_pilot": True}, 'Write rule="thesis:reuse=yes"'),
        (Thesis(8, combiner="balance"), {"combiner": "power"}, "Make the rule with combiner='power'"),
        (Stubborn(), {"combiner": "power"}, "The rule has no option combiner: leave combiner out of the settings"),
        ("uniform", {"techniques": ("light", "uniform")}, 'Write rule="fixed:light=0.5,uniform=0.5" with your'),
    ],
)
def test_a_conflict_names_rule_and_option(box: dmis.Scene, rule: Any, setting: dict[str, Any], advice: str) -> None:
    """The advice is of the rule at hand, and what it tells to write is a rule."""
    with pytest.raises(ValueError, match=rf"^conflicting .*{re.escape(advice)}"):
        dmis.render(box, rule, 16, **setting)
    if advice.startswith("Write"):
        make_rule(advice.split('"')[1])


# Names --------------------------------------------------------------------------------------------------------------


def test_registered_rules() -> None:
    """Arguments of a constructor are options, read by the type of their defaults; what text cannot say is none."""
    dmis.register_rule("constant", Constant)
    dmis.register_rule("three-quarters", lambda: Constant(0.75))
    rule: Any = make_rule("constant:0.75,name=x,steep=yes")
    assert (rule.w, rule.name, rule.steep) == (0.75, "x", True)
    assert parse_rules("constant:0.5,steep=no,balance") == ["constant:0.5,steep=no", "balance"]
    assert make_rule("three-quarters").fit({}).weight == 0.75
    for text, message in (
        ("constant:table=3", "rule constant has the options w, name, steep; got 'table'"),
        ("three-quarters:patch=4", "rule three-quarters has no options; got 'patch'"),
        ("three-quarters:4", "rule three-quarters has no options; got '4'"),
    ):
        with pytest.raises(ValueError, match=message):
            make_rule(text)


@pytest.mark.parametrize(
    "cls, message",
    [
        (Constant(), "rule mine must be a class or a function; got .*Constant"),
        (NoFit, "has no method fit. Add it to class NoFit"),
        (lambda patch: Constant(), "must have a default for every option.*; got: .*'patch'"),
    ],
)
def test_bad_classes(cls: object, message: str) -> None:
    """Errors say what is allowed, what was given and what to write; nothing is registered."""
    with pytest.raises(ValueError, match=message):
        dmis.register_rule("mine", cls)
    assert "mine" not in RULES
