"""What the kernels of the renderer cost on a batch as long as those of a render: ``make bench-kernels``.

Divide the times by `N` for nanoseconds per sample; the groups put side by side what a scene may choose from.
"""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from dmis.base.vectors import Array, dot, frame, normalise
from dmis.brdf import materials, models
from dmis.brdf.cosines import Directions
from dmis.brdf.texture import Image
from dmis.estimator.technique import SampledLight
from dmis.light.area import DiskLight, QuadLight, SphereLight
from dmis.light.environment import EnvironmentLight
from dmis.samplers import warp
from dmis.samplers.pixel_block import PixelBlock
from dmis.samplers.streams import SAMPLERS, Independent
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


@pytest.mark.benchmark(group="lobes: value")
@pytest.mark.parametrize("name", MATERIALS)
def test_eval(benchmark: Any, name: str) -> None:
    points = surface(name)
    assert np.isfinite(benchmark(lambda: points.eval(Directions(points, WI)))).all()


@pytest.mark.benchmark(group="lobes: density")
@pytest.mark.parametrize("name", MATERIALS)
def test_pdf(benchmark: Any, name: str) -> None:
    points = surface(name)
    assert benchmark(lambda: points.pdf(Directions(points, WI))).shape == (N,)


@pytest.mark.benchmark(group="lobes: direction")
@pytest.mark.parametrize("name", MATERIALS)
def test_sample(benchmark: Any, name: str) -> None:
    points = surface(name)
    assert benchmark(lambda: points.sample(U)).shape == (3, N)


@pytest.mark.benchmark(group="lights: sample")
@pytest.mark.parametrize("name", LIGHTS)
def test_light_sample(benchmark: Any, name: str) -> None:
    points = np.zeros((3, N), np.float32)
    assert benchmark(lambda: LIGHTS[name].sample(points, U).pdf).shape == (N,)


@pytest.mark.benchmark(group="lights: what a direction meets")
@pytest.mark.parametrize("name", LIGHTS)
def test_light_hit(benchmark: Any, name: str) -> None:
    points = np.zeros((3, N), np.float32)
    assert benchmark(lambda: LIGHTS[name].hit(points, WI).pdf).shape == (N,)


@pytest.mark.benchmark(group="warps")
@pytest.mark.parametrize("name", WARPS)
def test_warp(benchmark: Any, name: str) -> None:
    assert benchmark(lambda: WARPS[name](U)).shape[1] == N


@pytest.mark.benchmark(group="textures")
@pytest.mark.parametrize("side, channels", [(64, 3), (1024, 1), (1024, 3)])
def test_texture(benchmark: Any, side: int, channels: int) -> None:
    image = Image(RNG.random((side, side, channels)))
    assert benchmark(lambda: image(U)).shape == (channels, N)


@pytest.mark.benchmark(group="vectors")
@pytest.mark.parametrize("name", ["dot", "normalise", "frame", "atan2"])
def test_vectors(benchmark: Any, name: str) -> None:
    call = {
        "dot": lambda: dot(UP, WI),
        "normalise": lambda: normalise(WI),
        "frame": lambda: frame(WI)[0],
        "atan2": lambda: warp.atan2(WI[1], WI[0]),
    }[name]
    assert benchmark(call).shape[-1] == N


@pytest.mark.benchmark(group="random numbers")
@pytest.mark.parametrize("kind", tuple(SAMPLERS))
def test_random_numbers(benchmark: Any, kind: Any) -> None:
    pixels = 1024
    block = PixelBlock(np.random.default_rng(1), 1, np.arange(pixels), [N // pixels], 2)
    sampler = SAMPLERS[kind](block)
    sampler.start(np.tile(np.arange(pixels), N // pixels), np.repeat(np.arange(N // pixels), pixels))
    assert isinstance(sampler, Independent) == (kind == "independent")
    assert benchmark(lambda: sampler.draw("camera", None)).shape == (2, N)


@pytest.mark.benchmark(group="film")
def test_accumulation(benchmark: Any) -> None:
    samples = RNG.random((32, 3, N // 32), dtype=np.float32)
    assert benchmark(lambda: Moments.of(samples)).mean.shape == (3, N // 32)
