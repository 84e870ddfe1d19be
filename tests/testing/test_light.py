"""`check_light`: it finds each planted fault, and right lights pass."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from own_lights import HalfSky, Panel

import dmis
from dmis.base.vectors import Array
from dmis.geometry.shapes import quad
from dmis.light.delta import PointLight
from dmis.light.light_sample import LightSample
from dmis.testing.light import check_light
from dmis.testing.outcome import require


def with_fault(base: type, method: str, change: Callable[..., Any], *values: Any) -> Any:
    """Return a light of these values whose `method` returns what `change` makes of its result and its arguments."""
    original = getattr(base, method)
    return type("Mine", (base,), {method: lambda self, *args: change(original(self, *args), *args)})(*values)


class Inner(Panel):
    """Samples the inner part of its square alone."""

    def sample(self, p: Array, u: Array) -> LightSample:
        return Panel.sample(self, p, np.float32(0.1) + u * np.float32(0.8))


def scaled(sample: LightSample, *args: Array) -> LightSample:
    return replace(sample, pdf=sample.pdf * np.float32(1.07))


def brighter(sample: LightSample, *args: Array) -> LightSample:
    return replace(sample, radiance=np.broadcast_to(sample.radiance, sample.wi.shape) * np.float32(1.5))


POINT = (0, 0, 2), (1, 1, 1)
CAMERA, EMITS = "camera sees", "^the camera and hit disagree .*: emits is the same in "
FAULTS: dict[str, tuple[Any, str, str]] = {
    "pdf": (with_fault(Panel, "hit", scaled), "integrates", r"^the pdf of hit is not the density of sample"),
    "pdf of a sky": (with_fault(HalfSky, "hit", scaled), "integrates", r": it integrates to 1\.07"),
    "pdf without cosine": (
        with_fault(Panel, "hit", lambda s, *_: replace(s, pdf=s.pdf * np.abs(s.wi[2]))),
        "chi-square",
        r"^sample does not follow the pdf of hit",
    ),
    "pdf of sample alone": (
        with_fault(Panel, "sample", scaled),
        "sample and hit",
        r"^sample and hit disagree .*: pdf is .* in 100% of",
    ),
    "radiance of sample alone": (
        with_fault(Panel, "sample", brighter),
        "sample and hit",
        r"^sample and hit disagree .*: radiance is 1\.5 by sample, 1 by hit in 100%",
    ),
    "emits on the wrong side": (
        with_fault(Panel, "hit", lambda s, *_: replace(s, emits=(s.pdf > 0) & (s.wi[2] < 0))),
        CAMERA,
        EMITS,
    ),
    "winding": (with_fault(Panel, "mesh", lambda *_: quad((-1, -1, 2), (2, 0, 0), (0, 2, 0))), CAMERA, EMITS),
    "mesh elsewhere": (
        with_fault(Panel, "mesh", lambda *_: quad((-1, -1, 2.3), (0, 2, 0), (2, 0, 0))),
        CAMERA,
        EMITS,
    ),
    "samples of a part": (Inner(), "chi-square", r"^sample does not follow the pdf of hit: .* integrates to 1\.00"),
    "emission": (
        with_fault(Panel, "hit", lambda s, *_: replace(s, radiance=np.full((3, 1), 4, np.float32))),
        CAMERA,
        r"^the camera and hit disagree .*: radiance is 8 by the camera, 4 by hit",
    ),
    "brightness": (with_fault(Panel, "brightness", lambda *_: 4.0), "brightness", r"^brightness.. returns 4, but .* 8"),
    "NaN": (
        with_fault(Panel, "hit", lambda s, p, wi: replace(s, pdf=s.pdf * (s.distance / s.distance))),
        "forms",
        r"^Mine.hit: pdf must be finite and not negative; got nan",
    ),
    "no mesh": (with_fault(Panel, "mesh", lambda *_: None), "forms", r"^mesh\(\) must return the visible surface"),
    "form": (with_fault(Panel, "hit", lambda s, *_: s.pdf), "forms", r"must return a LightSample of .*; got ndarray"),
    "delta": (
        with_fault(PointLight, "sample", lambda s, *_: replace(s, distance=s.distance * np.nan), *POINT),
        "forms",
        r"^Mine.sample: distance must be finite and not negative; got nan",
    ),
    "falloff of 1 / d": (
        with_fault(PointLight, "sample", lambda s, *_: replace(s, radiance=s.radiance * s.distance), *POINT),
        "fall off",
        r"^sample: radiance is 2 times as large at half the distance",
    ),
    "renders": (with_fault(HalfSky, "hit", scaled), "renders", "sample or hit: BRDF samples need hit alone"),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_each_fault_is_found(fault: str) -> None:
    light, check, message = FAULTS[fault]
    found = [outcome for outcome in check_light(light) if not outcome.passed]
    texts = [outcome.message for outcome in found if check in outcome.name]
    assert any(re.search(message, text) for text in texts), [f"{o.name}: {o.message}" for o in found]


RIGHT = [
    Panel(),
    HalfSky(),
    PointLight(*POINT),
    dmis.SpotLight((30, 0, 9), (0, 0, -1), (1, 1, 1)),
    dmis.DistantLight((0, 1, 1), (1, 1, 1)),
]


@pytest.mark.parametrize("light", RIGHT, ids=lambda light: type(light).__name__)
def test_right_lights_pass(light: Any) -> None:
    require(check_light(light))
