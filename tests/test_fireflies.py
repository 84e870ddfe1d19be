"""Fireflies: found where they were planted, and what it costs to remove them is measured."""

import json
from dataclasses import replace

import numpy as np
import pytest

import dmis
from dmis.__main__ import main
from dmis.fireflies import clamp, find_fireflies, median_of_means
from dmis.image import read_exr
from dmis.metrics import mean_and_error
from dmis.variance import Moments


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


def test_what_is_no_firefly():
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


def test_clamp_keeps_colours():
    """Only what exceeds the value is changed, and becomes it."""
    values = np.array([[1.0, 8, 0], [0.5, 4, 0], [0, 2, 4]], np.float32)
    np.testing.assert_allclose(clamp(values, 2), [[1, 2, 0], [0.5, 1, 0], [0, 0.5, 2]])
    assert clamp(values, 2).dtype == np.float32
    assert clamp(values, 8) is values


@pytest.fixture(scope="module")
def spiky(box):
    """The box under a small lamp, which BRDF sampling rarely meets: a sample that does is worth hundreds."""
    lamp = dmis.QuadLight((-0.25, -0.25, 3), (0, 0.5, 0), (0.5, 0, 0), (32, 32, 32))
    return replace(box, lights=(lamp,))


@pytest.fixture(scope="module")
def truth(spiky):
    """The converged image, by light sampling."""
    return dmis.render(spiky, "balance", 256, seed=99).image.astype(np.float64)


RENDERS = 9


@pytest.fixture(scope="module")
def renders(spiky):
    """BRDF sampling alone, with several seeds."""
    return [dmis.render(spiky, "fixed:0", 64, seed=seed) for seed in range(RENDERS)]


def lost(image, truth):
    """Share of the light that is missing, and its standard error over pixels."""
    mean, error = mean_and_error((np.asarray(image, np.float64) - truth).mean(axis=2))
    return -mean / truth.mean(), error / truth.mean()


def test_biases_are_what_they_are_called(spiky, truth, renders):
    """Without options no light is missing; with either, some of it is, beyond all doubt."""
    plain = np.mean([r.image for r in renders], axis=0)
    share, error = lost(plain, truth)
    assert abs(share) < 4 * error
    clamped = [dmis.render(spiky, "fixed:0", 64, seed=s, settings=dmis.Settings(clamp=1)) for s in range(RENDERS)]
    for biased in (np.mean([r.image for r in clamped], axis=0), median_of_means(renders).image):
        share, error = lost(biased, truth)
        assert share > 0.05 and share > 6 * error


def test_the_bias_of_clamping_stays_and_that_of_medians_vanishes(spiky, truth):
    """With eight times the samples."""
    shares = {}
    for spp in (32, 256):
        renders = [dmis.render(spiky, "fixed:0", spp, seed=seed) for seed in range(5)]
        shares["median", spp], _ = lost(median_of_means(renders).image, truth)
        image = dmis.render(spiky, "fixed:0", spp, seed=7, settings=dmis.Settings(clamp=1)).image
        shares["clamp", spp], _ = lost(image, truth)
    assert shares["median", 256] < shares["median", 32] / 2
    assert shares["clamp", 256] > 0.7 * shares["clamp", 32]


def test_results_know_their_fireflies(renders, spiky):
    """Many where samples are rare and strong, few where the lamp is sampled."""
    found = [r.fireflies for r in renders]
    assert all(one.shape == (24, 32) for one in found)
    assert dmis.render(spiky, "balance", 64, seed=1).fireflies.sum() < 0.1 * np.mean([one.sum() for one in found])


def test_pilots_are_clamped_too(spiky):
    """What a pilot brings to the image is under the same rule."""
    result = dmis.render(spiky, "thesis:reuse=yes", 16, settings=dmis.Settings(clamp=0.25))
    assert 0 < result.image.max() <= 0.25


def test_medians_say_what_they_are(renders):
    """Samples, rays and seeds of all; the bias has a name."""
    found = median_of_means(renders)
    np.testing.assert_array_equal(found.image, np.median([r.image for r in renders], axis=0))
    assert found.samples[0, 0] == 64 * RENDERS and found.rays["camera"] == sum(r.rays["camera"] for r in renders)
    assert found.provenance["seed"] == list(range(RENDERS))
    assert found.provenance["bias"] == [f"median of means of {RENDERS} renders"]
    assert "bias" not in renders[0].provenance


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda r: r[:2], "an odd number of at least 3, .* got 2"),
        (lambda r: [r[0], r[1], r[1]], "different seeds"),
        (lambda r: [*r[:2], replace(r[2], provenance={**r[2].provenance, "spp": 3})], "they differ in spp"),
    ],
)
def test_medians_of_what_does_not_belong_together(renders, change, message):
    """Are refused."""
    with pytest.raises(ValueError, match=message):
        median_of_means(change(renders))


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"clamp": 0}, "clamp must be a number from 1.17549e-38 to"),
        ({"clamp": float("nan")}, "clamp must be a number from 1.17549e-38 to"),
        ({"clamp": float("inf")}, "or None; got inf"),
        ({"clamp": 1e-300}, "clamp must be a number from 1.17549e-38 to"),
        ({"clamp": 1e39}, r"to 3.40282e\+38, a radiance that float32 holds in full, or None; got 1e\+39"),
        ({"clamp": "1"}, "clamp must be a number from .*; got '1'"),
        ({"clamp": 1.0, "combiner": "optimal"}, "clamp needs a combiner that adds up"),
    ],
)
def test_bad_values(options, message):
    """Have a message."""
    with pytest.raises(ValueError, match=message):
        dmis.Settings(**options)


def test_command_line(tmp_path, capsys):
    """The option, what is printed, what the file says."""
    out, stats = tmp_path / "a.exr", tmp_path / "a.json"
    words = ["render", "teapot-area-light", "-o", str(out), "--resolution", "32x32", "--spp", "16", "--rule", "fixed:0"]
    assert main([*words, "--stats", str(stats)]) == 0
    said = capsys.readouterr().out
    number = json.loads(stats.read_text())["fireflies"]
    assert number > 1 and f"{number} pixels look like fireflies" in said and "biased" not in said
    assert "bias" not in json.loads(read_exr(out)[1]["dmis.provenance"])
    assert main([*words, "--clamp", "0.5"]) == 0
    assert "biased: camera samples clamped at 0.5" in capsys.readouterr().out
    layers, about = read_exr(out)
    assert layers["RGB"].max() <= 0.5
    assert json.loads(about["dmis.provenance"])["bias"] == ["camera samples clamped at 0.5"]
    assert main([*words, "--clamp", "-1"]) == 2
    assert "clamp must be a number from 1.17549e-38 to" in capsys.readouterr().err


@pytest.mark.parametrize("gain", [1e-12, 1.0, 1e12])
def test_clamp_is_in_units_of_the_scene(gain):
    """However bright the lamp is, and in whatever units its light is computed for that."""
    lamp = dmis.DiskLight((0, 0, 3), (0, 0, -1), 1.0, (gain, gain, gain))
    floor = dmis.Part(dmis.geometry.quad((-2, -2, 0), (4, 0, 0), (0, 4, 0)), dmis.matte(0.5))
    scene = dmis.Scene(dmis.Camera.look_at((0, 0, 4), (0, 1e-4, 0), fov=30, resolution=(8, 8)), (floor,), (lamp,))
    image = dmis.render(scene, "balance", 64, settings=dmis.Settings(clamp=0.02 * gain)).image
    assert image.mean() == pytest.approx(0.02 * gain, rel=1e-3) and image.max() <= 0.02 * gain * (1 + 1e-6)


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
