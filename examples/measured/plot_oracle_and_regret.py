"""
Oracle and regret
=================

How good could weights be at all? From thousands of samples the variance curve of every
patch is known, and with it the best weight: the oracle. A rule that sees six samples is
judged by what it loses to that: the regret, patch by patch, the share of the oracle's
saving that it reaches, and the share of patches in which it does harm.
"""

import dmis
from dmis import plot
from dmis.examples.gallery import SCENES, options
from dmis.experiment.report.tables import saving_text
from dmis.variance.curves import HALF

opts, _ = options("plot_oracle_and_regret", __doc__)
RULES = {
    "thesis, shares": "thesis:weigh=samples",
    "second-moment": "second-moment:cost=no",
    "unguarded": "second-moment:cost=no,guard=0",
}

# %%
# The oracle of each scene, at half of the usual size; and the weights of the rules,
# which need their pilots only.
figure, axes = plot.canvas(4, 2 + len(RULES), 21, 14)
told = []
for line, (name, about) in zip(axes, SCENES.items(), strict=True):
    scene = opts.scene(name, 2 * opts.shrink)
    same = {
        "parallel": opts.threads,
        "compensation": 0,
    }  # of the sky, which shares are learned for
    oracle = dmis.make_oracle(scene, opts.pick(16, 512), progress=opts.progress, **same)
    result = dmis.render(scene, "auto", opts.pick(8, 32), seed=1, parallel=opts.threads)
    plot.picture(line[0], result.image, about.title)
    height, width = oracle.variance.shape[1:]
    covered = (0, height * oracle.patch), (0, width * oracle.patch)
    shown = plot.weights(line[1], oracle.best(), "best weights", covered)
    possible = oracle.variance.min(axis=0).sum() / oracle.variance[HALF].sum()
    parts = [f"{name}: best {possible:.2f} of w = ½"]
    for axis, (title, rule) in zip(line[2:], RULES.items(), strict=True):
        weight = dmis.render(scene, rule, 8, seed=1, **same).weight
        regret = oracle.regret(weight)
        harm, error = oracle.harm(weight)
        saving = saving_text(oracle.saving(weight))
        heat = plot.heat(
            axis,
            regret,
            f"{title}: {saving}, harm {harm:.1%}",
            covered,
            cmap="magma",
            vmin=0,
            vmax=1,
        )
        parts.append(f"{title}: {saving}, harm in {harm:.1%} ± {error:.1%}")
    plot.weight_bar(figure, shown, line[1], shrink=0.8)
    figure.colorbar(heat, ax=line[2:], label="regret / V(½)", shrink=0.8)
    told.append("; ".join(parts))
    print(told[-1], flush=True)
opts.save(
    figure,
    "Oracle and regret",
    f"""Best weights of each patch of 4x4 pixels, and what rules with a pilot of six
    samples lose to them: variance beyond the best, over that of w = 1/2. Saving: share
    of what the best weights save over w = 1/2. Harm: share of lit patches with more
    than 1.02 times the variance of w = 1/2. At equal samples, cost left out.
    {". ".join(told)}.""",
    panel=axes[2, 1],
)
