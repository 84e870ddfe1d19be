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
from dmis.variance.curves import Curves

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
