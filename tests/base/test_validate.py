"""Checks of numbers: what is kept, as which type, and what is said of the rest."""

import json
from typing import Any

import numpy as np
import pytest

from dmis.base.validate import did_you_mean, number, pair, whole


@pytest.mark.parametrize("value", [8, 8.0, np.int64(8), np.uint8(8), np.float32(8), np.float64(8)])
def test_numbers_become_plain(value: Any) -> None:
    """Whatever their type; and can be written as JSON, which NumPy's integers cannot."""
    assert json.dumps([whole("n", value, 8, 8), number("x", value, 8, 8)]) == "[8, 8.0]"
    assert json.dumps(pair("p", np.array([value, value]), whole)) == "[8, 8]"


def test_large_numbers_stay_exact() -> None:
    assert whole("n", 10**400 + 1, 0) == 10**400 + 1


@pytest.mark.parametrize("value", [None, "8", [8], True, np.bool_(True), np.nan, np.inf, 8.5, np.float32(8.5), 1j])
def test_bad_whole_numbers(value: Any) -> None:
    with pytest.raises(ValueError, match="n must be a whole number of at least 1; got "):
        whole("n", value, 1)


@pytest.mark.parametrize("value", [None, "8", [8], True, np.nan, np.inf, -0.5, np.float32(2.5)])
def test_numbers_out_of_range(value: Any) -> None:
    with pytest.raises(ValueError, match="x must be a number from 0 to 2, of something; got "):
        number("x", value, 0, 2, "of something")


@pytest.mark.parametrize("value", [None, 8, (), (8,), (8, 8, 8)])
def test_bad_pairs(value: Any) -> None:
    with pytest.raises(ValueError, match="p must be two numbers; got "):
        pair("p", value, whole)


@pytest.mark.parametrize(
    ("name", "end"), [("thesi", ", did you mean 'thesis'?"), ("AUTO", ", did you mean 'auto'?"), ("nope", "")]
)
def test_a_name_that_is_alike_is_suggested(name: str, end: str) -> None:
    assert did_you_mean(name, ["auto", "balance", "thesis"]) == end
