"""The directives of pbrt files that stand in the world: textures, materials, lights, shapes, objects."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from dmis.base.vectors import Floats
from dmis.formats.pbrt.cursor import Cursor
from dmis.formats.pbrt.dialect import V2, V4
from dmis.formats.pbrt.lights import emission, make_light
from dmis.formats.pbrt.materials import check_material
from dmis.formats.pbrt.objects import make_texture
from dmis.formats.pbrt.parameters import Parameters
from dmis.formats.pbrt.reader import Directive, Reader
from dmis.formats.pbrt.shapes import make_shape
from dmis.formats.pbrt.tokens import Token


def _attribute(reader: Reader, token: Token, cursor: Cursor) -> None:
    kind = cursor.string(token, "shape, light, material, medium or texture")
    if kind.name not in ("shape", "light", "material", "medium", "texture"):
        raise kind.error("Attribute must be of shape, light, material, medium or texture")
    items = {**reader.state.added.get(kind.name, {}), **cursor.parameters(token).items}
    reader.state = replace(reader.state, added={**reader.state.added, kind.name: items})


def _parameters(reader: Reader, token: Token, cursor: Cursor, kind: str) -> Parameters:
    """Read the parameters of a shape, light, material or texture, with those that Attribute lines add."""
    p = cursor.parameters(token)
    extra = reader.state.added.get(kind)
    return Parameters(p.directive, {**extra, **p.items}) if extra else p


def _texture(reader: Reader, token: Token, cursor: Cursor) -> None:
    name, kind = cursor.string(token, "a name"), cursor.string(token, "a type, float or color,")
    kind_name = "color" if kind.name == "spectrum" else kind.name
    if kind_name not in ("float", "color"):
        raise kind.error("the type of a texture must be float or color")
    made_of = cursor.string(token, "a class, such as imagemap,")
    parameters = _parameters(reader, token, cursor, "texture")
    if reader.dialect is V4 and (kind_name, name.name) in reader.state.textures:
        raise name.error("there is a texture of this name; it must have another, because v4 has one of each")
    value = make_texture(kind_name, made_of, parameters, reader.state.textures)
    reader.note(parameters)
    reader.state = replace(reader.state, textures={**reader.state.textures, (kind_name, name.name): value})


def _material(reader: Reader, token: Token, cursor: Cursor) -> None:
    name = cursor.string(token, "a kind of material")
    check_material(name)
    reader.state = replace(reader.state, material=(name, _parameters(reader, token, cursor, "material")), named=None)


def _make_named_material(reader: Reader, token: Token, cursor: Cursor) -> None:
    name, parameters = cursor.string(token, "a name"), cursor.parameters(token)
    kind = parameters.string("type")
    kind_token = parameters.items["type"].token._replace(text=f'"{kind}"')
    check_material(kind_token)
    lists = (parameters, reader.state.material[1]) if reader.dialect is V2 else (parameters,)
    material = reader.make_material(kind_token, lists)
    reader.note(parameters)
    state = replace(reader.state, named_materials={**reader.state.named_materials, name.name: material})
    if reader.dialect is not V2 and reader.dialect.overrides:
        state = replace(state, recipes={**state.recipes, name.name: (kind_token, parameters)})
    reader.state = state


def _named_material(reader: Reader, token: Token, cursor: Cursor) -> None:
    name = cursor.string(token, "a name")
    reader.named(name, name.name)
    if name.name in reader.state.recipes:  # as if its line stood here, so that Shape lines may change it
        reader.state = replace(reader.state, material=reader.state.recipes[name.name], named=None)
    else:
        reader.state = replace(reader.state, named=name.name)


def _light_source(reader: Reader, token: Token, cursor: Cursor) -> None:
    name = cursor.string(token, "a kind of light")
    parameters = _parameters(reader, token, cursor, "light")
    reader.lights.append(make_light(name, parameters, reader.state.to_world))
    reader.samples.light_samples.append(reader.samples.read_light(parameters))
    reader.note(parameters)


def _area_light_source(reader: Reader, token: Token, cursor: Cursor) -> None:
    name = cursor.string(token, "a kind of area light")
    parameters = _parameters(reader, token, cursor, "light")
    if name.name not in ("area", "diffuse"):
        raise name.error("an area light must be area (or diffuse, the same); others are not supported")
    emitted = emission(parameters, lambda: np.ones(1))  # of unit area, to check the parameters here
    if min(emitted) < 0:
        raise name.error(f"the radiance of a light must not be negative; got {emitted}")
    reader.samples.read_light(parameters)
    reader.note(parameters)
    reader.state = replace(reader.state, area_light=parameters)


def _shape(reader: Reader, token: Token, cursor: Cursor) -> None:
    name, parameters = cursor.string(token, "a kind of shape"), _parameters(reader, token, cursor, "shape")
    state = reader.state
    shape = make_shape(name, parameters, state.to_world, state.reverse)
    material = reader.material_for(parameters)
    reader.note(parameters)
    if state.area_light is None:
        reader.add(token, [(shape, material)])
        return
    if reader.object is not None:
        raise token.error("a shape in an object must not emit, because its instances could not be sampled")
    reader.count(token, shape)
    reader.emitters.append((len(reader.lights), shape, material, state.area_light))
    reader.lights.append(None)
    reader.samples.light_samples.append(reader.samples.read_light(state.area_light))


def _object_instance(reader: Reader, token: Token, cursor: Cursor) -> None:
    name = cursor.string(token, "a name")
    if reader.object is not None:
        raise token.error("an object must not hold instances of others")
    if name.name not in reader.objects:
        names = ", ".join(map(repr, reader.objects)) or "none"
        raise name.error(f"there is no object of this name; there are: {names}")
    reader.count(token, *(shape for shape, _ in reader.objects[name.name]))
    placed: dict[int, Floats] = {}
    copies = []
    for shape, material in reader.objects[name.name]:
        to_world = placed.setdefault(id(shape.to_world), reader.state.to_world @ shape.to_world)
        copies.append((replace(shape, to_world=to_world), material))
    reader.shapes += copies


def _volume(reader: Reader, token: Token, cursor: Cursor) -> None:
    raise token.error("volumes are not supported")


WORLD: dict[str, tuple[str, Directive]] = {
    "Attribute": ("world", _attribute),
    "Texture": ("world", _texture),
    "Material": ("world", _material),
    "MakeNamedMaterial": ("world", _make_named_material),
    "NamedMaterial": ("world", _named_material),
    "LightSource": ("world", _light_source),
    "AreaLightSource": ("world", _area_light_source),
    "Shape": ("world", _shape),
    "ObjectInstance": ("world", _object_instance),
    "Volume": ("world", _volume),
}
