"""Scenes from pbrt-v2 files.

`read_pbrt` reads the text format of pbrt-v2, M. Pharr and G. Humphreys, *Physically Based Rendering*, 2nd edition,
appendix B. It never makes a wrong image in silence: what it does not know or cannot render is an error that names file,
line and token; options and parameters that do not change the expected image are named in one warning. Later dialects
of the format mean other things by the same words and are refused.

What pbrt-v2 does and a textbook would not; the rest of the library knows nothing of it:

* Camera space is left-handed, and ``LookAt`` makes such a space: x right, y up, z forward.
* ``plastic`` and ``uber`` take the Fresnel reflectance from inside the coat: total beyond 42 degrees at index 1.5.
* The exponent of a Blinn lobe is at most 10000, so a roughness is at least 1e-4; negative reflectances become 0.
* A texture given in the Material line beats a constant in the Shape line, which beats a constant in the Material line.
  A named material takes what it lacks from the current Material line, and nothing from Shape lines.
* ``from`` of a point light is added in world space, after the current transform.
* Area lights emit on one side. Disks, spheres and cylinders do so along their normals, triangles along their winding in
  world space, and ReverseOrientation turns both. pbrt-v2 has this rule for points that it samples on a light; for
  triangles that rays hit it takes dp/du x dp/dv, turned also by transforms that change handedness, so a mirrored mesh
  or mirrored texture coordinates give it two different bright sides. Here the sampled side holds for both.
* A disk or sphere that emits has its radius from object space, which makes pbrt-v2's image wrong under any scaling.
  Here uniform scaling is right, and other scaling is an error.
* The outside of glass is the side of the vertex normals, if there are any, else of dp/du x dp/dv; a transform that
  changes handedness turns it, and so does ReverseOrientation.
* An image's first row is at t = 0, and its texels are (scale * texel) ^ gamma. Images are bilinear here; pbrt-v2 blurs
  by about a texel more.
* Without a PixelFilter line the filter is a box of one pixel. It is the only one that is rendered.

Quadrics are tessellated, but those that emit are sampled and hit as what they are.
"""

from __future__ import annotations

import os
import warnings
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from dmis import geometry
from dmis.brdf import SpecularReflection, SpecularTransmission
from dmis.camera import Camera
from dmis.light import Light
from dmis.material import Material
from dmis.pbrt_objects import Textures, check_material, make_light, make_material, make_texture, radiance
from dmis.pbrt_shapes import Shape, make_light_part, make_shape, merge
from dmis.pbrt_tokens import Cursor, Floats, Parameters, PbrtError, Source, Token, blame
from dmis.scene import Part, Scene
from dmis.spectrum import Rgb

__all__ = ["PbrtError", "PbrtWarning", "read_pbrt"]

MAX_INCLUDES = 32
BOX_FILTER = 'PixelFilter "box" "float xwidth" [0.5] "float ywidth" [0.5]'


class PbrtWarning(UserWarning):
    """Lines of a pbrt file that were not used, because they do not change the expected image."""


def read_pbrt(path: str | os.PathLike[str], resolution: tuple[int, int] | None = None) -> Scene:
    """Read a pbrt-v2 scene file.

    Parameters
    ----------
    path
        The file. Names in it are relative to the folder of the file that they stand in, else to that of `path`.
    resolution
        ``(width, height)`` in place of the file's. The field of view belongs to the shorter side, so a change of shape
        shows more or less on the longer one.

    Returns
    -------
    Scene
        Its name is the file's. Shapes of one material are joined; see `dmis.pbrt_shapes.merge`.

    Raises
    ------
    FileNotFoundError
        If there is no such file.
    PbrtError
        If it is malformed, or asks for what is not supported; the message begins ``FILE:LINE: token TOKEN:``.

    Warns
    -----
    PbrtWarning
        Once, if something in the file was not used.
    """
    path = Path(path)
    if not path.is_file():
        raise FileNotFoundError(f"there is no scene file {path}")
    reader = _Reader(resolution)
    reader.read(Source.read(path))
    scene = reader.scene(path.stem)
    reader.warn(path)
    return scene


@dataclass(frozen=True, eq=False)
class _State:
    """What AttributeBegin saves. Nothing here is changed in place."""

    to_world: Floats
    reverse: bool = False
    material: Parameters | None = None
    material_name: Token | None = None
    named: str | None = None
    named_materials: Mapping[str, Material] = field(default_factory=dict)
    textures: Textures = field(default_factory=dict)
    area_light: Rgb | None = None


