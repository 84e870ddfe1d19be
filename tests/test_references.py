"""Converged images against pbrt-v2's, on the thesis's original scenes. Minutes: `make test-slow`."""

import warnings
from functools import lru_cache

import numpy as np
import pytest
from agreement import block_error
from helpers import channels_z

import dmis
from dmis.fit.registry import RULES

pytestmark = pytest.mark.slow
LIMITS = {"killeroo-diffuse": 0.006, "killeroo-gold": 0.015, "teapot-area-light": 0.006, "env": 0.015}


@lru_cache(len(LIMITS))
def load(path):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return dmis.load_scene(path)


@lru_cache(len(LIMITS))
def balance(path):
    return dmis.render(load(path), "balance", 256, seed=11)


def dark_blocks(image, reference):
    """Of env only the blocks that the visible light probe does not fill, as images of one block each."""
    size = 8
    height, width = (n // size * size for n in reference.shape[:2])
    shape = height // size, size, width // size, size, 3
    cropped = (a[:height, :width].reshape(shape) for a in (image, reference))
    blocks = [a.swapaxes(1, 2).reshape(-1, size, size, 3) for a in cropped]
    keep = blocks[1].mean(axis=(1, 2, 3)) < 0.1
    return [np.concatenate(list(b[keep])) for b in blocks]


@pytest.mark.parametrize("name", LIMITS)
def test_balance_converges_to_pbrt(pbrt_scenes, references, name):
    """At 1024 spp: each channel's mean within 0.3 %, and 8x8 blocks within the limit that their noise allows."""
    reference = np.load(references / f"{name}.npz")["mean"].astype(float)
    image = dmis.render(load(pbrt_scenes / f"{name}.pbrt"), "balance", 1024).image.astype(float)
    np.testing.assert_allclose(image.mean(axis=(0, 1)), reference.mean(axis=(0, 1)), rtol=0.003)
    if name == "env":
        image, reference = dark_blocks(image, reference)
    assert block_error(image, reference) < LIMITS[name]


@pytest.mark.parametrize("name", LIMITS)
@pytest.mark.parametrize(
    "rule",
    [
        "fixed:0",
        "fixed:0.25",
        *(rule for rule in RULES if rule not in ("balance", "uniform")),
        *(f"second-moment:combiner={combiner}" for combiner in ("power", "maximum", "cutoff")),
    ],
)
def test_every_mixture_has_the_same_mean(pbrt_scenes, name, rule):
    """The mean over the image differs from the balance heuristic's by noise: |z| < 4 in every channel."""
    path = pbrt_scenes / f"{name}.pbrt"
    a, b = balance(path), dmis.render(load(path), rule, 128, seed=12)
    z = channels_z(a, b)
    assert np.abs(z).max() < 4, z
