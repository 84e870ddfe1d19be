"""Checks of exercises 16 to 18, of tutorial 5: missed spikes, second moments, an unbiased variance curve."""

from __future__ import annotations

from collections.abc import Iterator
from types import ModuleType

import numpy as np

from check_mis import densities, exact_variance, integrand
from dmis.base.vectors import Array
from dmis.testing.outcome import Outcome
from grading import between, call, compare, exercise, likely_mistake, seeded, z_test

_X = np.linspace(-4, 4, 20_001)
_W = np.array([0.05, 0.25, 0.5, 0.75, 0.95])


@exercise(16)
def samples_needed(module: ModuleType) -> Iterator[Outcome]:
    """Exercise 16: the chance to miss a spike, and the samples that make it small."""
    hit = round(between(0.01, 0.003, 0.03), 4)
    p, n = np.array([hit, hit, 0.5, 1e-12]), np.array([32, 512, 3, 10**12])
    (chance,) = call(module, "chance_of_no_hit", p, n, shapes=[(4,)])
    expected = np.array([(1 - hit) ** 32, (1 - hit) ** 512, 0.125, np.exp(-1)])
    yield compare("chance of no hit", chance, expected, 1e-5, "For tiny p take the logarithm: numpy.log1p")
    # no tie such as p = 1/2 and a chance of 1/8, where rounding decides between 3 and 4
    for p_one, wanted in ((0.5, 0.13), (hit, 0.01), (1e-3, 0.5), (0.25, 1.0)):
        number = np.ceil(np.log(wanted) / np.log1p(-p_one))
        (needed,) = call(module, "samples_needed", p_one, wanted, shapes=[()])
        yield compare(f"p = {p_one}, chance {wanted}: least number", needed, float(number), 1e-9, "Whole, rounded up")


@exercise(17)
def second_moment(module: ModuleType) -> Iterator[Outcome]:
    """Exercise 17: the second moment at every share, from samples of the mixture of both techniques alike."""
    # pilots of two samples, one of each technique: a ratio of two sums, such as a self-normalised estimate, is biased
    x_l, d_l, x_b, d_b = _pilot(5000, 1, samples=1)
    moments = _curves(module, "second_moment", np.concatenate([x_l, x_b]), np.concatenate([d_l, d_b]))
    p_l, p_b = densities(_X)
    exact = [float((integrand(_X) ** 2 / (w * p_l + (1 - w) * p_b)).sum() * (_X[1] - _X[0])) for w in _W]
    for k, w in enumerate(_W):
        yield z_test(f"w = {w}", moments[:, k], exact[k], "A sample at w is worth X q / p_w, and is drawn from q")
    ends = call(module, "second_moment", np.zeros(4), np.array([1.0, -1, 1, -1]), np.array([0.0, 1]), shapes=[(2,)])
    yield compare("samples of value 0 at the ends", ends[0], 0.0, 1e-6, "Where m is 0, a value of 0 stays 0")


@exercise(18)
def variance_curve(module: ModuleType) -> Iterator[Outcome]:
    """Exercise 18: an unbiased curve of variances from four samples."""
    pilot = _pilot(3000, 2, samples=2)
    curves = _curves(module, "variance_curve", *pilot)
    advice = likely_mistake(curves, _mistakes(*pilot), "The two groups have variances of their own")
    for k, w in enumerate(_W):
        exact = exact_variance(float(w), _X)
        yield z_test(f"w = {w}: two samples of each technique", curves[:, k], exact, advice)
    x = np.full(3, 2.0)
    curve = call(module, "variance_curve", x, 0 * x, x, 0 * x, _W, shapes=[_W.shape])[0]
    yield compare("equal samples have no variance", curve, 0.0, 1e-6)


def _curves(module: ModuleType, name: str, *samples: Array) -> Array:
    """Return what a function says of the samples ``(n, pixels)`` of each pixel, ``(pixels, G)``."""
    pixels = zip(*(x.T for x in samples), strict=True)
    return np.stack([call(module, name, *pixel, _W, shapes=[_W.shape])[0] for pixel in pixels])


def _mistakes(x_l: Array, d_l: Array, x_b: Array, d_b: Array) -> list[tuple[str, Array]]:
    """Return advice on a wrong curve, and the curves of each pixel that the mistake gives, ``(pixels, G)``."""
    y_l, y_b = (x[..., None] / (1 + (2 * _W - 1) * d[..., None]) for x, d in ((x_l, d_l), (x_b, d_b)))
    v_l, v_b = (y.var(axis=0, ddof=1) for y in (y_l, y_b))
    one = np.concatenate([y_l, y_b])
    groups = "One variance over all samples: take that of the light samples and that of the BRDF samples apart"
    return [
        (groups, one.var(axis=0)),
        (groups, one.var(axis=0, ddof=1)),
        ("The shares are swapped: w is that of the light samples", (1 - _W) * v_l + _W * v_b),
        ("The variances have no shares: w V_l + (1 - w) V_b", v_l + v_b),
        ("Mean squares of n samples need n - 1", (_W * v_l + (1 - _W) * v_b) / 2),
    ]


def _pilot(pixels: int, seed: int, samples: int) -> tuple[Array, Array, Array, Array]:
    """Return X and d of light and of BRDF samples, ``(samples, pixels)`` each; the pilot has w = 1/2."""
    rng = np.random.default_rng(seeded(seed))
    out = []
    for sigma in (0.1, 0.5):
        x = rng.normal(0, sigma, (samples, pixels))
        p_l, p_b = densities(x)
        out += [integrand(x) * 2 / (p_l + p_b), (p_l - p_b) / (p_l + p_b)]
    return out[0], out[1], out[2], out[3]
