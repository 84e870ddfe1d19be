"""Shares of K techniques: planted answers in one dimension, agreement with two, and unbiased images."""

from __future__ import annotations

import itertools
from typing import Any

import numpy as np
import pytest
from helpers import Z_LIMIT, images_z_score, lamp_images, z_score

from dmis.base.vectors import Array
from dmis.estimator.allocation import systematic_counts
from dmis.estimator.records import Record
from dmis.fit.pooling import PatchCurves, guarded_argmin
from dmis.fit.registry import make_rule
from dmis.variance.moments import Film

pytestmark = pytest.mark.usefixtures("literature")


@pytest.fixture
def simplex(literature: Any) -> Any:
    """The module of the plug-in."""
    return literature.simplex


# One dimension ------------------------------------------------------------------------------------------------------
# On [0, 1]: 2 x, 2 (1 - x) and 6 x (1 - x), which are linearly independent; each is drawn from uniform numbers.


def density(x: Array) -> Array:
    return np.stack([2 * x, 2 * (1 - x), 6 * x * (1 - x)])


def draw(technique: int, rng: np.random.Generator, n: int) -> Array:
    if technique == 2:
        return np.sort(rng.random((3, n)), axis=0)[1]  # the median of three
    x = np.sqrt(rng.random(n))
    return x if technique == 0 else 1 - x


PLANTED = np.array([1 / 2, 1 / 3, 1 / 6])


def planted(x: Array, y: Array) -> Array:
    """A mixture: the shares `PLANTED` have no variance."""
    return PLANTED @ density(x)


def plain(x: Array, y: Array) -> Array:
    """Nothing in particular, different at every y in [0, 1]; 0 where densities are, so that variances are finite."""
    return x * (1 - x) * (0.25 + (1 + 2 * y) * x)


def pilot(simplex: Any, f: Any, pixels: int, count: int, exact=(True,) * 3, keys: int = 1, s: int = 2, seed: int = 1):
    """Records of s samples of each technique at equal shares, their radiance, and the sums of `SimplexCurves`.

    A technique that is not exact draws evenly, has ``2 x`` as its stand-in, and makes up for it.
    """
    rng, k, n = np.random.default_rng(seed), len(exact), pixels * count
    records, radiance, y = [], np.zeros(n), rng.random(n)
    for key, side, turn in itertools.product(range(keys), range(k), range(s)):
        x = draw(side, rng, n) if exact[side] else rng.random(n)
        pdf = density(x)[:k]
        for other in np.flatnonzero(~np.array(exact)):
            pdf[other] = 2 * x
        value = f(x, y) / pdf.mean(axis=0) * (1 if exact[side] else 2 * x)
        radiance += value / (k * s)
        value = np.repeat(value[None], 3, axis=0).astype(np.float32)
        records.append(Record(side, (key,), turn, None, value, pdf.astype(np.float32)))
    radiance = np.repeat(radiance[None], 3, axis=0).astype(np.float32)
    found = simplex.SimplexCurves(pixels, k * s, exact)
    found.add(records, radiance, count)
    return records, radiance, found.sums()


def variance(f: Any, w: Array, s: int, exact=(True, True, True)) -> float:
    """By quadrature: variance of a camera sample, less that of I(y), with systematic counts."""
    x = ((np.arange(20_000) + 0.5) / 20_000)[:, None]
    y = (np.arange(20) + 0.5) / 20
    q = density(x)[: len(w)]
    q[~np.array(exact)] = 2 * x
    p_w = np.maximum(np.einsum("k,kxy->xy", w, q), 1e-300)
    # of a technique that is not exact: f F / p_w, F = 2 x, under the density 1
    means, seconds = [], []
    for p, known in zip(q, exact, strict=True):
        factor, drawn = (1, p) if known else (2 * x, 1)
        means.append(np.mean(drawn * f(x, y) * factor / p_w, axis=0))
        seconds.append(np.mean(drawn * (f(x, y) * factor / p_w) ** 2, axis=0))
    offset = np.random.default_rng(1).random((len(w) - 1, 4000))
    at = np.arange(4000)
    shares = np.repeat(np.array(w)[:, None], 4000, axis=1)
    counts, _ = systematic_counts(shares, s, at, at * 0 + 3, offset)
    found, number = np.unique(np.array(counts), axis=1, return_counts=True)
    total = 0.0
    for n, share in zip(found.T, number / number.sum(), strict=True):
        mean = np.einsum("k,ky->y", n, means) / s
        at_y = np.einsum("k,ky->y", n, np.array(seconds) - np.array(means) ** 2) / s**2
        total += share * float(mean.var() + at_y.mean())
    return total - float(np.einsum("k,ky->y", w, means).var())


def test_a_mixture_has_no_variance_at_its_own_shares(simplex: Any) -> None:
    """f = p_1 / 2 + p_2 / 3 + p_3 / 6: at these shares every sample is 1, and nowhere else is V as small."""
    _, _, sums = pilot(simplex, planted, 20_000, 2)
    shares, _ = simplex.grid(3)
    curve = sums["curve"]
    best = int(curve.mean(axis=1).argmin())
    np.testing.assert_allclose(shares[:, best], PLANTED)
    assert abs(z_score(curve[best], 0.0)) < Z_LIMIT
    assert all(z_score(other, 0.0) > Z_LIMIT for other in np.delete(curve, best, axis=0))


