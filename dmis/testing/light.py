"""Checks of a light: `sample` against the pdf of `hit`, its visible surface, irradiance, finite values, and renders.

A light is seen from receivers: an infinite one from the origin, an area light from two points before the bright side
of its mesh and from one behind it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

from dmis.base.vectors import Array, frame, normalise
from dmis.brdf.materials import matte
from dmis.formats.load_scene import light_part
from dmis.geometry.mesh import Mesh
from dmis.geometry.shapes import quad
from dmis.intersect import Intersector
from dmis.light.light import AreaLight, InfiniteLight, Light, check_light_form
from dmis.light.light_sample import INFINITE_DISTANCE, LightSample
from dmis.scene.camera import Camera
from dmis.scene.groups import Part
from dmis.scene.scene import Scene
from dmis.testing.density import DensityView
from dmis.testing.density_checks import CORNERS, COUNT, ROUNDED, check_light_sample, check_unit, view_checks
from dmis.testing.outcome import Fault, Outcome, run_checks
from dmis.testing.scenes import TECHNIQUES_ALONE, compare_means
from dmis.testing.sphere import columns, uniforms, unit
from dmis.testing.statistics import level, z_limit

LEVEL = level(16)
"""Of each test: chi-square, integral and irradiance for up to three receivers, and renders."""
_OUTLINE = 0.97
"""Share of directions in which the mesh and `hit` must agree: at outlines, and of a tessellated sphere, they do not."""
_FALLOFF = 2e-3
"""Relative error of the radiance of a delta light at half the distance."""


def check_light(light: Light, name: str = "") -> list[Outcome]:
    """Check a light by what `dmis.light.light` promises.

    Parameters
    ----------
    light
        An area light with a mesh, an infinite light, or a Dirac delta.
    name
        For messages. Default: that of the class.

    Returns
    -------
    list of Outcome
        One for each check. A right light fails any of them with a probability of 1e-4; a pdf that is 7 % off fails.
    """
    name = name or type(light).__name__
    views: list[DensityView] = []
    corners: list[DensityView] = []

    def check_form() -> str:
        check_light_form(light)
        if not light.delta:
            if not light.infinite and light.mesh() is None:
                raise Fault("mesh() must return the visible surface, a dmis.Mesh, which the camera sees")
            for seed, p in enumerate(receivers(light), 1):
                views.append(_view(light, p, uniforms(COUNT, seed), f"seen from ({', '.join(f'{x:.3g}' for x in p)})"))
            corners.extend(_view(light, p, CORNERS[:2], f"receiver {place}") for place, p in _special(light).items())
        return "methods and shapes are right"

    def run() -> Iterator[tuple[str, Callable[[], str]]]:
        yield "methods and forms of light samples", check_form
        if light.delta:
            yield "values are finite, and fall off", lambda: _check_delta(light)
            return
        yield from view_checks(views, corners, LEVEL, "the radiance of hit", light.hides_itself())
        yield "hit has bright side, outline and distance of mesh", lambda: _check_mesh(light, views)
        yield "hit has the radiance that the camera sees, at most brightness", lambda: _check_radiance(light, views)
        yield "renders by fixed:0, fixed:1 and balance agree", lambda: _check_renders(light)

    return run_checks(name, run())


def receivers(light: Any) -> list[Array]:
    """Return points ``(3,)`` from which a light is looked at; all but the third see its bright side."""
    if light.infinite:
        return [np.zeros(3)]
    mesh = light.mesh()
    centre, normal, size = placement(mesh)
    s, t = (a[:, 0].astype(float) for a in frame(normal.astype(np.float32)[:, None]))
    return [
        centre + size * (1.1 * normal + 0.2 * s + 0.1 * t),
        centre + size * (0.5 * normal - 0.6 * s + 0.3 * t),
        centre - size * (1.3 * normal + 0.3 * s - 0.2 * t),
    ]


def placement(mesh: Mesh) -> tuple[Array, Array, float]:
    """Return the middle of the largest triangle of a mesh, its normal, both ``(3,)``, and the mesh's diagonal."""
    corners = np.asarray(mesh.vertices, float)[mesh.faces]
    cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    k = int(np.linalg.norm(cross, axis=1).argmax())
    low, high = mesh.bounds
    return corners[k].mean(axis=0), unit(*cross[k]), float(np.linalg.norm(np.subtract(high, low)))


