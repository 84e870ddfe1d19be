"""
The held-out scenes
===================

Veach's plates, a room with ten lights, and a living room in three lights, rendered by
BRDF samples alone, by light samples alone and by the balance heuristic, and the share
of light samples that dmis learns. Only one constant of dmis was chosen on these scenes.
"""

import dmis
from dmis import plot
from dmis.examples.gallery import options, print_canvas

opts, _ = options("plot_held_out_scenes", __doc__)
SPP, SHRINK = opts.pick(4, 64), opts.pick(32, 2, 1)
SIZES = {"veach-mis": (480, 360), "ten-lights": (400, 300)}
SIZES |= dict.fromkeys(("interior", "interior-glasses", "interior-door"), (320, 180))
TITLES = {
    "fixed:0": "BRDF samples",
    "fixed:1": "light samples",
    "balance": "balance heuristic",
}
RULES = (*TITLES, "auto")

# %%
# The variance of one camera sample is the variance of the image times the number of
# camera samples.
figure, axes = print_canvas(len(SIZES), 4, 1.2 * len(SIZES))
rows = [f"| scene | {' | '.join(RULES)} |", "|---" * (1 + len(RULES)) + "|"]
for line, (name, (width, height)) in zip(axes, SIZES.items(), strict=True):
    scene = dmis.load_scene(name, resolution=(width // SHRINK, height // SHRINK))
    results = {
        rule: dmis.render(
            scene, rule, SPP, seed=1, sampler="independent", parallel=opts.threads
        )
        for rule in RULES
    }
    means = " | ".join(
        f"{SPP * result.variance.mean(dtype=float):#.3g}" for result in results.values()
    )
    rows.append(f"| {name} {width // SHRINK}×{height // SHRINK} | {means} |")

    for axis, (rule, title) in zip(line, TITLES.items(), strict=False):
        plot.picture(axis, results[rule].image, title if name == "veach-mis" else "")
    share = plot.weights(line[-1], results["auto"].weight)
    line[0].set_ylabel(name)
axes[0, -1].set_title("auto: shares", fontsize="medium")
plot.weight_bar(figure, share, axes[:, -1], shrink=0.8)

print(*rows, f"{SPP} samples per pixel, seed 1.", sep="\n")
opts.save(
    figure,
    "The held-out scenes",
    f"""The same {SPP} camera samples per pixel, each with two BRDF samples, two light
    samples, or one of each; and the share of light samples that auto learns. Smooth
    surfaces that mirror large lamps favour BRDF samples, rough surfaces and small lamps
    light samples. The small lamps of ten-lights hang out of view, because the noise of
    their edges, which is that of the camera samples, would be nearly all of the
    variance.""",
    panel=axes[1, 2],
)
