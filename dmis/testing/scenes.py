"""Small scenes of checks, and the comparison of renders that must have the same mean."""

from __future__ import annotations

from collections.abc import Sequence

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
from dmis.scene.groups import Part
from dmis.scene.probe import surface as surface
from dmis.scene.scene import Scene
from dmis.testing.outcome import Fault

FLOOR = quad((-4, -4, 0), (8, 0, 0), (0, 8, 0))
"""A square floor, 8 on a side, at z = 0."""
ABOVE: QuadLight = QuadLight((-0.5, -0.5, 2), (0, 1, 0), (1, 0, 0), (5, 4, 3))
"""A lamp 2 above the floor that shines downwards."""
BELOW = QuadLight((-0.5, -0.5, -2), (1, 0, 0), (0, 1, 0), (5, 4, 3))
"""A lamp 2 below the floor that shines upwards."""
TECHNIQUES_ALONE: tuple[tuple[str, Rule | str], ...] = (
    ("light samples (fixed:1)", "fixed:1"),
    ("BRDF samples (fixed:0)", "fixed:0"),
    ("both", "balance"),
)
"""Rules, with names for messages, whose means agree if a lobe or light is right."""


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
    advice: str,
    spp: int = 64,
) -> str:
    """Render a scene by several rules, and compare each mean with that of the first by a z-test.

    Parameters
    ----------
    rules
        Names for messages, and rules.
    limit
        Of the normal deviate.
    advice
        The end of the message of a failure.

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
    means = [(float(result.image.mean(dtype=float)), standard_error(result)) for _, result in results]
    text = f"mean radiance {', '.join(f'{results[k][0]} {m:.4g} ± {e:.2g}' for k, (m, e) in enumerate(means))}"
    noisy = []
    for (name, result), (mean, error) in zip(results[1:], means[1:], strict=True):
        if _few_pixels(result) or _few_pixels(results[0][1]):
            noisy.append(name)
            continue
        z = (mean - means[0][0]) / max(np.hypot(error, means[0][1]), 1e-6 * abs(means[0][0]), 1e-30)
        if abs(z) > limit:
            raise Fault(f"{text} (z = {z:.1f} of {name}). {advice}")
    return text if not noisy else f"{text}; too noisy to compare: {', '.join(noisy)}"


def _few_pixels(result: Result) -> bool:
    """Return whether the noise of an image comes from a few of its pixels."""
    variance = result.variance.astype(float).mean(axis=2)
    return bool(variance.any() and variance.sum() ** 2 / (variance**2).sum() < 12)