class _Reader:
    """Carries out directives, one after the other."""

    def __init__(self, resolution: tuple[int, int] | None) -> None:
        self.resolution = resolution
        self.state = _State(np.eye(4))
        self.stack: list[tuple[Token, _State]] = []
        self.systems: dict[str, Floats] = {}
        self.phase = "options"
        self.last: Token | None = None
        self.camera: tuple[Token, Parameters, Floats] | None = None
        self.film: Parameters | None = None
        self.depth: Token | None = None
        self.shapes: list[tuple[Shape, Material]] = []
        self.lit: list[Part] = []
        self.lights: list[Light] = []
        self.objects: dict[str, list[tuple[Shape, Material]]] = {}
        self.object: list[tuple[Shape, Material]] | None = None
        self.materials: dict[tuple[int, int], tuple[Material, set[str], object]] = {}
        self.unused: dict[str, list[Token]] = {}
        self.including: list[Path] = []

    def read(self, source: Source) -> None:
        """Carry out a file's directives."""
        real = source.path.resolve()
        self.including.append(real)
        cursor = Cursor(source)
        while (token := cursor.next()).kind != "end":
            self.last = token
            if token.kind != "word":
                raise token.error("a directive is expected here, such as Shape or Translate")
            if token.text not in _DIRECTIVES:
                raise token.error(_unknown(token.text))
            phase, carry_out = _DIRECTIVES[token.text]
            if phase != "any" and phase != self.phase:
                where = {"options": "before WorldBegin", "world": "between WorldBegin and WorldEnd"}[phase]
                raise token.error(f"{token.text} belongs {where}")
            if self.phase == "end":
                raise token.error("nothing may follow WorldEnd; one file holds one image")
            carry_out(self, token, cursor)
        self.including.pop()
        if not self.including and self.phase != "end":
            missing = "WorldEnd" if self.phase == "world" else "WorldBegin"
            raise token.error(f"{missing} is missing")

    # What the file became ------------------------------------------------------------------------------------------

    def scene(self, name: str) -> Scene:
        """The scene, once all is read."""
        assert self.last is not None
        parts = self.lit + merge(self.shapes)
        with blame(self.last):
            scene = Scene(self._camera(), tuple(parts), tuple(self.lights), name)
        delta = (SpecularReflection, SpecularTransmission)
        if self.depth is not None and any(isinstance(x, delta) for part in parts for x in part.material.lobes):
            raise self.depth.error("mirrors and glass are followed to depth 5; for another depth remove maxdepth here "
                                   "and set the renderer's")  # fmt: skip
        return scene

    def _camera(self) -> Camera:
        film = self.film
        size = (film.integer("xresolution", 640), film.integer("yresolution", 480)) if film else (640, 480)
        token = film.directive if film else self.last
        width, height = self.resolution or size
        to_camera, fov = np.eye(4), 90.0
        if self.camera is not None:
            token, p, to_camera = self.camera
            fov = p.number("fov", 90)
            half = p.number("halffov", -1)
            fov = 2 * half if half > 0 else fov
            if p.number("lensradius", 0) != 0:
                raise p.items["lensradius"].token.error("the camera is a pinhole; lensradius must be 0")
            ratio = width / height
            if not np.isclose(p.number("frameaspectratio", ratio), ratio, rtol=1e-6):
                raise p.items["frameaspectratio"].token.error(
                    f"pixels are square; frameaspectratio must be {width}/{height}, that of the resolution, or absent"
                )
            window = p.table("screenwindow", "float", 4)
            x, y = max(ratio, 1), max(1 / ratio, 1)
            if window is not None and not np.allclose(window, [-x, x, -y, y], rtol=1e-6):
                raise p.items["screenwindow"].token.error(
                    f"screenwindow is not supported unless it is the whole screen, {[-x, x, -y, y]} here; use fov"
                )
            self.note(p)
        if film is not None:
            crop = film.table("cropwindow", "float", 4)
            if crop is not None and not np.array_equal(crop[0], [0, 1, 0, 1]):
                raise film.items["cropwindow"].token.error("cropwindow is not supported unless it is [0 1 0 1], the whole image")
            self.note(film)
        assert token is not None
        with blame(token):
            return Camera(_inverse(to_camera), fov, (width, height))

    # What the warning says -----------------------------------------------------------------------------------------

    def note(self, parameters: Parameters) -> None:
        """Remember the parameters that nobody asked for."""
        for name in parameters.unused():
            where = f"parameter {name!r} of {parameters.directive.text}"
            self.unused.setdefault(where, []).append(parameters.items[name].token)

    def skip(self, token: Token) -> None:
        """Remember a directive that is not used."""
        self.unused.setdefault(token.text, []).append(token)

    def warn(self, path: Path) -> None:
        """Warn of all that was not used."""
        if not self.unused:
            return
        told = []
        for what, tokens in self.unused.items():
            file = "" if tokens[0].source.path == path else f"{tokens[0].source.path}:"
            more = f" and {len(tokens) - 1} more" if len(tokens) > 1 else ""
            told.append(f"{what} (line {file}{tokens[0].line}{more})")
        text = f"{path}: not used, because it does not change the expected image here: {', '.join(told)}"
        warnings.warn(PbrtWarning(text), stacklevel=3)

    # Materials -----------------------------------------------------------------------------------------------------

    def material_of(self, shape: Parameters) -> Material:
        """The current material, with what the Shape line changes."""
        state = self.state
        if state.named is not None:
            return state.named_materials[state.named]
        name, base = state.material_name, state.material
        if name is None or base is None:
            name, base = Token("string", '"matte"', shape.directive.source, shape.directive.start), _NO_PARAMETERS
        key = id(base), id(state.textures)
        if key not in self.materials:
            base.asked.clear()
            own = make_material(name, (base,), state.textures)
            self.materials[key] = own, set(base.asked), (base, state.textures)
            self.note(base)
        own, asked, _ = self.materials[key]
        return own if asked.isdisjoint(shape.items) else make_material(name, (shape, base), state.textures)


