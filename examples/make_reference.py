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
# Sobol samples converge faster than independent ones, and are as unbiased. The seeds are far from those of the demo.
scene = dmis.load_scene("teapot-area-light", resolution=(400, 400))
halves = [dmis.render(scene, "balance", options.spp, seed=seed, sampler="sobol").image for seed in (1001, 1002)]

# %%
# Half the mean squared difference of the halves is the error of one; their average has half of that.
error = float(((halves[0] - halves[1]).astype(float) ** 2).mean() / 4)
layers = {"first": halves[0].astype(np.float16), "second": halves[1].astype(np.float16)}
attributes = {"spp": f"2 x {options.spp}", "mse": f"{error:.3g}"}
dmis.write_exr(options.output, layers, attributes)
print(f"{options.output}: 2 x {options.spp} spp, mean squared error of the average {error:.3g}")
