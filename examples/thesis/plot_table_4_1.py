"""
Table 4.1: the thesis's rule against the balance heuristic
==========================================================

The main result of the thesis, scene by scene: the mean squared error of its rule over
that of the balance heuristic, with 128 camera samples, of which 6 are the pilot's. The
rule goes step by step here, as in Section 3 of the thesis, in two set-ups:

* **independent**: independent points, one light and one BRDF sample, direct light.
* **nearest**: pbrt-v2's points, the numbers of samples of the scene files, paths on
  both killeroo scenes. It was chosen knowing the thesis's errors.

Images are an eighth as wide as the thesis's, which changes errors and ratios. Hours of
``--full`` take its size. ``make_score.py`` beside this script measures both set-ups
with several seeds, and can be interrupted.
"""

import time

import numpy as np

import dmis
from dmis.base.color import luminance
from dmis.base.patches import patch_mean, patch_spread
from dmis.examples.gallery import SCENES, options, print_canvas
from dmis.experiment.metrics import ratio_over_blocks, squared_error
from dmis.filter import gaussian

opts, _ = options("plot_table_4_1", __doc__)
PATCH = opts.pick(4, 16)
STRATEGIES = np.array([0, 0.5, 1])

# %%
# **The set-ups.** In direct light ``nearest`` takes as many light and BRDF samples as
# the scene file asks for. Its final pass has 128 points, 122 rounded up to a power of
# two, as pbrt-v2's sampler does.
FINAL = {"independent": opts.spp - 6, "nearest": opts.spp}
scenes = {name: opts.scene(name, opts.pick(32, 8, 1)) for name in SCENES}
cases = {}
for name, scene in scenes.items():
    cases["independent", name] = {"preset": "thesis", "integrator": "direct"}
    paths = {"preset": "nearest", "integrator": "path"}
    direct = {"preset": "nearest", "integrator": "direct"}
    direct["shading_samples"] = scene.suggested.shading_samples or 2
    cases["nearest", name] = paths if name.startswith("killeroo") else direct
seconds = {}


def render(case, rule, spp, seed, **more):
    """Render a case; add the seconds of all processors to those of the rule."""
    begin = time.process_time()
    progress = opts.progress
    settings = {**cases[case], "progress": progress, "parallel": opts.threads, **more}
    result = dmis.render(scenes[case[1]], rule, spp, seed=seed, **settings)
    stage = case, "balance" if rule == "balance" else "rule"
    seconds[stage] = seconds.get(stage, 0) + time.process_time() - begin
    return result


# %%
# **The baseline**: w = 1/2 everywhere, without a pilot. What a scene makes once, such
# as tables of its sky, is made before the seconds are counted.
for scene in scenes.values():
    dmis.render(scene, "balance", 1)
balance = {case: render(case, "balance", opts.spp, 4).image for case in cases}

# %%
# **Step 1, the pilot.** Two camera samples per pixel for each weight w = 0, 1/2, 1.
# With p_w = w p_l + (1 - w) p_b, a light sample of contribution f counts w f / p_w, a
# BRDF sample (1 - w) f / p_w. Points of a pilot are independent.
pilots = {
    case: [
        render(case, f"fixed:{w:g},weigh=heuristic", 2, k, sampler="independent")
        for k, w in enumerate(STRATEGIES, 1)
    ]
    for case in cases
}

# %%
# **Step 2, the variance.** y = Σ (x - mean)² / (n - 1) over the n = 2 samples x of a
# pixel, averaged over a patch (`Result.variance` is y / n, which has the same minimum).
variances = {
    case: np.stack([patch_mean(luminance(pilot.variance), PATCH) for pilot in three])
    for case, three in pilots.items()
}

# %%
# **Step 3, the fit.** The parabola a₂ w² + a₁ w + a₀ through the three points (w, y) of
# each patch (Eqs. 3.2-3.4) has its minimum at w = -a₁ / (2 a₂) (Eq. 3.5). Three points
# determine it: a₂ = 2 (y₀ + y₁ - 2 y½), a₁ = -3 y₀ + 4 y½ - y₁. Outside [0, 1] the
# nearer end is taken, without a minimum the best of the three, without a signal 1/2.
weights = {}
for case, (y0, y_half, y1) in variances.items():
    a2, a1 = 2 * (y0 + y1 - 2 * y_half), -3 * y0 + 4 * y_half - y1
    best = STRATEGIES[variances[case].argmin(axis=0)]
    convex, signal = a2 > 0, np.ptp(variances[case], axis=0) > 0
    minimum = np.clip(-a1 / np.where(convex, 2 * a2, 1), 0, 1)
    weights[case] = np.where(convex, minimum, np.where(signal, best, 0.5))

