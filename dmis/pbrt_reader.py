"""What a pbrt file has said so far, and the scene that it becomes.

`dmis.pbrt_directives` carries out the directives of a file on a `Reader`, which remembers what they ask for.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from difflib import get_close_matches
from pathlib import Path

import numpy as np

from dmis.camera import Camera
from dmis.light import Light
from dmis.material import Material
from dmis.pbrt_cursor import Cursor
from dmis.pbrt_materials import make_material
from dmis.pbrt_objects import Textures
from dmis.pbrt_parameters import Parameter, Parameters
from dmis.pbrt_shapes import Shape, merge
from dmis.pbrt_tokens import Floats, Source, Token, blame
from dmis.scene import Part, Scene
from dmis.settings import DEPTH

MAX_TRIANGLES = 2**25
"""Most triangles of a scene: some 8 GB."""
ALIKE = 0.8
"""From this likeness on, 0 to 1, a parameter that nobody knows may be a misspelt one."""


class PbrtWarning(UserWarning):
    """Lines of a pbrt file that were not used: they do not change the expected image, or nobody knows them."""


@dataclass(frozen=True, eq=False)
class State:
    """What AttributeBegin saves. Nothing in it is changed in place.

    Attributes
    ----------
    to_world
        The current transform, 4x4.
    reverse
        Whether ReverseOrientation is on.
    material
        The kind and the parameters of the Material line.
    named
        The material that NamedMaterial chose, in place of it.
    named_materials, textures
        By name.
    recipes
        Kind and parameters of named materials that Shape lines may still change (v3).
    area_light
        The AreaLightSource line by which shapes emit.
    added
        Parameters that Attribute lines add to shapes, lights and so on, by their kind.
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
    """What a file has said so far."""

    def __init__(self, source: Source, resolution: tuple[int, int] | None) -> None:
        self.source, self.resolution = source, resolution
        self.token = Token("word", "", source, 0)
        self.dialect = source.dialect
        nothing = Parameters(self.token, {})
        default = '"diffuse"' if self.dialect.name == "v4" else '"matte"'
        self.state = State(np.eye(4), (Token("string", default, source, 0), nothing))
        self.blocks: list[tuple[Token, State]] = []
        self.phase = "options"
        self.including: list[Path] = []
        self.files, self.characters = 0, 0
        self.asks = "direct" if self.dialect.name == "v2" else "path", DEPTH
        self.filter = self.dialect.filter
        self.vacuums: set[str] = set()
        self.systems: dict[str, Floats] = {}
        self.film = self.camera = nothing
        self.to_camera = np.eye(4)
        self.shapes: list[tuple[Shape, Material]] = []
        self.objects: dict[str, list[tuple[Shape, Material]]] = {}
        self.object: list[tuple[Shape, Material]] | None = None
        self.triangles = self.defined = 0
        self.bright: list[Part] = []
        self.lights: list[Light] = []
        self._materials: dict[tuple[int, int], tuple[Material, object]] = {}
        self._unused: dict[str, list[Token]] = {}

    def material_for(self, shape: Parameters) -> Material:
        """The current material, with what the Shape line changes.

        Shapes that change nothing get the same object, by which they can be joined.
        """
        state = self.state
        if state.named is not None:
            return state.named_materials[state.named]
        name, parameters = state.material
        key = id(parameters), id(state.textures)
        if key not in self._materials:
            made = make_material(name, (parameters,), state.textures, self.named)
            self._materials[key] = made, state  # keeps alive what the key is the address of
            self.note(parameters)
        if not self.dialect.overrides or parameters.asked.isdisjoint(shape.items):
            return self._materials[key][0]
        return make_material(name, (shape, parameters), state.textures, self.named)

    def named(self, token: Token, name: str) -> Material:
        """The material called `name`."""
        if name not in self.state.named_materials:
            known = ", ".join(map(repr, self.state.named_materials)) or "none"
            raise token.error(f"there is no material of this name here; there are: {known}")
        return self.state.named_materials[name]

    def add(self, token: Token, shapes: list[tuple[Shape, Material]]) -> None:
        """Add shapes to the world, or to the object that is being defined."""
        if self.object is not None:
            self.object += shapes
        else:
            self.shapes += shapes
        self.count(token, *(shape for shape, _ in shapes))

    def count(self, token: Token, *shapes: Shape) -> None:
        """Keep count of the triangles of the world and of those of objects."""
        more = sum(shape.mesh.triangles for shape in shapes)
        self.defined += more if self.object is not None else 0
        self.triangles += more if self.object is None else 0
        if max(self.triangles, self.defined) > MAX_TRIANGLES:
            raise token.error(f"a scene must have at most {MAX_TRIANGLES} triangles, because instances are copied")

    def scene(self) -> Scene:
        """The scene, once all is read."""
        parts = self.bright + merge(self.shapes)
        camera = self._camera()
        with blame(self.token):
            return Scene(camera, tuple(parts), tuple(self.lights), self.source.path.stem, *self.asks)

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
        """Remember the parameters that nobody asked for."""
        for name in parameters.unused():
            known = {asked.lower(): asked for asked in sorted(parameters.asked)}
            similar = get_close_matches(name.lower(), known, 1, ALIKE)
            hint = f", did you mean {known[similar[0]]!r}?" if similar else ""
            what = f"parameter {name!r} of {parameters.directive.text}{hint}"
            self._unused.setdefault(what, []).append(parameters.items[name].token)

    def skip(self, token: Token) -> None:
        """Remember a directive that is not used."""
        self._unused.setdefault(token.text, []).append(token)

    def warn(self, stacklevel: int) -> None:
        """Warn once of all that was not used."""
        told = []
        for what, (first, *others) in self._unused.items():
            file = "" if first.source is self.source else f"{first.source.path}:"
            told.append(f"{what} (line {file}{first.line}{f' and {len(others)} more' if others else ''})")
        if told:
            why = "because it does not change the expected image, or is unknown there"
            text = f"{self.source.path}: not used, {why}: {', '.join(told)}"
            warnings.warn(PbrtWarning(text), stacklevel=stacklevel + 1)


def inverse(matrix: Floats) -> Floats:
    """Inverse of an affine map (4, 4)."""
    out = np.asarray(np.linalg.inv(matrix), np.float64)
    out[3] = 0, 0, 0, 1
    return out


Directive = Callable[[Reader, Token, Cursor], None]
"""What a directive does: it is given the reader, its own token, and the cursor behind it."""
