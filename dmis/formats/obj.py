"""Materials of OBJ files: the statements ``Kd Ks Ns Ke d Tr map_Kd map_d`` of MTL files.

`Kd` is the reflectance of a matte surface, which ``map_Kd``, an image, multiplies. With `Ks` it has a coat of index
1.5, times `Ks`, whose Blinn exponent is `Ns`; a black one with `Ks` is a metal of reflectance `Ks`. `Ke` is the
radiance that triangles emit, corners counterclockwise. A share ``1 - d`` (`Tr`) of light goes straight through;
``map_d`` is an image of d, its opacity if it has any. Ambient colours, ``illum`` and ``Ni`` are no part of this and are
ignored; other statements are named as left out. Source: Wavefront Technologies, *Advanced Visualizer Manual*, MTL
material format.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from dmis.base.named_files import named_file
from dmis.brdf.cosines import MAX_LOBE_EXPONENT
from dmis.brdf.materials import Material, matte, plastic, shiny_metal, uber
from dmis.brdf.texture import Image, scale
from dmis.formats.model import Model
from dmis.geometry.mesh import Mesh
from dmis.geometry.wavefront import NUMBER, read_obj
from dmis.image_reader import load_image
from dmis.scene.masks import Mask

READ = "Kd", "Ks", "Ns", "Ke", "d", "Tr", "map_Kd", "map_d"
"""Statements of MTL files that are read."""
IGNORED = "Ka", "map_Ka", "illum", "Ni", "sharpness", "Tf"
"""Statements that say nothing about the light of a scene here."""
Statements = dict[str, tuple[int, str]]
"""The line and the argument of each statement of a material."""


def read_obj_with_materials(data: bytes, model: Model) -> None:
    """Add the triangles of the bytes of an OBJ file to a model, with the materials of the MTL files that it names."""
    meshes, libraries, coloured = read_obj(data)
    materials: dict[str, tuple[Path, Statements]] = {}
    for names in libraries:
        # one name with spaces, or several
        several = [] if named_file(model.path.parent, names, None) else names.split()
        for name in several or [names]:
            if (path := model.file(name)) is not None:
                materials |= {material: (path, mtl) for material, mtl in _read_mtl(path).items()}
    model.unread["vertex colours"] += coloured
    images: dict[Any, Image | None] = {}
    for name, flat in meshes.items():
        if (mesh := model.drop_flat(flat)) is None:
            continue
        if name not in materials:
            model.unread[f"material {name[-60:]!r} without a definition"] += bool(name)
            model.add(mesh)
            continue
        path, mtl = materials[name]
        try:
            _add(name, mtl, mesh, model, images)
        except ValueError as error:
            raise ValueError(f"material file {path}, {error}") from error


def _read_mtl(path: Path) -> dict[str, Statements]:
    """Return the statements of each material of an MTL file; of those with one name the last one counts."""
    materials: dict[str, Statements] = {}
    mtl: Statements = {}
    for number, line in enumerate(path.read_text("utf-8", "replace").splitlines(), 1):
        word, _, argument = " ".join(line.split()).partition(" ")
        if word == "newmtl":
            mtl = materials[argument] = {}
        elif word and not word.startswith("#"):
            mtl[word] = number, argument
    return materials


def _add(name: str, mtl: Statements, mesh: Mesh, model: Model, images: dict[Any, Image | None]) -> None:
    """Add triangles with the material `name` to a model."""
    for word in mtl:
        model.unread[f"{word} of a material"] += word not in (*READ, *IGNORED)
    grey = 0.5 if "map_Kd" not in mtl else 1.0
    given = {"Kd": _values(mtl, "Kd", (grey,) * 3), "Ks": _values(mtl, "Ks", (0.0,) * 3)}
    for word, colour in given.items():
        model.unread[f"{word} above 1 of {name!r}"] += max(colour) > 1
    kd: Any
    kd, ks = (tuple(min(x, 1.0) for x in colour) for colour in given.values())
    emission = _values(mtl, "Ke", (0.0,) * 3)
    if "map_Kd" in mtl:
        image = _image(mtl["map_Kd"][1], model, images)
        kd = kd if image is None else scale(kd if any(kd) else 1.0, image)
    opacity = _values(mtl, "d", (1 - _values(mtl, "Tr", (0.0,), 1)[0],), 1)[0]  # exporters differ about Tr
    roughness = 1 / min(max(_values(mtl, "Ns", (10.0,))[0], 1), MAX_LOBE_EXPONENT)
    if opacity < 1:
        material = uber(kd, ks, roughness=roughness, opacity=opacity)
    elif not any(ks):
        material = matte(kd)
    elif isinstance(kd, Image) or any(kd):
        material = plastic(kd, ks, roughness)
    else:
        material = shiny_metal(ks, 0.0, roughness)
    light = model.lamp(mesh, emission) if any(emission) else None
    mask = _image(mtl["map_d"][1], model, images, opacity=True) if "map_d" in mtl and mesh.uv is not None else None
    model.add(mesh, Material(material.lobes, name), light, None if mask is None else Mask(mask, None))


def _values(mtl: Statements, word: str, default: tuple[float, ...], most: float = np.inf) -> Any:
    """Return the numbers of a statement, from 0 to `most`, as many as its `default`, or one that stands for all."""
    if word not in mtl:
        return default
    number, argument = mtl[word]
    words = argument.removeprefix("-halo ").split()
    values = [float(x) for x in words if NUMBER.fullmatch(x)]
    fits = len(values) == len(words) and len(values) in (1, len(default))
    if not fits or not all(0 <= x <= most and x < np.inf for x in values):
        what = f"{'1 number' if len(default) == 1 else '1 or 3 numbers'} from 0{f' to {most:g}' * (most < np.inf)}"
        raise ValueError(f"line {number}: {word} must be {what}; got {argument[:60]!r}")
    return tuple(values * (len(default) // len(values)))


def _image(argument: str, model: Model, images: dict[Any, Image | None], opacity: bool = False) -> Image | None:
    """Return the image of ``map_Kd`` or, of one channel, of ``map_d``, placed by its options ``-s`` and ``-o``."""
    words, options = argument.split(" "), {"-s": [1.0, 1.0], "-o": [0.0, 0.0]}
    while len(words) > 1 and words[0].startswith("-"):
        name = words.pop(0)
        values = []
        while len(words) > 1 and (NUMBER.fullmatch(words[0]) or words[0] in ("on", "off", "")):
            values.append(words.pop(0))
        given = [float(x) for x in values if NUMBER.fullmatch(x)]
        options[name] = [*given, *options.get(name, [])[len(given) :]]
        model.unread[f"{name} of an image"] += name not in ("-s", "-o")
    file = " ".join(words)
    if (file, opacity) not in images:
        path = model.file(file)
        images[file, opacity] = None if path is None else _opacity(path) if opacity else Image(path)
    image, (s, t, *_), (u, v, *_) = images[file, opacity], options["-s"], options["-o"]
    return None if image is None else replace(image, scale=(s, t), offset=(u, v))


def _opacity(path: Path) -> Image:
    """Return the opacity of an image file, or its values where it has none, as an image of one channel."""
    texels = load_image(path, linear=True, alpha=True)[::-1]
    values = texels[..., -1:] if (texels[..., -1] < 1).any() else texels[..., :-1].mean(axis=2, keepdims=True)
    return Image(np.clip(values, 0, 1))
