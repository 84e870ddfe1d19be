"""The text of pbrt files: tokens that know their place, parameter lists, and errors that name file, line and token.

Only the form is read here: words, strings, numbers, ``[lists]`` and ``"type name" value`` parameters. What directives
and parameters mean is in `dmis.pbrt`. A list of plain numbers is one token and becomes an array in one step, so large
meshes cost little more than their characters.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from dmis.pbrt_dialect import SAME_TYPE, V2, Dialect
from dmis.pbrt_spectra import SPECTRA, luminous
from dmis.spectrum import Rgb, read_spd, spectrum_to_rgb, xyz_to_rgb

Floats = npt.NDArray[np.float64]

COLOURS = ("color", "rgb", "xyz", "blackbody", "spectrum")
"""Types of parameters that are spectra."""

_WORDS = ("bool", "string", "texture")

MAX_TEXT = 2**30
"""Most characters of all files of a scene together, and of each."""

_TOKEN = re.compile(
    r"""(?: \s++ | \#[^\n]*+ )*+                                        # blanks and comments
    (?: (?P<list> \[ (?: [-+.0-9eE\s]++ | \#[^\n]*+ )*+ \] )            # of numbers alone
      | (?P<string> "[^"\n]*+" )
      | (?P<open> \[ ) | (?P<close> \] )
      | (?P<word> [^\s"\[\]\#]++ )
      | (?P<broken> "[^\n]*+ )                                          # a string without an end
      | (?P<end> \Z ) )""",
    re.VERBOSE,
)
_NUMBER = re.compile(r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?")


class PbrtError(ValueError):
    """A pbrt file that cannot be rendered as it should be: the message names file, line and token."""


@dataclass(frozen=True, eq=False)
class Source:
    """A file's text and dialect. File names in it are looked for in `folders`, in order; nowhere else but in `root`."""

    path: Path
    text: str
    folders: tuple[Path, ...]
    root: Path | None = None
    dialect: Dialect = V2

    @classmethod
    def read(cls, path: Path, outside: bool = False) -> Source:
        """Read `path`, the first file; what it names must be in its folder or below, unless `outside`."""
        root = None if outside else path.parent.resolve()
        return cls(path, _text(path), (path.parent,), root)

    def include(self, path: Path) -> Source:
        """Read a file that this one names: names in it are relative to its own folder, else to the first file's."""
        folders = dict.fromkeys([path.parent, self.folders[-1]])
        return replace(self, path=path, text=_text(path), folders=tuple(folders))


class Token(NamedTuple):
    """A piece of a file; `kind` is list, string, word, open, close or end."""

    kind: str
    text: str
    source: Source
    start: int

    @property
    def line(self) -> int:
        """Line number, from 1."""
        return self.source.text.count("\n", 0, self.start) + 1

    @property
    def name(self) -> str:
        """The text of a string without its quotes."""
        return self.text[1:-1]

    def error(self, message: str) -> PbrtError:
        """The error to raise about this token."""
        text = " ".join(self.text[:200].split()) or "end of file"
        if len(text) > 60:
            text = f"{text[:57]}..."
        return PbrtError(f"{self.source.path}:{self.line}: token {text}: {message}")

    def file(self, name: str) -> Path:
        """The existing file that `name` means where this token stands."""
        if "\0" in name:
            raise self.error("a file name must not hold a zero character")
        root = self.source.root
        for folder in self.source.folders:
            path = folder / name
            try:
                if not path.is_file():
                    continue
                inside = root is None or path.resolve().is_relative_to(root)
            except OSError as error:
                raise self.error(f"the file {name[:60]!r} cannot be looked for: {error.strerror}") from error
            if not inside:
                raise self.error(
                    f"the file {name!r} is outside of the scene's folder {root}, which a scene must not reach "
                    "unless that is allowed (outside=True, --allow-outside)"
                )
            return path
        raise self.error(f"there is no file {name!r} in {' or '.join(str(folder) for folder in self.source.folders)}")


@contextmanager
def blame(token: Token) -> Iterator[None]:
    """Errors of constructors, raised again with the place in the file that caused them."""
    try:
        yield
    except PbrtError:
        raise
    except (ValueError, OSError) as error:
        raise token.error(str(error)) from error


class Cursor:
    """Walks over the tokens of a file."""

    def __init__(self, source: Source) -> None:
        self.tokens = list(tokens_of(source))
        self.index = 0

    def peek(self) -> Token:
        """The token ahead; at the end of the file that is the end."""
        return self.tokens[self.index]

    def next(self) -> Token:
        """The token ahead, and step over it."""
        token = self.tokens[self.index]
        self.index += token.kind != "end"
        return token

    def string(self, directive: Token, what: str) -> Token:
        """A quoted string, which is `what` the directive needs."""
        token = self.next()
        if token.kind != "string":
            raise token.error(f"{directive.text} needs {what} as a string in quotes here")
        return token

    def numbers(self, directive: Token, count: int) -> Floats:
        """`count` numbers without brackets."""
        values = []
        for k in range(count):
            token = self.next()
            if token.kind != "word" or not _NUMBER.fullmatch(token.text):
                raise token.error(f"{directive.text} needs {count} numbers; got {k}")
            values.append(_finite(token))
        return np.array(values)

    def matrix(self, directive: Token) -> Floats:
        """Sixteen numbers in brackets, column by column, as a 4x4 matrix."""
        token = self.next()
        if token.kind != "list":
            raise token.error(f"{directive.text} needs 16 numbers in brackets, a 4x4 matrix column by column")
        values = _numbers(token)
        if len(values) != 16:
            raise token.error(f"{directive.text} needs 16 numbers, a 4x4 matrix column by column; got {len(values)}")
        return values.reshape(4, 4).T

    def parameters(self, directive: Token) -> Parameters:
        """The ``"type name" value`` pairs up to the next directive."""
        items: dict[str, Parameter] = {}
        while self.peek().kind == "string":
            declaration = self.next()
            parameter = self._parameter(declaration)
            if parameter.name in items:
                raise declaration.error(f"parameter {parameter.name!r} is given twice; it must be given once")
            items[parameter.name] = parameter
        return Parameters(directive, items)

    def _parameter(self, declaration: Token) -> Parameter:
        words = declaration.name.split()
        if len(words) != 2:
            raise declaration.error('a parameter is declared by its type and name, like "float fov"')
        kind, name = words
        dialect = declaration.source.dialect
        if kind not in dialect.types and kind not in _WORDS and kind != "spectrum":
            known = ", ".join([*dialect.types, "spectrum", *_WORDS])
            raise declaration.error(f"the type of a parameter must be one of {known} in {dialect.name}; got {kind!r}")
        token = self.next()
        values: Floats | tuple[str, ...]
        if token.kind == "list":
            values = _numbers(token)
        elif token.kind == "word" and _NUMBER.fullmatch(token.text):
            values = np.array([_finite(token)])
        elif token.kind == "string":
            values = (token.name,)
        elif _bare(token):
            values = (token.text,)
        elif token.kind == "open":
            values = self._strings(token)
        else:
            raise token.error(f"parameter {name!r} needs a value: a number, a string, or a list of them in brackets")
        _check(declaration, kind, name, values)
        return Parameter(SAME_TYPE.get(kind, kind), name, values, declaration)

    def _strings(self, opening: Token) -> tuple[str, ...]:
        """The rest of a list that is not one of numbers alone."""
        values = []
        numeric = False
        while (token := self.next()).kind != "close":
            if token.kind == "word" and _NUMBER.fullmatch(token.text):
                numeric = True
            elif token.kind == "string":
                values.append(token.name)
            elif _bare(token):
                values.append(token.text)
            elif token.kind in ("end", "open", "list"):
                raise opening.error("this list has no end: a closing bracket ] is missing")
            else:
                where = f"the bracket of line {opening.line} may not be closed"
                raise token.error(f"a list holds numbers or quoted strings; {where}")
            if numeric and values:
                raise token.error("a list holds numbers or quoted strings, not both")
        return tuple(values)


@dataclass(frozen=True, eq=False)
class Parameter:
    """A parameter as written: its values are numbers ``(n,)`` or strings, as its type asks."""

    kind: str
    name: str
    values: Floats | tuple[str, ...]
    token: Token

    @property
    def numbers(self) -> Floats:
        """Values of a parameter whose type is numeric."""
        assert isinstance(self.values, np.ndarray)
        return self.values

    def colour(self) -> Rgb:
        """Linear RGB of a parameter of one of the types `COLOURS`, of a surface or, before v4, of a light."""
        spectra = SPECTRA[self.token.source.dialect.name]
        with blame(self.token):
            if isinstance(self.values, tuple):
                if self.values[0] in spectra.named:
                    return spectra.named[self.values[0]]
                return spectra.sampled(*read_spd(self._file(self.values[0])))
            if self.kind == "spectrum":
                return spectra.sampled(self.values[::2], self.values[1::2])
            if self.kind == "blackbody":
                return spectra.blackbody(*self.values.tolist())
            if self.kind == "xyz":
                return xyz_to_rgb(self.values)
        r, g, b = self.values.tolist()
        return r, g, b

    def illuminant(self) -> Rgb:
        """Linear RGB of a light: in v4 every spectrum but rgb is brought to luminance 1."""
        spectra = SPECTRA[self.token.source.dialect.name]
        if self.token.source.dialect.name != "v4" or self.kind != "spectrum":
            return self.colour()
        with blame(self.token):
            if isinstance(self.values, tuple):
                if self.values[0] in spectra.named:
                    return luminous(spectra.named[self.values[0]])
                return luminous(spectrum_to_rgb(*read_spd(self._file(self.values[0]))))
            return luminous(spectrum_to_rgb(self.values[::2], self.values[1::2]))

    def _file(self, name: str) -> Path:
        known = SPECTRA[self.token.source.dialect.name].named
        if known and "." not in name:
            raise self.token.error(
                f"there is no spectrum of the name {name!r} here, write it as rgb; there are {', '.join(known)}"
            )
        return self.token.file(name)


@dataclass(eq=False)
class Parameters:
    """The parameters of a directive; remembers which were asked for.

    Every method takes the name and what it is when absent, and raises `PbrtError` if the parameter is of another type
    or does not have one value.
    """

    directive: Token
    items: dict[str, Parameter]
    asked: set[str] = field(default_factory=set)

    def get(self, name: str, *kinds: str) -> Parameter | None:
        """The parameter `name` if it is there, of one of the types `kinds`."""
        self.asked.add(name)
        found = self.items.get(name)
        if found is not None and found.kind not in kinds:
            raise found.token.error(f"parameter {name!r} must be of type {' or '.join(kinds)}; got {found.kind}")
        return found

    def number(self, name: str, default: float) -> float:
        """A ``float``."""
        found = self.get(name, "float")
        return default if found is None else float(_one(found, 1)[0])

    def integer(self, name: str, default: int) -> int:
        """An ``integer``."""
        found = self.get(name, "integer")
        return default if found is None else int(_one(found, 1)[0])

    def string(self, name: str, default: str | None = None) -> str:
        """A ``string``; required if there is no default."""
        found = self.get(name, "string")
        if found is None:
            if default is None:
                raise self.missing(name, "string")
            return default
        if len(found.values) != 1:
            raise found.token.error(f"parameter {name!r} must be one string; got {len(found.values)}")
        return str(found.values[0])

    def boolean(self, name: str, default: bool) -> bool:
        """A ``bool``."""
        found = self.get(name, "bool")
        return default if found is None else found.values == ("true",)

    def point(self, name: str, default: tuple[float, float, float]) -> Floats:
        """A ``point``, (3,)."""
        found = self.get(name, "point")
        return np.array(default) if found is None else _one(found, 3)

    def colour(self, name: str, default: float) -> Rgb:
        """A spectrum of any type, as linear RGB."""
        found = self.get(name, *COLOURS)
        return (default, default, default) if found is None else found.colour()

    def illuminant(self, name: str, default: float) -> Rgb:
        """The colour of a light of any type of spectrum, as linear RGB."""
        found = self.get(name, *COLOURS)
        return (default, default, default) if found is None else found.illuminant()

    def table(self, name: str, kind: str | tuple[str, ...], columns: int) -> Floats | None:
        """Numbers in rows of `columns`, (n, columns)."""
        found = self.get(name, *((kind,) if isinstance(kind, str) else kind))
        if found is None:
            return None
        if len(found.numbers) % columns or not len(found.numbers):
            rule = f"a positive multiple of {columns}" if columns > 1 else "one or more"
            raise found.token.error(f"parameter {name!r} must hold {rule} numbers; got {len(found.numbers)}")
        return found.numbers.reshape(-1, columns)

    def indices(self, count: int) -> npt.NDArray[np.int32]:
        """The triangles ``integer indices`` (n, 3) into `count` vertices."""
        table = self.table("indices", "integer", 3)
        if table is None:
            raise self.missing("indices", "integer")
        if table.min() < 0 or table.max() >= count:
            bad = int(table[(table < 0) | (table >= count)][0])
            raise self.items["indices"].token.error(f"indices must be from 0 to {count - 1}, the last point; got {bad}")
        return table.astype(np.int32)

    def missing(self, name: str, kind: str) -> PbrtError:
        """The error of a required parameter that is absent."""
        return self.directive.error(f'needs the parameter "{kind} {name}", which is missing')

    def fixed(self, values: Mapping[str, Any]) -> None:
        """Raise if one of these parameters is there and has another value; infinity stands for none at all."""
        for name, value in values.items():
            kind = "bool" if isinstance(value, bool) else "string" if isinstance(value, str) else "float"
            found = self.get(name, kind)
            if found is None:
                continue
            if value == float("inf"):
                raise found.token.error(f"parameter {name!r} changes the image and is not supported; remove it")
            got = found.values[0] == "true" if kind == "bool" else found.values[0]
            if len(found.values) != 1 or got != value:
                raise found.token.error(f"parameter {name!r} must be {value}, because another makes another image")

    def refuse(self, name: str, reason: str) -> None:
        """Raise if there is a parameter `name`."""
        self.asked.add(name)
        if name in self.items:
            raise self.items[name].token.error(reason)

    def unused(self) -> list[str]:
        """Names of parameters that nobody asked for."""
        return [name for name in self.items if name not in self.asked]


def tokens_of(source: Source) -> Iterator[Token]:
    """The tokens of a file, the last of which is its end."""
    for match in _TOKEN.finditer(source.text):
        kind = match.lastgroup or "end"
        token = Token(kind, match[kind], source, match.start(kind))
        if kind == "broken":
            raise token.error('this string has no end: a closing quote " is missing on its line')
        yield token
        if kind == "end":
            break


def _text(path: Path) -> str:
    if path.stat().st_size > MAX_TEXT:
        raise ValueError(f"a file must have at most {MAX_TEXT} bytes, because it is kept in memory; got {path}")
    return path.read_text(encoding="utf-8", errors="replace")


def _bare(token: Token) -> bool:
    """Whether this is true or false where they need no quotes."""
    return token.source.dialect.bare_words and token.kind == "word" and token.text in ("true", "false")


def _numbers(token: Token) -> Floats:
    """The values of a list token."""
    text = token.text[1:-1]
    if "#" in text:
        text = re.sub(r"#[^\n]*", "", text)
    try:
        values = np.array(text.split(), np.float64)
    except ValueError:
        bad = next(word for word in text.split() if not _NUMBER.fullmatch(word))
        raise _within(token, bad).error("a number is expected here") from None
    if not np.isfinite(values).all():
        bad = text.split()[int(np.argmin(np.isfinite(values)))]
        raise _within(token, bad).error("a number must be finite; this one is too large")
    return values


def _within(token: Token, word: str) -> Token:
    """The token of a word in a list token."""
    match = re.compile(rf"(?<![^\s\[]){re.escape(word)}(?![^\s\]])").search(token.source.text, token.start)
    return Token("word", word, token.source, match.start() if match else token.start)


def _finite(token: Token) -> float:
    value = float(token.text)
    if not np.isfinite(value):
        raise token.error("a number must be finite; this one is too large")
    return value


def _one(parameter: Parameter, width: int) -> Floats:
    """The values of a parameter that must hold one of its type."""
    if len(parameter.values) != width:
        wanted = "one number" if width == 1 else f"{width} numbers"
        raise parameter.token.error(f"parameter {parameter.name!r} must be {wanted}; got {len(parameter.values)}")
    return parameter.numbers


def _check(declaration: Token, kind: str, name: str, values: Floats | tuple[str, ...]) -> None:
    """Values of the kind that the type asks for, in the right number."""
    widths = declaration.source.dialect.types
    strings = isinstance(values, tuple)
    if (strings and kind in widths) or (not strings and kind in _WORDS and len(values)):
        wanted, got = ("numbers", "strings") if strings else ("strings in quotes", "numbers")
        raise declaration.error(f"parameter {name!r} of type {kind} needs {wanted}; got {got}")
    if not len(values) and kind not in widths.keys() - set(COLOURS):
        raise declaration.error(f"parameter {name!r} needs a value; got an empty list")
    if kind == "bool" and values not in (("true",), ("false",)):
        raise declaration.error(f'parameter {name!r} of type bool must be "true" or "false"; got {values}')
    if (kind == "texture" and len(values) != 1) or (kind == "spectrum" and strings and len(values) != 1):
        raise declaration.error(f"parameter {name!r} must name one {kind}; got {len(values)}")
    if strings:
        return
    assert isinstance(values, np.ndarray)
    if kind == "integer" and ((values != np.rint(values)).any() or (np.abs(values) >= 2**31).any()):
        bad = values[(values != np.rint(values)) | (np.abs(values) >= 2**31)][0]
        raise declaration.error(f"parameter {name!r} needs whole numbers below 2**31; got {bad:g}")
    if kind == "spectrum" and len(values) % 2:
        raise declaration.error(f"parameter {name!r} needs pairs of wavelength and value; got {len(values)} numbers")
    if kind in widths and len(values) % widths[kind]:
        raise declaration.error(f"parameter {name!r} needs {widths[kind]} numbers for each {kind}; got {len(values)}")
    if kind in COLOURS[:4] and len(values) != widths[kind]:
        raise declaration.error(f"parameter {name!r} must be one {kind}; got {len(values) // widths[kind]}")
