"""Rounds refuse what would make the image wrong without a word."""

from __future__ import annotations

import re
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import dmis
from dmis.estimator.allocation import shares_of
from dmis.fit.round import Round
from dmis.testing.scenes import box_scene
from dmis.variance.curves import Curves

HALF = np.array([0.5, 0.5], np.float32)


@pytest.mark.parametrize(
    "values, message",
    [
        ({"shares": np.array([0.9, 0.9])}, "shares of a round must add up to 1 over the techniques"),
        ({"shares": np.array([1.2, -0.2])}, "shares of a round must be in [0, 1], a share of the samples; got 1.2"),
        ({"shares": np.array([np.nan, 0.5])}, "got nan"),
        ({"shares": (0.9, 0.9)}, "got sums from 1.8 to 1.8"),
        ({"shares": 0.5}, "one for each technique; got shape ()"),
        ({"shares": np.stack([np.eye(3), 2 - np.eye(3)])}, "got 2 in 6 of 9 pixels"),
        (
            {"shares": np.array([0.2, 0.3, 0.5])},
            "shares of a round must be (2, ...), one for each technique; got shape (3,)",
        ),
        ({"tilt": np.array([0.3, 0.3])}, "tilt of a round must add up to 1"),
        ({"tilt": HALF, "settings": dmis.Settings(combiner="power")}, "weigh=heuristic needs combiner balance"),
        ({"spp": -1}, "spp of a round must not be negative; got -1"),
        ({"spp": np.full((3, 3), 2.5)}, "spp of a round must be whole; got 2.5. Make it whole by dmis.fit"),
        ({"begin": np.array([[3, -2]])}, "begin of a round must not be negative; got -2"),
        ({"needs_features": "pixel"}, "needs_features of a round must be False or True or pixels; got 'pixel'"),
        ({"image_weight": 0.5}, "image_weight of a round must be whole; got 0.5"),
    ],
)
def test_wrong_rounds_are_refused(values: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=re.escape(message)):
        Round(**{"spp": 4, "shares": HALF, "settings": dmis.Settings(), **values})


def test_right_rounds_are_not() -> None:
    """Shares of the image, of its pixels, and those that float32 rounds."""
    for w in (0.0, 1.0, np.linspace(0, 1, 12).reshape(3, 4), np.array([0.1, 0.2, 0.7])):
        shares = shares_of(w)
        techniques = ("light", "brdf", "uniform")[: len(shares)]
        round_ = Round(np.ones((3, 4), int), shares, dmis.Settings(techniques=techniques), tilt=shares)
        assert round_.in_row_order().shares.shape[0] == len(shares)


@pytest.mark.parametrize(
    "values, message",
    [
        ({"shares": np.full((2, 3, 5), 0.5)}, "shares of a round must be of shape (2,) or (2, 3, 4), for the image"),
        ({"shares": np.full((2, 12), 0.5)}, "got (2, 12)"),
        ({"tilt": np.full((2, 4, 3), 0.5)}, "tilt of a round must be of shape (2,) or (2, 3, 4)"),
        ({"spp": np.ones((4, 3), int)}, "spp of a round must be of shape () or (3, 4), for the image or for"),
        ({"begin": np.ones(4, int)}, "begin of a round must be of shape () or (3, 4)"),
        ({"settings": dmis.Settings(integrator="path", sampler="sobol")}, "those of its budget; got max_depth='auto'"),
        ({"settings": dmis.Settings(max_depth=3, sampler="sobol")}, "got integrator='auto'. Write budget.settings, or"),
        ({"settings": dmis.Settings(integrator="path", max_depth=3)}, "got sampler='auto'"),
        ({"spp": np.eye(3, 4, dtype=int)}, "spp of a round with an image_weight must be at least 1, because every"),
    ],
)
def test_rounds_of_another_image_are_refused(values: dict[str, Any], message: str) -> None:
    """In place of NumPy's broadcast error, or of black pixels where there are no samples."""

    class Mine(dmis.Rule):
        def rounds(self, budget: Any) -> Any:
            yield replace(budget.final(dmis.Fit(0.5)), **values)

    with pytest.raises(ValueError, match=re.escape(message)):
        dmis.render(box_scene(resolution=(4, 3)), Mine(), 4, parallel=1)


def test_numbers_of_numpy_are_numbers() -> None:
    round_ = Round(np.int64(3), HALF, dmis.Settings(), begin=np.array(2))
    assert type(round_.spp) is int and type(round_.begin) is int


def test_the_round_of_a_rule_is_refused(box: dmis.Scene) -> None:
    """A rule that divides samples by shares of sum 1.8: the image would be 2 % darker."""

    class Over(dmis.Rule):
        def rounds(self, budget: Any) -> Any:
            yield replace(budget.final(dmis.Fit(0.5)), shares=np.array([0.9, 0.9], np.float32))

    with pytest.raises(ValueError, match=r"add up to 1 over the techniques, .*; got sums from 1.8 to 1.8"):
        dmis.render(box, Over(), 4)
    (found,) = {outcome.message for outcome in dmis.check_rule(Over()) if not outcome.passed}
    assert "shares of a round must add up to 1" in found


def test_a_statistic_needs_one_number_of_samples() -> None:
    """It is told one number of camera samples of every pixel, and would add up others in silence."""
    uneven = np.arange(1, 13).reshape(3, 4)
    with pytest.raises(ValueError, match=r"a statistic must have one number spp .*, or 0 .*, and no patterns"):
        Round(uneven, shares_of(0.5), dmis.Settings(), Curves)
