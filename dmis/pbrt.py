"""Scenes from files of pbrt-v2, v3 and v4.

`read_pbrt` reads the text format of pbrt: M. Pharr and G. Humphreys, *Physically Based Rendering*, 2nd edition,
appendix B, and the common subset of the formats of the 3rd and 4th edition. It makes no wrong image in silence: what it
does not know or cannot render is an error that names file, line and token; options and parameters that do not change
the expected image are named in one warning. The later dialects mean other things by the same words, so a file is read
by the rules of one dialect (`dmis.pbrt_dialect`): the one that its words belong to, or the one that the caller names.
Beside the shapes of pbrt-v2 the reader knows ``plymesh`` in all dialects. docs/scenes.md lists what is read.

What pbrt-v2 does and a textbook would not. The rest of the library knows nothing of it:

* Camera space is left-handed, x right, y up, z forward, and so is what ``LookAt`` makes.
* ``plastic`` and ``uber`` take their Fresnel reflectance from inside: it is total beyond 42 degrees at index 1.5.
* A Blinn exponent is at most 10000, so a roughness is at least 1e-4. Negative reflectances become 0, sigma is brought
  to [0, 90], and what ``shinymetal`` reflects is at most 1. (Opacity is at most 1 here, too; above, pbrt-v2 lets
  negative light through.)
* A texture in the Material line beats a constant in the Shape line, which beats a constant in the Material line. A
  named material takes what it lacks from the Material line that stands then, and nothing from Shape lines.
* ``from`` of a point light is added in world space, after the current transform.
* An area light emits on one side: disks, spheres and cylinders along their normals, triangles along their winding in
  world space; ReverseOrientation turns both. That is pbrt-v2's rule for points it samples on a light. For triangles
  that a ray hits it takes dp/du x dp/dv, turned by transforms that change handedness too, so that a mirrored mesh, or
  mirrored texture coordinates, have two bright sides. Here the sampled side holds for both.
* pbrt-v2 samples a disk or sphere with its radius from object space, which is wrong under any scaling. Here uniform
  scaling is right, and other scaling is an error. Disks and spheres with parts cut out must not emit.
* Refracted radiance is not divided by eta^2: a lamp in a ball of glass is as bright as outside of it.
* The outside of glass is the side of the vertex normals of triangles, else of dp/du x dp/dv. ReverseOrientation turns
  it, and so does a transform that changes handedness.
* The first row of an image is t = 0 and, in a map of infinite light, +z. A texel is (scale * texel) ^ gamma; a float
  texture takes the luminance. Images are bilinear here; pbrt-v2 blurs textures by a texel, and resamples images whose
  sides are no powers of 2.
* ``maxdepth`` m of path tracing lets m + 1 surfaces scatter light. (One thing is not followed: a light that is seen by
  way of exactly m + 1 mirrors is black in pbrt-v2.)
* Without a PixelFilter line the filter is a box of one pixel. Other filters are smooth here, and taken from a table of
  16 x 16 values in pbrt-v2 and v3.

What v3 and v4 do otherwise is told where it is done: sides of lights and glass in `dmis.pbrt_shapes`, colours in
`dmis.pbrt_spectra`, materials and lights in `dmis.pbrt_materials` and `dmis.pbrt_lights`.

File names are relative to the folder of the file that they stand in, else to that of the file read first, and must not
lead out of the latter unless the caller allows it.

The modules: `dmis.pbrt_dialect` (dialects as data), `dmis.pbrt_tokens` and `dmis.pbrt_cursor` (text),
`dmis.pbrt_parameters` (values), `dmis.pbrt_directives`, `dmis.pbrt_transforms` and `dmis.pbrt_world` (lines),
`dmis.pbrt_reader` (what they add up to), `dmis.pbrt_objects` (textures, materials and lights of v2),
`dmis.pbrt_materials`, `dmis.pbrt_lights` and `dmis.pbrt_spectra` (by dialect), `dmis.pbrt_shapes` (meshes, sides,
parts).
"""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path

import numpy as np

from dmis.camera import Camera
from dmis.pbrt_dialect import DIALECTS, detect
from dmis.pbrt_directives import carry_out
from dmis.pbrt_reader import PbrtWarning, Reader
from dmis.pbrt_tokens import PbrtError, Source, tokens_of
from dmis.scene import Scene

__all__ = ["PbrtError", "PbrtWarning", "read_pbrt"]


def read_pbrt(
    path: str | os.PathLike[str],
    resolution: tuple[int, int] | None = None,
    *,
    dialect: str | None = None,
    outside: bool = False,
) -> Scene:
    """Read a pbrt scene file.

    Parameters
    ----------
    path
        The file.
    resolution
        ``(width, height)`` in place of the file's. The field of view belongs to the shorter side, so a change of shape
        shows more or less on the longer one.
    dialect
        ``v2``, ``v3`` or ``v4``. Default: what the file's own words say; v2 if they fit all.
    outside
        Whether the scene may read files outside of its folder. Links count as where they lead.

    Returns
    -------
    Scene
        Its name is the file's. Shapes of one material make one part, or a few: flat and smooth ones are kept apart, and
        so are those with and without texture coordinates.

    Raises
    ------
    FileNotFoundError
        If there is no such file.
    PbrtError
        If it is malformed, or asks for what is not supported. The message begins ``FILE:LINE: token TOKEN:``.
    ValueError
        If the resolution or the dialect is not one, or the file is too large.

    Warns
    -----
    PbrtWarning
        Once, if something in the file was not used.
    """
    path = Path(path)
    if not path.is_file():
        raise FileNotFoundError(f"there is no scene file {path}")
    if resolution is not None:
        resolution = Camera(np.eye(4), 90.0, resolution).resolution
    if dialect is not None and dialect not in DIALECTS:
        raise ValueError(f"dialect must be one of {', '.join(DIALECTS)}; got {dialect!r}")
    source = Source.read(path, outside)
    spoken = detect(tokens_of(source)) if dialect is None else DIALECTS[dialect]
    source = replace(source, dialect=spoken)
    reader = Reader(source, resolution)
    with np.errstate(all="ignore"):  # what is not finite is refused where it matters
        carry_out(reader, source)
        scene = reader.scene()
    reader.warn(stacklevel=2)
    return scene
