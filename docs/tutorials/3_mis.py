"""
3. Multiple importance sampling: both, weighted
===============================================

Light sampling fails on smooth plates, BRDF sampling on small lamps. Multiple importance sampling takes samples of
both, and gives each sample a weight that says how much it is to be trusted: little, where the other technique would
have found the same direction more easily. Which weights? And how many samples of each?
"""

import matplotlib.pyplot as plt
import numpy as np
from plates import plates

import dmis
from dmis import plot
from dmis.estimator import mis
from dmis.experiment.metrics import mean_and_error, squared_error

# %%
# Heuristics
# ----------
# Two techniques with densities p_l and p_b share the samples: w and 1 - w of them. A sample x of one of them counts
# as W f / (w p_l), where the two weights W of a direction have to sum to 1, so that nothing is counted twice. The
# *balance heuristic* takes W = w p_l / (w p_l + (1 - w) p_b). Then a sample counts as f / (w p_l + (1 - w) p_b),
# whichever technique it comes from: as if it had been drawn from the mixture of both. ``dmis.estimator.mis`` has it,
# and others that are more radical: the power heuristic squares, the cutoff heuristic drops what is below a tenth, the
# maximum takes all.
x = np.linspace(-1, 1, 401, dtype=np.float32)
p_l = np.exp(-0.5 * (x / 0.1) ** 2) / (0.1 * np.sqrt(2 * np.pi))
p_b = np.exp(-0.5 * (x / 0.4) ** 2) / (0.4 * np.sqrt(2 * np.pi))
figure, (left, right) = plt.subplots(1, 2, figsize=(11, 3.6), layout="constrained")
left.plot(x, p_l, label="p_l, narrow")
left.plot(x, p_b, label="p_b, wide")
left.set_ylabel("densities")
heuristics = {"balance": mis.balance, "power": mis.power(2), "cutoff": mis.cutoff(0.1), "maximum": mis.maximum}
for name, heuristic in heuristics.items():
    own, other = heuristic((p_l, p_b), 0) * p_l, heuristic((p_l, p_b), 1) * p_b  # a heuristic returns W / density
    assert np.allclose(own + other, 1, atol=1e-3)
    right.plot(x, own, label=name)
right.set_ylabel("weight W of a sample from p_l")
for axis in (left, right):
    axis.set_xlabel("x")
    axis.legend()

# %%
# One light and one BRDF sample
# -----------------------------
# The rule ``balance`` takes one of each with every camera sample, w = 1/2. It is the baseline of every comparison in
# dmis. All samples of this tutorial are independent: its theorems are about such.
independent = dmis.Settings(sampler="independent")
scene = plates()
reference = dmis.make_reference(scene, 64)
below = slice(35, None)  # rows below the lamps: at their edges no choice of directions matters
half = dmis.render(scene, "balance", 16, seed=1, settings=independent)
figure, axis = plt.subplots(figsize=(6, 4.5), layout="constrained")
plot.picture(axis, half.image, "one light + one BRDF sample, balance heuristic")

# %%
# It is good wherever one of the two techniques is. With as many samples, on the plates (± one standard error over
# pixels):
rules = "balance", "fixed:0", "fixed:1", "pbrt", "fixed:0.5,combiner=cutoff", "fixed:0.5,combiner=maximum", "one-sample"
for rule in rules:
    image = dmis.render(scene, rule, 16, seed=1, settings=independent).image
    error, uncertainty = mean_and_error(squared_error(image, reference.first, reference.second)[below])
    print(f"{rule:27} squared error {error:7.3f} ± {uncertainty:.3f}")

# %%
# Either technique alone loses by far. Heuristics differ little from one another (``pbrt`` is the power heuristic); no
# choice of non-negative weights can be much better than balance, which is a theorem of Veach's. (Weights below 0 can:
# the combiner ``optimal`` has such.) ``one-sample``, which draws lots for which technique each sample comes from, shows
# that *fixed* numbers of samples are worth something by themselves.
#
# How many of each?
# -----------------
# What the theorem does not cover is w. The variance of an image is known from a few images with different seeds, so
# here it is for every share of light samples, where different plates mirror different lamps:
shares = np.array([0, 0.05, 0.25, 0.5, 0.75, 0.95, 1])
maps = []
for w in shares:
    images = [dmis.render(scene, f"fixed:{w}", 8, seed=seed, settings=independent).image for seed in (1, 2, 3)]
    maps.append(np.var(images, axis=0, ddof=1).mean(axis=-1))
places = {
    "smooth plate, large lamp": (slice(36, 42), slice(74, 85)),
    "third plate, second lamp": (slice(53, 59), slice(32, 45)),
    "rough plate, large lamp": (slice(66, 72), slice(70, 90)),
}
figure, axis = plt.subplots(figsize=(7, 4.3), layout="constrained")
for name, place in places.items():
    curve = np.array([variance[place].mean() for variance in maps])
    axis.semilogy(shares, curve / curve[shares == 0.5], "o-", label=name)
axis.axhline(1, color="0.5", linewidth=1)
axis.set_xlabel("share of light samples w (0: BRDF only, 1: light only)")
axis.set_ylabel("variance / variance at w = 1/2")
axis.legend()

# %%
# w = 1/2 is nowhere bad, and nowhere best. On the smooth plate nearly all samples should be BRDF samples, on rough
# ones nearly all light samples, and the right choice leaves a fraction of the variance. It is different in every part
# of the image, and nobody can tell it beforehand; but a few samples, spent in advance, could find out. That is the
# idea of the thesis.
#
# Exercises
# ---------
# * Why are the ends, w = 0 and w = 1, not part of the mixture's safe range? Look at f / (w p_l + (1 - w) p_b) where
#   p_b = 0.
# * Show that two light samples with the balance heuristic and w = 1 are not the same as w = 1/2 with four samples,
#   two of each.
# * ``fixed:0.5,combiner=optimal`` fits the integrand by both densities (Kondapaneni et al. 2019), and needs many
#   samples. At which number does it begin to pay on the plates?
for path in plot.show("3_mis"):
    print(path)
