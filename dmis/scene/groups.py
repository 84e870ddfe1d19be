"""Parts of a scene, and groups of parts that are shaded as one batch.

Materials are simplified before: black lobes are left out, and constant images become numbers.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, fields, is_dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from dmis.base.plugins import checked, is_shipped
from dmis.base.validate import direction
from dmis.base.vectors import Array, Index
from dmis.brdf.lobe import LOBE_CHECKS, DeltaLobe, Lobe, Parameters
from dmis.brdf.materials import Material, matte
from dmis.brdf.texture import Image, Images
from dmis.geometry.mesh import Mesh
from dmis.light.light import AreaLight
from dmis.light.light_sample import ANY_POINT

if TYPE_CHECKING:
    from dmis.brdf.relief import Relief
    from dmis.scene.masks import Mask

NO_GROUP = 255
"""Group number of misses, and of surfaces that neither reflect nor emit."""


@dataclass(frozen=True, eq=False)
class Part:
    """A mesh with its material.

    Parameters
    ----------
    mesh
        Triangles in world space.
    material
        How they reflect.
    light
        The light whose visible surface this is; the winding of the triangles gives the bright side. None: it is none.
    tangent
        The direction that anisotropic lobes call u, three numbers, laid upon the surface; default: the one in which
        the mesh's texture coordinate u grows.
    mask
        Holes in the mesh, which must not be that of a light; None: there are none.
    """

    mesh: Mesh
    material: Material
    light: AreaLight | None = None
    tangent: tuple[float, float, float] | None = None
    mask: Mask | None = None

    def __post_init__(self) -> None:
        if self.mask is not None and self.light is not None:
            raise ValueError("a part with a light must not have a mask, because the light is sampled without its holes")
        if self.tangent is not None:
            direction("tangent", self.tangent)


def light_part(light: AreaLight) -> Part:
    """Return the visible surface of an area light, which emits its radiance and reflects nothing."""
    mesh = light.mesh()
    if mesh is None:
        raise ValueError(f"light must have a visible surface; {type(light).__name__}.mesh() returns None")
    return Part(Mesh(mesh.vertices, mesh.faces, uv=mesh.uv), matte(0), light)


@dataclass(frozen=True, eq=False)
class Group:
    """Materials with the same kinds of lobes, shaded as one batch.

    Attributes
    ----------
    materials
        The materials; a part's row in the parameter tables is its position here.
    reflection, transmission, delta
        Lobes with parameter tables ``(C, M)`` or ``(M,)`` in place of numbers, or textures (`Images` if M > 1).
        The three are reflection, transmission, and Dirac deltas of both kinds.
    emission
        ``(3, M)`` radiance of the bright side; None if nothing here emits.
    textured, smooth, anisotropic
        Whether texture coordinates, interpolated normals, tangents are needed.
    tangent
        ``(3, 1)``, the same for all points; None if tangents are those of the meshes.
    relief
        What turns the shading normals; None: nothing.
    textured_light
        The light whose emission is not in the table but computed at each point; None if there is none.
    """

    materials: tuple[Material, ...]
    reflection: tuple[Lobe, ...]
    transmission: tuple[Lobe, ...]
    delta: tuple[DeltaLobe, ...]
    emission: Array | None
    textured: bool
    smooth: bool
    anisotropic: bool
    tangent: Array | None = None
    textured_light: AreaLight | None = None
    relief: Relief | None = None

    @cached_property
    def turns(self) -> bool:
        """Whether shading normals differ from those of the triangles."""
        return self.smooth or self.relief is not None

    @cached_property
    def reflects(self) -> bool:
        """Whether there is any lobe, and not just emission."""
        return bool(self.reflection or self.transmission or self.delta)

    @cached_property
    def lobes(self) -> dict[str, tuple[Any, ...]]:
        """`reflection`, `transmission` and `delta` by name."""
        return {"reflection": self.reflection, "transmission": self.transmission, "delta": self.delta}

    def textured_emission(self, p: Array, uv: Array | None) -> Array:
        """Return what `textured_light` emits at points `p` ``(3, N)`` of texture coordinates `uv` ``(2, N)``."""
        assert self.textured_light is not None
        image = getattr(self.textured_light, "radiance", None)
        return image(uv) if isinstance(image, Image) and uv is not None else self.textured_light.emission(p)


def parameters(lobe: Parameters) -> Iterator[tuple[str, Any]]:
    """Yield the parameters that differ from point to point, and the nested data that may hold some, by name."""
    for field in fields(lobe):  # type: ignore[arg-type]
        value = getattr(lobe, field.name)
        nested = hasattr(value, "colours")  # to ask whether it is an instance of the protocol takes 30 µs
        if nested or field.name in lobe.colours or field.name in lobe.scalars or isinstance(value, Image | Images):
            yield field.name, value


def simplify(material: Material) -> Material:
    """Return a material without black lobes, and with constants in place of constant images.

    `dmis.brdf.ashikhmin_shirley.BlendBase` stays if it is black: which lobe a sample is drawn from would change for
    old scenes.
    """
    lobes = tuple(_fold_constant_images(lobe) for lobe in material.lobes)
    kept = tuple(lobe for lobe in lobes if not lobe.is_black())
    same = len(kept) == len(material.lobes) and all(a is b for a, b in zip(kept, material.lobes, strict=True))
    return material if same else replace(material, lobes=kept)


def _fold_constant_images(lobe: Any) -> Any:
    """Return `lobe` with numbers in place of images whose texels are all the same."""
    changes: dict[str, Any] = {}
    for name, value in parameters(lobe):
        if isinstance(value, Image):
            if "black" not in value.wraps and (value.texels == value.texels[0, 0]).all():
                texel = value(np.zeros((2, 1), np.float32))[:, 0].tolist()
                changes[name] = tuple(texel) if name in lobe.colours else texel[0]
        elif isinstance(value, Parameters) and (folded := _fold_constant_images(value)) is not value:
            changes[name] = folded
    return replace(lobe, **changes) if changes else lobe


def _batch_signature(lobe: Any) -> tuple[Any, ...]:
    """Return what two lobes must share to be shaded together: types, and fields that are the same at all points."""
    named = dict(parameters(lobe))
    rest = tuple(getattr(lobe, f.name) for f in fields(lobe) if f.name not in named)
    nested = tuple(_batch_signature(value) for value in named.values() if isinstance(value, Parameters))
    return type(lobe), rest, nested


def has_texture(lobe: Any) -> bool:
    """Return whether a parameter of a lobe, or of the data nested in it, is an image."""
    return any(isinstance(v, Image) or (isinstance(v, Parameters) and has_texture(v)) for _, v in parameters(lobe))


def _anisotropic(lobe: Any) -> bool:
    """Return whether a lobe, or the data nested in it, needs tangents."""
    return lobe.anisotropic or any(_anisotropic(v) for _, v in parameters(lobe) if isinstance(v, Parameters))


def batch_key(part: Part) -> Any:
    """Return a key that is equal for parts that can be shaded together; None for parts that neither reflect nor emit.

    Each textured light and each material with relief has its own key.
    """
    material = part.material
    if not material.lobes and part.light is None:
        return None
    textured = any(has_texture(lobe) for lobe in material.lobes)
    texture_key = textured if material.relief is None else id(material)
    smooth = part.mesh.normals is not None and bool(material.lobes)
    tangent = part.tangent if any(_anisotropic(lobe) for lobe in material.lobes) else None
    emission_key = id(part.light) if part.light is not None and part.light.textured else part.light is not None
    return tuple(_batch_signature(lobe) for lobe in material.lobes), texture_key, smooth, emission_key, tangent


def make_group(key: Any, members: list[tuple[Material, AreaLight | None]]) -> Group:
    """Return the group of the materials and lights of all parts that have the same `batch_key`."""
    _, texture_key, smooth, emits, tangent = key
    materials = tuple(material for material, _ in members)
    lobes = tuple(_checked(_tabulate(same)) for same in zip(*(material.lobes for material in materials), strict=True))
    lights = [light for _, light in members if light is not None]
    textured_light = next((light for light in lights if light.textured), None)
    emission = None
    if emits:
        # a textured light's column only says that the group emits
        tables = [ANY_POINT if light.textured else light.emission(ANY_POINT) for light in lights]
        emission = np.concatenate(tables, axis=1)
    return Group(
        materials,
        tuple(lobe for lobe in lobes if not lobe.delta and not lobe.transmissive),
        tuple(lobe for lobe in lobes if lobe.transmissive and not lobe.delta),
        tuple(lobe for lobe in lobes if lobe.delta),
        emission,
        bool(texture_key) or isinstance(getattr(textured_light, "radiance", None), Image),
        smooth,
        any(_anisotropic(lobe) for lobe in lobes),
        None if tangent is None else direction("tangent", tangent).astype(np.float32)[:, None],
        textured_light,
        materials[0].relief,
    )


def _tabulate(lobes: tuple[Any, ...]) -> Any:
    """Return one lobe whose parameters are tables over the materials: colours ``(1 or 3, M)``, scalars ``(M,)``."""
    changes: dict[str, Any] = {}
    for name, value in parameters(lobes[0]):
        values = [getattr(lobe, name) for lobe in lobes]
        if any(isinstance(x, Image) for x in values):
            changes[name] = Images(tuple(values)) if len(values) > 1 else value
        elif isinstance(value, Parameters):
            changes[name] = _tabulate(tuple(values))
        elif name in lobes[0].scalars:
            table = np.array([float(np.asarray(x).reshape(-1)[0]) for x in values], np.float32)
            changes[name] = table if len(lobes) > 1 else table[0]
        else:
            table = np.stack([np.broadcast_to(np.asarray(x, np.float32).reshape(-1), 3) for x in values], axis=1)
            changes[name] = table[:1] if (table == table[0]).all() else table
    return replace(lobes[0], **changes)


def _checked(lobe: Any) -> Any:
    """Return a lobe that checks what it returns if its class, or that of data nested in it, is not shipped."""
    nested = [getattr(lobe, field.name) for field in fields(lobe)]
    return checked(lobe, LOBE_CHECKS, any(is_dataclass(value) and not is_shipped(type(value)) for value in nested))


def bind_lobes(group: Group, row: Index | None, uv: Array | None) -> dict[str, tuple[Any, ...]]:
    """Return the lobes of a group with the parameters of N points, by kind.

    These come from the rows ``(N,)`` of the parameter tables (None: there is one material), and from images at the
    texture coordinates `uv` ``(2, N)`` (None: there are no images).
    """
    return {kind: tuple(bind(lobe, row, uv) for lobe in lobes) for kind, lobes in group.lobes.items()}


def bind(lobe: Any, row: Index | None, uv: Array | None) -> Any:
    """Return a lobe of a group with the parameters of N points, see `bind_lobes`."""
    changes: dict[str, Any] = {}
    for name, value in parameters(lobe):
        if isinstance(value, Image | Images):
            texels = value(uv) if isinstance(value, Image) else value(row, uv)  # type: ignore[arg-type]
            changes[name] = texels if name in lobe.colours else texels[0]
        elif not isinstance(value, np.ndarray | np.generic):
            changes[name] = bind(value, row, uv)
        elif row is not None:
            changes[name] = value.take(row, axis=-1)
    return replace(lobe, **changes)