_NO_PARAMETERS = Parameters(Token("word", "Material", Source(Path(), "", ()), 0), {})


def _inverse(matrix: Floats) -> Floats:
    """Inverse of an affine map."""
    out = np.linalg.inv(matrix)
    out[3] = 0, 0, 0, 1
    return out


def _unknown(word: str) -> str:
    if word in _LATER:
        return f"{word} belongs to a later dialect of the format, in which other words mean other things; pbrt-v2 is read here"
    return f"there is no directive {word}; those of pbrt-v2 are {', '.join(_DIRECTIVES)}"


# Directives: each is given the reader, its own token, and the cursor after it ---------------------------------------

_Directive = Callable[[_Reader, Token, Cursor], None]


def _include(reader: _Reader, token: Token, cursor: Cursor) -> None:
    name = cursor.string(token, "a file name")
    path = name.file(name.name)
    if path.resolve() in reader.including:
        raise name.error("a file must not include itself, because that has no end")
    if len(reader.including) >= MAX_INCLUDES:
        raise name.error(f"files may include each other to a depth of {MAX_INCLUDES}")
    with blame(name):
        source = Source.read(path, Path(os.devnull) if not reader.including else _top(name))
    reader.read(source)


def _top(token: Token) -> Path:
    """A file in the folder of the file that was read first."""
    return token.source.folders[-1] / "top"


def _set(reader: _Reader, token: Token, matrix: Floats) -> None:
    """Make `matrix` the current transform."""
    linear = matrix[:3, :3]
    if not np.isfinite(matrix).all() or np.linalg.cond(linear) > 1e12:
        raise token.error(f"the current transform must be invertible and finite; it becomes {matrix.tolist()}")
    if not np.allclose(matrix[3], [0, 0, 0, 1], rtol=0, atol=1e-9):
        raise token.error(f"a transform must be affine, with last row 0 0 0 1; it has {matrix[3].tolist()}")
    matrix[3] = 0, 0, 0, 1
    reader.state = replace(reader.state, to_world=matrix)


def _identity(reader: _Reader, token: Token, cursor: Cursor) -> None:
    _set(reader, token, np.eye(4))


def _translate(reader: _Reader, token: Token, cursor: Cursor) -> None:
    _set(reader, token, reader.state.to_world @ geometry.translate(cursor.numbers(token, 3)))


def _scale(reader: _Reader, token: Token, cursor: Cursor) -> None:
    _set(reader, token, reader.state.to_world @ geometry.scale(cursor.numbers(token, 3)))


def _rotate(reader: _Reader, token: Token, cursor: Cursor) -> None:
    degrees, *axis = cursor.numbers(token, 4)
    with blame(token):
        _set(reader, token, reader.state.to_world @ geometry.rotate(degrees, axis))


def _look_at(reader: _Reader, token: Token, cursor: Cursor) -> None:
    eye, at, up = cursor.numbers(token, 9).reshape(3, 3)
    with blame(token):
        _set(reader, token, reader.state.to_world @ geometry.look_at(eye, at, up))


