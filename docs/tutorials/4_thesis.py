r"""
4. The thesis: learning weights from a pilot
============================================

After this tutorial you can

* do the five steps of the thesis by hand: pilot, variance, fit, filter, final pass;
* compute the minimum of a parabola through three variances;
* test that a rule's image is unbiased;
* compare two rules at equal samples, with an interval over seeds.

How much light samples should count, compared with BRDF samples, differs from one part
of an image to the next. Seo's thesis (KAIST, 2014) spends 6 of the 128 samples of each
pixel on finding the best weight. This tutorial does the same step by step, with the
functions that the rule ``thesis`` uses.
"""

import os

import matplotlib.pyplot as plt
import numpy as np

import dmis
from dmis import plot
from dmis.base.color import luminance
from dmis.base.patches import patch_mean, patch_spread
from dmis.experiment.metrics import ratio
from dmis.experiment.runs import measure
from dmis.filter import gaussian
from dmis.fit.thesis import STATUS, parabola_minimum
from dmis.variance.moments import Moments

QUICK = os.environ.get("DMIS_QUICK") == "1"  # small and fast, for tests
SIDE, PATCH = (80, 4) if QUICK else (320, 8)

scene = dmis.load_scene("teapot-area-light", resolution=(SIDE, SIDE))

# %%
# Two readings of w
# -----------------
# The thesis gives each part of the image a weight w, but leaves open what w weighs. Two
# readings are possible. The figure shows four camera samples with two shading samples
# each. A dot is a shading sample, and the area of the dot is the weight. On the left, w
# divides the *samples*: w = 3/4 means six light samples and two BRDF samples. On the
# right, w tilts the *heuristic*: there are always four of each kind, and w decides
# which kind counts more. This tutorial follows the second reading, because its results
# are nearer to the thesis's numbers.
figure, axes = plt.subplots(1, 2, figsize=(11, 2.2), layout="constrained")
readings = {
    "w divides the samples": (np.arange(8) < 6, np.ones(8)),
    "w tilts the heuristic": (np.arange(8) % 2 == 0, np.tile([1.5, 0.5], 4)),
}
for axis, (title, (is_light, area)) in zip(axes, readings.items(), strict=True):
    place = np.arange(8) + 0.25 * (np.arange(8) // 2)  # two of each camera sample
    colours = np.where(is_light, "tab:blue", "tab:red")
    axis.scatter(place, np.zeros(8), s=500 * area, c=colours)
    axis.set_title(f"{title}: w = 3/4 (blue: light, red: BRDF samples)", fontsize=10)
    axis.set(xlim=(-0.8, 8.6), ylim=(-1, 1))
    axis.axis("off")

# %%
# Step 1, the pilot
# -----------------
# A camera sample takes one light and one BRDF sample. The heuristic weights them by the
# densities of the two techniques:
#
# .. math::
#
#    W_l = \frac{w\, p_l}{w\, p_l + (1 - w)\, p_b}, \qquad W_b = 1 - W_l
#
# The pilot renders two camera samples per pixel at each of three weights: w = 0 (BRDF
# sampling), w = 1/2 (the balance heuristic) and w = 1 (light sampling). The rule
# ``fixed`` renders with one weight for all pixels. Its option ``weigh=heuristic``
# selects the second reading.
#
# Here we render each sample as a separate image, so the array of samples is
# ``(2, height, width, 3)``. As in the thesis, the sample points are independent.
weights = np.array([0, 0.5, 1])
pilots = [
    np.stack(
        [
            dmis.render(
                scene,
                f"fixed:{w},weigh=heuristic",
                1,
                seed=2 * k + s,
                sampler="independent",
            ).image
            for s in range(2)
        ]
    )
    for k, w in enumerate(weights)
]
titles = "BRDF sampling", "balance heuristic", "light sampling"
figure, axes = plt.subplots(1, 3, figsize=(13, 4.4), layout="constrained")
for axis, samples, title in zip(axes, pilots, titles, strict=True):
    plot.picture(axis, samples.mean(axis=0), f"{title}, 2 samples")

# %%
# Step 2, the variance
# --------------------
# A renderer has no reference image to measure its error. But the estimates are
# unbiased, so their mean squared error equals their variance. We estimate the variance
# from n = 2 samples, the fewest possible:
#
# .. math::
#
#    y = \frac{1}{n - 1} \sum_{i=1}^{n} (x_i - \bar x)^2
#
# `Moments` stores the mean and the sum of squared deviations for each pixel and
# channel. Luminance combines the three channels. The mean over a patch of 8 by 8 pixels
# reduces the noise of the variances.
moments = [Moments.of(samples) for samples in pilots]
variances = np.stack([patch_mean(luminance(m.variance()), PATCH) for m in moments])
print("variances by weight and patch:", variances.shape)

# %%
# Step 3, the fit
# ---------------
# One parabola :math:`a_2 w^2 + a_1 w + a_0` passes through the three points (thesis,
# Eqs. 3.2 to 3.4). Let :math:`y_0, y_h, y_1` be the variances at w = 0, 1/2 and 1. The
# minimum of the parabola (Eq. 3.5) is at
#
# .. math::
#
#    w = -\frac{a_1}{2 a_2}
#      = \frac{3 y_0 - 4 y_h + y_1}{4 (y_0 + y_1 - 2 y_h)}
#
# `parabola_minimum` computes w for all patches at once. Its second result marks the
# patches where the minimum is outside [0, 1], or where the parabola has no minimum.
raw, status = parabola_minimum(weights, variances)
row, column = raw.shape[0] * 13 // 20, raw.shape[1] * 15 // 20
w = np.linspace(0, 1, 101)
points = variances[:, row, column]
figure, axis = plt.subplots(figsize=(7, 4.4), layout="constrained")
axis.plot(weights, points, "o", color="black", label="three variances of the pilot")
parabola = np.polyval(np.polyfit(weights, points, 2), w)
axis.plot(w, parabola, color="tab:red", label="parabola")
least = raw[row, column]
label = f"minimum, w = {least:.2f}"
axis.axvline(least, color="tab:red", linestyle=":", label=label)
axis.set_xlabel("weight w")
axis.set_ylabel(f"variance of a sample in patch {row}, {column}")
axis.legend()
for code, meaning in STATUS.items():
    print(f"{meaning:10}: {(status == code).mean():4.0%} of the patches")

# %%
# Step 4, the filter
# ------------------
# The weights of neighbouring patches differ strongly, because each weight comes from
# few samples. A Gaussian over 5 by 5 patches smooths the weights (thesis, Sec. 3.4). In
# blue patches light samples count more, in red patches BRDF samples.
filtered = gaussian(raw)
figure, axes = plt.subplots(1, 2, figsize=(11, 4.8), layout="constrained")
window = 0, 0, SIDE, SIDE
plot.weights(axes[0], raw, "minima of the parabolas", window)
shown = plot.weights(axes[1], filtered, "after the filter", window)
plot.weight_bar(figure, shown, axes, "weight w of the heuristic")

# %%
# Step 5, the final pass
# ----------------------
# Each pixel takes the weight of its patch, and the rest of the budget is rendered with
# these weights. The rule `Given` renders with a given map instead of a pilot.
weight = patch_spread(filtered, PATCH, (SIDE, SIDE))
given = dmis.Given(weight=weight, weigh="heuristic")
final = dmis.render(scene, given, 32 - 6, seed=6, sampler="independent")
print(f"weight of light samples on average: {final.weight.mean():.2f}")

# %%
# The rule ``thesis`` does these steps. From the same pilot it computes the same map,
# bit for bit. With another pilot, the image of the rule differs only by noise. To test
# this, the code divides the difference of the two means by its standard error. This
# quotient, z, is between -3 and 3 in 99.7 % of such tests.
rule = f"thesis:patch={PATCH}"
pilot = dict(zip(weights.tolist(), moments, strict=True))
fit = dmis.make_rule(rule).fit(pilot)
print("same weights as the rule's:", np.array_equal(fit.weight, weight))
result = dmis.render(scene, rule, 32, seed=7, sampler="independent")
error = np.sqrt((final.variance + result.variance)[..., 1].sum())
difference = (final.image - result.image)[..., 1].sum()
print(f"z of the mean of the image: {difference / error:.2f}")

# %%
# Was it worth it?
# ----------------
# A fair comparison gives all rules the same budget, pilot included, and repeats each
# render with several seeds. `measure` does this and renders rules alternately.
#
# Much of this image's error is in a few pixels at the visible edge of the lamp, where
# no choice of directions can help. This error differs so much between seeds that it
# hides the rest. So we leave the lamp out: a `crop` is a part of the image, here the
# rows below the lamp.
#
# Let :math:`a_k` and :math:`b_k` be the errors of two rules with seed k. The ratio of
# their means over K seeds is :math:`\bar a / \bar b`. By the delta method its standard
# error is
#
# .. math::
#
#    \frac{1}{\bar b} \sqrt{ \frac{1}{K (K - 1)} \sum_{k=1}^{K}
#    \left( a_k - \frac{\bar a}{\bar b}\, b_k \right)^2 }
#
# The function `ratio` computes a 95 % interval of the ratio, with Student's t.
below = scene.crop((0, SIDE * 2 // 5, SIDE, SIDE))
reference = dmis.make_reference(below, 64)
shares = f"thesis:weigh=samples,patch={PATCH}"
budgets = [("balance", 32), (rule, 32), (shares, 32)]
runs = measure(below, budgets, range(5), reference, sampler="independent")
mse = [np.array([run.mse for run in runs[budget]]) for budget in budgets]
seconds = [np.array([run.cpu_seconds for run in runs[budget]]) for budget in budgets]
print(f"mean squared error of balance {mse[0].mean():.2e}")
for k in (1, 2):
    value, half = ratio(mse[k], mse[0])
    print(f"{budgets[k][0]}: ratio at equal samples {value:.2f} ± {half:.2f}")
    value, half = ratio(mse[k] * seconds[k], mse[0] * seconds[0])
    print(f"    in equal CPU time {value:.2f} ± {half:.2f}")

# %%
# With ``weigh=samples`` the whole interval at equal samples is below 1. In images of
# full size the error is a quarter smaller than that of ``balance``, although the pilot
# took six of the 32 samples. But light samples need shadow rays, and pilot and fit take
# time. The second ratio includes these costs.
#
# If w tilts the heuristic, the gain is smaller, because every camera sample takes a
# BRDF sample, whatever w is. With 32 samples the gain hardly makes up for the six pilot
# samples. With the thesis's 128 samples the gain is larger than the cost of the pilot
# on this scene. The page "The thesis" compares both readings.
#
# On other scenes the rule loses, even at equal samples. The next tutorial explains why,
# and what helps.
#
# Exercises
# ---------
# Starter files and solutions are on the page "Syllabus". Check your file with
# ``python docs/exercises/checks N FILE``.
#
# 13. *Easy.* Write the minimum of the parabola, with all special cases
#     (``13_parabola.py``).
# 14. *Medium.* Turn shares into whole numbers of samples (``14_whole_samples.py``).
# 15. *Hard.* Keep the pilot's samples in the image, without bias
#     (``15_keep_the_pilot.py``).
#
# To play: ``python -m dmis play veach-mis -o play.html`` writes a page where you paint
# w yourself, and compare your map with the map of this rule and the best map. Where
# does the rule lose?
#
# To think about: try ``thesis:patch=1`` and ``thesis:patch=40``. What is wrong with
# each patch size? Omit the filter with ``thesis:filter=none``. Does the error agree
# with your impression of the weight maps?
for path in plot.show("4_thesis"):
    print(path)
