"""
5. Why it fails, and the second moment
======================================

The rule of the thesis loses on two of its four scenes. The idea is right, and with exact variances the parabola would
win. But two samples of a technique that fails do not say that it fails, and a mistake at the ends is expensive. The
same six samples can say much more, if each of them is asked about every weight at once.
"""

import matplotlib.pyplot as plt
import numpy as np
from plates import plates

import dmis
from dmis import plot
from dmis.experiment.metrics import ratio
from dmis.fit.thesis import parabola_minimum
from dmis.variance.curves import GRID, HALF
from dmis.variance.moments import Moments

rng = np.random.default_rng(1)

# %%
# Two samples do not see a spike
# ------------------------------
# A small lamp above a matte floor: one BRDF sample in a hundred hits it and brings 100, the others bring 0. The
# variance is 99. What do two samples say, averaged over a patch of 16 pixels?
hits = 100.0 * (rng.random((2, 16, 10_000)) < 0.01)
reported = Moments.of(hits).variance().mean(axis=0)
print(f"mean of what patches report {reported.mean():.0f}, and {(reported == 0).mean():.0%} of them report 0")

# %%
# Right on average; and three patches of four report no variance at all. For a parabola through three points the
# technique that fails is then the best, and the patch gets nothing but BRDF samples.
#
# How many patches are so misled depends on their size times the number of samples. With n BRDF samples in a patch, and
# a hit in a hundred, none of them hits with probability 0.99^n:
for side in (4, 8, 16):
    n = 2 * side**2
    print(f"patches of {side:2}x{side:<2}: {n:3} samples, {0.99**n:.1%} of the patches see no hit")

