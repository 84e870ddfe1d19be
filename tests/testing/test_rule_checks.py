"""`check_rule`: it finds each planted fault, and right rules pass."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from helpers import assert_found

import dmis
from dmis.base.vectors import Array
from dmis.estimator.mis import BRDF
from dmis.fit.round import Round
from dmis.testing.outcome import require
from dmis.testing.rule_checks import check_rule
from dmis.testing.scenes import box_scene, mean_of_image
from dmis.testing.technique_checks import registered


def rule(weight: Callable[[Array, Array], Any], **attributes: Any) -> Any:
    """Return a rule whose fit returns this weight of the variances of BRDF and light samples, ``(H, W)``."""

    def fit(self: Any, pilot: Any) -> Any:
        w = weight(*(pilot[k].variance().mean(axis=2) for k in (0.0, 1.0)))
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
    noise = np.sqrt(film.variance().mean(axis=2)) + 1e-6
    more = np.maximum((noise / noise.mean() * final.spp).astype(int), 1)
    yield replace(final, spp=more, begin=4, before=film.moments, image_weight=budget.spp)


def raising(budget: Any, final: Any, first: Any) -> Any:
    yield first
    raise IndexError("no more")


REFUSED, ANY, RENDERS = "accepts", "renders any image", "agree with balance"
FAULTS: dict[str, tuple[Any, str, str]] = {
    "share above 1": (rule(lambda brdf, light: 1.5 + 0 * brdf), REFUSED, "a rule's weight must be in"),
    "shape of even images": (
        rule(lambda brdf, light: np.full((16, 16), 0.5)),
        ANY,
        "an image of 21x13 pixels: Mine: a rule's weight must be of shape",
    ),
    "0 / 0 in a black image": (
        rule(lambda brdf, light: np.where((brdf + light).max() > 0, quieter(brdf, light), brdf / (brdf + light))),
        ANY,
        "an image of a black floor: Mine: a rule's weight must be in .*; got nan",
    ),
    "fit raises": (rule(lambda brdf, light: brdf / "x"), REFUSED, "<lambda> raised TypeError: "),
    "bias": (yielding(joined), RENDERS, "spp of the last Round depends on the samples that it is joined to"),
    "rounds raise": (yielding(raising), REFUSED, r"raising raised IndexError: no more \(test_rule_checks.py, line "),
    "no rule": (3, REFUSED, "rule must be a rule, or text such as thesis:patch=16; got 3"),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_each_fault_is_found(fault: str) -> None:
    wrong, check, message = FAULTS[fault]
    assert_found(check_rule(wrong), check, message)


def test_a_rule_of_another_mean_is_found() -> None:
    """Its settings ask for a technique whose pdf is twice the density of its samples."""
    wrong = replace(BRDF, name="wrong", rays="wrong", pdf=lambda s, d, p: 2 * BRDF.pdf(s, d, p))
    with registered(wrong):
        outcomes = check_rule(rule(quieter, settings={"reuse_pilot": False, "techniques": ("light", "wrong")}))
    (found,) = [outcome for outcome in outcomes if not outcome.passed]
    assert "renders" in found.name and found.message.startswith("mean radiance balance 0.")
    assert found.message.endswith("settings: dmis.check_technique tells whether a technique of your own is wrong")


def test_a_rule_learns_whatever_its_least_budget() -> None:
    """With 32 samples it would be rendered with equal shares."""
    outcomes = check_rule(rule(lambda brdf, light: 1.5 + 0 * brdf, least_spp=100))
    assert_found(outcomes, REFUSED, "a rule's weight must be in")
    # it is right, but noisy
    outcomes = check_rule(rule(quieter, settings={"reuse_pilot": True, "sampler": "independent"}))
    require(outcomes)
    assert "; the pilot is 12% of the image's samples and makes" in outcomes[-1].message


def test_pixels_of_one_sample_are_compared() -> None:
    """Their standard error is unknown, which was equal to any mean: here w = 1/2 at half of the radiance."""
    scene = box_scene(resolution=(32, 32))
    half = replace(scene, lights=(dmis.QuadLight((-0.5, -0.5, 2), (0, 1, 0), (1, 0, 0), (2.5, 2, 1.5)),))
    mean, error, _ = mean_of_image(dmis.render(half, "balance", 1, parallel=1), dmis.render(scene, "balance", 64).image)
    assert 0 < error < mean / 10


@pytest.mark.parametrize(
    "right", [rule(quieter), "thesis:patch=4", "auto", dmis.Given(weight=0.3)], ids=("own", "thesis", "auto", "given")
)
def test_right_rules_pass(right: Any) -> None:
    require(check_rule(right))
