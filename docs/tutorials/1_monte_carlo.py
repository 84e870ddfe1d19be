r"""
1. Monte Carlo: an image is an estimate
=======================================

After this tutorial you can

* write a Monte Carlo estimate of an integral, and say why it is unbiased;
* predict how its variance falls with the number of samples;
* estimate the variance from the samples, and say how noisy this estimate is;
* measure the error of an image against a reference, with an interval.

The light that a pixel receives is an integral, and few such integrals have a formula.
Monte Carlo integration estimates the integral: it averages the light from random
directions. The error of the estimate is the noise in an image.
"""

import os

import matplotlib.pyplot as plt
import numpy as np

import dmis
from dmis import plot
from dmis.experiment.metrics import ratio_over_blocks, squared_error
from dmis.variance.moments import Moments

QUICK = os.environ.get("DMIS_QUICK") == "1"  # small and fast, for tests
RESOLUTION = (80, 80) if QUICK else (320, 320)

# %%
# An integral as an average
# -------------------------
# How much light arrives at a desk below a round lamp? Let t be the angle of a direction
# from the vertical, and T the half angle of the cone that the lamp fills. The radiance
# is 1 inside this cone and 0 outside. So the desk receives
#
# .. math::
#
#    I = \int_{\mathrm{cone}} \cos t \,\mathrm{d}\omega
#      = 2 \pi \int_{\cos T}^{1} u \,\mathrm{d}u = \pi \sin^2 T
#
# with :math:`u = \cos t`. If directions are uniform over the hemisphere, their density
# is :math:`1 / 2 \pi` per solid angle, and u is uniform in [0, 1). The Monte Carlo
# estimate from n directions is the mean of the integrand divided by the density:
#
# .. math::
#
#    \hat I = \frac{1}{n} \sum_{i=1}^{n} X_i, \qquad
#    X_i = \frac{f(\omega_i)}{p(\omega_i)} = 2 \pi u_i\ \mbox{ where } u_i > \cos T,
#    \mbox{ else } 0
#
# Here we know the exact integral, so we can see the error of each estimate.
half_angle = np.radians(25)
exact = np.pi * np.sin(half_angle) ** 2
rng = np.random.default_rng(1)


def samples_of(n, times):
    """Return n samples of the integral for each of so many estimates."""
    u = rng.random((n, times))
    return 2 * np.pi * np.where(u > np.cos(half_angle), u, 0)


counts = 4 ** np.arange(1, 7)
estimates = {int(n): samples_of(n, 2000).mean(axis=0) for n in counts}
print(f"exact integral {exact:.4f}")
for n, values in estimates.items():
    print(f"{n:5d} directions: mean {values.mean():.4f}, variance {values.var():.6f}")

# %%
# On average the estimates are right, even with few directions. Such estimates are
# *unbiased*: :math:`\mathrm{E}[\hat I] = I`. But their *variance*, the mean of their
# squared distance from I, depends on n:
#
# .. math::
#
#    \mathrm{Var}[\hat I] = \frac{1}{n}
#    \left( \int \frac{f^2}{p} \,\mathrm{d}\omega - I^2 \right)
#
# With four times as many directions the variance falls to a quarter. So on logarithmic
# axes the variance falls along a line with the slope -1. Does the measurement agree?
variances = np.array([values.var() for values in estimates.values()])
fit, covariance = np.polyfit(np.log(counts), np.log(variances), 1, cov=True)
half = 2.78 * np.sqrt(covariance[0, 0])  # Student's t for 6 points less 2 parameters
print(f"slope of the variance {fit[0]:.3f} ± {half:.3f}")
figure, (left, right) = plt.subplots(1, 2, figsize=(11, 4), layout="constrained")
left.violinplot(list(estimates.values()), showextrema=False)
left.set_xticks(range(1, len(counts) + 1), labels=counts)
left.axhline(exact, color="black", linewidth=1, label="exact")
left.set_xlabel("directions n")
left.set_ylabel("2000 estimates of the integral")
left.legend()
right.loglog(counts, variances, "o", label="measured")
right.loglog(counts, samples_of(1, 100_000).var() / counts, label="variance of one / n")
right.set_xlabel("directions n")
right.set_ylabel("variance of an estimate")
right.legend()

