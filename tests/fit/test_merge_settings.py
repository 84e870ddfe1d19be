"""Settings of a render: what is given stays or is refused, and the first source that names a value decides."""

import pickle
import re
from dataclasses import replace
from itertools import combinations
from typing import Any

import pytest

import dmis
from dmis.cli.commands import main
from dmis.estimator.settings import DEFAULTS, PRESETS, make_settings
from dmis.fit.rule import merge_settings

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


def test_open_fields_read_as_their_defaults() -> None:
    """Or as the preset's values; equality and ``repr`` are those of plain values, ``auto`` is not given."""
    settings = dmis.Settings()
    assert (settings.shading_samples, settings.combiner) == (2, "balance") and "combiner='balance'" in repr(settings)
    assert settings == dmis.Settings(combiner="balance", sampler="auto") and not dmis.Settings(sampler="auto").explicit
    assert dmis.Settings(preset="nearest", sampler="auto").sampler == "lowdiscrepancy"
    assert replace(dmis.Settings(preset="nearest"), preset=None) == settings


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


def test_info_says_who_decides(capsys: pytest.CaptureFixture[str]) -> None:
    """A line for each setting; what conflicts ends the command."""
    scene = ["info", "teapot-area-light", "--resolution", "16x12", "--rule"]
    assert main([*scene, "thesis:combiner=power", "--preset", "nearest", "--max-depth", "3"]) == 0
    decided = [line.strip() for line in capsys.readouterr().out.partition("who decides")[2].splitlines()[1:]]
    assert len(decided) == len(DEFAULTS)
    assert {"combiner: 'power', rule", "max_depth: 3, caller", "sampler: 'lowdiscrepancy', preset"} <= set(decided)
    assert {"integrator: 'direct', scene", "reuse_pilot: False, default"} <= set(decided)
    assert main([*scene, "thesis:sampler=sobol", "--sampler", "stratified"]) == 2
