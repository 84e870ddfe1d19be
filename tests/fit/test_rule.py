"""The base class of rules: defaults, names, errors; texts that name rules."""

from __future__ import annotations

import pickle
import re
from dataclasses import replace
from itertools import combinations
from typing import Any

import numpy as np
import pytest

import dmis
from dmis.cli.commands import main
from dmis.estimator.allocation import shares_of
from dmis.estimator.settings import DEFAULTS, PRESETS, make_settings
from dmis.fit.registry import RULES, Thesis, make_rule
from dmis.fit.round import Budget, Round
from dmis.fit.rule import merge_settings, rule_text
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
    # 6 pilot samples of three techniques are 2 with 6 shading samples each; decisions depend on seed and round
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


# Names -------------------------------------------------------------------------------------------------------------


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


# Rounds ---------------------------------------------------------------------------------------------------------------

SHAPE = (3, 4)
HALF = np.array([0.5, 0.5], np.float32)
SETTINGS = dmis.Settings(integrator="direct", max_depth=5, sampler="sobol")


@pytest.mark.parametrize(
    "values, message",
    [
        ({"shares": np.array([0.9, 0.9])}, "shares of a round must add up to 1 over the techniques"),
        ({"shares": np.array([1.2, -0.2])}, "shares of a round must be in [0, 1], a share of the samples; got 1.2"),
        ({"shares": np.array([np.nan, 0.5])}, "got nan"),
        ({"shares": 0.5}, "one for each technique; got shape ()"),
        ({"shares": np.stack([np.eye(3, 4), 2 - np.eye(3, 4)])}, "got 2 in 9 of 12 pixels"),
        ({"shares": np.array([0.2, 0.3, 0.5])}, "must be (2, ...), one for each technique; got shape (3,)"),
        ({"shares": np.full((2, 3, 5), 0.5)}, "shares of a round must be of shape () or (3, 4), for the image"),
        ({"tilt": np.array([0.3, 0.3])}, "tilt of a round must add up to 1"),
        ({"tilt": HALF, "settings": replace(SETTINGS, combiner="power")}, "weigh=heuristic needs combiner balance"),
        ({"spp": -1}, "spp of a round must not be negative; got -1"),
        ({"spp": np.full(SHAPE, 2.5)}, "spp of a round must be whole; got 2.5. Make it whole by dmis.fit"),
        ({"spp": np.ones((4, 3), int)}, "spp of a round must be of shape () or (3, 4), for the image or for"),
        ({"spp": np.eye(3, 4, dtype=int)}, "spp of a round with an image_weight must be at least 1, because every"),
        ({"begin": np.full(SHAPE, -2)}, "begin of a round must not be negative; got -2"),
        ({"image_weight": 0.5}, "image_weight of a round must be whole; got 0.5"),
        ({"needs_features": "pixel"}, "needs_features of a round must be False or True or pixels; got 'pixel'"),
        ({"settings": replace(SETTINGS, max_depth="auto")}, "those of its budget; got max_depth='auto'"),
        ({"settings": replace(SETTINGS, integrator="auto")}, "got integrator='auto'. Write budget.settings, or"),
        ({"spp": np.ones(SHAPE, int) + np.eye(3, 4, dtype=int), "statistic": Curves}, "must have one number spp"),
    ],
)
def test_wrong_rounds_are_refused(values: dict[str, Any], message: str) -> None:
    """In place of NumPy's broadcast error, or of an image that is wrong."""
    round_ = Round(**{"spp": 4, "shares": HALF, "settings": SETTINGS, "image_weight": 4, **values})
    with pytest.raises(ValueError, match=re.escape(message)):
        round_.checked(SHAPE)


def test_right_rounds_are_not() -> None:
    """Shares of the image, of its pixels, and those that float32 rounds; numbers of NumPy are numbers."""
    for w in (0.0, 1.0, np.linspace(0, 1, 12).reshape(SHAPE), np.array([0.1, 0.2, 0.7])):
        shares = shares_of(w)
        techniques = ("light", "brdf", "uniform")[: len(shares)]
        settings = replace(SETTINGS, techniques=techniques)
        round_ = Round(np.ones(SHAPE, int), shares.tolist(), settings, tilt=shares, begin=np.int64(2)).checked(SHAPE)
        assert round_.in_row_order().shares.shape[0] == len(shares) and type(round_.begin) is int


