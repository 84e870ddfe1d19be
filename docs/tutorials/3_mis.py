r"""
3. Multiple importance sampling: both, weighted
===============================================

After this tutorial you can

* combine the samples of two techniques without bias;
* write the balance heuristic, and compare it with other heuristics;
* say what Veach's theorem bounds, and what it does not;
* measure how the variance depends on the share of light samples.

Light sampling fails on smooth plates, and BRDF sampling fails with small lamps.
Multiple importance sampling (MIS) takes samples of both techniques and gives each
sample a weight. The weight is small if the other technique finds the same direction
more easily.
"""

import os

import matplotlib.pyplot as plt
import numpy as np

import dmis
from dmis import plot
from dmis.estimator import mis
from dmis.experiment.metrics import ratio_over_blocks, squared_error

QUICK = os.environ.get("DMIS_QUICK") == "1"  # small and fast, for tests
RESOLUTION = (120, 90) if QUICK else (480, 360)

# %%
# Weights
# -------
# Draw :math:`n_l` samples with the density :math:`p_l` and :math:`n_b` samples with
# :math:`p_b`. In each direction choose two weights with :math:`W_l + W_b = 1`, so that
# light counts only once. Then this sum is unbiased (Veach and Guibas 1995):
#
# .. math::
#
#    \hat I = \frac{1}{n_l} \sum_{i=1}^{n_l} W_l(x_i) \frac{f(x_i)}{p_l(x_i)}
#           + \frac{1}{n_b} \sum_{j=1}^{n_b} W_b(x_j) \frac{f(x_j)}{p_b(x_j)}
#
# A weight must be 0 where its technique has density 0.
#
# Let :math:`w = n_l / N` be the share of light samples among all N samples. The
# *balance heuristic* is
#
# .. math::
#
#    W_l = \frac{w\, p_l}{p_w}, \qquad p_w = w\, p_l + (1 - w)\, p_b, \qquad
#    \hat I = \frac{1}{N} \sum_{i=1}^{N} \frac{f(x_i)}{p_w(x_i)}
#
# Every sample counts as if it had been drawn from the mixture of both densities.
#
# Other heuristics favour the larger density more than the balance heuristic does. The
# power heuristic squares the terms :math:`w\, p_l` and :math:`(1 - w)\, p_b`. The
# cutoff heuristic drops a term that is below a tenth of the other. The maximum
# heuristic keeps only the larger term. Here are the weights for two densities on a
# line.
x = np.linspace(-1, 1, 401, dtype=np.float32)
p_l = np.exp(-0.5 * (x / 0.1) ** 2) / (0.1 * np.sqrt(2 * np.pi))
p_b = np.exp(-0.5 * (x / 0.4) ** 2) / (0.4 * np.sqrt(2 * np.pi))
figure, (left, right) = plt.subplots(1, 2, figsize=(11, 3.8), layout="constrained")
left.plot(x, p_l, label="$p_l$, narrow")
left.plot(x, p_b, label="$p_b$, wide")
left.set_ylabel("density")
heuristics = {
    "balance": mis.balance,
    "power": mis.power(2),
    "cutoff": mis.cutoff(0.1),
    "maximum": mis.maximum,
}
for name, heuristic in heuristics.items():
    # a heuristic returns W / density
    light, brdf = heuristic((p_l, p_b), 0) * p_l, heuristic((p_l, p_b), 1) * p_b
    assert np.allclose(light + brdf, 1, atol=1e-3)
    right.plot(x, light, label=name)
right.set_ylabel("weight $W_l$ of a light sample")
for axis in (left, right):
    axis.set_xlabel("x")
    axis.legend()

# %%
# One light and one BRDF sample
# -----------------------------
# With the rule ``balance`` every camera sample takes one light and one BRDF sample, so
# w = 1/2. This rule is the baseline of all comparisons in dmis. Compare its picture
# with the two pictures of tutorial 2.
scene = dmis.load_scene("veach-mis", resolution=RESOLUTION)
reference = dmis.make_reference(scene, 16)


def errors_of(rule, spp=8):
    """Return the squared error of each pixel, with independent points."""
    image = dmis.render(scene, rule, spp, seed=1, sampler="independent").image
    return squared_error(image, reference.first, reference.second)


result = dmis.render(scene, "balance", 16, seed=1, sampler="independent")
figure, axis = plt.subplots(figsize=(8, 6), layout="constrained")
plot.picture(axis, result.image, "one light + one BRDF sample, balance heuristic")

# %%
# What does each technique contribute? The image is the sum of two images: the mean of
# :math:`W_l f / p_l` over light samples, and the mean of :math:`W_b f / p_b` over BRDF
# samples. The third picture shows in false colours which fraction the light samples
# contribute. In blue pixels only light samples contribute; in red pixels only BRDF
# samples contribute.
table = dmis.samples(scene, spp=16, seed=1, sampler="independent")
light, brdf = (table.rows(table.technique == k).radiance().mean(axis=0) for k in (0, 1))
figure, axes = plt.subplots(1, 3, figsize=(15, 4.2), layout="constrained")
plot.picture(axes[0], light, "$W_l f / p_l$, light samples")
plot.picture(axes[1], brdf, "$W_b f / p_b$, BRDF samples")
total = (light + brdf).mean(axis=2)
part = light.mean(axis=2) / np.maximum(total, 1e-6)
part[total <= 0] = np.nan
shown = plot.heat(
    axes[2], part, "part of the light samples", cmap="RdBu", vmin=0, vmax=1
)
figure.colorbar(shown, ax=axes[2], label="0: BRDF samples only, 1: light samples only")

