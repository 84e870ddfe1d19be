"""The lobes, lights, techniques, rules, samplers and heuristics that a module of a user's own defines."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from types import ModuleType
from typing import Any

from dmis.base.plugins import raised
from dmis.brdf.lobe import Lobe
from dmis.brdf.materials import Material
from dmis.estimator.mis import COMBINERS
from dmis.estimator.technique import TECHNIQUES, Technique
from dmis.fit.registry import RULES
from dmis.fit.rule import Rule
from dmis.light.light import Light
from dmis.samplers.streams import SAMPLERS
from dmis.testing.light import check_light
from dmis.testing.lobe import check_lobe
from dmis.testing.outcome import Outcome
from dmis.testing.rule import check_rule
from dmis.testing.sampler import check_sampler
from dmis.testing.technique import check_technique

RECOGNISED = (
    "classes that derive from Lobe, DeltaLobe, AreaLight, InfiniteLight, DeltaLight or dmis.Rule and whose fields all "
    "have defaults; objects of such classes, dmis.Material and dmis.Technique; rules, techniques, samplers and "
    "heuristics that are registered"
)
_KINDS: dict[str, type] = {"lobe": Lobe, "light": Light, "technique": Technique, "rule": Rule}
_SHIPPED = tuple(TECHNIQUES.values())


@dataclass(frozen=True)
class Subject:
    """What can be checked, or the name of a registered rule, sampler or heuristic; or why a class cannot."""

    name: str
    kind: str
    item: Any
    refused: str = ""

    def check(self, albedo: Sequence[float] = ()) -> list[Outcome]:
        """Return the outcomes of its checks; `albedo` is that of `dmis.testing.lobe.check_lobe`."""
        if self.refused:
            return [Outcome(f"{self.name}: an object of the class", False, self.refused)]
        if self.kind == "lobe":
            return check_lobe(self.item, self.name, albedo)
        if self.kind == "technique":
            return check_technique(self.item)
        if self.kind == "light":
            return check_light(self.item, self.name)
        if self.kind == "sampler":
            return check_sampler(self.item, self.name)
        return check_rule(f"fixed:0.3,combiner={self.item}" if self.kind == "heuristic" else self.item, self.name)


def find(module: ModuleType) -> list[Subject]:
    """Return what a module defines that can be checked, and classes that cannot without an object.

    Recognised are objects that are variables of the module: lobes, the lobes of materials, lights, techniques, rules;
    classes defined in the module, with the defaults of their fields, unless one of those objects is of the class; and
    the rules, techniques, samplers and heuristics that the module registers. Names that begin with an underscore, and
    what is imported, are left out.
    """
    variables = {name: value for name, value in vars(module).items() if not name.startswith("_")}
    subjects: list[Subject] = []

    def add(name: str, item: Any) -> None:
        kind = _kind(type(item))
        if kind and item not in _SHIPPED and all(item is not subject.item for subject in subjects):
            subjects.append(Subject(name, kind, item))

    for name, item in _items(variables):
        add(name, item)
    rules, samplers = (
        {name: cls for name, cls in table.items() if getattr(cls, "__module__", "") == module.__name__}
        for table in (RULES, SAMPLERS)
    )
    used = {type(item) for _, item in _items(vars(module))} | set(rules.values())
    for name, cls in variables.items():
        if isinstance(cls, type) and cls.__module__ == module.__name__ and _kind(cls) and cls not in used:
            try:
                add(name, cls())
            except Exception as error:
                text = f"{raised(error)}. Give it defaults, or add an object: my_{name.lower()} = {name}(...)"
                subjects.append(Subject(name, _kind(cls), None, text))
    subjects += [Subject(name, "rule", name) for name in rules]
    for technique in TECHNIQUES.values():
        add(technique.name, technique)
    subjects += [Subject(name, "sampler", name) for name in samplers]
    own = [name for name, combiner in COMBINERS.items() if combiner.heuristic.__module__ == module.__name__]
    return subjects + [Subject(name, "heuristic", name) for name in own]


def _items(variables: dict[str, Any]) -> Iterator[tuple[str, Any]]:
    """Yield the objects that are no classes, with their names; of a material its lobes."""
    for name, value in variables.items():
        if isinstance(value, Material):
            yield from ((f"{name}.lobes[{k}]", lobe) for k, lobe in enumerate(value.lobes))
        elif not isinstance(value, type):
            yield name, value


def _kind(cls: type) -> str:
    """Return the kind of the objects of a class; empty if they are none that is checked."""
    return next((kind for kind, base in _KINDS.items() if base in cls.__mro__), "")
