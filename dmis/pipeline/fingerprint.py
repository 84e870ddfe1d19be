"""A scene's fingerprint: the key of caches and checkpoints.

Fields and arrays enter by content. What is shipped enters by name, and `MEANING` stands for its code. A class or
function of one's own enters by the text of the file, or of the cell of a notebook, that defines it: a lobe, a rule, a
sampler, a technique. What is imported from other files, and what a notebook defines in other cells, does not enter.
"""

from __future__ import annotations

import functools
import hashlib
import inspect
import linecache
import re
import sys
from collections.abc import Mapping, Set
from dataclasses import fields, is_dataclass
from pathlib import Path
from types import BuiltinFunctionType, FunctionType
from typing import TYPE_CHECKING, Any

import numpy as np

from dmis.estimator.mis import COMBINERS, technique_by_name
from dmis.samplers.streams import SAMPLERS
from dmis.scene.suggestions import DEFAULT_DEPTH, DEFAULT_INTEGRATOR

if TYPE_CHECKING:
    from dmis.estimator.settings import Settings
    from dmis.scene.scene import Scene

MEANING = 2
"""Raise it by one when a shipped lobe, light, camera or reader changes the image that is expected of a scene: the
references of all scenes are then rendered anew.
"""
_ABOUT = ("name", "source", "suggested")
"""Fields of a scene that no expected image depends on, but for a suggested integrator and depth."""
_PLAIN: tuple[Any, ...] = (type(None), bool, int, float, complex, str, bytes, type(...))


def fingerprint(scene: Scene, expected_image: bool = False) -> str:
    """Return a hash of what an image of `scene` depends on: 16 hexadecimal digits.

    All fields of the scene but its name and what is known of its file. An integrator or depth that the scene does not
    ask for is the default one, and the light of a part is its number among the scene's lights.

    Parameters
    ----------
    expected_image
        Leave out what only the noise depends on, the compensation of lights.

    Raises
    ------
    ValueError
        If a field of a class that is not shipped holds something that has no fingerprint, see `digest`.
    """
    number = {id(light): k for k, light in enumerate(scene.lights)}
    noise = ("compensation",) if expected_image else ()
    content = {field.name: getattr(scene, field.name) for field in fields(scene) if field.name not in _ABOUT}
    content["lights"] = [
        (type(light), {name: v for name, v in _fields(light).items() if name not in noise}) for light in scene.lights
    ]
    content["parts"] = [
        {**_fields(part), "light": None if part.light is None else number[id(part.light)]} for part in scene.parts
    ]
    content["integrator"] = scene.suggested.integrator or DEFAULT_INTEGRATOR
    content["max_depth"] = scene.suggested.max_depth or DEFAULT_DEPTH
    return digest({"meaning": MEANING, **content}, "scene")


def digest(value: Any, name: str = "value") -> str:
    """Return a hash of `value` by its structure: 16 hexadecimal digits.

    Parameters
    ----------
    value
        Numbers, texts, None, arrays, tuples, lists, dictionaries, sets, functions, classes, and objects whose
        attributes are made of these, such as dataclasses.
    name
        What messages call it.

    Raises
    ------
    ValueError
        If there is something else in it, or it contains itself; the message has the path of fields that leads there.
    """
    try:
        return hashlib.sha256(_text(value, name).encode()).hexdigest()[:16]
    except RecursionError:
        raise ValueError(f"{name} must not contain itself, because all its content is hashed") from None


def content_hashes(scene: Scene, rule: Any, settings: Settings) -> dict[str, str]:
    """Return hashes of the scene, the rule, the sampler and techniques, and the code of dmis, by name.

    With the rest of the provenance they are the key of a checkpoint. A ValueError if one has no fingerprint.
    """
    hashes = {"scene_hash": fingerprint(scene), "rule_hash": digest(rule, "rule"), "package_hash": package_hash()}
    return hashes | sampling_hashes(vars(settings))


def sampling_hashes(settings: Mapping[str, Any]) -> dict[str, str]:
    """Return hashes of the sampler, if there is one, and of techniques and heuristic that fields of `Settings` name.

    A ValueError if one that is not shipped has no fingerprint, see `digest`.
    """
    named: dict[str, Any] = {f"technique {name}": technique_by_name(name) for name in settings["techniques"]}
    if (sampler := settings.get("sampler", "auto")) != "auto":
        named[f"sampler {sampler}"] = SAMPLERS[sampler]
    if (combiner := settings.get("combiner")) in COMBINERS.keys() - COMBINERS.shipped:
        named[f"combiner {combiner}"] = COMBINERS[combiner]
    return {name: digest(value, name) for name, value in named.items()}


