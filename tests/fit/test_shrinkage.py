"""Shrinkage on planted curves: what agrees becomes one, what surely differs stays as it is."""

from copy import deepcopy
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from dmis.base.patches import row_blocks
from dmis.base.vectors import Array
from dmis.fit.curve_minimum import PatchCurves
from dmis.fit.registry import make_rule
from dmis.fit.rule import Pilot
from dmis.fit.shrinkage import shrink_in_place
from dmis.variance.curves import GRID, HALF
from dmis.variance.moments import Moments

SHAPE = (24, 24)
PIXELS = 16


def planted(best: Array | float, noise: float, seed: int = 1, spread: float = 2.0) -> tuple[PatchCurves, Array]:
    """Noisy curves of patches whose brightness varies over orders of magnitude, and the true ones.

    The true curves are parabolas about the weights `best`, 1 at w = 1/2 for the same shape everywhere; `noise` is the
    standard error of a patch's curve at a weight, relative to its brightness.
    """
    rng = np.random.default_rng(seed)
    shape = 1 + 2 * ((GRID[:, None, None] - best) ** 2 - (0.5 - np.asarray(best)) ** 2)
    true = np.broadcast_to(shape, (len(GRID), *SHAPE)) * np.exp(rng.normal(0, spread, SHAPE))
    normal = rng.normal(size=(*true.shape, PIXELS))
    pixels = true[..., None] + noise * np.sqrt(PIXELS) * true[HALF, :, :, None] * normal
    curve, cross = pixels.mean(axis=-1), (pixels * pixels[HALF]).mean(axis=-1)
    return PatchCurves(
        curve, (pixels**2).mean(axis=-1), cross, np.zeros_like(cross), np.zeros(SHAPE), np.full(SHAPE, float(PIXELS))
    ), true


def shrink(curves: PatchCurves, kinds: Array | None = None, **change: Any) -> PatchCurves:
    """Shrunk copies of the curves."""
    return shrink_in_place(deepcopy(curves), kinds, **change)


def minima(curves: PatchCurves) -> Array:
    return GRID[curves.curve.argmin(axis=0)]


def error(curves: PatchCurves, true: Array) -> float:
    """Root mean square of the errors of the shapes, given the scale V(1/2), relative to the true one."""
    return float(np.sqrt(np.mean((curves.curve / true[HALF] - curves.curve[HALF] * true / true[HALF] ** 2) ** 2)))


def test_equal_curves_become_one() -> None:
    """Under noise that scatters the minima of single patches, all take the same one, the true one."""
    curves, _ = planted(0.27, 0.1)
    assert len(np.unique(minima(curves))) > 3
    shrunk = shrink(curves)
    assert np.mean(minima(shrunk) == np.float32(0.27)) > 0.97
    assert np.abs(minima(shrunk) - 0.27).max() < 0.12


def test_different_groups_stay() -> None:
    """Two shapes with little noise: hardly anything moves, and both keep their minima."""
    best = np.where(np.arange(SHAPE[1]) < 12, 0.08, 0.92)[None].repeat(SHAPE[0], 0)
    curves, _ = planted(best, 0.01)
    shrunk = shrink(curves)
    moved = np.abs(shrunk.curve - curves.curve) / curves.curve[HALF]
    assert moved.max() < 0.005  # half a standard error
    assert np.mean(minima(shrunk) == minima(curves)) > 0.98
    assert np.abs(minima(shrunk) - best).max() < 0.12


def test_kinds_do_not_speak_for_one_another() -> None:
    """Few patches of one material among many of another: both get their own minimum, which one kind for all misses."""
    few = np.zeros(SHAPE)
    few[:, :4] = 1
    curves, _ = planted(np.where(few, 0.73, 0.27), 0.2)
    minimum = minima(shrink(curves, np.stack([few, 1 - few])))
    at_few, at_many = (np.abs(minimum[few == k] - best) for k, best in ((1, 0.73), (0, 0.27)))
    assert np.mean(at_few < 0.12) > 0.95 and np.mean(at_many < 0.12) > 0.95
    assert np.mean(np.abs(minima(shrink(curves))[few == 1] - 0.73) < 0.12) < 0.8


def test_mixed_and_black_kinds() -> None:
    """A patch of two kinds has a shape in between; a kind without light is no kind; one kind for all is none."""
    curves, _ = planted(np.where(np.arange(SHAPE[1]) < 12, 0.16, 0.84)[None].repeat(SHAPE[0], 0), 0.05)
    left = np.zeros(SHAPE)
    left[:, :12] = 1
    left[0, 0] = 0.5
    curve = curves.curve.copy()
    curve[:, 1, 1] = 0
    dark = np.zeros(SHAPE)
    dark[1, 1] = 1
    kinds = np.stack([left, 1 - left, 0 * left]) * (1 - dark) + dark * np.array([0, 0, 1])[:, None, None]
    curves = replace(curves, curve=curve, square=np.maximum(curves.square, curve * curve))
    shrunk = shrink(curves, kinds)
    assert np.isfinite(shrunk.curve).all() and (shrunk.curve[HALF] >= 0).all()
    assert 0.16 < minima(shrunk)[0, 0] < 0.84
    alone = shrink(curves, np.ones((1, *SHAPE)))
    np.testing.assert_allclose(alone.curve, shrink(curves).curve)


