"""The directives of pbrt files that do not change the scene, as a table: camera, film, integrator, options, media.

`make_camera` makes the camera of the Camera, Film and PixelFilter lines, at the end of the file.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from dmis.base.validate import FARTHEST
from dmis.base.vectors import Floats
from dmis.formats.pbrt.dialect import V2, V4
from dmis.formats.pbrt.notes import UNUSED
from dmis.formats.pbrt.parameters import ParameterSet
from dmis.formats.pbrt.reader import KEPT, OPTIONAL, PARAMETERS, Directive, Reader, power_of_two
from dmis.formats.pbrt.tokens import Token, blame
from dmis.samplers.pixel_filter import PixelFilter
from dmis.scene.camera import Camera
from dmis.scene.suggestions import MAX_DEPTH

SAMPLERS = {
    "lowdiscrepancy": "lowdiscrepancy",
    "02sequence": "lowdiscrepancy",
    "stratified": "stratified",
    "random": "independent",
    "independent": "independent",
}
"""Samplers of dmis by the names of pbrt's."""
ROUNDED = ("lowdiscrepancy", "02sequence", "maxmindist", "adaptive")
"""pbrt's samplers that round numbers of samples up to powers of two."""


def _camera(reader: Reader, name: Token, p: ParameterSet) -> None:
    """Keep the camera, which the film completes, and its coordinate system."""
    reader.camera_kind = name.among("the camera", CAMERAS[name.dialect])
    reader.camera, reader.to_camera = p, reader.to_world()
    reader.systems["camera"] = inverse(reader.to_camera)


def _film(reader: Reader, name: Token, p: ParameterSet) -> None:
    """Keep the film, of which the image has its size."""
    name.among("the film", reader.dialect.film)
    reader.film = p


def _pixel_filter(reader: Reader, name: Token, p: ParameterSet) -> None:
    """Set the pixel filter, by its radius and its own parameters."""
    v4 = reader.dialect is V4
    usual = {"box": 0.5, "gaussian": 1.5 if v4 else 2.0}.get(name.name, 2.0)
    x, y = (p.number(half, usual) for half in reader.dialect.radius)
    sigma = p.number("sigma", 0.5) if name.name == "gaussian" and v4 else 0.5
    if name.name == "gaussian" and not v4:  # exp(-alpha x^2)
        alpha = p.number("alpha", 2)
        if not alpha > 0:
            raise p.items["alpha"].token.error(f"alpha must be positive, or the filter has no width; got {alpha:g}")
        sigma = (2 * alpha) ** -0.5
    kind = name.name
    if kind == "mitchell":  # of B = C = 1/3, whose variance is B / 3 in units of half its radius
        reader.notes.add("negative filter, a Gaussian of the same variance taken", name.text, name)
        kind, sigma = "gaussian", max(x, y) / 6
    with blame(name):
        pixel_filter = PixelFilter(kind, (x, y), sigma)
    reader.filter = None if pixel_filter == PixelFilter("box", (0.5, 0.5)) else pixel_filter


def _sampler(reader: Reader, name: Token, p: ParameterSet) -> None:
    """Suggest the sampler and its camera samples, which do not change the expected image, so no number is refused."""
    count, side = (4, 2) if reader.dialect is V2 else (16, 4)
    if name.name == "stratified":
        spp = p.request("xsamples", side) * p.request("ysamples", side)
    elif name.name == "adaptive":
        spp = p.request("maxsamples", 32)
    else:
        spp = p.request("pixelsamples", 4 if name.name == "random" else count)
    reader.rounds = name.name in ROUNDED
    reader.suggested = replace(
        reader.suggested,
        sampler=SAMPLERS.get(name.name),
        spp=power_of_two(spp) if reader.rounds else spp,
        unmet=() if name.name in SAMPLERS else (f"sampler {name.name}",),
    )


def _integrator(reader: Reader, name: Token, p: ParameterSet) -> None:
    """Set the integrator and the depth that the file suggests, and note what its own image lacks."""
    dialect = reader.dialect
    unbiased, biased = dialect.integrators
    direct = () if dialect is V4 else ("directlighting", "whitted")
    p.note_unapplied(dialect.unapplied.get("Integrator", {}))
    name.among("the integrator", (*direct, *unbiased, *biased))
    depth = p.integer("maxdepth", 5)
    if name.name in biased:
        reader.notes.add("rendered as path, because pbrt's own image is biased", f"integrator {name.text}", name)
    if name.name in direct:
        strategy = p.string("strategy", "all", ("all", "one"))
        depth = max(depth, 1)  # none is left out at depth 0 either
    else:
        # In pbrt-v2 the light at vertices 0 to maxdepth is gathered before the loop is left (integrators/path.cpp), in
        # v3 and v4 the loop is left first, with light from maxdepth vertices (integrators/path.cpp, `bounces >=
        # maxDepth`; cpu/integrators.cpp, `depth++ == maxDepth`; volpath alike). Bidirectional paths have s + t - 2
        # surfaces between camera and light, which `bdpt` and `mlt` bound by maxdepth.
        strategy = "one"
        depth += dialect is V2
    if not 1 <= depth <= MAX_DEPTH:
        rule = f"must let 1 to {MAX_DEPTH} surfaces scatter light, else only lights are seen"
        raise p.items["maxdepth"].token.error(f"maxdepth {rule}; here it is {depth}")
    reader.suggested = replace(reader.suggested, lights=strategy)
    if not reader.metropolis:
        kind = "direct" if name.name in direct else "path"
        reader.suggested = replace(reader.suggested, integrator=kind, max_depth=depth)