def _transform(reader: _Reader, token: Token, cursor: Cursor) -> None:
    _set(reader, token, cursor.matrix(token).copy())


def _concat_transform(reader: _Reader, token: Token, cursor: Cursor) -> None:
    _set(reader, token, reader.state.to_world @ cursor.matrix(token))


def _coordinate_system(reader: _Reader, token: Token, cursor: Cursor) -> None:
    reader.systems[cursor.string(token, "a name").name] = reader.state.to_world


def _coord_sys_transform(reader: _Reader, token: Token, cursor: Cursor) -> None:
    name = cursor.string(token, "a name")
    if name.name not in reader.systems:
        known = ", ".join(map(repr, reader.systems)) or "none yet"
        raise name.error(f"there is no coordinate system of this name; there are: {known}")
    reader.state = replace(reader.state, to_world=reader.systems[name.name])


def _active_transform(reader: _Reader, token: Token, cursor: Cursor) -> None:
    which = cursor.next()
    if which.text != "All":
        raise which.error("ActiveTransform must be All, because nothing moves while the shutter is open")


def _transform_times(reader: _Reader, token: Token, cursor: Cursor) -> None:
    cursor.numbers(token, 2)
    reader.skip(token)


def _reverse_orientation(reader: _Reader, token: Token, cursor: Cursor) -> None:
    reader.state = replace(reader.state, reverse=not reader.state.reverse)


def _begin(reader: _Reader, token: Token, cursor: Cursor) -> None:
    reader.stack.append((token, reader.state))


def _end(reader: _Reader, token: Token, cursor: Cursor) -> None:
    _pop(reader, token)


def _pop(reader: _Reader, token: Token) -> None:
    """Close the block that was opened last, which must be of the same kind."""
    opener = token.text.replace("End", "Begin")
    if not reader.stack or reader.stack[-1][0].text != opener:
        inside = f"the open block is {reader.stack[-1][0].text} of line {reader.stack[-1][0].line}" if reader.stack else "none is open"
        raise token.error(f"{token.text} must close {opener}, but {inside}")
    _, saved = reader.stack.pop()
    reader.state = replace(reader.state, to_world=saved.to_world) if opener == "TransformBegin" else saved


def _world_begin(reader: _Reader, token: Token, cursor: Cursor) -> None:
    reader.phase = "world"
    _set(reader, token, np.eye(4))
    reader.systems["world"] = reader.state.to_world


def _world_end(reader: _Reader, token: Token, cursor: Cursor) -> None:
    if reader.stack:
        opener = reader.stack[-1][0]
        raise token.error(f"{opener.text} of line {opener.line} is still open")
    reader.phase = "end"


# Options


def _camera(reader: _Reader, token: Token, cursor: Cursor) -> None:
    name = cursor.string(token, "a kind of camera")
    if name.name != "perspective":
        raise name.error("the camera must be perspective; others are not supported")
    reader.camera = token, cursor.parameters(token), reader.state.to_world
    reader.systems["camera"] = _inverse(reader.state.to_world)


def _film(reader: _Reader, token: Token, cursor: Cursor) -> None:
    name = cursor.string(token, "a kind of film")
    if name.name != "image":
        raise name.error("the film must be image; others are not supported")
    reader.film = cursor.parameters(token)


def _pixel_filter(reader: _Reader, token: Token, cursor: Cursor) -> None:
    name = cursor.string(token, "a kind of filter")
    p = cursor.parameters(token)
    if name.name != "box" or (p.number("xwidth", 0.5), p.number("ywidth", 0.5)) != (0.5, 0.5):
        raise name.error(f"the filter must be a box of one pixel, because no other is rendered: make the line {BOX_FILTER}")
    reader.note(p)


def _integrator(reader: _Reader, token: Token, cursor: Cursor) -> None:
    name = cursor.string(token, "a kind of integrator")
    p = cursor.parameters(token)
    if name.name == "path":
        raise name.error('path tracing is not supported yet; for direct light alone write SurfaceIntegrator "directlighting"')
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


def _renderer(reader: _Reader, token: Token, cursor: Cursor) -> None:
    name = cursor.string(token, "a kind of renderer")
    if name.name != "sampler":
        raise name.error("the renderer must be sampler; others are not supported")
    reader.note(cursor.parameters(token))


def _ignored(reader: _Reader, token: Token, cursor: Cursor) -> None:
    cursor.string(token, "a kind")
    cursor.parameters(token)
    reader.skip(token)


