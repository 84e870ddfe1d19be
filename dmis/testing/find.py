"""The lobes, lights, techniques, rules, samplers and heuristics that a module of a user's own defines."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from types import ModuleType
from typing import Any

from dmis.base.plugins import raised
from dmis.brdf.lobe import Lobe
from dmis.brdf.materials import Material
from dmis.estimator.mis import COMBINERS, TECHNIQUES, Technique
from dmis.fit.registry import RULES
from dmis.fit.rule import Rule
from dmis.light.light import Light
from dmis.samplers.streams import SAMPLERS
from dmis.testing.light_checks import check_light
from dmis.testing.lobe_checks import check_lobe
from dmis.testing.outcome import Outcome
from dmis.testing.rule_checks import check_rule
from dmis.testing.sampler_checks import check_sampler
from dmis.testing.technique_checks import check_technique

RECOGNISED = (
    "classes that derive from Lobe, DeltaLobe, AreaLight, InfiniteLight, DeltaLight or dmis.Rule and whose fields all "
    "have defaults; objects of such classes, dmis.Material and dmis.Technique; rules, techniques, samplers and "
    "heuristics that are registered"
)
_KINDS: dict[str, type] = {"lobe": Lobe, "light": Light, "technique": Technique, "rule": Rule}
_REGISTRIES: dict[str, Any] = {"rule": RULES, "technique": TECHNIQUES, "sampler": SAMPLERS, "heuristic": COMBINERS}


@dataclass(frozen=True)
class Subject:
    """What can be checked: an object, or the name of a registered rule, sampler or heuristic; or why it cannot."""

    name: str
    kind: str
    item: Any
    refused: str = ""

    def check(self, albedo: Sequence[float] = ()) -> list[Outcome]:
        """Return the outcomes of its checks; `albedo` is that of `dmis.testing.lobe_checks.check_lobe`."""
        if self.refused:
            return [Outcome(f"{self.name}: an object of the class", False, self.refused)]
        if self.kind == "technique":
            return check_technique(self.item)
        if self.kind == "lobe":
            return check_lobe(self.item, self.name, albedo)
        if self.kind == "heuristic":
            return check_rule(f"fixed:0.3,combiner={self.item}", self.name)
        checks: dict[str, Any] = {"light": check_light, "rule": check_rule, "sampler": check_sampler}
        return checks[self.kind](self.item, self.name)


def find(module: ModuleType) -> list[Subject]:
    """Return what a module defines that can be checked, and classes that cannot without an object.

    Recognised are objects that are variables of the module: lobes, the lobes of materials, lights, techniques, rules;
    classes defined in the module, with the defaults of their fields, unless one of those objects is of the class; and
    the rules, techniques, samplers and heuristics that are registered. Names that begin with an underscore, and what is
    imported, are left out.
    """
    variables = {name: value for name, value in vars(module).items() if not name.startswith("_")}
    objects = dict(_objects(variables))
    subjects = [Subject(name, _kind(type(item)), item) for name, item in objects.items()]
    registered = [
        (kind, name, table[name]) for kind, table in _REGISTRIES.items() for name in table if name not in table.shipped
    ]
    used = {type(item) for _, item in _objects(vars(module))}
    used |= {item for *_, item in registered if isinstance(item, type)}
    for name, cls in variables.items():
        if isinstance(cls, type) and cls.__module__ == module.__name__ and _kind(cls) and cls not in used:
            try:
                subjects.append(Subject(name, _kind(cls), cls()))
            except Exception as error:
                text = f"{raised(error)}. Give it defaults, or add an object: my_{name.lower()} = {name}(...)"
                subjects.append(Subject(name, _kind(cls), None, text))
    for kind, name, item in registered:
        if all(item is not other for other in objects.values()):
            subjects.append(Subject(name, kind, item if kind == "technique" else name))
    return subjects


def _objects(variables: dict[str, Any]) -> Iterator[tuple[str, Any]]:
    """Yield the objects that are checked, with their names; of a material its lobes."""
    for name, value in variables.items():
        if isinstance(value, Material):
            yield from ((f"{name}.lobes[{k}]", lobe) for k, lobe in enumerate(value.lobes))
        elif _kind(type(value)) and not (isinstance(value, Technique) and value.name in TECHNIQUES.shipped):
            yield name, value


def _kind(cls: type) -> str:
    """Return the kind of the objects of a class; empty if they are none that is checked."""
    return next((kind for kind, base in _KINDS.items() if base in cls.__mro__), "")
