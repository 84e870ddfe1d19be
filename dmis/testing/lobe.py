"""Checks of a lobe: `sample` against `pdf`, energy, reciprocity, finite values, and renders.

All are made for a point at the origin with normal +z that is seen from some angles. Of a lobe that transmits, the
directions are those below, and both sides of the surface are tried.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from dmis.base.vectors import Array, dot, normalise
from dmis.brdf.cosines import Directions
from dmis.brdf.lobe import Lobe, checked_lobe
from dmis.brdf.materials import Material
from dmis.scene.probe import check_lobe_form, surface
from dmis.scene.shading_points import ShadingPoints
from dmis.testing.density import QUADRATURE, DensityView
from dmis.testing.density_checks import CORNERS, COUNT, GRAZING, check_unit, view_checks
from dmis.testing.outcome import Check, Fault, Outcome, run_checks
from dmis.testing.scenes import ABOVE, BELOW, TECHNIQUES_ALONE, TURNED, UNIFORM_SKY, box_scene, compare_means
from dmis.testing.sphere import polar, uniforms
from dmis.testing.statistics import level, z_limit

ANGLES = (0.0, 35.0, 70.0, 85.0)
"""Angles between the normal and wo, in degrees."""
LEVEL = level(36)
"""Of each test: chi-square, integral and furnace at four angles from two sides, and renders on two floors."""
_RECIPROCITY = 0.02
"""Relative difference of two values of a lobe that is allowed, because exponents amplify roundings."""
_ALBEDO = 0.02
"""The same of the albedo."""


def check_lobe(lobe: Lobe, name: str = "", albedo: Sequence[float] = ()) -> list[Outcome]:
    """Check a lobe that is not a Dirac delta, or one that is, by what `Lobe` and `DeltaLobe` promise.

    Parameters
    ----------
    lobe
        Its colours at most 1, so that it must not reflect more light than arrives.
    name
        For messages. Default: that of the class.
    albedo
        The largest channel of the albedo that it must have: one number, or one for each of `ANGLES`. Default: any of
        at most 1.

    Returns
    -------
    list of Outcome
        One for each check. A right lobe fails any of them with a probability of 1e-4; a pdf that is 7 % off fails.
    """

    def prepare() -> list[Check]:
        material = Material((lobe,))
        check_lobe_form(lobe)
        material = Material((checked_lobe(lobe, always=True),))
        if lobe.delta and albedo:
            raise Fault("a Dirac delta has no albedo that is checked")
        if lobe.delta:
            return [("scatter: directions and factors", lambda: _check_scatter(material))]
        places = [(k, outside) for outside in (True, False)[: 1 + lobe.has_sides()] for k in ANGLES]
        views = [_view(material, k, outside, uniforms(COUNT, round(k) + 90 * outside)) for k, outside in places]
        corners = [_view(material, degrees, True, CORNERS[:2]) for degrees in GRAZING]
        check_unit("sample", views[0].wi, views[0].place)
        eta2 = [lobe.eta_scale() ** (2 if outside else -2) for _, outside in places]
        return [
            *view_checks(views, corners, LEVEL, "eval cos"),
            *([("albedo is as expected", lambda: _check_albedo(views, albedo))] if albedo else []),
            ("eval reflects no more than arrives (energy)", lambda: _check_energy(views, eta2)),
            ("eval is reciprocal", lambda: _check_reciprocity(material)),
            ("weight is eval cos / pdf", lambda: _check_weight(material, views)),
            ("renders by fixed:0, fixed:1 and balance agree", lambda: _check_renders(material)),
            ("renders agree where shading normals turn", lambda: _check_turned(material)),
        ]

    return run_checks(name or type(lobe).__name__, "forms of what its methods return", prepare)


def _points(material: Material, degrees: float, count: int, outside: bool = True) -> ShadingPoints:
    """Return points seen from an angle, on the side of the lobe."""
    points = surface(material, polar(degrees) * [1, 1, degrees < 90], count, outside=outside)
    return points.beyond() if material.lobes[0].transmissive else points


def _view(material: Material, degrees: float, outside: bool, u: Array) -> DensityView:
    """Return the lobe seen from an angle, sampled by the uniform numbers `u` ``(2, N)``."""

    def pdf(w: Array) -> Array:
        points = _points(material, degrees, w.shape[1], outside)
        return points.pdf(Directions(points, w))

    def value(w: Array) -> Array:
        points = _points(material, degrees, w.shape[1], outside)
        directions = Directions(points, w)
        return np.broadcast_to(points.eval(directions) * (directions.cos_i * directions.above), w.shape)

    points = _points(material, degrees, u.shape[1], outside)
    wi = points.sample(u)
    accepted = Directions(points, wi).above
    if material.lobes[0].transmissive:  # it may refuse directions
        accepted = accepted & (pdf(wi) > 0)
    return DensityView(wi, pdf, accepted, f"wo at {degrees:g}°{'' if outside else ' inside'}", value)


def _check_albedo(views: Sequence[DensityView], albedo: Sequence[float]) -> str:
    """Raise a Fault unless the albedo is the expected one, of one number or one for each of `ANGLES`."""
    for k, view in enumerate(views):
        expected = albedo[k % len(ANGLES) % len(albedo)]
        exact = view.finer().integral
        if not abs(exact.value.max() - expected) <= _ALBEDO * expected + exact.error.max():
            raise Fault(f"the albedo must be {expected:g}, but eval reflects {exact.value.max():.4f} ({view.place})")
    return f"within {_ALBEDO:.0%}"


def _check_energy(views: Sequence[DensityView], eta2: Sequence[float]) -> str:
    """Raise a Fault if the lobe reflects more light than arrives; radiance is divided by squared indices `eta2`."""
    shares = [view.integral.value.max() * factor for view, factor in zip(views, eta2, strict=True)]
    k = int(np.argmax(shares))
    for view in (views[k], views[k].finer()):
        share = view.integral.value * eta2[k]
        if (share <= 1 + 2 * QUADRATURE + 3 * view.integral.error).all():
            return f"at most {share.max():.3f} of the light ({view.place}); nothing else bounds the scale of eval"
    raise Fault(
        f"eval reflects {share.max():.4f} of the light that arrives ({view.place}); at most 1 is allowed with colours "
        f"of at most 1. eval must not contain the cosine, and is 1 / pi for a white diffuse lobe"
    )


def _check_reciprocity(material: Material) -> str:
    """Raise a Fault if f(wo, wi) differs from f(wi, wo), with radiance per squared index where light is refracted."""
    lobe, count = material.lobes[0], 2048
    transmits = lobe.transmissive
    a = normalise(np.random.default_rng(3).normal(size=(3, count)).astype(np.float32))
    a[2] = np.abs(a[2]) + np.float32(0.05)
    a = normalise(a)
    there = _moved(material, a, True, transmits)
    b = normalise(np.random.default_rng(4).normal(size=(3, count)).astype(np.float32))
    b[2] = np.abs(b[2]) * (-1 if transmits else 1)
    half = count // 2
    b[:, half:] = there.sample(uniforms(count))[:, half:]  # where the lobe is
    ok = (np.abs(b[2]) > 0.02) & ((b[2] < 0) == transmits)
    b[:, ~ok] = [[0], [0], [-1 if transmits else 1]]
    back = _moved(material, b, not transmits, transmits)
    one = np.broadcast_to(there.eval(Directions(there, b)), b.shape) * np.float32(lobe.eta_scale() ** 2)
    other = np.broadcast_to(back.eval(Directions(back, a)), a.shape)
    larger = np.maximum(one, other)
    difference = np.where(ok, np.abs(one - other) / np.maximum(larger, 1e-5 * larger[:, ok].max() + 1e-20), 0)
    wrong = (difference > _RECIPROCITY).any(axis=0)
    if wrong.sum() > 0.02 * ok.sum():
        k = int(difference.max(axis=0).argmax())
        raise Fault(
            f"eval is not reciprocal in {wrong.sum() / ok.sum():.0%} of the pairs: f(wo, wi) = {one[:, k].max():.4g}, "
            f"f(wi, wo) = {other[:, k].max():.4g} for wo = {_text(a[:, k])}, wi = {_text(b[:, k])}. cos_i must not be "
            f"a factor of eval: the estimator multiplies by it"
        )
    return f"{ok.sum()} pairs of directions, within {_RECIPROCITY:.0%}"


def _moved(material: Material, wo: Array, outside: bool, transmits: bool) -> ShadingPoints:
    """Return points seen from the directions `wo` ``(3, N)``, on the side of the lobe."""
    points = surface(material, (0, 0, 1), wo.shape[1], (0, 0, 1 if outside or not transmits else -1), outside=outside)
    points.wo, points.cos_o = wo, dot(points.n, wo)
    return points.beyond() if transmits else points


def _check_weight(material: Material, views: Sequence[DensityView]) -> str:
    """Raise a Fault if `weight` returns something else than f cos / pdf."""
    if (weight := _points(material, 35.0, COUNT).reflection[0].weight()) is None:
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
    """Raise a Fault if light sampling, BRDF sampling and both have different means."""
    advice = "sample or pdf: light samples need eval alone, and the others disagree with them"
    return compare_means(box_scene(material, (ABOVE, BELOW)), TECHNIQUES_ALONE, z_limit(LEVEL), advice)


def _check_turned(material: Material) -> str:
    """Raise a Fault if they have different means on a floor whose shading normals leave its own."""
    advice = "sample or pdf: they must be about the shading normal n; where wi may be, the estimator decides"
    return compare_means(box_scene(material, (UNIFORM_SKY,), floor=TURNED), TECHNIQUES_ALONE, z_limit(LEVEL), advice)


def _check_scatter(material: Material) -> str:
    """Raise a Fault if directions or factors are wrong from any side and angle."""
    largest = 0.0
    for outside in (True, False):
        for degrees in (*ANGLES, *GRAZING[1:]):
            points = surface(material, polar(degrees) * [1, 1, degrees < 90], 4, outside=outside)
            wi, factor = points.delta[0].scatter(points)
            largest = max(largest, _check_scattered(points, wi, factor, f"wo at {degrees:g}°"))
    return f"factors of at most {largest:.3f}"


def _check_scattered(points: ShadingPoints, wi: Array, factor: Array, place: str) -> float:
    """Return the largest share of light; raise a Fault if directions or factors are wrong."""
    lobe = points.delta[0]
    lit = np.broadcast_to(factor, (3, 4)).any(axis=0)
    check_unit("scatter", wi[:, lit], place)
    cos = dot(points.n, wi)[lit] * (-1 if lobe.transmissive else 1)
    if (cos < -1e-4).any():
        word = "transmissive = True, but wi is on wo's side" if lobe.transmissive else "wi is below the surface"
        raise Fault(f"scatter: wrong side of the surface: {word} ({place})")
    eta = lobe.eta_scale() if points.outside.all() else 1 / lobe.eta_scale()
    if (share := float(np.max(factor) * eta**2)) > 1 + 1e-4:
        raise Fault(f"scatter returns a factor of {share:.4f} of the light ({place}); at most 1 is allowed")
    return share


def _text(w: Array) -> str:
    return f"({', '.join(f'{x:.6g}' for x in w.tolist())})"
