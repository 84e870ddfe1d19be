"""Syntax of pbrt files: words, strings, numbers, ``[lists]`` and ``"type name" value`` parameters.

The meaning of directives and parameters is in `dmis.formats.pbrt.directives`.
"""

from __future__ import annotations

import numpy as np

from dmis.base.vectors import Floats
from dmis.formats.pbrt.dialect import SAME_TYPE
from dmis.formats.pbrt.parameters import SPECTRUM_TYPES, Parameter, Parameters
from dmis.formats.pbrt.tokens import Source, Token, is_number, number_of, numbers_of, tokens_of

_WORDS = ("bool", "string", "texture")


class Cursor:
    """Position in the tokens of a file, with methods that read its values."""

    def __init__(self, source: Source) -> None:
        self.tokens = list(tokens_of(source))
        self.index = 0

    def peek(self) -> Token:
        """Return the next token without stepping over it; at the end of the file this is the token ``end``."""
        return self.tokens[self.index]

    def next(self) -> Token:
        """Return the next token and step over it."""
        token = self.tokens[self.index]
        self.index += token.kind != "end"
        return token

    def string(self, directive: Token, what: str) -> Token:
        """Read a quoted string; `what` names it in the error that the directive needs it."""
        token = self.next()
        if token.kind != "string":
            raise token.error(f"{directive.text} needs {what} as a string in quotes here")
        return token

    def numbers(self, directive: Token, count: int) -> Floats:
        """Read `count` numbers without brackets, (count,)."""
        values = []
        for k in range(count):
            token = self.next()
            if not is_number(token):
                raise token.error(f"{directive.text} needs {count} numbers; got {k}")
            values.append(number_of(token))
        return np.array(values)

    def matrix(self, directive: Token) -> Floats:
        """Read sixteen numbers in brackets, column by column, as a 4x4 matrix."""
        token = self.next()
        if token.kind != "list":
            raise token.error(f"{directive.text} needs 16 numbers in brackets, a 4x4 matrix column by column")
        values = numbers_of(token)
        if len(values) != 16:
            raise token.error(f"{directive.text} needs 16 numbers, a 4x4 matrix column by column; got {len(values)}")
        return values.reshape(4, 4).T

    def parameters(self, directive: Token) -> Parameters:
        """Read the ``"type name" value`` pairs up to the next directive."""
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
            types = ", ".join([*dialect.types, "spectrum", *_WORDS])
            raise declaration.error(f"the type of a parameter must be one of {types} in {dialect.name}; got {kind!r}")
        token = self.next()
        values: Floats | tuple[str, ...]
        if token.kind == "list":
            values = numbers_of(token)
        elif is_number(token):
            values = np.array([number_of(token)])
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
        """Read the rest of a list that does not consist of numbers alone."""
        values = []
        numeric = False
        while (token := self.next()).kind != "close":
            if is_number(token):
                numeric = True
            elif token.kind == "string":
                values.append(token.name)
            elif _bare(token):
                values.append(token.text)
            elif token.kind in ("end", "open", "list"):
                raise opening.error("this list has no end: a closing bracket ] is missing")
            elif token.text.lower().lstrip("+-") in ("nan", "inf", "infinity"):
                raise token.error("a number must be finite; this one is not")
            else:
                where = f"the bracket of line {opening.line} may not be closed"
                raise token.error(f"a list holds numbers or quoted strings; {where}")
            if numeric and values:
                raise token.error("a list holds numbers or quoted strings, not both")
        return tuple(values)


def _bare(token: Token) -> bool:
    """Return whether a token is true or false without quotes, in a dialect that allows it."""
    return token.source.dialect.bare_words and token.kind == "word" and token.text in ("true", "false")


def _check(declaration: Token, kind: str, name: str, values: Floats | tuple[str, ...]) -> None:
    """Raise a `PbrtError` unless the values of a parameter have the kind and the number that its type needs."""
    widths = declaration.source.dialect.types
    strings = isinstance(values, tuple)
    if (strings and kind in widths) or (not strings and kind in _WORDS and len(values)):
        expected, got = ("numbers", "strings") if strings else ("strings in quotes", "numbers")
        raise declaration.error(f"parameter {name!r} of type {kind} needs {expected}; got {got}")
    if not len(values) and kind not in widths.keys() - set(SPECTRUM_TYPES):
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
    if kind in SPECTRUM_TYPES[:4] and len(values) != widths[kind]:
        raise declaration.error(f"parameter {name!r} must be one {kind}; got {len(values) // widths[kind]}")