def _volume(reader: _Reader, token: Token, cursor: Cursor) -> None:
    raise token.error("volumes are not supported")


# The world


def _texture(reader: _Reader, token: Token, cursor: Cursor) -> None:
    name, kind = cursor.string(token, "a name"), cursor.string(token, "a type, float or color,")
    kind_name = "color" if kind.name == "spectrum" else kind.name
    if kind_name not in ("float", "color"):
        raise kind.error("the type of a texture must be float or color")
    made_of = cursor.string(token, "a class, such as imagemap,")
    parameters = cursor.parameters(token)
    value = make_texture(kind_name, made_of, parameters, reader.state.textures)
    reader.note(parameters)
    reader.state = replace(reader.state, textures={**reader.state.textures, (kind_name, name.name): value})


def _material(reader: _Reader, token: Token, cursor: Cursor) -> None:
    name = cursor.string(token, "a kind of material")
    check_material(name)
    reader.state = replace(reader.state, material_name=name, material=cursor.parameters(token), named=None)


def _make_named_material(reader: _Reader, token: Token, cursor: Cursor) -> None:
    name, own = cursor.string(token, "a name"), cursor.parameters(token)
    kind = own.string("type")
    kind_token = own.items["type"].token._replace(text=f'"{kind}"')
    check_material(kind_token)
    lists = (own,) if reader.state.material is None else (own, reader.state.material)
    made = make_material(kind_token, lists, reader.state.textures)
    reader.note(own)
    reader.state = replace(reader.state, named_materials={**reader.state.named_materials, name.name: made})


def _named_material(reader: _Reader, token: Token, cursor: Cursor) -> None:
    name = cursor.string(token, "a name")
    if name.name not in reader.state.named_materials:
        known = ", ".join(map(repr, reader.state.named_materials)) or "none"
        raise name.error(f"there is no material of this name here; there are: {known}")
    reader.state = replace(reader.state, named=name.name)


def _light_source(reader: _Reader, token: Token, cursor: Cursor) -> None:
    name, parameters = cursor.string(token, "a kind of light"), cursor.parameters(token)
    reader.lights.append(make_light(name, parameters, reader.state.to_world))
    reader.note(parameters)


def _area_light_source(reader: _Reader, token: Token, cursor: Cursor) -> None:
    name, parameters = cursor.string(token, "a kind of area light"), cursor.parameters(token)
    if name.name not in ("area", "diffuse"):
        raise name.error("an area light must be area (or diffuse, the same); others are not supported")
    emitted = radiance(parameters)
    if min(emitted) < 0:
        raise name.error(f"the radiance of a light must not be negative; got {emitted}")
    reader.note(parameters)
    reader.state = replace(reader.state, area_light=emitted)


def _shape(reader: _Reader, token: Token, cursor: Cursor) -> None:
    name, parameters = cursor.string(token, "a kind of shape"), cursor.parameters(token)
    state = reader.state
    shape = make_shape(name, parameters, state.to_world, state.reverse)
    material = reader.material_of(parameters)
    reader.note(parameters)
    if state.area_light is None:
        (reader.shapes if reader.object is None else reader.object).append((shape, material))
        return
    if reader.object is not None:
        raise token.error("a shape in an object must not emit, because its instances could not be sampled")
    part, light = make_light_part(shape, material, state.area_light)
    reader.lit.append(part)
    reader.lights.append(light)


def _object_begin(reader: _Reader, token: Token, cursor: Cursor) -> None:
    name = cursor.string(token, "a name")
    if reader.object is not None:
        raise token.error("an object must not be defined within another one")
    reader.stack.append((token, reader.state))
    reader.object = reader.objects[name.name] = []


def _object_end(reader: _Reader, token: Token, cursor: Cursor) -> None:
    _pop(reader, token)
    reader.object = None


def _object_instance(reader: _Reader, token: Token, cursor: Cursor) -> None:
    name = cursor.string(token, "a name")
    if reader.object is not None:
        raise token.error("an object must not hold instances of others")
    if name.name not in reader.objects:
        known = ", ".join(map(repr, reader.objects)) or "none"
        raise name.error(f"there is no object of this name; there are: {known}")
    placed: dict[int, Floats] = {}
    for shape, material in reader.objects[name.name]:
        to_world = placed.setdefault(id(shape.to_world), reader.state.to_world @ shape.to_world)
        reader.shapes.append((replace(shape, to_world=to_world), material))


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
