"""The checks that lobes, lights and techniques share: samples against pdf, integral, light samples, finite values."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from dmis.base.vectors import Array, dot
from dmis.testing.density import DensityView, Integral
from dmis.testing.outcome import Check, Fault
from dmis.testing.sphere import polar
from dmis.testing.statistics import z_limit

Views = Sequence[DensityView]
COUNT = 2**16
"""Sampled directions of a view."""
GRAZING = (0.0, 89.9, 89.9999, 90.0)
"""Angles of directions of the checks of finite values, in degrees."""
CORNERS = np.array([[0, 0, 1, 1, 0.5, 0.5], [0, 1, 0, 1, 0, 1], [0, 1, 1, 0, 0, 1], [0, 1, 0, 1, 1, 0]], np.float32)
CORNERS *= np.float32(1 - 2**-24)
"""Smallest and largest uniform numbers, ``(4, 6)``."""


def view_checks(views: Views, corners: Views, level: float, value: str = "", hides_itself: bool = False) -> list[Check]:
    """Return all checks here, for `run_checks`, each test at the significance `level`.

    `views` are places with `COUNT` samples, `corners` those with samples of the uniform numbers `CORNERS`. The name of
    `DensityView.value` in messages is `value`, empty if there is none. About `hides_itself` see `check_hit`.
    """
    checks: list[Check] = [
        ("values are finite and not negative", lambda: check_finite(corners)),
        ("pdf integrates to its accepted mass", lambda: check_mass(views, level)),
        ("sample follows pdf (chi-square)", lambda: check_chi_square(views, level)),
    ]
    if views[0].hit is not None:
        checks.append(("sample and hit agree", lambda: check_hit(views, hides_itself)))
    if value:
        checks.append((f"samples have the integral of {value}", lambda: check_integral(views, level, value)))
    return checks


def check_mass(views: Views, level: float) -> str:
    """Raise a Fault unless each pdf integrates to the share of samples that is accepted; return the integrals."""
    limit = z_limit(level)
    for view in views:
        if not view.mass_agrees(limit) and not (view := view.finer()).mass_agrees(limit):
            text = f"it integrates to {view.mass:.4f}, and {view.share:.4f} of the directions of sample are accepted"
            raise Fault(f"{view.pdf_name} is not the density of sample: {text} ({view.place})")
    return f"integrals {', '.join(f'{view.mass:.3f}' for view in views)}"


def check_chi_square(views: Views, level: float) -> str:
    """Raise a Fault unless the samples follow each pdf; return the p-values."""
    for view in views:
        if view.p <= level and (view := view.finer()).p <= level:
            text = f"p = {view.p:.1g}; {view.pdf_name} integrates to {view.mass:.3f}; {view.worst()}"
            raise Fault(f"sample does not follow {view.pdf_name}: {text} ({view.place})")
    return f"p = {', '.join(f'{view.p:.2g}' for view in views)}"


def check_integral(views: Views, level: float, name: str) -> str:
    """Raise a Fault unless the mean of value / pdf over samples is the integral of `value`; return the integrals."""
    for view in views:
        assert view.value is not None
        pdf = view.pdf(view.wi).astype(float)
        value = view.value(view.wi).astype(float)
        ratio = np.divide(value, pdf, out=np.zeros_like(value), where=view.accepted & (pdf > 0))
        mean, limit = ratio.mean(axis=1), z_limit(level)
        if _difference(mean, view.integral, limit) and (text := _difference(mean, view.finer().integral, limit)):
            raise Fault(f"{text.format(pdf=view.pdf_name, name=name)} ({view.place})")
    return f"integrals {', '.join(f'{view.integral.value.max():.3f}' for view in views)}"


def _difference(mean: Array, exact: Integral, limit: float) -> str:
    """Return how the mean of the samples ``(C,)`` differs from the exact integral; empty if by noise only."""
    largest = exact.value.max()
    deviation = np.sqrt(max(exact.square - largest**2, 0) / COUNT)
    if exact.missed > 2e-3 * largest + exact.error.max():
        return f"{{pdf}} is 0 where {{name}} has {exact.missed / largest:.1%} of its integral: samples never find it"
    if (np.abs(mean - exact.value) <= limit * deviation + 3 * exact.error + 2e-3 * exact.value).all():
        return ""
    k = np.abs(mean - exact.value).argmax()
    return (
        f"the mean of {{name}} / pdf over samples is {mean[k]:.4g}, with a standard error of {deviation:.1g}, but the "
        f"integral of {{name}} is {exact.value[k]:.4g}"
    )


def check_hit(views: Views, hides_itself: bool = False, share: float = 0.995, name: str = "sample") -> str:
    """Raise a Fault if `hit` reports other light samples of the directions than `sample` does.

    They must agree in a `share` of the directions at least, since rounding decides at outlines. If the light
    `hides_itself`, `sample` may pick a point that another one hides. The pdfs are compared where there is a
    `DensityView.value`: that of a technique's light samples is the light's. `name` is that of what returned `sample`.
    """
    for view in views:
        assert view.sample is not None and view.hit is not None
        sample, hit, disagree = view.sample, view.hit(view.wi), f"{name} and hit disagree ({view.place})"
        same = (sample.emits == hit.emits) | (hides_itself & ~sample.emits)
        if same.mean() < share:
            raise Fault(
                f"{disagree}: emits is the same in {same.mean():.1%} of directions; it is True in "
                f"{sample.emits.mean():.1%} by {name}, in {hit.emits.mean():.1%} by hit"
            )
        both = sample.emits & hit.emits
        for field in ("distance", "radiance", "pdf")[: 2 if view.value is None else 3]:
            a, b = (np.broadcast_to(getattr(of, field), view.wi.shape) for of in (sample, hit))
            atol = 1e-3 * np.abs(b).max() if field == "radiance" else 0
            close = np.isclose(a, b, rtol=2e-2 if field == "distance" else 2e-3, atol=atol).all(axis=0)
            if both.any() and close[both].mean() < share:
                k = np.flatnonzero(both & ~close)[0]
                raise Fault(
                    f"{disagree}: {field} is {a[:, k].max():.5g} by {name}, {b[:, k].max():.5g} by hit in "
                    f"{1 - close[both].mean():.0%} of directions"
                )
    return f"{views[0].wi.shape[1]} directions"


def check_finite(views: Views) -> str:
    """Call the functions of the views for their samples and for special directions; what they return is checked then.

    Raise a Fault if a direction is not of unit length.
    """
    wo = np.stack([polar(degrees) for degrees in (*GRAZING, 90.00001)], axis=1)
    special = [wo, -wo, wo * [[-1], [-1], [1]], wo * [[1], [1], [-1]], np.eye(3), -np.eye(3)]
    special.append(np.random.default_rng(5).normal(size=(3, 256)))
    w = np.concatenate([v / np.linalg.norm(v, axis=0) for v in special], axis=1).astype(np.float32)
    for view in views:
        check_unit("sample", view.wi[:, view.accepted], view.place)
        for function in filter(None, (view.pdf, view.value, view.hit)):
            function(view.wi)
            function(w)
    return f"{len(views)} places"


def check_unit(function: str, w: Array, place: str) -> None:
    """Raise a Fault unless all directions ``(3, N)`` have unit length."""
    length = np.sqrt(dot(w, w))
    if length.size and not np.abs(length - 1).max() < 1e-4:
        worst = length[np.abs(length - 1).argmax()]
        raise Fault(f"{function} must return unit directions; got a length of {worst:.5g} ({place})")
