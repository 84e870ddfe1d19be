"""Tokens of pbrt files with their places, the paths of files that they name, and errors that name file, line and token.

A list of plain numbers is one token and becomes an array in one step, so large meshes cost little more than their
characters. `dmis.formats.pbrt.directives.Cursor` walks over the tokens.
"""

from __future__ import annotations

import io
import re
from bisect import bisect_left
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from dmis.base.named_files import named_file
from dmis.base.text import decode
from dmis.base.vectors import Floats
from dmis.formats.pbrt.dialect import V2, Dialect

_TOKEN = re.compile(
    r"""(?: [\s,]++ | \#[^\n]*+ )*+                                        # blanks, commas (of v3), comments
    (?: (?P<list> \[ (?: [^\[\]"\#]++ | "[^"\n]*+" | \#[^\n]*+ )*+ \] )
      | (?P<string> "[^"\n]*+" )
      | (?P<bracket> [\[\]] )                                             # without its other half
      | (?P<word> [^\s,"\[\]\#]++ )
      | (?P<broken> "[^\n]*+ )                                          # a string without an end
      | (?P<end> \Z ) )""",
    re.VERBOSE,
)
MAX_UNZIPPED, MAX_RATIO = 2**22, 100
"""Most bytes of an unpacked .gz file, and how many times its own bytes they may be if that is more."""
_VALUES = re.compile(r'"[^"\n]*"|\#[^\n]*|[^\s,"\#]+')
_NUMBER = re.compile(r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?")


class PbrtError(ValueError):
    """Error about a pbrt file that is malformed or not supported; the message names file, line and token.

    `reason` is the message without file and line; `is_last` whether reading stops there.
    """

    def __init__(self, message: str, reason: str = "", is_last: bool = False) -> None:
        super().__init__(message)
        self.reason, self.is_last = reason, is_last


@dataclass(frozen=True, eq=False)
class Source:
    """Text and dialect of a file. File names in it are relative to `folders`, in order, and must be within `root`."""

    path: Path
    text: str
    folders: tuple[Path, ...]
    root: Path | None = None
    dialect: Dialect = V2

    @cached_property
    def line_ends(self) -> list[int]:
        """Positions of the ends of the lines, so that many errors find their lines quickly."""
        return [match.start() for match in re.finditer("\n", self.text)]

    @classmethod
    def read(cls, path: Path, outside: bool = False) -> Source:
        """Read `path`, the first file of a scene; files named in it must be below its folder unless `outside`."""
        root = None if outside else path.parent.resolve()
        try:
            return cls(path, decode(path.read_bytes(), "the file"), (path.parent,), root)
        except ValueError as error:
            raise PbrtError(f"{path}:1: token at the beginning: {error}") from error

    def include(self, path: Path) -> Source:
        """Read a file that this one names: names in it are relative to the first file's folder, else to its own."""
        folders = dict.fromkeys([self.folders[0], path.parent])
        text = decode(unzipped(path, path.read_bytes()), str(path))
        return replace(self, path=path, text=text, folders=tuple(folders))


class Token(NamedTuple):
    """A piece of a file; `kind` is list, string, word or end."""

    kind: str
    text: str
    source: Source
    start: int

    @property
    def line(self) -> int:
        """Line number, from 1."""
        return bisect_left(self.source.line_ends, self.start) + 1

    @property
    def name(self) -> str:
        """The text of a string without its quotes."""
        return self.text[1:-1]

    @property
    def dialect(self) -> str:
        """Name of the dialect of the file."""
        return self.source.dialect.name

    def among(self, what: str, names: Iterable[str]) -> str:
        """Return the name, of `what`; raise a `PbrtError` unless it is one of `names`."""
        if self.name not in names:
            raise self.error(f"{what} must be {either(names)}; others are not supported in {self.dialect}")
        return self.name

    def find(self, what: str, name: Any, table: Mapping[Any, Any]) -> Any:
        """Return the entry `name` of a table of `what`; raise a `PbrtError` that lists its names if it has none."""
        if name not in table:
            raise self.error(f"there is no {what} {name!r} here; there are: {', '.join(map(repr, table)) or 'none'}")
        return table[name]

    def error(self, message: str, is_last: bool = False) -> PbrtError:
        """Return an error with the file, the line and the text of this token."""
        text = " ".join(self.text[:200].split()) or "end of file"
        if len(text) > 60:
            text = f"{text[:57]}..."
        reason = f"token {text}: {message}"
        return PbrtError(f"{self.source.path}:{self.line}: {reason}", reason, is_last)

    def file(self, name: str) -> Path:
        """Return the path of the existing file `name`, relative to the folders of this token's file."""
        for folder in self.source.folders:
            with blame(self):
                path = named_file(folder, name, self.source.root)
            if path is not None:
                return path
        raise self.error(f"there is no file {name!r} in {' or '.join(str(folder) for folder in self.source.folders)}")


def unzipped(path: Path, data: bytes) -> bytes:
    """Return what the bytes of a .gz file hold, those of other files as they are; a ValueError if that is too large."""
    if path.suffix.lower() != ".gz":
        return data
    import gzip
    import zlib

    most = max(MAX_UNZIPPED, MAX_RATIO * len(data))
    try:
        with gzip.open(io.BytesIO(data)) as packed:
            plain = packed.read(most + 1)
    except (OSError, EOFError, zlib.error) as error:
        raise ValueError(f"{path} cannot be unpacked: {error}") from error
    if len(plain) > most:
        raise ValueError(f"{path} must have at most {most:,} bytes when it is unpacked; unpack it")
    return plain


def either(names: Iterable[str]) -> str:
    """Return names as words: "a, b or c"."""
    *others, last = names
    return f"{', '.join(others)} or {last}" if others else last


@contextmanager
def blame(token: Token) -> Iterator[None]:
    """Raise errors of the block again as errors about `token`, with its place in the file."""
    try:
        yield
    except PbrtError:
        raise
    except (ValueError, OSError) as error:
        raise token.error(str(error)) from error


def tokens_of(source: Source) -> Iterator[Token]:
    """Yield the tokens of a file, the last of which is its end."""
    for match in _TOKEN.finditer(source.text):
        kind = match.lastgroup or "end"
        token = Token(kind, match[kind], source, match.start(kind))
        if kind == "broken":
            raise token.error('this string has no end: a closing quote " is missing on its line')
        if kind == "bracket":
            raise token.error("this list has no end or no beginning: a bracket [ or ] is missing")
        yield token
        if kind == "end":
            break


def is_number(token: Token) -> bool:
    """Return whether a token is a number without brackets."""
    return token.kind == "word" and _NUMBER.fullmatch(token.text) is not None


def values_of(token: Token) -> Floats | tuple[str, ...]:
    """Return the values of a list, or of a number, a string, or true or false without quotes: numbers or strings."""
    text = token.text[1:-1] if token.kind == "list" else token.text
    words = text.replace(",", " ").split()
    if '"' in text or "#" in text:
        words = [word for word in _VALUES.findall(text) if word[0] != "#"]
    bare = ("true", "false") if token.dialect == "v4" and "e" in text else ()
    if '"' in text or bare:
        strings = tuple(word.strip('"') for word in words if word[0] == '"' or word in bare)
        if strings and len(strings) < len(words):
            raise token.error("a list holds numbers or quoted strings, not both")
        if strings:
            return strings
    try:
        values = np.array([] if "_" in text else words, np.float64)
    except ValueError:
        values = np.empty(0)
    if len(values) < len(words):
        bad = next(word for word in words if not _NUMBER.fullmatch(word))
        raise token.error(f"a list holds numbers or quoted strings; got {bad}")
    if not np.isfinite(values).all():
        raise token.error(f"a number must be finite; {words[int(np.argmin(np.isfinite(values)))]} is too large")
    return values
