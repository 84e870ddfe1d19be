"""Why a pixel is noisy: the script's variance and sources against closed forms and renders."""

from __future__ import annotations

import runpy
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scripts import run_script  # noqa: F401  # a fixture

import dmis
from dmis.geometry.shapes import quad
from dmis.testing.scenes import ABOVE, box_scene
from dmis.variance.curves import GRID, HALF

pytest.importorskip("matplotlib")
pytestmark = pytest.mark.examples
SCRIPT = Path(__file__).parent.parent / "examples" / "explained" / "why_is_this_pixel_noisy.py"


@pytest.fixture(scope="module")
def script():
    return runpy.run_path(str(SCRIPT))


def test_lamp_edge(script) -> None:
    """Emission E on the share q of the square has the variance E^2 q (1 - q), which no w changes.

    Beside a floor of radiance I it has Cov(E 1, E 1 + I (1 - 1)) = E (E - I) q (1 - q) of the variance.
    """
    camera = dmis.Camera.look_at((0, 0, 2), (0, 0, 0), (0, 1, 0), np.degrees(2 * np.arctan(0.5)), (1, 1))
    lamp = dmis.QuadLight((-1, -1, 0), (0.6, 0, 0), (0, 2, 0), (5, 4, 3))
    bright = replace(ABOVE, corner=(-0.5, -0.5, 0.5), radiance=(90, 90, 90))
    for kd, lights in ((0.0, (lamp,)), (0.8, (lamp, bright))):
        floor = dmis.Part(quad((-4, -4, -1), (8, 0, 0), (0, 8, 0)), dmis.matte(kd))
        why = script["explain"](dmis.Scene(camera, (dmis.light_part(lamp), floor), lights), (0, 0), rules=())
        v, p = why["sources"][script["SEEN"]]
        if kd == 0:
            np.testing.assert_allclose(why["variance"], 16 * 0.3 * 0.7, rtol=0.05)
            assert (v, p) == pytest.approx((1, 1)) and why["largest"] == []
    radiance = (why["mean"] - 0.3 * 4) / 0.7
    assert 0.05 < abs(v) < 0.9 and p == pytest.approx(v, rel=0.2)
    assert v == pytest.approx(4 * (4 - radiance) * 0.3 * 0.7 / why["variance"][HALF], rel=0.15)


def test_variance_is_that_of_renders(script) -> None:
    """V(1/2) and P = V - A / S: with 16 times the shading samples a render has P + A / (16 S)."""
    scene, spp = box_scene(dmis.matte((0.6, 0.3, 0.6)), resolution=(1, 1)), 2**14
    why = script["explain"](scene, (0, 0), spp, rules=("fixed:0.3",))
    assert why["marks"] == {"balance": 0.5, "fixed": pytest.approx(0.3), "oracle": GRID[why["variance"].argmin()]}
    p = sum(share for _, share in why["sources"].values())
    assert sum(v for v, _ in why["sources"].values()) == pytest.approx(1) and 0.1 < p < 0.9
    for s, expected in ((2, 1.0), (32, p + (1 - p) / 16)):
        result = dmis.render(
            scene, "balance", spp, seed=5, sampler="independent", shading_samples=s, integrator="direct"
        )
        # channels rise and fall together
        assert spp * result.deviation.mean() ** 2 == pytest.approx(expected * why["variance"][HALF], rel=0.06)
    assert why["mean"] == pytest.approx(result.image.mean(), rel=0.03)


def test_largest_samples_by_hand(script) -> None:
    """f = kd / pi L cos, p_l = d^2 / (A cos), p_b = cos / pi, W and the value of the balance heuristic, per sample."""
    why = script["explain"](box_scene(dmis.matte((0.6, 0.3, 0.6)), resolution=(16, 16)), (9, 6), rules=(), seed=3)
    assert {source for source, _ in why["largest"]} == {("QuadLight 0", name, 1) for name in ("light", "brdf")}
    for (_, technique, _), sample in why["largest"]:
        cos = sample["wi"][2]
        on_lamp = sample["point"] + sample["wi"] * (2 - sample["point"][2]) / cos
        assert np.abs(on_lamp[:2]).max() <= 0.5 + 1e-5
        np.testing.assert_allclose(sample["f"], np.multiply((0.6, 0.3, 0.6), (5, 4, 3)) / np.pi * cos, rtol=1e-4)
        assert sample["p_l"] == pytest.approx((2 / cos) ** 2 / cos, rel=1e-3)
        assert sample["p_b"] == pytest.approx(cos / np.pi, rel=1e-4)
        own = sample["p_l"] if technique == "light" else sample["p_b"]
        assert sample["W"] == pytest.approx(own / (sample["p_l"] + sample["p_b"]))
        assert sample["value"] == pytest.approx(sample["W"] * np.mean(sample["f"]) / (own / 2), rel=1e-5)
