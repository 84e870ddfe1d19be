"""Checks of a light: `sample` against the pdf of `hit`, its visible surface, brightness, irradiance, and renders.

A light is seen from receivers: an infinite one from the origin, an area light from two points before the bright side
of its mesh and from one behind it.
"""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from inspect import unwrap
from typing import Any

import numpy as np

from dmis.base.plugins import checked
from dmis.base.vectors import Array, frame
from dmis.brdf.materials import matte
from dmis.geometry.shapes import quad
from dmis.geometry.transforms import translate
from dmis.light.light import LIGHT_CHECKS, Light, check_light_methods
from dmis.light.light_sample import INFINITE_DISTANCE
from dmis.pipeline.render import render
from dmis.scene.camera import Camera
from dmis.scene.groups import Part, light_part
from dmis.scene.scene import Scene
from dmis.testing.density import COUNT, DensityView, check_integral, check_pdf
from dmis.testing.outcome import Check, Fault, Outcome, run_checks
from dmis.testing.scenes import compare_techniques
from dmis.testing.sphere import columns, uniforms, unit
from dmis.testing.statistics import level, z_limit

LEVEL = level(8)
"""Of each test: chi-square and integral for up to three receivers, and two comparisons of renders."""
_MEAN, _PLACES = 0.03, 0.1
"""Relative differences of an image and `hit` beside noise, since meshes are approximate: of means, mean of blocks."""
_FALLOFF = 2e-3
"""Relative error of the radiance of a delta light at half the distance."""
_DARK = (Part(quad((-0.5, -0.5, 20), (1, 0, 0), (0, 1, 0)), matte(0)),)
"""A speck, because a scene needs a surface."""


def check_light(light: Light, name: str = "") -> list[Outcome]:
    """Return the outcomes of the checks of a light, by what `dmis.light.light` promises.

    It is an area light with a mesh, an infinite light or a Dirac delta; its `name` in messages is that of the class by
    default. A right light fails any check with a probability of 1e-4; a pdf that is 7 % off fails.
    """
    return run_checks(name or type(light).__name__, _checks(light))


def _checks(light: Any) -> Iterator[Check]:
    """Yield the checks of a light."""
    check_light_methods(light)
    light = checked(light, LIGHT_CHECKS, always=True)
    if light.delta:
        yield "radiance falls off", lambda: _check_falloff(light)
        return
    parts = () if light.infinite else (light_part(light),)
    points = _receivers(light)
    views = [_view(light, p, uniforms(COUNT, k)) for k, p in enumerate(points)]
    pdf, value = "the pdf of hit", "the radiance of hit"
    yield "sample follows pdf", lambda: check_pdf(views, LEVEL, pdf)
    yield f"samples have the integral of {value}", lambda: check_integral(views, LEVEL, value, pdf)
    yield "the camera sees what hit reports", lambda: _check_images(light, parts, points)
    if light.brightness(1.0) > 0:
        yield "renders by fixed:0, fixed:1 and balance agree", lambda: _check_renders(light, parts)


def _placement(light: Any) -> tuple[Array, Array, Array, Array, float]:
    """Return centre, normal and two tangents ``(3,)`` of the largest triangle of a light's mesh, and its diagonal.

    An infinite light has the centre 0, the normal -z and the diagonal 1.
    """
    centre, normal, size = np.zeros(3), np.array([0.0, 0.0, -1.0]), 1.0
    if not light.infinite:
        mesh = light.mesh()
        corners = np.asarray(mesh.vertices, float)[mesh.faces]
        normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        k = int(np.linalg.norm(normals, axis=1).argmax())
        centre, normal = corners[k].mean(axis=0), unit(*normals[k])
        size = float(np.linalg.norm(np.subtract(*mesh.bounds)))
    return centre, normal, *frame(normal), size


def _receivers(light: Any) -> list[Array]:
    """Return points ``(3,)`` from which a light is looked at; the first two see the bright side."""
    centre, normal, s, t, size = _placement(light)
    places = (1.1, 0.2, 0.1), (0.5, -0.6, 0.3), (-1.3, -0.3, 0.2)
    points = [centre + size * (along * normal + x * s + y * t) for along, x, y in places]
    return points[:1] if light.infinite else points


def _view(light: Any, p: Array, u: Array) -> DensityView:
    """Return the light seen from the receiver `p` ``(3,)``, sampled by the uniform numbers `u` ``(2, N)``."""

    def pdf(w: Array) -> Array:
        light_sample = light.hit(columns(p, w.shape[1]), w)
        return np.where(light_sample.emits, light_sample.pdf, 0)

    light_sample = light.sample(columns(p, u.shape[1]), u)
    return DensityView(light_sample.wi, pdf, light_sample.emits, _from(p), lambda w: _radiance(light, p, w))


