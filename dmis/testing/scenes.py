"""Small scenes of checks, and the comparison of renders that must have the same mean."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from dmis.base.vectors import Array
from dmis.brdf.materials import Material, matte
from dmis.estimator.settings import Settings
from dmis.fit.rule import Rule
from dmis.geometry.mesh import Mesh
from dmis.geometry.shapes import quad
from dmis.light.area import QuadLight
from dmis.light.environment import EnvironmentLight
from dmis.light.light import Light
from dmis.pipeline.render import render
from dmis.pipeline.result import Result
from dmis.scene.camera import Camera
from dmis.scene.groups import Part, batch_key, bind_lobes, make_group
from dmis.scene.scene import Scene
from dmis.scene.shading_points import ShadingPoints
from dmis.testing.outcome import Fault
from dmis.testing.statistics import z_limit

FLOOR = quad((-4, -4, 0), (8, 0, 0), (0, 8, 0))
"""A square floor, 8 on a side, at z = 0."""
TURNED = replace(FLOOR, normals=FLOOR.vertices + (0, 0, 1.6))
"""The floor with shading normals that lean outwards, by 32 degrees at a distance of 1 from its middle."""
ABOVE: QuadLight = QuadLight((-0.5, -0.5, 2), (0, 1, 0), (1, 0, 0), (5, 4, 3))
"""A lamp 2 above the floor that shines downwards."""
BELOW = QuadLight((-0.5, -0.5, -2), (1, 0, 0), (0, 1, 0), (5, 4, 3))
"""A lamp 2 below the floor that shines upwards."""
UNIFORM_SKY = EnvironmentLight(np.ones((1, 1, 3)))
"""The same radiance from all directions, those between the horizons of floor and shading normal among them."""


def box_scene(
    material: Material | None = None,
    lights: tuple[Light, ...] = (ABOVE,),
    extra: tuple[Part, ...] = (),
    resolution: tuple[int, int] = (16, 16),
    eye: tuple[float, float, float] = (0.0, -3.0, 2.0),
    target: tuple[float, float, float] = (0.0, 0.0, 0.0),
    fov: float = 40.0,
    floor: Mesh = FLOOR,
) -> Scene:
    """Return a scene of the `floor` under `lights`, and of the parts `extra`."""
    camera = Camera.look_at(eye, target, fov=fov, resolution=resolution)
    return Scene(camera, (Part(floor, material or matte(0.6)), *extra), lights)


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
    group = make_group(batch_key(Part(FLOOR, material)), [(material, None)])
    uv = np.full((2, count), 0.5, np.float32)
    normal, wo, dpdu = (np.repeat(np.array(v, np.float32).reshape(3, 1), count, axis=1) for v in (n, wo, dpdu))
    return ShadingPoints(
        p=np.zeros((3, count), np.float32),
        ng=normal,
        n=normal,
        wo=wo,
        cos_o=(normal * wo).sum(axis=0),
        outside=np.full(count, outside),
        dpdu=dpdu,
        epsilon=np.float32(0),
        **bind_lobes(group, None, uv),
    )


def compare_techniques(scene: Scene, level: float, advice: str, spp: int = 64) -> str:
    """Return the means of renders by light samples, BRDF samples and both, or raise a Fault: see `compare_means`."""
    rules = [("light samples (fixed:1)", "fixed:1"), ("BRDF samples (fixed:0)", "fixed:0"), ("both", "balance")]
    return compare_means(scene, rules, level, advice, spp)


def compare_means(
    scene: Scene, rules: Sequence[tuple[str, Rule | str]], level: float, advice: str, spp: int = 64
) -> str:
    """Render a scene by `rules`, each with its name for messages, and return the means.

    Raise a `Fault`, whose message ends with `advice`, if a mean differs from the first at the significance `level`. A
    rule whose noise comes from a few pixels, of a lobe that its samples hardly ever meet, is named and not compared,
    because its standard error is not known.
    """
    options: dict[str, Any] = {"settings": Settings(integrator="direct"), "parallel": 1}
    results = [(name, render(scene, rule, spp, seed=k, **options)) for k, (name, rule) in enumerate(rules)]
    means = [(name, *mean_of_image(result, results[0][1].image)) for name, result in results]
    text = f"mean radiance {', '.join(f'{name} {mean:.4g} ± {error:.2g}' for name, mean, error, _ in means)}"
    _, first, first_error, first_noisy = means[0]
    noisy = [name for name, *_, is_noisy in means[1:] if is_noisy or first_noisy]
    for name, mean, error, _ in means[1:]:
        z = (mean - first) / max(np.hypot(error, first_error), 1e-6 * abs(first), 1e-30)
        if abs(z) > z_limit(level) and name not in noisy:
            raise Fault(f"{text} (z = {z:.1f} of {name}). {advice}")
    return text if not noisy else f"{text}; too noisy to compare: {', '.join(noisy)}"


def mean_of_image(result: Result, other: Array) -> tuple[float, float, bool]:
    """Return the mean of an image, its standard error, and whether its noise comes from a few of its pixels.

    Pixels are independent, channels are taken as fully dependent. The variance of a pixel of one sample is unknown; the
    squared difference to the `other` image stands for it.
    """
    variance = np.where(np.isnan(result.variance), np.square(result.image - other), result.variance).astype(float)
    error = np.linalg.norm(np.sqrt(variance).mean(axis=2)) / variance[..., 0].size
    of_pixels = variance.mean(axis=2)
    few = of_pixels.any() and of_pixels.sum() ** 2 / (of_pixels**2).sum() < 12
    return float(result.image.mean(dtype=float)), float(error), bool(few)
