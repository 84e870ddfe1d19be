"""`check_rule`: it finds each planted fault, and right rules pass."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import dmis
from dmis.base.vectors import Array
from dmis.estimator.technique import BRDF
from dmis.testing.outcome import require
from dmis.testing.rule import check_rule
from dmis.testing.technique import registered


def rule(weight: Callable[[Array, Array], Any], **attributes: Any) -> Any:
    """Return a rule whose fit returns this weight of the variances of BRDF and light samples, ``(H, W)``."""

    def fit(self: Any, pilot: Any) -> Any:
        w = weight(*(pilot[k].moments.variance().mean(axis=2) for k in (0.0, 1.0)))
        return w if isinstance(w, str) else dmis.Fit(weight=w)

    names = {"fit": fit, "pilot": {0.0: 2, 1.0: 2}, "settings": {"reuse_pilot": False}, **attributes}
    return type("Mine", (dmis.Rule,), names)()


def quieter(brdf: Array, light: Array) -> Array:
    return ((brdf + 1e-9) / (brdf + light + 2e-9)).clip(0.1, 0.9)


CALLS = itertools.count()
FAULTS: dict[str, tuple[Any, str, str]] = {
    "share above 1": (
        rule(lambda brdf, light: 1.5 + 0 * brdf),
        "in [0, 1]",
        "fit, image of 16x16 pixels: a rule's weight must be in",
    ),
    "wrong shape": (rule(lambda brdf, light: brdf[:-1] * 0), "in [0, 1]", "a rule's weight must be of shape"),
    "shape of even images": (
        rule(lambda brdf, light: np.full((16, 16), 0.5)),
        "in [0, 1]",
        "fit, image of 21x13 pixels: a rule's weight must be of shape",
    ),
    "0 / 0 in a black image": (
        rule(lambda brdf, light: np.where((brdf + light).max() > 0, quieter(brdf, light), brdf / (brdf + light))),
        "without variance",
        "a rule's weight must be in [0, 1], a share of the samples; got nan",
    ),
    "another result each time": (
        rule(lambda brdf, light: np.full(brdf.shape, 0.5 + 1e-3 * (next(CALLS) % 7))),
        "pilot alone",
        "fit returns other shares from the same pilot, by up to 0.00",
    ),
    "no fit": (rule(lambda brdf, light: "half"), "in [0, 1]", "a rule's fit must be a dmis.Fit; got str"),
    "fit raises": (rule(lambda brdf, light: brdf / "x"), "in [0, 1]", "<lambda> raised TypeError: "),
    "unknown settings": (
        rule(quieter, settings={"depth": 3}),
        "in [0, 1]",
        "must be fields of dmis.Settings; got 'depth'",
    ),
    "no rule": (3, "it is a rule", "rule must be a rule, or text such as thesis:patch=16; got 3"),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_each_fault_is_found(fault: str) -> None:
    wrong, check, message = FAULTS[fault]
    found = [outcome for outcome in check_rule(wrong) if not outcome.passed]
    texts = [outcome.message for outcome in found if check in outcome.name]
    assert any(message in text for text in texts), [f"{o.name}: {o.message}" for o in found]


def test_a_rule_of_another_mean_is_found() -> None:
    """Its settings ask for a technique whose pdf is twice the density of its samples."""
    wrong = replace(BRDF, name="wrong", rays="wrong", pdf=lambda s, d, p: 2 * BRDF.pdf(s, d, p))
    with registered(wrong):
        outcomes = check_rule(rule(quieter, settings={"reuse_pilot": False, "techniques": ("light", "wrong")}))
    (found,) = [outcome for outcome in outcomes if not outcome.passed]
    assert "renders" in found.name and found.message.startswith("mean radiance balance 0.")


@pytest.mark.parametrize(
    "right", [rule(quieter), "thesis:patch=4", "auto", dmis.Given(weight=0.3)], ids=("own", "thesis", "auto", "given")
)
def test_right_rules_pass(right: Any) -> None:
    require(check_rule(right))
