"""Variance curves from one pilot: closed forms, unbiasedness, and what renders measure."""

import itertools
from dataclasses import replace

import numpy as np
import pytest
from helpers import image_tile, pixel_shares
from planted import exact, f, pilot, unbiased

import dmis
from dmis.brdf.materials import matte, plastic
from dmis.estimator.patterns import SHARES
from dmis.estimator.records import Record, Wants
from dmis.estimator.settings import Settings
from dmis.fit.pooling import PatchCurves
from dmis.fit.round import Round
from dmis.fit.second_moment import SecondMoment
from dmis.geometry.shapes import quad
from dmis.light.area import QuadLight
from dmis.pipeline.tile import render_tile
from dmis.scene.groups import Part
from dmis.testing.scenes import box_scene
from dmis.variance.curves import GRID, HALF, Curves, PatternCurves, share_variance


@pytest.mark.parametrize("count, s", [(2, 2), (6, 2), (3, 4)])
def test_curve_is_unbiased(count: int, s: int) -> None:
    """Curve and Var_y(I) of one light are unbiased, from 2, 3 and 6 camera samples alike.

    The ends of the grid have no finite variance here (p_l = 0 at one end of the interval), so they are left out.
    """
    sums = pilot(40_000, count, seed=count, s=s).sums()
    assert unbiased(sums["position"], exact(0.5, s)[1])
    for g in range(1, len(GRID) - 1):
        total, position = exact(float(GRID[g]), s)
        values = sums["curve"][g]
        assert unbiased(values, total - position)
        assert values.std() / np.sqrt(len(values)) < 0.05 * exact(0.5, s)[0]


@pytest.mark.parametrize("combiner", ["power", "power-3", "power-9", "maximum", "cutoff-0.5"])
def test_curves_of_other_heuristics(combiner: str) -> None:
    """The pilot of the balance heuristic gives unbiased curves of the other heuristics."""
    sums = pilot(40_000, 6, seed=7, combiner=combiner).sums()
    assert unbiased(sums["position"], exact(0.5, 2)[1])
    for g in range(1, len(GRID) - 1):
        total, position = exact(float(GRID[g]), 2, combiner)
        assert unbiased(sums["curve"][g], total - position)


def test_surfaces_of_a_path_add_up() -> None:
    """One surface, then two that see the same y: their own noise adds up, and uneven counts go along, so that Var_y(D)
    is nine times that of one.
    """
    s = 2
    curves = pilot(20_000, 6, seed=3, keys=((0,), (1, 0), (4, 0)), s=s)
    sums = curves.sums()
    assert unbiased(sums["position"], 9 * exact(0.5, s)[1])
    for g in (1, 4, HALF, 9):
        w = float(GRID[g])
        total, position = exact(w, s)
        part = w * s % 1
        rounding = part * (1 - part) / s**2
        pattern = _pattern(w)
        assert unbiased(sums["curve"][g], 3 * (total - position - rounding * pattern) + 9 * rounding * pattern)
        assert unbiased(sums["pattern"][g], 9 * pattern)


def _pattern(w: float) -> float:
    """Var_y(D) of the planted integrand, by quadrature."""
    x, y = ((np.arange(20_000) + 0.5) / 20_000)[:, None], (np.arange(400) + 0.5) / 400
    p_l, p_b = 2 * x, 2 * (1 - x)
    return float(((p_l - p_b) * f(x, y) / (w * p_l + (1 - w) * p_b)).mean(axis=0).var())


