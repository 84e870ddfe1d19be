"""Checks of a light: `sample` against the pdf of `hit`, its visible surface, irradiance, finite values, and renders.

A light is seen from receivers: an infinite one from the origin, an area light from two points before the bright side
of its mesh and from one behind it.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from inspect import unwrap
from typing import Any

import numpy as np

from dmis.base.vectors import Array, frame, normalise
from dmis.brdf.materials import matte
from dmis.brdf.texture import Image
from dmis.formats.load_scene import light_part
from dmis.geometry.mesh import Mesh
from dmis.geometry.shapes import quad
from dmis.intersect import Intersector
from dmis.light.light import Light, check_light_form, checked_light
from dmis.light.light_sample import INFINITE_DISTANCE, LightSample
from dmis.samplers.warp import square_to_sphere
from dmis.scene.camera import Camera
from dmis.scene.groups import Part
from dmis.scene.scene import Scene
from dmis.testing.density import DensityView
from dmis.testing.density_checks import CORNERS, COUNT, check_hit, check_unit, view_checks
from dmis.testing.outcome import Check, Fault, Outcome, run_checks
from dmis.testing.scenes import TECHNIQUES_ALONE, compare_means
from dmis.testing.sphere import columns, uniforms, unit
from dmis.testing.statistics import level, z_limit

LEVEL = level(16)
"""Of each test: chi-square, integral and irradiance for up to three receivers, and renders."""
_OUTLINE = 0.97
"""Share of directions in which camera and `hit` must agree: at outlines, and of a tessellated sphere, they do not."""
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

    def prepare() -> list[Check]:
        nonlocal light
        light = checked_light(light, always=True)
        check_light_form(light)
        if light.delta:
            return [("values are finite, and fall off", lambda: _check_delta(light))]
        if not light.infinite and light.mesh() is None:
            raise Fault("mesh() must return the visible surface, a dmis.Mesh, which the camera sees")
        points, special = _receivers(light)
        views = [_view(light, p, uniforms(COUNT, k), _from(p)) for k, p in enumerate(points, 1)]
        corners = [_view(light, p, CORNERS[:2], f"receiver {place}") for place, p in special.items()]
        cameras = list(_cameras(light, points))
        return [
            *view_checks(views, corners, LEVEL, "the radiance of hit", light.hides_itself()),
            ("the camera sees what hit reports", lambda: check_hit(cameras, share=_OUTLINE, name="the camera")),
            ("radiance is at most brightness", lambda: _check_brightness(light, views)),
            ("renders by fixed:0, fixed:1 and balance agree", lambda: _check_renders(light)),
        ]

    return run_checks(name or type(light).__name__, "forms of what its methods return", prepare)


def _placement(light: Any) -> tuple[Array, Array, Array, Array, float]:
    """Return centre, normal and two tangents ``(3,)`` of the largest triangle of a light's mesh, and its diagonal.

    An infinite light has the centre 0, the normal -z and the diagonal 1.
    """
    centre, normal, size = np.zeros(3), np.array([0.0, 0.0, -1.0]), 1.0
    if not light.infinite:
        corners, cross = _triangles(light.mesh())
        k = int(np.linalg.norm(cross, axis=1).argmax())
        centre, normal = corners[k].mean(axis=0), unit(*cross[k])
        size = float(np.linalg.norm(np.subtract(*light.mesh().bounds)))
    return centre, normal, *frame(normal), size


def _triangles(mesh: Mesh) -> tuple[Array, Array]:
    """Return the corners of a mesh's triangles ``(F, 3, 3)``, and their normals, twice as long as their areas."""
    corners = np.asarray(mesh.vertices, float)[mesh.faces]
    return corners, np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])


def _receivers(light: Any) -> tuple[list[Array], dict[str, Array]]:
    """Return points ``(3,)`` from which a light is looked at, and others, by words for messages.

    All but the third see the bright side. At the others values may not be finite.
    """
    centre, normal, s, t, size = _placement(light)
    places = (1.1, 0.2, 0.1), (0.5, -0.6, 0.3), (-1.3, -0.3, 0.2)
    points = [centre + size * (along * normal + x * s + y * t) for along, x, y in places]
    special = {"on the light": centre, "in its plane": centre + 2 * size * s, "far": centre + 1e3 * size * normal}
    return points[:1] if light.infinite else points, special


def _from(p: Array) -> str:
    return f"seen from ({', '.join(f'{x:.3g}' for x in p)})"


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


