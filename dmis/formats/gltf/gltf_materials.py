"""Materials of glTF files.

A material is `dmis.metallic_roughness` with the file's base colour, metalness and roughness, numbers and images.
Triangles of a material with emission are a mesh light, on both sides if the material is double-sided. Where the opacity
of the base colour is an image, it is a mask. The occlusion texture is no light transport, and ignored.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache
from typing import Any, cast
from urllib.parse import unquote

import numpy as np

from dmis.brdf.materials import Material
from dmis.brdf.metallic_roughness import metallic_roughness
from dmis.brdf.relief import NormalMap
from dmis.brdf.texture import Image, Wrap, scale
from dmis.formats.gltf.gltf_file import Gltf
from dmis.geometry.mesh import Mesh
from dmis.image_reader import decode_image, linear_values
from dmis.scene.masks import Mask

_WRAPS: dict[int, Wrap] = {33071: "clamp", 33648: "mirror", 10497: "repeat"}
"""How an image goes on along an axis, by glTF's numbers; it repeats, as by default, if a number is none of these."""
_NEAREST = 9728


def _place(info: Mapping[str, Any]) -> tuple[Mapping[str, Any], int]:
    """Return the transform of a texture, and its set of coordinates."""
    place = info.get("extensions", {}).get("KHR_texture_transform", {})
    return place, place.get("texCoord", info.get("texCoord", 0))


