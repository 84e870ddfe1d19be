"""A scene of dmis as a scene of Mitsuba 3: camera, meshes, lights, materials.

Select a Mitsuba variant before this is imported. What has no exact counterpart is refused, but for glossy materials
with ``exact=False``: those get the nearest of Mitsuba's own BSDFs, which costs about the same and makes another image.
"""

from __future__ import annotations

from typing import Any

import mitsuba as mi
import numpy as np

from dmis.base.color import LUMINANCE
from dmis.base.vectors import frame
from dmis.brdf.ashikhmin_shirley import BlendBase, BlendCoat
from dmis.brdf.fresnel import Conductor, Dielectric
from dmis.brdf.lobe import Lambert
from dmis.brdf.materials import Material
from dmis.brdf.microfacet import Microfacet
from dmis.brdf.texture import Image
from dmis.geometry.mesh import Mesh
from dmis.light.area import DiskLight, SphereLight
from dmis.light.delta import DistantLight, PointLight
from dmis.light.environment import EnvironmentLight
from dmis.scene.camera import Camera
from dmis.scene.groups import Part
from dmis.scene.scene import Scene

SAMPLERS = ("independent", "stratified", "multijitter", "orthogonal", "ldsampler")
"""Mitsuba's samplers."""


def translate(scene: Scene, *, exact: bool, by_power: bool = False, compensated: bool = False) -> Any:
    """Return the Mitsuba scene.

    Parameters
    ----------
    exact
        Every BRDF by `mitsuba_lobes.Lobes`, for images that must be the same; else by Mitsuba's own BSDFs.
    by_power
        Lights are picked in proportion to `power` (Mitsuba's `sampling_weight`); else all with the same probability.
    compensated
        The environment map's light samples leave out what is below its mean (Mitsuba's `mis_compensation`).
    """
    objects: dict[str, Any] = {"type": "scene"}
    bsdfs: dict[int, Any] = {}
    for k, part in enumerate(scene.parts):
        bsdf = bsdfs.setdefault(id(part.material), _bsdf(part.material, exact))
        weight = power(part.light, scene) if by_power and part.light is not None else 1.0
        objects[f"part{k}"] = _shape(part, bsdf, weight)
    visible = [part.light for part in scene.parts if part.light is not None]
    for k, light in enumerate(scene.lights):
        if not any(light is area_light for area_light in visible):
            objects[f"light{k}"] = _light(light, power(light, scene) if by_power else 1.0, compensated)
    return mi.load_dict(objects)


def power(light: Any, scene: Scene) -> float:
    """Return the power of a light of `scene` in watts by luminance.

    An area light emits ``pi A L``, a point ``4 pi I``. Of lights that are infinitely far away it is the power that
    enters the disk of the scene's radius, ``pi R^2`` times irradiance, or times the integral of the sky's radiance.
    """
    low, high = scene.bounds
    disk = np.pi * float(((high - low) ** 2).sum()) / 4
    if isinstance(light, EnvironmentLight):
        rgb = np.asarray(light.texels, float) * np.asarray(light.scale, float)
        sine = np.sin((np.arange(len(rgb)) + 0.5) * np.pi / len(rgb))
        return float(disk * 4 * np.pi * np.average((rgb @ LUMINANCE).mean(axis=1), weights=sine))
    if isinstance(light, PointLight):
        return float(4 * np.pi * np.dot(_rgb(light.intensity), LUMINANCE))
    luminance = float(np.dot(_rgb(light.radiance), LUMINANCE))
    if isinstance(light, DistantLight):
        return disk * luminance
    (mesh,) = [part.mesh for part in scene.parts if part.light is light]
    a, b, c = np.asarray(mesh.vertices, float)[np.asarray(mesh.faces).T]
    return float(np.pi * luminance * np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2)


def nearest_spp(sampler: str, spp: int) -> int:
    """Return the number of samples per pixel nearest to `spp`, by ratio, that the Mitsuba sampler does not change.

    Stratified takes squares, multijitter products of two numbers that differ by 0 or 1, orthogonal squares of primes,
    and ldsampler powers of 4 from 4 on.
    """
    roots = np.arange(1, int(np.sqrt(spp)) * 2 + 3)
    allowed = {
        "independent": np.array([spp]),
        "stratified": roots**2,
        "multijitter": np.concatenate([roots**2, roots * (roots + 1)]),
        "orthogonal": np.array([p * p for p in roots[1:] if (p % np.arange(2, p) > 0).all()]),
        "ldsampler": 4 ** np.arange(1, 16),
    }[sampler]
    return int(allowed[np.abs(np.log(allowed / spp)).argmin()])


