"""Rules without a pilot: given shares of several techniques, and maps that the user brings."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from helpers import Z_LIMIT, images_z_score, lamp_images, z_score

import dmis
from dmis.fit.fixed import Fixed
from dmis.fit.registry import make_rule
from dmis.report.compare import parse_rules

MIX = "fixed:light=0.3,brdf=0.45,uniform=0.25"
THREE = ("light", "brdf", "uniform")
WIDTH, HEIGHT = 32, 24


@pytest.mark.parametrize(
    "rule, settings, path",
    [
        (f"{MIX},combiner=power", {"shading_samples": 3}, {}),
        (f"{MIX},combiner=cutoff,sampler=sobol", {"shading_samples": 1}, {}),
        (f"{MIX},sampler=stratified", {}, {}),
        (Fixed((0.2, 0.3, 0.5), techniques=("uniform", "brdf", "light"), allocation="random"), {}, {}),
        (MIX, {}, {"integrator": "path", "max_depth": 3}),
    ],
)
def test_images_of_several_techniques_are_unbiased(rule: Any, settings: dict[str, Any], path: dict[str, Any]) -> None:
    """Against light and BRDF samples with the balance heuristic."""
    assert abs(images_z_score(lamp_images(rule, **settings, **path), lamp_images("balance", 500, **path))) < Z_LIMIT


def test_texts_and_maps(box: dmis.Scene) -> None:
    """Of two techniques the rule is that of one weight; commas between rules, and within one."""
    assert make_rule(f"{MIX},combiner=power") == Fixed((0.3, 0.45, 0.25), "power", THREE)
    assert make_rule("fixed:light=0.25,brdf=0.75") == Fixed(0.25, techniques=("light", "brdf"))
    assert parse_rules(f"balance,{MIX},auto") == ["balance", MIX, "auto"]
    assert dmis.render(box, MIX, 4, seed=3).weight == pytest.approx(0.3)
    # three techniques where two are needed
    with pytest.raises(ValueError, match="combiner optimal needs two techniques; got 3: light, brdf, uniform"):
        dmis.Settings(techniques=THREE, combiner="optimal")
    # what happens to the caller's array does not reach the rule, and the rule's cannot be written to
    weight = np.full((2, 3), 0.5)
    rule = dmis.Given(weight=weight)
    weight[:] = 2
    assert np.max(rule.weight) == 0.5 and not rule.weight.flags.writeable
    assert repr(rule) == "Given(weight=<2 x 3, 0.5 to 0.5>, samples=None)"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("fixed", "rule fixed needs the share of light samples, such as fixed:0.5, .*; got none"),
        ("fixed:0.5,light=0.5,brdf=0.5", "rule fixed needs .*; got both"),
        ("fixed:light=0.5", "shares of at least two techniques; got light"),
        ("fixed:light=0.5,brdf=0.3,uniform=0.3", r"add up to 1, .* got 0.5 \+ 0.3 \+ 0.3 = 1.1"),
        ("fixed:light=x,brdf=0.5", "option light of rule fixed must be of type float"),
        ("fixed:dark=0.5", "rule fixed has the options w, .*, weigh, light, brdf, uniform; got 'dark'"),
        ("simplex", "got 'simplex'. It is a plug-in: load it with --plugin simplex, or dmis.load_plugin.'simplex'"),
        ("kl:patch=8", "got 'kl'. It is a plug-in: load it with --plugin objectives, or dmis.load_plugin.'objectives'"),
    ],
)
def test_texts_that_are_refused(text: str, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        make_rule(text)


# Maps -----------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("w", [0.0, 0.3, 1.0])
def test_constant_map_is_fixed(box: dmis.Scene, w: float) -> None:
    """One number and a constant map give the image of `fixed`, bit by bit, with the caller's settings."""
    fixed = dmis.render(box, f"fixed:{w}", 8, seed=2, combiner="power")
    for weight in (w, np.full((HEIGHT, WIDTH), w), np.full((HEIGHT, WIDTH), w, np.float32)):
        given = dmis.render(box, dmis.Given(weight=weight), 8, seed=2, combiner="power")
        np.testing.assert_array_equal(given.image, fixed.image)
        np.testing.assert_array_equal(given.weight, fixed.weight)
        np.testing.assert_array_equal(given.deviation, fixed.deviation)


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