def test_the_round_of_a_rule_is_refused(box: dmis.Scene) -> None:
    """A rule that divides samples by shares of sum 1.8: the image would be 2 % darker."""

    class Over(dmis.Rule):
        def rounds(self, budget: Any) -> Any:
            yield replace(budget.final(dmis.Fit(0.5)), shares=np.array([0.9, 0.9], np.float32))

    with pytest.raises(ValueError, match=r"add up to 1 over the techniques, .*; got sums from 1.8 to 1.8"):
        dmis.render(box, Over(), 4)
    (found,) = {outcome.message for outcome in dmis.check_rule(Over()) if not outcome.passed}
    assert "shares of a round must add up to 1" in found


# Settings of scene, rule and caller -----------------------------------------------------------------------------------

FIRST = {**DEFAULTS, "lights": "all"}
"""Values that are given: the defaults, but for lights, whose ``auto`` gives nothing."""
VALUES = (4, ("uniform", "brdf"), "power", "random", "one", "path", 3, "independent", True, 0.5)
OTHER = dict(zip((name for name in DEFAULTS if name != "preset"), VALUES, strict=True))
"""Another value of each."""


def needing(**settings: Any) -> dmis.Rule:
    """A rule that needs these settings."""
    return type("Needing", (dmis.Rule,), {"settings": settings})()


@pytest.mark.parametrize("name", OTHER)
def test_a_default_that_is_given_is_not_replaced(box: dmis.Scene, name: str) -> None:
    """By field, option, copy, or in another process; one that is not given leaves the decision to the rule."""
    first, other = FIRST[name], OTHER[name]
    given, rule = dmis.Settings(**{name: first}), needing(**{name: other})
    copies = replace(dmis.Settings(), **{name: first}), make_settings(**{name: first}), replace(given, preset=None)
    for settings in (given, *copies, pickle.loads(pickle.dumps(given))):
        with pytest.raises(ValueError, match=rf"^conflicting {name}: Settings has {re.escape(repr(first))}, rule r"):
            merge_settings(settings, box, rule, "r")
        assert getattr(merge_settings(settings, box, needing(**{name: first}))[0], name) == first
    empty = dmis.Settings()
    for settings in (empty, replace(empty, preset=None), pickle.loads(pickle.dumps(empty))):
        assert not settings.explicit and getattr(merge_settings(settings, box, rule)[0], name) == other


def test_open_fields_read_as_their_defaults(capsys: pytest.CaptureFixture[str]) -> None:
    """Or as the preset's values; equality and ``repr`` are those of plain values, ``auto`` is not given."""
    settings = dmis.Settings()
    assert (settings.shading_samples, settings.combiner) == (2, "balance") and "combiner='balance'" in repr(settings)
    assert settings == dmis.Settings(combiner="balance", sampler="auto") and not dmis.Settings(sampler="auto").explicit
    assert dmis.Settings(preset="nearest", sampler="auto").sampler == "lowdiscrepancy"
    assert replace(dmis.Settings(preset="nearest"), preset=None) == settings
    # a line for each setting; what conflicts ends the command
    scene = ["info", "teapot-area-light", "--resolution", "16x12", "--rule"]
    assert main([*scene, "thesis:combiner=power", "--preset", "nearest", "--max-depth", "3"]) == 0
    decided = [line.strip() for line in capsys.readouterr().out.partition("who decides")[2].splitlines()[1:]]
    assert len(decided) == len(DEFAULTS)
    assert {"combiner: 'power', rule", "max_depth: 3, caller", "sampler: 'lowdiscrepancy', preset"} <= set(decided)
    assert {"integrator: 'direct', scene", "reuse_pilot: False, default"} <= set(decided)
    assert main([*scene, "thesis:sampler=sobol", "--sampler", "stratified"]) == 2


@pytest.mark.parametrize(("winner", "loser"), [*combinations(("caller", "rule", "preset", "scene", "default"), 2)])
def test_precedence(box: dmis.Scene, winner: str, loser: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Of each two sources of a depth; caller and rule name the same one."""
    values, choices = {**PRESETS["nearest"].values, "max_depth": 4}, {"max_depth": ()}
    monkeypatch.setitem(PRESETS, "nearest", replace(PRESETS["nearest"], values=values, choices=choices))  # type: ignore
    of = {"caller": 3, "rule": 3, "preset": 4, "scene": 6, "default": DEFAULTS["max_depth"]}
    depth = {source: value if source in (winner, loser) else None for source, value in of.items()}
    settings = dmis.Settings(max_depth=depth["caller"] or "auto", preset="nearest" if depth["preset"] else None)
    scene = box.changed(suggested=dmis.Suggestions("direct", depth["scene"]))
    merged, sources = merge_settings(settings, scene, needing(max_depth=depth["rule"] or "auto"))
    assert (merged.max_depth, sources["max_depth"]) == (of[winner], winner)
