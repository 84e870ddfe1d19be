"""Scenes from files of pbrt-v2, v3 and v4.

`read_pbrt` reads the text format of pbrt: M. Pharr and G. Humphreys, *Physically Based Rendering*, 2nd edition,
appendix B, and the common subset of the formats of the 3rd and 4th edition. A line that is unknown or not supported is
an error that names file, line and token, so that no wrong image is rendered in silence; one warning names the options
and parameters that are not used because they do not change the expected image. The later dialects mean other things by
the same words, so a file is read by the rules of one dialect (`dmis.formats.pbrt.dialect`): the one that its words
belong to, or an argument. ``plymesh`` is read in all dialects. docs/scenes.md lists what is read.

Deviations of pbrt-v2 from the textbook that only this reader knows, beside those of docs/scenes.md:

* Camera space is left-handed, x right, y up, z forward, and so is what ``LookAt`` makes.
* A Blinn exponent is at most 10000, so a roughness is at least 1e-4. Negative reflectances become 0, sigma is brought
  to [0, 90], and what ``shinymetal`` reflects is at most 1. (Opacity is at most 1 here, too; above, pbrt-v2 lets
  negative light through.)
* A named material takes what it lacks from the Material line that stands then, whose textures count before constants
  of its own. Parameters of materials in Shape lines, which pbrt puts before those of the Material line, are refused.
* For triangles that a ray hits pbrt-v2 takes the side of dp/du x dp/dv, turned by transforms that change handedness
  too, so that a mirrored mesh, or mirrored texture coordinates, have two bright sides. Here the side that is sampled,
  along their winding in world space, holds for both.
* pbrt-v2 samples a disk or sphere with its radius from object space, which is wrong under any scaling. Here uniform
  scaling is right, and other scaling is an error. Disks and spheres with parts cut out must not emit.
* A texel is (scale * texel) ^ gamma. Images are bilinear here; pbrt-v2 blurs textures by a texel, and resamples images
  whose sides are no powers of 2. In a map of infinite light the first row is +z.
* ``maxdepth`` m of path tracing lets m + 1 surfaces scatter light. (One thing is not followed: a light that is seen by
  way of exactly m + 1 mirrors is black in pbrt-v2.)
* Without a PixelFilter line the filter is a box of one pixel. Other filters are smooth here, and taken from a table of
  16 x 16 values in pbrt-v2 and v3.

Deviations of v3 and v4 are described in the modules: sides of lights and glass in `dmis.formats.pbrt.parts`, colours in
`dmis.formats.pbrt.spectra`, materials in `materials_v3` and `materials_v4`, lights in `dmis.formats.pbrt.lights`.

File names are relative to the folder of the file read first, as in all versions of pbrt; where there is no such file,
to that of the file that they stand in. They must not lead out of the former unless the caller allows it.
"""

from __future__ import annotations

import os
import warnings
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

import numpy as np

from dmis.base.validate import did_you_mean, one_of
from dmis.formats.pbrt.dialect import DIALECTS, detect
from dmis.formats.pbrt.directives import MAX_FILES, MAX_INCLUDES, carry_out
from dmis.formats.pbrt.notes import PbrtWarning
from dmis.formats.pbrt.options import make_camera
from dmis.formats.pbrt.reader import Reader
from dmis.formats.pbrt.tokens import Source, Token, tokens_of
from dmis.scene.camera import Camera
from dmis.scene.scene import Scene


def read_pbrt(
    path: str | os.PathLike[str],
    resolution: tuple[int, int] | None = None,
    *,
    dialect: str | None = None,
    outside: bool = False,
) -> Scene:
    """Return the scene of a pbrt file; arguments are those of `dmis.formats.load_scene.load_scene`.

    The field of view belongs to the shorter side, so a `resolution` of another shape shows more or less on the longer
    one. If the words of the file fit several dialects, it is read by the first of them, with a warning. Links to files
    count as where they lead. The scene's `source` says which dialect the file was read by, and why.

    A PbrtError if the file is malformed or asks for what is not supported; it lists all that is not, each a line
    ``FILE:LINE: token TOKEN: REASON`` with the number of places. One PbrtWarning each if something in it was not used,
    if reflectances exceed 1, and if the dialect is a guess or not that of the file's words.
    """
    path = Path(path)
    if path.exists() and not path.is_file():
        raise FileNotFoundError(f"{path} is no scene file but a folder, a pipe or a device")
    if not path.is_file():
        files = (file.name for file in path.parent.glob("*.pbrt"))
        raise FileNotFoundError(f"there is no scene file {path}{did_you_mean(path.name, files)}")
    if dialect is not None:
        one_of("dialect", dialect, DIALECTS)
    if resolution is not None:
        resolution = Camera(np.eye(4), 90.0, resolution).resolution
    source = Source.read(path, outside)
    guess, fits = detect(_words(source, {path.resolve()}))
    chosen = guess if dialect is None else DIALECTS[dialect]
    reason = "caller" if dialect is not None else "guess" if len(fits) > 1 else "file"
    reader = Reader(replace(source, dialect=chosen), resolution)
    if reason == "guess" or chosen.name not in fits:
        how = "which is a guess" if reason == "guess" else "as asked"
        others = " or ".join(f"dialect={name!r} (--dialect {name})" for name in fits)
        text = f"{path}: read as pbrt-{chosen.name}, {how}, but the words of the file fit {' and '.join(fits)}; images"
        text += f" differ by it (integrator and film where no line names them, materials, textures); give {others}"
        if reason == "guess":
            reader.notes.warnings.append(text)
        else:  # at once, because the dialect may be why the file is refused
            warnings.warn(PbrtWarning(text), stacklevel=2)
    with np.errstate(all="ignore"):  # what is not finite is refused where it matters
        with reader.refusals.collect():
            carry_out(reader, reader.source)
            reader.refusals.complete = True
            camera = make_camera(reader)
        if reader.refusals:
            raise reader.refusals.error()
        scene = reader.scene(camera)
    reader.notes.warn(2)
    return scene.changed(source={"dialect": chosen.name, "dialect_from": reason, **scene.source})


def _words(source: Source, read: set[Path], depth: int = 0) -> Iterator[Token]:
    """Yield the tokens of a file and of those it includes, each file once; the reader reports files that fail."""
    before = ""
    for token in tokens_of(source):
        yield token
        if before == "Include" and token.kind == "string" and depth < MAX_INCLUDES:
            with suppress(ValueError, OSError):
                path = token.file(token.name)
                if path.resolve() not in read and len(read) < MAX_FILES:
                    read.add(path.resolve())
                    yield from _words(token.source.include(path), read, depth + 1)
        before = token.text
