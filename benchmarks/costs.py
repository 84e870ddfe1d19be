"""
What a shading sample costs
===========================

Rules that weigh variance against cost go by counted rays times the constants of `dmis.estimator.cost`. Here they are
measured: CPU time of renders at several weights and numbers of shading samples on the scenes that come with dmis but
the held-out ones, in turns, and the constants that explain it best, each scene's camera sample being one. Takes ten
minutes or so, and wants an idle machine.
"""

import argparse
import itertools
import statistics
import time

import numpy as np
from scipy.optimize import least_squares

import dmis
from dmis.estimator import cost

parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
parser.add_argument(
    "scenes",
    nargs="*",
    default=[name for name in dmis.SHIPPED if name not in dmis.HELD_OUT],
    help="names or files; default: all that are shipped and not held out",
)
parser.add_argument("--weights", default="0.1,0.3,0.499,0.7,0.9", help="shares of light samples")
parser.add_argument("--shading-samples", default="2,4,8", help="of a camera sample")
parser.add_argument("--repeats", type=int, default=5, help="renders of each kind (default 5)")
parser.add_argument("--spp", type=int, default=32, help="camera samples per pixel (default 32)")
given = parser.parse_args()

weights = [float(w) for w in given.weights.split(",")]
numbers = [int(n) for n in given.shading_samples.split(",")]
scenes = [dmis.load_scene(name, resolution=(228, 171)) for name in given.scenes]
cases = list(itertools.product(range(len(scenes)), weights, numbers))
seconds: dict[tuple[int, float, int], list[float]] = {case: [] for case in cases}
rays = {}
for scene in scenes:
    dmis.render(scene, "balance", 1, parallel=1)  # tables are built, the first time
for seed in range(given.repeats):
    for case in cases:
        k, w, n = case
        settings = dmis.Settings(shading_samples=n)
        begin = time.process_time()
        result = dmis.render(scenes[k], f"fixed:{w:g}", given.spp, seed=seed, settings=settings, parallel=1)
        seconds[case].append(time.process_time() - begin)
        rays[case] = result.rays

# %%
# A camera sample, its shading samples before their rays (those of lights with a single direction among them), and
# occlusion rays, per camera sample.
scene_of = np.array([k for k, _, _ in cases])
shaded = np.array([(n + rays[case].get("delta", 0) / rays[case]["camera"]) for case in cases for n in case[2:]])
traced = np.array([sum(n for kind, n in rays[c].items() if kind != "camera") / rays[c]["camera"] for c in cases])
measured = np.array([statistics.median(seconds[case]) / rays[case]["camera"] for case in cases])


def off(constants: np.ndarray) -> np.ndarray:
    """Logarithms of measured over explained time, each scene's mean taken out."""
    shading, ray = constants
    error = np.log(measured / (cost.CAMERA + shading * shaded + ray * traced))
    return error - np.array([error[scene_of == k].mean() for k in scene_of])


found = least_squares(off, [cost.SHADING, cost.RAY]).x
in_use = off(np.array([cost.SHADING, cost.RAY]))
best = off(found)
print(f"best SHADING {found[0]:.3f} RAY {found[1]:.3f}, in use {cost.SHADING} and {cost.RAY}\n")
print(
    "| scene | w | shading samples | rays | µs per camera sample | off, in use | off, best |",
    "|---" * 7 + "|",
    sep="\n",
)
for case, y, t, a, b in zip(cases, traced, measured, in_use, best, strict=True):
    print(f"| {scenes[case[0]].name} | {case[1]:g} | {case[2]} | {y:.2f} | {1e6 * t:.2f} | {a:+.1%} | {b:+.1%} |")
