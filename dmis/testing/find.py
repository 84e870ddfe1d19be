"""The lobes, lights, techniques and rules that a module of a user's own defines."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from types import ModuleType
from typing import Any

from dmis.brdf.lobe import Lobe
from dmis.brdf.materials import Material
from dmis.estimator.technique import TECHNIQUES, Technique
from dmis.fit.registry import RULES
from dmis.fit.rule import Rule
from dmis.light.light import Light
from dmis.testing.light import check_light
from dmis.testing.lobe import check_lobe
from dmis.testing.outcome import Outcome, raised
from dmis.testing.rule import check_rule
from dmis.testing.technique import check_technique

RECOGNISED = (
    "classes that derive from Lobe, DeltaLobe, AreaLight, InfiniteLight, DeltaLight or dmis.Rule and whose fields all "
    "have defaults; objects of such classes, dmis.Material and dmis.Technique; registered rules and techniques"
)


_SHIPPED = tuple(TECHNIQUES.values())


@dataclass(frozen=True)
class Subject:
    """What can be checked in a module.

    Attributes
    ----------
    name
        In the module, or under which it is registered.
    kind
        ``lobe``, ``light``, ``technique`` or ``rule``.
    check
        Returns the outcomes of its checks.
    """

    name: str
    kind: str
    check: Callable[[], list[Outcome]]


@dataclass(frozen=True)
class Skipped:
    """A class of a module that cannot be checked: its name, and why."""

    name: str
    reason: str


def find(module: ModuleType) -> tuple[list[Subject], list[Skipped]]:
    """Return what a module defines that can be checked, and the classes that cannot.

    Recognised are objects that are variables of the module: lobes, the lobes of materials, lights, techniques, rules;
    classes defined in the module, with the defaults of their fields, unless one of those objects is of the class; and
    the rules and techniques that the module registers. Names that begin with an underscore, and what is imported, are
    left out.
    """
    subjects, skipped = [], []
    classes: list[tuple[str, type]] = []
    checked: set[int] = set()
    for name, value in vars(module).items():
        if name.startswith("_"):
            continue
        if isinstance(value, type):
            if value.__module__ == module.__name__ and _kind(value):
                classes.append((name, value))
            continue
        for label, item in _items(name, value):
            kind = _kind(type(item))
            if kind and id(item) not in checked and _belongs(item, module):
                checked.add(id(item))
                subjects.append(Subject(label, kind, _check(kind, item, label)))
    known = {type(item) for value in vars(module).values() for _, item in _items("", value)}
    rules = {name: cls for name, cls in RULES.items() if getattr(cls, "__module__", "") == module.__name__}
    for name, cls in classes:
        if cls in known or cls in rules.values():
            continue
        if missing := _required(cls):
            example = f"my_{name.lower()} = {name}({', '.join(f'{field}=...' for field in missing)})"
            has, it = ("has", "it") if len(missing) == 1 else ("have", "them")
            reason = f"{', '.join(missing)} {has} no default. Give {it} one, or add an object to the file: {example}"
            skipped.append(Skipped(name, reason))
            continue
        try:
            item = cls()
        except Exception as error:
            skipped.append(Skipped(name, raised(error)))
            continue
        kind = _kind(cls)
        subjects.append(Subject(name, kind, _check(kind, item, name)))
    subjects += [Subject(name, "rule", _check("rule", name, name)) for name in rules]
    subjects += [
        Subject(technique.name, "technique", _check("technique", technique, technique.name))
        for technique in TECHNIQUES.values()
        if id(technique) not in checked and _belongs(technique, module)
    ]
    return subjects, skipped


def _items(name: str, value: Any) -> Iterator[tuple[str, Any]]:
    """Yield a variable, or the lobes of a material, with names."""
    if not isinstance(value, Material):
        yield name, value
        return
    for k, lobe in enumerate(value.lobes):
        yield f"{name}.lobes[{k}]", lobe


def _kind(cls: type) -> str:
    """Return the kind of the objects of a class; empty if they are none that is checked."""
    kinds: dict[str, type] = {"lobe": Lobe, "light": Light, "technique": Technique, "rule": Rule}
    return next((kind for kind, base in kinds.items() if base in cls.__mro__), "")


def _belongs(item: Any, module: ModuleType) -> bool:
    """Return whether an object is the module's own; a technique is by its functions, or if it is a copy."""
    if not isinstance(item, Technique):
        return True
    own = module.__name__ in (getattr(item.sample, "__module__", ""), getattr(item.pdf, "__module__", ""))
    return own or (any(item is value for value in vars(module).values()) and item not in _SHIPPED)


def _check(kind: str, item: Any, name: str) -> Callable[[], list[Outcome]]:
    """Return what checks an object."""
    checks: dict[str, Callable[[], list[Outcome]]] = {
        "lobe": lambda: check_lobe(item, name),
        "light": lambda: check_light(item, name),
        "technique": lambda: check_technique(item),
        "rule": lambda: check_rule(item, name),
    }
    return checks[kind]


def _required(cls: type) -> list[str]:
    """Return the arguments of a class that have no default."""
    rest = (inspect.Parameter.VAR_POSITIONAL, inspect.Parameter.VAR_KEYWORD)
    parameters = inspect.signature(cls).parameters.items()
    return [name for name, p in parameters if p.default is p.empty and p.kind not in rest]
