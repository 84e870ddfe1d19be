"""The directives of pbrt-v2 files, and what each does to a `dmis.pbrt_reader.Reader`."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from dmis import geometry
from dmis.pbrt_objects import check_material, make_light, make_material, make_texture, radiance
from dmis.pbrt_reader import Reader, inverse
from dmis.pbrt_shapes import make_light_part, make_shape
from dmis.pbrt_tokens import Cursor, Floats, Source, Token, blame

MAX_INCLUDES = 32
BOX_FILTER = 'PixelFilter "box" "float xwidth" [0.5] "float ywidth" [0.5]'


def carry_out(reader: Reader, source: Source) -> None:
    """Carry out a file's directives."""
    reader.including.append(source.path.resolve())
    cursor = Cursor(source)
    while (token := cursor.next()).kind != "end":
        reader.token = token
        if token.kind != "word" or not token.text[0].isalpha():
            raise token.error("a directive is expected here, such as Shape or Translate")
        if token.text not in _DIRECTIVES:
            raise token.error(_unknown(token.text))
        phase, directive = _DIRECTIVES[token.text]
        if reader.phase == "end":
            raise token.error("nothing may follow WorldEnd, because one file makes one image")
        if phase not in ("any", reader.phase):
            where = "before WorldBegin" if phase == "options" else "between WorldBegin and WorldEnd"
            raise token.error(f"{token.text} must stand {where}")
        directive(reader, token, cursor)
    reader.including.pop()
    if not reader.including and reader.phase != "end":
        raise token.error(f"{'WorldEnd' if reader.phase == 'world' else 'WorldBegin'} is missing")


def _unknown(word: str) -> str:
    if word in _LATER:
        return f"{word} belongs to a later dialect, where the same words mean other things; only pbrt-v2 is read"
    return f"there is no such directive; there are {', '.join(_DIRECTIVES)}"


# Each directive is given the reader, its own token, and the cursor behind it

_Directive = Callable[[Reader, Token, Cursor], None]


def _include(reader: Reader, token: Token, cursor: Cursor) -> None:
    name = cursor.string(token, "a file name")
    path = name.file(name.name)
    if path.resolve() in reader.including:
        raise name.error("a file must not include itself, because that would have no end")
    if len(reader.including) >= MAX_INCLUDES:
        raise name.error(f"files must not include each other to a depth of more than {MAX_INCLUDES}")
    with blame(name):
        source = Source.read(path, top=name.source.folders[-1])
    carry_out(reader, source)


def _set(reader: Reader, token: Token, matrix: Floats) -> None:
    """Make `matrix` the current transform."""
    linear = matrix[:3, :3]
    if not np.isfinite(matrix).all() or np.linalg.cond(linear) > 1e12:
        raise token.error(f"the current transform must be invertible and finite; it becomes {matrix.tolist()}")
    if not np.allclose(matrix[3], [0, 0, 0, 1], rtol=0, atol=1e-9):
        raise token.error(f"a transform must be affine, with last row 0 0 0 1; it has {matrix[3].tolist()}")
    matrix[3] = 0, 0, 0, 1
    reader.state = replace(reader.state, to_world=matrix)


def _identity(reader: Reader, token: Token, cursor: Cursor) -> None:
    _set(reader, token, np.eye(4))


def _translate(reader: Reader, token: Token, cursor: Cursor) -> None:
    _set(reader, token, reader.state.to_world @ geometry.translate(cursor.numbers(token, 3)))


def _scale(reader: Reader, token: Token, cursor: Cursor) -> None:
    _set(reader, token, reader.state.to_world @ geometry.scale(cursor.numbers(token, 3)))


def _rotate(reader: Reader, token: Token, cursor: Cursor) -> None:
    degrees, *axis = cursor.numbers(token, 4)
    with blame(token):
        _set(reader, token, reader.state.to_world @ geometry.rotate(degrees, axis))


