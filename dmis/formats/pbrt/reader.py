"""State of reading a pbrt file, the directives of its world, and the scene that is made of it.

`dmis.formats.pbrt.directives` executes the directives of a file on a `Reader`; `WORLD` has those of textures,
materials, lights, shapes and objects.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from dmis.base.vectors import Floats
from dmis.brdf.materials import Material
from dmis.formats.pbrt.dialect import V2, V4
from dmis.formats.pbrt.lights import emission, make_light
from dmis.formats.pbrt.make_material import make_material, materials_of
from dmis.formats.pbrt.notes import Notes, Refusals
from dmis.formats.pbrt.parameters import ParameterSet, Textures
from dmis.formats.pbrt.parts import make_light_part, merge
from dmis.formats.pbrt.pbrt_shapes import Shape, make_shape, tessellate_quadrics
from dmis.formats.pbrt.quadrics import TRIANGLE_BUDGET, VISIBLE_ERROR
from dmis.formats.pbrt.tokens import Source, Token, blame
from dmis.light.light import Light
from dmis.scene.camera import Camera
from dmis.scene.scene import Scene
from dmis.scene.suggestions import DEFAULT_DEPTH, Suggestions

MAX_SCENE_TRIANGLES = 2**25
"""Most triangles of a scene: some 8 GB."""
MAX_QUADRICS = 2**14
"""Most spheres, cylinders and disks of a scene, instances counted: lines are chosen for each, in some 0.5 ms."""
PARAMETERS, KEPT, WORD, OPTIONAL = "parameters", "kept parameters", "word", "optional string"
"""Arguments of a directive: parameters, of which those that it does not read are noted for a warning; parameters that
are read later; a word; a string that may be absent. A whole number stands for as many numbers, any other text for a
string in quotes that it describes."""


@dataclass(frozen=True, eq=False)
class State:
    """Graphics state, which AttributeBegin saves. Nothing in it is changed in place.

    Attributes
    ----------
    to_world
        The current transform, 4x4.
    reverse
        Whether ReverseOrientation is on.
    material
        The kind and the parameters of the Material line.
    named
        Name of the material of the NamedMaterial line, which replaces the Material line.
    named_materials, textures
        Materials and textures by name.
    area_light
        Parameters of the AreaLightSource line; None if shapes do not emit.
    """

    to_world: Floats
    material: tuple[Token, ParameterSet]
    reverse: bool = False
    named: str | None = None
    named_materials: Mapping[str, Material] = field(default_factory=dict)
    textures: Textures = field(default_factory=dict)
    area_light: ParameterSet | None = None


class Reader:
    """State of reading a pbrt file: options, graphics state, shapes and lights so far, and warnings."""

    def __init__(self, source: Source, resolution: tuple[int, int] | None) -> None:
        self.source, self.resolution = source, resolution
        self.token = Token("word", "", source, 0)
        """The directive that is executed, for errors."""
        self.dialect = source.dialect
        nothing = ParameterSet(self.token, {})
        default = '"diffuse"' if self.dialect.name == "v4" else '"matte"'
        self.state = State(np.eye(4), (Token("string", default, source, 0), nothing))
        self.blocks: list[tuple[Token, State]] = []
        self.phase = "options"
        self.including: list[Path] = []
        self.files = 0
        self.suggested = Suggestions("direct" if self.dialect is V2 else "path", DEFAULT_DEPTH)
        self.metropolis = False
        """Whether a Renderer line decides about the integrator."""
        self.rounds = self.dialect is V2
        """Whether the sampler rounds numbers of samples up to powers of two; the default sampler of v2 does."""
        self.filter = self.dialect.filter
        self.systems: dict[str, Floats] = {}
        self.film = self.camera = nothing
        self.to_camera, self.camera_kind = np.eye(4), "perspective"
        self.shapes: list[tuple[Shape, Material]] = []
        self.objects: dict[str, list[tuple[Shape, Material]]] = {}
        self.object: list[tuple[Shape, Material]] | None = None
        self.triangles = self.quadrics = 0
        self.emitters: list[tuple[int, Shape, Material, ParameterSet]] = []
        """Shapes that emit, with their places among the lights, which are None there until `scene`."""
        self.lights: list[Light | None] = []
        self.light_samples: list[int] = []
        """Samples that each light asks for."""
        self._materials: dict[tuple[int, int], tuple[Material, object]] = {}
        self.notes = Notes(source)
        self.refusals = Refusals()

    def change(self, **changes: Any) -> None:
        """Change the graphics state."""
        self.state = replace(self.state, **changes)

    def open_block(self) -> None:
        """Save the state for the end of the block that the directive begins."""
        self.blocks.append((self.token, self.state))

    def close_block(self) -> None:
        """Close the innermost open block, which must be of the kind that the directive closes."""
        opener = self.token.text.replace("End", "Begin")
        innermost = self.blocks[-1][0] if self.blocks else None
        if innermost is None or innermost.text != opener:
            what = f"{innermost.text} of line {innermost.line} is open" if innermost else "nothing is open"
            raise self.token.error(f"{self.token.text} must close {opener}; {what}")
        _, saved = self.blocks.pop()
        if opener == "TransformBegin":
            self.change(to_world=saved.to_world)
            return
        kept = self.state if self.dialect is V4 else saved  # textures and named materials outlive a block in v4
        self.state = replace(saved, textures=kept.textures, named_materials=kept.named_materials)

    def material(self) -> Material:
        """Return the current material, the same object for all shapes that have it, by which they can be joined."""
        state = self.state
        if state.named is not None:
            return state.named_materials[state.named]
        name, parameters = state.material
        key = id(parameters), id(state.textures)
        if key not in self._materials:
            self._materials[key] = self.make_material(name, parameters), state  # keeps alive what the key refers to
            self.notes.add_parameters(parameters)
        return self._materials[key][0]

    def make_material(self, name: Token, parameters: ParameterSet) -> Material:
        """Return the material `name` made from parameters."""
        textures = self.state.textures if self.dialect is V2 else parameters.textures  # of the shape; of the line
        return make_material(name, replace(parameters, textures=textures), self.state.named_materials)

    def to_world(self) -> Floats:
        """Return the current transform (4, 4), which must be invertible, finite and affine where it is used."""
        matrix = self.state.to_world
        if not np.isfinite(matrix).all() or np.linalg.cond(matrix[:3, :3]) > 1e12:
            raise self.token.error(f"the current transform must be invertible and finite; it is {matrix.tolist()}")
        if not np.allclose(matrix[3], [0, 0, 0, 1], rtol=0, atol=1e-9):
            raise self.token.error(f"a transform must be affine, with last row 0 0 0 1; it has {matrix[3].tolist()}")
        return matrix

    def add(self, shape: Shape, material: Material) -> None:
        """Add a shape to the world, or to the object that is being defined."""
        (self.shapes if self.object is None else self.object).append((shape, material))
        self.count(shape)

    def add_light(self, light: Light | None, p: ParameterSet) -> None:
        """Add a light, None for one that `scene` makes, with the samples that its line asks for."""
        self.lights.append(light)
        self.light_samples.append(self.samples_of(p))

    def samples_of(self, p: ParameterSet) -> int:
        """Return the number of samples that the line of a light asks for, rounded as the file's sampler does."""
        number = p.request("nsamples", 1) if self.dialect is not V4 else 1
        number = p.request("samples", number) if self.dialect.name == "v3" else number
        return power_of_two(number) if self.rounds else number

    def count(self, *shapes: Shape) -> None:
        """Count triangles and quadrics; raise a `PbrtError` if there are too many."""
        self.triangles += sum(shape.mesh.triangles for shape in shapes)
        self.quadrics += sum(shape.quadric is not None for shape in shapes)
        if self.triangles > (most := MAX_SCENE_TRIANGLES):
            raise self.token.error(f"a scene must have at most {most} triangles, because instances are copied", True)
        if self.quadrics > (most := MAX_QUADRICS):
            reason = "because each becomes triangles of its own; make meshes of them (plymesh)"
            raise self.token.error(f"a scene must have at most {most:,} spheres, cylinders and disks, {reason}", True)

    def scene(self, camera: Camera) -> Scene:
        """Return the scene, after all files are read; raise a `PbrtError` that lists all that is not supported."""
        placed = [*(shape for _, shape, *_ in self.emitters), *(shape for shape, _ in self.shapes)]
        placed, quadrics = tessellate_quadrics(placed, len(self.emitters), camera, MAX_SCENE_TRIANGLES)
        self.triangles = self.quadrics = 0
        self.count(*placed)
        bright, lights = [], list(self.lights)
        for shape, (place, _, material, emits) in zip(placed, self.emitters, strict=False):
            with self.refusals.collect():
                lamp, lights[place] = make_light_part(shape, material, emission(emits))
                bright.append(lamp)
        if self.refusals:
            raise self.refusals.error()
        others = zip(placed[len(self.emitters) :], (material for _, material in self.shapes), strict=True)
        parts = bright + merge(others)
        finished = tuple(light for light in lights if light is not None)
        pairs = zip(lights, self.light_samples, strict=True)
        light_samples = tuple(number for light, number in pairs if light is not None and not light.delta)
        suggested = replace(self.suggested, light_samples=light_samples)
        if quadrics is not None and quadrics["pixels"] > VISIBLE_ERROR:
            self.notes.warnings.append(
                f"{self.source.path}: spheres, cylinders and disks ({quadrics['shapes']:,}) are off by up to "
                f"{quadrics['pixels']:.2g} pixels, because they have at most {TRIANGLE_BUDGET} triangles; have "
                f"fewer of them, farther from the camera, a field of view from 1 to 170 degrees, or a lower resolution"
            )
        with blame(self.token):
            source = {} if quadrics is None else {"quadrics": quadrics}
            return Scene(camera, tuple(parts), finished, self.source.path.stem, suggested, source=source)


def power_of_two(number: int) -> int:
    """Return the least power of two that is not below `number`."""
    return 1 << max(number - 1, 0).bit_length()


Directive = tuple[str, Callable[..., None], tuple[int | str, ...]]
"""Phase in which a directive stands (options, world or any), function that executes it, and arguments that it takes.

The function gets the reader and the arguments: tokens of strings, arrays of numbers, `ParameterSet`.
"""


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
    reader.add_light(make_light(name, p, reader.to_world()), p)


def _area_light_source(reader: Reader, name: Token, p: ParameterSet) -> None:
    """Let the shapes of this block emit."""
    name.among("an area light", ("area", "diffuse"))
    emitted = emission(p)
    if min(emitted) < 0:
        raise name.error(f"the radiance of a light must not be negative; got {emitted}")
    reader.samples_of(p)  # notes the parameter as read
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
        reader.add_light(None, state.area_light)


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
