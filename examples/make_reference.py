"""
The demo's reference
====================

Renders ``data/teapot-area-light-400x400.exr``, which `demo.py` measures errors against: two independent halves of
many samples each, because ``mean[(x - r1)(x - r2)]`` is then free of the reference's own noise. Takes some minutes;
the result is kept with the project.
"""

import argparse
from pathlib import Path

import numpy as np

import dmis

HERE = Path(__file__).parent

parser = argparse.ArgumentParser(description="render the reference of demo.py")
parser.add_argument("--spp", type=int, default=2048, help="camera samples of each half")
parser.add_argument("-o", "--output", default=HERE / "data" / "teapot-area-light-400x400.exr")
options = parser.parse_args()

# %%
# Two independent halves; what the average of both is still wrong by is a quarter of their mean squared difference.
scene = dmis.load_scene("teapot-area-light", resolution=(400, 400))
reference = dmis.make_reference(scene, options.spp)

# %%
# Half floats are fine enough: their rounding is independent in the two halves, and far below the error of the demo.
layers = {"first": reference.first.astype(np.float16), "second": reference.second.astype(np.float16)}
dmis.write_exr(options.output, layers, {"spp": f"2 x {options.spp}", "mse": f"{reference.mse:.3g}"})
print(options.output, reference.text(), sep="\n")