@pytest.mark.parametrize("exact", [(True, True, True), (True, True, False), (True, True)])
@pytest.mark.parametrize("count, s", [(2, 2), (3, 4)])
def test_curves_are_unbiased(simplex: Any, exact: tuple[bool, ...], count: int, s: int) -> None:
    """At every point of the grid where f over the mixture is bounded, by quadrature."""
    _, _, sums = pilot(simplex, plain, 20_000, count, exact, s=s, seed=count)
    shares, _ = simplex.grid(len(exact))
    assert abs(z_score(sums["position"], 1 / 6**2 / 12)) < Z_LIMIT  # I(y) = 1 / 24 + (1 + 2 y) / 12
    for g, w in enumerate(shares.T):
        if (w[:2] > 0).all():
            assert abs(z_score(sums["curve"][g], variance(plain, w, s, exact))) < Z_LIMIT, w


@pytest.mark.parametrize("techniques", [2, 3, 4])
def test_grid(simplex: Any, techniques: int) -> None:
    """Points of the simplex, each once; those that leave techniques out have twins; equal shares of known densities."""
    shares, inside = simplex.grid(techniques)
    np.testing.assert_allclose(shares.sum(axis=0), 1)
    assert len(np.unique(shares.round(9), axis=1).T) == shares.shape[1]
    np.testing.assert_allclose(shares[:, inside], np.where(shares == 0, simplex.SMALLEST_SHARE, shares[:, inside]))
    np.testing.assert_allclose(shares[:, simplex.baseline_point((True,) * techniques)], 1 / techniques)
    exact = (True, True, False, False)[:techniques]
    np.testing.assert_allclose(shares[:, simplex.baseline_point(exact)], 0.5 * np.array(exact))


@pytest.mark.parametrize("shares", [(0.3, 0.7), (0.2, 0.5, 0.3), (0.0, 0.9, 0.1), (0.1, 0.2, 0.3, 0.4)])
@pytest.mark.parametrize("s", [2, 3])
def test_covariance_of_rounding(simplex: Any, shares: tuple[float, ...], s: int) -> None:
    """That of the counts of a camera sample, in the middle of its pixel."""
    at = np.arange(100_000)
    offset = np.random.default_rng(16).random((len(shares) - 1, len(at)))
    of_pixels = np.repeat(np.array(shares)[:, None], len(at), axis=1)
    counts, _ = systematic_counts(of_pixels, s, at, at * 0 + 5, offset)
    np.testing.assert_allclose(np.cov(counts) / s**2, simplex.rounding_covariance(shares, s), atol=2e-3)


# Images -------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "rule, settings",
    [
        ("simplex:light+brdf+uniform,guard=0,filter=gaussian", {}),
        ("simplex:brdf+resampled", {}),
        ("simplex:light+brdf+uniform+resampled,spp=8,filter=none,cost=no", {}),
        ("simplex", {"integrator": "path", "max_depth": 3}),
    ],
)
def test_images_are_unbiased(rule: str, settings: dict[str, Any]) -> None:
    """Against light and BRDF samples with the balance heuristic."""
    assert abs(images_z_score(lamp_images(rule, **settings), lamp_images("balance", 500, **settings))) < Z_LIMIT


def test_the_price_is_that_of_the_minimum(simplex: Any) -> None:
    """A technique of twice the cost and a quarter of the variance in all patches is taken, although at the price of
    where it is not taken that would be worse; one of half the variance is no better.
    """
    shares, inside = simplex.grid(3)
    at = simplex.baseline_point((True, True, False))
    cost = 1 + shares[2]
    for alone, taken in ((0.25, True), (0.55, False)):
        curve = np.broadcast_to((1 - (1 - alone) * shares[2])[:, None, None], (shares.shape[1], 2, 3))
        curves = PatchCurves(curve, (curve - curve[at]) ** 2, np.zeros((2, 3)), np.full((2, 3), 1e9), at)
        may = np.ones(shares.shape[1], bool)
        found = simplex.best_points(curves, cost, 1.5, may, np.full((2, 3), 16.0))
        assert (shares[2][found] == taken).all()
        np.testing.assert_array_equal(simplex.best_points(curves, 1e3 * cost, 1.5, may, np.full((2, 3), 16.0)), found)
        assert (guarded_argmin(curves, cost, 1.5, may, price=1.0) == at).all()  # that where it is not taken


def test_techniques_are_left_out_where_that_suits_the_image(simplex: Any) -> None:
    """Two patches of 16 and 4 pixels: 16 * .1 + 4 * 1.3 < 16 * .2 + 4, but not with 1.5 in place of 1.3."""
    shares, inside = simplex.grid(2)
    alone = int(shares[0].argmax())
    for harm, w in ((1.3, 1.0), (1.5, 1 - simplex.SMALLEST_SHARE)):
        curve = np.ones((shares.shape[1], 1, 2))
        curve[[alone, inside[alone]]] = [[[0.1, harm]], [[0.2, 1.0]]]
        sums = {"curve": curve, "gain_square": (curve - 1) ** 2, "position": np.zeros((1, 2))}
        sums = {name: a * [16, 4] for name, a in sums.items()}
        found = Film(2, *np.ones((2, 4, 5, 3)), {"camera": 100}, sums)
        fit = simplex.Simplex("light+brdf", filter="none", cost=False, guard=0.0).fit({0.5: found})
        np.testing.assert_allclose(fit.maps["patch"][0], [[w, 0.5]])


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("simplex:light", "mix must be two or more different techniques"),
        ("simplex:light+dark", "technique must be one of .*; got 'dark'"),
        ("simplex:light+brdf+uniform+resampled", "even multiple of 4, the number of techniques, .* 8; got 6"),
    ],
)
def test_texts(simplex: Any, text: str, message: str) -> None:
    assert make_rule("simplex:brdf+uniform,patch=8,cost=no") == simplex.Simplex("brdf+uniform", patch=8, cost=False)
    with pytest.raises(ValueError, match=message):
        make_rule(text)