@pytest.mark.parametrize("noise", [0.03, 0.1, 0.3])
def test_it_is_closer_to_the_truth(noise: float) -> None:
    """Than both extremes, the patches' own curves and the image's alone, with a continuum of shapes."""
    best = np.random.default_rng(2).uniform(0.3, 0.7, SHAPE)
    curves, true = planted(best, noise)
    shrunk = shrink(curves)
    rho = curves.curve.sum(axis=(1, 2)) / curves.curve[HALF].sum()
    same = replace(curves, curve=rho[:, None, None] * curves.curve[HALF])
    assert error(shrunk, true) < min(error(curves, true), error(same, true))


@pytest.mark.parametrize("noise", [0.03, 0.1])
def test_errors_are_those_of_the_result(noise: float) -> None:
    """The standard error of the gain covers the true one: of its shape, given the scale V(1/2)."""
    best = np.random.default_rng(2).uniform(0.3, 0.7, SHAPE)
    curves, true = planted(best, noise, spread=0.5)
    shrunk = shrink(curves)
    e = shrunk.gain_error()
    others = np.arange(len(GRID)) != HALF
    gain = (shrunk.curve - shrunk.curve[HALF] * true / true[HALF])[others]
    assert 0.8 < np.sqrt(np.mean((gain / e[others]) ** 2)) < 1.25
    np.testing.assert_allclose(e[HALF], 0, atol=1e-6 * curves.curve[HALF].max())


def test_brightness_does_not_matter() -> None:
    """Scaled curves, scaled results; one bright patch among dim ones is moved like them."""
    curves, _ = planted(0.27, 0.1)
    for k in (1e-6, 1e6):
        scaled = replace(curves, curve=curves.curve * k, square=curves.square * k * k, cross=curves.cross * k * k)
        np.testing.assert_allclose(shrink(scaled).curve, shrink(curves).curve * k, rtol=1e-9)


def test_negative_and_black_patches() -> None:
    """A patch whose V(1/2) came out negative takes the image's minimum, not its maximum; black ones stay black."""
    curves, _ = planted(0.27, 0.05)
    curve, square, cross = curves.curve.copy(), curves.square.copy(), curves.cross.copy()
    curve[:, 0, 0] *= -0.1
    square[:, 0, 0] *= 5  # so noisy that its sign says nothing
    curve[:, 1, 1] = square[:, 1, 1] = cross[:, 1, 1] = 0
    shrunk = shrink(replace(curves, curve=curve, square=square, cross=cross))
    assert minima(shrunk)[0, 0] == np.float32(0.27)
    assert (shrunk.curve[:, 1, 1] == 0).all() and np.isfinite(shrunk.square).all()
    black = np.zeros_like(curve)
    assert (shrink(PatchCurves(black, black, black, black, black[0], curves.pixels)).curve == 0).all()


def test_one_patch_is_its_own_image() -> None:
    """Nothing to learn from."""
    curves, _ = planted(0.27, 0.05)
    one = PatchCurves(**{name: a[..., :1, :1] for name, a in vars(curves).items() if name != "baseline"})
    np.testing.assert_allclose(shrink(one).curve, np.where(one.curve[HALF] > 0, one.curve, 0), rtol=1e-9)


@pytest.mark.parametrize("filter_", ["none", "gaussian", "joint"])
def test_every_filter(filter_: str) -> None:
    """Shrinkage follows any of them, and finds the planted minimum where it is the same everywhere."""
    curves, _ = planted(0.27, 0.1)
    names = ("curve", "square", "cross", "pattern", "position")
    sums = {name: getattr(curves, name) * PIXELS for name in names}
    side = 4 * SHAPE[0]
    moments = Moments(6, np.ones((side, side, 3)), np.ones((side, side, 3)))
    pilot = {0.5: Pilot(moments, {"camera": 100}, sums, features={"normal": np.zeros((3, *SHAPE))})}
    weight = make_rule(f"second-moment:combiner=balance,cost=no,guard=0,shrink=yes,filter={filter_}").fit(pilot).weight
    assert np.mean(weight == np.float32(0.27)) > 0.95


@pytest.mark.parametrize("kinds", [False, True])
def test_some_rows_at_a_time(kinds: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    """Neither how many nor where the result is written makes a difference."""
    curves, _ = planted(0.27, 0.1)
    of = np.random.default_rng(3).dirichlet(np.ones(3), SHAPE).transpose(2, 0, 1) if kinds else None
    whole, copy = shrink(curves, of), deepcopy(curves)
    monkeypatch.setattr("dmis.fit.shrinkage.row_blocks", lambda rows: row_blocks(rows, 5))
    assert shrink_in_place(copy, of) is copy
    for name in ("curve", "square", "cross"):
        np.testing.assert_allclose(getattr(copy, name), getattr(whole, name), rtol=1e-9)


def test_it_needs_curves() -> None:
    """Other objectives have none."""
    with pytest.raises(ValueError, match="shrink needs variances, which objective kl does not"):
        make_rule("kl:shrink=yes")
