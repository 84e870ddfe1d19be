"""Syntax of pbrt files: words, strings, numbers, ``[lists]`` and ``"type name" value`` parameters.

The meaning of directives and parameters is in `dmis.formats.pbrt.directives`.
"""

from __future__ import annotations

import numpy as np

from dmis.base.vectors import Floats
from dmis.formats.pbrt.dialect import SAME_TYPE
from dmis.formats.pbrt.parameters import SPECTRUM_TYPES, Parameter, Parameters
from dmis.formats.pbrt.tokens import Source, Token, either, is_number, tokens_of, values_of

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

    def skip(self) -> None:
        """Step over the arguments of a directive, whatever they are."""
        while (token := self.peek()).kind != "end" and (
            token.kind != "word" or not token.text[0].isalpha() or token.text in ("true", "false")
        ):
            self.index += 1

    def string(self, directive: Token, what: str) -> Token:
        """Read a quoted string; `what` names it in the error that the directive needs it."""
        token = self.next()
        if token.kind != "string":
            raise token.error(f"{directive.text} needs {what} as a string in quotes here")
        return token

    def numbers(self, directive: Token, count: int) -> Floats:
        """Read `count` numbers without brackets, (count,); sixteen stand in brackets, a matrix (4, 4) by columns."""
        if count == 16:
            token = self.next()
            matrix = values_of(token) if token.kind == "list" else ()
            if isinstance(matrix, tuple) or len(matrix) != 16:
                raise token.error(f"{directive.text} needs 16 numbers in brackets, a 4x4 matrix column by column")
            return matrix.reshape(4, 4).T
        values = []
        for k in range(count):
            token = self.next()
            if not is_number(token):
                raise token.error(f"{directive.text} needs {count} numbers; got {k}")
            values.append(values_of(token)[0])
        return np.array(values)

    def parameters(self, directive: Token) -> Parameters:
        """Read the ``"type name" value`` pairs up to the next directive."""
        items: dict[str, Parameter] = {}
        while self.peek().kind == "string":
            parameter = self._parameter(directive, self.next())
            if parameter.name in items and directive.dialect == "v4":  # elsewhere the last one counts
                raise parameter.error("is given twice; it must be given once")
            items[parameter.name] = parameter
        return Parameters(directive, items)

    def _parameter(self, directive: Token, declaration: Token) -> Parameter:
        words = declaration.name.split()
        if len(words) != 2:
            raise declaration.error('a parameter is declared by its type and name, like "float fov"')
        kind, name = words
        types = [*declaration.source.dialect.types, "spectrum", *_WORDS]
        if kind not in types:
            what = f"the type of a parameter must be {either(types)} in {declaration.dialect}"
            raise declaration.error(f"{what}; got {kind!r}")
        token = self.next()
        bare = token.dialect == "v4" and token.text in ("true", "false")
        if token.kind not in ("list", "string") and not bare and not is_number(token):
            raise token.error(f"parameter {name!r} needs a value: a number, a string, or a list of them in brackets")
        parameter = Parameter(SAME_TYPE.get(kind, kind), name, values_of(token), declaration, directive)
        if fault := _fault(parameter, kind):
            raise parameter.error(fault)
        return parameter


def _fault(parameter: Parameter, kind: str) -> str | None:
    """Return what is wrong with the values of a parameter declared as `kind`, None if nothing is."""
    values, widths = parameter.values, parameter.token.source.dialect.types
    count, width = len(values), widths.get(kind, 1)
    strings = isinstance(values, tuple)
    if strings == (kind in widths) and kind != "spectrum" and (strings or count):
        return f"of type {kind} needs {'numbers; got strings' if strings else 'strings in quotes; got numbers'}"
    if not count and kind not in widths.keys() - set(SPECTRUM_TYPES):
        return "needs a value; got an empty list"
    if kind == "bool" and values not in (("true",), ("false",)):
        return f'of type bool must be "true" or "false"; got {values}'
    if (kind == "texture" or (kind == "spectrum" and strings)) and count != 1:
        return f"must name one {kind}; got {count}"
    if kind == "integer" and ((parameter.numbers % 1 != 0) | (np.abs(parameter.numbers) >= 2**31)).any():
        return "needs whole numbers below 2**31"
    if kind == "spectrum" and not strings and count % 2:
        return f"needs pairs of wavelength and value; got {count} numbers"
    if count % width:
        return f"needs {width} numbers for each {kind}; got {count}"
    if kind in widths.keys() & set(SPECTRUM_TYPES) and count != width:
        return f"must be one {kind}; got {count // width}"
    return None
