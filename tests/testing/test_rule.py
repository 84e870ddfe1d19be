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
from dmis.fit.round import Round
from dmis.testing.outcome import require
from dmis.testing.rule import check_rule
from dmis.testing.scenes import _mean, box_scene
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


def yielding(rounds: Callable[..., Any]) -> Any:
    """Return a rule whose rounds are made of a budget, its final round at w = 1/2, and one of 4 samples before.

    `rounds` is a generator, or returns a single round.
    """

    def of_budget(self: Any, budget: Any) -> Any:
        final = budget.final(dmis.Fit(0.5), spent=4)
        made = rounds(budget, final, replace(final, spp=4, image_weight=4))
        if isinstance(made, Round):
            yield made
        else:
            yield from made

    return type("Mine", (dmis.Rule,), {"rounds": of_budget, "settings": {"sampler": "independent"}})()


def joined(budget: Any, final: Any, first: Any) -> Any:
    """The pilot decides the numbers of samples of its own pixels, and is counted with them."""
    film = yield first
    noise = np.sqrt(film.moments.variance().mean(axis=2)) + 1e-6
    more = np.maximum((noise / noise.mean() * final.spp).astype(int), 1)
    yield replace(final, spp=more, begin=4, before=film.moments, image_weight=budget.spp)


def weighed(budget: Any, final: Any, first: Any) -> Any:
    """The weight of the second round depends on the brightness of the first."""
    film = yield first
    yield replace(final, image_weight=int(1e6 * film.moments.mean.mean()) + 1)


def raising(budget: Any, final: Any, first: Any) -> Any:
    yield first
    raise IndexError("no more")


CALLS = itertools.count()
FAULTS: dict[str, tuple[Any, str, str]] = {
    "share above 1": (
        rule(lambda brdf, light: 1.5 + 0 * brdf),
        "it is a rule",
        "image of 16x16 pixels: a rule's weight must be in",
    ),
    "wrong shape": (rule(lambda brdf, light: brdf[:-1] * 0), "it is a rule", "a rule's weight must be of shape"),
    "shape of even images": (
        rule(lambda brdf, light: np.full((16, 16), 0.5)),
        "fit returns shares in [0, 1]",
        "image of 21x13 pixels: a rule's weight must be of shape",
    ),
    "0 / 0 in a black image": (
        rule(lambda brdf, light: np.where((brdf + light).max() > 0, quieter(brdf, light), brdf / (brdf + light))),
        "without variance",
        "a rule's weight must be in [0, 1], a share of the samples; got nan",
    ),
    "another result each time": (
        rule(lambda brdf, light: np.full(brdf.shape, 0.5 + 1e-3 * (next(CALLS) % 7))),
        "pilot alone",
        "fit returns other shares from the same pilot (weight differs by up to 0.00",
    ),
    "no fit": (rule(lambda brdf, light: "half"), "it is a rule", "a rule's fit must be a dmis.Fit; got str"),
    "fit raises": (rule(lambda brdf, light: brdf / "x"), "it is a rule", "<lambda> raised TypeError: "),
    "unknown settings": (
        rule(quieter, settings={"depth": 3}),
        "it is a rule",
        "must be fields of dmis.Settings; got 'depth'",
    ),
    "sum of shares": (
        yielding(lambda budget, final, first: replace(final, shares=np.full(2, 0.9))),
        "it is a rule",
        "shares of a round must add up to 1 over the techniques, because shares divide samples; got sums from 1.8",
    ),
    "NaN": (
        yielding(lambda budget, final, first: replace(final, shares=np.full(2, np.nan))),
        "it is a rule",
        "shares of a round must be in [0, 1], a share of the samples; got nan",
    ),
    "map of another shape": (
        yielding(lambda budget, final, first: replace(final, spp=np.full((8, 16), 28))),
        "it is a rule",
        "image of 16x16 pixels: spp of a round must be of shape () or (16, 16), for the image or for each pixel",
    ),
    "bias": (
        yielding(joined),
        "renders",
        "). rounds: spp of the last Round depends on the samples that it is joined to",
    ),
    "weight": (yielding(weighed), "renders", "rounds: image_weight depends on samples, [4, "),
    "rounds raise": (yielding(raising), "it is a rule", "raising raised IndexError: no more (test_rule.py, line "),
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
    assert found.message.endswith("settings: dmis.check_technique tells whether technique wrong is wrong")


def test_a_rule_learns_whatever_its_least_budget() -> None:
    """With 32 samples it would be rendered with equal shares."""
    outcomes = check_rule(rule(lambda brdf, light: 1.5 + 0 * brdf, least_spp=100))
    assert "a rule's weight must be in [0, 1]" in outcomes[0].message


def test_a_reused_pilot_is_named() -> None:
    """It is right, but noisy."""
    outcomes = check_rule(rule(quieter, settings={"reuse_pilot": True, "sampler": "independent"}))
    require(outcomes)
    assert "; the pilot is 12% of the image's samples and makes" in outcomes[-1].message


def test_pixels_of_one_sample_are_compared() -> None:
    """Their standard error is unknown, which was equal to any mean: here w = 1/2 at half of the radiance."""
    scene = box_scene(resolution=(32, 32))
    half = replace(scene, lights=(dmis.QuadLight((-0.5, -0.5, 2), (0, 1, 0), (1, 0, 0), (2.5, 2, 1.5)),))
    mean, error, _ = _mean(dmis.render(half, "balance", 1, parallel=1), dmis.render(scene, "balance", 64).image)
    assert 0 < error < mean / 10


@pytest.mark.parametrize(
    "right", [rule(quieter), "thesis:patch=4", "auto", dmis.Given(weight=0.3)], ids=("own", "thesis", "auto", "given")
)
def test_right_rules_pass(right: Any) -> None:
    require(check_rule(right))
