"""Checks of a sampler: uniform numbers, none of them twice, independent dimensions, and renders.

Chi-square tests on 64 cells hold for independent numbers, and for structured ones, whose pixels are independent and
spread more evenly than by chance. Within a pixel the numbers of two dimensions may each be even, and still go through
their points in one order: that is found by the pairs of both, see `dmis.samplers.streams`.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import combinations, product

import numpy as np

from dmis.base.validate import check_array
from dmis.base.vectors import Array
from dmis.fit.fixed import Fixed
from dmis.samplers.pixel_block import CONTINUE, LENS, PixelBlock
from dmis.samplers.streams import SAMPLERS, BlockSampler, RoundingSampler, SamplerFactory, stream
from dmis.testing.outcome import Check, Fault, Outcome, run_checks
from dmis.testing.scenes import box_scene, compare_means
from dmis.testing.statistics import chi2_p, level

PIXELS = 1024
"""Pixels of the tile that the sampler serves."""
SPP = 64
"""Camera samples of each pixel."""
PATH = ("camera", (LENS,), (CONTINUE,), (CONTINUE, 0, 0, 0))
"""Dimensions of a path, which must be independent: place in the pixel and on the lens, direction, light sample."""
KEYS = (*PATH, (0, 0, 0))
"""And a light sample at the first surface, whose value is added to that of the path: it may go in its order."""
LEVEL = level(89)
"""Of each test: at most 64 chi-square tests of uniform numbers, 24 of pairs of dimensions, and renders."""
ONE_ORDER = 30.0
"""Chi-square of 64 pairs in 16 cells, on average over coordinates, from which on two dimensions go in one order.

