"""
Oracle and regret
=================

How much can shares of light samples save at best? Thousands of samples give the
variance curve of every patch, and so its best share: the oracle. The figure judges
rules that learn from six samples in three ways: by the regret of each patch, by the
fraction of the oracle's saving that the rule reaches, and by the fraction of harmed
patches.
"""

import numpy as np

import dmis
from dmis import plot
from dmis.examples.gallery import SCENES, options, print_canvas
from dmis.variance.curves import HALF

opts, _ = options("plot_oracle_and_regret", __doc__)
RULES = {
    "thesis:weigh=samples": "thesis:weigh=samples",
    "second-moment": "second-moment:cost=no",
}

# %%
# Compute the oracle of each scene at half of the usual size, and the shares of the
# rules, which need only their pilots. Without sky compensation shares are learned for
# skies, too.
figure, axes = print_canvas(2 + len(RULES), 4, 5.4, width_ratios=[1, 1.33, 1.33, 1.8])
captions = []
for column, name in zip(axes.T, SCENES, strict=True):
    scene = opts.scene(name, 2 * opts.shrink)
    same = {"parallel": opts.threads, "compensation": 0}
    oracle = dmis.make_oracle(
        scene, opts.pick(16, 1024), progress=opts.progress, **same
    )
    result = dmis.render(scene, "auto", opts.pick(8, 32), seed=1, parallel=opts.threads)
    plot.picture(column[0], result.image, name)
    height, width = oracle.variance.shape[1:]
    covered = 0, 0, width * oracle.patch, height * oracle.patch
    shown = plot.weights(column[1], oracle.best(), "", covered)
    half, least = oracle.variance[HALF], oracle.variance.min(axis=0)
    best = least.sum() / half.sum()
    sentence = [f"{name}: best {best:.2f} of w = 1/2"]
    for axis, (title, rule) in zip(column[2:], RULES.items(), strict=True):
        weight = dmis.render(scene, rule, 8, seed=1, **same).weight
        harm, error = oracle.harm(weight)
        variance = oracle.at(weight)
        left = oracle.mean(variance) / oracle.mean(half)
        limit = oracle.limit()
        share = (1 - left) / max(1 - limit, 1e-9)
        saving = f"saving {share:.0%}" if limit < 0.99 else "nothing to save"
        style = {"cmap": "magma", "vmin": 0, "vmax": 1}
        text = f"{saving}\nharm {harm:.0%}"
        excess = (variance - least) / np.maximum(half, 1e-30)
        regret = plot.heat(axis, excess, text, covered, **style)
        sentence.append(f"{title}: {saving}, harm in {harm:.1%} ± {error:.1%}")
    captions.append("; ".join(sentence))
    print(captions[-1], flush=True)
for axis, label in zip(
    axes[:, 0],
    ("image", "best shares", "thesis:\nweigh=samples", "second-moment"),
    strict=True,
):
    axis.set_ylabel(label)
plot.weight_bar(figure, shown, axes[:2], shrink=0.8)
figure.colorbar(regret, ax=axes[2:], label="regret / V(½)", shrink=0.8)
opts.save(
    figure,
    "Oracle and regret",
    f"""Best shares of each patch of 4x4 pixels, and the regret of rules with a pilot of
    six samples: variance beyond the best, over that of w = 1/2. Saving: part of what
    the best shares save over w = 1/2. Harm: part of the lit patches with more than 1.02
    times the variance of w = 1/2. At equal samples, cost left out.
    {". ".join(captions)}.""",
    panel=axes[1, 2],
)
