"""Checks of a sampling technique: `sample` against `pdf`, and renders in which it takes part."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np

from dmis.base.vectors import Array
from dmis.brdf.lobe import Directions
from dmis.brdf.materials import Material, matte, plastic
from dmis.estimator.mis import TECHNIQUES, Technique, check_technique_form, register_technique
from dmis.fit.fixed import Fixed
from dmis.light.area import QuadLight
from dmis.light.environment import EnvironmentLight
from dmis.light.light import SampledLight
from dmis.testing.density import COUNT, DensityView, check_pdf
from dmis.testing.outcome import Check, Fault, Outcome, run_checks
from dmis.testing.scenes import ABOVE, TURNED, box_scene, compare_means, surface
from dmis.testing.sphere import polar, uniforms
from dmis.testing.statistics import level

LEVEL = level(7)
"""Of each test: chi-square in four places, and three comparisons of renders."""
_SKY = EnvironmentLight(0.2 + np.random.default_rng(8).random((8, 16, 3)))
_TILTED = QuadLight((0.4, -0.6, 1.2), (0.3, 1.2, 0.2), (1.0, 0.2, -0.3), (5.0, 4.0, 3.0))
_GLOSSY = plastic(0.4, 0.4, 0.05)
_PLACES = ((matte(0.6), ABOVE, 35.0), (_GLOSSY, _TILTED, 60.0), (matte(0.6), _SKY, 20.0), (_GLOSSY, _SKY, 75.0))
"""Material, light, and angle of wo in degrees."""


def check_technique(technique: Technique) -> list[Outcome]:
    """Return the outcomes of the checks of a sampling technique, by what `Technique` promises.

    Its pdf is compared with its samples if it is `Technique.exact`. One that is not registered is, for the renders. A
    right technique fails any check with a probability of 1e-4; a pdf that is 7 % off fails.
    """
    return run_checks(technique.name, _checks(technique))


def _checks(technique: Technique) -> Iterator[Check]:
    """Yield the checks of a technique."""
    check_technique_form(technique)
    views = [_view(technique, *place, uniforms(COUNT, k, technique.numbers)) for k, place in enumerate(_PLACES)]
    if technique.exact:
        yield "sample follows pdf", lambda: check_pdf(views, LEVEL)
    yield "renders agree with balance", lambda: _check_renders(technique)


def _view(technique: Technique, material: Material, light: SampledLight, degrees: float, u: Array) -> DensityView:
    """Return the technique at one surface point under one light, sampled by the uniform numbers `u`."""
    wo = polar(degrees)

    def pdf(w: Array) -> Array:
        points = surface(material, wo, w.shape[1])
        return technique.pdf(points, Directions(points, w), light.hit(points.p, w).pdf)

    points = surface(material, wo, u.shape[1])
    light_sample = technique.sample(points, light, u)
    wi = light_sample.wi
    place = f"{material.name} below {type(light).__name__}, wo at {degrees:g}°"
    same = light_sample.emits == light.hit(points.p, wi).emits
    if same.mean() < 0.995:  # rounding decides at outlines
        raise Fault(f"sample must return light.hit in its directions; emits differs in {1 - same.mean():.0%} ({place})")
    return DensityView(wi, pdf, pdf(wi) > 0, place)


def _check_renders(technique: Technique) -> str:
    """Raise a Fault if mixtures with the technique have another mean than light and BRDF samples."""
    name = technique.name
    mixtures = ({"light": 0.5, name: 0.5}, {name: 0.5, "brdf": 0.5}, {"light": 0.2, "brdf": 0.3, name: 0.5})
    with registered(technique):
        rules: list[tuple[str, Any]] = [("balance", "balance")]
        for shares in mixtures:
            if len(shares) > 1:  # it may be light or brdf itself
                w = tuple(shares.values())
                text = "fixed:" + ",".join(f"{key}={share:g}" for key, share in shares.items())
                rules.append((text, Fixed(w if len(w) > 2 else w[0], techniques=tuple(shares))))
        advice = f"sample or pdf of {name}: light and BRDF samples alone have another mean"
        return compare_means(box_scene(_GLOSSY, (ABOVE, _SKY), floor=TURNED), rules, LEVEL, advice)


@contextmanager
def registered(technique: Technique) -> Iterator[None]:
    """Register a technique within the block, unless it is registered already."""
    known = technique.name in TECHNIQUES
    register_technique(technique)
    try:
        yield
    finally:
        if not known:
            del TECHNIQUES[technique.name]