def _view(light: Any, p: Array, u: Array, place: str) -> DensityView:
    """Return the light seen from the receiver `p` ``(3,)``, sampled by the uniform numbers `u` ``(2, N)``."""

    def hit(w: Array) -> LightSample:
        return light.hit(columns(p, w.shape[1]), w)

    def pdf(w: Array) -> Array:
        sample = hit(w)
        return np.where(sample.emits, sample.pdf, 0)

    def radiance(w: Array) -> Array:
        sample = hit(w)
        return np.where(sample.emits, np.broadcast_to(sample.radiance, w.shape), 0)

    sample = light.sample(columns(p, u.shape[1]), u)
    return DensityView(sample.wi, pdf, sample.emits, place, radiance, sample, hit, "the pdf of hit")


def _special(light: Any) -> dict[str, Array]:
    """Return receivers ``(3,)`` at which values may not be finite, with words for messages."""
    if light.infinite:
        return {"at the origin": np.zeros(3), "1000 away": np.array([600.0, 0.0, 800.0])}
    centre, normal, size = placement(light.mesh())
    s = frame(normal.astype(np.float32)[:, None])[0][:, 0]
    return {"on the light": centre, "in its plane": centre + 2 * size * s, "far": centre + 1e3 * size * normal}


def _check_delta(light: Any) -> str:
    """Raise a Fault unless a delta light has four times the radiance at half the distance, or, infinite, the same."""
    p = 20 * uniforms(4096, 7, 3) - 10
    p[:, :2] = [[0, 600], [0, 0], [0, 800]]
    far = light.sample(p)
    check_light_sample("sample", far, "receivers at the origin and elsewhere")
    check_unit("sample", far.wi[:, far.emits], "receivers at the origin and elsewhere")
    infinite = np.asarray(far.distance) >= INFINITE_DISTANCE
    near = light.sample(np.ascontiguousarray(p + far.wi * np.where(infinite, 1, np.asarray(far.distance) / 2)))
    lit = far.emits & near.emits
    factor = np.where(infinite, 1.0, 4.0)
    expected, radiance = factor * np.broadcast_to(far.radiance, p.shape), np.broadcast_to(near.radiance, p.shape)
    wrong = lit & ~np.isclose(radiance, expected, rtol=_FALLOFF, atol=1e-30).all(axis=0)
    if wrong.mean() > 1 - ROUNDED:
        gain = (radiance[:, wrong] / expected[:, wrong] * factor[wrong]).max()
        raise Fault(f"sample: radiance is {gain:.3g} times as large at half the distance; a point of light must have 4")
    return f"{lit.mean():.0%} of 4096 receivers are lit"


