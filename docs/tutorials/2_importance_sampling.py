"""
2. Importance sampling: look where the light is
===============================================

Even random directions mostly see nothing. If we pick directions with a density p, the average of f / p is still
right, and its variance is small where p is like f. In a renderer f is a product, light times reflection, and we know
good densities for each factor alone: aim at the lamp, or follow the reflection. This tutorial tries both, and shows
where each fails.
"""

import matplotlib.pyplot as plt
import numpy as np
from plates import LAMPS, ROUGHNESS, plates

import dmis
from dmis import plot
from dmis.experiment.metrics import squared_error
from dmis.samplers.warp import INV_PI, cone_pdf, square_to_cone, square_to_hemisphere

# %%
# Three densities for one integral
# --------------------------------
# The desk lamp of the first tutorial again: f is cos t inside of the lamp's cone, 0 outside. Directions come in three
# ways: evenly over the hemisphere, density 1 / (2 pi); in proportion to cos t, which is how a matte surface reflects,
# density cos t / pi; and evenly in the lamp's cone. ``dmis.samplers.warp`` has the maps from pairs of even random
# numbers to directions ``(3, N)``, z up, and their densities per solid angle.
half_angle = np.radians(25)
exact = np.pi * np.sin(half_angle) ** 2
u = np.random.default_rng(1).random((2, 100_000), dtype=np.float32)
one_minus_cos = np.float32(1 - np.cos(half_angle))

ways = {
    "even": (square_to_hemisphere(u)[2], lambda z: np.full_like(z, INV_PI / 2)),
    "BRDF": (np.sqrt(u[0]), lambda z: z * INV_PI),  # cos t of directions in proportion to cos t
    "light": (square_to_cone(u, one_minus_cos)[2], lambda z: np.full_like(z, cone_pdf(one_minus_cos))),
}
for name, (z, density) in ways.items():
    f = np.where(z > np.cos(half_angle), z, 0)
    estimates = f / density(z)
    print(f"{name:5}: mean {estimates.mean():.4f} (exact {exact:.4f}), variance of one sample {estimates.var():.4f}")

# %%
# All three are unbiased. What differs is the variance: for the BRDF's density f / p is pi or 0, for the light's it is
# nearly constant. A density in exact proportion to f would have no variance at all; but to know it, one would have to
# know the integral.
#
# Two techniques in the renderer
# ------------------------------
# The rule ``fixed:1`` spends all shading samples on **light sampling**, ``fixed:0`` all on **BRDF sampling**. (The
# number is w, the share of light samples. It is what everything turns on from here.) Samples are independent, as
# before.
scene = plates()
brdf = dmis.render(scene, "fixed:0", 16, seed=1, sampler="independent")
light = dmis.render(scene, "fixed:1", 16, seed=1, sampler="independent")
figure, axes = plt.subplots(1, 2, figsize=(11, 4.3), layout="constrained")
plot.picture(axes[0], brdf.image, "BRDF sampling, w = 0")
plot.picture(axes[1], light.image, "light sampling, w = 1")

# %%
# Follow one lamp down the plates, or one plate across the lamps. BRDF sampling finds large lamps in smooth plates,
# where all reflected directions meet the lamp; of small lamps it sees sparks. Light sampling is fine for small lamps,
# and for rough plates and walls; but of all points on a large lamp, few are where a smooth plate reflects, and those
# few count very much.
#
# Who is better where?
# --------------------
# Each pixel's own estimate of its variance is noisy; over a patch of 6×6 pixels it says enough.
patch = 6
variance = [dmis.base.patches.patch_mean(dmis.base.color.luminance(r.variance), patch) for r in (brdf, light)]
figure, axis = plt.subplots(figsize=(7, 4.3), layout="constrained")
window = (0, scene.camera.resolution[1]), (0, scene.camera.resolution[0])
ratio = np.log10((variance[0] + 1e-9) / (variance[1] + 1e-9))
shown = plot.heat(axis, ratio, "red: BRDF sampling has less variance", window, cmap="RdBu", vmin=-3, vmax=3)
figure.colorbar(shown, ax=axis, label="log₁₀ of variance, BRDF / light")

# %%
# Neither wins everywhere: smooth and large is red, rough or small is blue. (Do not believe the dark red patches at
# the lower left: there BRDF sampling found no light at all, and nothing but zeros has no variance. This trap is the
# subject of the fifth tutorial.) Errors against the reference are not fooled. Where each plate mirrors each lamp:
reference = dmis.make_reference(scene, 64)
errors = {name: squared_error(r.image, reference.first, reference.second) for name, r in (("0", brdf), ("1", light))}
rows = ((35, 42), (44, 50), (53, 59), (64, 72))
columns = ((8, 28), (29, 46), (48, 67), (70, 90))
print("squared error of BRDF over that of light sampling: rows are plates, columns are lamps by radius")
print("roughness " + "".join(f"{radius:>10}" for radius in LAMPS))
for roughness, y in zip(ROUGHNESS, rows, strict=True):
    cells = [errors["0"][slice(*y), slice(*x)].mean() / errors["1"][slice(*y), slice(*x)].mean() for x in columns]
    print(f"{roughness:<10}" + "".join(f"{cell:>10.3g}" for cell in cells))

# %%
# A renderer that had to choose one technique for the whole image would be bad somewhere in any case. The next
# tutorial takes both.
#
# Exercises
# ---------
# * Which density has no variance for the desk lamp? Write its map from a random number to cos t, and check.
# * Make the BRDF's density 0 for half of the directions, ``lambda z: np.where(u[0] < 0.5, 0, ...)``, and do not
#   divide by zero: leave such samples out. What is the mean now? When is a density allowed to be zero?
# * In ``plates.py`` make all lamps equally large. Where is the border between red and blue now?
for path in plot.show("2_importance_sampling"):
    print(path)
