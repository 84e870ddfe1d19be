"""Data-driven multiple importance sampling for Monte Carlo rendering, in NumPy on Embree.

The public names are those of `__all__`, which the imports in ``__init__.pyi`` list. ``import dmis`` loads nothing else,
not even NumPy: a public name, a room and a module of a room (``dmis.geometry.shapes``) are loaded where they are first
used.
"""

import sys
from importlib import import_module
from types import ModuleType

__version__ = "0.1.0"

with open(f"{__file__.removesuffix('c')}i", encoding="utf-8") as _stub:  # __init__.pyi
    _HOMES = {line.split()[3]: line.split()[1] for line in _stub if line.startswith("from dmis.")}
"""Public names, and the modules that define them."""
__all__ = sorted((*_HOMES, "plot"))


class _Package(ModuleType):
    """A package that loads its modules where they are first used as attributes, and so do the packages in it."""

    def __setattr__(self, name: str, value: object) -> None:
        """Bind a name; the import system binds a package in this one so, which then loads its modules, too."""
        if isinstance(value, ModuleType) and value.__package__ == f"{self.__name__}.{name}":
            value.__class__ = _Package
        super().__setattr__(name, value)

    def __call__(self, *_: object, **__: object) -> None:
        """Refuse to be called: `dmis.doctor` was a function."""
        hint = "; write dmis.diagnose(table)" if self.__name__ == "dmis.doctor" else ""
        raise TypeError(f"{self.__name__} is a package, not a function{hint}")

    def __getattr__(self, name: str) -> object:
        """Return a public name of dmis, or a module; a missing attribute says what to write, if that is known."""
        public, full, hint = self.__name__ == __name__, f"{self.__name__}.{name}", ""
        if public and name in _HOMES:
            value = globals()[name] = getattr(import_module(_HOMES[name]), name)
            return value
        try:
            if not name.startswith("_"):
                return import_module(full)
        except ModuleNotFoundError as error:
            if error.name != full:
                raise
        if public:
            synonyms = import_module("dmis.base.synonyms")
            hint = synonyms.advice(name, synonyms.NAMES, __all__)
        raise AttributeError(f"module {self.__name__!r} has no attribute {name!r}{hint}")


def no_attribute(owner: object, name: str) -> object:
    """Say what to write in place of an attribute that an object of dmis lacks: ``__getattr__`` of its class."""
    names = import_module("dmis.base.synonyms").NAMES
    written = names.get(name, f"dmis.{name}(...)" if name in __all__ else "")
    if not written:
        return object.__getattribute__(owner, name)  # raises Python's error, or that of a property
    raise AttributeError(f"{type(owner).__name__!r} object has no attribute {name!r}: write {written}")


def __dir__() -> list[str]:
    return ["__version__", *__all__]


sys.modules[__name__].__class__ = _Package