def _renderer(reader: Reader, name: Token, p: ParameterSet) -> None:
    """Set path tracing, if the renderer is Metropolis's."""
    name.among("the renderer", ("sampler", "metropolis"))
    if name.name == "metropolis":  # of paths of v2 with at most maxdepth surfaces, whatever the SurfaceIntegrator
        reader.metropolis = True
        depth = min(max(p.integer("maxdepth", 7), 1), MAX_DEPTH)
        reader.suggested = replace(reader.suggested, integrator="path", max_depth=depth)


def _medium_interface(reader: Reader, *names: Token | None) -> None:
    """Refuse all media: a vacuum has no name."""
    for name in names:
        if name is not None and name.text != '""':
            raise name.error('a medium changes the image, and media are not supported; write "" to render a vacuum')
    _unused(reader)


def _unused(reader: Reader, *arguments: object) -> None:
    """Note a directive that does not change the image."""
    reader.notes.add(UNUSED, reader.token.text, reader.token)


OPTIONS: dict[str, Directive] = {
    "TransformTimes": ("options", _unused, (2,)),
    "ColorSpace": ("any", lambda reader, name: name.among("the colour space", ("srgb",)), ("a name",)),
    "MakeNamedMedium": ("any", _unused, ("a name", KEPT)),
    "MediumInterface": ("any", _medium_interface, ("the name of a medium", OPTIONAL)),
    "Camera": ("options", _camera, ("a kind of camera", KEPT)),
    "Film": ("options", _film, ("a kind of film", KEPT)),
    "PixelFilter": ("options", _pixel_filter, ("a kind of filter", PARAMETERS)),
    "Sampler": ("options", _sampler, ("a kind of sampler", PARAMETERS)),
    "SurfaceIntegrator": ("options", _integrator, ("a kind of integrator", PARAMETERS)),
    "Integrator": ("options", _integrator, ("a kind of integrator", PARAMETERS)),
    "VolumeIntegrator": ("options", _unused, ("a kind", KEPT)),
    "Renderer": ("options", _renderer, ("a kind of renderer", PARAMETERS)),
    "Accelerator": ("options", _unused, ("a kind", KEPT)),
}
"""Directives by name."""


CAMERAS: dict[str, dict[str, Any]] = {
    dialect: {"perspective": "perspective", "orthographic": "orthographic", around: "spherical"}
    for dialect, around in (("v2", "environment"), ("v3", "environment"), ("v4", "spherical"))
}
"""Projections by the names of the dialect and of the camera."""


def make_camera(reader: Reader) -> Camera:
    """Return the camera of a file that was read."""
    film, p = reader.film, reader.camera
    wide, high = reader.dialect.film_size
    size = film.integer("xresolution", wide), film.integer("yresolution", high)
    film.refuse("pixelbounds is not supported; use cropwindow", "pixelbounds")
    film.require(reader.dialect.required)
    crop = film.table("cropwindow", 4, "float")
    if reader.resolution is None:
        with blame(film.directive):
            Camera(np.eye(4), 90.0, size)
    width, height = reader.resolution or size
    window = _window(p, width / height)
    projection = CAMERAS[reader.dialect.name][reader.camera_kind]
    half, fov = p.number("halffov", 0), p.number("fov", 90)
    fov = (2 * half if half > 0 else fov) if projection == "perspective" else 90.0
    if window != 1:
        fov = float(np.degrees(2 * np.arctan(window * np.tan(np.radians(fov / 2)))))
    radius, focus = p.number("lensradius", 0), p.number("focaldistance", 1e6)
    if projection == "spherical":
        radius = 0
        if reader.dialect.name == "v4" and p.string("mapping", "equalarea") != "equirectangular":
            raise p.directive.error('needs "string mapping" "equirectangular"; maps of equal area are not supported')
    for name, line in (("Film", film), ("Camera", p)):
        line.note_unapplied(reader.dialect.unapplied.get(name, {}))
        reader.notes.add_parameters(line)
    with blame(p.directive):
        camera = Camera(inverse(reader.to_camera), fov, (width, height), filter=reader.filter, projection=projection)
        if radius:
            camera = replace(camera, lens_radius=radius, focal_distance=min(focus, FARTHEST))
    if crop is None:
        return camera
    if crop.shape != (1, 4) or not ((crop >= 0) & (crop <= 1)).all():
        got = crop.tolist()
        raise film.items["cropwindow"].error(f"must be four shares of the image, 0 to 1: x, x, y, y; got {got}")
    left, right, top, bottom = np.ceil(crop[0] * [width, width, height, height]).astype(int).tolist()
    with blame(film.items["cropwindow"].token):
        return camera.crop((left, top, right, bottom))


def _window(p: ParameterSet, ratio: float) -> float:
    """Return the factor by which the screen window is larger than that of an image of the aspect `ratio`."""
    square = np.array([-max(ratio, 1), max(ratio, 1), -max(1 / ratio, 1), max(1 / ratio, 1)])
    p.refuse("pixels that are not square are not supported; remove the parameter", "frameaspectratio")
    window = p.table("screenwindow", 4, "float")
    factor = 1.0 if window is None else float(window[0, 3] / square[3])
    if window is not None and not (factor > 0 and np.allclose(window, square * factor, rtol=1e-6)):
        text = " ".join(f"{number:g}" for number in square)
        raise p.items["screenwindow"].error(f"must be that of square pixels, [{text}], or a multiple of it")
    return 1.0 if np.isclose(factor, 1, rtol=1e-6) else factor


def inverse(matrix: Floats) -> Floats:
    """Return the inverse of an affine matrix (4, 4)."""
    result = np.asarray(np.linalg.inv(matrix), np.float64)
    result[3] = 0, 0, 0, 1
    return result
