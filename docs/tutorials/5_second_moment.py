r"""
5. Why it fails, and the second moment
======================================

After this tutorial you can

* compute the probability that a pilot misses a bright spot;
* say where a parabola is wrong, and why this costs little;
* estimate the variance at every share from the samples of one pilot;
* explain why low-discrepancy points beat better shares, and when both help.

The rule of the thesis lost on two of its four scenes. The parabola is not the reason:
with exact variances it would win. The reason is that two samples of a bad technique
often show little variance. A better estimate uses every sample to predict the variance
at every share.
"""

import os

import matplotlib.pyplot as plt
import numpy as np

import dmis
from dmis import plot
from dmis.experiment.metrics import ratio
from dmis.fit.thesis import parabola_minimum
from dmis.variance.curves import GRID, HALF
from dmis.variance.moments import Moments

QUICK = os.environ.get("DMIS_QUICK") == "1"  # small and fast, for tests
RESOLUTION = (60, 45) if QUICK else (480, 360)
PATCH = 4 if QUICK else 8
rng = np.random.default_rng(1)

# %%
# Two samples miss a spike
# ------------------------
# A small lamp is above a matte floor. One BRDF sample in a hundred hits the lamp and
# has the value 100: a *spike*. The others have the value 0. So the variance is 99. What
# is the sample variance of two samples per pixel, averaged over a patch of 16 pixels?
hits = 100.0 * (rng.random((2, 16, 10_000)) < 0.01)
reported = Moments.of(hits).variance().mean(axis=0)
error = 1.96 * reported.std() / 100
print(f"mean of what 10,000 patches report: {reported.mean():.1f} ± {error:.1f}")
print(f"patches that report 0: {(reported == 0).mean():.0%}")

# %%
# The estimates are right on average, but three of four patches report the variance 0.
# In these patches BRDF sampling seems best, so they get only BRDF samples.
#
# If a sample hits the lamp with probability p, all samples of a patch of P pixels miss
# with probability
#
# .. math::
#
#    (1 - p)^{2 P}
for side in (4, 8, 16):
    n = 2 * side**2
    print(f"patches of {side:2} by {side:<2}: {n:3} samples, no hit in {0.99**n:.1%}")

