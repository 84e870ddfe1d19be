"""The fast estimator against the readable one of docs/estimator.md: sample by sample, or in the mean."""

import re
from functools import cache
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import scipy.stats
from helpers import LEVEL, Z_LIMIT, image_tile, pixel_shares, shared_scene, tile_of

import dmis
from dmis.base.vectors import Array
from dmis.estimator.settings import Settings
from dmis.fit.round import Round
from dmis.pipeline.tile import render_tile
from dmis.samplers.streams import stream
from dmis.testing.scenes import box_scene
from dmis.variance.moments import Film, Moments

pytestmark = pytest.mark.examples
PAGE = Path(__file__).parents[2] / "docs" / "estimator.md"
CODE = re.findall(r"```python\n(.*?)```", PAGE.read_text("utf-8"), re.S)[0]
SEED = 3


@pytest.fixture
def page() -> SimpleNamespace:
    namespace: dict[str, Any] = {}
    exec(compile(CODE, str(PAGE), "exec"), namespace)
    return SimpleNamespace(**namespace, globals=namespace)


def four_lights() -> dmis.Scene:
    """A glossy floor that fills the image, with shadows, under an area light, a sky, a point and a distant light."""
    sky = np.ones((4, 8, 3), np.float32)
    sky[1, 2:4] = 6, 5, 4
    lights = (
        dmis.QuadLight((-0.5, -0.5, 2), (0, 1, 0), (1, 0, 0), (5, 4, 3)),
        dmis.EnvironmentLight(sky),
        dmis.PointLight((1, -1, 2), (2, 2, 3)),
        dmis.DistantLight((0.3, 0.2, -1), (0.5, 0.5, 0.5)),
    )
    triangle = dmis.Mesh(np.array([[0, 0, 1], [0.5, 0, 1], [0, 0.5, 1.0]]), np.array([[0, 1, 2]]))
    blocker = dmis.Part(triangle, dmis.matte(0))
    return box_scene(dmis.plastic((0.5, 0.3, 0.1), 0.3, 0.05), lights, (blocker,), fov=20.0)


def raster(scene: dmis.Scene) -> tuple[Array, Array]:
    width, height = scene.camera.resolution
    y, x = (a.reshape(-1).astype(np.float32) for a in np.mgrid[:height, :width])
    return x, y


@cache
def make_scene(name: str) -> dmis.Scene:
    return four_lights() if name == "four lights" else shared_scene(name, (24, 18))


LONG = "ten-lights"
"""Scene whose renders take several times as long as those of the others."""
PLAIN = [name for name in dmis.SHIPPED if not name.startswith("interior")]  # whose mirror and glass it does not follow
SCENES = [pytest.param(name, marks=pytest.mark.slow) if name == LONG else name for name in PLAIN]
SCENES.append("four lights")


def test_it_is_short() -> None:
    """At most sixty lines, docstrings and all."""
    assert len([line for line in CODE.split("\n") if line.strip()]) <= 60


@pytest.mark.parametrize("name", SCENES)
def test_camera_samples_are_equal(page: SimpleNamespace, name: str) -> None:
    """With the same random numbers each camera sample is the same up to rounding."""
    scene = make_scene(name)
    x, y = raster(scene)
    plain = page.radiance(scene, x, y, np.full(len(x), 0.5, np.float32), stream(SEED, 0, 0))
    fast = tile_of(scene, SEED, 1, 0.5)[0].reshape(-1, 3).T
    assert (fast > 0).mean() > 0.2
    np.testing.assert_allclose(fast, plain, rtol=1e-4, atol=1e-6 * plain.max())


class Shelf:
    """A statistic that keeps the records of shading samples."""

    records: list[Any]

    def __init__(self, pixels: int, shading_samples: int) -> None:
        Shelf.records = []

    def add(self, records: Any, radiance: Array, count: int) -> None:
        Shelf.records += records

    def sums(self) -> dict[str, Array]:
        return {}


def test_densities_and_values_are_equal(page: SimpleNamespace, monkeypatch: pytest.MonkeyPatch) -> None:
    """Of each shading sample that meets a light: p_l, p_b and f / p_w."""
    scene = four_lights()
    x, y = raster(scene)
    logged: list[tuple[Array, Array, Array]] = []

    def integrand(*arguments: Any) -> tuple[Array, Array, Array]:
        logged.append(plain_integrand(*arguments))
        return logged[-1]

    plain_integrand = page.globals["integrand"]
    monkeypatch.setitem(page.globals, "integrand", integrand)
    page.radiance(scene, x, y, np.full(len(x), 0.5, np.float32), stream(SEED, 0, 0))
    round_ = Round(1, pixel_shares(0.5), Settings(sampler="independent"), Shelf)
    render_tile(scene, image_tile(scene, SEED, round_))
    floor = [entry for entry in logged if entry[0].shape[1] == len(x)]  # four lights, two of them by two techniques
    assert len(floor) == 6 and len(Shelf.records) == 4
    for record, (f, p_l, p_b) in zip(Shelf.records, floor, strict=False):
        index = np.arange(len(x)) if record.sample is None else np.arange(len(x))[record.sample]
        assert len(index) > 10
        f, p_l, p_b = f[:, index], p_l[index], p_b[index]
        np.testing.assert_allclose(record.pdf, [p_l, p_b], rtol=1e-4)
        np.testing.assert_allclose(record.value, f / (p_l + p_b) * 2, rtol=1e-4, atol=1e-6)


@pytest.mark.parametrize("name", SCENES)
@pytest.mark.parametrize("w", ["0.3", "map"])
def test_images_agree(page: SimpleNamespace, name: str, w: str) -> None:
    """Where the fast estimator sorts its samples: pixels and the mean of the image, by z-tests."""
    scene, spp = make_scene(name), 64
    x, y = raster(scene)
    share = np.full(len(x), 0.3, np.float32) if w == "0.3" else np.linspace(0.1, 0.9, len(x), dtype=np.float32)
    samples = page.radiance(scene, *(np.tile(a, spp) for a in (x, y, share)), stream(SEED, 1, 0))
    plain = Moments.of(samples.mean(axis=0, dtype=float).reshape(spp, len(x)))
    round_ = Round(spp, pixel_shares(share), Settings(sampler="independent"))
    tile = render_tile(scene, image_tile(scene, SEED, round_, 2))
    fast = Film(spp, tile.mean, tile.root)
    # of the mean of the channels, which are taken as fully dependent
    deviation = np.sqrt(fast.variance()).mean(axis=-1).reshape(-1)
    error = np.sqrt((deviation**2 + plain.variance()) / spp)
    difference = fast.mean.mean(axis=-1).reshape(-1) - plain.mean
    assert abs(difference.sum() / np.sqrt((error**2).sum())) < Z_LIMIT
    z = difference[error > 0] / error[error > 0]
    assert np.abs(difference[error == 0]).max(initial=0) < 1e-5 * plain.mean.max()
    # a pixel with a rare spike is far from normal: count large deviates, and let each be a few times as likely
    large = scipy.stats.binom.sf((np.abs(z) > 3).sum() - 1, len(z), 3 * 2 * scipy.stats.norm.sf(3))
    assert len(z) > 50 and large > LEVEL