def sensor(camera: Camera, sampler: str = "independent") -> Any:
    """Return the Mitsuba camera: x is left in its images, and a box filter of one pixel. `sampler`: see `SAMPLERS`."""
    if camera.filter is not None:
        raise ValueError(f"the pixel filter must be a box of one pixel, to be the same in both; got {camera.filter}")
    width, height = camera.resolution
    return mi.load_dict(
        {
            "type": "perspective",
            "fov": camera.fov,
            "fov_axis": "smaller",
            "near_clip": 1e-4,
            "far_clip": 1e7,
            "to_world": mi.ScalarTransform4f(np.asarray(camera.to_world, float) @ np.diag([-1.0, 1.0, 1.0, 1.0])),
            "film": {
                "type": "hdrfilm",
                "width": width,
                "height": height,
                "rfilter": {"type": "box"},
                "pixel_format": "rgb",
                "component_format": "float32",
            },
            "sampler": {"type": sampler},
        }
    )


def render(scene: Any, camera: Any, integrator: Any, spp: int, seed: int) -> np.ndarray:
    """An image ``(H, W, 3)``, computed when this returns.

    Seeds are spread over all 32 bits: images of Mitsuba's seeds 0 to 5 differ less from each other than from those of
    seeds 100 to 105, by up to five standard errors in the mean of a block of pixels, so neighbours are not independent.
    """
    spread = int(np.random.SeedSequence(seed).generate_state(1)[0])
    return np.array(mi.render(scene, sensor=camera, integrator=integrator, spp=spp, seed=spread))


def direct() -> Any:
    """Direct lighting with one light and one BRDF sample."""
    return mi.load_dict({"type": "direct", "emitter_samples": 1, "bsdf_samples": 1})


def path(max_depth: int | None) -> Any:
    """Path tracing; `max_depth` counts surfaces that scatter, as in dmis, where Mitsuba counts segments."""
    return mi.load_dict({"type": "path", "max_depth": -1 if max_depth is None else max_depth + 1})


# Shapes and lights ----------------------------------------------------------------------------------------------------


def _shape(part: Part, bsdf: Any, weight: float) -> Any:
    light = part.light
    if light is None:
        return _mesh(part.mesh, {"mesh_bsdf": bsdf}, part.mesh.normals)
    radiance = {"type": "rgb", "value": _rgb(light.radiance)}
    emitter = mi.load_dict({"type": "area", "radiance": radiance, "sampling_weight": weight})
    if isinstance(light, SphereLight):
        centre = [float(x) for x in light.centre]
        return mi.load_dict(
            {"type": "sphere", "center": centre, "radius": light.radius, "bsdf": bsdf, "emitter": emitter}
        )
    if isinstance(light, DiskLight):
        normal = np.asarray(light.normal, float) / np.linalg.norm(light.normal)
        s = frame(normal[:, None])[0][:, 0].astype(float)
        matrix = np.eye(4)
        matrix[:3] = np.stack(
            [s * light.radius, np.cross(normal, s) * light.radius, normal, np.asarray(light.centre, float)], axis=1
        )
        return mi.load_dict(
            {"type": "disk", "to_world": mi.ScalarTransform4f(matrix), "bsdf": bsdf, "emitter": emitter}
        )
    return _mesh(part.mesh, {"mesh_bsdf": bsdf, "mesh_emitter": emitter}, None)


def _mesh(mesh: Mesh, properties: dict[str, Any], normals: np.ndarray | None) -> Any:
    props = mi.Properties()
    for name, value in properties.items():
        props[name] = value
    out = mi.Mesh("mesh", len(mesh.vertices), len(mesh.faces), props, normals is not None, mesh.uv is not None)
    parameters = mi.traverse(out)
    parameters["vertex_positions"] = np.ravel(mesh.vertices).astype(np.float32)
    parameters["faces"] = np.ravel(mesh.faces).astype(np.uint32)
    if normals is not None:
        parameters["vertex_normals"] = np.ravel(normals).astype(np.float32)
    if mesh.uv is not None:
        parameters["vertex_texcoords"] = np.ravel(mesh.uv).astype(np.float32)
    parameters.update()
    return out


def _light(light: Any, weight: float = 1.0, compensated: bool = False) -> Any:
    if isinstance(light, EnvironmentLight):
        return _sky(light, weight, compensated)
    if isinstance(light, PointLight):
        intensity = {"type": "rgb", "value": _rgb(light.intensity)}
        position = [float(x) for x in light.position]
        return mi.load_dict({"type": "point", "position": position, "intensity": intensity, "sampling_weight": weight})
    if isinstance(light, DistantLight):
        away = [-float(x) for x in light.direction]
        irradiance = {"type": "rgb", "value": _rgb(light.radiance)}
        return mi.load_dict(
            {"type": "directional", "direction": away, "irradiance": irradiance, "sampling_weight": weight}
        )
    raise ValueError(f"a light must have a counterpart in Mitsuba, and a surface if it has an area; got {light}")


