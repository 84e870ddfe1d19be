"""What docs/extending.md shows of lobes and lights works as it stands, outside the package."""

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers import Z_LIMIT, z_score

import dmis
from dmis.formats.load_scene import light_part
from dmis.testing.scenes import box_scene

TEXT = (Path(__file__).parent.parent / "docs" / "extending.md").read_text("utf-8")


@pytest.fixture(scope="module")
def page() -> dict[str, Any]:
    """Names that the blocks of the page define, each of which runs without the others."""
    names: dict[str, Any] = {}
    blocks = re.findall(r"^## (?:A lobe|A delta lobe|A light)\n.*?```python\n(.*?)```", TEXT, re.M | re.S)
    assert len(blocks) == 3
    for code in blocks:
        namespace: dict[str, Any] = {"__name__": "page"}
        exec(compile(code, "extending.md", "exec", dont_inherit=True), namespace)
        names |= namespace
    return names


def agree(scene: dmis.Scene) -> None:
    """Light sampling, BRDF sampling and the balance heuristic have the same mean."""
    settings = dmis.Settings(integrator="direct")

    def means(rule: str, first: int) -> np.ndarray:
        images = (dmis.render(scene, rule, 16, seed=s, settings=settings).image for s in range(first, first + 16))
        return np.array([image.mean() for image in images])

    light, brdf, both = means("fixed:0", 0), means("fixed:1", 100), means("balance", 200)
    assert both.mean() > 0
    assert abs(z_score(light, both)) < Z_LIMIT and abs(z_score(brdf, both)) < Z_LIMIT


def test_lobe(page: dict[str, Any]) -> None:
    agree(box_scene(dmis.Material((page["Dust"]((0.5, 0.4, 0.3)),))))


def test_textured_light(page: dict[str, Any]) -> None:
    lamp = page["Checks"](2.0)
    agree(box_scene(lights=(lamp,), extra=(light_part(lamp),)))


def test_camera_and_mirror_see_the_texture(page: dict[str, Any]) -> None:
    """The mirror shows the emission of the lamp times its colour, 8 or 1."""
    lamp = page["Checks"](2.0)
    mirror = dmis.Material((page["Tinted"]((1.0, 0.5, 0.25)),))
    scene = box_scene(mirror, (lamp,), (light_part(lamp),), eye=(0, -1, 1), target=(0, -0.5, 0), fov=60.0)
    image = dmis.render(scene, "balance", 4, settings=dmis.Settings(integrator="direct")).image
    assert np.isclose(image.max(), 8) and image[..., 0].min() < 2
    np.testing.assert_allclose(image[..., 2], image[..., 0] / 4, rtol=1e-5)
