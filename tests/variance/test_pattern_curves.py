"""Curves at the shares of patterns: kept apart by colour, and the same in sum."""

import itertools
from dataclasses import replace

import numpy as np
import pytest
from helpers import image_tile, pixel_shares

import dmis
from dmis.estimator.patterns import SHARES
from dmis.estimator.records import Record, Wants
from dmis.estimator.settings import Settings
from dmis.fit.round import Round
from dmis.pipeline.tile import render_tile
from dmis.variance.curves import Curves, PatternCurves, share_variance


class Whole(PatternCurves):
    """The same, not kept apart."""

    wants = Wants()


def plain(pixels: int, shading_samples: int) -> Curves:
    """Return curves at the same shares whose numbers of samples are rounded at random."""
    return Curves(pixels, shading_samples, grid=SHARES)


def test_colours_add_up_to_the_curves(box: dmis.Scene) -> None:
    """In patches that the tile cuts, too."""
    scene = box.crop((0, 0, 30, 22))
    settings = Settings(shading_samples=4, integrator="direct", sampler="sobol")
    by_colour, whole, rounded = (
        render_tile(scene, image_tile(scene, 1, Round(8, pixel_shares(0.5), settings, statistic))).sums
        for statistic in (PatternCurves, Whole, plain)
    )
    for name, a in by_colour.items():
        assert a.shape == (4, *whole[name].shape) and a[:, ..., :4].any()
        np.testing.assert_allclose(a.sum(axis=0), whole[name], rtol=1e-9, atol=1e-12)
    np.testing.assert_array_equal(rounded["position"], whole["position"])
    extra = share_variance(2, SHARES)[:, None, None] * rounded["pattern"]
    np.testing.assert_allclose(rounded["curve"] - extra, whole["curve"], rtol=1e-6, atol=1e-6 * whole["curve"].max())


@pytest.mark.parametrize("colour", range(4))
def test_sums_of_a_colour_come_from_its_pixels(box: dmis.Scene, colour: int) -> None:
    """Whose rows and columns are even or odd in the image."""
    settings = Settings(shading_samples=4, integrator="direct", sampler="sobol")
    round_ = Round(4, pixel_shares(0.5), settings, PatternCurves)
    sums = render_tile(box, image_tile(box, 1, round_)).sums
    statistic: list[PatternCurves] = []

    def kept(pixels: int, shading_samples: int) -> Whole:
        statistic.append(Whole(pixels, shading_samples))
        return statistic[0]

    render_tile(box, image_tile(box, 1, replace(round_, statistic=kept)))
    image = statistic[0].sums()["curve"].reshape(len(SHARES), 6, 4, 8, 4)
    of_colour = image[:, :, colour // 2 :: 2, :, colour % 2 :: 2].sum(axis=(2, 4))
    np.testing.assert_allclose(sums["curve"][colour], of_colour, rtol=1e-9)


def test_variances_of_each_light_and_of_the_rest() -> None:
    """Four shading samples of a lamp and of a light behind those told apart; the lamp at the second surface is rest."""
    rng, n = np.random.default_rng(2), 6 * 5
    statistic, radiance = PatternCurves(5, 4, lights=1), rng.random((3, n), np.float32)
    parts, records = {key: np.zeros((3, n), np.float32) for key in ((0,), (1,), (0, 0))}, []
    for key, side, turn in itertools.product(parts, (0, 1), (0, 1)):
        value = rng.random((3, n), np.float32)
        records.append(Record(side, key, turn, None, value, rng.random((2, n), np.float32)))
        parts[key] += value / 4
    statistic.add(records, radiance + sum(parts.values()), 6)
    rest = radiance + parts[1,] + parts[0, 0]
    expected = [part.mean(axis=0).reshape(6, 5).var(axis=0, ddof=1) for part in (parts[0,], rest)]
    np.testing.assert_allclose(statistic.sums()["lights"], expected, rtol=1e-4)
