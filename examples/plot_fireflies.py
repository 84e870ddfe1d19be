"""
Fireflies, and what it costs to remove them
===========================================

BRDF sampling alone meets a small lamp rarely, and what it then brings is worth many samples: fireflies. A clamp on the
camera samples removes them, and so does the median of several renders. Both remove light. The error has two parts
then, noise and bias, and more samples make only the first smaller. Sampling the lamp removes the fireflies, and no
light.
"""

import numpy as np
from thesis import options

import dmis
from dmis import plot
from dmis.fireflies import median_of_means
from dmis.image import tonemap
from dmis.metrics import mse, squared_error

opts, _ = options(__file__, __doc__)
RULE, RENDERS = "fixed:0", 5
CLAMPS = opts.pick((1.0, 16.0), (0.5, 1.0, 2.0, 4.0, 8.0, 16.0, 32.0, 64.0))
PER = opts.pick(4, 16)  # camera samples of each of the renders; all that follows has as many in all

# %%
# The share of light that is missing is the bias, over the mean of the reference; its standard error is that of noise.
scene = opts.scene("killeroo-gold", 2 * opts.shrink)
reference = opts.reference(scene, opts.pick(64, 512))


def about(result):
    """Share of light missing, its standard error, mean squared error, pixels that look like fireflies."""
    light, pixels = reference.mean.mean(), result.weight.size
    missing = (reference.mean - result.image).mean() / light
    error = np.sqrt((result.variance.mean() + reference.mse) / pixels) / light
    return missing, error, mse(result.image, reference.first, reference.second), int(result.fireflies.sum())


def render(rule, seed, spp, clamp=None):
    return dmis.render(scene, rule, spp, seed=seed, settings=dmis.Settings(clamp=clamp), threads=opts.threads)


results = {"as it is": render(RULE, 1, PER * RENDERS)}
for clamp in CLAMPS:
    results[f"clamp {clamp:g}"] = render(RULE, 1, PER * RENDERS, clamp)
results[f"median of {RENDERS}"] = median_of_means([render(RULE, 1 + k, PER) for k in range(RENDERS)])
results["balance heuristic"] = render("balance", 1, PER * RENDERS)
found = {name: about(result) for name, result in results.items()}
for name, (missing, error, square, pixels) in found.items():
    print(f"{name:18} light missing {100 * missing:6.2f} ± {100 * error:.2f} %, MSE {square:.2e}, {pixels} fireflies")

# %%
# Pictures above; below, light that is missing and error, against the clamp.
shown = ["as it is", f"clamp {CLAMPS[len(CLAMPS) // 2 - 1]:g}", f"median of {RENDERS}", "balance heuristic"]
figure, axes = plot.canvas(2, 4, 18, 8.5)
for axis, name in zip(axes[0], shown, strict=True):
    axis.imshow(tonemap(results[name].image))
    axis.set_title(f"{name}: {100 * found[name][0]:.1f} % of the light missing", fontsize=10)
    axis.set_axis_off()
for axis, name in zip(axes[1, :2], ("as it is", shown[1]), strict=True):
    errors = np.sqrt(np.maximum(squared_error(results[name].image, reference.first, reference.second), 0))
    axis.imshow(errors, vmax=1, cmap="magma")
    axis.set_title(f"error of {name}", fontsize=10)
    axis.set_axis_off()
values = np.array([found[f"clamp {clamp:g}"] for clamp in CLAMPS])
for axis, column, title in (
    (axes[1, 2], 0, "share of the light that is missing"),
    (axes[1, 3], 2, "mean squared error"),
):
    bars = 2 * values[:, 1] if column == 0 else None
    axis.errorbar(CLAMPS, values[:, column], bars, marker="o", markersize=4, capsize=3, label="clamp (biased)")
    for name, colour in zip((shown[0], *shown[2:]), ("0.35", "tab:red", "tab:green"), strict=True):
        axis.axhline(found[name][column], color=colour, linestyle="--", label=name)
    axis.set_xscale("log", base=2)
    axis.set_xticks(CLAMPS, [f"{clamp:g}" for clamp in CLAMPS])
    axis.set_xlabel("clamp (radiance)")
    axis.set_title(title, fontsize=10)
    axis.legend(fontsize=8)
axes[1, 3].set_yscale("log")
opts.save(
    figure,
    "Fireflies, and what it costs to remove them",
    f"""The golden creature by BRDF sampling alone, {PER * RENDERS} camera samples per pixel in every image: as it is,
    with camera samples clamped, as the pixel-wise median of {RENDERS} renders of {PER}, and by the balance heuristic,
    which samples the lamp too. Clamp and median are biased: what they remove is light. Bars are ± 2 standard errors of
    the noise.""",
)