# %%
# A variance is not a parabola
# ----------------------------
# The variance V(w) is not a parabola, but this costs little. The *oracle* computes V(w)
# from many samples. The figure shows the oracle's V(w) where the third plate of
# ``veach-mis`` reflects the second lamp. The image is cropped below the lamps.
plates = dmis.load_scene("veach-mis", resolution=RESOLUTION)
scale = RESOLUTION[0] / 480
top = int(64 * scale)
plates = plates.crop((0, top, *RESOLUTION))
oracle = dmis.make_oracle(plates, 32, PATCH)
place = tuple(
    slice(int((a * scale - offset) // PATCH), int((b * scale - offset) // PATCH))
    for (a, b), offset in zip(((224, 264), (152, 224)), (top, 0), strict=True)
)
curve = oracle.variance[:, *place].mean(axis=(1, 2))
three = curve[[0, HALF, -1]]
parabola = np.polyfit([0, 0.5, 1], three, 2)
minimum = float(parabola_minimum(np.array([0, 0.5, 1]), three)[0])
w = np.linspace(0, 1, 201)
figure, axes = plt.subplots(1, 2, figsize=(11, 4.2), layout="constrained")
for axis in axes:
    axis.plot(GRID, curve, "o-", color="black", markersize=4, label="variance")
    label = "parabola through three exact points"
    axis.plot(w, np.polyval(parabola, w), color="tab:red", label=label)
    label = f"its minimum, w = {minimum:.2f}"
    axis.axvline(minimum, color="tab:red", linestyle=":", label=label)
    axis.set_xlabel("share of light samples w")
axes[0].set_ylabel("variance of a camera sample")
axes[1].set_ylim(-1.5 * curve[HALF], 4 * curve[HALF])
axes[1].set_title("the same, enlarged")
axes[0].legend()

# %%
# The variance is a sum of terms like :math:`1 / (w\, p_l + (1 - w)\, p_b)`, so its
# curve is steep at the ends and flat between the ends. The parabola dips below zero
# although its points are exact. If one end is far above the other points, the minimum
# of the parabola is near 3/4 or 1/4, wherever the best share is.
#
# But this minimum is on the side of 1/2 where the variance is lower. If V(w) only falls
# or only rises, a parabola through exact points never loses against w = 1/2. The
# parabola only misses a part of the gain. The proof is in `dmis/fit/thesis.py`.
half = curve[HALF]
for name, value in (
    ("at the parabola's minimum", np.interp(minimum, GRID, curve)),
    ("best", curve.min()),
    ("at w = 0", curve[0]),
    ("at w = 1", curve[-1]),
):
    print(f"variance over that at w = 1/2, {name}: {value / half:.2f}")

# %%
# So the pilot causes the loss, not the parabola.
#
# Every sample at every share
# ---------------------------
# Take a pilot with the share w = 1/2. Its samples have the density
# :math:`q = (p_l + p_b) / 2`, and each sample counts :math:`X = f / q`. At another
# share, a sample in the same direction would count
#
# .. math::
#
#    \frac{f}{p_w} = \frac{X}{m(w)}, \qquad m(w) = \frac{p_w}{q} = 1 + (2 w - 1)\, d,
#    \qquad d = \frac{p_l - p_b}{p_l + p_b}
#
# and it would occur :math:`m(w)` times as often. So the mean over the samples of this
# one pilot estimates the second moment at any share:
#
# .. math::
#
#    M_2(w) = \int \frac{f^2}{p_w} = \mathrm{E}_q \left[ \frac{X^2}{m(w)} \right],
#    \qquad \frac{X^2}{m(w)} \le \frac{X^2}{2 \min(w, 1 - w)}
#
# By this bound, at shares between 1/4 and 3/4 a term is at most twice the term at w =
# 1/2. Towards 0 and 1 the bound grows without limit, so the curves are less certain
# there. Samples of one technique inform about both techniques: if the BRDF samples miss
# a lamp, the light samples still hit it. The density :math:`p_b` of these light samples
# shows the variance of BRDF sampling.
#
# The rule ``second-moment`` uses this estimate. It averages the *curves* of similar
# neighbouring patches, and then takes the minimum of each patch. If the gain is
# uncertain, w stays at 1/2. The figure shows the shares that ``thesis`` and
# ``second-moment`` learn from six samples, and the best shares by the oracle. (With
# ``weigh=samples``, w of ``thesis`` is also the share of light samples. With
# ``cost=no`` all samples have the same cost; by default a light sample costs more
# rays.)
rules = f"thesis:weigh=samples,patch={PATCH}", "second-moment:cost=no"
learned = {
    rule: dmis.render(plates, rule, 16, seed=1, sampler="independent").weight
    for rule in rules
}
figure, axes = plt.subplots(1, 3, figsize=(15, 3.6), layout="constrained")
width, height = plates.camera.resolution
for axis, (rule, weight) in zip(axes, learned.items()):
    plot.weights(axis, weight, rule.partition(":")[0])
window = 0, 0, width, height
shown = plot.weights(axes[2], oracle.best(), "oracle", window)
plot.weight_bar(figure, shown, axes)
for rule, weight in learned.items():
    change = oracle.mean(oracle.at(weight)) / oracle.mean(oracle.at(0.5))
    harm, error = oracle.harm(weight)
    print(
        f"{rule}: variance of the image over that of w = 1/2 {change:.2f}, "
        f"patches made worse {harm:.0%} ± {1.96 * error:.0%}"
    )
print(f"best shares: {oracle.limit():.2f}")

# %%
# In numbers
# ----------
# On the diffuse killeroo light sampling is nearly always better, and BRDF sampling has
# spikes. Here are the errors at equal samples divided by the error of ``balance``, from
# five seeds.
side = (20, 15) if QUICK else (160, 120)
scene = dmis.load_scene("killeroo-diffuse", resolution=side)
reference = dmis.make_reference(scene, 32 if QUICK else 128)
rules = "balance", "thesis:weigh=samples,patch=8", "second-moment"
budgets = [(rule, 32) for rule in rules]
runs = dmis.measure(scene, budgets, range(5), reference, sampler="independent")
errors = {rule: np.array([run.mse for run in runs[rule, 32]]) for rule in rules}
for rule in rules[1:]:
    value, half = ratio(errors[rule], errors["balance"])
    print(f"{rule:28} mean squared error over that of balance {value:.2f} ± {half:.2f}")

# %%
# ``second-moment`` wins. ``thesis`` (with shares) loses. The page "The thesis" reports
# a gain on this scene, with 128 samples and larger patches. Here the pilot takes six of
# only 32 samples: even with equal shares the ratio would be 32/26 = 1.23, because only
# 26 samples make the image. Besides, patches of 8 by 8 pixels miss spikes.
# With patches of 16 by 16 pixels the ratio is 1.14 ± 0.05; with these patches and 128
# samples it is 0.95 ± 0.03.
#
# Why low-discrepancy points beat shares
# --------------------------------------
# So far all samples were *independent*. Their error is V / n, and a better share
# reduces V. Low-discrepancy points, which fill each other's gaps, change the exponent
# of n. For smooth integrands the error may fall like :math:`n^{-2}`, for an edge in the
# pixel like :math:`n^{-1.5}`. For large n a better exponent beats any constant factor.
#
# Here are measured errors with independent points and with Sobol points, the default.
# ``auto`` also learns how many samples of each technique a pixel needs.
spp = np.array([8, 32, 128])
figure, axis = plt.subplots(figsize=(7, 4.6), layout="constrained")
for rule, sampler, style in (
    ("balance", "independent", "o:"),
    ("second-moment", "independent", "s:"),
    ("balance", "sobol", "o-"),
    ("auto", "sobol", "v-"),
):
    budgets = [(rule, int(n)) for n in spp]
    runs = dmis.measure(scene, budgets, range(1), reference, sampler=sampler)
    errors = [runs[budget][0].mse for budget in budgets]
    slope = np.polyfit(np.log(spp), np.log(errors), 1)[0]
    axis.loglog(spp, errors, style, label=f"{rule}, {sampler}: $n^{{{slope:.2f}}}$")
    print(f"{rule}, {sampler}: {errors[0]:.1e} to {errors[-1]:.1e}, slope {slope:.2f}")
axis.set_xlabel("camera samples per pixel")
axis.set_ylabel("mean squared error")
axis.legend()

# %%
# Better shares still help with Sobol points: the shares reduce the remaining noise of
# edges and shadows. The page "Low-discrepancy points" explains the points, and the page
# "How the learned rules work" explains ``auto``.
#
# Exercises
# ---------
# Starter files and solutions are on the page "Syllabus". Check your file with
# ``python docs/exercises/checks N FILE``.
#
# 16. *Easy.* Compute the probability to miss a spike, and how many samples make this
#     probability small (``16_missed.py``).
# 17. *Medium.* Estimate the second moment at every share (``17_second_moment.py``).
# 18. *Hard.* Estimate the variance curve without bias, from two samples of each
#     technique (``18_unbiased_curve.py``).
#
# To think about: why is w = 1/2 the right place for a pilot? Which of the slopes are
# steeper than -1, and why is none of them -2?
for path in plot.show("5_second_moment"):
    print(path)
