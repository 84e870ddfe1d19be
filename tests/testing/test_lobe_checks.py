"""`check_lobe`: it finds each planted fault, and right lobes pass."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
import pytest
from helpers import assert_found, with_fault

import dmis
from dmis.base.vectors import Array, normalise
from dmis.brdf.lobe import CosineLobe, DeltaLobe, Directions, Lambert, Lobe
from dmis.samplers.warp import INV_PI, square_to_hemisphere, to_world
from dmis.testing.lobe_checks import check_lobe
from dmis.testing.outcome import require

LAMBERT, GGX = Lambert(0.5), dmis.ggx(0, 1, 0.3).lobes[0]


def lost_cosine(pdf: Array, directions: Directions) -> Array:
    return np.where(directions.above, pdf / np.maximum(directions.cos_i, np.float32(1e-6)), 0)


def turned_down(wi: Array, surface: Any, u: Array) -> Array:
    """The directions on the other side of the surface."""
    return normalise(wi - 2 * surface.n * np.abs((surface.n * wi).sum(axis=0)))


def below(pdf: Array, directions: Directions) -> Array:
    return np.maximum(-directions.cos_i_signed, 0) * INV_PI


PDF, INTEGRAL = "follows pdf", "integral of eval"
MASS = "^pdf is not the density of sample: it integrates to "
FAULTS: dict[str, tuple[Lobe, str, Callable[..., Any], str, str]] = {
    "7 % too large": (LAMBERT, "pdf", lambda p, d: p * np.float32(1.07), INTEGRAL, r"is 0\.46\d+ ± 0, .* is 0\.5"),
    "7 % too small": (LAMBERT, "pdf", lambda p, d: p * np.float32(0.93), PDF, MASS + r"0\.9300"),
    "ggx, 7 % too large": (GGX, "pdf", lambda p, d: p * np.float32(1.07), PDF, MASS + r"0\.98"),
    "no cosine": (LAMBERT, "pdf", lost_cosine, PDF, MASS + r"2\.0"),
    "ggx, no cosine": (GGX, "pdf", lost_cosine, PDF, MASS + r"[23]\."),
    "uniform pdf": (LAMBERT, "pdf", lambda p, d: d.above / np.float32(2 * np.pi), PDF, MASS + r"1\.000"),
    "ggx, pdf on the wrong side": (GGX, "pdf", below, PDF, MASS + r"1\.000"),
    "pdf on both sides": (LAMBERT, "pdf", lambda p, d: p + below(p, d), PDF, MASS + r"2\.0"),
    "half of the pdf": (LAMBERT, "pdf", lambda p, d: p * (d.wi[0] > 0), INTEGRAL, r"is 0\.249.* is 0\.5: pdf .* or 0"),
    "sample on the wrong side": (LAMBERT, "sample", turned_down, PDF, r" 0\.0000 of the directions .* accepted"),
    "uniform sample": (LAMBERT, "sample", lambda w, s, u: to_world(square_to_hemisphere(u), s.n), PDF, MASS + r"1\.0"),
    "sample turned": (LAMBERT, "sample", lambda w, s, u: np.abs(w), "renders", "light samples need eval alone"),
    "eval with the cosine": (LAMBERT, "eval", lambda f, d: f * d.cos_i, "reciprocal", "cos_i must not be a factor"),
    "eval of one side": (LAMBERT, "eval", lambda f, d: f * (d.wi[0] > 0), "reciprocal", "^eval is not reciprocal"),
    "eval without 1 / pi": (LAMBERT, "eval", lambda f, d: f * np.float32(np.pi), "energy", r"^eval reflects 1\.57"),
    "weight": (LAMBERT, "weight", lambda w: 2 * w, "weight", r"^weight returns up to 1, eval cos / pdf 0\.5"),
}


def planted(base: Lobe, method: str, change: Callable[..., Any]) -> Any:
    return with_fault(type(base), method, change)(**vars(base))


@pytest.mark.parametrize("fault", FAULTS)
def test_each_fault_is_found(fault: str) -> None:
    base, method, change, check, message = FAULTS[fault]
    assert_found(check_lobe(planted(base, method, change)), check, message)


def test_albedo() -> None:
    """Only the expected albedo finds an eval that is 15 % too bright, and one that is too dark at one angle."""
    bright = planted(LAMBERT, "eval", lambda f, d: f * np.float32(1.15))
    bright = planted(bright, "weight", lambda weight: weight * np.float32(1.15))
    require(check_lobe(bright))
    require(check_lobe(LAMBERT, "", (0.5, 0.5, 0.5, 0.5)))
    for lobe, albedo, value in ((bright, (0.5,), "0.575"), (LAMBERT, (0.5, 0.5, 0.5, 0.6), "0.500")):
        (failed,) = [outcome for outcome in check_lobe(lobe, "", albedo) if not outcome.passed]
        assert "albedo" in failed.name and f"but eval reflects {value}" in failed.message


@dataclass(frozen=True, eq=False)
class Paper(CosineLobe):
    """Diffuse transmission."""

    share: Any = 0.5
    gain: float = 1.0
    colours: ClassVar = ("share",)
    transmissive: ClassVar = True

    def eval(self, directions: Directions) -> Array:
        return self.share * (directions.above * INV_PI)

    def pdf(self, directions: Directions) -> Array:
        return np.maximum(directions.cos_i_signed, 0) * np.float32(self.gain * INV_PI)

    def has_sides(self) -> bool:
        return False


@dataclass(frozen=True, eq=False)
class Mirror(DeltaLobe):
    """A mirror, with a sign and a factor."""

    sign: float = 1.0
    factor_: float = 0.9

    def scatter(self, surface: Any) -> tuple[Array, Array]:
        wi = surface.n * (2 * surface.cos_o) - surface.wo
        return wi * np.float32(self.sign), np.full((3, 1), np.float32(self.factor_))


@pytest.mark.parametrize(
    ("lobe", "check", "message"),
    [
        (Paper(gain=1.07), PDF, MASS + r"1\.0700"),
        (Mirror(sign=-1.0), "scatter", r"wrong side of the surface: wi is below the surface \(wo at 0°\)"),
        (Mirror(factor_=1.1), "scatter", r"a factor of 1\.1000 of the light .*; at most 1 is allowed"),
        (3, "accepts", "lobes must derive from dmis.brdf.lobe.Lobe"),
    ],
)
def test_transmission_and_deltas(lobe: Any, check: str, message: str) -> None:
    assert_found(check_lobe(lobe), check, message)


RIGHT = {
    "paper": Paper(),
    "mirror": Mirror(),
    "texture": Lambert(dmis.Image(np.full((4, 4, 3), 0.5))),
    "spike of 3 mrad": dmis.phong(0, 1, 1e5).lobes[0],
    "blade": dmis.ggx(0, 1, 0.02, 0.5).lobes[0],
}


@pytest.mark.parametrize("lobe", RIGHT.values(), ids=RIGHT)
def test_right_lobes_pass(lobe: Lobe) -> None:
    require(check_lobe(lobe))
