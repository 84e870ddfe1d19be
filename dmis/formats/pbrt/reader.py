"""State of reading a pbrt file, and the scene that is made of it.

`dmis.formats.pbrt.directives` executes the directives of a file on a `Reader`.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from dmis.base.validate import did_you_mean
from dmis.base.vectors import Floats
from dmis.brdf.materials import Material
from dmis.formats.pbrt.cursor import Cursor
from dmis.formats.pbrt.dialect import IRRELEVANT, V1_PARAMETERS
from dmis.formats.pbrt.lights import emission
from dmis.formats.pbrt.materials import make_material
from dmis.formats.pbrt.objects import Textures
from dmis.formats.pbrt.parameters import SPECTRUM_TYPES, Parameter, Parameters
from dmis.formats.pbrt.parts import areas, make_light_part, merge
from dmis.formats.pbrt.quadrics import TRIANGLE_BUDGET, VISIBLE_ERROR
from dmis.formats.pbrt.shapes import Shape, tessellate_quadrics
from dmis.formats.pbrt.suggestions import SampleRequests
from dmis.formats.pbrt.tokens import Source, Token, blame
from dmis.light.light import AreaLight, Light
from dmis.scene.camera import Camera
from dmis.scene.defaults import DEFAULT_DEPTH
from dmis.scene.scene import Scene, SceneWarning

MAX_SCENE_TRIANGLES = 2**25
"""Most triangles of a scene: some 8 GB."""
_TOO_MANY = "a scene must have at most {} triangles, because instances are copied"
MIN_LIKENESS = 0.8
"""Similarity, 0 to 1, from which on an unknown parameter may be a misspelt one."""


class PbrtWarning(SceneWarning):
    """Warning about lines of a pbrt file that were not used, probably have another meaning, or are too bright.

    Lines are not used if they do not change the expected image or are unknown. Reflectances above 1 are too bright;
    below 0 they are taken as 0.
    """


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
    recipes
        Kinds and parameters of named materials that Shape lines may override (v3).
    area_light
        Parameters of the AreaLightSource line; None if shapes do not emit.
    added
        Parameters that Attribute lines add, by the kind of object: shape, light, material, medium or texture.
    """

    to_world: Floats
    material: tuple[Token, Parameters]
    reverse: bool = False
    named: str | None = None
    named_materials: Mapping[str, Material] = field(default_factory=dict)
    textures: Textures = field(default_factory=dict)
    recipes: Mapping[str, tuple[Token, Parameters]] = field(default_factory=dict)
    area_light: Parameters | None = None
    added: Mapping[str, Mapping[str, Parameter]] = field(default_factory=dict)


