"""Plugins: Python files of a user's own, imported before a command runs, and calls of what they define.

A plugin registers what it defines (rules, techniques, samplers, heuristics) in a `Registry`. It is a module of its
file's name, so worker processes can import it, and it may import other files of its folder.

Calls of code that is not shipped are `guarded`: arguments are read-only, values are checked once for a batch, and what
is raised becomes one error with class, method and line. Shipped code is called as it is.
"""

from __future__ import annotations

import importlib
import os
import re
import sys
import sysconfig
import traceback
from collections import UserDict
from collections.abc import Callable, Mapping
from copy import copy
from dataclasses import dataclass
from functools import cache, partial, wraps
from pathlib import Path
from types import FunctionType, ModuleType
from typing import Any, NoReturn, TypeVar

import numpy as np

from dmis.base.validate import did_you_mean

T = TypeVar("T")

_LOADED: list[Path] = []
"""Files of the plugins that were loaded."""
_SHIPPED = tuple(Path(__file__).parents[k] / folder / "literature" for k, folder in ((1, "_examples"), (2, "examples")))
"""Folders of the plugins that come with dmis, of a wheel and of a checkout."""


def loaded_plugins() -> tuple[Path, ...]:
    """Return the files of all plugins that were loaded, in this order: worker processes load them, too."""
    return tuple(_LOADED)


def load_plugin(file: str | os.PathLike[str]) -> ModuleType:
    """Return the module of a Python file, imported by its name; a file that was loaded before is not loaded again.

    Parameters
    ----------
    file
        The file, or the name of one of examples/literature, such as ``simplex``.

    Raises
    ------
    FileNotFoundError
        If there is no such file.
    ValueError
        If its name is that of another module, or it raises an exception; the message has the file and the line.
    """
    shipped = (folder / f"{file}.py" for folder in _SHIPPED)
    path = next((path for path in shipped if path.is_file()), Path(file)).resolve()
    if path in _LOADED:
        return sys.modules[path.stem]
    if not path.is_file():
        names = ", ".join(sorted(path.stem for folder in _SHIPPED for path in folder.glob("*.py")))
        raise FileNotFoundError(f"no such plugin: {file}; a plugin must be a Python file, or one of dmis: {names}")
    name, folder = path.stem, str(path.parent)
    if path.suffix != ".py" or "." in name:
        raise ValueError(f"a plugin must be a Python file with a name such as my_rule.py; got {file}")
    sys.path.append(folder)  # for other files of the folder, too
    importlib.invalidate_caches()
    try:
        module = importlib.import_module(name)
    except (Exception, SystemExit) as error:
        sys.path.remove(folder)
        raise ValueError(f"plugin {file}: {raised(error)}") from error
    if getattr(module, "__file__", None) != str(path):
        sys.path.remove(folder)
        raise ValueError(f"plugin {file} must have another name, because {name} is a Python module already: {module}")
    _LOADED.append(path)
    return module


@dataclass(frozen=True)
class Later:
    """A value of a `module` that is imported when the value is first used; with `arguments` a partial call of it."""

    module: str
    name: str
    arguments: tuple[Any, ...] = ()

    def load(self) -> Any:
        """Return the value."""
        value = getattr(importlib.import_module(self.module), self.name)
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
        joint = self._joint
        of = f"name of a {self.kind}"
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
        from dmis.base.synonyms import PLUGINS

        if name in PLUGINS:
            plugin = PLUGINS[name]
            advice = f". It is a plug-in: load it with --plugin {plugin}, or dmis.load_plugin({plugin!r})"
        return ValueError(
            f"{self.kind} must be one of {', '.join(self)}{more}; got {name!r}{advice or did_you_mean(name, self)}"
        )


def origin(value: Any) -> str:
    """Return the module and the name of a class or function, which stay when a notebook cell defines it anew."""
    return f"{value.__module__}.{getattr(value, '__qualname__', repr(value))}"


