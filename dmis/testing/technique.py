"""Checks of a sampling technique: `sample` against `pdf`, its light samples, and renders in which it takes part."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np

from dmis.base.vectors import Array
from dmis.brdf.cosines import Directions
from dmis.brdf.materials import matte, plastic
from dmis.estimator.technique import TECHNIQUES, Technique, check_technique_form, checked_technique, register_technique
from dmis.fit.fixed import Fixed
from dmis.geometry.mesh import Mesh
from dmis.light.area import QuadLight
from dmis.light.environment import EnvironmentLight
from dmis.light.light import SampledLight
from dmis.light.light_sample import LightSample
from dmis.scene.probe import surface
from dmis.testing.density import DensityView
from dmis.testing.density_checks import CORNERS, COUNT, view_checks
from dmis.testing.outcome import Check, Outcome, run_checks
from dmis.testing.scenes import ABOVE, FLOOR, TURNED, box_scene, compare_means
from dmis.testing.sphere import polar, uniforms
from dmis.testing.statistics import level, z_limit

LEVEL = level(20)
"""Of each test: chi-square and integral in four places, and renders on two floors."""
_SKY = EnvironmentLight(0.2 + np.random.default_rng(8).random((8, 16, 3)))
_TILTED = QuadLight((0.4, -0.6, 1.2), (0.3, 1.2, 0.2), (1.0, 0.2, -0.3), (5.0, 4.0, 3.0))
_DIFFUSE, _GLOSSY = matte(0.6), plastic(0.4, 0.4, 0.05)
_PLACES: tuple[tuple[SampledLight, str, float, bool], ...] = (
    (ABOVE, "under a lamp", 35.0, False),
    (_TILTED, "beside a lamp", 60.0, True),
    (_SKY, "under a sky", 20.0, False),
    (_SKY, "under a sky", 75.0, True),
)
"""Light, its name, angle of wo in degrees, and whether the surface is glossy."""


def check_technique(technique: Technique) -> list[Outcome]:
    """Check a sampling technique by what `Technique` promises.

    Its pdf is compared with its samples if it is `Technique.exact`. One that is not registered is, for the renders.

    Returns
    -------
    list of Outcome
        One for each check. A right technique fails any of them with a probability of 1e-4; a pdf that is 7 % off fails.
    """

    def prepare() -> list[Check]:
        check_technique_form(technique)
        numbers = [uniforms(COUNT, round(place[2]), technique.numbers) for place in _PLACES]
        guarded = checked_technique(technique)
        views = [_view(guarded, *place, u) for place, u in zip(_PLACES, numbers, strict=True)]
        corners = [
            _view(guarded, light, lit_by, degrees, glossy, CORNERS[: technique.numbers])
            for light, lit_by, _, glossy in _PLACES
            for degrees in (0.0, 89.99, 90.0)
        ]
        checks = view_checks(views, corners, LEVEL)[: None if technique.exact else 1]
        return [
            *checks,
            ("renders agree with balance", lambda: _check_renders(technique, FLOOR)),
            ("renders agree where shading normals turn", lambda: _check_renders(technique, TURNED)),
        ]

    return run_checks(technique.name, "forms of what its methods return", prepare)


def _view(
    technique: Technique, light: SampledLight, lit_by: str, degrees: float, glossy: bool, u: Array
) -> DensityView:
    """Return the technique at one surface point under one light."""
    material, wo = _GLOSSY if glossy else _DIFFUSE, polar(degrees) * [1, 1, degrees < 90]
    count = u.shape[1]
    sample = technique.sample(surface(material, wo, count), light, u)

    def pdf(w: Array) -> Array:
        points = surface(material, wo, w.shape[1])
        return technique.pdf(points, Directions(points, w), light.hit(points.p, w).pdf)

    def hit(w: Array) -> LightSample:
        return light.hit(np.zeros_like(w), w)

    place = f"{'glossy' if glossy else 'diffuse'} floor {lit_by}, wo at {degrees:g}°"
    return DensityView(sample.wi, pdf, pdf(sample.wi) > 0, place, sample=sample, hit=hit)


def _check_renders(technique: Technique, floor: Mesh) -> str:
    """Raise a Fault if mixtures with the technique have another mean on a floor than light and BRDF samples."""
    name = technique.name
    with registered(technique):
        rules: list[tuple[str, Any]] = [("balance", "balance")]
        for shares in ({"light": 0.5, name: 0.5}, {name: 0.5, "brdf": 0.5}, {"light": 0.2, "brdf": 0.3, name: 0.5}):
            if len(shares) < 2:
                continue  # light or brdf itself
            w = tuple(shares.values())
            text = ",".join(f"{key}={share:g}" for key, share in shares.items())
            rules.append((f"fixed:{text}", Fixed(w if len(w) > 2 else w[0], techniques=tuple(shares))))
        advice = f"sample or pdf of {name}: light and BRDF samples alone have another mean"
        scene = box_scene(_GLOSSY, (ABOVE, _SKY), floor=floor)
        return compare_means(scene, rules, z_limit(LEVEL), advice)


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