class Reader:
    """State of reading a pbrt file: options, graphics state, shapes and lights so far, and warnings."""

    def __init__(self, source: Source, resolution: tuple[int, int] | None, fits: tuple[str, ...] = ()) -> None:
        self.source, self.resolution = source, resolution
        self.fits = fits
        """Dialects that the words of the file fit, where no caller has chosen one."""
        self.token = Token("word", "", source, 0)
        self.dialect = source.dialect
        nothing = Parameters(self.token, {})
        default = '"diffuse"' if self.dialect.name == "v4" else '"matte"'
        self.state = State(np.eye(4), (Token("string", default, source, 0), nothing))
        self.blocks: list[tuple[Token, State]] = []
        self.phase = "options"
        self.including: list[Path] = []
        self.files, self.characters = 0, 0
        self.integrator = "direct" if self.dialect.name == "v2" else "path", DEFAULT_DEPTH
        self.samples = SampleRequests(self.dialect.name)
        self.filter, self.filter_line = self.dialect.filter, False
        self.v1_token: Token | None = None
        self.vacuums: set[str] = set()
        self.systems: dict[str, Floats] = {}
        self.film = self.camera = nothing
        self.to_camera = np.eye(4)
        self.shapes: list[tuple[Shape, Material]] = []
        self.objects: dict[str, list[tuple[Shape, Material]]] = {}
        self.object: list[tuple[Shape, Material]] | None = None
        self.triangles = self.object_triangles = 0
        self.emitters: list[tuple[int, Shape, Material, Parameters]] = []
        """Shapes that emit, with their places among the lights, which are None there until `scene`."""
        self.lights: list[Light | None] = []
        self.quadrics: dict[str, Any] | None = None
        self._materials: dict[tuple[int, int], tuple[Material, object]] = {}
        self._unused: dict[str, list[Token]] = {}
        self._unknown: dict[str, list[Token]] = {}
        self._doubts: list[str] = []
        self._bright: dict[str, dict[int, Token]] = {}
        self._negative: dict[str, dict[int, Token]] = {}

    def material_for(self, shape: Parameters) -> Material:
        """Return the current material, with the parameters that the Shape line overrides.

        Shapes that change nothing get the same object, by which they can be joined.
        """
        state = self.state
        if state.named is not None:
            return state.named_materials[state.named]
        name, parameters = state.material
        key = id(parameters), id(state.textures)
        if key not in self._materials:
            material = self.make_material(name, (parameters,))
            self._materials[key] = material, state  # keeps alive what the key is the address of
            self.note(parameters)
        if not self.dialect.overrides or parameters.read_names.isdisjoint(shape.items):
            return self._materials[key][0]
        return self.make_material(name, (shape, parameters))

    def make_material(self, name: Token, lists: tuple[Parameters, ...]) -> Material:
        """Return the material `name` made from the parameter `lists`; note reflectances outside of [0, 1]."""
        material = make_material(name, lists, self.state.textures, self.named)
        for parameters in lists:
            for table, names in ((self._bright, parameters.bright_names), (self._negative, parameters.negative_names)):
                for key in names:
                    token = parameters.items[key].token
                    table.setdefault(f"{key!r} of {parameters.directive.text}", {})[id(token)] = token
        return material

    def named(self, token: Token, name: str) -> Material:
        """Return the material called `name`."""
        if name not in self.state.named_materials:
            names = ", ".join(map(repr, self.state.named_materials)) or "none"
            raise token.error(f"there is no material of this name here; there are: {names}")
        return self.state.named_materials[name]

    def add(self, token: Token, shapes: list[tuple[Shape, Material]]) -> None:
        """Add shapes to the world, or to the object that is being defined."""
        if self.object is not None:
            self.object += shapes
        else:
            self.shapes += shapes
        self.count(token, *(shape for shape, _ in shapes))

    def count(self, token: Token, *shapes: Shape) -> None:
        """Count triangles, of the world or of objects; raise a `PbrtError` if there are too many."""
        more = sum(shape.mesh.triangles for shape in shapes)
        self.object_triangles += more if self.object is not None else 0
        self.triangles += more if self.object is None else 0
        if max(self.triangles, self.object_triangles) > MAX_SCENE_TRIANGLES:
            raise token.error(_TOO_MANY.format(MAX_SCENE_TRIANGLES))

    def scene(self) -> Scene:
        """Return the scene, after all files are read."""
        camera = self._camera()
        placed = [*(shape for _, shape, *_ in self.emitters), *(shape for shape, _ in self.shapes)]
        placed, self.quadrics = tessellate_quadrics(placed, len(self.emitters), camera, MAX_SCENE_TRIANGLES)
        if sum(shape.mesh.triangles for shape in placed) > MAX_SCENE_TRIANGLES:
            raise self.token.error(_TOO_MANY.format(MAX_SCENE_TRIANGLES))
        bright, lights = [], list(self.lights)
        for shape, (place, _, material, emits) in zip(placed, self.emitters, strict=False):
            lamp, lights[place] = make_light_part(shape, material, emission(emits, partial(areas, shape)))
            self._doubt_overlap(shape.token, lamp.light)
            bright.append(lamp)
        others = zip(placed[len(bright) :], (material for _, material in self.shapes), strict=True)
        parts = bright + merge(others)
        source = {} if self.quadrics is None else {"quadrics": self.quadrics}
        finished = tuple(light for light in lights if light is not None)
        suggested = self.samples.suggestions(self.integrator, lights)
        with blame(self.token):
            return Scene(camera, tuple(parts), finished, self.source.path.stem, suggested, source=source)

    def _camera(self) -> Camera:
        film, p = self.film, self.camera
        wide, high = self.dialect.film_size
        size = film.integer("xresolution", wide), film.integer("yresolution", high)
        film.refuse("pixelbounds", "pixelbounds is not supported; use cropwindow")
        film.fixed(self.dialect.fixed.get("Film", {}))
        p.fixed(self.dialect.fixed.get("Camera", {}))
        crop = film.table("cropwindow", "float", 4)
        if self.resolution is None:
            with blame(film.directive):
                Camera(np.eye(4), 90.0, size)
        width, height = self.resolution or size
        half, fov = p.number("halffov", 0), p.number("fov", 90)
        if p.number("lensradius", 0) != 0:
            raise p.items["lensradius"].token.error("lensradius must be 0; only a pinhole is supported")
        ratio = width / height
        if not np.isclose(p.number("frameaspectratio", ratio), ratio, rtol=1e-6):
            raise p.items["frameaspectratio"].token.error(f"frameaspectratio must be that of square pixels, {ratio:g}")
        x, y = max(ratio, 1), max(1 / ratio, 1)
        window = p.table("screenwindow", "float", 4)
        if window is not None and not np.allclose(window, [-x, x, -y, y], rtol=1e-6):
            raise p.items["screenwindow"].token.error(
                f"screenwindow must be [{-x:g} {x:g} {-y:g} {y:g}]; use fov instead"
            )
        self.note(film)
        self.note(p)
        with blame(p.directive):
            camera = Camera(inverse(self.to_camera), 2 * half if half > 0 else fov, (width, height), filter=self.filter)
        if crop is None:
            return camera
        token = film.items["cropwindow"].token
        if crop.shape != (1, 4) or not ((crop >= 0) & (crop <= 1)).all():
            raise token.error(f"cropwindow must be four shares of the image, 0 to 1: x, x, y, y; got {crop.tolist()}")
        left, right, top, bottom = np.ceil(crop[0] * [width, width, height, height]).astype(int).tolist()
        with blame(token):
            return camera.crop((top, bottom), (left, right))

    def note(self, parameters: Parameters) -> None:
        """Note the parameters that were not read, for the warning."""
        for name in parameters.unused():
            if name in V1_PARAMETERS.get(parameters.directive.text, ()):
                self.v1_token = self.v1_token or parameters.items[name].token
            directive, item = parameters.directive.text, parameters.items[name]
            what = f"parameter {name!r} of {directive}"
            if directive in ("Sampler", "Renderer") or name in IRRELEVANT.get(directive, ()):
                self._unused.setdefault(what, []).append(item.token)
                continue
            hint = did_you_mean(name, parameters.read_names, MIN_LIKENESS)
            if directive in ("LightSource", "AreaLightSource") and item.kind in SPECTRUM_TYPES:
                meant = "I" if "I" in parameters.read_names else "L"
                hint = "" if meant in parameters.items else f", did you mean {meant!r}?"
            self._unknown.setdefault(what + hint, []).append(item.token)

    def skip(self, token: Token) -> None:
        """Note a directive that is not used, for the warning."""
        self._unused.setdefault(token.text, []).append(token)

    def doubt(self, token: Token, message: str) -> None:
        """Note a warning about `token`, whose line is used as it stands."""
        self._doubts.append(f"{token.source.path}:{token.line}: {message}")

    def _doubt_overlap(self, token: Token, light: AreaLight | None) -> None:
        if light is not None and light.doubled_triangles is not None:
            first, second = light.doubled_triangles
            self.doubt(
                token,
                f"triangles {first} and {second} of this light overlap and face the same side, where their radiances "
                f"add up; remove one of them, or reverse its corners if it is meant to shine on the other side",
            )

    def warn(self, stacklevel: int) -> None:
        """Issue the warnings: doubts, unused and unknown lines, reflectances, coarse quadrics, words of pbrt-v1."""
        for text in self._doubts:
            warnings.warn(PbrtWarning(text), stacklevel=stacklevel + 1)
        bright, negative = (
            {what: list(tokens.values()) for what, tokens in table.items()} for table in (self._bright, self._negative)
        )
        for text, named in (
            ("not used, because it does not change the expected image", self._unused),
            ("not used, because it is unknown there", self._unknown),
            ("reflectance above 1, which adds light, taken as it is, as pbrt does", bright),
            ("reflectance below 0, taken as 0, as pbrt does", negative),
        ):
            if named:
                places = ", ".join(self._places(what, *tokens) for what, tokens in named.items())
                warnings.warn(PbrtWarning(f"{self.source.path}: {text}: {places}"), stacklevel=stacklevel + 1)
        if self.quadrics is not None and self.quadrics["pixels"] > VISIBLE_ERROR:
            text = (
                f"{self.source.path}: spheres, cylinders and disks ({self.quadrics['shapes']:,}) are off by up to "
                f"{self.quadrics['pixels']:.2g} pixels, because they have at most {TRIANGLE_BUDGET} triangles; have "
                f"fewer of them, farther from the camera, a field of view from 1 to 170 degrees, or a lower resolution"
            )
            warnings.warn(PbrtWarning(text), stacklevel=stacklevel + 1)
        if self.v1_token is not None and self.dialect.name == "v2" and not self.filter_line:
            text = (
                f"{self.v1_token.source.path}:{self.v1_token.line}: token {self.v1_token.text}: this parameter is of "
                f"pbrt-v1, and the file is read as v2, where the pixel filter without a PixelFilter line is a box of "
                f"one pixel; in v1 it is Mitchell's filter of 4 x 4 pixels, which is not supported. Write "
                f'PixelFilter "box" to render with a box, or PixelFilter "gaussian" for a filter of that size'
            )
            warnings.warn(PbrtWarning(text), stacklevel=stacklevel + 1)

    def _places(self, what: str, first: Token, *others: Token) -> str:
        file = "" if first.source is self.source else f"{first.source.path}:"
        return f"{what} (line {file}{first.line}{f' and {len(others)} more' if others else ''})"


def inverse(matrix: Floats) -> Floats:
    """Return the inverse of an affine matrix (4, 4)."""
    result = np.asarray(np.linalg.inv(matrix), np.float64)
    result[3] = 0, 0, 0, 1
    return result


Directive = Callable[[Reader, Token, Cursor], None]
"""Function that executes a directive: its arguments are the reader, the token, and the cursor behind the token."""