# %%
# A variance is not a parabola
# ----------------------------
# That costs less than one would think. The *oracle* renders variance curves from very many samples. Here is what it
# says of the plates, without the lamps above them (a `crop` is a part of the image), at the place where the third plate
# mirrors the second lamp:
scene = plates().crop((32, 72), (0, 96))
oracle = dmis.make_oracle(scene, 64)
place = slice(21 // oracle.patch, 27 // oracle.patch), slice(32 // oracle.patch, 45 // oracle.patch)
curve = oracle.variance[:, *place].mean(axis=(1, 2))
three = curve[[0, HALF, -1]]
parabola = np.polyfit([0, 0.5, 1], three, 2)
minimum, _ = parabola_minimum(np.array([0, 0.5, 1]), three)
w = np.linspace(0, 1, 201)
figure, axes = plt.subplots(1, 2, figsize=(11, 4), layout="constrained")
for axis in axes:
    axis.plot(GRID, curve, "o-", color="black", markersize=4, label="true variance")
    axis.plot(w, np.polyval(parabola, w), color="tab:red", label="parabola through three exact points")
    axis.axvline(float(minimum), color="tab:red", linestyle=":", label=f"its minimum, w = {float(minimum):.2f}")
    axis.set_xlabel("share of light samples w")
axes[0].set_ylabel("variance of a camera sample")
axes[1].set_ylim(-0.1 * curve[HALF], 3 * curve[HALF])
axes[1].set_title("the same, enlarged")
axes[0].legend()

# %%
# A variance is a sum of terms like 1 / (w p_l + (1 - w) p_b): steep at the ends, flat between. Even from exact points
# the parabola dips below zero, and its minimum is near 3/4 (or 1/4), wherever the best weight is. But on this side of
# 1/2 the curve is lower than at 1/2. Where a curve falls (or rises) all the way, the exact parabola cannot lose, it
# only leaves some of the gain (the theory page has the proof):
half = curve[HALF]
print(
    f"variance over that of w = 1/2: at the parabola's minimum {np.interp(minimum, GRID, curve) / half:.2f}, "
    f"best {curve.min() / half:.2f}, at w = 0 {curve[0] / half:.1f}, at w = 1 {curve[-1] / half:.2f}"
)

# %%
# So what hurts is the pilot, not the parabola.
#
# Ask every sample about every weight
# -----------------------------------
# Take the pilot at w = 1/2. Its samples come from the density q = (p_l + p_b) / 2, and each is worth X = f / q. At
# another weight a sample in the same direction would be worth f / p_w = X q / p_w; its square, weighted for having
# been drawn from q, is an unbiased estimate of the *second moment* at that weight. So the same six samples tell of
# all weights. And if the BRDF samples miss the lamp, the light samples that hit it know what that would have cost,
# since they know p_b there. The rule ``second-moment`` does that, for `dmis.variance.curves.GRID`. What a pilot of 6
# samples learns (``cost=no`` is for samples that all count the same; as it is, the rule weighs variance against the
# rays that a light sample costs; ``combiner=balance`` is what the oracle has curves of, the rule would choose between
# balance and power by the curves of both):
learned = {
    rule: dmis.render(scene, rule, 16, seed=1).weight
    for rule in ("thesis:patch=4", "second-moment:combiner=balance,cost=no")
}
figure, axes = plt.subplots(1, 3, figsize=(14, 2.6), layout="constrained")
width, height = scene.camera.resolution
for axis, (rule, weight) in zip(axes, learned.items()):
    plot.weights(axis, weight, rule)
shown = plot.weights(axes[2], oracle.best(), "oracle", ((0, height), (0, width)))
plot.weight_bar(figure, shown, axes)
for rule, weight in learned.items():
    change = oracle.at(weight) / oracle.at(0.5)
    print(f"{rule:44} variance over that of w = 1/2: median patch {np.median(change):.2f}, worst {change.max():.1f}")
best = oracle.variance.min(axis=0) / oracle.at(0.5)
print(f"{'oracle':44} variance over that of w = 1/2: median patch {np.median(best):.2f}, worst {best.max():.1f}")

# %%
# Share what was measured, not what was decided: the rule averages *curves* of neighbours that look alike, then each
# patch takes its own minimum. Where the gain is not sure it stays at 1/2.
#
# In numbers
# ----------
# On the diffuse killeroo, where light sampling is nearly always better, with several seeds. ``auto`` also puts more
# samples where the noise is. Samples are independent.
scene = dmis.load_scene("killeroo-diffuse", resolution=(80, 60))
reference = dmis.make_reference(scene, 512)
rules = "balance", "thesis:patch=4", "second-moment", "auto"
runs = dmis.measure(scene, [(rule, 32) for rule in rules], range(3), reference, sampler="independent")
baseline = np.array([run.mse for run in runs["balance", 32]])
for rule in rules[1:]:
    value, half = ratio(np.array([run.mse for run in runs[rule, 32]]), baseline)
    print(f"{rule:16} squared error over that of balance {value:.2f} ± {half:.2f}")

# %%
# Why evenness beats weights
# --------------------------
# All of this shared out *independent* samples, whose squared error is V / n: a better weight makes V smaller. Points
# that fill each other's gaps change the exponent, to n^-2 for what is smooth, n^-1.5 or so at an edge in the pixel, and
# n^-1.25 at the edge of a soft shadow. At some n the exponent wins against any factor in V. Here are the slopes: the
# best single weight against even points, then even points with numbers of samples (``counts``), and with weights too
# (``auto``).
spp = np.array([16, 64, 256])
figure, axis = plt.subplots(figsize=(6, 4), layout="constrained")
for rule, sampler, style in (
    ("balance", "independent", "o:"),
    ("fixed:0.9", "independent", "s:"),
    ("balance", "sobol", "o-"),
    ("counts", "sobol", "^-"),
    ("auto", "sobol", "v-"),
):
    images = [dmis.render(scene, rule, int(n), seed=1, sampler=sampler).image for n in spp]
    errors = [dmis.mse(image, reference.first, reference.second) for image in images]
    slope = np.polyfit(np.log(spp), np.log(errors), 1)[0]
    axis.loglog(spp, errors, style, label=f"{rule}, {sampler}: $n^{{{slope:.2f}}}$")
    print(f"{rule:10} {sampler:12} mean squared error {errors[0]:.1e} to {errors[-1]:.1e}, slope {slope:.2f}")
axis.set_xlabel("camera samples per pixel")
axis.set_ylabel("mean squared error")
axis.legend()

# %%
# Weights still pay once the points are even: they then work on the part that stays, edges and shadows. The page on
# even points (``docs/sampling.md``) says how such points are made, that on weight rules what ``auto`` does.
#
# Exercises
# ---------
# * Which of the slopes are steeper than -1, and why is none of them -2 on this image?
# * How many pilot samples would it take until only one patch in a hundred reports no variance at all?
# * The second moment at w from samples of q is the mean of X² / m with m = p_w / q. How large can a single term be,
#   in terms of X² and w? Why is w = 1/2 the right place for a pilot?
# * Take ``filter=none`` and ``guard=0`` from ``second-moment``. Which of the two does more harm?
for path in plot.show("5_second_moment"):
    print(path)
