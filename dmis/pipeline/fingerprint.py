"""A scene's fingerprint: the key of caches and checkpoints.

Fields and arrays enter by content. What is shipped enters by name, and `MEANING` stands for its code. A class or
function of one's own enters by its source, with the definitions of its file that it uses by name. What it imports from
other files, and what a notebook defines in other cells, does not enter.
"""

from __future__ import annotations

import ast
import functools
import hashlib
import inspect
import linecache
import sys
from collections.abc import Mapping, Set
from copy import copy
from dataclasses import fields, is_dataclass
from pathlib import Path
from types import BuiltinFunctionType, FunctionType
from typing import TYPE_CHECKING, Any

import numpy as np

from dmis.scene.defaults import DEFAULT_DEPTH, DEFAULT_INTEGRATOR

if TYPE_CHECKING:
    from dmis.scene.scene import Scene

MEANING = 1
"""Raise it by one when a shipped lobe, light, camera or reader changes the image that is expected of a scene: the
references of all scenes are then rendered anew.
"""
_ABOUT = ("name", "source", "suggested")
"""Fields of a scene that no expected image depends on, but for a suggested integrator and depth."""
_PLAIN = (type(None), bool, int, float, complex, str, bytes, type(...))


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
    lights = [copy(light) for light in scene.lights] if expected_image else scene.lights
    for light in lights if expected_image else ():
        if hasattr(light, "compensation"):
            vars(light)["compensation"] = 0.0
    number = {id(light): k for k, light in enumerate(scene.lights)}
    content = {field.name: getattr(scene, field.name) for field in fields(scene) if field.name not in _ABOUT}
    content["lights"] = lights
    content["camera"] = {**_fields(scene.camera), "to_world": np.asarray(scene.camera.to_world, np.float64)}
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
        return _hash(value, name).hex()[:16]
    except RecursionError:
        raise ValueError(f"{name} must not contain itself, because it is walked to the end") from None


@functools.cache
def package_hash() -> str:
    """Return a hash of the Python files of dmis, by their content and their paths in the package."""
    root = Path(__file__).parents[1]
    files = {path.relative_to(root).as_posix(): path.read_bytes() for path in root.rglob("*.py")}
    return digest(files)


def _hash(value: Any, path: str) -> bytes:
    """Return the hash of anything; `path` leads to it, for messages."""
    if isinstance(value, _PLAIN):
        return _leaf(value)
    if isinstance(value, np.ndarray | np.generic):
        return _array_hash(np.asarray(value), path)
    if isinstance(value, tuple | list | range):
        return _node("sequence", *(_hash(v, f"{path}[{k}]") for k, v in enumerate(value)))
    if isinstance(value, Mapping):
        items = (_node("item", _hash(k, path), _hash(v, f"{path}[{k!r}]")) for k, v in value.items())
        return _node("mapping", *sorted(items))
    if isinstance(value, Set):
        return _node("set", *sorted(_hash(v, path) for v in value))
    if isinstance(value, BuiltinFunctionType | np.ufunc):
        return _node("builtin", _leaf(value.__name__))
    if isinstance(value := inspect.unwrap(value), type | FunctionType):
        return _definition_hash(value, path)
    kind = type(value)
    own = kind.__module__.partition(".")[0] not in sys.stdlib_module_names
    if is_dataclass(value) or (hasattr(value, "__dict__") and own):
        content = {name: _hash(v, f"{path}.{name}") for name, v in sorted(_fields(value).items())}
        named = (_node("field", _leaf(name), content[name]) for name in content)
        return _node("object", _definition_hash(kind, path), *named)
    raise ValueError(
        f"{path} must be made of numbers, texts, arrays, tuples, dictionaries, functions and dataclasses of these, "
        f"because references and checkpoints are kept by its content; got {kind.__name__}. Store the data that it "
        f"is made from in the field, and build it in a functools.cached_property"
    )


