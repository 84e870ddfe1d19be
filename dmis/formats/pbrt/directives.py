"""Execution of pbrt's directives on a `dmis.formats.pbrt.reader.Reader`; the directives of files, blocks and options.

The other directives are in `dmis.formats.pbrt.transforms` and `dmis.formats.pbrt.world`.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from dmis.base.validate import did_you_mean
from dmis.formats.pbrt.cursor import Cursor
from dmis.formats.pbrt.dialect import DIALECTS, V2, V4
from dmis.formats.pbrt.parameters import Parameters
from dmis.formats.pbrt.reader import Directive, Reader, State, inverse
from dmis.formats.pbrt.tokens import MAX_TEXT, Source, Token, blame
from dmis.formats.pbrt.transforms import TRANSFORMS, set_transform
from dmis.formats.pbrt.world import WORLD
from dmis.samplers.pixel_filter import PixelFilter
from dmis.scene.defaults import MAX_DEPTH

MAX_INCLUDES = 32
"""Largest depth of files that include each other."""
MAX_FILES = 10_000
"""Most inclusions of files; a file that is included twice counts twice."""


def carry_out(reader: Reader, source: Source) -> None:
    """Execute the directives of a file on `reader`."""
    reader.including.append(source.path.resolve())
    cursor = Cursor(source)
    while (token := cursor.next()).kind != "end":
        reader.token = token
        if token.kind != "word" or not token.text[0].isalpha():
            raise token.error("a directive is expected here, such as Shape or Translate")
        if token.text not in _DIRECTIVES or token.text in _SPECIAL - reader.dialect.directives:
            raise token.error(_unknown(token.text, reader.dialect.name))
        phase, directive = _DIRECTIVES[token.text]
        if reader.phase == "end":
            raise token.error("nothing may follow WorldEnd, because one file makes one image")
        if phase not in ("any", reader.phase):
            where = "before WorldBegin" if phase == "options" else "between WorldBegin and WorldEnd"
            raise token.error(f"{token.text} must stand {where}")
        directive(reader, token, cursor)
    reader.including.pop()
    if not reader.including and reader.phase == "world" and not reader.dialect.ends:
        _world_end(reader, reader.token, cursor)
    if not reader.including and reader.phase != "end":
        raise token.error(_unfinished(reader))


def _unfinished(reader: Reader) -> str:
    """Return the message about a file that ends too early."""
    if reader.phase != "world":
        return "WorldBegin is missing"
    if "v4" not in reader.fits:
        return "WorldEnd is missing"
    return (
        "WorldEnd is missing: the file is cut off, or looks like pbrt-v4, which has no WorldEnd; for v4 give "
        'dialect="v4" (--dialect v4)'
    )


def _unknown(word: str, dialect: str) -> str:
    """Return the message about a directive that the dialect does not have."""
    owners = [other.name for other in DIALECTS.values() if word in other.directives]
    if owners:
        return (
            f"{word} belongs to {' and '.join(owners)}, where the same words mean other things; this file is read as "
            f"{dialect}: remove the line, or name another dialect (dialect=, --dialect)"
        )
    names = [name for name in _DIRECTIVES if name not in _SPECIAL - DIALECTS[dialect].directives]
    return f"a directive must be one of {', '.join(names)}{did_you_mean(word, names)}"


def _include(reader: Reader, token: Token, cursor: Cursor) -> None:
    name = cursor.string(token, "a file name")
    path = name.file(name.name)
    if path.resolve() in reader.including:
        raise name.error("a file must not include itself, because that would have no end")
    if len(reader.including) >= MAX_INCLUDES:
        raise name.error(f"files must not include each other to a depth of more than {MAX_INCLUDES}")
    with blame(name):
        source = name.source.include(path)
    reader.files, reader.characters = reader.files + 1, reader.characters + len(source.text)
    if reader.files > MAX_FILES or reader.characters > MAX_TEXT:
        raise name.error(f"a scene must not include more than {MAX_FILES} files or {MAX_TEXT} characters in total")
    carry_out(reader, source)


def _import(reader: Reader, token: Token, cursor: Cursor) -> None:
    state, blocks = reader.state, len(reader.blocks)
    _include(reader, token, cursor)
    if len(reader.blocks) != blocks:
        raise token.error("an imported file must close what it opens")
    reader.state = _restored(reader, state)


def _restored(reader: Reader, saved: State) -> State:
    """Return the state at the beginning of a block, with the textures and materials that outlive it."""
    if not reader.dialect.global_names:
        return saved
    return replace(saved, textures=reader.state.textures, named_materials=reader.state.named_materials)


def _reverse_orientation(reader: Reader, token: Token, cursor: Cursor) -> None:
    reader.state = replace(reader.state, reverse=not reader.state.reverse)


def _begin(reader: Reader, token: Token, cursor: Cursor) -> None:
    reader.blocks.append((token, reader.state))


def _end(reader: Reader, token: Token, cursor: Cursor) -> None:
    _pop(reader, token)


def _pop(reader: Reader, token: Token) -> None:
    """Close the innermost open block, which must be of the kind that `token` closes."""
    opener = token.text.replace("End", "Begin")
    if not reader.blocks:
        raise token.error(f"{token.text} must close {opener}; nothing is open")
    innermost = reader.blocks[-1][0]
    if innermost.text != opener:
        raise token.error(f"{token.text} must close {opener}; {innermost.text} of line {innermost.line} is open")
    _, saved = reader.blocks.pop()
    reader.state = (
        replace(reader.state, to_world=saved.to_world) if opener == "TransformBegin" else _restored(reader, saved)
    )


def _world_begin(reader: Reader, token: Token, cursor: Cursor) -> None:
    reader.phase = "world"
    set_transform(reader, token, np.eye(4))
    reader.systems["world"] = reader.state.to_world


def _world_end(reader: Reader, token: Token, cursor: Cursor) -> None:
    if reader.blocks:
        innermost = reader.blocks[-1][0]
        raise token.error(f"{innermost.text} of line {innermost.line} is still open")
    reader.phase = "end"


def _object_begin(reader: Reader, token: Token, cursor: Cursor) -> None:
    name = cursor.string(token, "a name")
    if reader.object is not None:
        raise token.error("an object must not be defined within another one")
    reader.blocks.append((token, reader.state))
    reader.object = reader.objects[name.name] = []


def _object_end(reader: Reader, token: Token, cursor: Cursor) -> None:
    _pop(reader, token)
    reader.object = None


def _camera(reader: Reader, token: Token, cursor: Cursor) -> None:
    name = cursor.string(token, "a kind of camera")
    if name.name != "perspective":
        raise name.error("the camera must be perspective; others are not supported")
    reader.camera, reader.to_camera = cursor.parameters(token), reader.state.to_world
    reader.systems["camera"] = inverse(reader.state.to_world)


def _film(reader: Reader, token: Token, cursor: Cursor) -> None:
    name = cursor.string(token, "a kind of film")
    films = reader.dialect.film
    if name.name not in films:
        raise name.error(f"the film must be {' or '.join(films)}; others are not supported")
    reader.film = cursor.parameters(token)


def _pixel_filter(reader: Reader, token: Token, cursor: Cursor) -> None:
    name = cursor.string(token, "a kind of filter")
    p = cursor.parameters(token)
    usual = {"box": 0.5, "gaussian": 1.5 if reader.dialect.name == "v4" else 2.0}.get(name.name, 2.0)
    x, y = (p.number(half, usual) for half in reader.dialect.radius)
    sigma = 0.5
    if name.name == "gaussian" and reader.dialect.name == "v4":
        sigma = p.number("sigma", 0.5)
    elif name.name == "gaussian":  # exp(-alpha x^2)
        alpha = p.number("alpha", 2)
        if not alpha > 0:
            raise p.items["alpha"].token.error(f"alpha must be positive, or the filter has no width; got {alpha:g}")
        sigma = (2 * alpha) ** -0.5
    with blame(name):
        pixel_filter = PixelFilter(name.name, (x, y), sigma)
    reader.filter = None if pixel_filter == PixelFilter("box", (0.5, 0.5)) else pixel_filter
    reader.filter_line = True
    reader.note(p)


def _integrator(reader: Reader, token: Token, cursor: Cursor) -> None:
    name = cursor.string(token, "a kind of integrator")
    p = cursor.parameters(token)
    dialect = reader.dialect
    p.fixed(dialect.fixed.get("Integrator", {}))
    depth = p.integer("maxdepth", 5)
    if name.name == "path" or (name.name == "volpath" and dialect is not V2):
        # In pbrt-v2 the light at vertices 0 to maxdepth is gathered before the loop is left (integrators/path.cpp), in
        # v3 and v4 the loop is left first, with light from maxdepth vertices (integrators/path.cpp, `bounces >=
        # maxDepth`; cpu/integrators.cpp, `depth++ == maxDepth`; volpath alike).
        reader.integrator, reader.samples.strategy = ("path", _surfaces(p, depth + dialect.beyond)), "one"
        reader.note(p)
        return
    if name.name != "directlighting" or dialect is V4:
        allowed = "path or volpath" if dialect is V4 else "directlighting or path"
        raise name.error(f"the integrator must be {allowed}; others make other images")
    strategy = p.string("strategy", "all")
    if strategy not in ("all", "one"):
        raise p.items["strategy"].token.error(f"strategy must be all or one; got {strategy!r}")
    reader.samples.strategy = strategy
    reader.integrator = "direct", _surfaces(p, max(depth, 1))  # none is left out at depth 0 either
    reader.note(p)


def _surfaces(p: Parameters, depth: int) -> int:
    """Return `depth`; raise a `PbrtError` unless it is from 1 to the largest path depth."""
    if not 1 <= depth <= MAX_DEPTH:
        raise p.items["maxdepth"].token.error(
            f"maxdepth must let 1 to {MAX_DEPTH} surfaces scatter light, else only lights are seen; here it is {depth}"
        )
    return depth


def _renderer(reader: Reader, token: Token, cursor: Cursor) -> None:
    name = cursor.string(token, "a kind of renderer")
    if name.name != "sampler":
        raise name.error("the renderer must be sampler; others are not supported")
    reader.note(cursor.parameters(token))


def _sampler(reader: Reader, token: Token, cursor: Cursor) -> None:
    name = cursor.string(token, "a kind of sampler")
    p = cursor.parameters(token)
    reader.samples.read_sampler(name.name, p)
    reader.note(p)


def _ignored(reader: Reader, token: Token, cursor: Cursor) -> None:
    cursor.string(token, "a kind")
    cursor.parameters(token)
    reader.skip(token)


def _option(reader: Reader, token: Token, cursor: Cursor) -> None:
    p = cursor.parameters(token)
    p.fixed(reader.dialect.fixed["Option"])
    allowed = ("seed", "quiet", "pixelstats", "wavefront", "rendercoordsys", "disablewavelengthjitter")
    for name, item in p.items.items():
        if name not in p.read_names and name not in allowed:
            raise item.token.error(
                f"there is no option {name!r} here; there are {', '.join([*p.read_names, *allowed])}"
            )
    reader.note(p)


def _color_space(reader: Reader, token: Token, cursor: Cursor) -> None:
    name = cursor.string(token, "a name")
    if name.name != "srgb":
        raise name.error("the colour space must be srgb; others are not supported")


def _make_named_medium(reader: Reader, token: Token, cursor: Cursor) -> None:
    name, p = cursor.string(token, "a name"), cursor.parameters(token)
    empty = p.string("type", "") == "homogeneous" and all(
        (coefficient := p.get(key, "color", "rgb", "spectrum")) is not None and not any(coefficient.colour())
        for key in ("sigma_a", "sigma_s")
    )
    p.read_names.update(p.items)
    reader.vacuums = reader.vacuums | {name.name} if empty else reader.vacuums - {name.name}
    reader.skip(token)


def _medium_interface(reader: Reader, token: Token, cursor: Cursor) -> None:
    names = [cursor.string(token, "the name of a medium")]
    if cursor.peek().kind == "string" and " " not in cursor.peek().name:
        names.append(cursor.next())
    for name in names:
        if name.text != '""' and name.name not in reader.vacuums:
            raise name.error("a medium changes the image, and media are not supported; remove it to render a vacuum")
    reader.skip(token)


_DIRECTIVES: dict[str, tuple[str, Directive]] = {
    "Include": ("any", _include),
    "Import": ("world", _import),
    **TRANSFORMS,
    "ReverseOrientation": ("world", _reverse_orientation),
    "WorldBegin": ("options", _world_begin),
    "WorldEnd": ("world", _world_end),
    "AttributeBegin": ("world", _begin),
    "AttributeEnd": ("world", _end),
    "TransformBegin": ("world", _begin),
    "TransformEnd": ("world", _end),
    "ObjectBegin": ("world", _object_begin),
    "ObjectEnd": ("world", _object_end),
    **WORLD,
    "Option": ("options", _option),
    "ColorSpace": ("any", _color_space),
    "MakeNamedMedium": ("any", _make_named_medium),
    "MediumInterface": ("any", _medium_interface),
    "Camera": ("options", _camera),
    "Film": ("options", _film),
    "PixelFilter": ("options", _pixel_filter),
    "Sampler": ("options", _sampler),
    "SurfaceIntegrator": ("options", _integrator),
    "Integrator": ("options", _integrator),
    "VolumeIntegrator": ("options", _ignored),
    "Renderer": ("options", _renderer),
    "Accelerator": ("options", _ignored),
}
_SPECIAL = frozenset().union(*(dialect.directives for dialect in DIALECTS.values()))