def raised(error: BaseException) -> str:
    """Return the message of an exception with the function, file and line of the user's code that raised it."""
    own = [] if isinstance(error, PluginError) else _own_frames(error)
    if not own:
        return str(error) if isinstance(error, ValueError) else f"{type(error).__name__}: {error}"
    outer, inner = (code.co_qualname.rpartition("<locals>.")[2] for code, _ in (own[0], own[-1]))
    code, line = own[-1]
    place = f"{Path(code.co_filename).name}, line {line}"
    return f"{'' if outer == inner else f'{outer}: '}{inner} raised {type(error).__name__}: {error} ({place})"


def _own_frames(error: BaseException) -> list[tuple[Any, int]]:
    """Return code and line of the frames of a traceback that are neither of dmis nor of another library."""
    libraries = (sysconfig.get_path(key) for key in ("stdlib", "purelib", "platlib"))
    others = Path(__file__).parents[1], *map(Path, libraries)
    frames = ((frame.f_code, line) for frame, line in traceback.walk_tb(error.__traceback__))
    return [
        (code, line)
        for code, line in frames
        if not code.co_filename.startswith("<")  # generated, such as a dataclass's __init__
        and not any(Path(code.co_filename).is_relative_to(folder) for folder in others)
    ]


class PluginError(ValueError):
    """An exception of code that is not shipped, or a value that it must not return; the message names both."""


def reraise(error: Exception, call: str = "") -> NoReturn:
    """Raise an exception of a `call` of code that is not shipped as an error that names it; another as it is."""
    if isinstance(error, PluginError) or not (call or _own_frames(error)):
        raise error
    text = raised(error)
    raise PluginError(text if text.startswith(call) else f"{call}: {text}") from error


def is_shipped(value: Any) -> bool:
    """Return whether a class or function is one of dmis."""
    return str(getattr(value, "__module__", "")).startswith("dmis.")


def locked(array: np.ndarray) -> np.ndarray:
    """Return an array, from now on read-only: it is handed to code that is not shipped."""
    array.flags.writeable = False
    return array


def _locked_view(argument: Any) -> Any:
    """Return a read-only view of an array, or a list of such views; other arguments are as they are."""
    if isinstance(argument, np.ndarray):
        return locked(argument.view())
    return [*map(_locked_view, argument)] if isinstance(argument, list) else argument


def guarded(call: str, function: Callable[..., Any], check: Callable[..., None] | None = None) -> Callable[..., Any]:
    """Return a function with read-only arguments whose exceptions name the `call`.

    Parameters
    ----------
    call
        Class and method in messages, such as ``Dust.eval``; empty: the code that raises an exception is named.
    check
        ``check(call, value, *arguments)`` raises a ValueError unless a value is right; None: any is. Values of calls
        with named arguments, which the renderer does not make, are not checked.
    """

    @wraps(function, updated=())
    def guard(*arguments: Any, **named: Any) -> Any:
        try:
            given = [_locked_view(argument) for argument in arguments]
            value = function(*given, **named)
            if check is not None and not named:
                check(call, value, *given)
        except Exception as error:
            reraise(error, call)
        return value

    return guard


def checked(
    value: T, methods: Mapping[str, Callable[..., None] | None], always: bool = False, in_place: bool = False
) -> T:
    """Return an object whose `methods`, by their checks, are `guarded`, a copy or the object itself (`in_place`).

    One that is shipped is returned as it is, or guarded `always`.
    """
    cls: Any = type(value)
    if (is_shipped(cls) and not always) or "_guards" in vars(cls):
        return value
    twin = value if in_place else copy(value)
    object.__setattr__(twin, "__class__", _guarded_class(cls, tuple(methods.items())))
    return twin


@cache
def _guarded_class(cls: Any, methods: tuple[tuple[str, Any], ...]) -> Any:
    """Return a class that derives from `cls`, has its name, and guarded methods."""
    namespace = {"__module__": cls.__module__, "__qualname__": cls.__qualname__, "__slots__": (), "_guards": cls}
    for name, check in methods:
        if isinstance(function := getattr(cls, name, None), FunctionType):
            namespace[name] = guarded(f"{cls.__name__}.{name}", function, check)
    return type(cls)(cls.__name__, (cls,), namespace)
