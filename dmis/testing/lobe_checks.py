"""Checks of a lobe: `sample` against `pdf` and `eval`, energy, reciprocity, and renders.

All are made for points at the origin with normal +z. Of a lobe that transmits, the directions are those below, and both
sides of the surface are tried.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from dmis.base.plugins import checked
from dmis.base.vectors import Array, dot, normalise
from dmis.brdf.lobe import LOBE_CHECKS, Directions, Lobe
from dmis.brdf.materials import Material
from dmis.scene.shading_points import ShadingPoints
from dmis.testing.density import COUNT, DensityView, Views, check_integral, check_pdf
from dmis.testing.outcome import Check, Fault, Outcome, run_checks
from dmis.testing.scenes import ABOVE, BELOW, TURNED, UNIFORM_SKY, box_scene, compare_techniques, surface
from dmis.testing.sphere import columns, polar, uniforms
from dmis.testing.statistics import level

ANGLES = (0.0, 35.0, 70.0, 85.0)
"""Angles between the normal and wo, in degrees."""
LEVEL = level(18)
"""Of each test: chi-square and integral at four angles from two sides, and two comparisons of renders."""
_TOLERANCE = 0.02
"""Relative difference of two values of a lobe that is allowed, because exponents amplify roundings; and of albedos."""


def check_lobe(lobe: Lobe, name: str = "", albedo: Sequence[float] = ()) -> list[Outcome]:
    """Return the outcomes of the checks of a lobe, by what `Lobe` and `DeltaLobe` promise.

    A right lobe fails any check with a probability of 1e-4; a pdf that is 7 % off fails.

    Parameters
    ----------
    lobe
        Its colours at most 1, so that it must not reflect more light than arrives.
    name
        For messages. Default: that of the class.
    albedo
        The largest channel of the albedo that it must have: one number, or one for each of `ANGLES`. Default: any of
        at most 1.
    """
    return run_checks(name or type(lobe).__name__, _checks(lobe, albedo))


def _checks(lobe: Lobe, albedo: Sequence[float]) -> Iterator[Check]:
    """Yield the checks of a lobe."""
    material = replace(Material((lobe,)), lobes=(checked(lobe, LOBE_CHECKS, always=True),))
    if lobe.delta and albedo:
        raise Fault("a Dirac delta has no albedo that is checked")
    if lobe.delta:
        yield "scatter: directions and factors", lambda: _check_scatter(material)
        return
    places = [(degrees, outside) for outside in (True, False)[: 1 + lobe.has_sides()] for degrees in ANGLES]
    views = [_view(material, *place, uniforms(COUNT, k)) for k, place in enumerate(places)]
    eta2 = [lobe.eta_scale() ** (2 if outside else -2) for _, outside in places]
    yield "sample follows pdf", lambda: check_pdf(views, LEVEL)
    yield "samples have the integral of eval cos", lambda: check_integral(views, LEVEL, "eval cos")
    if albedo:
        yield "albedo is as expected", lambda: _check_albedo(views, albedo)
    yield "eval reflects no more than arrives (energy)", lambda: _check_energy(views, eta2)
    yield "eval is reciprocal", lambda: _check_reciprocity(material)
    yield "weight is eval cos / pdf", lambda: _check_weight(material, views)
    yield "renders by fixed:0, fixed:1 and balance agree", lambda: _check_renders(material)


def _points(material: Material, wo: Array, outside: bool = True, side: float = 1.0) -> ShadingPoints:
    """Return points seen from the directions `wo` ``(3, N)``, with normals (0, 0, side), on the side of the lobe."""
    points = surface(material, (0, 0, 1), wo.shape[1], (0, 0, side), outside=outside)
    points.wo, points.cos_o = wo, dot(points.n, wo)
    return points.beyond() if material.lobes[0].transmissive else points


def _view(material: Material, degrees: float, outside: bool, u: Array) -> DensityView:
    """Return the lobe seen from an angle, sampled by the uniform numbers `u` ``(2, N)``."""

    def at(w: Array) -> tuple[ShadingPoints, Directions]:
        points = _points(material, columns(polar(degrees), w.shape[1]), outside)
        return points, Directions(points, w)

    def pdf(w: Array) -> Array:
        points, directions = at(w)
        return points.pdf(directions)

    def value(w: Array) -> Array:
        points, directions = at(w)
        return np.broadcast_to(points.eval(directions) * (directions.cos_i * directions.above), w.shape)

    wi = _points(material, columns(polar(degrees), u.shape[1]), outside).sample(u)
    accepted = at(wi)[1].above
    if material.lobes[0].transmissive:  # it may refuse directions
        accepted = accepted & (pdf(wi) > 0)
    return DensityView(wi, pdf, accepted, f"wo at {degrees:g}°{'' if outside else ' inside'}", value)


def _check_albedo(views: Views, albedo: Sequence[float]) -> str:
    """Raise a Fault unless the albedo is the expected one, of one number or one for each of `ANGLES`."""
    for k, view in enumerate(views):
        expected, value = albedo[k % len(ANGLES) % len(albedo)], float(view.integral[0].max())
        if not abs(value - expected) <= _TOLERANCE * expected:
            raise Fault(f"the albedo must be {expected:g}, but eval reflects {value:.4f} ({view.place})")
    return f"within {_TOLERANCE:.0%}"


def _check_energy(views: Views, eta2: Sequence[float]) -> str:
    """Raise a Fault if the lobe reflects more light than arrives; radiance is divided by squared indices `eta2`."""
    shares = [float(view.integral[0].max()) * factor for view, factor in zip(views, eta2, strict=True)]
    k = int(np.argmax(shares))
    if not shares[k] <= 1 + 4 * float(views[k].integral[1].max()) * eta2[k]:
        raise Fault(
            f"eval reflects {shares[k]:.4f} of the light that arrives ({views[k].place}); at most 1 is allowed with "
            f"colours of at most 1. eval must not contain the cosine, and is 1 / pi for a white diffuse lobe"
        )
    return f"at most {shares[k]:.3f} of the light ({views[k].place}); nothing else bounds the scale of eval"


def _check_reciprocity(material: Material) -> str:
    """Raise a Fault if f(wo, wi) differs from f(wi, wo), with radiance per squared index where light is refracted."""
    lobe, count = material.lobes[0], 2048
    side = -1 if lobe.transmissive else 1
    wo, wi = map(normalise, np.random.default_rng(3).normal(size=(2, 3, count)).astype(np.float32))
    wo[2] = np.abs(wo[2])
    wi[2] = side * np.abs(wi[2])
    sampled = _points(material, wo).sample(uniforms(count))
    wi = np.where(np.arange(count) % 2, wi, sampled)  # where the lobe is, too
    ok = (wo[2] > 0.05) & (side * wi[2] > 0.02)
    wo, wi = wo[:, ok], wi[:, ok]

    def f(points: ShadingPoints, w: Array) -> Array:
        return np.broadcast_to(points.eval(Directions(points, w)), w.shape)

    one = f(_points(material, wo), wi) * np.float32(lobe.eta_scale() ** 2)
    other = f(_points(material, wi, not lobe.transmissive, side), wo)
    larger = np.maximum(one, other)
    difference = np.abs(one - other) / np.maximum(larger, 1e-5 * larger.max() + 1e-20)
    wrong = (difference > _TOLERANCE).any(axis=0)
    if wrong.mean() > 0.02:
        k = int(difference.max(axis=0).argmax())
        raise Fault(
            f"eval is not reciprocal in {wrong.mean():.0%} of the pairs: f(wo, wi) = {one[:, k].max():.4g}, f(wi, wo) "
            f"= {other[:, k].max():.4g} for wo = {wo[:, k].round(6).tolist()}, wi = {wi[:, k].round(6).tolist()}. "
            f"cos_i must not be a factor of eval: the estimator multiplies by it"
        )
    return f"{wrong.size} pairs of directions, within {_TOLERANCE:.0%}"


def _check_weight(material: Material, views: Views) -> str:
    """Raise a Fault if `weight` returns something else than f cos / pdf."""
    if (weight := _points(material, columns(polar(35.0), COUNT)).reflection[0].weight()) is None:
        return "there is none"
    for view in views:
        assert view.value is not None
        pdf = view.pdf(view.wi)
        ok = view.accepted & (pdf > 1e-3)
        ratio = view.value(view.wi)[:, ok] / pdf[ok]
        if not np.allclose(ratio, np.broadcast_to(weight, view.wi.shape)[:, ok], rtol=1e-3):
            raise Fault(f"weight returns up to {np.max(weight):.4g}, eval cos / pdf {ratio.max():.4g} ({view.place})")
    return "as computed"


def _check_renders(material: Material) -> str:
    """Raise a Fault if light sampling, BRDF sampling and both have different means, with tilted shading normals."""
    scene = box_scene(material, (ABOVE, BELOW, UNIFORM_SKY), floor=TURNED)
    advice = "sample or pdf, which must be about the shading normal n: light samples need eval alone"
    return compare_techniques(scene, LEVEL, advice)


def _check_scatter(material: Material) -> str:
    """Raise a Fault if directions are on the wrong side of the surface, or factors too large, from any angle."""
    lobe, largest = material.lobes[0], 0.0
    side = -1 if lobe.transmissive else 1
    for outside in (True, False):
        for degrees in (*ANGLES, 89.9):
            points = surface(material, polar(degrees), 4, outside=outside)
            wi, factor = points.delta[0].scatter(points)
            if (side * dot(points.n, wi) < -1e-4)[np.broadcast_to(factor, (3, 4)).any(axis=0)].any():
                word = "transmissive = True, but wi is on wo's side" if side < 0 else "wi is below the surface"
                raise Fault(f"scatter: wrong side of the surface: {word} (wo at {degrees:g}°)")
            share = float(np.max(factor) * lobe.eta_scale() ** (2 if outside else -2))
            if share > 1 + 1e-4:
                raise Fault(
                    f"scatter returns a factor of {share:.4f} of the light (wo at {degrees:g}°); at most 1 is allowed"
                )
            largest = max(largest, share)
    return f"factors of at most {largest:.3f}"