def test_curves_predict_paths() -> None:
    """The variance of rendered paths, over many seeds, is what pilots at 1/2 say of each weight."""
    lamp = QuadLight((-0.7, -0.7, 1.6), (0, 1.4, 0), (1.4, 0, 0), (4, 4, 4))
    walls = (
        Part(quad((-4, 1, 0), (8, 0, 0), (0, 0, 4)), matte((0.8, 0.3, 0.2))),
        Part(quad((-1.5, -4, 0), (0, 8, 0), (0, 0, 4)), plastic((0.2, 0.5, 0.3), 0.4, 0.02)),
    )
    room = box_scene(plastic(0.5, 0.3, 0.02), (lamp,), walls, resolution=(24, 24)).crop((0, 8, 24, 24))
    paths = dmis.Settings(integrator="path", max_depth=4, sampler="independent")
    rule = SecondMoment(patch=32, spp=512, filter="none")
    predicted = dmis.render(room, rule, 513, settings=paths).maps["variances"][:, 0, 0]
    for g in (HALF - 2, HALF + 2):
        rendered = f"fixed:{GRID[g]}"
        images = [dmis.render(room, rendered, 64, seed=s, settings=paths).image.mean(axis=2) for s in range(24)]
        measured = np.var(images, axis=0, ddof=1).mean() * 64
        assert measured == pytest.approx(predicted[g], rel=0.07)  # four standard errors of both


def test_standard_error_of_the_gain() -> None:
    """`PatchCurves.gain_error` from the sums over pixels agrees with the standard error computed from the pixels."""
    sums = pilot(500, 6, seed=4).sums()
    pooled = PatchCurves(**{name: a.mean(axis=-1) for name, a in sums.items()}, pixels=np.array(500))
    gain = sums["curve"] - sums["curve"][HALF]
    np.testing.assert_allclose(pooled.gain_error(), gain.std(axis=1, ddof=1) / np.sqrt(500), rtol=1e-5, atol=1e-9)
    assert pooled.gain_error()[HALF] == pytest.approx(0, abs=1e-9)


def test_black_pixels() -> None:
    """A pilot without records has curves of 0, and so has one whose samples towards a light are all occluded.

    One camera sample has no variance.
    """
    record = Record(0, (0,), 0, np.arange(6), np.zeros((3, 6), np.float32), np.ones((2, 6), np.float32))
    for records in ([], [record]):
        curves = Curves(2, 4, combiner="power")
        curves.add(records, np.zeros((3, 6), np.float32), 3)
        assert all((a == 0).all() for a in curves.sums().values())
    with pytest.raises(ValueError, match="at least two camera samples"):
        Curves(4, 4).add([], np.zeros((3, 4), np.float32), 1)


def test_blocks_without_records_count() -> None:
    """As many camera samples again that meet no light halve all sums."""
    curves = pilot(50, 2, seed=1)
    before = curves.sums()
    curves.add([], np.zeros((3, 100), np.float32), 2)
    for name in ("curve", "pattern", "position"):
        np.testing.assert_allclose(curves.sums()[name], before[name] / 2)
    # gathered values are means over pairs
    gather = dmis.Gather(lambda x, d: x.mean(axis=0), 3, 4)
    value, pdf = np.full((3, 6), 0.7, np.float32), np.ones((2, 6), np.float32)
    gather.add([Record(k, (0,), i, None, value, pdf) for k in (0, 1) for i in (0, 1)], value, 2)
    np.testing.assert_allclose(gather.sums()["values"], [0.7, 0.7, 0.7], rtol=1e-6)


@pytest.mark.parametrize("w, combiner", [(0.08, "balance"), (0.27, "power")])
def test_curve_predicts_renders(box: dmis.Scene, w: float, combiner: str) -> None:
    """The variance of images rendered at w, over many seeds, agrees with V(w) from pilots at w = 1/2.

    Both are means over a part of the floor, where all variance comes from the shading samples.
    """
    floor = box.crop((0, 18, 10, 24))
    rule = SecondMoment(patch=32, spp=256, filter="none", combiner=combiner)
    fits = [
        dmis.render(floor, rule, 257, seed=s, sampler="independent").maps["variances"].mean(axis=(1, 2))
        for s in range(6)
    ]
    predicted = np.mean(fits, axis=0)[list(GRID).index(np.float32(w))]
    images = np.array(
        [
            dmis.render(floor, f"fixed:{w},combiner={combiner}", 64, seed=s, sampler="independent").image.mean(axis=2)
            for s in range(96)
        ]
    )
    measured = images.var(axis=0, ddof=1).mean() * 64
    assert measured == pytest.approx(predicted, rel=0.08)  # four standard errors of both


# Curves of patterns ---------------------------------------------------------------------------------------------------


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
