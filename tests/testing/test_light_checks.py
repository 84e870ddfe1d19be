"""`check_light`: it finds each planted fault, and right lights pass."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from helpers import assert_found, with_fault
from own_lights import HalfSky, Panel

import dmis
from dmis.base.vectors import Array
from dmis.geometry.shapes import quad
from dmis.light.delta import PointLight
from dmis.light.light import AreaLight
from dmis.light.light_sample import LightSample
from dmis.testing.light_checks import check_light
from dmis.testing.outcome import require


class Inner(Panel):
    """Samples the inner part of its square alone."""

    def sample(self, p: Array, u: Array) -> LightSample:
        return Panel.sample(self, p, np.float32(0.1) + u * np.float32(0.8))


def pdf(factor: Callable[[LightSample], Any]) -> Callable[..., LightSample]:
    return lambda s, *_: replace(s, pdf=s.pdf * np.float32(factor(s)))


def brighter(sample: LightSample, *args: Array) -> LightSample:
    return replace(sample, radiance=np.broadcast_to(sample.radiance, sample.wi.shape) * np.float32(1.5))


MORE = pdf(lambda s: 1.07)
PDF, CAMERA, RENDERS = "follows pdf", "camera sees", "renders"
MASS, SEES = ("^the pdf of hit is not the density of sample: it integrates to ", "^the camera sees a mean radiance of ")
FAULTS: dict[str, tuple[type, str, Callable[..., Any], str, str]] = {
    "pdf": (Panel, "hit", MORE, PDF, MASS + "1.0[67]"),
    "pdf without cosine": (Panel, "hit", pdf(lambda s: np.abs(s.wi[2])), PDF, MASS + "0.96"),
    "pdf of sample alone": (Panel, "sample", MORE, RENDERS, "must return the same light samples"),
    "radiance of sample alone": (Panel, "sample", brighter, RENDERS, "must return the same light samples"),
    "winding": (Panel, "mesh", lambda *_: quad((-1, -1, 2), (2, 0, 0), (0, 2, 0)), CAMERA, SEES + ".* hit reports 0,"),
    "mesh elsewhere": (Panel, "mesh", lambda *_: quad((-1, -1, 2.3), (0, 2, 0), (2, 0, 0)), CAMERA, SEES),
    "emission": (
        Panel,
        "hit",
        lambda s, *_: replace(s, radiance=np.full((3, 1), 4, np.float32)),
        CAMERA,
        SEES + ".* up to 8, .* up to 4 .*emission",
    ),
    "5 % less": (Panel, "hit", lambda s, *_: replace(s, radiance=s.radiance * np.float32(1.05)), CAMERA, SEES),
    "emission turned": (
        Panel,
        "hit",
        lambda s, p, w: replace(
            s, radiance=np.where((p + w * s.distance)[[1, 1, 1]] > 0, np.float32(8), np.float32(1))
        ),
        CAMERA,
        SEES,
    ),
    "brightness": (Panel, "brightness", lambda *_: 4.0, CAMERA, r"^brightness.. returns 4, but .* 8"),
    "no mesh": (Panel, "mesh", lambda *_: None, "accepts", "must have a visible surface"),
    "falloff of 1 / d": (
        PointLight,
        "sample",
        lambda s, *_: replace(s, radiance=s.radiance * s.distance),
        "falls off",
        r"^sample: radiance is 2 times as large at half the distance",
    ),
}
POINT = (0, 0, 2), (1, 1, 1)


@pytest.mark.parametrize("fault", FAULTS)
def test_each_fault_is_found(fault: str) -> None:
    base, method, change, check, message = FAULTS[fault]
    assert_found(check_light(with_fault(base, method, change)(*(POINT if base is PointLight else ()))), check, message)


def test_samples_of_a_part_are_found() -> None:
    assert_found(check_light(Inner()), PDF, MASS + r"(1\.00|0\.99)")


class Dull(Panel):
    """A light whose radiance has no name that the default of `brightness` reads."""

    brightness = AreaLight.brightness


def test_a_light_without_brightness_is_refused() -> None:
    assert_found(check_light(Dull()), "accepts", r"Dull.*brightness")


RIGHT = [
    Panel(),
    # thinner than a pixel of the check's camera, and so thin that few of its samples hit them
    *(dmis.QuadLight((0, 0, 2), (0, 1.3, 0), (width, 0, 0), (1, 2, 3)) for width in (0.02, 0.005, 0.0003)),
    HalfSky(),
    PointLight(*POINT),
    dmis.SpotLight((30, 0, 9), (0, 0, -1), (1, 1, 1)),
    dmis.DistantLight((0, 1, 1), (1, 1, 1)),
]


@pytest.mark.parametrize("light", RIGHT, ids=lambda light: type(light).__name__)
def test_right_lights_pass(light: Any) -> None:
    require(check_light(light))