def _from(p: Array) -> str:
    return f"seen from ({', '.join(f'{x:.3g}' for x in p)})"


def _radiance(light: Any, p: Array, w: Array) -> Array:
    """Return the radiance of `hit` from directions `w` ``(3, N)`` at `p` ``(3,)``; 0 where they miss the light."""
    light_sample = light.hit(columns(p, w.shape[1]), w)
    return np.where(light_sample.emits, np.broadcast_to(light_sample.radiance, w.shape), 0)


def _check_falloff(light: Any) -> str:
    """Raise a Fault unless a delta light has four times the radiance at half the distance, or, infinite, the same."""
    p = 20 * uniforms(4096, 7, 3) - 10
    far = light.sample(p)
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


def _camera(light: Any, p: Array) -> Camera:
    """Return a camera at `p` ``(3,)`` that sees all of a light, but at most 127 degrees of one that is near."""
    if light.infinite:
        return Camera(translate(p), 90, (64, 32), projection="spherical")
    low, high = light.mesh().bounds
    centre = (low + high) / 2
    _, up = frame(centre - p)
    radius = float(np.linalg.norm(high - low) / 2)
    distance = float(np.linalg.norm(centre - p))
    half_angle = np.degrees(np.arcsin(min(radius / distance, 0.87)))
    return Camera.look_at(tuple(p), tuple(centre), tuple(up), 2.1 * half_angle, (48, 48))


def _check_images(light: Any, parts: tuple[Part, ...], points: list[Array]) -> str:
    """Raise a Fault unless images of the light show the radiance of `hit`, on average and in blocks of 4x4 pixels."""
    side = 8
    largest = 0.0
    for p in points:
        camera = _camera(light, p)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of a light without power
            scene = Scene(camera, parts or _DARK, (light,))
            image = render(scene, "balance", side**2, integrator="direct", parallel=1).image
        # directions at random within the cells of a grid: those of its nodes would all miss a thin light, or hit it
        height, width = image.shape[:2]
        nodes = np.mgrid[: height * side, : width * side].reshape(2, -1)
        y, x = (nodes + uniforms(nodes.shape[1], 5)) / side
        w = camera.rays(x, y) if camera.is_pinhole else camera.lens_rays(x, y)[1]
        radiance = _radiance(light, p, w)
        cells = radiance.reshape(3, height // 4, 4 * side, width // 4, 4 * side)
        expected = np.moveaxis(cells.mean(axis=(2, 4)), 0, -1)
        image = image.reshape(height // 4, 4, width // 4, 4, 3).mean(axis=(1, 3))
        # values from 0 to M with mean m have a variance of at most m (M - m)   (Bhatia and Davis 2000)
        light_samples = light.sample(columns(p, 256), uniforms(256, 6))
        most = max(np.max(light_samples.radiance), radiance.max(), image.max())
        m = (image + expected) / 2
        noise = z_limit(LEVEL) * np.sqrt(2 * m * (most - m)) / (4 * side)
        noise_of_mean = np.sqrt(np.square(noise).mean() / noise[..., 0].size)
        mean = expected.mean()
        if abs(image.mean() - mean) > _MEAN * mean + noise_of_mean or (
            np.abs(image - expected).mean() > _PLACES * mean + noise.mean()
        ):
            raise Fault(
                f"the camera sees a mean radiance of {image.mean():.4g}, up to {image.max():.4g}, but hit reports "
                f"{mean:.4g}, up to {expected.max():.4g} ({_from(p)}): emission or radiance must be that of "
                f"hit, and normals of mesh() point to the bright side"
            )
        largest = max(largest, float(image.max()))
    brightness = light.brightness(1.0)
    if unwrap(type(light).brightness) is not Light.brightness and largest > brightness * (1 + 1e-4):
        raise Fault(f"brightness() returns {brightness:.5g}, but the radiance of hit is up to {largest:.5g}")
    return f"radiance up to {largest:.4g}"


def _check_renders(light: Any, parts: tuple[Part, ...]) -> str:
    """Raise a Fault if light sampling, BRDF sampling and both have different means on a floor below the light."""
    centre, normal, s, t, size = _placement(light)
    middle = centre + size * normal
    # t x s points to the light
    floor = quad(middle - 4 * size * (s + t), 8 * size * t, 8 * size * s)
    # the camera is beside the light's column, on the bright side of the floor
    eye = middle + size * (1.5 * s - 0.6 * normal)
    camera = Camera.look_at(tuple(eye), tuple(middle), tuple(t), fov=30, resolution=(16, 16))
    advice = "sample or hit: they must return the same light samples, and BRDF samples do without the pdf"
    return compare_techniques(Scene(camera, (Part(floor, matte(0.5)), *parts), (light,)), LEVEL, advice, 256)