def _look_at(reader: Reader, token: Token, cursor: Cursor) -> None:
    eye, at, up = cursor.numbers(token, 9).reshape(3, 3)
    with blame(token):
        _set(reader, token, reader.state.to_world @ geometry.look_at(eye, at, up))


def _transform(reader: Reader, token: Token, cursor: Cursor) -> None:
    _set(reader, token, cursor.matrix(token).copy())


def _concat_transform(reader: Reader, token: Token, cursor: Cursor) -> None:
    _set(reader, token, reader.state.to_world @ cursor.matrix(token))


def _coordinate_system(reader: Reader, token: Token, cursor: Cursor) -> None:
    reader.systems[cursor.string(token, "a name").name] = reader.state.to_world


def _coord_sys_transform(reader: Reader, token: Token, cursor: Cursor) -> None:
    name = cursor.string(token, "a name")
    if name.name not in reader.systems:
        known = ", ".join(map(repr, reader.systems)) or "none yet"
        raise name.error(f"there is no coordinate system of this name; there are: {known}")
    reader.state = replace(reader.state, to_world=reader.systems[name.name])


def _active_transform(reader: Reader, token: Token, cursor: Cursor) -> None:
    which = cursor.next()
    if which.text != "All":
        raise which.error("ActiveTransform must be All, because nothing moves while the shutter is open")


def _transform_times(reader: Reader, token: Token, cursor: Cursor) -> None:
    cursor.numbers(token, 2)
    reader.skip(token)


def _reverse_orientation(reader: Reader, token: Token, cursor: Cursor) -> None:
    reader.state = replace(reader.state, reverse=not reader.state.reverse)


def _begin(reader: Reader, token: Token, cursor: Cursor) -> None:
    reader.blocks.append((token, reader.state))


def _end(reader: Reader, token: Token, cursor: Cursor) -> None:
    _pop(reader, token)


def _pop(reader: Reader, token: Token) -> None:
    """Close the block that was opened last, which must be of the same kind."""
    opener = token.text.replace("End", "Begin")
    if not reader.blocks:
        raise token.error(f"{token.text} must close {opener}; nothing is open")
    open_one = reader.blocks[-1][0]
    if open_one.text != opener:
        raise token.error(f"{token.text} must close {opener}; {open_one.text} of line {open_one.line} is open")
    _, saved = reader.blocks.pop()
    reader.state = replace(reader.state, to_world=saved.to_world) if opener == "TransformBegin" else saved


def _world_begin(reader: Reader, token: Token, cursor: Cursor) -> None:
    reader.phase = "world"
    _set(reader, token, np.eye(4))
    reader.systems["world"] = reader.state.to_world


def _world_end(reader: Reader, token: Token, cursor: Cursor) -> None:
    if reader.blocks:
        open_one = reader.blocks[-1][0]
        raise token.error(f"{open_one.text} of line {open_one.line} is still open")
    reader.phase = "end"


# Options


def _camera(reader: Reader, token: Token, cursor: Cursor) -> None:
    name = cursor.string(token, "a kind of camera")
    if name.name != "perspective":
        raise name.error("the camera must be perspective; others are not supported")
    reader.camera, reader.to_camera = cursor.parameters(token), reader.state.to_world
    reader.systems["camera"] = inverse(reader.state.to_world)


def _film(reader: Reader, token: Token, cursor: Cursor) -> None:
    name = cursor.string(token, "a kind of film")
    if name.name != "image":
        raise name.error("the film must be image; others are not supported")
    reader.film = cursor.parameters(token)


def _pixel_filter(reader: Reader, token: Token, cursor: Cursor) -> None:
    name = cursor.string(token, "a kind of filter")
    p = cursor.parameters(token)
    if name.name != "box" or (p.number("xwidth", 0.5), p.number("ywidth", 0.5)) != (0.5, 0.5):
        raise name.error(f"the filter must be a box of one pixel, no other is rendered; make the line {BOX_FILTER}")
    reader.note(p)


