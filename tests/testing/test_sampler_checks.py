"""`check_sampler`: it finds each planted fault, and right samplers pass."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from helpers import assert_found

from dmis.base.vectors import Array, take
from dmis.samplers.sobol import Sobol
from dmis.samplers.streams import SAMPLERS, Independent
from dmis.testing.outcome import require
from dmis.testing.sampler_checks import check_sampler


def changed(base: Any, **methods: Callable[..., Any]) -> Any:
    """Return a sampler with other methods, which get those of its base, bound, after themselves."""
    of_base = {name: getattr(base, name) for name in methods}

    def bound(name: str) -> Callable[..., Any]:
        return lambda self, *args: methods[name](self, lambda *a: of_base[name](self, *a), *args)

    return type("Mine", (base,), {name: bound(name) for name in methods})


def ceiling(u: Array) -> Array:
    return np.ceil(u * 1000) / np.float32(1000)


def squares(u: Array) -> Array:
    return np.stack([u[0], u[1] ** 2])


def of_numbers(change: Callable[[Array], Array]) -> Any:
    return changed(Independent, draw=lambda self, draw, *args: change(draw(*args)))


def one_shift(self: Any, init: Any, block: Any) -> None:
    init(block)
    self._pixel_words[:] = self._pixel_words[0]


def one_order(self: Any, draw: Any, key: Any, index: Any, number: Any = None) -> Array:
    """The points of the place in the pixel, shifted anew for each key."""
    u = draw("camera", index, number)
    shift = np.random.default_rng([abs(k) for k in key] if key != "camera" else 9).random((2, self._pixels))
    return ((u + shift[:, take(self._pixel, index)]) % 1).astype(np.float32).clip(0, np.float32(1 - 2**-24))


REFUSED, UNIFORM, SAME = "accepts", "uniform", "samples of a pixel have the same numbers"
FAULTS: dict[str, tuple[Any, str, str]] = {
    "constant": (of_numbers(lambda u: 0 * u + np.float32(0.25)), UNIFORM, "have the same numbers"),
    "square": (of_numbers(squares), UNIFORM, r"second numbers are not uniform \(p = 0, mean 0.33"),
    "pairs": (of_numbers(lambda u: u[[0, 0]]), UNIFORM, "pairs are not uniform"),
    "one key": (
        changed(Sobol, draw=lambda self, draw, key, *args: draw("camera", *args)),
        "dimensions",
        "depend on each other .*: each key needs its own",
    ),
    "one camera sample": (
        changed(Sobol, start=lambda self, start, pixel, number: start(pixel, 0 * number)),
        UNIFORM,
        SAME + r" \(100% of them",
    ),
    "batches": (
        changed(Sobol, start=lambda self, start, pixel, number: start(pixel, number - number.min())),
        UNIFORM,
        SAME + r" \(51% of them",
    ),
    "one pixel": (changed(Sobol, __init__=one_shift), UNIFORM, "pixels have the same numbers .100% of them"),
    "sample of block ignored": (
        changed(Sobol, draw_block=lambda self, draw, key, index, sample, count: draw(key, index, 0, count)),
        UNIFORM,
        r"draw_block\(\(2, 0\), None, sample, 2\): " + SAME,
    ),
    "one order": (changed(Sobol, draw=one_order), "dimensions", "go through their points in one order"),
    "float64": (of_numbers(lambda u: u.astype(float)), REFUSED, "must return float32; got float64"),
    "one": (of_numbers(ceiling), REFUSED, r"draw\('camera', None\) must be in \[0, 1\); got 1 "),
    "rounding": (
        changed(Sobol, rounding_offsets=lambda self, offsets, count: offsets(count) ** 2),
        UNIFORM,
        r"rounding_offsets\(2\): first numbers are not uniform",
    ),
    "no sampler": (lambda block: None, REFUSED, "'NoneType' object has no attribute 'start'"),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_each_fault_is_found(fault: str) -> None:
    wrong, check, message = FAULTS[fault]
    assert_found(check_sampler(wrong, "mine"), check, message)


@pytest.mark.parametrize("name", tuple(SAMPLERS))
def test_right_samplers_pass(name: str) -> None:
    require(check_sampler(name))
