"""Execution of pbrt's directives on a `dmis.formats.pbrt.reader.Reader`: of files, transforms and blocks.

A `Cursor` reads their arguments. Other directives are in `dmis.formats.pbrt.options` and `dmis.formats.pbrt.reader`.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import nullcontext
from typing import Any

import numpy as np

from dmis.base.validate import did_you_mean
from dmis.base.vectors import Floats
from dmis.formats.pbrt.dialect import DIALECTS, SAME_TYPE, V4
from dmis.formats.pbrt.options import OPTIONS
from dmis.formats.pbrt.parameters import SPECTRUM_TYPES, Parameter, ParameterSet
from dmis.formats.pbrt.reader import KEPT, OPTIONAL, PARAMETERS, WORD, WORLD, Directive, Reader
from dmis.formats.pbrt.tokens import Source, Token, blame, either, is_number, tokens_of, values_of
from dmis.geometry import transforms

MAX_FILES = 10_000
"""Most inclusions of files; a file that is included twice counts twice."""
MAX_INCLUDES = 32
"""Largest depth of files that include each other."""
_WORDS = ("bool", "string", "texture")
_STRUCTURE = "Begin", "End", "Include"
"""Ends of the names of directives that others depend on."""
_INSTEAD = {
    "Volume": "remove it to render a vacuum",
    "Attribute": "write its parameters in each line of its kind",
    "Import": "write AttributeBegin, Include and AttributeEnd, because its transforms end with the file",
    "Option": "remove it, if the image does not depend on it",
}
"""Directives that are refused, with what to do."""
_PLACES = {"options": "before WorldBegin", "world": "between WorldBegin and WorldEnd"}


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

    def parameters(self, directive: Token) -> ParameterSet:
        """Read the ``"type name" value`` pairs up to the next directive."""
        items: dict[str, Parameter] = {}
        while self.peek().kind == "string":
            parameter = self._parameter(directive, self.next())
            if parameter.name in items and directive.dialect == "v4":  # elsewhere the last one counts
                raise parameter.error("is given twice; it must be given once")
            items[parameter.name] = parameter
        return ParameterSet(directive, items)

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


def carry_out(reader: Reader, source: Source) -> None:
    """Execute the directives of a file on `reader`.

    A directive that fails is noted and left out, unless others depend on it: files, blocks and objects.
    """
    reader.including.append(source.path.resolve())
    cursor = Cursor(source)
    while (token := cursor.next()).kind != "end":
        reader.token = token
        if token.kind != "word" or not token.text[0].isalpha():
            raise token.error("a directive is expected here, such as Shape or Translate")
        if token.text not in _DIRECTIVES or token.text in _SPECIAL - reader.dialect.directives:
            reader.refusals.add(token.error(_unknown(token.text, reader.dialect.name)))
            cursor.skip()
            continue
        phase, run, takes = _DIRECTIVES[token.text]
        if reader.phase == "end":
            raise token.error("nothing may follow WorldEnd, because one file makes one image")
        if phase not in ("any", reader.phase):
            raise token.error(f"{token.text} must stand {_PLACES[phase]}")
        arguments = [_argument(reader, cursor, kind) for kind in takes]
        with nullcontext() if token.text.endswith(_STRUCTURE) else reader.refusals.collect():
            run(reader, *arguments)
        if takes[-1:] == (PARAMETERS,):
            reader.notes.add_parameters(arguments[-1])
    reader.including.pop()
    if not reader.including and reader.phase == "world" and reader.dialect is V4:  # which has no WorldEnd
        _world_end(reader)
    if not reader.including and reader.phase != "end":
        raise token.error(
            "WorldBegin is missing"
            if reader.phase == "options"
            else 'WorldEnd is missing; for a file of pbrt-v4, which has none, give dialect="v4" (--dialect v4)'
        )


def _argument(reader: Reader, cursor: Cursor, kind: int | str) -> Any:
    """Read an argument of the current directive, of a kind of `Directive`."""
    token = reader.token
    if isinstance(kind, int):
        return cursor.numbers(token, kind)
    if kind == WORD or (kind == OPTIONAL and cursor.peek().kind == "string" and " " not in cursor.peek().name):
        return cursor.next()
    if kind == OPTIONAL:
        return None
    if kind not in (PARAMETERS, KEPT):
        return cursor.string(token, kind)
    p = cursor.parameters(token)
    p.textures = reader.state.textures
    return p


def _unknown(word: str, dialect: str) -> str:
    """Return the message about a directive that the dialect does not have."""
    if word in _INSTEAD and word in DIALECTS[dialect].directives:
        return f"{word} is not supported; {_INSTEAD[word]}"
    owners = [other.name for other in DIALECTS.values() if word in other.directives]
    if owners:
        owner = f"{word} belongs to {' and '.join(owners)}, where the same words mean other things"
        fix = "remove the line, or name another dialect (dialect=, --dialect)"
        return f"{owner}; this file is read as {dialect}: {fix}"
    names = [name for name in _DIRECTIVES if name not in _SPECIAL - DIALECTS[dialect].directives]
    return f"a directive must be one of {', '.join(names)}{did_you_mean(word, names)}"


def _include(reader: Reader, name: Token) -> None:
    path = name.file(name.name)
    if path.resolve() in reader.including:
        raise name.error("a file must not include itself, because that would have no end")
    reader.files += 1
    if reader.files > MAX_FILES or len(reader.including) >= MAX_INCLUDES:
        raise name.error(f"a scene must not include more than {MAX_FILES} files, {MAX_INCLUDES} deep")
    with blame(name):
        carry_out(reader, name.source.include(path))


def _set_transform(reader: Reader, matrix: Floats) -> None:
    """Make `matrix` (4, 4) the current transform."""
    reader.change(to_world=matrix)


def _concatenated(make: Callable[[Floats], Floats]) -> Callable[[Reader, Floats], None]:
    """Return the directive that multiplies the current transform by a matrix made of its numbers."""

    def run(reader: Reader, numbers: Floats) -> None:
        with blame(reader.token):
            _set_transform(reader, reader.state.to_world @ make(numbers))

    return run


def _name_system(reader: Reader, name: Token) -> None:
    reader.systems[name.name] = reader.state.to_world


def _return_to_system(reader: Reader, name: Token) -> None:
    reader.change(to_world=name.find("coordinate system", name.name, reader.systems))


def _world_begin(reader: Reader) -> None:
    reader.phase = "world"
    _set_transform(reader, np.eye(4))
    reader.systems["world"] = reader.state.to_world


def _world_end(reader: Reader) -> None:
    if reader.blocks:
        innermost = reader.blocks[-1][0]
        raise reader.token.error(f"{innermost.text} of line {innermost.line} is still open")
    reader.phase = "end"


def _active_transform(reader: Reader, which: Token) -> None:
    if which.text != "All":
        raise which.error("ActiveTransform must be All, because motion is not supported; remove the line")


_DIRECTIVES: dict[str, Directive] = {
    "Include": ("any", _include, ("a file name",)),
    "Identity": ("any", lambda reader: _set_transform(reader, np.eye(4)), ()),
    "Translate": ("any", _concatenated(transforms.translate), (3,)),
    "Scale": ("any", _concatenated(transforms.scale), (3,)),
    "Rotate": ("any", _concatenated(lambda numbers: transforms.rotate(numbers[0], numbers[1:])), (4,)),
    "LookAt": ("any", _concatenated(lambda numbers: transforms.look_at(*numbers.reshape(3, 3))), (9,)),
    "Transform": ("any", lambda reader, matrix: _set_transform(reader, matrix.copy()), (16,)),
    "ConcatTransform": ("any", _concatenated(lambda matrix: matrix), (16,)),
    "CoordinateSystem": ("any", _name_system, ("a name",)),
    "CoordSysTransform": ("any", _return_to_system, ("a name",)),
    "ActiveTransform": ("any", _active_transform, (WORD,)),
    "ReverseOrientation": ("world", lambda reader: reader.change(reverse=not reader.state.reverse), ()),
    "WorldBegin": ("options", _world_begin, ()),
    "WorldEnd": ("world", _world_end, ()),
    "AttributeBegin": ("world", Reader.open_block, ()),
    "AttributeEnd": ("world", Reader.close_block, ()),
    "TransformBegin": ("world", Reader.open_block, ()),
    "TransformEnd": ("world", Reader.close_block, ()),
    **WORLD,
    **OPTIONS,
}
_SPECIAL = frozenset().union(*(dialect.directives for dialect in DIALECTS.values()))
