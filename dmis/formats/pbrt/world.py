"""The directives of pbrt files that stand in the world, as a table: textures, materials, lights, shapes, objects."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from dmis.base.vectors import Floats
from dmis.brdf.materials import Material
from dmis.formats.pbrt.dialect import V2, V4
from dmis.formats.pbrt.lights import emission, make_light
from dmis.formats.pbrt.make_material import materials_of
from dmis.formats.pbrt.parameters import ParameterSet
from dmis.formats.pbrt.pbrt_shapes import make_shape
from dmis.formats.pbrt.reader import KEPT, PARAMETERS, Directive, Reader
from dmis.formats.pbrt.tokens import Token


def _texture(reader: Reader, name: Token, kind: Token, made_of: Token, p: ParameterSet) -> None:
    from dmis.formats.pbrt.textures import make_texture

    kind.among("the type of a texture", ("float", "color", "spectrum"))
    key = ("float" if kind.name == "float" else "color"), name.name
    if reader.dialect is V4 and key in reader.state.textures:
        raise name.error("there is a texture of this name; it must have another, because v4 has one of each")
    value: Any = 0.5 if key[0] == "float" else (0.5, 0.5, 0.5)  # stands for one that is refused
    with reader.refusals.collect():
        value = make_texture(key[0], made_of, p)
    reader.change(textures={**reader.state.textures, key: value})


def _check_material(kind: Token) -> None:
    """Refuse a kind of material that the dialect does not have."""
    if kind.name in ("interface", "none", ""):
        raise kind.error("a surface that only bounds a medium is not supported, nor are media; remove its shapes")
    kind.among("a material", materials_of(kind.dialect))


def _material(reader: Reader, name: Token, p: ParameterSet) -> None:
    """Keep the line: its material is made where a shape has it."""
    _check_material(name)
    reader.change(material=(name, p), named=None)


def _make_named_material(reader: Reader, name: Token, p: ParameterSet) -> None:
    kind = p.string("type")
    token = p.items["type"].token._replace(text=f'"{kind}"')
    own = p
    if reader.dialect is V2:  # what it lacks is that of the Material line, whose textures count before constants
        line = reader.state.material[1].items
        textures = {key: item for items in (line, p.items) for key, item in items.items() if item.kind == "texture"}
        own = replace(p, items={**line, **p.items, **textures})
    material = Material(())  # stands for one that is refused
    with reader.refusals.collect():
        _check_material(token)
        material = reader.make_material(token, own)
    reader.change(named_materials={**reader.state.named_materials, name.name: material})


def _named_material(reader: Reader, name: Token) -> None:
    """Take a named material; one that is not defined leaves the Material line, but in v4."""
    if reader.dialect is not V4 and name.name not in reader.state.named_materials:
        reader.notes.add("material that is not defined, the Material line taken, as pbrt does", name.text, name)
        return
    name.find("material", name.name, reader.state.named_materials)
    reader.change(named=name.name)


def _light_source(reader: Reader, name: Token, p: ParameterSet) -> None:
    reader.lights.append(make_light(name, p, reader.to_world()))
    reader.samples.light_samples.append(reader.samples.of_light(p))


def _area_light_source(reader: Reader, name: Token, p: ParameterSet) -> None:
    """Let the shapes of this block emit."""
    name.among("an area light", ("area", "diffuse"))
    emitted = emission(p)
    if min(emitted) < 0:
        raise name.error(f"the radiance of a light must not be negative; got {emitted}")
    reader.samples.of_light(p)  # notes the parameter as read
    if reader.dialect is not V2:
        p.boolean("twosided", False)
    reader.change(area_light=p)


def _shape(reader: Reader, name: Token, p: ParameterSet) -> None:
    """Add a shape, or one or two that emit, with the current material."""
    state, corners = reader.state, p.items.get("indices")
    if corners is not None and not len(corners.values) and reader.dialect is not V4:
        reader.notes.add("mesh without triangles, left out, as pbrt does", "Shape", reader.token)
        p.read_names |= set(p.items)
        return
    shape = make_shape(name, p, reader.to_world(), state.reverse)
    material = reader.material()
    if state.area_light is None:
        reader.add(shape, material)
        return
    if reader.object is not None:
        raise reader.token.error("a shape in an object must not emit, because its instances could not be sampled")
    sides = [shape]
    if reader.dialect is not V2 and state.area_light.boolean("twosided", False):
        if shape.kind == "sphere":
            raise reader.token.error("a sphere that emits must not be twosided, which is not supported; use a mesh")
        sides = [replace(shape, reverse=reverse, twosided=True) for reverse in (False, True)]
    for side in sides:
        reader.count(side)
        reader.emitters.append((len(reader.lights), side, material, state.area_light))
        reader.lights.append(None)
        reader.samples.light_samples.append(reader.samples.of_light(state.area_light))


def _object_begin(reader: Reader, name: Token) -> None:
    if reader.object is not None:
        raise reader.token.error("an object must not be defined within another one")
    reader.open_block()
    reader.object = reader.objects[name.name] = []


def _object_end(reader: Reader) -> None:
    reader.close_block()
    reader.object = None


def _object_instance(reader: Reader, name: Token) -> None:
    """Add the shapes of an object, moved by the current transform."""
    if reader.object is not None:
        raise reader.token.error("an object must not hold instances of others")
    members = name.find("object", name.name, reader.objects)
    placed: dict[int, Floats] = {}
    for shape, material in members:
        to_world = placed.setdefault(id(shape.to_world), reader.to_world() @ shape.to_world)
        reader.add(replace(shape, to_world=to_world), material)


WORLD: dict[str, Directive] = {
    "Texture": ("world", _texture, ("a name", "a type, float or color,", "a class, such as imagemap,", PARAMETERS)),
    "Material": ("world", _material, ("a kind of material", KEPT)),
    "MakeNamedMaterial": ("world", _make_named_material, ("a name", PARAMETERS)),
    "NamedMaterial": ("world", _named_material, ("a name",)),
    "LightSource": ("world", _light_source, ("a kind of light", PARAMETERS)),
    "AreaLightSource": ("world", _area_light_source, ("a kind of area light", PARAMETERS)),
    "Shape": ("world", _shape, ("a kind of shape", PARAMETERS)),
    "ObjectBegin": ("world", _object_begin, ("a name",)),
    "ObjectEnd": ("world", _object_end, ()),
    "ObjectInstance": ("world", _object_instance, ("a name",)),
}
"""Directives by name."""