def _integrator(reader: Reader, token: Token, cursor: Cursor) -> None:
    name = cursor.string(token, "a kind of integrator")
    p = cursor.parameters(token)
    if name.name == "path":
        raise name.error('paths are not supported yet; for direct light alone write SurfaceIntegrator "directlighting"')
    if name.name != "directlighting":
        raise name.error("the integrator must be directlighting; others make other images")
    strategy = p.string("strategy", "all")
    if strategy not in ("all", "one"):
        raise p.items["strategy"].token.error(f"strategy must be all or one; got {strategy!r}")
    if strategy == "one":
        p.asked.discard("strategy")  # lights are sampled as the renderer is told; the expected image is the same
    if p.integer("maxdepth", 5) != 5:
        reader.depth = p.items["maxdepth"].token
        p.asked.discard("maxdepth")
    reader.note(p)


def _renderer(reader: Reader, token: Token, cursor: Cursor) -> None:
    name = cursor.string(token, "a kind of renderer")
    if name.name != "sampler":
        raise name.error("the renderer must be sampler; others are not supported")
    reader.note(cursor.parameters(token))


def _ignored(reader: Reader, token: Token, cursor: Cursor) -> None:
    cursor.string(token, "a kind")
    cursor.parameters(token)
    reader.skip(token)


def _volume(reader: Reader, token: Token, cursor: Cursor) -> None:
    raise token.error("volumes are not supported")


# The world


def _texture(reader: Reader, token: Token, cursor: Cursor) -> None:
    name, kind = cursor.string(token, "a name"), cursor.string(token, "a type, float or color,")
    kind_name = "color" if kind.name == "spectrum" else kind.name
    if kind_name not in ("float", "color"):
        raise kind.error("the type of a texture must be float or color")
    made_of = cursor.string(token, "a class, such as imagemap,")
    parameters = cursor.parameters(token)
    value = make_texture(kind_name, made_of, parameters, reader.state.textures)
    reader.note(parameters)
    reader.state = replace(reader.state, textures={**reader.state.textures, (kind_name, name.name): value})


def _material(reader: Reader, token: Token, cursor: Cursor) -> None:
    name = cursor.string(token, "a kind of material")
    check_material(name)
    reader.state = replace(reader.state, material=(name, cursor.parameters(token)), named=None)


def _make_named_material(reader: Reader, token: Token, cursor: Cursor) -> None:
    name, own = cursor.string(token, "a name"), cursor.parameters(token)
    kind = own.string("type")
    kind_token = own.items["type"].token._replace(text=f'"{kind}"')
    check_material(kind_token)
    made = make_material(kind_token, (own, reader.state.material[1]), reader.state.textures)
    reader.note(own)
    reader.state = replace(reader.state, named_materials={**reader.state.named_materials, name.name: made})


def _named_material(reader: Reader, token: Token, cursor: Cursor) -> None:
    name = cursor.string(token, "a name")
    if name.name not in reader.state.named_materials:
        known = ", ".join(map(repr, reader.state.named_materials)) or "none"
        raise name.error(f"there is no material of this name here; there are: {known}")
    reader.state = replace(reader.state, named=name.name)


def _light_source(reader: Reader, token: Token, cursor: Cursor) -> None:
    name, parameters = cursor.string(token, "a kind of light"), cursor.parameters(token)
    reader.lights.append(make_light(name, parameters, reader.state.to_world))
    reader.note(parameters)


def _area_light_source(reader: Reader, token: Token, cursor: Cursor) -> None:
    name, parameters = cursor.string(token, "a kind of area light"), cursor.parameters(token)
    if name.name not in ("area", "diffuse"):
        raise name.error("an area light must be area (or diffuse, the same); others are not supported")
    emitted = radiance(parameters)
    if min(emitted) < 0:
        raise name.error(f"the radiance of a light must not be negative; got {emitted}")
    reader.note(parameters)
    reader.state = replace(reader.state, area_light=emitted)