def _sky(light: EnvironmentLight, weight: float, compensated: bool) -> Any:
    """The same sky. Mitsuba's rows lie at the ends of their range, so the map has ``2 H + 1`` of them, which keeps the
    interpolant: it is linear between the rows of dmis's, every second one of these."""
    height, width, _ = light.texels.shape
    s, t = np.meshgrid((np.arange(width) + 0.5) / width, np.arange(2 * height + 1) / (2 * height))
    at = np.stack([s.ravel(), t.ravel()]).astype(np.float32)
    texels = light._lookup(at[0], at[1]).T.reshape(2 * height + 1, width, 3)
    rotation = np.eye(3) if light.to_world is None else np.asarray(light.to_world, float)
    matrix = np.eye(4)
    matrix[:3, :3] = rotation @ [[0, 0, -1], [1, 0, 0], [0, 1, 0]]  # y up and x = -z in Mitsuba's maps
    bitmap = mi.Bitmap(np.ascontiguousarray(texels, np.float32))
    return mi.load_dict(
        {
            "type": "envmap",
            "bitmap": bitmap,
            "to_world": mi.ScalarTransform4f(matrix),
            "sampling_weight": weight,
            "mis_compensation": compensated,
        }
    )


# Materials ------------------------------------------------------------------------------------------------------------


def _bsdf(material: Material, exact: bool) -> Any:
    if not material.lobes:
        return mi.load_dict({"type": "diffuse", "reflectance": {"type": "rgb", "value": [0.0, 0.0, 0.0]}})
    if material.name == "mirror":
        (lobe,) = material.lobes
        reflection = {"type": "conductor", "material": "none", "specular_reflectance": _spectrum(lobe.reflectance)}  # type: ignore[attr-defined]
        return mi.load_dict({"type": "twosided", "bsdf": reflection})
    if material.name == "glass" and len(material.lobes) == 2:
        mirrored, refracted = material.lobes
        if not refracted.scaled:  # type: ignore[attr-defined]
            raise ValueError("glass of pbrt-v2, whose refracted radiance is not divided by eta^2, is not in Mitsuba")
        return mi.load_dict(
            {
                "type": "dielectric",
                "int_ior": float(refracted.eta),  # type: ignore[attr-defined]
                "ext_ior": 1.0,
                "specular_reflectance": _spectrum(mirrored.reflectance),  # type: ignore[attr-defined]
                "specular_transmittance": _spectrum(refracted.transmittance),  # type: ignore[attr-defined]
            }
        )
    if exact:
        from mitsuba_lobes import Lobes

        return Lobes(material)
    return mi.load_dict({"type": "twosided", "bsdf": _nearest(material)})


def _nearest(material: Material) -> dict[str, Any]:
    """One of Mitsuba's own BSDFs that looks much the same; Blinn's exponent e is about ``alpha^2 = 2 / (e + 2)``."""
    match material.lobes:
        case (Lambert(reflectance=kd),):
            return {"type": "diffuse", "reflectance": _spectrum(kd)}
        case (Microfacet(distribution=facets, fresnel=Conductor() as metal),):
            eta, k = ({"type": "rgb", "value": [float(x) for x in v]} for v in (metal.eta, metal.k))
            return {"type": "roughconductor", "eta": eta, "k": k, **_rough(facets)}
        case (Lambert(reflectance=kd), Microfacet(distribution=facets, fresnel=Dielectric())):
            return {"type": "roughplastic", "diffuse_reflectance": _spectrum(kd), **_rough(facets)}
        case (BlendBase(diffuse=kd), BlendCoat(distribution=facets)):
            return {"type": "roughplastic", "diffuse_reflectance": _spectrum(kd), **_rough(facets)}
    raise ValueError(f"a material must be like one of Mitsuba's; got {material.name} with {material.lobes}")


def _rough(facets: Any) -> dict[str, Any]:
    return {"distribution": "beckmann", "alpha": float(np.sqrt(2 / (facets.exponent + 2)))}


def _spectrum(value: Any) -> Any:
    if isinstance(value, Image):
        from mitsuba_lobes import texture

        return texture(value)
    return {"type": "rgb", "value": _rgb(value)}


def _rgb(value: Any) -> list[float]:
    return np.broadcast_to(np.asarray(value, float).reshape(-1), 3).tolist()