class Materials:
    """The materials of a glTF file, each made once."""

    def __init__(self, gltf: Gltf) -> None:
        self._gltf = gltf
        self.material = lru_cache(maxsize=None)(self._material)
        self._pixels = lru_cache(maxsize=1)(self._decoded)
        self._counted: set[tuple[str, str]] = set()

    def leave_out(self, kind: str, thing: object, is_so: bool = True) -> None:
        """Count a thing of the description as left out, once, unless a caller's material takes its place."""
        if is_so and not self._gltf.model.bare and (kind, repr(thing)) not in self._counted:
            self._counted.add((kind, repr(thing)))
            self._gltf.model.unread[kind] += 1

    def entry(self, number: int | None) -> dict[str, Any]:
        """Return the description of a material; that without a number is the default."""
        return {} if number is None else self._gltf.item("materials", number)

    def textured(self, number: int | None) -> bool:
        """Return whether a material has a texture."""
        entry = self.entry(number)
        return any(name.endswith("Texture") for name in (*entry, *entry.get("pbrMetallicRoughness", {})))

    def _infos(self, number: int | None) -> dict[str, Any]:
        """Return the descriptions of a material's textures by name, that of the base colour first."""
        infos = {**self.entry(number).get("pbrMetallicRoughness", {}), **self.entry(number)}
        names = "baseColorTexture", "metallicRoughnessTexture", "normalTexture", "emissiveTexture"
        return {name: infos[name] for name in names if name in infos}

    def coordinates(self, number: int | None) -> int:
        """Return the set of texture coordinates of a material's first texture; textures of other sets are left out."""
        return _place(next(iter(self._infos(number).values()), {}))[1]

    def _material(self, number: int | None, colours: Image | tuple[float, ...] | None = None) -> Material:
        """Return a material, with `colours` that multiply its base colour."""
        entry = self.entry(number)
        surface, extensions = entry.get("pbrMetallicRoughness", {}), entry.get("extensions", {})
        *base, alpha = surface.get("baseColorFactor", (1, 1, 1, 1))
        name = entry.get("name") or ("default" if number is None else f"material {number}")
        self.leave_out(f"base colour above 1 of {name!r}", number, max(base) > 1)
        colour: Any = tuple(min(x, 1.0) for x in base)
        if (image := self.texture(number, "baseColorTexture")) is not None:
            colour = image if min(colour) == 1 else scale(colour, image)
        if colours is not None:
            colour = scale(colour, colours)
        metallic, roughness = surface.get("metallicFactor", 1.0), surface.get("roughnessFactor", 1.0)
        rough = self.texture(number, "metallicRoughnessTexture", True, channel=1)
        if rough is not None and isinstance(colour, Image) and rough.place != colour.place:
            self.leave_out("metalness and roughness placed apart from the base colour", number)
        elif rough is not None:
            roughness = scale(roughness, rough)
            metal = cast(Image, self.texture(number, "metallicRoughnessTexture", True, channel=2))
            metallic = scale(metallic, metal) if metallic and metal.texels.any() else 0.0  # which takes no image
        relief = None
        if (image := self.texture(number, "normalTexture", True)) is not None:
            relief = NormalMap(image, entry["normalTexture"].get("scale", 1.0))
        coat = extensions.get("KHR_materials_specular", {})
        if "KHR_materials_unlit" in extensions:  # matte is as near as light allows
            metallic, roughness, coat = 0.0, 1.0, {"specularFactor": 0.0}
        self.leave_out("colour of a coat", entry, coat.get("specularColorFactor", [1, 1, 1]) != [1, 1, 1])
        self.leave_out("texture of a coat", entry, bool({"specularTexture", "specularColorTexture"} & set(coat)))
        unnamed = metallic_roughness(
            colour,
            metallic,
            roughness,
            coat.get("specularFactor", 1.0),
            extensions.get("KHR_materials_ior", {}).get("ior", 1.5) or 1e4,  # 0: it reflects everything
            alpha if entry.get("alphaMode") == "BLEND" and not isinstance(colour, Image) else 1.0,
        )
        return Material(unnamed.lobes, name, relief)

    def mask(self, number: int | None, mesh: Mesh) -> Mask | None:
        """Return the holes that the opacity of a material's texture cuts; None if there are none."""
        entry = self.entry(number)
        mode, surface = entry.get("alphaMode", "OPAQUE"), entry.get("pbrMetallicRoughness", {})
        image = self.texture(number, "baseColorTexture", channel=3) if mode in ("MASK", "BLEND") else None
        if image is None or mesh.uv is None:
            return None
        factor = min(max(surface.get("baseColorFactor", (1, 1, 1, 1))[3], 0.0), 1.0)
        cutoff = None if mode == "BLEND" else entry.get("alphaCutoff", 0.5)
        whole = factor * image.texels.min() >= (1.0 if cutoff is None else cutoff)
        return None if whole else Mask(cast(Image, scale(factor, image)), cutoff)

    def is_clear(self, number: int | None) -> bool:
        """Return whether a material is nowhere there, because its factor of opacity is below the cutoff."""
        entry = self.entry(number)
        opacity = min(entry.get("pbrMetallicRoughness", {}).get("baseColorFactor", (1, 1, 1, 1))[3], 1)
        return entry.get("alphaMode") == "MASK" and bool(opacity < entry.get("alphaCutoff", 0.5))

    def emission(self, number: int | None, mesh: Mesh) -> Any:
        """Return the radiance of triangles with a material, a colour or an image; None if they emit nothing."""
        entry = self.entry(number)
        strength = entry.get("extensions", {}).get("KHR_materials_emissive_strength", {}).get("emissiveStrength", 1.0)
        radiance = tuple(strength * x for x in entry.get("emissiveFactor", (0, 0, 0)))
        if not any(radiance) or "emissiveTexture" not in entry:
            return radiance if any(radiance) else None
        image = self.texture(number, "emissiveTexture")
        return None if image is None or mesh.uv is None or not image.texels.any() else scale(radiance, image)

    def texture(self, number: int | None, name: str, linear: bool = False, channel: int | None = None) -> Image | None:
        """Return the image of a texture, of all colours or of a `channel`, 3: opacity; None if there is none, or it is
        counted as left out.
        """
        infos = self._infos(number)
        if (info := infos.get(name)) is None:
            return None
        place, texture_set = _place(info)
        if texture_set != self.coordinates(number):
            self.leave_out(f"{name} with other coordinates than {next(iter(infos))}", info)
            return None
        if place.get("rotation"):
            if "KHR_texture_transform" in self._gltf.json.get("extensionsRequired", ()):
                raise ValueError(f"it requires {name} to be rotated, which is not read; export it without rotation")
            self.leave_out(f"{name} that is rotated", info)
            return None
        texture = self._gltf.item("textures", info["index"])
        if "source" not in texture:
            self.leave_out("texture of another format", info)
            return None
        uri = self._gltf.item("images", texture["source"]).get("uri", "data:")
        if not uri.startswith("data:") and self._gltf.file(uri) is None:
            self.leave_out(f"missing file {unquote(uri)[-60:]!r}", uri)
            return None
        sampler = self._gltf.item("samplers", texture["sampler"]) if "sampler" in texture else {}
        across, down = (_WRAPS.get(sampler.get(axis, 10497), "repeat") for axis in ("wrapS", "wrapT"))
        (s, t), (u, v) = place.get("scale", (1, 1)), place.get("offset", (0, 0))
        pixels = self._pixels(texture["source"])[::-1]
        if channel == 3:
            pixels = np.ones((1, 1, 1), np.float32) if pixels.shape[2] in (1, 3) else pixels[..., -1:]
        elif channel is not None and pixels.shape[2] > 2:
            pixels = pixels[..., channel : channel + 1]
        texels = linear_values(pixels, linear or channel == 3)
        return Image(texels, (s, t), (u, 1 - t - v), (across, down), sampler.get("magFilter") == _NEAREST)

    def _decoded(self, number: int) -> np.ndarray:
        """Return the pixels of an image, ``(H, W, 1 to 4)``; `_pixels` keeps those of the last one."""
        image = self._gltf.item("images", number)
        data = self._gltf.resource(image["uri"]) if "uri" in image else self._gltf.view(image["bufferView"])[0]
        return decode_image(data, f"image {number}")