def _shape(reader: Reader, token: Token, cursor: Cursor) -> None:
    name, parameters = cursor.string(token, "a kind of shape"), cursor.parameters(token)
    state = reader.state
    shape = make_shape(name, parameters, state.to_world, state.reverse)
    material = reader.material_for(parameters)
    reader.note(parameters)
    if state.area_light is None:
        reader.add(token, [(shape, material)])
        return
    if reader.object is not None:
        raise token.error("a shape in an object must not emit, because its instances could not be sampled")
    part, light = make_light_part(shape, material, state.area_light)
    reader.bright.append(part)
    reader.lights.append(light)


def _object_begin(reader: Reader, token: Token, cursor: Cursor) -> None:
    name = cursor.string(token, "a name")
    if reader.object is not None:
        raise token.error("an object must not be defined within another one")
    reader.blocks.append((token, reader.state))
    reader.object = reader.objects[name.name] = []


def _object_end(reader: Reader, token: Token, cursor: Cursor) -> None:
    _pop(reader, token)
    reader.object = None


def _object_instance(reader: Reader, token: Token, cursor: Cursor) -> None:
    name = cursor.string(token, "a name")
    if reader.object is not None:
        raise token.error("an object must not hold instances of others")
    if name.name not in reader.objects:
        known = ", ".join(map(repr, reader.objects)) or "none"
        raise name.error(f"there is no object of this name; there are: {known}")
    placed: dict[int, Floats] = {}
    copies = []
    for shape, material in reader.objects[name.name]:
        to_world = placed.setdefault(id(shape.to_world), reader.state.to_world @ shape.to_world)
        copies.append((replace(shape, to_world=to_world), material))
    reader.add(token, copies)


_DIRECTIVES: dict[str, tuple[str, _Directive]] = {
    "Include": ("any", _include),
    "Identity": ("any", _identity),
    "Translate": ("any", _translate),
    "Scale": ("any", _scale),
    "Rotate": ("any", _rotate),
    "LookAt": ("any", _look_at),
    "Transform": ("any", _transform),
    "ConcatTransform": ("any", _concat_transform),
    "CoordinateSystem": ("any", _coordinate_system),
    "CoordSysTransform": ("any", _coord_sys_transform),
    "ActiveTransform": ("any", _active_transform),
    "TransformTimes": ("options", _transform_times),
    "Camera": ("options", _camera),
    "Film": ("options", _film),
    "PixelFilter": ("options", _pixel_filter),
    "Sampler": ("options", _ignored),
    "SurfaceIntegrator": ("options", _integrator),
    "VolumeIntegrator": ("options", _ignored),
    "Renderer": ("options", _renderer),
    "Accelerator": ("options", _ignored),
    "WorldBegin": ("options", _world_begin),
    "WorldEnd": ("world", _world_end),
    "AttributeBegin": ("world", _begin),
    "AttributeEnd": ("world", _end),
    "TransformBegin": ("world", _begin),
    "TransformEnd": ("world", _end),
    "ObjectBegin": ("world", _object_begin),
    "ObjectEnd": ("world", _object_end),
    "ObjectInstance": ("world", _object_instance),
    "ReverseOrientation": ("world", _reverse_orientation),
    "Texture": ("world", _texture),
    "Material": ("world", _material),
    "MakeNamedMaterial": ("world", _make_named_material),
    "NamedMaterial": ("world", _named_material),
    "LightSource": ("world", _light_source),
    "AreaLightSource": ("world", _area_light_source),
    "Shape": ("world", _shape),
    "Volume": ("world", _volume),
}
_LATER = ("Integrator", "MakeNamedMedium", "MediumInterface", "Option", "Attribute", "ColorSpace", "Import")
