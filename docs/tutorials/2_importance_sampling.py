r"""
2. Importance sampling: look where the light is
===============================================

After this tutorial you can

* pick directions with a density, and divide by it;
* say which density has the least variance, and why no renderer knows this density;
* use light sampling and BRDF sampling, and predict where each of them fails;
* compare two techniques in parts of an image, with intervals.

Uniform directions mostly miss the light. Importance sampling picks directions with a
density similar to the integrand. In a renderer the integrand is a product, light times
reflection. Good densities are known for each factor alone.
"""

import os

import matplotlib.pyplot as plt
import numpy as np

import dmis
from dmis import plot
from dmis.base.color import luminance
from dmis.base.patches import patch_mean
from dmis.experiment.metrics import ratio_over_blocks, squared_error
from dmis.samplers.warp import (
    INV_PI,
    cone_pdf,
    square_to_cone,
    square_to_cosine,
    square_to_hemisphere,
)

QUICK = os.environ.get("DMIS_QUICK") == "1"  # small and fast, for tests
RESOLUTION = (120, 90) if QUICK else (480, 360)

# %%
# Three densities for one integral
# --------------------------------
# Take any density p that is positive wherever the integrand f is. Then
#
# .. math::
#
#    \hat I = \frac{1}{n} \sum_{i=1}^{n} \frac{f(\omega_i)}{p(\omega_i)}, \qquad
#    \mathrm{Var}[\hat I] = \frac{1}{n}
#    \left( \int \frac{f^2}{p} \,\mathrm{d}\omega - I^2 \right)
#
# The estimate is unbiased with each such density. Only its variance differs.
#
# Take the desk lamp of tutorial 1 again: f is :math:`\cos t` inside the lamp's cone of
# half angle T, and 0 outside. Here are three densities per solid angle:
#
# * *uniform*, over the hemisphere: :math:`1 / 2 \pi`;
# * *BRDF*, in proportion to the cosine: :math:`\cos t / \pi`;
# * *light*, uniform in the lamp's cone: :math:`1 / (2 \pi (1 - \cos T))`.
#
# The functions of ``dmis.samplers.warp`` map pairs of uniform numbers to directions
# ``(3, N)``, where z is up. The module also contains the densities.
half_angle = np.radians(25)
exact = np.pi * np.sin(half_angle) ** 2
u = np.random.default_rng(1).random((2, 100_000), dtype=np.float32)
one_minus_cos = np.float32(1 - np.cos(half_angle))

uniform, cosine = square_to_hemisphere(u)[2], square_to_cosine(u)[2]
cone = square_to_cone(u, one_minus_cos)[2]
ways = {
    "uniform": (uniform, INV_PI / 2),
    "BRDF": (cosine, cosine * INV_PI),
    "light": (cone, cone_pdf(one_minus_cos)),
}
print(f"exact {exact:.4f}")
for name, (z, density) in ways.items():
    f = np.where(z > np.cos(half_angle), z, 0)
    x = f / density
    half = 1.96 * x.std() / np.sqrt(x.size)
    print(
        f"{name:5}: {x.mean():.4f} ± {half:.4f}, variance of one sample {x.var():.4f}"
    )

# %%
# All three intervals contain the exact value, but the intervals have different widths.
# With the BRDF's density, f / p is :math:`\pi` or 0. With the light's density, f / p is
# nearly constant, so the interval is the narrowest.
#
# With a density in exact proportion to f, the variance is 0: f / p is the same for all
# directions. But this density is :math:`p = f / I`, which contains the unknown
# integral.
#
# Two techniques in the renderer
# ------------------------------
# The rule ``fixed:1`` spends all shading samples on **light sampling**. The rule
# ``fixed:0`` spends all of them on **BRDF sampling**. The number after the colon is w,
# the share of light samples.
#
# The scene ``veach-mis`` is a classic of Veach and Guibas (1995). Four metal plates
# reflect four lamps. The plates are smooth at the back and rough in front. The lamps
# are small at the left and large at the right; all lamps emit the same power.
scene = dmis.load_scene("veach-mis", resolution=RESOLUTION)
brdf = dmis.render(scene, "fixed:0", 16, seed=1, sampler="independent")
light = dmis.render(scene, "fixed:1", 16, seed=1, sampler="independent")
figure, axes = plt.subplots(1, 2, figsize=(13, 5.3), layout="constrained")
plot.picture(axes[0], brdf.image, "BRDF sampling, w = 0")
plot.picture(axes[1], light.image, "light sampling, w = 1")