It is 15 for independent ones, at most 16 for the shipped samplers, 96 for a (0, 2)-sequence in one order, 55 for R2.
"""
REPEATED = 0.02
"""Largest share of equal numbers; by chance it is 0.001 among 64 numbers of 16 binary digits."""
Numbers = dict[str, Array]
"""Numbers of each kind of draw, ``(2, n, PIXELS)`` for n samples of each pixel."""


def check_sampler(factory: SamplerFactory | str, name: str = "") -> list[Outcome]:
    """Return the outcomes of the checks of a sampler, by what `dmis.samplers.streams.Sampler` and its kin promise.

    It is a registered name, or a class or function that makes the sampler of a
    `dmis.samplers.pixel_block.PixelBlock`; its `name` in messages is that of the class or the registered one by
    default. A right sampler fails any check with a probability of 1e-4.
    """
    name = name or (factory if isinstance(factory, str) else getattr(factory, "__name__", repr(factory)))
    return run_checks(name, _checks(SAMPLERS[factory] if isinstance(factory, str) else factory, name))


def _checks(make: SamplerFactory, name: str) -> Iterator[Check]:
    """Yield the checks of a sampler."""
    numbers = _numbers(make)
    in_batches = _numbers(make, batches=2)
    yield "numbers are uniform, and none is repeated", lambda: _check_uniform([numbers, in_batches])
    yield "dimensions of a path are independent", lambda: _check_independent(numbers)
    yield "renders agree with independent numbers", lambda: _check_renders(make, name)


def _checked(u: Array, count: int, call: str) -> Array:
    """Return the numbers of a call; a Fault or ValueError unless they are ``(2, count)`` float32 in [0, 1)."""
    check_array(call, u, count, "(2, N)", below=1.0)
    if u.dtype != np.float32:
        raise Fault(f"{call} must return float32; got {u.dtype}")
    return u


def _numbers(make: SamplerFactory, batches: int = 1) -> Numbers:
    """Return the numbers of each kind of draw, of the camera samples in one batch or several.

    Each of `SPP` camera samples of a pixel has two shading samples.
    """
    sampler = make(PixelBlock(stream(0, 0, 0), 0, np.arange(PIXELS), [SPP], 2))
    drawn: dict[str, list[Array]] = {}

    def add(call: str, u: Array, count: int) -> None:
        drawn.setdefault(call, []).append(_checked(u, count, call).reshape(2, -1, PIXELS))

    for batch in np.split(np.arange(SPP), batches):
        number = np.repeat(batch, PIXELS)
        count = len(number)
        sampler.start(np.tile(np.arange(PIXELS), len(batch)), number)
        for key in KEYS:
            add(f"draw({key!r}, None)", sampler.draw(key, None), count)
        for i in range(2):  # two samples of a technique in each camera sample
            add("draw((1, 0), None, number)", sampler.draw((1, 0), None, 2 * number + i), count)
            if isinstance(sampler, BlockSampler):
                add("draw_block((2, 0), None, sample, 2)", sampler.draw_block((2, 0), None, i, 2), count)
    if isinstance(sampler, RoundingSampler):
        add("rounding_offsets(2)", sampler.rounding_offsets(2), PIXELS)
    return {call: np.concatenate(arrays, axis=1) for call, arrays in drawn.items()}


def _p(*u: Array) -> float:
    """Return the p-value of numbers, or of the pairs of two arrays, against a uniform density on 64 cells."""
    cell = (64 * u[0]).astype(int) if len(u) == 1 else 8 * (8 * u[0]).astype(int) + (8 * u[1]).astype(int)
    return chi2_p(np.bincount(cell.ravel(), minlength=64), np.full(64, cell.size / 64))


def _check_uniform(views: list[Numbers]) -> str:
    """Raise a Fault unless numbers and their pairs are uniform, those of the first samples of pixels among them."""
    least = 1.0
    for call, (x, y) in (item for numbers in views for item in numbers.items()):
        in_order = np.sort(x, axis=0)
        for text, same in (("samples of a pixel", in_order[1:] == in_order[:-1]), ("pixels", np.diff(in_order) == 0)):
            if same.size and same.mean() > REPEATED:
                raise Fault(f"{call}: {text} have the same numbers ({same.mean():.0%} of them)")
        tests = {"first numbers": (x,), "second numbers": (y,), "pairs": (x, y), "first pairs of pixels": (x[0], y[0])}
        for text, u in tests.items():
            p = _p(*u)
            least = min(least, p)
            if p <= LEVEL:
                raise Fault(f"{call}: {text} are not uniform (p = {p:.1g}, mean {u[0].mean():.3f})")
    return f"least p of chi-square {least:.2g}"


def _check_independent(numbers: Numbers) -> str:
    """Raise a Fault if numbers of two dimensions of a path depend on each other, over pixels or within them."""
    largest = 0.0
    for (a, x), (b, y) in combinations(list(numbers.items())[: len(PATH)], 2):
        chi2 = []
        for i, j in product((0, 1), (0, 1)):
            p = _p(x[i, 0], y[j, 0])
            if p <= LEVEL:
                raise Fault(f"{a}[{i}] and {b}[{j}] depend on each other (p = {p:.1g}): each key needs its own numbers")
            # sum (observed - expected)^2 / expected over 4 x 4 cells of the pairs of a pixel, on average over pixels
            cell = 4 * (4 * x[i]).astype(int) + (4 * y[j]).astype(int) + 16 * np.arange(PIXELS)
            counts = np.bincount(cell.ravel(), minlength=16 * PIXELS)
            chi2.append(np.square(counts - SPP / 16).sum() / (SPP / 16) / PIXELS)
        largest = max(largest, float(np.mean(chi2)))
        if largest > ONE_ORDER:
            raise Fault(
                f"{a} and {b} go through their points in one order, so that pairs of both stay on lines (chi-square "
                f"{largest:.0f} in place of 15): permute the order for each key"
            )
    return f"largest chi-square within pixels {largest:.1f}; 15 if independent"


def _check_renders(make: SamplerFactory, name: str) -> str:
    """Raise a Fault unless the mean is that of independent numbers."""
    SAMPLERS["checked"] = make
    try:
        rules = [("independent", Fixed(sampler="independent")), (name, Fixed(sampler="checked"))]
        return compare_means(box_scene(), rules, LEVEL, "draw: numbers are not uniform and independent")
    finally:
        del SAMPLERS["checked"]
