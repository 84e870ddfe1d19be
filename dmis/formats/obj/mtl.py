"""Materials of OBJ files: statements of MTL files, in upper or lower case.

`Kd` is the reflectance of a matte surface, which ``map_Kd``, an image, multiplies. With `Ks` it has a coat of index
1.5, times `Ks`, whose Blinn exponent is `Ns`; a black one with `Ks` is a metal of reflectance `Ks`. With `Pr` or `Pm`
it is `dmis.metallic_roughness`; ``illum 7`` is glass of index `Ni` that transmits `Tf`. `Ke`, times ``map_Ke``, is the
radiance that triangles emit, corners counterclockwise. A share ``1 - d`` (`Tr`) of light goes straight through;
``map_d`` is an image of d, its opacity if it has any. An image that cannot be read is left out, ``map_Kd`` is then
grey. Ambient colours are no part of this and are ignored; other statements are named as left out. Sources: Wavefront
Technologies, *Advanced Visualizer Manual*, MTL material format; Exocortex, *PBR extension to MTL*.
"""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from dmis.base.named_files import found_file
from dmis.base.text import decode
from dmis.brdf.lobe import MAX_LOBE_EXPONENT
from dmis.brdf.materials import Material, glass, matte, plastic, shiny_metal, uber
from dmis.brdf.metallic_roughness import metallic_roughness
from dmis.brdf.texture import Image, scale
from dmis.formats.model import Model
from dmis.formats.obj.obj_file import NUMBER, read_obj, uncommented
from dmis.geometry.mesh import Mesh
from dmis.image_reader import load_image
from dmis.scene.masks import Mask

READ = "Kd", "Ks", "Ns", "Ke", "d", "Tr", "Pr", "Pm", "map_Kd", "map_Ke", "map_d"
"""Statements of MTL files that are read."""
IGNORED = "Ka", "map_Ka", "illum", "Ni", "sharpness", "Tf"
"""Statements that say nothing about the light of a scene here, but for those of glass."""
_SPELLINGS = {word.lower(): word for word in (*READ, *IGNORED)}
Statements = dict[str, tuple[int, str]]
"""The line and the argument of each statement of a material."""
Images = dict[tuple[str, bool], Image | None]
"""Images by file name and whether they are opacities; None if there is none, or it cannot be read."""


def read_obj_with_materials(data: bytes, model: Model) -> None:
    """Add the triangles of the bytes of an OBJ file to a model, with the materials of the MTL files that it names."""
    meshes, libraries, unread = read_obj(data)
    materials: dict[str, tuple[Path, Statements]] = {}
    for names in libraries:
        # one name with spaces, or several
        several = [] if found_file(model.path.parent, names, None) else re.split(r"(?<!\\) ", names)
        for name in several or [names]:
            if (path := model.file(name)) is not None:
                materials |= {material: (path, mtl) for material, mtl in _read_mtl(path).items()}
    model.unread.update(unread)
    images: Images = {}
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
    text = uncommented(decode(path.read_bytes(), f"material file {path}"))
    for number, line in enumerate(text.split("\n"), 1):
        word, _, argument = " ".join(line.split()).partition(" ")
        if word.lower() == "newmtl":
            mtl = materials[argument] = {}
        elif word and (argument or not word.lower().startswith("map_")):  # exporters name no file where none is
            mtl[_SPELLINGS.get(word.lower(), word)] = number, argument
    return materials


def _add(name: str, mtl: Statements, mesh: Mesh, model: Model, images: Images) -> None:
    """Add triangles with the material `name` to a model."""
    for word in mtl:
        model.unread[f"{word} of a material"] += word not in (*READ, *IGNORED)
    material, radiance = _surface(name, mtl, model, images), _radiance(mtl, mesh, model, images)
    light = None if radiance is None else model.lamp(mesh, radiance)
    mask = _image("map_d", mtl, model, images) if "map_d" in mtl and mesh.uv is not None else None
    model.add(mesh, Material(material.lobes, name), light, None if mask is None else Mask(mask, None))


