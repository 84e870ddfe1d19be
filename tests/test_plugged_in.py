"""What is plugged in and wrong ends in one error that names class and method, or gives the right image."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np
import pytest
from helpers import Z_LIMIT, registries_kept, results_z, with_fault
from own_lights import HalfSky

import dmis
from dmis.brdf.lobe import Lambert
from dmis.brdf.specular import SpecularReflection
from dmis.estimator.mis import BRDF, balance
from dmis.fit.round import Round
from dmis.geometry.shapes import quad
from dmis.light.delta import PointLight
from dmis.samplers.streams import SAMPLERS, Independent
from dmis.testing.scenes import ABOVE, box_scene

NAN = np.float32(np.nan)
WALL = quad((2, -4, 0), (0, 8, 0), (0, 0, 8))
HALF_SKY, POINT = HalfSky(), PointLight((0.0, 0.0, 2.0), (5.0, 5.0, 5.0))


def spoil(result: Any, array: Any) -> Any:
    array *= 0
    return result


def fails(*_: Any) -> Any:
    return 1 / 0


def some(values: Any, where: Any, other: Any) -> Any:
    return np.where(where, np.float32(other), values)


def with_pdf(change: Callable[[Any], Any]) -> Callable[..., Any]:
    return lambda s, *_: replace(s, pdf=change(s.pdf))


Plants = dict[str, tuple[str, Callable[..., Any]]]
LOBE: Plants = {
    "directions NaN": ("sample", lambda w, s, u: some(w, u[0] > 0.5, NAN)),
    "directions too long": ("sample", lambda w, s, u: w * np.float32(1.2)),
    "directions of half the points": ("sample", lambda w, s, u: w[:, ::2]),
    "sample writes the normal": ("sample", lambda w, s, u: spoil(w, s.n)),
    "pdf bool": ("pdf", lambda p, d: p > 0),
    "pdf negative": ("pdf", lambda p, d: -p),
    "pdf NaN away from the lamp": ("pdf", lambda p, d: some(p, d.wi[0] > 0.7, NAN)),
    "pdf writes cosines": ("pdf", lambda p, d: spoil(p, d.cos_i)),
    "eval NaN away from the lamp": ("eval", lambda f, d: f * some(d.cos_i * 0 + 1, d.wi[0] > 0.7, NAN)),
    "eval writes directions": ("eval", lambda f, d: spoil(f, d.wi)),
    "weight NaN": ("weight", lambda w: w * NAN),
}
MIRROR: Plants = {
    "directions NaN": ("scatter", lambda r, s: (some(r[0], s.wo[0] > 0, NAN), r[1])),
    "factors NaN": ("scatter", lambda r, s: (r[0], some(np.broadcast_to(r[1], r[0].shape), s.wo[0] > 0, NAN))),
    "directions alone": ("scatter", lambda r, s: r[0]),
    "scatter writes wo": ("scatter", lambda r, s: spoil(r, s.wo)),
}
LIGHT: Plants = {
    "directions NaN": ("sample", lambda s, p, u: replace(s, wi=some(s.wi, u[0] > 0.5, NAN))),
    "half of the points": ("sample", lambda s, p, u: replace(s, wi=s.wi[:, ::2])),
    "sample writes u": ("sample", lambda s, p, u: spoil(s, u)),
    "pdf NaN": ("hit", with_pdf(lambda p: p * NAN)),
    "pdf of one direction": ("hit", with_pdf(lambda p: p[:1])),
    "radiance NaN": ("hit", lambda s, *_: replace(s, radiance=np.full((3, 1), NAN))),
    "emits in numbers": ("hit", lambda s, *_: replace(s, emits=s.emits * 1.0)),
}
DELTA: Plants = {
    "directions NaN": ("sample", lambda s, p, u=None: replace(s, wi=some(s.wi, p[0] > 0, NAN))),
    "radiance negative": ("sample", lambda s, p, u=None: replace(s, radiance=-s.radiance)),
}
SAMPLER: Plants = {
    "NaN": ("draw", lambda u, *_: u * NAN),
    "one pair": ("draw", lambda u, *_: u[:, :1]),
    "1 among them": ("draw", lambda u, *_: np.ceil(u)),
    "writes the pixels": ("start", lambda _, pixel, number: spoil(_, pixel)),
}
TECHNIQUE: Plants = {
    "directions NaN": ("sample", lambda s, p, light, u: replace(s, wi=some(s.wi, u[0] > 0.5, NAN))),
    "pdf negative": ("pdf", lambda p, *_: -p),
    "pdf bool": ("pdf", lambda p, *_: p > 0),
    "pdf writes that of the light": ("pdf", lambda p, s, d, light_pdf: spoil(p, light_pdf)),
}
HEURISTIC: Plants = {"NaN": ("", lambda w, a, k: w * NAN), "writes densities": ("", lambda w, a, k: spoil(w, a[0]))}
STATISTIC: Plants = {
    "add writes radiance": ("add", lambda _, records, radiance, count: spoil(_, radiance)),
    "sums NaN": ("sums", lambda s: {name: a * NAN for name, a in s.items()}),
    "sums of other pixels": ("sums", lambda s: {name: a[1:] for name, a in s.items()}),
}
RULE: Plants = {
    "fit writes the film": ("fit", lambda fit, pilot: spoil(fit, pilot[0.5].mean)),
    "fit writes sums": ("fit", lambda fit, pilot: spoil(fit, pilot[0.5].sums["n"])),
    "fit of NaN": ("fit", lambda fit, pilot: dmis.Fit(NAN)),
}
PLANTS: dict[str, Plants] = {
    "lobe": LOBE, "mirror": MIRROR, "sky": LIGHT, "lamp": LIGHT, "point": DELTA, "sampler": SAMPLER,
    "technique": TECHNIQUE, "heuristic": HEURISTIC, "statistic": STATISTIC, "rule": RULE,
}  # fmt: skip
for _plants in PLANTS.values():
    _plants |= {f"{method} fails": (method, fails) for method, _ in _plants.values()}


class Unweighted(Lambert):
    """A matte lobe whose directions along paths are weighed by `eval` and `pdf`."""

    def weight(self) -> Any:
        return None


class Count:
    """A statistic: camera samples of each pixel."""

    def __init__(self, pixels: int, shading_samples: int) -> None:
        self._n = np.zeros(pixels)

    def add(self, records: Any, radiance: Any, count: int) -> None:
        self._n += count

    def sums(self) -> dict[str, Any]:
        return {"n": self._n}


class Half(dmis.Rule):
    """A rule whose pilot counts samples; its fit is what `change` makes of one half."""

    def __init__(self, statistic: type = Count, change: Callable[..., Any] = lambda fit, _: fit) -> None:
        self.pilot, self.statistic, self.change = {0.5: 4}, statistic, change  # type: ignore[misc]

    def fit(self, pilot: Any) -> Any:
        return self.change(dmis.Fit(0.5), pilot)


@dataclass
class Faulty:
    """A function that is right until it is made faulty."""

    function: Callable[..., Any]
    change: Callable[..., Any] | None = None

    def __call__(self, *args: Any) -> Any:
        result = self.function(*args)
        return result if self.change is None else self.change(result, *args)


def render(kind: str, method: str, change: Callable[..., Any], **options: Any) -> dmis.Result:
    """Render a scene with what is planted."""
    scene, rule = {"lights": (ABOVE,)}, "balance"  # type: tuple[dict[str, Any], Any]
    if kind in ("lobe", "mirror"):
        base = {"weight": Lambert}.get(method, Unweighted) if kind == "lobe" else SpecularReflection
        scene["material"] = dmis.Material((with_fault(base, method, change)(0.6),))
        scene["extra"] = (dmis.Part(WALL, scene["material"]),)
        scene["lights"] = (ABOVE, HALF_SKY) if kind == "mirror" else (ABOVE,)
    elif kind in ("sky", "lamp", "point"):
        light: Any = {"sky": HALF_SKY, "lamp": ABOVE, "point": POINT}[kind]
        scene["lights"] = (with_fault(type(light), method, change)(*(getattr(light, f.name) for f in fields(light))),)
    elif kind == "sampler":
        dmis.register_sampler("mine", with_fault(Independent, method, change))
        options["sampler"] = "mine"
    elif kind == "technique":
        functions = {"sample": BRDF.sample, "pdf": BRDF.pdf, method: Faulty(getattr(BRDF, method), change)}
        dmis.register_technique(dmis.Technique("mine", "mine", **functions))
        rule = "fixed:light=0.5,mine=0.5"
    elif kind == "heuristic":
        heuristic = Faulty(balance)
        heuristic.__qualname__ = "mine"  # type: ignore[attr-defined]
        dmis.register_heuristic("mine", heuristic)
        heuristic.change, rule = change, "fixed:0.5,combiner=mine"
    elif kind == "statistic":
        rule = Half(with_fault(Count, method, change))
    else:
        rule = Half(change=change)
    return dmis.render(box_scene(**scene), rule, 16, max_depth=3, **options)


@pytest.mark.filterwarnings("ignore::RuntimeWarning")
@pytest.mark.parametrize("integrator", ["direct", "path"])
@pytest.mark.parametrize(("kind", "plant"), [(kind, plant) for kind, plants in PLANTS.items() for plant in plants])
def test_planted(kind: str, plant: str, integrator: str) -> None:
    method, change = PLANTS[kind][plant]
    names = {
        "technique": f"{method} of technique mine",
        "heuristic": "heuristic mine",
        "rule": "Half.fit|rule's weight",
    }
    options: dict[str, Any] = {"integrator": integrator, "parallel": 2}
    with registries_kept():
        try:
            result: Any = render(kind, method, change, **options)
        except ValueError as error:
            result = str(error)
    if isinstance(result, str):
        name = names.get(kind, f"Mine.{method}")
        assert any(word in result for word in name.split("|"))
        assert "test_plugged_in.py, line " in result or not ("fails" in plant or "writes" in plant)
        return
    with registries_kept():
        right = render(kind, method, lambda result, *_: result, seed=1, **options)
    assert abs(results_z(result, right)) < Z_LIMIT


class Demanding(dmis.Rule):
    """A rule whose `fit` cannot be called."""

    def fit(self, pilot: Any, more: Any) -> dmis.Fit:  # type: ignore[override]
        return dmis.Fit(0.5)


def test_what_cannot_be_called_is_named() -> None:
    with registries_kept():
        unstarted = type("Unstarted", (), {"__init__": lambda self, block: None})
        for factory, message in ((unstarted, "Unstarted must have methods start and draw"), (object, "sampler mine: ")):
            dmis.register_sampler("mine", factory)
            with pytest.raises(ValueError, match=message):
                dmis.render(box_scene(), "balance", 2, sampler="mine", parallel=1)
            del SAMPLERS["mine"]
        dmis.register_sampler("mine", type("Mine", (Independent,), {}))  # a worker's error arrives as it is
        with pytest.raises(ValueError, match="sampler 'mine' is not registered in this process"):
            dmis.render(box_scene(), "balance", 4, sampler="mine", parallel=dmis.Processes(1))
        with pytest.raises(ValueError, match=r"Demanding: TypeError: Demanding\.fit\(\) missing"):
            dmis.render(box_scene(), Demanding(), 2, parallel=1)
        with pytest.raises(ValueError, match=r"rule mine must make a rule of its defaults; .*KeyError: 'x'"):
            dmis.register_rule("mine", lambda: {}["x"])
    with pytest.raises(ValueError, match="weight of Given must be a number or an array of numbers; got 'a'"):
        dmis.Given(weight="a")


def test_lost_light_is_refused() -> None:
    """A technique without samples must have no weight either: a render would lack its light."""
    round_ = Round(4, np.array([0.0, 1.0]), dmis.Settings(integrator="direct", max_depth=5, sampler="sobol"))
    for tilt in (None, np.array([0.0, 1.0])):
        replace(round_, tilt=tilt).checked((4, 4))
    with pytest.raises(ValueError, match="the tilt gives a technique a weight"):
        replace(round_, tilt=np.array([0.5, 0.5])).checked((4, 4))
