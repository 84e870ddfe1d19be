"""Checks of a lobe: `sample` against `pdf`, energy, reciprocity, finite values, and renders.

All are made for a point at the origin with normal +z that is seen from some angles. Of a lobe that transmits, the
directions are those below, and both sides of the surface are tried.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from dmis.base.vectors import Array, dot, normalise
from dmis.brdf.cosines import Directions
from dmis.brdf.lobe import Lobe
from dmis.brdf.materials import Material
from dmis.scene.shading_points import ShadingPoints
from dmis.testing.chi_square import QUADRATURE
from dmis.testing.delta_lobe import check_delta_lobe
from dmis.testing.density import check_chi_square, check_mass
from dmis.testing.lobe_view import COUNT, LobeView
from dmis.testing.outcome import Fault, Outcome, run_checks
from dmis.testing.scenes import ABOVE, BELOW, box_scene, compare_means, surface
from dmis.testing.sphere import columns, polar, uniforms
from dmis.testing.statistics import level, z_limit

ANGLES = (0.0, 35.0, 70.0, 85.0)
"""Angles between the normal and wo, in degrees."""
GRAZING = (0.0, 89.9, 89.9999, 90.0)
"""The same, of the check of finite values."""
LEVEL = level(32)
"""Of each test: chi-square, integral and furnace at four angles from two sides, and renders."""
LIMIT = z_limit(LEVEL)
CORNERS = np.array([[0, 0, 1, 1, 0.5, 0.5], [0, 1, 0, 1, 0, 1]], np.float32) * np.float32(1 - 2**-24)
"""Smallest and largest uniform numbers, ``(2, 6)``."""
_EVEN = 4096
"""Directions all over a side of the surface."""
_RECIPROCITY = 0.02
"""Relative difference of two values of a lobe that is allowed, because exponents amplify roundings."""


def check_lobe(lobe: Lobe, name: str = "") -> list[Outcome]:
    """Check a lobe that is not a Dirac delta, or one that is, by what `Lobe` and `DeltaLobe` promise.

    Parameters
    ----------
    lobe
        Its colours at most 1, so that it must not reflect more light than arrives.
    name
        For messages. Default: that of the class.

    Returns
    -------
    list of Outcome
        One for each check. A right lobe fails any of them with a probability of 1e-4; a pdf that is 7 % off fails.

    Raises
    ------
    ValueError
        If it is no lobe, or lacks a method.
    """
    material = Material((lobe,))
    name = name or type(lobe).__name__
    if lobe.delta:
        return check_delta_lobe(material, name)
    form = run_checks(name, [("forms of what eval, pdf and sample return", lambda: _check_form(material))])
    if not form[0].passed:
        return form
    views = [
        LobeView(material, degrees, outside)
        for outside in ((True, False) if lobe.has_sides() else (True,))
        for degrees in ANGLES
    ]

    def at_all(check: Callable[[LobeView], None], success: str) -> Callable[[], str]:
        def run() -> str:
            for view in views:
                check(view)
            return success

        return run

    checks: list[tuple[str, Callable[[], Outcome | str]]] = [
        ("values are finite and not negative", lambda: _check_finite(material)),
        ("sample and pdf are on one side", at_all(_check_side, "directions are on the side of the lobe")),
        ("pdf integrates to its accepted mass", lambda: check_mass(views, LEVEL)),
        ("sample follows pdf (chi-square)", lambda: check_chi_square(views, LEVEL)),
        ("samples reflect the integral of eval (furnace)", lambda: _check_furnace(views)),
        ("eval reflects no more than arrives (energy)", lambda: _check_energy(views)),
        ("eval is reciprocal", lambda: _check_reciprocity(material)),
        ("weight is eval cos / pdf", at_all(_check_weight, "as computed, or there is none")),
        ("renders by fixed:0, fixed:1 and balance agree", lambda: _check_renders(material)),
    ]
    return form + run_checks(name, checks)


def _check_form(material: Material) -> str:
    """Return a message if shapes are right; raise a Fault that names the function whose are not."""
    view = LobeView(material, 35.0)
    for count in (1, 5):
        points = view.points(count)
        wi = np.asarray(points.sample(uniforms(count)))
        if wi.shape != (3, count):
            raise Fault(f"sample must return directions (3, N); got shape {wi.shape} for N = {count}")
        length = np.sqrt(dot(wi, wi))
        if not np.abs(length - 1).max() < 1e-4:
            raise Fault(
                f"sample must return unit directions; got a length of {length[np.abs(length - 1).argmax()]:.6g}"
            )
        directions = Directions(points, wi)
        if (shape := np.shape(points.pdf(directions))) != (count,):
            raise Fault(f"pdf must return densities (N,); got shape {shape} for N = {count}")
        if (shape := np.shape(points.eval(directions))) not in ((1, count), (3, 1), (3, count), (1, 1)):
            raise Fault(f"eval must return values (1, N), (3, 1) or (3, N); got shape {shape} for N = {count}")
    return "shapes are right, directions are unit vectors"


def _check_finite(material: Material) -> str:
    """Raise a Fault if a value is not finite or is negative, at grazing and special directions."""
    for degrees in GRAZING:
        wo = polar(degrees) * [1, 1, degrees < 90]
        special = [wo, wo * [-1, -1, 1], -wo, wo * [1, 1, -1], (0, 0, 1), (0, 0, -1), (1, 0, 0), (-1, 0, 0)]
        special += [polar(89.99999, 205.0), polar(90.00001, 205.0)]
        points = surface(material, wo, CORNERS.shape[1])
        sampled = _side(points).sample(CORNERS)
        if not np.isfinite(sampled).all():
            k = np.flatnonzero(~np.isfinite(sampled).all(axis=0))[0]
            raise Fault(f"sample returns {sampled[:, k]} for wo at {degrees:g}°, u = {CORNERS[:, k].tolist()}")
        wi = np.concatenate([*(columns(w) for w in special), sampled.astype(np.float32)], axis=1)
        points = _side(surface(material, wo, wi.shape[1]))
        directions = Directions(points, wi)
        for function, values in (("eval", points.eval(directions)), ("pdf", points.pdf(directions))):
            values = np.broadcast_to(values, (3, wi.shape[1]))
            if (wrong := ~(np.isfinite(values) & (values >= 0)).all(axis=0)).any():
                k = np.flatnonzero(wrong)[0]
                raise Fault(
                    f"{function} is {values[:, k].min():g} for wo at {degrees:g}° and wi = {_text(wi[:, k])}; it must "
                    f"be finite and not negative"
                )
    return f"wo at {', '.join(f'{degrees:g}°' for degrees in GRAZING)}"


def _side(points: ShadingPoints) -> ShadingPoints:
    """Return the points on the side of their only lobe."""
    return points if points.reflection else points.beyond()


def _check_side(view: LobeView) -> None:
    """Raise a Fault if samples, or the density, are on the other side of the surface."""
    points = view.points(_EVEN)
    wi = normalise(np.random.default_rng(5).normal(size=(3, _EVEN)).astype(np.float32))
    wi[2] = -points.n[2] * (np.abs(wi[2]) + np.float32(1e-3))
    directions = Directions(points, normalise(wi))
    side = "below" if view.reflects else "above"
    if (pdf := points.pdf(directions)).any():
        raise Fault(f"pdf is up to {pdf.max():.3g} {side} the surface, where it must be 0 ({view.place})")
    if not Directions(view.points(COUNT), view.wi).above.any() and view.degrees == 0 and view.outside:
        raise Fault(f"sample: all directions are {side} the surface, the wrong side ({view.place})")


def _check_furnace(views: list[LobeView]) -> str:
    """Raise a Fault if the samples, weighted by f cos / pdf, do not reflect the integral of f cos."""
    for view in views:
        points = view.points(COUNT)
        directions = Directions(points, view.wi)
        pdf = points.pdf(directions).astype(float)
        f = np.broadcast_to(points.eval(directions), view.wi.shape).astype(float)
        ok = directions.above & (pdf > 0)
        estimate = np.divide(f * directions.cos_i, pdf, out=np.zeros_like(f), where=ok).mean(axis=1)
        for fine in (False, True):
            reflected = view.reflected(fine)
            albedo, error = reflected.albedo, reflected.error
            deviation = np.sqrt(max(reflected.square - albedo.max() ** 2, 0) / COUNT)
            allowed = LIMIT * deviation + 3 * error + 2e-3 * np.maximum(albedo, 1e-3)
            missed = reflected.missed > (2e-3 + error).max()
            if not missed and (np.abs(estimate - albedo) <= allowed).all():
                break
        else:
            if missed:
                raise Fault(
                    f"pdf is 0 where eval reflects {reflected.missed:.4f} of the light ({view.place}): BRDF sampling "
                    f"loses it"
                )
            k = np.abs(estimate - albedo).argmax()
            raise Fault(
                f"sample and pdf reflect {estimate[k]:.4f} of the light (mean of eval cos / pdf), eval {albedo[k]:.4f} "
                f"(its integral), with a standard error of {deviation:.1g} ({view.place})",
                view.figure(),
            )
    return f"albedo {', '.join(f'{view.reflected().albedo.max():.3f}' for view in views)}"


def _check_energy(views: list[LobeView]) -> str:
    """Raise a Fault if the lobe reflects more light than arrives."""
    worst = max(views, key=lambda view: view.reflected().albedo.max() * view.eta2)
    for fine in (False, True):
        reflected = worst.reflected(fine)
        share = reflected.albedo * worst.eta2
        if (share <= 1 + 2 * QUADRATURE + 3 * reflected.error).all():
            return f"at most {share.max():.3f} of the light ({worst.place}); nothing else bounds the scale of eval"
    raise Fault(
        f"eval reflects {share.max():.4f} of the light that arrives ({worst.place}); at most 1 is allowed with colours "
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
    back = _moved(material, b, not transmits, transmits)
    one = np.broadcast_to(there.eval(Directions(there, b)), b.shape) * np.float32(lobe.eta_scale() ** 2)
    other = np.broadcast_to(back.eval(Directions(back, a)), a.shape)
    larger = np.maximum(one, other)
    difference = np.where(ok, np.abs(one - other) / np.maximum(larger, 1e-5 * larger[:, ok].max() + 1e-20), 0)
    wrong = (difference > _RECIPROCITY).any(axis=0)
    if wrong.sum() > 0.02 * ok.sum():
        k = int(difference.max(axis=0).argmax())
        # f(wo, wi) cos_o = f(wi, wo) cos_i if f is a reciprocal function times cos_i
        sides = one * np.abs(a[2]), other * np.abs(b[2])
        cosine = np.isclose(*sides, rtol=2 * _RECIPROCITY, atol=1e-5 * sides[0].max()).all(axis=0)
        advice = ". Is cos_i a factor of eval? The estimator multiplies by it" if cosine[ok].mean() > 0.98 else ""
        raise Fault(
            f"eval is not reciprocal in {wrong.sum() / ok.sum():.0%} of the pairs: f(wo, wi) = {one[:, k].max():.4g}, "
            f"f(wi, wo) = {other[:, k].max():.4g} for wo = {_text(a[:, k])}, wi = {_text(b[:, k])}{advice}"
        )
    return f"{ok.sum()} pairs of directions, within {_RECIPROCITY:.0%}"


def _moved(material: Material, wo: Array, outside: bool, transmits: bool) -> ShadingPoints:
    """Return points seen from the directions `wo` ``(3, N)``, on the side of the lobe."""
    points = surface(material, (0, 0, 1), wo.shape[1], (0, 0, 1 if outside or not transmits else -1), outside=outside)
    points.wo, points.cos_o = wo, dot(points.n, wo)
    return points.beyond() if transmits else points


def _check_weight(view: LobeView) -> None:
    """Raise a Fault if `weight` returns something else than f cos / pdf."""
    points = view.points(COUNT)
    if (weight := points.reflection[0].weight()) is None:
        return
    directions = Directions(points, view.wi)
    pdf = points.pdf(directions)
    ok = directions.above & (pdf > 1e-3)
    value = np.broadcast_to(points.eval(directions) * directions.cos_i, view.wi.shape)[:, ok] / pdf[ok]
    given = np.broadcast_to(weight, view.wi.shape)[:, ok]
    if not np.allclose(value, given, rtol=1e-3):
        k = np.unravel_index(np.abs(value - given).argmax(), value.shape)
        raise Fault(f"weight returns {given[k]:.4g}, eval cos / pdf is {value[k]:.4g} ({view.place})")


def _check_renders(material: Material) -> str:
    """Raise a Fault if light sampling, BRDF sampling and both have different means."""
    rules = (("light samples (fixed:1)", "fixed:1"), ("BRDF samples (fixed:0)", "fixed:0"), ("both", "balance"))
    return compare_means(
        box_scene(material, (ABOVE, BELOW)),
        rules,
        LIMIT,
        lambda name: "sample or pdf: light samples need eval alone, and the others disagree with them",
    )


def _text(w: Array) -> str:
    return f"({', '.join(f'{x:.6g}' for x in w.tolist())})"
