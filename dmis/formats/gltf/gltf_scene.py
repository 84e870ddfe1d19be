"""Parts, lights and cameras of glTF files; their materials are read by `dmis.formats.gltf.gltf_materials`.

What a file lets fade out is no light transport: the range of lights is ignored. Intensities and radiances are the
file's numbers: candela, lux and nits are not converted.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from dmis.base.vectors import Floats
from dmis.brdf.texture import Image
from dmis.formats.gltf.gltf_file import Gltf
from dmis.formats.gltf.gltf_materials import Materials
from dmis.formats.model import Model
from dmis.geometry.mesh import Mesh, concatenate
from dmis.light.delta import DistantLight, PointLight, SpotLight
from dmis.light.light import Light
from dmis.scene.camera import Camera

HEIGHT = 480
"""Pixels of the height of an image by a camera of the file."""


def read_gltf(data: bytes, model: Model) -> None:
    """Add the triangles, lights and cameras of the bytes of a glTF file to its model."""
    gltf = Gltf(model, data)
    materials = Materials(gltf)
    joined: dict[Any, list[Mesh]] = {}
    for number, (whole, colours, material) in enumerate(gltf.primitives(materials.coordinates)):
        if materials.is_clear(material) or (mesh := model.drop_flat(whole)) is None:
            continue
        image = None
        if colours is not None:
            mesh, image = _with_colours(materials, material, mesh, colours)
        # primitives of a material are one part, where their vertices have the same attributes
        key = material, mesh.uv is None, mesh.normals is None, None if image is None else number
        joined.setdefault((key, image), []).append(mesh)
    for ((material, *_), image), meshes in joined.items():
        mesh = concatenate(meshes)
        radiance, two_sided = materials.emission(material, mesh), materials.entry(material).get("doubleSided", False)
        if (light := None if radiance is None else model.lamp(mesh, radiance, two_sided)) is not None:
            mesh = Mesh(mesh.vertices, light.faces, mesh.normals, mesh.uv)
        surface = materials.material(material, image)
        if light is not None and two_sided and surface.relief is not None:  # it would turn both sides alike
            materials.leave_out("normal map of a surface that emits on both sides", material)
            surface = replace(surface, relief=None)
        model.add(mesh, surface, light, materials.mask(material, mesh))
    for node, matrix in gltf.nodes:
        if "camera" in node:
            _add_camera(gltf.item("cameras", node["camera"]), node, matrix, model)
        if (of_node := node.get("extensions", {}).get("KHR_lights_punctual")) is not None:
            lights = gltf.json["extensions"]["KHR_lights_punctual"]["lights"]
            model.lights.append(_light(lights[of_node["light"]], matrix))
    model.unread["animation"] += len(gltf.json.get("animations", []))
    model.unread.update(f"extension {name}" for name in gltf.unread_extensions("extensionsUsed"))


def _with_colours(materials: Materials, material: int | None, mesh: Mesh, given: Floats) -> tuple[Mesh, Any]:
    """Return a mesh with vertex colours, and these: an image, a colour, or None if they are white or left out."""
    colours, alpha = np.split(np.clip(given, 0, 1), [3], axis=1)
    fades = materials.entry(material).get("alphaMode", "OPAQUE") != "OPAQUE" and bool((alpha < 1).any())
    materials.leave_out("opacity of vertex colours", material, fades)
    used = colours[np.unique(mesh.faces)]
    if (used == used[0]).all():
        return mesh, None if (used[0] == 1).all() else tuple(used[0].tolist())
    if materials.textured(material):
        materials.leave_out("material with vertex colours over a texture", material)
        return mesh, None
    return paint(mesh, colours)


def _add_camera(camera: Mapping[str, Any], node: Mapping[str, Any], matrix: Floats, model: Model) -> None:
    """Add a camera, which looks along -z of its node."""
    kind, lens = camera["type"], camera[camera["type"]]
    if kind == "perspective":
        aspect = lens.get("aspectRatio", 4 / 3)
        half = math.tan(lens["yfov"] / 2) * min(aspect, 1)
    else:
        aspect, half = lens["xmag"] / lens["ymag"], min(lens["xmag"], lens["ymag"])
    axes = matrix[:3, :3] / np.linalg.norm(matrix[:3, :3], axis=0)
    to_world = np.eye(4)
    to_world[:3] = np.stack([axes[:, 0], axes[:, 1], -axes[:, 2], matrix[:3, 3]], axis=1)
    name = node.get("name") or camera.get("name") or f"camera {len(model.cameras)}"
    size = max(round(HEIGHT * aspect), 1), HEIGHT
    model.cameras[name] = Camera(to_world, 2 * math.degrees(math.atan(half)), size, projection=kind)


def _light(light: Mapping[str, Any], matrix: Floats) -> Light:
    """Return a light of KHR_lights_punctual; it shines along -z of its node."""
    place, axis = tuple(matrix[:3, 3].tolist()), matrix[:3, 2] / np.linalg.norm(matrix[:3, 2])
    strength = tuple(light.get("intensity", 1.0) * x for x in light.get("color", (1, 1, 1)))
    if light["type"] == "directional":
        return DistantLight(tuple(axis), strength)
    if light["type"] == "point":
        return PointLight(place, strength)
    cone = light.get("spot", {})
    inner, outer = cone.get("innerConeAngle", 0.0), cone.get("outerConeAngle", math.pi / 4)
    return SpotLight(place, tuple(-axis), strength, math.degrees(outer), math.degrees(inner))


def paint(mesh: Mesh, colours: Floats) -> tuple[Mesh, Image]:
    """Return a mesh whose triangles have coordinates of their own, and the image that they show: their colours.

    Parameters
    ----------
    mesh
        Its texture coordinates are replaced.
    colours
        Linear RGB of the vertices, ``(V, 3)``, from 0 to 1.

    Notes
    -----
    Bilinear interpolation in a square is linear on the triangle of three corners, ``c0 + a (c1 - c0) + b (c2 - c0)``,
    if the fourth corner is ``c1 + c2 - c0``. Of the three corners that may be c0, the one is taken for which this is
    nearest to [0, 1]: of grey always one is inside. Where none is, triangles are split at the midpoints of their edges:
    with a corner of the old triangle as c0, or a midpoint for the inner one, the fourth is a midpoint or a corner.
    """
    turns = [np.roll(mesh.faces, turn, axis=1) for turn in range(3)]
    fourths = [colours[f[:, 1]] + colours[f[:, 2]] - colours[f[:, 0]] for f in turns]
    beyond = [np.abs(fourth - np.clip(fourth, 0, 1)).max(axis=1) for fourth in fourths]
    if np.min(beyond, axis=0).max() > 1e-6:
        from trimesh.remesh import subdivide  # here: few colours need it

        columns = [x for x in (mesh.vertices, colours, mesh.normals) if x is not None]
        rows, faces = subdivide(np.concatenate(columns, axis=1), mesh.faces)
        return paint(Mesh(rows[:, :3], faces, None if mesh.normals is None else rows[:, 6:]), rows[:, 3:6])
    best = np.argmin(beyond, axis=0)
    triangle = np.arange(len(best))
    corner = np.stack(turns)[best, triangle].ravel()
    fourth = np.clip(np.stack(fourths)[best, triangle], 0, 1)
    across = int(np.ceil(np.sqrt(len(best))))
    down = -(-len(best) // across)
    texels = np.zeros((down, 2, across, 2, 3), np.float32)
    row, column = np.divmod(triangle, across)
    c = colours[corner].reshape(-1, 3, 3)
    for (i, j), values in zip(((0, 0), (0, 1), (1, 0), (1, 1)), (c[:, 0], c[:, 1], c[:, 2], fourth), strict=True):
        texels[row, i, column, j] = values
    places = np.array([[0.5, 0.5], [1.5, 0.5], [0.5, 1.5]])
    uv = (2 * np.stack([column, row], axis=1)[:, None] + places) / (2 * across, 2 * down)
    normals = None if mesh.normals is None else mesh.normals[corner]
    faces = np.arange(len(corner)).reshape(-1, 3)
    return Mesh(mesh.vertices[corner], faces, normals, uv.reshape(-1, 2)), Image(
        texels.reshape(2 * down, 2 * across, 3), wrap="clamp"
    )