# %%
# Variance, from the samples themselves
# -------------------------------------
# In practice I is unknown. But the samples themselves give an estimate of their
# variance:
#
# .. math::
#
#    s^2 = \frac{1}{n - 1} \sum_{i=1}^{n} (X_i - \hat I)^2, \qquad
#    \mathrm{E}[s^2] = \mathrm{Var}[X]
#
# The standard error of the mean is then :math:`s / \sqrt{n}`. If n is large, the
# interval :math:`\hat I \pm 1.96\, s / \sqrt{n}` contains I in about 95 % of all cases.
# The class `dmis.variance.moments.Moments` stores n, the mean and the sum of squared
# deviations. The class can also merge these moments of several sets of samples.
for n in (2, 16, 1024):
    values = Moments.of(samples_of(n, 20_000)).variance()
    print(f"{n:4d} samples: variance {values.mean():.3f}, spread {values.std():.3f}")

# %%
# Even from two samples the estimate of the variance is right on average. But the spread
# of this estimate is twice the variance. Tutorial 5 shows the consequences.
#
# Noise in an image
# -----------------
# The scene ``teapot-area-light`` is a pot under a round lamp. The rule ``uniform``
# samples uniform directions at each point, as above. Neighbouring pixels have different
# errors. We see these differences as noise.
#
# The formulas of this tutorial hold for independent samples, so the code uses the
# sampler ``independent``. The default sampler uses low-discrepancy points.
scene = dmis.load_scene("teapot-area-light", resolution=RESOLUTION)
images = {
    n: dmis.render(scene, "uniform", n, seed=1, sampler="independent")
    for n in (4, 16, 64)
}
figure, axes = plt.subplots(1, 3, figsize=(13, 4.4), layout="constrained")
for axis, (n, result) in zip(axes, images.items(), strict=True):
    plot.picture(axis, result.image, f"{n} samples per pixel")

# %%
# How large is the error?
# -----------------------
# A `dmis.Reference` contains two independent images :math:`r_1` and :math:`r_2` with
# many samples, so the noise of the reference cancels on average:
#
# .. math::
#
#    \mathrm{E}[(x - r_1)(x - r_2)] = \mathrm{E}[(x - r)^2]
#
# Here x is the rendered image and r the exact one. The mean of this product over the
# pixels is the *mean squared error* of x. The reference is saved on disk for the next
# run.
#
# The mean squared error of an unbiased image is its mean variance. So the measured
# error must agree with `Result.variance`, the renderer's estimate of this variance: the
# 95 % interval of their ratio should contain 1.
reference = dmis.make_reference(scene, 32)
for n, result in images.items():
    measured = squared_error(result.image, reference.first, reference.second)
    own = result.variance.mean(axis=-1)
    value, half = ratio_over_blocks(measured, own)
    print(
        f"{n:2d} samples: mean squared error {measured.mean():.4f}, own estimate "
        f"{own.mean():.4f}, ratio {value:.2f} ± {half:.2f}"
    )

# %%
# With four times the samples the error falls to a quarter, and the renderer's own
# estimate agrees. But the eye sees the square root of the variance, so halving the
# noise takes four times as many samples. The other tutorials lower the variance of each
# sample instead.
#
# Exercises
# ---------
# Starter files and solutions are on the page "Syllabus". Check your file with
# ``python docs/exercises/checks N FILE``.
#
# 4. *Easy.* Write a mean and its standard error (``04_standard_error.py``).
# 5. *Medium.* Derive a formula for the variance of one sample of the lamp's integral
#    (``05_lamp_variance.py``).
# 6. *Hard.* Merge the moments of two parts, without loss of digits (``06_merge.py``).
#
# To think about: make the lamp smaller. How fast does the ratio of the variance to the
# squared integral grow? Render with ``sampler="sobol"``: is the error lower, and does
# `Result.variance` agree?
for path in plot.show("1_monte_carlo"):
    print(path)
