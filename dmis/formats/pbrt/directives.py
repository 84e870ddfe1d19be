"""Execution of pbrt's directives on a `dmis.formats.pbrt.reader.Reader`: of files, transforms and blocks.

The other directives are in `dmis.formats.pbrt.options` and `dmis.formats.pbrt.world`.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import nullcontext
from typing import Any

import numpy as np

from dmis.base.validate import did_you_mean
from dmis.base.vectors import Floats
from dmis.formats.pbrt.cursor import Cursor
from dmis.formats.pbrt.dialect import DIALECTS, V4
from dmis.formats.pbrt.options import OPTIONS
from dmis.formats.pbrt.reader import KEPT, OPTIONAL, PARAMETERS, WORD, Directive, Reader
from dmis.formats.pbrt.tokens import Source, Token, blame
from dmis.formats.pbrt.world import WORLD
from dmis.geometry import transforms

MAX_FILES = 10_000
"""Most inclusions of files; a file that is included twice counts twice."""
MAX_INCLUDES = 32
"""Largest depth of files that include each other."""
_ADDED = {"Shape": "shape", "LightSource": "light", "AreaLightSource": "light"}
_ADDED |= {"Material": "material", "Texture": "texture"}
"""Kinds of objects to which Attribute lines add parameters, by directive."""
_STRUCTURE = "Begin", "End", "Include", "Import"
"""Ends of the names of directives that others depend on."""
_PLACES = {"options": "before WorldBegin", "world": "between WorldBegin and WorldEnd"}


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
    p.items = {**reader.state.added.get(_ADDED.get(token.text, ""), {}), **p.items}
    p.textures = reader.state.textures
    return p


def _unknown(word: str, dialect: str) -> str:
    """Return the message about a directive that the dialect does not have."""
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


def _import(reader: Reader, name: Token) -> None:
    state, blocks = reader.state, len(reader.blocks)
    _include(reader, name)
    if len(reader.blocks) != blocks:
        raise name.error("an imported file must close what it opens")
    reader.restore(state)


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
    "Import": ("world", _import, ("a file name",)),
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
