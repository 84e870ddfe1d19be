"""A scene's fingerprint: the key of caches and checkpoints."""

from __future__ import annotations

import functools
import hashlib
import inspect
import sys
import textwrap
from collections.abc import Iterator, Mapping, Set
from dataclasses import fields, is_dataclass
from pathlib import Path
from types import BuiltinFunctionType, CodeType, FunctionType, MethodType
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
_CONSTANTS = (*_PLAIN, tuple, frozenset, np.ndarray, np.generic)
_CODE = (
    FunctionType, MethodType, type, property, staticmethod, classmethod, functools.cached_property, functools.partial,
)  # fmt: skip
_GENERATED = {
    "__repr__", "__eq__", "__lt__", "__le__", "__gt__", "__ge__", "__hash__", "__setattr__", "__delattr__",
    "__replace__", "__getstate__", "__setstate__", "__annotate__", "__annotate_func__",
}  # fmt: skip
"""Methods that `dataclasses` writes, or that do not enter an image."""


def fingerprint(scene: Scene, expected_image: bool = False) -> str:
    """Return a hash of what an image of `scene` depends on: 16 hexadecimal digits.

    All fields of the scene but its name and what is known of its file. An integrator or depth that the scene does not
    ask for is the default one, and the light of a part is its number among the scene's lights.

    Parameters
    ----------
    expected_image
        Leave out what only the noise depends on: a field of a dataclass with ``fingerprint`` in its metadata enters
        with that value.

    Raises
    ------
    ValueError
        If a field of a class that is not shipped holds something that has no fingerprint, see `digest`.
    """
    number = {id(light): k for k, light in enumerate(scene.lights)}
    content = {field.name: getattr(scene, field.name) for field in fields(scene) if field.name not in _ABOUT}
    content["camera"] = {**_fields(scene.camera), "to_world": np.asarray(scene.camera.to_world, np.float64)}
    content["parts"] = [
        {**_fields(part), "light": None if part.light is None else number[id(part.light)]} for part in scene.parts
    ]
    content["integrator"] = scene.suggested.integrator or DEFAULT_INTEGRATOR
    content["max_depth"] = scene.suggested.max_depth or DEFAULT_DEPTH
    return digest({"meaning": MEANING, **content}, "scene", expected_image)


def digest(value: Any, name: str = "value", expected_image: bool = False) -> str:
    """Return a hash of `value` by its structure: 16 hexadecimal digits.

    Parameters
    ----------
    value
        Numbers, texts, None, arrays, tuples, lists, dictionaries, sets, functions, classes, and objects whose
        attributes are made of these, such as dataclasses.
    name
        What messages call it.
    expected_image
        See `fingerprint`.

    Raises
    ------
    ValueError
        If there is something else in it, or it contains itself; the message has the path of fields that leads there.
    """
    try:
        return _Walk(expected_image).value(value, name).hex()[:16]
    except RecursionError:
        raise ValueError(f"{name} must not contain itself, because it is walked to the end") from None


@functools.cache
def package_hash() -> str:
    """Return a hash of the Python files of dmis, by their content and their paths in the package."""
    root = Path(__file__).parents[1]
    files = {path.relative_to(root).as_posix(): path.read_bytes() for path in root.rglob("*.py")}
    return digest(files)