def _array_hash(array: np.ndarray, path: str) -> bytes:
    if array.dtype.kind not in "biufc":
        return _node("array", _leaf(str(array.shape)), _hash(array.tolist(), path))
    ordered = np.ascontiguousarray(array, array.dtype.newbyteorder("<")).reshape(-1)
    data = hashlib.sha256(ordered.view(np.uint8).data).digest()
    return _node("array", _leaf(f"{array.dtype.kind}{array.dtype.itemsize}{array.shape}"), data)


def _definition_hash(value: Any, path: str) -> bytes:
    """Return the hash of a class or function: its name if it is shipped, else its source and that of its bases."""
    if value.__module__.partition(".")[0] == "dmis" or _of_python(value):
        return _node("shipped", _leaf(value.__name__))
    bases = [_definition_hash(base, path) for base in getattr(value, "__bases__", ())]
    constants = {k: v for k, v in vars(value).items() if isinstance(v, (*_PLAIN, np.ndarray)) and k[:2] != "__"}
    text = _leaf(value.__qualname__), _leaf(_source(value))
    return _node("source", *text, _hash(constants, path), *bases)


@functools.cache
def _source(value: Any) -> str:
    """Return the statement that defines a class or function, and those of its file that it uses, as text.

    It is read once: if the file is edited afterwards, the code that runs is still the former one.

    Raises
    ------
    ValueError
        If it is not defined at the top level of a file or of a cell of a notebook.
    """
    functions = [f for f in vars(value).values() if isinstance(f, FunctionType)] if isinstance(value, type) else [value]
    module = getattr(sys.modules.get(value.__module__), "__file__", None)
    for file in (*(f.__code__.co_filename for f in functions), module or ""):
        linecache.checkcache(file)
        try:
            statements = ast.parse("".join(linecache.getlines(file))).body
        except (SyntaxError, ValueError):  # no Python file
            continue
        names, used = {value.__qualname__}, set[ast.stmt]()
        while more := {statement for statement in statements if names & _defined_names(statement)} - used:
            used |= more
            names |= {node.id for statement in more for node in ast.walk(statement) if isinstance(node, ast.Name)}
        if used:
            return "\n".join(ast.unparse(statement) for statement in statements if statement in used)
    raise ValueError(
        f"{value.__qualname__} must be defined by class or def at the top level of a file, or of a cell of a notebook, "
        f"because references and checkpoints are kept by its source. Move it there; what it needs goes into its fields"
    )


def _defined_names(statement: ast.stmt) -> set[str | None]:
    """Return the names that a top-level statement defines."""
    nodes = [statement] if isinstance(statement, ast.ClassDef | ast.FunctionDef) else list(ast.walk(statement))
    stored = {node.id for node in nodes if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store)}
    return stored | {getattr(node, "asname", None) or getattr(node, "name", None) for node in nodes} - {None}


def _of_python(value: Any) -> bool:
    """Return whether a class or function comes with Python, and enters by its name."""
    known = value.__module__.partition(".")[0] in sys.stdlib_module_names
    return known and getattr(sys.modules.get(value.__module__), value.__name__, None) is value  # executed text says so


def _leaf(value: object) -> bytes:
    """Return the hash of a plain value, with its type."""
    kind = next(kind for kind in _PLAIN if isinstance(value, kind))
    if isinstance(value, float):
        data = float.hex(value).encode()
    else:
        data = value if isinstance(value, bytes) else str(value).encode(errors="surrogatepass")
    return hashlib.sha256(kind.__name__.encode() + b":" + data).digest()


def _node(kind: str, *parts: bytes) -> bytes:
    """Return the hash of hashes, 32 bytes each."""
    return hashlib.sha256(kind.encode() + b"(" + b"".join(parts)).digest()


def _fields(value: Any) -> dict[str, Any]:
    """Return the fields of a dataclass, or else the attributes of an object but for cached properties, by name."""
    if is_dataclass(value):
        return {field.name: getattr(value, field.name, None) for field in fields(value)}
    cached = functools.cached_property
    return {name: v for name, v in vars(value).items() if not isinstance(getattr(type(value), name, None), cached)}
