"""Fireflies: found where they were planted, counted in results and by the command line."""

import json

import numpy as np
import pytest

from dmis.cli.commands import main
from dmis.variance.fireflies import find_fireflies
from dmis.variance.moments import Moments


def image_of(samples):
    """Image and variance of ``(n, H, W, 3)`` samples."""
    moments = Moments.of(samples.astype(np.float64))
    return moments.mean, moments.m2 / (moments.n - 1) / moments.n


@pytest.mark.parametrize("n", [4, 64])
def test_planted_fireflies_are_found(n):
    """All of them, in noise and on the border, and nothing else."""
    rng = np.random.default_rng(n)
    samples = rng.gamma(2.0, 0.5, (n, 40, 50, 3))
    places = [(0, 0), (7, 9), (20, 49), (39, 3), (30, 30)]
    for row, column in places:
        samples[rng.integers(n), row, column] += 40 * n
    found = find_fireflies(*image_of(samples), n)
    assert sorted(zip(*(a.tolist() for a in np.nonzero(found)), strict=True)) == sorted(places)


def test_values_that_are_no_fireflies():
    """A lamp in one pixel, an edge of it, dark corners, black, unknown variance, an image of one pixel."""
    rng = np.random.default_rng(1)
    n = 64
    samples = rng.gamma(2.0, 0.5, (n, 20, 20, 3))
    samples[:, 4, 4] = 50  # lit by all its samples
    samples[: n // 4, 10, 10] = 50  # by a quarter
    samples[:, 14:] *= rng.random((n, 6, 20, 1)) < 0.02  # a corner that few samples reach
    image, variance = image_of(samples)
    assert find_fireflies(image, variance, n)[:14].sum() == 0
    assert find_fireflies(image, variance, n)[14:].mean() < 0.05  # median and error of the neighbours are 0 there
    assert not find_fireflies(0 * image, 0 * variance, n).any()
    assert not find_fireflies(image, np.full_like(image, np.nan), 1).any()
    assert not find_fireflies(image[:1, :1], variance[:1, :1], n).any()


def test_command_line(tmp_path, capsys):
    """Their number, of rare BRDF samples that meet a lamp, is printed and in the statistics."""
    out, stats = tmp_path / "a.exr", tmp_path / "a.json"
    words = ["render", "teapot-area-light", "-o", str(out), "--resolution", "32x32", "--spp", "16", "--rule", "fixed:0"]
    assert main([*words, "--stats", str(stats)]) == 0
    said = capsys.readouterr().out
    number = json.loads(stats.read_text())["fireflies"]
    assert number > 1 and f"{number} of 1,024 pixels look like noisy specks (fireflies)" in said


@pytest.mark.parametrize("colour", [(1, 1, 1), (1, 0, 0), (0, 0, 1)])
def test_fireflies_of_all_colours(colour):
    """What one sample carries is found, and what twenty carry is not, in grey as in blue."""
    rng = np.random.default_rng(0)

    def found(bright, k, n=64):
        samples = rng.exponential(size=(n, 9, 9))
        samples[:, 4, 4] = 0
        samples[:k, 4, 4] = bright * n / k
        coloured = samples[..., None] * np.array(colour)
        return find_fireflies(coloured.mean(axis=0), coloured.var(axis=0, ddof=1) / n, np.full((9, 9), n))[4, 4]

    assert np.mean([found(2.6, 1) for _ in range(100)]) > 0.95
    assert not any(found(8.0, 20) for _ in range(100))
