"""Surface points and small scenes of checks, and the comparison of renders that must have the same mean."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from dmis.brdf.materials import Material, matte
from dmis.estimator.settings import Settings
from dmis.fit.rule import Rule
from dmis.geometry.shapes import quad
from dmis.light.area import QuadLight
from dmis.light.light import Light
from dmis.pipeline.render import render
from dmis.pipeline.result import Result
from dmis.scene.camera import Camera
from dmis.scene.groups import Part, batch_key, make_group
from dmis.scene.scene import Scene
from dmis.scene.shading_points import ShadingPoints
from dmis.testing.outcome import Fault
from dmis.testing.sphere import columns

FLOOR = quad((-4, -4, 0), (8, 0, 0), (0, 8, 0))
"""A square floor, 8 on a side, at z = 0."""
ABOVE = QuadLight((-0.5, -0.5, 2), (0, 1, 0), (1, 0, 0), (5, 4, 3))
"""A lamp 2 above the floor that shines downwards."""
BELOW = QuadLight((-0.5, -0.5, -2), (1, 0, 0), (0, 1, 0), (5, 4, 3))
"""A lamp 2 below the floor that shines upwards."""
_MIDDLE = np.full((2, 1), 0.5, np.float32)


def surface(
    material: Material, wo: Any, count: int = 1, n: Any = (0, 0, 1), dpdu: Any = (1, 0, 0), outside: bool = True
) -> ShadingPoints:
    """Return `count` points at the origin, all seen from `wo`.

    Parameters
    ----------
    material
        Its lobes are bound as a scene binds them; images at the middle of the texture.
    wo, n, dpdu
        Unit vectors ``(3,)``: to the viewer, the normal, the tangent.
    outside
        Whether the viewer is on the outer side.
    """
    part = Part(FLOOR, material)
    group = make_group(batch_key(part), [(material, None)])
    uv = np.repeat(_MIDDLE, count, axis=1)
    reflection, transmission, delta = (
        tuple(group.bind(lobe, None, uv) for lobe in lobes)
        for lobes in (group.reflection, group.transmission, group.delta)
    )
    normal, wo_ = columns(n, count), columns(wo, count)
    return ShadingPoints(
        p=np.zeros((3, count), np.float32),
        ng=normal,
        n=normal,
        wo=wo_,
        cos_o=(normal * wo_).sum(axis=0),
        outside=np.full(count, outside),
        dpdu=columns(dpdu, count),
        epsilon=np.float32(0),
        reflection=reflection,
        transmission=transmission,
        delta=delta,
    )


def box_scene(
    material: Material | None = None,
    lights: tuple[Light, ...] = (ABOVE,),
    extra: tuple[Part, ...] = (),
    resolution: tuple[int, int] = (16, 16),
    eye: tuple[float, float, float] = (0.0, -3.0, 2.0),
    target: tuple[float, float, float] = (0.0, 0.0, 0.0),
    fov: float = 40.0,
) -> Scene:
    """Return a scene of the `FLOOR` under `lights`, and of the parts `extra`."""
    camera = Camera.look_at(eye, target, fov=fov, resolution=resolution)
    return Scene(camera, (Part(FLOOR, material or matte(0.6)), *extra), lights)


def standard_error(result: Result) -> float:
    """Return the standard error of an image's mean: pixels are independent, channels taken as fully dependent."""
    deviation = np.sqrt(result.variance.astype(float)).mean(axis=2)
    return float(np.sqrt((deviation**2).sum()) / deviation.size)


def compare_means(
    scene: Scene,
    rules: Sequence[tuple[str, Rule | str]],
    limit: float,
    guilty: Callable[[str], str],
    spp: int = 64,
) -> str:
    """Render a scene by several rules, and compare each mean with that of the first by a z-test.

    Parameters
    ----------
    rules
        Names for messages, and rules.
    limit
        Of the normal deviate.
    guilty
        Returns the end of the message from the name of the rule whose mean differs.

    Returns
    -------
    str
        The means. A rule whose noise comes from a few pixels, of a lobe that its samples hardly ever meet, is named
        and not compared, because its standard error is not known.

    Raises
    ------
    Fault
        If two means differ.
    """
    settings = Settings(integrator="direct")
    results = [
        (name, render(scene, rule, spp, seed=k, settings=settings, parallel=1)) for k, (name, rule) in enumerate(rules)
    ]
    first, reference = results[0]
    mean, error = float(reference.image.mean(dtype=float)), standard_error(reference)
    lines, noisy = [f"{first} {mean:.4g} ± {error:.2g}"], []
    for name, result in results[1:]:
        other, other_error = float(result.image.mean(dtype=float)), standard_error(result)
        lines.append(f"{name} {other:.4g} ± {other_error:.2g}")
        if _few_pixels(result) or _few_pixels(reference):
            noisy.append(name)
            continue
        z = (other - mean) / max(np.hypot(error, other_error), 1e-6 * abs(mean), 1e-30)
        if abs(z) > limit:
            raise Fault(f"mean radiance {', '.join(lines)} (z = {z:.1f}). {guilty(name)}", lambda: _figure(results))
    text = f"mean radiance {', '.join(lines)}"
    return text if not noisy else f"{text}; too noisy to compare: {', '.join(noisy)}"


def _few_pixels(result: Result) -> bool:
    """Return whether the noise of an image comes from a few of its pixels."""
    variance = result.variance.astype(float).mean(axis=2)
    return bool(variance.any() and variance.sum() ** 2 / (variance**2).sum() < 12)


def _figure(results: Sequence[tuple[str, Result]]) -> Any:
    """Return a figure of the images side by side."""
    from dmis import plot

    figure, axes = plot.canvas(1, len(results), 4 * len(results), 4.2)
    for axis, (name, result) in zip(axes[0], results, strict=True):
        plot.picture(axis, result.image, f"{name}: mean {result.image.mean(dtype=float):.4g}")
    return figure
