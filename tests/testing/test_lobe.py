"""`check_lobe`: it finds each planted fault, and says which function is wrong."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
import pytest

import dmis
from dmis.base.vectors import Array, normalise
from dmis.brdf.cosines import Directions
from dmis.brdf.diffuse import Lambert, cosine_sample
from dmis.brdf.lobe import DeltaLobe, Lobe
from dmis.samplers.warp import INV_PI, square_to_hemisphere, to_world
from dmis.testing.lobe import check_lobe
from dmis.testing.outcome import Outcome, require

BASES: dict[str, Lobe] = {"lambert": Lambert(0.5), "ggx": dmis.ggx(0, 1, 0.3).lobes[0]}


def with_fault(base: Lobe, method: str, change: Callable[..., Any]) -> Any:
    """Return a lobe whose `method` returns what `change` makes of its result and its arguments."""
    original = getattr(type(base), method)
    cls = type("Mine", (type(base),), {method: lambda self, *args: change(original(self, *args), *args)})
    return cls(**vars(base))


def lost_cosine(pdf: Array, directions: Directions) -> Array:
    return np.where(directions.above, pdf / np.maximum(directions.cos_i, np.float32(1e-6)), 0)


def turned_down(wi: Array, surface: Any, u: Array) -> Array:
    """The directions on the other side of the surface."""
    return normalise(wi - 2 * surface.n * np.abs((surface.n * wi).sum(axis=0)))


def half_empty(pdf: Array, directions: Directions) -> Array:
    return pdf * (directions.wi[0] > 0)


FAULTS: dict[str, tuple[str, Callable[..., Any], str, str]] = {
    "pdf 7 % too large": (
        "pdf",
        lambda pdf, d: pdf * np.float32(1.07),
        "pdf integrates",
        r"^pdf is 1\.0[67]\d times the density of sample: pdf integrates to \d\.\d+",
    ),
    "pdf 7 % too small": (
        "pdf",
        lambda pdf, d: pdf * np.float32(0.93),
        "pdf integrates",
        r"^pdf is 0\.9[23]\d times the density of sample",
    ),
    "pdf without cosine": (
        "pdf",
        lost_cosine,
        "pdf integrates",
        r"^pdf is not the density of sample; its integral is wrong: look at pdf first: pdf integrates to ",
    ),
    "pdf without cosine, normalised": (
        "pdf",
        lambda pdf, d: d.above / np.float32(2 * np.pi),
        "chi-square",
        r"^pdf is not the density of sample: sample follows eval times the cosine, so look at pdf first\. The integral",
    ),
    "pdf on the wrong side": (
        "pdf",
        lambda pdf, d: np.maximum(-d.cos_i_signed, 0) * INV_PI,
        "chi-square",
        r"^pdf is not the density of sample: it is not 0 where eval times the cosine is 0, so look at pdf first",
    ),
    "pdf on both sides": (
        "pdf",
        lambda pdf, d: pdf + np.maximum(-d.cos_i_signed, 0) * INV_PI,
        "one side",
        r"^pdf is up to 0\.31\d below the surface, where it must be 0",
    ),
    "pdf 0 where eval reflects": (
        "pdf",
        half_empty,
        "furnace",
        r"^pdf is 0 where eval reflects 0\.\d+ of the light .* BRDF sampling loses it",
    ),
    "sample on the wrong side": ("sample", turned_down, "one side", r"^sample: all directions are below the surface"),
    "sample uniform": (
        "sample",
        lambda wi, surface, u: to_world(square_to_hemisphere(u), surface.n),
        "chi-square",
        r"^sample does not follow pdf, which is eval times the cosine with the right integral: look at sample first",
    ),
    "sample turned": (
        "sample",
        lambda wi, surface, u: np.abs(wi),
        "chi-square",
        r"^sample does not follow pdf, which is eval times the cosine with the right integral: look at sample first",
    ),
    "sample not of unit length": (
        "sample",
        lambda wi, surface, u: wi * np.float32(1.01),
        "forms",
        r"^sample must return unit directions; got a length of 1\.01",
    ),
    "eval with the cosine": (
        "eval",
        lambda f, d: f * d.cos_i,
        "reciprocal",
        r"^eval is not reciprocal in \d+% of the pairs: f\(wo, wi\) = .* Is cos_i a factor of eval\?",
    ),
    "eval that prefers one side": (
        "eval",
        lambda f, d: f * (d.wi[0] > 0),
        "reciprocal",
        r"^eval is not reciprocal in \d+% of the pairs: f\(wo, wi\) = [^?]*$",
    ),
    "eval without normalisation": (
        "eval",
        lambda f, d: f * np.float32(np.pi),
        "energy",
        r"^eval reflects \d\.\d+ of the light that arrives \(wo at \d+°\)",
    ),
    "eval NaN at grazing angles": (
        "eval",
        lambda f, d: f * (d.cos_o / d.cos_o),
        "finite",
        r"^eval is nan for wo at 90° and wi = ",
    ),
    "pdf infinite": (
        "pdf",
        lambda pdf, d: np.where(d.cos_i_signed >= 1, np.inf, pdf),
        "finite",
        r"^pdf is inf for wo at .* it must be finite and not negative",
    ),
    "pdf of the wrong shape": (
        "pdf",
        lambda pdf, d: pdf[None],
        "forms",
        r"^pdf must return densities \(N,\); got shape \(1, 1\) for N = 1",
    ),
    "eval of the wrong shape": (
        "eval",
        lambda f, d: np.ones((4, d.wi.shape[1])),
        "forms",
        r"^eval must return values \(1, N\)",
    ),
    "eval raises": ("eval", lambda f, d: d.nothing, "forms", r"raised AttributeError: .* \(test_lobe\.py, line \d+\)"),
}


def failures(outcomes: list[Outcome]) -> list[Outcome]:
    return [outcome for outcome in outcomes if not outcome.passed]


CASES = [
    *(("lambert", fault) for fault in FAULTS),
    ("ggx", "pdf 7 % too large"),
    ("ggx", "pdf on the wrong side"),
    ("ggx", "pdf without cosine"),
]


@pytest.mark.parametrize(("base", "fault"), CASES)
def test_each_fault_is_found(base: str, fault: str) -> None:
    method, change, check, message = FAULTS[fault]
    found = failures(check_lobe(with_fault(BASES[base], method, change)))
    texts = [outcome.message for outcome in found if check in outcome.name]
    assert texts and any(re.search(message, text) for text in texts), [f"{o.name}: {o.message}" for o in found]


def test_a_wrong_weight_is_found() -> None:
    found = failures(check_lobe(with_fault(BASES["lambert"], "weight", lambda weight: 2 * weight)))
    assert [outcome.name for outcome in found] == ["Mine: weight is eval cos / pdf"]
    assert "weight returns 1, eval cos / pdf is 0.5" in found[0].message


def test_renders_find_what_sample_does() -> None:
    """Light samples, BRDF samples and both of a lobe that samples another density."""
    uniform = with_fault(BASES["lambert"], "sample", FAULTS["sample uniform"][1])
    (found,) = [outcome for outcome in check_lobe(uniform) if "renders" in outcome.name]
    assert not found.passed and "sample or pdf: light samples need eval alone" in found.message


def test_the_cosine_is_the_second_guess() -> None:
    """Of a lobe that is sampled by the cosine, whatever its eval is; without any guess either may be wrong."""
    dark = with_fault(BASES["lambert"], "eval", lambda f, d: f * (1 - d.cos_o) * (1 - d.cos_i))
    flat = with_fault(dark, "pdf", lambda pdf, d: d.above / np.float32(2 * np.pi))
    texts = [outcome.message for outcome in failures(check_lobe(flat)) if "chi-square" in outcome.name]
    assert texts and texts[0].startswith("pdf is not the density of sample: sample follows the cosine, so look at pdf")
    turned = with_fault(flat, "sample", lambda wi, surface, u: np.abs(wi))
    texts = [outcome.message for outcome in failures(check_lobe(turned)) if "chi-square" in outcome.name]
    assert texts and texts[0].startswith("sample does not follow pdf, whose integral is right: either may be wrong")


def test_the_scale_of_eval_is_only_bounded() -> None:
    """The message says so."""
    (energy,) = [outcome for outcome in check_lobe(Lambert(0.5)) if "energy" in outcome.name]
    assert "at most 0.500 of the light" in energy.message and "nothing else bounds the scale of eval" in energy.message


@dataclass(frozen=True, eq=False)
class Paper(Lobe):
    """Diffuse transmission."""

    share: Any = 0.5
    gain: float = 1.0
    colours: ClassVar = ("share",)
    transmissive: ClassVar = True

    def eval(self, directions: Directions) -> Array:
        return self.share * (directions.above * INV_PI)

    def pdf(self, directions: Directions) -> Array:
        return np.maximum(directions.cos_i_signed, 0) * np.float32(self.gain * INV_PI)

    def sample(self, surface: Any, u: Array) -> Array:
        return cosine_sample(surface, u)

    def has_sides(self) -> bool:
        return False


def test_transmission() -> None:
    require(check_lobe(Paper()))
    assert any("pdf is 1.070 times" in outcome.message for outcome in failures(check_lobe(Paper(gain=1.07))))


@dataclass(frozen=True, eq=False)
class Mirror(DeltaLobe):
    """A mirror, with a sign and a factor."""

    sign: float = 1.0
    factor_: float = 0.9

    def scatter(self, surface: Any) -> tuple[Array, Array]:
        wi = surface.n * (2 * surface.cos_o) - surface.wo
        return wi * np.float32(self.sign), np.full((3, 1), np.float32(self.factor_))


@pytest.mark.parametrize(
    ("lobe", "message"),
    [
        (Mirror(sign=-1.0), "scatter: wrong side of the surface: wi is below the surface (wo at 0°)"),
        (Mirror(factor_=1.1), "scatter returns a factor of 1.1000 of the light (wo at 0°); at most 1 is allowed"),
        (Mirror(factor_=np.nan), "scatter must return finite directions and factors, not negative"),
        (Mirror(sign=2.0), "scatter must return unit directions; got a length of 2"),
    ],
)
def test_delta_lobes(lobe: Lobe, message: str) -> None:
    require(check_lobe(Mirror()))
    (found,) = check_lobe(lobe)
    assert not found.passed and found.message.startswith(message)


def test_a_textured_lobe_is_checked_at_the_middle_of_its_image() -> None:
    require(check_lobe(Lambert(dmis.Image(np.full((4, 4, 3), 0.5)))))


@pytest.mark.parametrize("lobe", [dmis.phong(0, 1, 1e5).lobes[0], dmis.ggx(0, 1, 0.02, 0.5).lobes[0]])
def test_narrow_lobes_pass(lobe: Lobe) -> None:
    """A spike of 3 mrad, and a blade."""
    require(check_lobe(lobe))


def test_what_is_no_lobe_is_refused() -> None:
    with pytest.raises(ValueError, match=r"lobes must derive from dmis\.brdf\.lobe\.Lobe"):
        check_lobe(3)  # type: ignore[arg-type]
