"""Execution of pbrt's directives on a `dmis.formats.pbrt.reader.Reader`: of files, transforms, blocks and options.

The other directives are in `dmis.formats.pbrt.world`.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import nullcontext
from typing import Any

import numpy as np

from dmis.base.validate import did_you_mean
from dmis.base.vectors import Floats
from dmis.formats.pbrt.cursor import Cursor
from dmis.formats.pbrt.dialect import DIALECTS, IRRELEVANT, V2, V4
from dmis.formats.pbrt.parameters import Parameters
from dmis.formats.pbrt.reader import KEPT, MATRIX, OPTIONAL, PARAMETERS, WORD, Directive, Reader, inverse
from dmis.formats.pbrt.tokens import Source, Token, blame
from dmis.formats.pbrt.world import WORLD
from dmis.geometry import transforms
from dmis.samplers.pixel_filter import PixelFilter
from dmis.scene.defaults import MAX_DEPTH

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
            reader.notes.add_unread(arguments[-1])
    reader.including.pop()
    if not reader.including and reader.phase == "world" and not reader.dialect.ends:
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
    if kind == MATRIX:
        return cursor.matrix(token)
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
    if not np.isfinite(matrix).all() or np.linalg.cond(matrix[:3, :3]) > 1e12:
        raise reader.token.error(f"the current transform must be invertible and finite; it becomes {matrix.tolist()}")
    if not np.allclose(matrix[3], [0, 0, 0, 1], rtol=0, atol=1e-9):
        raise reader.token.error(f"a transform must be affine, with last row 0 0 0 1; it has {matrix[3].tolist()}")
    matrix[3] = 0, 0, 0, 1
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


def _camera(reader: Reader, name: Token, p: Parameters) -> None:
    name.among("the camera", ("perspective",))
    reader.camera, reader.to_camera = p, reader.state.to_world
    reader.systems["camera"] = inverse(reader.state.to_world)


def _film(reader: Reader, name: Token, p: Parameters) -> None:
    name.among("the film", reader.dialect.film)
    reader.film = p


def _pixel_filter(reader: Reader, name: Token, p: Parameters) -> None:
    v4 = reader.dialect is V4
    usual = {"box": 0.5, "gaussian": 1.5 if v4 else 2.0}.get(name.name, 2.0)
    x, y = (p.number(half, usual) for half in reader.dialect.radius)
    sigma = p.number("sigma", 0.5) if name.name == "gaussian" and v4 else 0.5
    if name.name == "gaussian" and not v4:  # exp(-alpha x^2)
        alpha = p.number("alpha", 2)
        if not alpha > 0:
            raise p.items["alpha"].token.error(f"alpha must be positive, or the filter has no width; got {alpha:g}")
        sigma = (2 * alpha) ** -0.5
    with blame(name):
        pixel_filter = PixelFilter(name.name, (x, y), sigma)
    reader.filter = None if pixel_filter == PixelFilter("box", (0.5, 0.5)) else pixel_filter


def _integrator(reader: Reader, name: Token, p: Parameters) -> None:
    dialect = reader.dialect
    p.require(dialect.required.get("Integrator", {}))
    paths = ("path",) if dialect is V2 else ("path", "volpath")
    name.among("the integrator", paths if dialect is V4 else ("directlighting", *paths))
    depth = p.integer("maxdepth", 5)
    if name.name == "directlighting":
        reader.samples.strategy = p.string("strategy", "all", ("all", "one"))
        depth = max(depth, 1)  # none is left out at depth 0 either
    else:
        # In pbrt-v2 the light at vertices 0 to maxdepth is gathered before the loop is left (integrators/path.cpp), in
        # v3 and v4 the loop is left first, with light from maxdepth vertices (integrators/path.cpp, `bounces >=
        # maxDepth`; cpu/integrators.cpp, `depth++ == maxDepth`; volpath alike).
        reader.samples.strategy, depth = "one", depth + dialect.beyond
    if not 1 <= depth <= MAX_DEPTH:
        rule = f"must let 1 to {MAX_DEPTH} surfaces scatter light, else only lights are seen"
        raise p.items["maxdepth"].token.error(f"maxdepth {rule}; here it is {depth}")
    reader.integrator = ("direct" if name.name == "directlighting" else "path"), depth


def _option(reader: Reader, p: Parameters) -> None:
    p.require(reader.dialect.required["Option"])
    for item in p.items.values():
        item.token.find("option", item.name, dict.fromkeys([*p.read_names, *IRRELEVANT["Option"]]))


def _make_named_medium(reader: Reader, name: Token, p: Parameters) -> None:
    empty = p.string("type", "") == "homogeneous" and all(
        (coefficient := p.get(key, "color", "rgb", "spectrum")) is not None and not any(coefficient.colour())
        for key in ("sigma_a", "sigma_s")
    )
    reader.vacuums = reader.vacuums | {name.name} if empty else reader.vacuums - {name.name}
    _unused(reader)


def _medium_interface(reader: Reader, *names: Token | None) -> None:
    for name in names:
        if name is not None and name.text != '""' and name.name not in reader.vacuums:
            raise name.error("a medium changes the image, and media are not supported; remove it to render a vacuum")
    _unused(reader)


def _active_transform(reader: Reader, which: Token) -> None:
    if which.text != "All":
        raise which.error("ActiveTransform must be All, because motion is not supported; remove the line")


def _unused(reader: Reader, *arguments: object) -> None:
    reader.notes.add_unused(reader.token)


def _only(what: str, supported: str) -> Callable[..., None]:
    """Return a directive that does nothing, and whose string, `what`, must be the one that is supported."""
    return lambda reader, name, *others: name.among(what, (supported,))


def _volume(reader: Reader) -> None:
    raise reader.token.error("volumes are not supported")


_DIRECTIVES: dict[str, Directive] = {
    "Include": ("any", _include, ("a file name",)),
    "Import": ("world", _import, ("a file name",)),
    "Identity": ("any", lambda reader: _set_transform(reader, np.eye(4)), ()),
    "Translate": ("any", _concatenated(transforms.translate), (3,)),
    "Scale": ("any", _concatenated(transforms.scale), (3,)),
    "Rotate": ("any", _concatenated(lambda numbers: transforms.rotate(numbers[0], numbers[1:])), (4,)),
    "LookAt": ("any", _concatenated(lambda numbers: transforms.look_at(*numbers.reshape(3, 3))), (9,)),
    "Transform": ("any", lambda reader, matrix: _set_transform(reader, matrix.copy()), (MATRIX,)),
    "ConcatTransform": ("any", _concatenated(lambda matrix: matrix), (MATRIX,)),
    "CoordinateSystem": ("any", _name_system, ("a name",)),
    "CoordSysTransform": ("any", _return_to_system, ("a name",)),
    "ActiveTransform": ("any", _active_transform, (WORD,)),
    "TransformTimes": ("options", _unused, (2,)),
    "ReverseOrientation": ("world", lambda reader: reader.change(reverse=not reader.state.reverse), ()),
    "WorldBegin": ("options", _world_begin, ()),
    "WorldEnd": ("world", _world_end, ()),
    "AttributeBegin": ("world", Reader.open_block, ()),
    "AttributeEnd": ("world", Reader.close_block, ()),
    "TransformBegin": ("world", Reader.open_block, ()),
    "TransformEnd": ("world", Reader.close_block, ()),
    **WORLD,
    "Volume": ("world", _volume, ()),
    "Option": ("options", _option, (PARAMETERS,)),
    "ColorSpace": ("any", _only("the colour space", "srgb"), ("a name",)),
    "MakeNamedMedium": ("any", _make_named_medium, ("a name", KEPT)),
    "MediumInterface": ("any", _medium_interface, ("the name of a medium", OPTIONAL)),
    "Camera": ("options", _camera, ("a kind of camera", KEPT)),
    "Film": ("options", _film, ("a kind of film", KEPT)),
    "PixelFilter": ("options", _pixel_filter, ("a kind of filter", PARAMETERS)),
    "Sampler": ("options", lambda reader, *line: reader.samples.read_sampler(*line), ("a kind of sampler", PARAMETERS)),
    "SurfaceIntegrator": ("options", _integrator, ("a kind of integrator", PARAMETERS)),
    "Integrator": ("options", _integrator, ("a kind of integrator", PARAMETERS)),
    "VolumeIntegrator": ("options", _unused, ("a kind", KEPT)),
    "Renderer": ("options", _only("the renderer", "sampler"), ("a kind of renderer", PARAMETERS)),
    "Accelerator": ("options", _unused, ("a kind", KEPT)),
}
_SPECIAL = frozenset().union(*(dialect.directives for dialect in DIALECTS.values()))
