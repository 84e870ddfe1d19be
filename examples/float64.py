"""
Run a script, or a module, with the whole renderer in float64: ``python examples/float64.py -m dmis render ...``

A debug switch, for telling rounding from everything else. The modules of dmis are imported with a numpy in which
``float32`` means float64. What stays as it is: the uniform numbers, so that both renderers draw the same samples and
their images differ by rounding alone; files; and Embree, which knows float32 only, so that triangle number and
barycentrics of a hit have the accuracy that they always have, and so has the answer whether something is in between.
"""

import importlib
import pkgutil
import runpy
import sys
import types
from pathlib import Path

import embreex.mesh_construction  # what dmis needs must be there before, with numpy as it is
import embreex.rtcore_scene  # noqa: F401
import numpy as np
import scipy.ndimage
import scipy.stats  # noqa: F401
import trimesh  # noqa: F401

SINGLE = ("dmis.intersect", "dmis.samplers.streams", "dmis.samplers.sobol", "dmis.image")
"""Modules that go on to mean float32."""


def wide() -> None:
    """Import all of dmis in float64. ImportError if it has been imported before."""
    if "dmis" in sys.modules:
        raise ImportError("dmis has been imported in float32 already")
    double = types.ModuleType("numpy")
    double.__dict__.update(np.__dict__, float32=np.float64)
    sys.modules["numpy"] = double
    try:
        package = importlib.import_module("dmis")
        names = [m.name for m in pkgutil.walk_packages(package.__path__, "dmis.") if m.name != "dmis.__main__"]
        modules = {name: importlib.import_module(name) for name in names}
    finally:
        sys.modules["numpy"] = np
    for name in SINGLE:
        modules[name].np = np
    for name, sampler in (("streams", "Independent"), ("stratified", "Stratified"), ("sobol", "Sobol")):
        sampler = getattr(modules[f"dmis.samplers.{name}"], sampler)
        sampler.draw = _widened(sampler.draw)


def _widened(draw):
    return lambda *arguments: draw(*arguments).astype(np.float64)


if __name__ == "__main__":
    if len(sys.argv) < 2 or sys.argv[1:] == ["-m"]:
        sys.exit("give a script, or -m and a module, with its arguments")
    wide()
    del sys.argv[0]
    if sys.argv[0] == "-m":
        del sys.argv[0]
        runpy.run_module(sys.argv[0], run_name="__main__", alter_sys=True)
    else:
        sys.path[0] = str(Path(sys.argv[0]).resolve().parent)
        runpy.run_path(sys.argv[0], run_name="__main__")
