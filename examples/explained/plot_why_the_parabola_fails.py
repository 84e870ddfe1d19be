"""
Why the parabola fails
======================

Three reasons, in one patch of each scene. (i) V(w) is no parabola: near an end where a technique fails it shoots up
like 1/w, so the parabola through V(0), V(1/2), V(1) has its minimum in the wrong place even if the three are known
exactly. If V(0) dwarfs the others, Eq. 3.5 says w = 3/4, whatever they are; if V(1) does, w = 1/4. (ii) With two
samples per pixel the three are not known: where a spike is rare, most pilots do not see it, and the technique that
fails looks best. (iii) Then w goes to an end of [0, 1], where a mistake costs most.
"""

import sys
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from common import SCENES, options
from curves import STRATEGIES, draw_curve, mse_curve, parabola, patch_at, pilot

from dmis import plot
from dmis.fit.thesis import parabola_minimum

opts, _ = options(__file__, __doc__)
SIZE = opts.pick(4, 16)
PILOTS = opts.pick(10, 200)
PLACES = {
    "teapot-area-light": ("penumbra", 0.66, 0.6),
    "killeroo-diffuse": ("shadow's edge", 0.93, 0.187),
    "killeroo-gold": ("golden head", 0.125, 0.327),
    "tt": ("windscreen", 0.46, 0.47),
}

# %%
# In each patch: the true curve, the parabola through three exact points of it, and many pilots.
found = {}
for name, (_, row, column) in PLACES.items():
    scene = opts.scene(name)
    patch = patch_at(scene, row, column, SIZE)
    curve = mse_curve(opts, scene, patch)
    exact = curve.mse[[0, list(curve.w).index(0.5), -1]]
    fitted = np.array([pilot(scene, patch, seed).w for seed in range(PILOTS)])
    found[name] = curve, exact, fitted

# %%
# What the fitted weights cost: the curve, read at each of them.
figure, axes = plot.canvas(2, 4, 18, 8)
dense = np.linspace(0, 1, 401)
summary = []
for (above, below), (name, (curve, exact, fitted)) in zip(axes.T, found.items(), strict=True):
    draw_curve(above, curve)
    above.plot(
        dense, parabola(exact, dense), color="tab:red", linestyle="--", label="parabola through V(0), V(½), V(1)"
    )
    vertex = float(parabola_minimum(STRATEGIES, exact)[0])
    above.axvline(vertex, color="tab:red", linewidth=1, label=f"its minimum: w = {vertex:.2f}")
    above.set_yscale("log")
    above.set_ylim(0.4 * curve.mse.min(), 2.5 * curve.mse.max())
    above.set_ylabel(f"mean squared error at {curve.spp} spp (linear RGB²)")
    above.set_title(f"{SCENES[name].title}: {PLACES[name][0]}", fontsize=10)
    above.legend(fontsize=7, loc="upper center")
    below.hist(fitted, np.linspace(0, 1, 41), color="tab:red", alpha=0.7, label=f"{PILOTS} pilots of 2 + 2 + 2 samples")
    below.axvline(vertex, color="tab:red", linewidth=1, label="exact parabola")
    below.axvline(curve.w[curve.best], color="black", linestyle=":", label="lowest measured error")
    below.set_xlabel("fitted share of light samples w")
    below.set_ylabel("number of pilots")
    below.legend(fontsize=7)
    cost = np.exp(np.interp(fitted, curve.w, np.log(curve.mse)))
    half = curve.mse[list(curve.w).index(0.5)]
    told = cost.mean() / half, np.median(cost) / half, curve.mse.min() / half
    summary.append(f"{name} {told[0]:.2f} ({told[1]:.2f}, {told[2]:.2f})")
    print(
        f"{name:18} MSE / that of w = 1/2: mean over pilots {told[0]:6.2f}, median {told[1]:.2f}, exact parabola "
        f"{np.exp(np.interp(vertex, curve.w, np.log(curve.mse))) / half:.2f}, best {told[2]:.2f}; "
        f"fitted at an end of [0, 1]: {np.mean((fitted == 0) | (fitted == 1)):.0%}"
    )
opts.save(
    figure,
    "Why the parabola fails",
    f"""Top: measured error of one patch of {SIZE}x{SIZE} pixels per scene against the share of light samples, and the
    parabola through three exact points of the curve. Bottom: the weights that {PILOTS} independent pilots lead to.
    Error over that of w = 1/2, mean over pilots (median; best weight): {"; ".join(summary)}.""",
)