@functools.cache
def package_hash() -> str:
    """Return a hash of the Python files of dmis, by their content and their paths in the package."""
    root = Path(__file__).parents[1]
    return digest({path.relative_to(root).as_posix(): path.read_bytes() for path in root.rglob("*.py")})


def _text(value: Any, path: str) -> str:
    """Return the content of anything as text, which differs if the content does; `path` leads to it, for messages."""
    plain = next((kind for kind in _PLAIN if isinstance(value, kind)), None)
    if plain is not None:
        return plain.__repr__(value)  # that of a NumPy number depends on the version of NumPy
    if isinstance(value, np.ndarray | np.generic):
        return _array_text(np.asarray(value), path)
    if isinstance(value, tuple | list | range):
        return f"[{','.join(_text(v, f'{path}[{k}]') for k, v in enumerate(value))}]"
    if isinstance(value, Mapping):
        items = (f"{_text(k, path)}:{_text(v, f'{path}[{k!r}]')}" for k, v in value.items())
        return f"{{{','.join(sorted(items))}}}"
    if isinstance(value, Set):
        return f"set[{','.join(sorted(_text(v, path) for v in value))}]"
    if isinstance(value, BuiltinFunctionType | np.ufunc):
        return value.__name__
    if isinstance(value := inspect.unwrap(value), type | FunctionType):
        return _definition_text(value, path)
    kind = type(value)
    own = kind.__module__.partition(".")[0] not in sys.stdlib_module_names
    if is_dataclass(value) or (hasattr(value, "__dict__") and own):
        attributes = (f"{name}={_text(v, f'{path}.{name}')}" for name, v in sorted(_fields(value).items()))
        return f"{_definition_text(kind, path)}({','.join(attributes)})"
    raise ValueError(
        f"{path} must be made of numbers, texts, arrays, tuples, dictionaries, functions and dataclasses of these, "
        f"because references and checkpoints are kept by its content; got {kind.__name__}. Store the data that it "
        f"is made from in the field, and build it in a functools.cached_property"
    )


def _array_text(array: np.ndarray, path: str) -> str:
    if array.dtype.kind not in "biufc":
        return f"array{array.shape}{_text(array.tolist(), path)}"
    data = np.ascontiguousarray(array, array.dtype.newbyteorder("<")).reshape(-1).data
    return f"array{array.dtype.kind}{array.dtype.itemsize}{array.shape}{hashlib.sha256(data).hexdigest()}"


def _definition_text(value: Any, path: str) -> str:
    """Return a class or function as text: its name if it is shipped, else its source and that of its bases."""
    package, module = value.__module__.partition(".")[0], sys.modules.get(value.__module__)
    of_python = package in sys.stdlib_module_names and getattr(module, value.__name__, None) is value
    if package == "dmis" or of_python:  # executed text says that it is of Python's `builtins`
        return value.__name__
    bases = getattr(value, "__bases__", ())
    constants = {k: v for k, v in vars(value).items() if isinstance(v, (*_PLAIN, np.ndarray)) and k[:2] != "__"}
    return _text([value.__qualname__, _source_hash(value), constants, *bases], path)


@functools.cache
def _source_hash(value: Any) -> str:
    """Return a hash of the file, or of the cell of a notebook, that defines a class or function.

    It is read once: if the file is edited afterwards, the code that runs is still the former one. A ValueError if it is
    not defined at the top level of a file or of a cell of a notebook.
    """
    functions = [f for f in vars(value).values() if isinstance(f, FunctionType)] if isinstance(value, type) else [value]
    module = getattr(sys.modules.get(value.__module__), "__file__", None)
    for file in (*(f.__code__.co_filename for f in functions), module or ""):
        linecache.checkcache(file)
        text = "".join(linecache.getlines(file))
        if re.search(rf"^\s*(class|def) {re.escape(value.__qualname__)}\b", text, re.MULTILINE):
            return hashlib.sha256(text.encode()).hexdigest()
    raise ValueError(
        f"{value.__qualname__} must be defined by class or def at the top level of a file, or of a cell of a notebook, "
        f"because references and checkpoints are kept by its source. Move it there; what it needs goes into its fields"
    )


def _fields(value: Any) -> dict[str, Any]:
    """Return the fields of a dataclass, or else the attributes of an object but for cached properties, by name."""
    if is_dataclass(value):
        return {field.name: getattr(value, field.name, None) for field in fields(value)}
    cached = functools.cached_property
    return {name: v for name, v in vars(value).items() if not isinstance(getattr(type(value), name, None), cached)}
