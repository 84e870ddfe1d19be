"""Materials, lights and cameras of glTF files.

A material is `dmis.brdf.metallic_roughness` with the file's base colour, metalness and roughness, numbers and images;
`_EXTENSIONS` are the extensions that are read. Triangles of a material with emission are a mesh light, on both sides if
the material is double-sided. What a file lets fade out is no light transport: the range of lights and the occlusion
texture are ignored. Intensities and radiances are the file's numbers: candela, lux and nits are not converted.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from dmis.base.vectors import Array, Floats
from dmis.brdf.materials import Material
from dmis.brdf.metallic_roughness import metallic_roughness
from dmis.brdf.texture import Image, scale
from dmis.formats.model import Model
from dmis.formats.vertex_colours import paint
from dmis.geometry.gltf import Gltf, Primitive
from dmis.geometry.mesh import Mesh, concatenate
from dmis.image_reader import decode_image
from dmis.light.delta import DistantLight, PointLight, SpotLight
from dmis.light.light import Light
from dmis.light.mesh_light import MeshLight
from dmis.scene.camera import Camera

EXTENSIONS = (
    "KHR_lights_punctual",
    "KHR_materials_emissive_strength",
    "KHR_materials_ior",
    "KHR_materials_specular",
    "KHR_mesh_quantization",
    "KHR_texture_transform",
)
"""Extensions that are read; others are named as left out."""
HEIGHT = 480
"""Pixels of the height of an image by a camera of the file."""
_CLAMP, _MIRROR = 33071, 33648


def read_gltf(gltf: Gltf, model: Model) -> None:
    """Add the triangles, lights and cameras of a glTF file to a model."""
    materials = Materials(gltf)
    joined: dict[Any, list[Mesh]] = {}
    for number, primitive in enumerate(gltf.primitives()):
        if (mesh := model.drop_flat(primitive.mesh)) is None:
            continue
        material, image = primitive.material, None
        if primitive.colours is not None:
            mesh, image = _with_colours(materials, primitive, mesh)
        # primitives of a material are one part, where their vertices have the same attributes
        key = material, mesh.uv is None, mesh.normals is None, None if image is None else number
        joined.setdefault((key, image), []).append(mesh)
    for ((material, *_), image), meshes in joined.items():
        mesh = concatenate(meshes)
        light = materials.emission(material, mesh)
        if light is not None:
            mesh = Mesh(mesh.vertices, light.faces, mesh.normals, mesh.uv)
        model.add(mesh, materials.material(material, image), light)
    for node, matrix in gltf.nodes:
        if "camera" in node:
            _add_camera(gltf.json["cameras"][node["camera"]], node, matrix, model)
        if (of_node := node.get("extensions", {}).get("KHR_lights_punctual")) is not None:
            lights = gltf.json["extensions"]["KHR_lights_punctual"]["lights"]
            model.lights.append(_light(lights[of_node["light"]], matrix))
    gltf.unread["animation"] += len(gltf.json.get("animations", []))
    for name in gltf.json.get("extensionsUsed", []):
        gltf.unread[f"extension {name}"] += name not in EXTENSIONS
    model.unread.update(gltf.unread)


class Materials:
    """The materials of a glTF file, each made once."""

    def __init__(self, gltf: Gltf) -> None:
        self._gltf = gltf
        self._made: dict[int | None, Material] = {}
        self._images: dict[tuple[int, bool], Array] = {}

    def parts(self, number: int | None) -> dict[str, Any]:
        """Return the description of a material; that without a number is the default."""
        return {} if number is None else dict(self._gltf.json["materials"][number])

    def textured(self, number: int | None) -> bool:
        """Return whether a material has a texture."""
        said = self.parts(number)
        return any(name.endswith("Texture") for name in (*said, *said.get("pbrMetallicRoughness", {})))

    def material(self, number: int | None, colours: Image | tuple[float, ...] | None = None) -> Material:
        """Return a material, with `colours` that multiply its base colour."""
        if colours is None and number in self._made:
            return self._made[number]
        said = self.parts(number)
        surface, extensions = said.get("pbrMetallicRoughness", {}), said.get("extensions", {})
        *base, alpha = surface.get("baseColorFactor", (1, 1, 1, 1))
        colour: Any = tuple(base)
        if (image := self.texture(surface, "baseColorTexture")) is not None:
            colour = scale(colour, image)
        if colours is not None:
            colour = scale(colour, colours)
        metallic, roughness = surface.get("metallicFactor", 1.0), surface.get("roughnessFactor", 1.0)
        if (image := self.texture(surface, "metallicRoughnessTexture", linear=True)) is not None:
            roughness = scale(roughness, Image(image.texels[..., -2:-1], image.scale, image.offset, image.wrap))
            metallic = scale(metallic, Image(image.texels[..., -1:], image.scale, image.offset, image.wrap))
        self._note(said, alpha)
        made = metallic_roughness(
            colour,
            metallic,
            roughness,
            extensions.get("KHR_materials_specular", {}).get("specularFactor", 1.0),
            extensions.get("KHR_materials_ior", {}).get("ior", 1.5) or 1e4,  # 0: it reflects everything
            alpha if said.get("alphaMode") == "BLEND" else 1.0,
        )
        material = Material(made.lobes, said.get("name") or f"material {number}")
        if colours is None:
            self._made[number] = material
        return material

    def _note(self, said: Mapping[str, Any], alpha: float) -> None:
        """Count what is left out of a material."""
        unread = self._gltf.unread
        unread["normal map"] += "normalTexture" in said
        if said.get("alphaMode", "OPAQUE") != "OPAQUE":
            texture = said.get("pbrMetallicRoughness", {}).get("baseColorTexture")
            unread["alpha mask"] += texture is not None and bool((self._pixels(texture)[..., 3] < 1).any())
        specular = said.get("extensions", {}).get("KHR_materials_specular", {})
        unread["colour of a coat"] += specular.get("specularColorFactor", [1, 1, 1]) != [1, 1, 1]
        unread["texture of a coat"] += len({"specularTexture", "specularColorTexture"} & set(specular))

    def emission(self, number: int | None, mesh: Mesh) -> MeshLight | None:
        """Return the light of triangles with a material; None if it emits nothing."""
        said = self.parts(number)
        strength = said.get("extensions", {}).get("KHR_materials_emissive_strength", {}).get("emissiveStrength", 1.0)
        radiance: Any = tuple(strength * x for x in said.get("emissiveFactor", (0, 0, 0)))
        if not any(radiance):
            return None
        if (image := self.texture(said, "emissiveTexture")) is not None and mesh.uv is not None:
            radiance = scale(radiance, image)
            if not radiance.texels.any():
                return None
        faces = mesh.faces
        if said.get("doubleSided", False):
            faces = np.concatenate([faces, faces[:, ::-1]])
        try:
            return MeshLight(mesh.vertices, faces, radiance, mesh.uv if isinstance(radiance, Image) else None)
        except ValueError as error:
            if "overlap" not in str(error):
                raise
            self._gltf.unread["emission of triangles that overlap"] += 1
            return None

    def texture(self, owner: Mapping[str, Any], name: str, linear: bool = False) -> Image | None:
        """Return the image of a texture; None if there is none, or it is counted as left out."""
        if (info := owner.get(name)) is None:
            return None
        transform = info.get("extensions", {}).get("KHR_texture_transform", {})
        if transform.get("texCoord", info.get("texCoord", 0)) != 0:
            self._gltf.unread["texture with a second set of coordinates"] += 1
            return None
        texture = self._gltf.json["textures"][info["index"]]
        if "source" not in texture:
            self._gltf.unread["texture of another format"] += 1
            return None
        self._gltf.unread["rotated texture"] += transform.get("rotation", 0) != 0
        sampler = self._gltf.json["samplers"][texture["sampler"]] if "sampler" in texture else {}
        wraps = {sampler.get("wrapS", 10497), sampler.get("wrapT", 10497)}
        self._gltf.unread["texture that is mirrored or clamped along one axis (it is repeated)"] += (
            len(wraps) > 1 or _MIRROR in wraps
        )
        s, t = transform.get("scale", (1, 1))
        u, v = transform.get("offset", (0, 0))  # from the top, v downwards: here it is upwards
        texels = self._pixels(info, linear)[::-1, :, :3]
        return Image(texels, (s, t), (u, 1 - t - v), "clamp" if wraps == {_CLAMP} else "repeat")

    def _pixels(self, info: Mapping[str, Any], linear: bool = False) -> Array:
        """Return the pixels of a texture's image, ``(H, W, 4)``, read once."""
        number = self._gltf.json["textures"][info["index"]]["source"]
        if (number, linear) not in self._images:
            image = self._gltf.json["images"][number]
            data = self._gltf.resource(image["uri"]) if "uri" in image else self._gltf.view(image["bufferView"])[0]
            pixels = decode_image(data, f"image {number}", linear=linear, alpha=True)
            grey = pixels.shape[2] == 2
            self._images[number, linear] = pixels[..., [0, 0, 0, 1]] if grey else pixels
        return self._images[number, linear]


