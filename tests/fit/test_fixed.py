"""Given shares of several techniques: texts, and unbiased images."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
import pytest
from helpers import Z_LIMIT, images_z_score

import dmis
from dmis.base.vectors import Array
from dmis.brdf.materials import plastic
from dmis.estimator.settings import Settings
from dmis.fit.fixed import Fixed
from dmis.fit.registry import make_rule
from dmis.light.area import SphereLight
from dmis.report.compare import parse_rules
from dmis.testing.scenes import box_scene

LAMP = SphereLight((0.0, 1.5, 3.0), 1.0, (5.0, 4.0, 3.0))
MIX = "fixed:light=0.3,brdf=0.45,uniform=0.25"
THREE = ("light", "brdf", "uniform")


@cache
def images(rule: Any, first: int = 0, **settings: Any) -> Array:
    """Two images of a glossy floor under a large sphere."""
    scene = box_scene(plastic(0.3, 0.3, 0.1), (LAMP,), resolution=(28, 28))
    chosen = Settings(**settings)
    return np.array([dmis.render(scene, rule, 32, seed=first + k, parallel=1, settings=chosen).image for k in (0, 1)])


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
    assert abs(images_z_score(images(rule, **settings, **path), images("balance", 500, **path))) < Z_LIMIT


def test_texts(box: dmis.Scene) -> None:
    """Of two techniques the rule is that of one weight; commas between rules, and within one."""
    assert make_rule(f"{MIX},combiner=power") == Fixed((0.3, 0.45, 0.25), "power", THREE)
    assert make_rule("fixed:light=0.25,brdf=0.75") == Fixed(0.25, techniques=("light", "brdf"))
    assert parse_rules(f"balance,{MIX},auto") == ["balance", MIX, "auto"]
    assert dmis.render(box, MIX, 4, seed=3).weight == pytest.approx(0.3)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("fixed", "rule fixed needs the share of light samples, such as fixed:0.5, .*; got none"),
        ("fixed:combiner=power", "rule fixed needs the share of light samples, .*; got none"),
        ("fixed:0.5,light=0.5,brdf=0.5", "rule fixed needs .*; got both"),
        ("fixed:light=0.5", "shares of at least two techniques; got light"),
        ("fixed:light=0.5,brdf=0.3,uniform=0.3", r"add up to 1, .* got 0.5 \+ 0.3 \+ 0.3 = 1.1"),
        ("fixed:light=1.5,brdf=-0.5", r"shares must be in \[0, 1\]"),
        ("fixed:light=x,brdf=0.5", "option light of rule fixed must be of type float"),
        ("fixed:dark=0.5", "rule fixed has the options w, .*, weigh, light, brdf, uniform; got 'dark'"),
        ("simplex:light=0.5,brdf=0.5", "given by the rule fixed; got .* Write fixed:light=0.5,brdf=0.5"),
        ("simplex", "got 'simplex'. It is a plug-in: load it with --plugin simplex, or dmis.load_plugin.'simplex'"),
        ("kl:patch=8", "got 'kl'. It is a plug-in: load it with --plugin objectives, or dmis.load_plugin.'objectives'"),
    ],
)
def test_texts_that_are_refused(text: str, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        make_rule(text)


def test_three_techniques_where_two_are_needed() -> None:
    """Combiners that fit or freeze, and rules of one weight."""
    for combiner in ("optimal", "frozen"):
        with pytest.raises(ValueError, match=f"combiner {combiner} needs two techniques; got 3: light, brdf, uniform"):
            Settings(techniques=THREE, combiner=combiner)
    with pytest.raises(ValueError, match="techniques must be at least two names"):
        Settings(techniques=("light",))
    with pytest.raises(ValueError, match=r"got 'resampled'. It is a plug-in: load it with --plugin resampled"):
        dmis.render(box_scene(), "thesis", 16, techniques=("resampled", "brdf"))
    scene = box_scene(resolution=(8, 8))
    with pytest.raises(ValueError, match=r"weight must be of shape \(3,\) or .*; got \(2,\)"):
        dmis.render(scene, Fixed((0.5, 0.5), techniques=THREE), 16)
    for rule in ("thesis", "second-moment", "balance"):
        with pytest.raises(ValueError, match=r"got 3: light, brdf, uniform. Use rule fixed:light=...,brdf=..."):
            dmis.render(scene, rule, 16, settings=Settings(techniques=THREE))
