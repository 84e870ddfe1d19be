"""What the kernels of the renderer cost on a batch as long as those of a render: ``make bench-kernels``.

Divide the times by `N` for nanoseconds per sample; the groups put side by side what a scene may choose from.
"""

from collections.abc import Callable, Iterable
from typing import Any

import numpy as np
import pytest

from dmis.base.vectors import Array, frame, normalise
from dmis.brdf import materials, models
from dmis.brdf.lobe import Directions
from dmis.brdf.texture import Image
from dmis.estimator.mis import SampledLight
from dmis.light.area import DiskLight, QuadLight, SphereLight
from dmis.light.environment import EnvironmentLight
from dmis.samplers import warp
from dmis.samplers.pixel_block import PixelBlock
from dmis.samplers.streams import SAMPLERS
from dmis.scene.shading_points import ShadingPoints
from dmis.variance.moments import Moments

N = 2**15
RNG = np.random.default_rng(1)
U = RNG.random((2, N), dtype=np.float32)
UP = np.repeat(np.array([[0], [0], [1]], np.float32), N, axis=1)
WI = warp.square_to_hemisphere(U[::-1])

MATERIALS = {
    "matte": materials.matte(),
    "plastic": materials.plastic(),
    "metal": materials.metal(),
    "substrate": materials.substrate(),
    "ward": models.ward(),
    "cook-torrance": models.cook_torrance(),
    "ggx": models.ggx(),
    "rough coat": models.coated_diffuse(alpha=0.3),
}
LIGHTS: dict[str, SampledLight] = {
    "disk": DiskLight((0, 0, 3), (0, 0, -1), 1.0, (1, 1, 1)),
    "quad": QuadLight((0, 0, 3), (1, 0, 0), (0, -1, 0), (1, 1, 1)),
    "sphere": SphereLight((0, 0, 3), 1.0, (1, 1, 1)),
    "sky 1024x512": EnvironmentLight(RNG.random((512, 1024, 3))),
}
WARPS: dict[str, Callable[[Array], Array]] = {
    "disk": warp.square_to_disk,
    "sphere": warp.square_to_sphere,
    "cosine": warp.square_to_cosine,
    "power": lambda u: warp.square_to_power(u, np.array(50, np.float32)),
}


def surface(name: str) -> ShadingPoints:
    """Points at the origin, seen from all over the hemisphere."""
    wo = warp.square_to_hemisphere(U)
    return ShadingPoints(
        p=np.zeros((3, N), np.float32), ng=UP, n=UP, wo=wo, cos_o=wo[2], outside=np.ones(N, bool), dpdu=None,
        reflection=MATERIALS[name].lobes, delta=(),
    )  # fmt: skip


POINTS = {name: surface(name) for name in MATERIALS}
ORIGINS = np.zeros((3, N), np.float32)
IMAGES = {f"{side}, {c} channels": Image(RNG.random((side, side, c))) for side, c in ((64, 3), (1024, 1), (1024, 3))}
VECTORS: dict[str, Callable[[Array], Any]] = {"normalise": normalise, "frame": lambda wi: frame(wi)[0]}


def numbers(kind: Any) -> Array:
    """Draw a pair of numbers for each sample of 1,024 pixels."""
    pixels = 1024
    block = PixelBlock(np.random.default_rng(1), 1, np.arange(pixels), [N // pixels], 2)
    sampler = SAMPLERS[kind](block)
    sampler.start(np.tile(np.arange(pixels), N // pixels), np.repeat(np.arange(N // pixels), pixels))
    return sampler.draw("camera", None)


GROUPS: dict[str, tuple[Iterable[str], Callable[[str], Any]]] = {
    "lobes: value": (MATERIALS, lambda name: POINTS[name].eval(Directions(POINTS[name], WI))),
    "lobes: density": (MATERIALS, lambda name: POINTS[name].pdf(Directions(POINTS[name], WI))),
    "lobes: direction": (MATERIALS, lambda name: POINTS[name].sample(U)),
    "lights: sample": (LIGHTS, lambda name: LIGHTS[name].sample(ORIGINS, U).pdf),
    "lights: what a direction meets": (LIGHTS, lambda name: LIGHTS[name].hit(ORIGINS, WI).pdf),
    "warps": (WARPS, lambda name: WARPS[name](U)),
    "textures": (IMAGES, lambda name: IMAGES[name](U)),
    "vectors": (VECTORS, lambda name: VECTORS[name](WI)),
    "random numbers": (SAMPLERS, numbers),
    "film": (["moments"], lambda name: Moments.of(U.reshape(2, 32, -1).swapaxes(0, 1)).mean),
}
"""Kernels by group: names, and what is called with each."""


@pytest.mark.parametrize("group, name", [(group, name) for group, (names, _) in GROUPS.items() for name in names])
def test_kernel(benchmark: Any, group: str, name: str) -> None:
    benchmark.group = group
    assert np.isfinite(benchmark(GROUPS[group][1], name)).all()