def _surface(name: str, mtl: Statements, model: Model, images: Images) -> Material:
    """Return the material of the statements of `name`, without its emission and its holes."""
    if "illum" in mtl and mtl["illum"][1].split()[:1] == ["7"]:  # refraction and Fresnel's reflection
        model.unread["map_Kd of glass"] += "map_Kd" in mtl
        clear = tuple(min(x, 1.0) for x in _values(mtl, "Tf", (1.0,) * 3))
        return glass(1.0, clear, _values(mtl, "Ni", (1.5,))[0])
    grey = 0.5 if "map_Kd" not in mtl else 1.0
    given = {"Kd": _values(mtl, "Kd", (grey,) * 3), "Ks": _values(mtl, "Ks", (0.0,) * 3)}
    for word, colour in given.items():
        model.unread[f"{word} above 1 of {name!r}"] += max(colour) > 1
    kd: Any
    kd, ks = (tuple(min(x, 1.0) for x in colour) for colour in given.values())
    if "map_Kd" in mtl:
        image, kd = _image("map_Kd", mtl, model, images), kd if any(kd) else (1.0, 1.0, 1.0)
        kd = scale(kd, 0.5 if image is None else image)
    opacity = _values(mtl, "d", (1 - _values(mtl, "Tr", (0.0,), 1)[0],), 1)[0]  # exporters differ about Tr
    exponent = min(max(_values(mtl, "Ns", (10.0,))[0], 1), MAX_LOBE_EXPONENT)
    if "Pr" in mtl or "Pm" in mtl:
        alike = (2 / (exponent + 2)) ** 0.25  # the root of GGX's alpha whose peak is as wide as Blinn's
        metallic, roughness = (_values(mtl, word, (x,), 1)[0] for word, x in (("Pm", 0.0), ("Pr", alike)))
        return metallic_roughness(kd, metallic, roughness, opacity=opacity)
    if opacity < 1:
        return uber(kd, ks, roughness=1 / exponent, opacity=opacity)
    if not any(ks):
        return matte(kd)
    return plastic(kd, ks, 1 / exponent) if isinstance(kd, Image) or any(kd) else shiny_metal(ks, 0.0, 1 / exponent)


def _radiance(mtl: Statements, mesh: Mesh, model: Model, images: Images) -> Any:
    """Return the radiance of triangles, a colour or an image; None if they emit nothing."""
    radiance = _values(mtl, "Ke", (0.0,) * 3)
    if "map_Ke" not in mtl:
        return radiance if any(radiance) else None
    model.unread["map_Ke of triangles without texture coordinates"] += mesh.uv is None
    image = _image("map_Ke", mtl, model, images) if mesh.uv is not None else None
    return None if image is None or not image.texels.any() else scale(radiance if any(radiance) else 1.0, image)


def _values(mtl: Statements, word: str, default: tuple[float, ...], most: float = np.inf) -> Any:
    """Return the numbers of a statement, from 0 to `most`, as many as its `default`, or one that stands for all."""
    if word not in mtl:
        return default
    number, argument = mtl[word]
    words = argument.partition("#")[0].removeprefix("-halo ").split()
    values = [float(x) for x in words if NUMBER.fullmatch(x)]
    fits = len(values) == len(words) and len(values) in (1, len(default))
    if not fits or not all(0 <= x <= most and x < np.inf for x in values):
        what = f"{'1 number' if len(default) == 1 else '1 or 3 numbers'} from 0{f' to {most:g}' * (most < np.inf)}"
        raise ValueError(f"line {number}: {word} must be {what}; got {argument[:60]!r}")
    return tuple(values * (len(default) // len(values)))


def _image(word: str, mtl: Statements, model: Model, images: Images) -> Image | None:
    """Return the image of a statement, of one channel of ``map_d``, placed by its options ``-s`` and ``-o``."""
    words, options = mtl[word][1].split(" "), {"-s": [1.0, 1.0], "-o": [0.0, 0.0]}
    while len(words) > 1 and words[0].startswith("-"):
        name = words.pop(0)
        values = []
        while len(words) > 1 and (NUMBER.fullmatch(words[0]) or words[0] in ("on", "off", "")):
            values.append(words.pop(0))
        given = [float(x) for x in values if NUMBER.fullmatch(x)]
        options[name] = [*given, *options.get(name, [])[len(given) :]]
        model.unread[f"{name} of an image"] += name not in ("-s", "-o")
    key = " ".join(words), word == "map_d"
    if key not in images:
        path, images[key] = model.file(key[0]), None
        try:
            images[key] = None if path is None else _opacity(path) if word == "map_d" else Image(path)
        except ValueError as error:
            if isinstance(error.__cause__, ImportError):  # no fault of the file
                raise
            model.unread[f"damaged image: {error}"] += 1
    image, (s, t, *_), (u, v, *_) = images[key], options["-s"], options["-o"]
    return None if image is None else replace(image, scale=(s, t), offset=(u, v))


def _opacity(path: Path) -> Image:
    """Return the opacity of an image file, or its values where it has none, as an image of one channel."""
    texels = load_image(path, linear=True, alpha=True)[::-1]
    values = texels[..., -1:] if (texels[..., -1] < 1).any() else texels[..., :-1].mean(axis=2, keepdims=True)
    return Image(np.clip(values, 0, 1))