def _check_mesh(light: Any, views: list[DensityView]) -> str:
    """Raise a Fault if `hit` sees another surface than the light's mesh."""
    if light.infinite:
        return "infinite lights have none"
    mesh = light.mesh()
    caster = Intersector(mesh.vertices, mesh.faces)
    corners = np.asarray(mesh.vertices, float)[mesh.faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    middle = corners.mean(axis=(0, 1))
    size = np.linalg.norm(corners.reshape(-1, 3) - middle, axis=1).max()
    cube = 2 * np.random.default_rng(6).random((3, 4096)) - 1
    for view, p in zip(views, receivers(light), strict=True):
        assert view.hit is not None
        to = middle - p
        spread = np.clip(size / np.linalg.norm(to), 0.02, 2)
        w = normalise((unit(*to)[:, None] + spread * cube).astype(np.float32))
        hits, hit = caster.closest(columns(p, w.shape[1]), w), view.hit(w)
        meets = hits.prim >= 0
        faces = (normals[np.maximum(hits.prim, 0)] * w.T).sum(axis=1) < 0
        emits = meets & faces
        if (hit.emits == emits).mean() < _OUTLINE:
            wrong_side = bool((hit.emits == (meets & ~faces)).mean() >= _OUTLINE)
            raise Fault(
                f"hit: emits is True in {hit.emits.mean():.1%} of directions about the light, of which "
                f"{emits.mean():.1%} meet the bright side of mesh(){' and as many the other side' * wrong_side}. The "
                f"normals of mesh(), by the winding of its triangles, point to the bright side ({view.place})"
            )
        both = meets & hit.emits
        close = np.isclose(hit.distance[both], hits.distance[both], rtol=0.02)
        if both.any() and close.mean() < _OUTLINE:
            k = np.flatnonzero(both)[int(np.argmin(close))]
            raise Fault(
                f"hit: distance is {hit.distance[k]:.5g}, but mesh() is {hits.distance[k]:.5g} away ({view.place})"
            )
    return f"{len(views)} receivers"


def _check_radiance(light: Any, views: list[DensityView]) -> str:
    """Raise a Fault if camera rays would see another radiance than `hit` reports, or more than `brightness`."""
    for view, receiver in zip(views, receivers(light), strict=True):
        assert view.hit is not None
        hit = view.hit(view.wi)
        if not (ok := hit.emits).any():
            continue
        function = "radiance" if light.infinite else "emission"
        p = columns(receiver, COUNT) + hit.wi * hit.distance
        seen = light.radiance(hit.wi) if light.infinite else light.emission(p)
        seen, reported = (np.broadcast_to(a, hit.wi.shape)[:, ok] for a in (seen, hit.radiance))
        close = np.isclose(seen, reported, rtol=5e-3, atol=1e-3 * np.abs(reported).max()).all(axis=0)
        if close.mean() < ROUNDED:
            k = int(np.argmin(close))
            raise Fault(
                f"{function}() returns {seen[:, k].max():.5g} where the radiance of hit is {reported[:, k].max():.5g}: "
                f"the camera sees another light than the surfaces ({view.place})"
            )
        largest, brightness = float(reported.max()), light.brightness(1.0)
        if type(light).brightness is not Light.brightness and largest > brightness * (1 + 1e-4):
            raise Fault(f"brightness() returns {brightness:.5g}, but the radiance of hit is up to {largest:.5g}")
    return f"{len(views)} receivers"


def _check_renders(light: Any) -> str:
    """Raise a Fault if light sampling, BRDF sampling and both have different means on a floor below the light."""
    if not light.has_power():
        return "the light has no power: nothing to render"
    advice = "sample or hit: BRDF samples need hit alone, without its pdf, and the others disagree with them"
    return compare_means(light_scene(light), TECHNIQUES_ALONE, z_limit(LEVEL), advice)


def light_scene(light: AreaLight | InfiniteLight) -> Scene:
    """Return a scene of a floor that faces a light, which is out of view."""
    centre, normal, size = np.zeros(3), np.array([0.0, 0.0, -1.0]), 1.0
    parts: tuple[Part, ...] = ()
    if not light.infinite:
        mesh = light.mesh()
        assert mesh is not None
        centre, normal, size = placement(mesh)
        if light.hides_itself():
            parts = (light_part(light),)  # type: ignore[arg-type]
    s, t = (a[:, 0].astype(float) for a in frame(-normal.astype(np.float32)[:, None]))
    middle = centre + size * normal
    # s x t points to the light
    floor = quad(middle - 4 * size * (s + t), 8 * size * s, 8 * size * t)
    # the camera is beside the light's column, on the bright side of the floor
    eye = middle + size * (1.5 * s - 0.6 * normal)
    camera = Camera.look_at(tuple(eye), tuple(middle), tuple(t), fov=30, resolution=(16, 16))
    return Scene(camera, (Part(floor, matte(0.5)), *parts), (light,))
