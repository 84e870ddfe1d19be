"""Data-driven multiple importance sampling for Monte Carlo rendering, in NumPy on Embree."""

__version__ = "0.1.0"

from dmis.camera import Camera as Camera
from dmis.fit import Fit as Fit
from dmis.fit import Rule as Rule
from dmis.fit import make_rule as make_rule
from dmis.geometry import Mesh as Mesh
from dmis.geometry import load_mesh as load_mesh
from dmis.geometry import loop_subdivide as loop_subdivide
from dmis.image import read_exr as read_exr
from dmis.image import write_exr as write_exr
from dmis.image import write_image as write_image
from dmis.light import DiskLight as DiskLight
from dmis.light import DistantLight as DistantLight
from dmis.light import EnvironmentLight as EnvironmentLight
from dmis.light import MeshLight as MeshLight
from dmis.light import PointLight as PointLight
from dmis.light import QuadLight as QuadLight
from dmis.light import SphereLight as SphereLight
from dmis.light import SpotLight as SpotLight
from dmis.load import SHIPPED as SHIPPED
from dmis.load import load_scene as load_scene
from dmis.material import Material as Material
from dmis.material import glass as glass
from dmis.material import matte as matte
from dmis.material import metal as metal
from dmis.material import mirror as mirror
from dmis.material import plastic as plastic
from dmis.material import shiny_metal as shiny_metal
from dmis.material import substrate as substrate
from dmis.material import uber as uber
from dmis.metrics import mse as mse
from dmis.metrics import relmse as relmse
from dmis.reference import Reference as Reference
from dmis.reference import make_reference as make_reference
from dmis.render import Result as Result
from dmis.render import render as render
from dmis.scene import Part as Part
from dmis.scene import Scene as Scene
from dmis.settings import Settings as Settings
from dmis.texture import Image as Image
