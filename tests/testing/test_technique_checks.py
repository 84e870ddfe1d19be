"""`check_technique`: it finds each planted fault, and right techniques pass."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from helpers import assert_found

import dmis
from dmis.base.vectors import Array, normalise
from dmis.estimator.mis import TECHNIQUES
from dmis.light.light_sample import LightSample
from dmis.samplers.warp import INV_PI, square_to_sphere
from dmis.testing.outcome import require
from dmis.testing.technique_checks import check_technique


def sample(surface: Any, light: Any, u: Array) -> LightSample:
    return light.hit(surface.p, normalise(surface.n + square_to_sphere(u)))


def pdf(surface: Any, directions: Any, light_pdf: Array) -> Array:
    return np.maximum(directions.cos_i_signed, 0) * INV_PI


def behind(surface: Any, light: Any, u: Array) -> LightSample:
    return light.hit(surface.p, normalise(square_to_sphere(u) - surface.n))


def elsewhere(surface: Any, light: Any, u: Array) -> LightSample:
    """What another direction meets of the light."""
    wi = sample(surface, light, u).wi
    met = light.hit(surface.p, np.ascontiguousarray(wi[:, ::-1]))
    return LightSample(wi, np.broadcast_to(met.distance, len(u[0])), met.radiance_at(None), met.pdf, met.emits)


COSINE = dmis.Technique("cosine", "cosine", sample, pdf)
PDF, MASS = "follows pdf", "^pdf is not the density of sample: it integrates to "
RENDERS = "sample or pdf of cosine: light and BRDF samples alone have another mean"
FAULTS: dict[str, tuple[dict[str, Any], str, str]] = {
    "pdf 7 % too large": ({"pdf": lambda s, d, p: pdf(s, d, p) * np.float32(1.07)}, PDF, MASS + r"1\.070"),
    "pdf without cosine": ({"pdf": lambda s, d, p: d.above * INV_PI}, PDF, MASS + r"2\.00"),
    "pdf of other samples": ({"pdf": lambda s, d, p: d.above / np.float32(2 * np.pi)}, PDF, MASS + r"1\.00"),
    "sample on the wrong side": ({"sample": behind}, PDF, r" 0\.0000 of the directions of sample"),
    "light samples of other directions": ({"sample": elsewhere}, "accepts", "sample must return light.hit"),
    "numbers": ({"numbers": 7}, "accepts", r"^numbers of technique cosine must be .* from 2 to 4; got 7"),
    "renders": ({"pdf": lambda s, d, p: d.above * INV_PI, "exact": False}, "renders", RENDERS),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_each_fault_is_found(fault: str) -> None:
    changes, check, message = FAULTS[fault]
    before = dict(TECHNIQUES)
    assert_found(check_technique(replace(COSINE, **changes)), check, message)
    assert before == TECHNIQUES


@pytest.mark.parametrize("technique", [COSINE, *TECHNIQUES.values()], ids=lambda technique: technique.name)
def test_right_techniques_pass(technique: dmis.Technique) -> None:
    require(check_technique(technique))


def test_places_have_samples_of_their_own() -> None:
    """Chi-square in four places is four tests: no p value is there twice."""
    (outcome,) = [outcome for outcome in check_technique(TECHNIQUES["uniform"]) if PDF in outcome.name]
    values = outcome.message.removeprefix("p = ").split(", ")
    assert len(values) == len(set(values)) == 4
