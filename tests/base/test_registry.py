"""Registries of rules, techniques, samplers and heuristics: names that are refused, and what replaces what."""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import Any

import pytest
from helpers import fresh_python

import dmis
from dmis.base.plugins import Later, Registry
from dmis.estimator.mis import BRDF, COMBINERS, TECHNIQUES, balance
from dmis.fit.registry import RULES
from dmis.samplers.streams import SAMPLERS, Independent


def rule() -> Any:
    class Mine(dmis.Rule):
        def fit(self, pilot: object) -> dmis.Fit:
            return dmis.Fit(0.5)

    return Mine


def sample() -> Any:
    return lambda surface, light, u: BRDF.sample(surface, light, u)


def sampler() -> Any:
    class Mine(Independent):
        pass

    return Mine


def heuristic() -> Any:
    return lambda a, k: balance(a, k)


def register_technique(name: Any, sample: Any) -> None:
    dmis.register_technique(dmis.Technique(name, "rays_of_mine", sample, BRDF.pdf))


KINDS: dict[str, tuple[Registry[Any], Callable[[Any, Any], None], Callable[[], Any]]] = {
    "rule": (RULES, dmis.register_rule, rule),
    "technique": (TECHNIQUES, register_technique, sample),
    "sampler": (SAMPLERS, dmis.register_sampler, sampler),
    "combiner": (COMBINERS, dmis.register_heuristic, heuristic),
}
"""Registry of each kind, what registers a value, and a definition of one, the same at each call."""
RESERVED = {"rule": "all", "sampler": "auto", "combiner": "power"}
each_kind = pytest.mark.parametrize("kind", KINDS)


@each_kind
def test_a_definition_that_is_repeated_replaces_itself(kind: str) -> None:
    """As a notebook's cell that runs twice; another definition of the name is refused."""
    registry, register, define = KINDS[kind]
    register("mine", define())
    first = registry["mine"]
    register("mine", define())
    second = registry["mine"]
    assert first is not second and registry.keys() - registry.shipped == {"mine"}
    other = define()
    other.__qualname__ = "other"
    with pytest.raises(ValueError, match=rf"name of a {kind} must be new; 'mine' is taken by .*{define.__name__}\..*>"):
        register("mine", other)
    assert registry["mine"] is second


@each_kind
@pytest.mark.parametrize("name", ["", "my rule", "a:b", "3d", "mine-", "mine_", "light+brdf", "a_b-c", 3])
def test_bad_names_are_refused(kind: str, name: Any) -> None:
    registry, register, define = KINDS[kind]
    joint = "-" if kind == "rule" else "_"
    message = f"name of a {kind} must be letters, digits and {joint}, such as my{joint}{kind}; got {name!r}"
    with pytest.raises(ValueError, match=re.escape(message)):
        register(name, define())
    assert registry.keys() == registry.shipped
    register(f"my{joint}own", define())


@each_kind
def test_names_of_dmis_are_refused(kind: str) -> None:
    registry, register, define = KINDS[kind]
    for name in registry.shipped:
        with pytest.raises(ValueError, match=f"name of a {kind} must be new; '{name}' is taken by dmis. Ch"):
            register(name, define())
    if kind in RESERVED:
        with pytest.raises(ValueError, match=f"name of a {kind} must not be {RESERVED[kind]}, because .*. Choose"):
            register(RESERVED[kind], define())


@each_kind
def test_values_that_cannot_be_called_are_refused(kind: str) -> None:
    registry, register, _ = KINDS[kind]
    with pytest.raises(ValueError, match=f"{kind} mine.* must be a (class or a )?function; got 3"):
        register("mine", 3)
    assert registry.keys() == registry.shipped


def test_names_and_values() -> None:
    """What there is, and what is like it."""
    registry = Registry("lamp", {"sphere": 1, "quad": 2})
    assert str(registry.unknown("sphare")) == "lamp must be one of sphere, quad; got 'sphare', did you mean 'sphere'?"
    assert str(registry.unknown("x", " or a file", ". Make it")) == (
        "lamp must be one of sphere, quad or a file; got 'x'. Make it"
    )
    # Alone, or with arguments; names are known without an import
    registry: Registry[Any] = Registry("number", {"root": Later("math", "sqrt"), "power": Later("math", "pow", (2,))})
    assert list(registry) == ["root", "power"] and isinstance(registry.data["root"], Later)
    assert registry["root"](4) == 2 and registry["power"](3) == 8 and registry.data["root"] is registry["root"]
    code = "import sys, dmis.fit.registry as r; r.make_rule('balance'); print('dmis.fit.auto' in sys.modules)"
    assert fresh_python(code).split() == ["False"]
