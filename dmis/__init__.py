"""Data-driven multiple importance sampling for Monte Carlo rendering, in NumPy on Embree.

The public names are those of `__all__`. ``import dmis`` loads nothing else, not even NumPy: a public name, a room and
a module of a room (``dmis.geometry.shapes``) are loaded where they are first used (PEP 562).
"""

from functools import partial
from importlib import import_module
from types import ModuleType
from typing import TYPE_CHECKING, Any

__version__ = "0.1.0"

_MODULES = {
    "brdf.materials": "Material glass matte metal mirror plastic shiny_metal substrate uber",
    "brdf.models": "ashikhmin_shirley blinn_phong coated_diffuse cook_torrance ggx lafortune phong rough_glass"
    " torrance_sparrow ward",
    "brdf.texture": "Image",
    "estimator.settings": "Settings",
    "estimator.technique": "Technique register_technique",
    "experiment.compare": "compare",
    "experiment.metrics": "mse relmse",
    "experiment.oracle": "make_oracle",
    "experiment.reference": "Reference make_reference",
    "experiment.runs": "measure",
    "fit.given": "Given",
    "fit.registry": "make_rule register_rule",
    "fit.rule": "Fit Rule",
    "formats.load_scene": "SHIPPED load_scene",
    "geometry.mesh": "Mesh",
    "geometry.mesh_files": "load_mesh",
    "geometry.subdivision": "loop_subdivide",
    "image": "read_exr write_exr",
    "light.area": "DiskLight QuadLight SphereLight",
    "light.delta": "DistantLight PointLight SpotLight",
    "light.environment": "EnvironmentLight",
    "light.mesh_light": "MeshLight",
    "pipeline.executor": "Processes",
    "pipeline.render": "render",
    "pipeline.result": "Result find_fireflies write_image",
    "samplers.pixel_filter": "PixelFilter",
    "samplers.streams": "register_sampler",
    "scene.camera": "Camera",
    "scene.groups": "Part",
    "scene.scene": "Scene",
}
"""Public names by the module that defines them, without ``dmis.``; type checkers read the imports below."""
_HOMES = {name: module for module, names in _MODULES.items() for name in names.split()}
_ROOMS = (
    "base", "brdf", "cli", "estimator", "experiment", "experiment.report", "experiment.speed", "fit", "formats",
    "formats.pbrt", "geometry", "light", "pipeline", "samplers", "scene", "variance",
)  # fmt: skip
"""Packages, whose modules are loaded as attributes."""
__all__ = sorted((*_HOMES, "plot"))

if TYPE_CHECKING:
    from dmis import plot as plot
    from dmis.brdf.materials import Material as Material
    from dmis.brdf.materials import glass as glass
    from dmis.brdf.materials import matte as matte
    from dmis.brdf.materials import metal as metal
    from dmis.brdf.materials import mirror as mirror
    from dmis.brdf.materials import plastic as plastic
    from dmis.brdf.materials import shiny_metal as shiny_metal
    from dmis.brdf.materials import substrate as substrate
    from dmis.brdf.materials import uber as uber
    from dmis.brdf.models import ashikhmin_shirley as ashikhmin_shirley
    from dmis.brdf.models import blinn_phong as blinn_phong
    from dmis.brdf.models import coated_diffuse as coated_diffuse
    from dmis.brdf.models import cook_torrance as cook_torrance
    from dmis.brdf.models import ggx as ggx
    from dmis.brdf.models import lafortune as lafortune
    from dmis.brdf.models import phong as phong
    from dmis.brdf.models import rough_glass as rough_glass
    from dmis.brdf.models import torrance_sparrow as torrance_sparrow
    from dmis.brdf.models import ward as ward
    from dmis.brdf.texture import Image as Image
    from dmis.estimator.settings import Settings as Settings
    from dmis.estimator.technique import Technique as Technique
    from dmis.estimator.technique import register_technique as register_technique
    from dmis.experiment.compare import compare as compare
    from dmis.experiment.metrics import mse as mse
    from dmis.experiment.metrics import relmse as relmse
    from dmis.experiment.oracle import make_oracle as make_oracle
    from dmis.experiment.reference import Reference as Reference
    from dmis.experiment.reference import make_reference as make_reference
    from dmis.experiment.runs import measure as measure
    from dmis.fit.given import Given as Given
    from dmis.fit.registry import make_rule as make_rule
    from dmis.fit.registry import register_rule as register_rule
    from dmis.fit.rule import Fit as Fit
    from dmis.fit.rule import Rule as Rule
    from dmis.formats.load_scene import SHIPPED as SHIPPED
    from dmis.formats.load_scene import load_scene as load_scene
    from dmis.geometry.mesh import Mesh as Mesh
    from dmis.geometry.mesh_files import load_mesh as load_mesh
    from dmis.geometry.subdivision import loop_subdivide as loop_subdivide
    from dmis.image import read_exr as read_exr
    from dmis.image import write_exr as write_exr
    from dmis.light.area import DiskLight as DiskLight
    from dmis.light.area import QuadLight as QuadLight
    from dmis.light.area import SphereLight as SphereLight
    from dmis.light.delta import DistantLight as DistantLight
    from dmis.light.delta import PointLight as PointLight
    from dmis.light.delta import SpotLight as SpotLight
    from dmis.light.environment import EnvironmentLight as EnvironmentLight
    from dmis.light.mesh_light import MeshLight as MeshLight
    from dmis.pipeline.executor import Processes as Processes
    from dmis.pipeline.render import render as render
    from dmis.pipeline.result import Result as Result
    from dmis.pipeline.result import find_fireflies as find_fireflies
    from dmis.pipeline.result import write_image as write_image
    from dmis.samplers.pixel_filter import PixelFilter as PixelFilter
    from dmis.samplers.streams import register_sampler as register_sampler
    from dmis.scene.camera import Camera as Camera
    from dmis.scene.groups import Part as Part
    from dmis.scene.scene import Scene as Scene


def __dir__() -> list[str]:
    return ["__version__", *__all__]


def _load_module(package: str, name: str) -> ModuleType:
    """Return the module `name` of `package`; an unknown one is a missing attribute."""
    full = f"{package}.{name}"
    try:
        if not name.startswith("_"):
            return import_module(full)
    except ModuleNotFoundError as error:
        if error.name != full:
            raise
    raise AttributeError(f"module {package!r} has no attribute {name!r}")


if not TYPE_CHECKING:  # a type checker would take any name for one that exists

    def __getattr__(name: str) -> Any:
        if name not in _HOMES:
            return _load_module("dmis", name)
        value = globals()[name] = getattr(import_module(f"dmis.{_HOMES[name]}"), name)
        return value

    for _room in _ROOMS:
        import_module(f"dmis.{_room}").__getattr__ = partial(_load_module, f"dmis.{_room}")
