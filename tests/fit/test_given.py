"""The rule of a map that the user brings."""

from typing import Any

import numpy as np
import pytest
from helpers import Z_LIMIT, z_score

import dmis

WIDTH, HEIGHT = 32, 24


@pytest.mark.parametrize("w", [0.0, 0.3, 1.0])
def test_constant_map_is_fixed(box: dmis.Scene, w: float) -> None:
    """One number and a constant map give the image of `fixed`, bit by bit."""
    fixed = dmis.render(box, f"fixed:{w}", 8, seed=2)
    for weight in (w, np.full((HEIGHT, WIDTH), w), np.full((HEIGHT, WIDTH), w, np.float32)):
        given = dmis.render(box, dmis.Given(weight=weight), 8, seed=2)
        np.testing.assert_array_equal(given.image, fixed.image)
        np.testing.assert_array_equal(given.weight, fixed.weight)
        np.testing.assert_array_equal(given.deviation, fixed.deviation)


def test_settings_are_the_callers(box: dmis.Scene) -> None:
    """The combiner is not the rule's."""
    settings = dmis.Settings(combiner="power")
    given, fixed = (
        dmis.render(box, rule, 8, seed=2, settings=settings).image
        for rule in (dmis.Given(weight=0.25), "fixed:0.25,combiner=power")
    )
    np.testing.assert_array_equal(given, fixed)


def test_uneven_maps_keep_the_mean(box: dmis.Scene) -> None:
    """Weights from 0.1 to 0.9 and samples from 1 to 3 in proportion: the mean is that of the balance heuristic."""
    y, x = np.mgrid[:HEIGHT, :WIDTH]
    rule = dmis.Given(weight=0.1 + 0.8 * ((x // 4 + y // 4) % 2), samples=1.0 + 2.0 * (x >= WIDTH // 2))
    results = [dmis.render(box, rule, 16, seed=seed) for seed in range(24)]
    balance = [dmis.render(box, "balance", 16, seed=100 + seed).image.mean() for seed in range(24)]
    assert abs(z_score([result.image.mean() for result in results], balance)) < Z_LIMIT
    np.testing.assert_allclose(results[0].weight, rule.weight, rtol=1e-6)
    samples = results[0].samples
    assert samples.mean() == pytest.approx(16, rel=1e-3)
    assert samples[:, WIDTH // 2 :].mean() == pytest.approx(3 * samples[:, : WIDTH // 2].mean(), rel=1e-2)


def test_maps_are_copies() -> None:
    """What happens to the caller's array does not reach the rule, and the rule's cannot be written to."""
    weight = np.full((2, 3), 0.5)
    rule = dmis.Given(weight=weight)
    weight[:] = 2
    assert np.max(rule.weight) == 0.5 and not rule.weight.flags.writeable
    assert repr(rule) == "Given(weight=<2 x 3, 0.5 to 0.5>, samples=None)"


@pytest.mark.parametrize(
    "maps, message",
    [
        (
            {"weight": np.zeros((WIDTH, HEIGHT))},
            r"weight must be of shape .*\(24, 32\).*height, width.*; got \(32, 24\)",
        ),
        ({"samples": np.ones((3, 4))}, r"samples must be .* of shape \(24, 32\), .*; got shape \(3, 4\)"),
        ({"samples": 3.0}, r"samples must be .*; got shape \(\)"),
        ({"weight": 1.5}, r"weight must be in \[0, 1\], a share of the samples; got 1.5"),
        ({"weight": np.full((HEIGHT, WIDTH), np.nan)}, "got nan"),
        ({"samples": -np.ones((HEIGHT, WIDTH))}, "positive, finite.*; got .* -1 to -1"),
    ],
)
def test_bad_maps(box: dmis.Scene, maps: dict[str, Any], message: str) -> None:
    """Each message names the map, the constraint and the value."""
    with pytest.raises(ValueError, match=message):
        dmis.render(box, dmis.Given(**maps), 8)
