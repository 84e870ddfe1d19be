"""Checks of a sampling technique: `sample` against `pdf`, its light samples, and renders in which it takes part."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from dmis.base.vectors import Array
from dmis.brdf.cosines import Directions
from dmis.brdf.materials import matte, plastic
from dmis.estimator.technique import TECHNIQUES, Technique, register_technique
from dmis.fit.fixed import Fixed
from dmis.light.area import QuadLight
from dmis.light.environment import EnvironmentLight
from dmis.light.light import SampledLight
from dmis.light.light_sample import LightSample
from dmis.scene.shading_points import ShadingPoints
from dmis.testing.chi_square import Density, DensityComparison, compare_directions
from dmis.testing.density import DensityView, check_chi_square, check_mass
from dmis.testing.outcome import Fault, Outcome, run_checks
from dmis.testing.scenes import ABOVE, box_scene, compare_means, surface
from dmis.testing.sphere import polar, uniforms
from dmis.testing.statistics import level, z_limit

COUNT = 2**16
LEVEL = level(16)
"""Of each test: chi-square and integral in four places, and renders."""
LIMIT = z_limit(LEVEL)
_SKY = EnvironmentLight(0.2 + np.random.default_rng(8).random((8, 16, 3)))
_TILTED = QuadLight((0.4, -0.6, 1.2), (0.3, 1.2, 0.2), (1.0, 0.2, -0.3), (5.0, 4.0, 3.0))


@dataclass(frozen=True, eq=False)
class TechniqueView(DensityView):
    """A technique at one surface point under one light."""

    technique: Technique
    light: SampledLight
    lit_by: str
    degrees: float
    glossy: bool

    @property
    def title(self) -> str:  # type: ignore[override]
        """The technique, for figures."""
        return f"technique {self.technique.name}"

    @property
    def place(self) -> str:
        """Surface, light and angle of wo, for messages."""
        return f"{'glossy' if self.glossy else 'diffuse'} floor {self.lit_by}, wo at {self.degrees:g}°"

    @property
    def _wo(self) -> Array:
        return polar(self.degrees) * [1, 1, self.degrees < 90]

    def points(self, count: int) -> ShadingPoints:
        """Return `count` surface points."""
        return surface(plastic(0.4, 0.4, 0.05) if self.glossy else matte(0.6), self._wo, count)

    @cached_property
    def sample(self) -> LightSample:
        """Light samples, ``COUNT``, independent of those in other places."""
        u = uniforms(COUNT, round(self.degrees), self.technique.numbers)
        return self.technique.sample(self.points(COUNT), self.light, u)

    def pdf(self, w: Array) -> Array:
        """Return the pdf of directions ``(3, M)``."""
        points = self.points(w.shape[1])
        return np.asarray(self.technique.pdf(points, Directions(points, w), self.light.hit(points.p, w).pdf))

    def laws(self) -> dict[str, Density]:
        """Return the cosine, and the density of light samples."""

        def cosine(w: Array) -> Array:
            return np.maximum(Directions(self.points(w.shape[1]), w).cos_i_signed, 0).astype(float)

        def light(w: Array) -> Array:
            return np.asarray(self.light.hit(self.points(w.shape[1]).p, w).pdf, float)

        return {"the cosine": cosine, "the density of light samples": light}

    @cached_property
    def comparison(self) -> DensityComparison:
        """Samples against pdf; a direction is accepted where its own pdf is not 0."""
        w = self.sample.wi
        return compare_directions(w, self.pdf, accepted=self.pdf(w) > 0)


def check_technique(technique: Technique) -> list[Outcome]:
    """Check a sampling technique by what `Technique` promises.

    Its pdf is compared with its samples if it is `Technique.exact`. One that is not registered is, for the renders.

    Returns
    -------
    list of Outcome
        One for each check. A right technique fails any of them with a probability of 1e-4; a pdf that is 7 % off fails.
    """
    name = technique.name
    views = [
        TechniqueView(technique, ABOVE, "under a lamp", 35.0, False),
        TechniqueView(technique, _TILTED, "beside a lamp", 60.0, True),
        TechniqueView(technique, _SKY, "under a sky", 20.0, False),
        TechniqueView(technique, _SKY, "under a sky", 75.0, True),
    ]
    form = run_checks(name, [("forms of what sample and pdf return", lambda: _check_form(views))])
    if not form[0].passed:
        return form
    checks: list[tuple[str, Callable[[], Outcome | str]]] = [
        ("values are finite and not negative", lambda: _check_finite(views)),
    ]
    if technique.exact:
        checks += [
            ("light samples are those of the light's hit", lambda: _check_light_samples(views)),
            ("pdf integrates to its accepted mass", lambda: check_mass(views, LEVEL)),
            ("sample follows pdf (chi-square)", lambda: check_chi_square(views, LEVEL)),
        ]
    return form + run_checks(name, [*checks, ("renders agree with balance", lambda: _check_renders(technique))])


def _check_form(views: list[TechniqueView]) -> str:
    """Return a message if shapes are right; raise a Fault that names the function whose are not."""
    technique = views[0].technique
    if not 2 <= technique.numbers <= 4:
        raise Fault(f"numbers must be 2 to 4, the uniform numbers of a sample; got {technique.numbers}")
    for view in views:
        points = view.points(5)
        sample = technique.sample(points, view.light, uniforms(5, 1, technique.numbers))
        if not isinstance(sample, LightSample):
            raise Fault(
                f"sample must return a LightSample, such as light.hit(surface.p, wi); got {type(sample).__name__}"
            )
        if sample.wi.shape != (3, 5):
            raise Fault(f"sample must return directions wi (3, N); got shape {sample.wi.shape} for N = 5")
        pdf = technique.pdf(points, Directions(points, sample.wi), view.light.hit(points.p, sample.wi).pdf)
        if np.shape(pdf) != (5,):
            raise Fault(f"pdf must return densities (N,); got shape {np.shape(pdf)} for N = 5")
    return "shapes are right"


def _check_finite(views: list[TechniqueView]) -> str:
    """Raise a Fault if a direction or a density is not finite, or a density is negative."""
    edge = np.float32(1 - 2**-24)
    technique = views[0].technique
    u = np.array([[0, 0, edge, edge], [0, edge, 0, edge], [0, edge, edge, 0], [0, 0, edge, edge]], np.float32)
    for view in views:
        for degrees in (0.0, view.degrees, 89.99, 90.0):
            place = TechniqueView(technique, view.light, view.lit_by, degrees, view.glossy)
            w = technique.sample(place.points(4), view.light, u[: technique.numbers]).wi
            if not np.isfinite(w).all():
                raise Fault(f"sample returns wi = {w[:, ~np.isfinite(w).all(axis=0)][:, 0]} ({place.place})")
            pdf = place.pdf(w)
            if not (np.isfinite(pdf) & (pdf >= 0)).all():
                raise Fault(f"pdf is {pdf[~(np.isfinite(pdf) & (pdf >= 0))][0]:g} ({place.place})")
            length = np.linalg.norm(w[:, pdf > 0], axis=0)
            if len(length) and np.abs(length - 1).max() > 1e-4:
                raise Fault(
                    f"sample must return unit directions wi; got a length of {length.max():.5g} ({place.place})"
                )
    return f"{len(views)} places"


def _check_light_samples(views: list[TechniqueView]) -> str:
    """Raise a Fault if the light samples of `sample` are not what the light's `hit` says of their directions."""
    for view in views:
        sample = view.sample
        hit = view.light.hit(view.points(COUNT).p, sample.wi)
        if (share := (sample.emits == hit.emits).mean()) < 0.995:
            raise Fault(f"sample: emits is that of light.hit in {share:.1%} of its directions ({view.place})")
        both = sample.emits & hit.emits
        for field in ("distance", "radiance"):
            a, b = (np.broadcast_to(getattr(s, field), (3, COUNT)) for s in (sample, hit))
            close = np.isclose(a, b, rtol=1e-2, atol=1e-3 * np.abs(b).max() if field == "radiance" else 0).all(axis=0)
            if both.any() and close[both].mean() < 0.995:
                k = np.flatnonzero(both & ~close)[0]
                raise Fault(
                    f"sample: {field} is {a[:, k].max():.4g}, that of light.hit {b[:, k].max():.4g} ({view.place}). "
                    f"Return light.hit(surface.p, wi)"
                )
    return f"{len(views)} places"


def _check_renders(technique: Technique) -> str:
    """Raise a Fault if mixtures with the technique have another mean than light and BRDF samples."""
    name = technique.name
    with registered(technique):
        rules: list[tuple[str, Any]] = [("balance", "balance")]
        for shares in ({"light": 0.5, name: 0.5}, {name: 0.5, "brdf": 0.5}, {"light": 0.2, "brdf": 0.3, name: 0.5}):
            if len(shares) < 2:
                continue  # light or brdf itself
            w = tuple(shares.values())
            text = ",".join(f"{key}={share:g}" for key, share in shares.items())
            rules.append((f"simplex:{text}", Fixed(w if len(w) > 2 else w[0], techniques=tuple(shares))))
        return compare_means(
            box_scene(plastic(0.4, 0.4, 0.05), (ABOVE, _SKY)),
            rules,
            LIMIT,
            lambda rule: f"sample or pdf of {name}: light and BRDF samples alone have another mean",
        )


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
