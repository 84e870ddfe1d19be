"""Registries: what comes with dmis and what users add, by the names that options, settings and commands take."""

from __future__ import annotations

import re
from collections import UserDict
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from importlib import import_module
from typing import Any, TypeVar

from dmis.base.plugins import origin
from dmis.base.synonyms import PLUGINS
from dmis.base.validate import did_you_mean

T = TypeVar("T")


@dataclass(frozen=True)
class Later:
    """A value of a `module` that is imported when the value is first used; with `arguments` a partial call of it."""

    module: str
    name: str
    arguments: tuple[Any, ...] = ()

    def load(self) -> Any:
        """Return the value."""
        value = getattr(import_module(self.module), self.name)
        return partial(value, *self.arguments) if self.arguments else value


class Registry(UserDict[str, T]):
    """Values of one kind by name, such as the rules.

    Parameters
    ----------
    kind
        What messages call a value, such as ``rule``.
    shipped
        Values that come with dmis, which every process knows; or `Later`.
    joint
        What joins the words of a name: ``_`` or ``-``.
    reserved
        Names that cannot be given to a value, and why.
    source
        ``source(value)`` returns the class or function that defines a value; None: the value itself.
    """

    def __init__(
        self,
        kind: str,
        shipped: Mapping[str, T | Later],
        joint: str = "_",
        reserved: Mapping[str, str] | None = None,
        source: Callable[[T], Any] | None = None,
    ) -> None:
        super().__init__()
        self.data: dict[str, Any] = dict(shipped)
        self.kind = kind
        self.shipped = frozenset(shipped)
        self._joint = joint
        self._reserved = reserved or {}
        self._source = source or (lambda value: value)

    def __getitem__(self, name: str) -> T:
        """Return the value of a name; a KeyError if there is none."""
        if isinstance(value := self.data[name], Later):
            value = self.data[name] = value.load()
        return value

    def add(self, name: str, value: T) -> None:
        """Add a value, see `check`."""
        self.check(name, value)
        self[name] = value

    def check(self, name: Any, value: T) -> None:
        """Raise a ValueError unless the `value` can have the `name`.

        A name has letters, digits and joints, and is new. But what has it may be defined anew by a class or function
        of the same module and name, as a notebook cell that runs twice does.
        """
        joint, of = self._joint, f"name of a {self.kind}"
        if not isinstance(name, str) or not re.fullmatch(f"[A-Za-z][A-Za-z0-9]*({joint}[A-Za-z0-9]+)*", name):
            raise ValueError(f"{of} must be letters, digits and {joint}, such as my{joint}{self.kind}; got {name!r}")
        if name in self._reserved:
            raise ValueError(f"{of} must not be {name}, because {self._reserved[name]}. Choose another name")
        if not callable(source := self._source(value)):
            raise ValueError(f"{self.kind} {name} must be a class or a function; got {source!r}")
        if name not in self or self[name] == value:
            return
        owner = "dmis" if name in self.shipped else origin(self._source(self[name]))
        if owner != origin(source):
            raise ValueError(f"{of} must be new; {name!r} is taken by {owner}. Choose another name")

    def unknown(self, name: str, more: str = "", advice: str = "") -> ValueError:
        """Return the error that no value has a `name`.

        Parameters
        ----------
        more
            What else is allowed, behind the names.
        advice
            What to do, if the name is not that of a plug-in of examples/literature.
        """
        if name in PLUGINS:
            plugin = PLUGINS[name]
            advice = f". It is a plug-in: load it with --plugin {plugin}, or dmis.load_plugin({plugin!r})"
        return ValueError(
            f"{self.kind} must be one of {', '.join(self)}{more}; got {name!r}{advice or did_you_mean(name, self)}"
        )