def _with_colours(materials: Materials, primitive: Primitive, mesh: Mesh) -> tuple[Mesh, Any]:
    """Return a mesh with vertex colours, and these: an image, a colour, or None if they are white or left out."""
    colours = np.clip(np.asarray(primitive.colours)[:, :3], 0, 1)
    used = colours[np.unique(mesh.faces)]
    if (used == used[0]).all():
        return mesh, None if (used[0] == 1).all() else tuple(used[0].tolist())
    if materials.textured(primitive.material):
        materials._gltf.unread["mesh with vertex colours over a texture"] += 1
        return mesh, None
    return paint(mesh, colours)


def _add_camera(camera: Mapping[str, Any], node: Mapping[str, Any], matrix: Floats, model: Model) -> None:
    """Add a perspective camera; it looks along -z of its node."""
    if camera["type"] != "perspective":
        model.unread["orthographic camera"] += 1
        return
    lens = camera["perspective"]
    aspect = lens.get("aspectRatio", 4 / 3)
    half = math.tan(lens["yfov"] / 2)
    axes = matrix[:3, :3] / np.linalg.norm(matrix[:3, :3], axis=0)
    to_world = np.eye(4)
    to_world[:3] = np.stack([axes[:, 0], axes[:, 1], -axes[:, 2], matrix[:3, 3]], axis=1)
    name = node.get("name") or camera.get("name") or f"camera {len(model.cameras)}"
    fov = 2 * math.degrees(math.atan(half * min(aspect, 1)))
    model.cameras[name] = Camera(to_world, fov, (max(round(HEIGHT * aspect), 1), HEIGHT))


def _light(light: Mapping[str, Any], matrix: Floats) -> Light:
    """Return a light of KHR_lights_punctual; it shines along -z of its node."""
    place, axis = tuple(matrix[:3, 3].tolist()), matrix[:3, 2] / np.linalg.norm(matrix[:3, 2])
    strength = tuple(light.get("intensity", 1.0) * x for x in light.get("color", (1, 1, 1)))
    return _LIGHTS[light["type"]](place, axis, strength, light.get("spot", {}))


def _spot(place: Any, axis: Floats, strength: Any, spot: Mapping[str, Any]) -> Light:
    inner, outer = spot.get("innerConeAngle", 0.0), spot.get("outerConeAngle", math.pi / 4)
    return SpotLight(place, tuple(-axis), strength, math.degrees(outer), math.degrees(inner))


_LIGHTS: dict[str, Callable[..., Light]] = {
    "directional": lambda place, axis, strength, spot: DistantLight(tuple(axis), strength),
    "point": lambda place, axis, strength, spot: PointLight(place, strength),
    "spot": _spot,
}
"""Functions that make the lights of KHR_lights_punctual, by type."""
