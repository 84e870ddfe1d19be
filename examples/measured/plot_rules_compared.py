"""
Rules compared
==============

All rules on all scenes, with equal numbers of camera samples, pilot included, and by
time: mean squared error over that of the balance heuristic. The one-sample model is
what the thesis may have compared with; the balance heuristic with one light and one
BRDF sample is the baseline that counts. Samples are independent.
"""

import numpy as np

import dmis
from dmis import plot
from dmis.examples.gallery import SCENES, options
from dmis.experiment.metrics import ratio
from dmis.experiment.runs import median_seconds

opts, _ = options("plot_rules_compared", __doc__)
RULES = (
    "one-sample", "pbrt", "thesis:weigh=samples", "inverse-variance", "neyman",
    "representativity", "taylor", "kl", "tsallis", "second-moment", "auto",
)  # fmt: skip
SEEDS = range(opts.pick(1, 1, 5))

# %%
# At half of the usual size, because there is so much to render.
ratios, times = {}, {}
for name in SCENES:
    scene = opts.scene(name, 2 * opts.shrink)
    reference = opts.reference(scene)
    budgets = [(rule, opts.spp) for rule in ("balance", *RULES)]
    runs = dmis.measure(
        scene,
        budgets,
        SEEDS,
        reference,
        sampler="independent",
        parallel=opts.threads,
        progress=opts.progress,
    )
    base = runs["balance", opts.spp]
    for rule in RULES:
        mine = runs[rule, opts.spp]
        ratios[name, rule] = ratio(
            np.array([run.mse for run in mine]), np.array([run.mse for run in base])
        )[0]
        times[name, rule] = median_seconds(mine) / median_seconds(base)
print(f"{'MSE / balance (x time)':18}" + "".join(f"{name:>24}" for name in SCENES))
for rule in RULES:
    cells = (
        f"{ratios[name, rule]:.3f} ({ratios[name, rule] * times[name, rule]:.3f})"
        for name in SCENES
    )
    print(f"{rule:22}" + "".join(f"{cell:>24}" for cell in cells))

# %%
# One panel per scene. Hollow: times the time it took, which is the ratio at equal time
# if error falls as one over time.
figure, axes = plot.canvas(1, 4, 18, 5.5, sharey=True)
places = np.arange(len(RULES))[::-1]
for axis, (name, about) in zip(axes[0], SCENES.items(), strict=True):
    equal = np.array([ratios[name, rule] for rule in RULES])
    timed = equal * [times[name, rule] for rule in RULES]
    axis.plot(equal, places, "o", color="tab:blue", label="equal samples")
    axis.plot(
        timed,
        places,
        "o",
        color="tab:red",
        fillstyle="none",
        label="equal time (error x time)",
    )
    axis.axvline(1, color="0.35", linestyle="--", label="balance heuristic")
    axis.set_xscale("log")
    axis.set_yticks(places, RULES)
    axis.set_xlabel("MSE / MSE of the balance heuristic")
    axis.set_title(about.title, fontsize=10)
    axis.xaxis.set_major_formatter(lambda x, _: f"{x:g}")
    axis.xaxis.set_minor_formatter(
        lambda x, _: f"{x:g}" if f"{x:.0e}"[0] in "25" else ""
    )
    axis.grid(axis="x", alpha=0.3, which="both")
    axis.legend(fontsize=8)
axes[0, 0].set_ylabel("rule")
opts.save(
    figure,
    "Rules compared",
    f"""Mean squared error over that of the balance heuristic (one light and one BRDF
    sample), {opts.spp} camera samples per pixel, pilot included, {len(SEEDS)} seed(s),
    images of half the usual size. Left of the line a rule wins. auto is second-moment
    with numbers of samples that follow the variance.""",
)
