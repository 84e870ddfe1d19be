"""
1. Monte Carlo: an image is a guess
===================================

The light that a pixel receives is an integral, and nobody can solve it with pencil and paper. Monte Carlo integration
guesses it: look in random directions, and average what you see. This tutorial is about how far such a guess is off,
why that is the same as noise in an image, and what it costs to have less of it.
"""

import matplotlib.pyplot as plt
import numpy as np
from plates import plates

import dmis
from dmis import plot
from dmis.experiment.metrics import mean_and_error, squared_error
from dmis.variance.moments import Moments

# %%
# An integral as an average
# -------------------------
# How much light arrives at a desk below a round lamp? A direction at the angle t from upright brings L cos t, and L
# is 1 inside the lamp's cone, 0 outside. If directions are picked evenly over the hemisphere, cos t is an even random
# number between 0 and 1, so the integral over all directions is 2 pi times the average of f(u) = u where u > cos T,
# else 0, with T the lamp's half angle. We know the answer, pi sin² T, so that we can see how wrong each guess is.
half_angle = np.radians(25)
exact = np.pi * np.sin(half_angle) ** 2
rng = np.random.default_rng(1)


def guesses(n, times):
    """Estimates of the integral from n random directions each."""
    u = rng.random((n, times))
    return (2 * np.pi * np.where(u > np.cos(half_angle), u, 0)).mean(axis=0)


counts = 4 ** np.arange(1, 7)
spread = {int(n): guesses(n, 2000) for n in counts}
for n, found in spread.items():
    print(f"{n:5d} directions: mean of 2000 guesses {found.mean():.4f} (exact {exact:.4f}), variance {found.var():.6f}")

# %%
# The guesses are right on average, however few directions they use: they are *unbiased*. What changes is their
# *variance*, the mean of their squared distance from that average. Four times as many directions leave a quarter of
# it: the variance of a mean of n independent samples is that of one sample, divided by n.
figure, (left, right) = plt.subplots(1, 2, figsize=(11, 4), layout="constrained")
left.violinplot([spread[int(n)] for n in counts], showextrema=False)
left.set_xticks(range(1, len(counts) + 1), labels=counts)
left.axhline(exact, color="black", linewidth=1, label="exact")
left.set_xlabel("directions n")
left.set_ylabel("2000 guesses of the integral")
left.legend()
right.loglog(counts, [spread[int(n)].var() for n in counts], "o", label="measured")
right.loglog(counts, guesses(1, 100_000).var() / counts, label="variance of one / n")
right.set_xlabel("directions n")
right.set_ylabel("variance of a guess")
right.legend()

# %%
# Variance, from the samples themselves
# -------------------------------------
# In practice nobody knows the answer, but the samples know their own spread: their squared distances from their mean,
# over n - 1, are on average the variance of one sample. `dmis.variance.moments.Moments` is that sum, kept so that
# parts can be merged in any order. From two samples the estimate is right on average, and useless by itself; remember
# that for the fifth tutorial.
for n in (2, 16, 1024):
    u = rng.random((n, 20_000))
    estimates = Moments.of(2 * np.pi * np.where(u > np.cos(half_angle), u, 0)).variance()
    print(f"variance of one sample from {n:4d}: {estimates.mean():.3f}, give or take {estimates.std():.3f}")

# %%
# The same in an image
# --------------------
# `plates` (in ``plates.py`` beside this script) is a classic scene: four metal plates, smooth to rough from back to
# front, and four lamps, small to large. The rule ``uniform`` is the naive method from above: even random directions
# at every point. Each pixel is a guess of its own, and neighbours guess differently: that is the noise. The sampler
# ``independent`` draws them independently of each other; the default one spreads them more evenly (tutorial 5).
scene = plates()
images = {n: dmis.render(scene, "uniform", n, seed=1, sampler="independent") for n in (4, 16, 64)}
figure, axes = plt.subplots(1, 3, figsize=(12, 3.4), layout="constrained")
for axis, (n, result) in zip(axes, images.items()):
    plot.picture(axis, result.image, f"{n} samples per pixel")

# %%
# How far are these from the truth? A `dmis.Reference` holds two independent images with many samples. With two, the
# reference's own noise cancels: (x - r₁)(x - r₂) is on average (x - r)² with the exact r. References are kept on
# disk, so that the next tutorials find this one.
reference = dmis.make_reference(scene, 64)
for n, result in images.items():
    error, uncertainty = mean_and_error(squared_error(result.image, reference.first, reference.second))
    print(f"{n:3d} samples: squared error {error:.2f} ± {uncertainty:.2f}, own estimate {result.variance.mean():.2f}")

# %%
# `Result.variance` is the renderer's own estimate of each pixel's variance, from its samples alone. It agrees with
# the measured error as far as either is known, since the mean squared error of an unbiased image *is* its mean
# variance. (Neither is known well here: few directions meet a small lamp, and those that do decide everything.)
#
# The price of a clean image is therefore known: for half of the noise that the eye sees, which is the root of the
# variance, take four times as many samples. Or find better samples, with less variance each: that is what the rest of
# the tutorials is about.
#
# Exercises
# ---------
# * What is the variance of one sample of the lamp's integral, by formula? (Its second moment is an integral that you
#   can solve.) Compare with the line in the right plot.
# * Make the lamp smaller. Variance relative to the squared integral grows; how? Why do small lamps hurt this method?
# * Render with even points, the default: `dmis.render(scene, "uniform", 64, sampler="sobol")`. Is the error lower? Does
#   `Result.variance` know?
for path in plot.show("1_monte_carlo"):
    print(path)