# %%
# **Step 4, the filter and the map.** The weight of patch p becomes Σ_q g(p - q) w_q
# over 5x5 patches q, with g ~ exp(-d² / 2) at a distance of d patches. Each pixel takes
# the weight of its patch.
maps = {
    case: patch_spread(gaussian(w, sigma=1, radius=2), PATCH, balance[case].shape[:2])
    for case, w in weights.items()
}

# %%
# **Step 5, the final pass**, with one light sample for each BRDF sample, as the pilot.
final = {}
for case, w in maps.items():
    rule = dmis.Given(weight=w, weigh="heuristic")
    final[case] = render(case, rule, FINAL[case[0]], 5).image

# %%
# **The errors**: (x - r₁)(x - r₂) of each pixel, with two independent halves r₁, r₂ of
# a reference. A ratio covers the thesis's if that is inside its 95 % interval.
rows = {}
for case in cases:
    setup, name = case
    reference = dmis.make_reference(
        scenes[name],
        opts.pick(32, 128),
        integrator=cases[case]["integrator"],
        parallel=opts.threads,
        progress=opts.progress,
    )
    base, ours = (
        squared_error(images[case], reference.first, reference.second)
        for images in (balance, final)
    )
    value, half = ratio_over_blocks(ours, base)
    covered = abs(value - SCENES[name].equal_samples) <= half
    more_time = seconds[case, "rule"] / seconds[case, "balance"] - 1
    rows[case] = base.mean(), value, half, covered, more_time
print(
    "| set-up, scene | MSE of balance | the thesis's | rule / balance | the thesis's"
    " | covered | more time | the thesis's |"
)
print("|---" * 8 + "|")
for (setup, name), (mse, value, half, covered, more_time) in rows.items():
    about = SCENES[name]
    print(
        f"| {setup}, {name} | {mse:.2e} | {about.mse:.2e} |"
        f" {value:.3f} ± {half:.3f} | {about.equal_samples:.3f} |"
        f" {'yes' if covered else 'no'} | {more_time:+.1%} | {about.overhead:+.1%} |"
    )
print()

# %%
# Left: absolute errors. Right: ratios; below 1 the rule wins.
figure, axes = print_canvas(1, 2, 3.1)
places = np.arange(len(SCENES))
told = {"color": "black", "linestyle": "", "label": "thesis", "fillstyle": "none"}
axes[0, 0].plot(places, [about.mse for about in SCENES.values()], "D", **told)
axes[0, 1].plot(places, [about.equal_samples for about in SCENES.values()], "D", **told)
for shift, setup, colour in (
    (-0.15, "independent", "tab:blue"),
    (0.15, "nearest", "tab:red"),
):
    mse, values, halves, *_ = np.transpose([rows[setup, name] for name in SCENES])
    axes[0, 0].plot(places + shift, mse, "o", color=colour, label=setup)
    axes[0, 1].errorbar(
        places + shift, values, halves, fmt="o", capsize=3, color=colour, label=setup
    )
axes[0, 0].set_yscale("log")
axes[0, 0].set_ylabel("MSE of the balance heuristic")
axes[0, 1].axhline(1, color="0.35", linestyle="--", linewidth=0.8)
axes[0, 1].set_ylabel("MSE of the rule / that of balance")
for axis in axes[0]:
    axis.set_xticks(
        places, [about.title.replace(" ", "\n") for about in SCENES.values()]
    )
handles, labels = axes[0, 1].get_legend_handles_labels()
figure.legend(handles, labels, loc="outside lower center", ncols=3)
size = {"quick": "tiny images", "default": "an eighth of the thesis's side length"}
opts.save_for_print(
    figure,
    "Table 4.1: the thesis's rule against the balance heuristic",
    f"""Left: mean squared error of the balance heuristic, {opts.spp} camera samples.
    Right: that of the thesis's rule over it, 95 % intervals over blocks of pixels. Two
    set-ups, 1 seed, {size.get(opts.size, "the thesis's resolution")}. Diamonds: the
    thesis's numbers.""",
    panel=axes[0, 1],
)