# %%
# BRDF sampling is good for large lamps in smooth plates: all sampled directions hit the
# lamp. Few directions hit a small lamp, so its reflection is a set of bright specks.
#
# Light sampling is good for small lamps, for rough plates and for walls. But a smooth
# plate reflects only a few points of a large lamp to the viewer. Light sampling seldom
# picks these points, and then :math:`f / p_l` is very large.
#
# Which technique is better where?
# --------------------------------
# Each pixel has an estimate of its variance. This estimate is noisy, so we take the
# mean over patches of 8 by 8 pixels.
patch = 4 if QUICK else 8
variance = [patch_mean(luminance(result.variance), patch) for result in (brdf, light)]
logarithm = np.log10((variance[0] + 1e-9) / (variance[1] + 1e-9))
window = (0, 0, *RESOLUTION)
figure, axis = plt.subplots(figsize=(8, 5.2), layout="constrained")
title = "red: BRDF sampling has less variance"
shown = plot.heat(axis, logarithm, title, window, cmap="RdBu", vmin=-3, vmax=3)
figure.colorbar(shown, ax=axis, label="log₁₀ of variance, BRDF / light")

# %%
# Neither technique wins everywhere. BRDF sampling wins where smooth plates reflect
# large lamps (red); light sampling wins on rough plates and with small lamps (blue).
#
# The dark red patches at the left and around the reflections mislead. There BRDF
# sampling found no light at all. All its samples are zero, so its estimated variance is
# 0. Tutorial 5 is about this trap.
#
# Errors measured with a reference avoid the trap. For the reflection of each lamp in
# each plate, here is the mean squared error of BRDF sampling divided by that of light
# sampling, with its 95 % interval.
reference = dmis.make_reference(scene, 16)
errors = [
    squared_error(result.image, reference.first, reference.second)
    for result in (brdf, light)
]
scale = RESOLUTION[0] / 480
rows = {2000: (122, 158), 500: (170, 206), 125: (222, 262), 33: (282, 332)}
columns = {0.17: (150, 222), 0.45: (256, 334), 1.0: (350, 460)}
print("error of BRDF sampling over that of light sampling")
lamps = "".join(f"{f'lamp of radius {radius:g}':22}" for radius in columns)
print(f"Blinn's exponent  {lamps.rstrip()}")
for exponent, y in rows.items():
    cells = []
    for x in columns.values():
        place = tuple(slice(int(a * scale), int(b * scale)) for a, b in (y, x))
        value, half = ratio_over_blocks(*(error[place] for error in errors))
        cells.append(f"{value:.2g} ± {half:.1g}")
    print(f"{exponent:<18}" + "".join(f"{cell:22}" for cell in cells).rstrip())

# %%
# The ratios in one image span several powers of ten. A renderer with only one technique
# would be very noisy somewhere in the image. Tutorial 3 combines both.
#
# Exercises
# ---------
# Starter files and solutions are on the page "Syllabus". Check your file with
# ``python docs/exercises/checks N FILE``.
#
# 7. *Easy.* Write the zero-variance density of the desk lamp, and its sampling
#    (``07_no_variance.py``).
# 8. *Medium.* Write the density of directions reflected about half vectors
#    (``08_half_vector.py``).
# 9. *Hard.* Sample a sky: points of a table in proportion to its values
#    (``09_sky.py``).
#
# To think about: make the BRDF's density 0 for half of the directions, and drop these
# samples. What is the mean now? Where may a density be zero?
for path in plot.show("2_importance_sampling"):
    print(path)