class _Walk:
    """The hashes of one walk over a value. A function or class is walked once, even if it refers to itself."""

    def __init__(self, expected_image: bool) -> None:
        self._expected_image = expected_image
        self._code: dict[int, bytes] = {}

    def value(self, value: Any, path: str) -> bytes:
        """Return the hash of anything; `path` leads to it, for messages."""
        if isinstance(value, _PLAIN):
            return _leaf(value)
        if isinstance(value, np.ndarray | np.generic):
            return self._array(np.asarray(value), path)
        if isinstance(value, tuple | list | range):
            return _node("sequence", *(self.value(v, f"{path}[{k}]") for k, v in enumerate(value)))
        if isinstance(value, Mapping):
            items = (_node("item", self.value(k, path), self.value(v, f"{path}[{k!r}]")) for k, v in value.items())
            return _node("mapping", *sorted(items))
        if isinstance(value, Set):
            return _node("set", *sorted(self.value(v, path) for v in value))
        if isinstance(value, CodeType):
            return self._code_object(value, path)
        if isinstance(value, _CODE):
            return self._callable(value, path)
        if isinstance(value, BuiltinFunctionType | np.ufunc):
            return _node("builtin", _leaf(value.__name__))
        if hasattr(value, "__wrapped__"):  # functools.lru_cache
            return self.value(value.__wrapped__, path)
        if is_dataclass(value) or (hasattr(value, "__dict__") and _python(type(value))):
            content = _fields(value)
            if self._expected_image and is_dataclass(value):
                stand_ins = {field.name: field.metadata.get("fingerprint") for field in fields(value)}
                content |= {name: v for name, v in stand_ins.items() if v is not None}
            content = {name: self.value(v, f"{path}.{name}") for name, v in content.items()}
            named = (_node("field", _leaf(name), content[name]) for name in sorted(content))
            return _node("object", self.value(type(value), path), *named)
        raise ValueError(
            f"{path} must be made of numbers, texts, arrays, tuples, dictionaries, functions and dataclasses of these, "
            f"because references and checkpoints are kept by its content; got {type(value).__name__}. Store the data "
            f"that it is made from in the field, and build it in a functools.cached_property"
        )

    def _array(self, array: np.ndarray, path: str) -> bytes:
        if array.dtype.kind not in "biufc":
            return _node("array", _leaf(str(array.shape)), self.value(array.tolist(), path))
        ordered = np.ascontiguousarray(array, array.dtype.newbyteorder("<")).reshape(-1)
        data = hashlib.sha256(ordered.view(np.uint8).data).digest()
        return _node("array", _leaf(f"{array.dtype.kind}{array.dtype.itemsize}{array.shape}"), data)

    def _callable(self, value: Any, path: str) -> bytes:
        if isinstance(value, property):
            return self.value((value.fget, value.fset), path)
        if isinstance(value, functools.cached_property):
            return self.value(value.func, path)
        if isinstance(value, functools.partial):
            return self.value((value.func, value.args, value.keywords), path)
        if isinstance(value, MethodType):
            return self.value((value.__func__, value.__self__), path)
        if isinstance(value, staticmethod | classmethod):
            return _node(type(value).__name__, self.value(value.__func__, path))
        name = _leaf(value.__name__)
        if _shipped(value):
            return _node("shipped", name)
        if id(value) not in self._code:
            self._code[id(value)] = name  # until it is known: where it refers to itself
            walk = self._class if isinstance(value, type) else self._function
            self._code[id(value)] = walk(value, path)
        return self._code[id(value)]

    def _class(self, kind: type, path: str) -> bytes:
        """Return the hash of a class that is not shipped: its name, base classes, methods and constants."""
        skipped = {"__subclasshook__"}  # typing writes it into each class that derives from a protocol
        if "__dataclass_params__" in vars(kind):
            skipped |= _GENERATED
            if vars(kind)["__dataclass_params__"].init:
                skipped.add("__init__")
        members = {
            name: member
            for name, member in vars(kind).items()
            if name not in skipped and (isinstance(member, _CODE) or not name.startswith("__")) and _constant(member)
        }
        bases = [self.value(base, path) for base in kind.__bases__]
        return _node("class", _leaf(kind.__name__), *bases, self.value(members, f"{path}: {kind.__name__}"))

    def _function(self, function: FunctionType, path: str) -> bytes:
        """Return the hash of a function that is not shipped: its code, default values, and what that uses by name."""
        code, known = function.__code__, function.__globals__
        names = {name for part in _codes(code) for name in part.co_names}
        used = {name: known[name] for name in names if name in known and _local(known[name], known)}
        enclosed = [cell.cell_contents for cell in function.__closure__ or () if _filled(cell)]
        values = [value for value in enclosed if _constant(value)]
        given = function.__defaults__, function.__kwdefaults__
        return _node("function", self._text(code, path), self.value((given, values, used), path))

    def _text(self, code: CodeType, path: str) -> bytes:
        """Return the hash of the source of `code`, or of the code object if no source compiles to it.

        A file that was edited after it was imported, and a class that was defined twice, have sources that do not run.
        """
        own = self._code_object(code, path)
        try:
            text = textwrap.dedent("".join(inspect.getsourcelines(code)[0]))
            compiled = compile(text, "source", "exec", dont_inherit=True)
        except Exception:  # whatever a missing or an edited file makes these say
            return own
        named = [self._code_object(part, path) for part in _codes(compiled) if part.co_name == code.co_name]
        return _node("source", _leaf(text.strip())) if named == [own] else own  # a line may have two lambdas

    def _code_object(self, code: CodeType, path: str) -> bytes:
        content = code.co_code, code.co_names, code.co_consts, code.co_argcount, code.co_kwonlyargcount
        return _node("code", _leaf(code.co_name), self.value(content, path))


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


def _python(kind: type) -> bool:
    """Return whether a class and its bases are written in Python, so that attributes are all that its objects hold."""
    heap = 1 << 9  # flag of types that are not static in C; those of C among them have a `__new__` of C
    own = (vars(base) for base in kind.__mro__ if base is not object)
    written = not any(isinstance(names.get("__new__"), BuiltinFunctionType) for names in own)
    return written and all(base.__flags__ & heap for base in kind.__mro__ if base is not object)


def _shipped(value: Any) -> bool:
    """Return whether a class or function comes with dmis or with Python, and enters by its name alone."""
    module = str(value.__module__)
    if module.partition(".")[0] == "dmis":
        return True
    own = getattr(sys.modules.get(module), value.__name__, None)  # text that is executed says it is of builtins
    return module.partition(".")[0] in sys.stdlib_module_names and own is value


def _constant(value: Any) -> bool:
    """Return whether a member or global is code, or a value that does not change while a program runs."""
    options = getattr(type(value), "__dataclass_params__", None)
    return (
        (options is not None and options.frozen)
        or isinstance(value, _CODE + _CONSTANTS)
        or hasattr(value, "__wrapped__")
    )


def _local(value: Any, known: Mapping[str, Any]) -> bool:
    """Return whether a global is a constant, or code of the module whose globals are `known`."""
    if isinstance(value, FunctionType):
        return value.__globals__ is known
    if isinstance(value, type):
        return value.__module__ == known.get("__name__", "builtins")
    return _constant(value)


def _filled(cell: Any) -> bool:
    try:
        _ = cell.cell_contents
    except ValueError:
        return False
    return True


def _codes(code: CodeType) -> Iterator[CodeType]:
    """Yield `code` and all code objects within it."""
    yield code
    for value in code.co_consts:
        if isinstance(value, CodeType):
            yield from _codes(value)
