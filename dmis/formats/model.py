"""What the readers of models share: the contents of a file, and the files that it names."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from dmis.base.color import Rgb
from dmis.base.named_files import named_file
from dmis.brdf.materials import Material, matte
from dmis.brdf.texture import Image
from dmis.geometry.mesh import Mesh, without_degenerate
from dmis.light.light import Light
from dmis.light.mesh_light import MeshLight
from dmis.scene.camera import Camera
from dmis.scene.groups import Part
from dmis.scene.masks import Mask

DEFAULT_MATERIAL = matte()


@dataclass
class Model:
    """The contents of a file of a model.

    Attributes
    ----------
    path
        The file.
    outside
        Whether it may name files outside of its folder.
    parts, lights
        Those of a scene; a light with a surface is that of a part, too.
    cameras
        By name.
    unread
        Numbers of things that are left out, by kind: ``{"normal map": 2}``.
    flat
        Number of triangles without area, which are left out.
    """

    path: Path
    outside: bool = False
    parts: list[Part] = field(default_factory=list)
    lights: list[Light] = field(default_factory=list)
    cameras: dict[str, Camera] = field(default_factory=dict)
    unread: Counter[str] = field(default_factory=Counter)
    flat: int = 0

    def add(
        self,
        mesh: Mesh,
        material: Material = DEFAULT_MATERIAL,
        light: MeshLight | None = None,
        mask: Mask | None = None,
    ) -> None:
        """Add a mesh with its material, the light of its triangles, and its mask, which a light is left without."""
        if mask is not None and light is not None:
            self.unread["mask of a surface that emits"] += 1
            mask = None
        self.parts.append(Part(mesh, material, light, mask=mask))
        if light is not None:
            self.lights.append(light)

    def lamp(self, mesh: Mesh, radiance: Rgb | Image, two_sided: bool = False) -> MeshLight | None:
        """Return the light of a mesh whose triangles emit; None, and counted, if they overlap, so that none is one."""
        faces = np.concatenate([mesh.faces, mesh.faces[:, ::-1]]) if two_sided else mesh.faces
        try:
            return MeshLight(mesh.vertices, faces, radiance, mesh.uv if isinstance(radiance, Image) else None)
        except ValueError as error:
            if "overlap" not in str(error):
                raise
            self.unread["emission of triangles that overlap"] += 1
            return None

    def drop_flat(self, mesh: Mesh) -> Mesh | None:
        """Return a mesh without its triangles that have no area, which are counted; None if all are such."""
        try:
            mesh, dropped = without_degenerate(mesh)
        except ValueError:
            self.flat += mesh.triangles
            return None
        self.flat += dropped
        return mesh

    def file(self, name: str) -> Path | None:
        """Return the path of a file that this one names; None if there is none, which is counted as left out.

        Raises a ValueError if it is outside of the folder of the model, unless that is allowed.
        """
        path = named_file(self.path, name, self.outside)
        self.unread[f"missing file {name[-60:]!r}"] += path is None
        return path

    def summaries(self) -> tuple[str, ...]:
        """Return what is left out, with the number of each kind that there is more than once: "normal map (2)"."""
        return tuple(f"{kind} ({n})" if n > 1 else kind for kind, n in self.unread.items() if n)