def _check_delta(light: Any) -> str:
    """Raise a Fault unless a delta light has four times the radiance at half the distance, or, infinite, the same."""
    p = 20 * uniforms(4096, 7, 3) - 10
    p[:, :2] = [[0, 600], [0, 0], [0, 800]]
    far = light.sample(p)
    check_unit("sample", far.wi[:, far.emits], "receivers at the origin and elsewhere")
    infinite = np.asarray(far.distance) >= INFINITE_DISTANCE
    near = light.sample(np.ascontiguousarray(p + far.wi * np.where(infinite, 1, np.asarray(far.distance) / 2)))
    lit = far.emits & near.emits
    factor = np.where(infinite, 1.0, 4.0)
    expected, radiance = factor * np.broadcast_to(far.radiance, p.shape), np.broadcast_to(near.radiance, p.shape)
    wrong = lit & ~np.isclose(radiance, expected, rtol=_FALLOFF, atol=1e-30).all(axis=0)
    if wrong.mean() > 0.005:
        gain = (radiance[:, wrong] / expected[:, wrong] * factor[wrong]).max()
        raise Fault(f"sample: radiance is {gain:.3g} times as large at half the distance; a point of light must have 4")
    return f"{lit.mean():.0%} of 4096 receivers are lit"


def _cameras(light: Any, points: list[Array]) -> Iterator[DensityView]:
    """Yield directions from `points` ``(3,)`` to the light and around it, with light samples of what cameras see."""
    if not light.infinite:
        caster = Intersector(light.mesh().vertices, light.mesh().faces)
        corners, normals = _triangles(light.mesh())
        middle = corners.mean(axis=(0, 1))
        size = np.linalg.norm(corners.reshape(-1, 3) - middle, axis=1).max()
    for p in points:
        view = _view(light, p, CORNERS[:2], _from(p))
        if light.infinite:
            w = square_to_sphere(uniforms(4096))
            radiance, distance = light.radiance(w), np.full(4096, INFINITE_DISTANCE)
            emits = light.hit(columns(p, 4096), w).emits | np.broadcast_to(radiance, w.shape).any(axis=0)
        else:
            to = middle - p
            spread = np.clip(size / np.linalg.norm(to), 0.02, 2)
            cube = 2 * np.random.default_rng(6).random((3, 4096)) - 1
            w = normalise((unit(*to)[:, None] + spread * cube).astype(np.float32))
            hits = caster.closest(columns(p, 4096), w)
            emits, distance = (hits.prim >= 0) & ((normals[hits.prim] * w.T).sum(axis=1) < 0), hits.distance
            if isinstance(image := getattr(light, "radiance", None), Image):
                weights = np.stack([1 - hits.u - hits.v, hits.u, hits.v])
                uv = np.asarray(light.mesh().uv, np.float32)[light.mesh().faces[hits.prim]]
                radiance = image(np.einsum("kn,nkc->cn", weights, uv))
            else:
                radiance = light.emission((p[:, None] + w * np.where(emits, distance, 0)).astype(np.float32))
        yield replace(view, wi=w, sample=LightSample(w, distance, radiance, distance, emits), value=None)


def _check_brightness(light: Any, views: list[DensityView]) -> str:
    """Raise a Fault if the radiance is larger than `brightness`."""
    largest = max(float(np.max(view.sample.radiance * view.sample.emits)) for view in views if view.sample is not None)
    brightness = light.brightness(1.0)
    if unwrap(type(light).brightness) is not Light.brightness and largest > brightness * (1 + 1e-4):
        raise Fault(f"brightness() returns {brightness:.5g}, but the radiance of sample is up to {largest:.5g}")
    return f"up to {largest:.4g}"


def _check_renders(light: Any) -> str:
    """Raise a Fault if light sampling, BRDF sampling and both have different means on a floor below the light."""
    if not light.has_power():
        return "the light has no power: nothing to render"
    advice = "sample or hit: BRDF samples need hit alone, without its pdf, and the others disagree with them"
    return compare_means(light_scene(light), TECHNIQUES_ALONE, z_limit(LEVEL), advice)


def light_scene(light: Any) -> Scene:
    """Return a scene of a floor that faces a light, which is out of view."""
    centre, normal, s, t, size = _placement(light)
    parts = (light_part(light),) if light.hides_itself() else ()
    middle = centre + size * normal
    # t x s points to the light
    floor = quad(middle - 4 * size * (s + t), 8 * size * t, 8 * size * s)
    # the camera is beside the light's column, on the bright side of the floor
    eye = middle + size * (1.5 * s - 0.6 * normal)
    camera = Camera.look_at(tuple(eye), tuple(middle), tuple(t), fov=30, resolution=(16, 16))
    return Scene(camera, (Part(floor, matte(0.5)), *parts), (light,))
