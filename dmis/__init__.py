"""Data-driven multiple importance sampling for Monte Carlo rendering, in NumPy on Embree."""

__version__ = "0.1.0"

from dmis.camera import Camera
from dmis.estimator import Settings
from dmis.fit import Fit, Rule, make_rule
from dmis.geometry import Mesh, load_mesh, loop_subdivide
from dmis.image import read_exr, write_exr, write_image
from dmis.light import (
    DiskLight,
    DistantLight,
    EnvironmentLight,
    MeshLight,
    PointLight,
    QuadLight,
    SphereLight,
    SpotLight,
)
from dmis.material import Material, glass, matte, metal, mirror, plastic, shiny_metal, substrate, uber
from dmis.metrics import mse, relmse
from dmis.render import Result, render
from dmis.scene import Part, Scene
from dmis.texture import Image
