"""Data-driven multiple importance sampling for Monte Carlo rendering, in NumPy on Embree.

The public names are those of `__all__`, which the imports in ``__init__.pyi`` list. ``import dmis`` loads nothing else,
not even NumPy: a public name, a room and a module of a room (``dmis.geometry.shapes``) are loaded where they are first
used (PEP 562).
"""

from functools import partial
from importlib import import_module
from types import ModuleType
from typing import Any

__version__ = "0.1.0"

with open(f"{__file__.removesuffix('c')}i", encoding="utf-8") as _stub:  # __init__.pyi
    _HOMES = {line.split()[3]: line.split()[1] for line in _stub if line.startswith("from dmis.")}
"""Public names, and the modules that define them."""
_ROOMS = (
    "base", "brdf", "cli", "estimator", "experiment", "bench", "doctor", "report",
    "fit", "formats", "formats.gltf", "formats.obj", "formats.pbrt", "geometry", "light", "pipeline", "samplers",
    "scene", "testing", "variance",
)  # fmt: skip
"""Packages, whose modules are loaded as attributes."""
__all__ = sorted((*_HOMES, "plot"))


def __dir__() -> list[str]:
    return ["__version__", *__all__]


def _load_module(package: str, name: str) -> ModuleType:
    """Return the module `name` of `package`; an unknown one is a missing attribute."""
    full = f"{package}.{name}"
    try:
        if not name.startswith("_"):
            return import_module(full)
    except ModuleNotFoundError as error:
        if error.name != full:
            raise
    raise AttributeError(f"module {package!r} has no attribute {name!r}")


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        try:
            return _load_module("dmis", name)
        except AttributeError as error:
            synonyms = import_module("dmis.base.synonyms")
            raise AttributeError(f"{error}{synonyms.advice(name, synonyms.NAMES, __all__)}") from None
    value = globals()[name] = getattr(import_module(_HOMES[name]), name)
    return value


for _room in _ROOMS:
    import_module(f"dmis.{_room}").__getattr__ = partial(_load_module, f"dmis.{_room}")
