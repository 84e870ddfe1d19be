"""
Error against time
==================

What a rule is worth shows over time: its pilot and its fit have to be paid before its
weights can pay. On the four scenes, the root mean squared error of every rule at four
budgets over the seconds that they took, and how low the best weights of all would bring
the balance heuristic: the oracle.
"""

import dmis
from dmis import plot
from dmis.examples.gallery import SCENES, options
from dmis.experiment.convergence import gains
from dmis.experiment.report.plots import error_lines

opts, _ = options("plot_error_vs_time", __doc__)
RULES = ("balance", "pbrt", "thesis:weigh=samples", "second-moment", "auto")
BUDGETS = opts.pick((8, 32), (16, 32, 64, 128))
SEEDS = range(opts.pick(2, 3))

# %%
# At half of the usual size, because there is so much to render. Rules take turns, so
# that all meet the same machine.
figure, axes = plot.canvas(2, 4, 22, 10, sharey="col")
sentences = []
for column, (name, about) in zip(axes.T, SCENES.items(), strict=True):
    scene = opts.scene(name, 2 * opts.shrink)
    reference = opts.reference(scene)
    known = {"parallel": opts.threads, "progress": opts.progress}
    oracle = dmis.make_oracle(
        scene, opts.pick(32, 512), compensation=0, **known
    )  # as balance samples skies
    budgets = [(rule, spp) for spp in BUDGETS for rule in RULES]
    runs = dmis.measure(
        scene,
        budgets,
        SEEDS,
        reference,
        sampler="independent",
        parallel=opts.threads,
        progress=opts.progress,
    )
    for axis, over in zip(column, ("seconds", "rays"), strict=True):
        error_lines(axis, runs, over, oracle)
    column[0].set_title(about.title, fontsize=11)

    # %%
    # Lines of independent samples fall as N^-1/2; over seconds what is constant bends
    # them.
    print(
        f"{name}: best weights leave {oracle.limit():.3f} of the balance heuristic's"
        " variance"
    )
    print(f"    {'rule':14} {'MSE / balance in equal time':>28}")
    times = {
        gain.rule: gain.mse.equal_time
        for gain in gains(runs)
        if gain.spp == BUDGETS[-1]
    }
    for rule in RULES:
        print(f"    {rule:14} {times[rule]:28.2f}")
    sentences.append(f"{name} {times[RULES[2]]:.2f} and {times['auto']:.2f}")
figure.legend(*axes[0, 0].get_legend_handles_labels(), loc="outside right center")
opts.save(
    figure,
    "Error against time",
    f"""Root mean squared error over wall seconds (above; pilot and fit included) and
    over rays (below), at {", ".join(map(str, BUDGETS))} camera samples per pixel,
    {len(SEEDS)} seeds, images of half the usual size. Bands go from the lowest to the
    highest seed. Dotted: the slope of N^-1/2. Dashed: the best weights there are, in
    the time and rays of the balance heuristic; auto can get below it, because it also
    spreads samples over the image and compensates skies. MSE of thesis (shares) and
    auto at {BUDGETS[-1]} samples, over that of the balance heuristic in equal time:
    {"; ".join(sentences)}.""",
)