# %%
# The image is good wherever one of the two techniques is good. Here are errors at equal
# samples divided by the error of ``balance``, with 95 % intervals. We compare only the
# part of the image below the lamps, because the choice of directions does not change
# the noise at the lamps' edges.
scale = RESOLUTION[0] / 480
below = slice(int(60 * scale), None)
rules = (
    "fixed:0", "fixed:1", "pbrt", "fixed:0.5,combiner=cutoff",
    "fixed:0.5,combiner=maximum", "one-sample",
)  # fmt: skip
errors = {rule: errors_of(rule) for rule in ("balance", *rules)}
for rule in rules:
    value, width = ratio_over_blocks(errors[rule][below], errors["balance"][below])
    print(f"{rule:27} error over that of balance {value:6.2f} ± {width:.2f}")

# %%
# Each technique alone has a much larger error than ``balance``. The power heuristic
# (``pbrt``) and ``cutoff`` have nearly the error of ``balance``; ``maximum`` has a
# larger error. Veach's theorem bounds the possible gain: for the same samples, other
# *non-negative* weights lower the variance of the balance heuristic by at most
#
# .. math::
#
#    \left( \frac{1}{\min(n_l, n_b)} - \frac{1}{N} \right) I^2
#
# Negative weights may gain more; the combiner ``optimal`` uses them. No bound says how
# much worse than balance other weights can be.
#
# ``one-sample`` chooses the technique of each sample at random. Its error is larger
# than that of ``balance``: *fixed* numbers of samples reduce the variance.
#
# How many of each?
# -----------------
# The theorem says nothing about the choice of w. With the balance heuristic and fixed
# numbers of light and BRDF samples, the variance of the mean of N samples is
#
# .. math::
#
#    V(w) = \frac{1}{N} \left( \int \frac{f^2}{p_w} - I^2 - w (1 - w) D^2 \right),
#    \qquad p_w = w\, p_l + (1 - w)\, p_b
#
# Here D is the mean of :math:`f / p_w` over light samples minus the mean over BRDF
# samples. The figure shows the measured error for several shares w, divided by the
# error at w = 1/2, at three places of the image.
shares = (0, 0.05, 0.25, 0.5, 0.75, 0.95, 1)
known = {0: "fixed:0", 0.5: "balance", 1: "fixed:1"}
maps = [errors[known[w]] if w in known else errors_of(f"fixed:{w}") for w in shares]
places = {
    "smooth plate, large lamp": ((122, 158), (350, 460)),
    "second plate, third lamp": ((170, 206), (256, 334)),
    "third plate, second lamp": ((222, 262), (150, 222)),
}
figure, axis = plt.subplots(figsize=(8, 4.8), layout="constrained")
for name, place in places.items():
    window = tuple(slice(int(a * scale), int(b * scale)) for a, b in place)
    half = errors["balance"][window]
    ratios = np.array([ratio_over_blocks(error[window], half) for error in maps])
    axis.errorbar(shares, *ratios.T, fmt="o-", capsize=3, label=name)
    best = int(ratios[:, 0].argmin())
    value, width = ratios[best]
    print(f"{name}: {value:.2f} ± {width:.2f} at w = {shares[best]}, the best of these")
axis.set_yscale("log")
axis.axhline(1, color="0.5", linewidth=1)
axis.set_xlabel("share of light samples w (0: BRDF only, 1: light only)")
axis.set_ylabel("error / error at w = 1/2")
axis.legend()

# %%
# The share w = 1/2 never fails. But at two of these places the error of the best share
# is only a fifth of the error at w = 1/2. On the smooth plate nearly all samples should
# be BRDF samples; on the third plate nearly all should be light samples. The best share
# differs between parts of the image, and is unknown before rendering. But a few samples
# can estimate the best share in advance. The thesis is based on this idea.
#
# Exercises
# ---------
# Starter files and solutions are on the page "Syllabus". Check your file with
# ``python docs/exercises/checks N FILE``.
#
# 10. *Easy.* Write the balance heuristic (``10_balance_weight.py``).
# 11. *Medium.* Write the estimate from any numbers of samples of both techniques
#     (``11_two_techniques.py``).
# 12. *Hard.* Write V(w) for fixed numbers of samples (``12_variance_curve.py``).
#
# To think about: why are w = 0 and w = 1 dangerous? Look at :math:`f / p_w` where
# :math:`p_b` is close to 0. The combiner ``optimal`` (Kondapaneni et al. 2019) fits f
# by both densities and needs many samples. From how many samples on is it better than
# ``balance`` here?
for path in plot.show("3_mis"):
    print(path)
