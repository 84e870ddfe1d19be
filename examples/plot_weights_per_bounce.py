"""
Weights per bounce
==================

Should the surface that the camera sees and the surfaces behind it divide their samples alike? The oracle's best weights
of either, what a rule learns for them from six samples, and how the variance falls with the weight, bounce by bounce.
Where the maps differ in colour, two weights save more than one; how much more is in the titles. It is little, because
the first bounce has most of the variance that weights can save, and because a patch whose first surface is matte sees
mostly others that are: hence one weight for all bounces is the default.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import partial

import numpy as np
from thesis import TABLES, options, show

import dmis
from dmis import plot
from dmis.curves import GRID, HALF, Curves
from dmis.fit import Fit, Pilot
from dmis.oracle import make_oracle

opts, _ = options(__file__, __doc__)
DEPTH = 4
PATHS = dmis.Settings(integrator="path", max_depth=DEPTH)
SPP = opts.pick(16, 256)


# %%
# A rule may gather any statistic in its pilot: here a curve for each bounce, to be looked at.
@dataclass(frozen=True)
class PerBounce:
    """No weights, only curves of each bounce, ``(bounces, G, rows, columns)``."""

    settings: Mapping[str, object] = field(default_factory=dict)
    pilot: Mapping[float, int] = field(default_factory=lambda: {0.5: SPP})
    statistic = partial(Curves, classes=DEPTH)

    def fit(self, pilot: Mapping[float, Pilot]) -> Fit:
        return Fit(0.5, {name: pilot[0.5].sums[name] for name in ("curve", "position")})


scenes = [dmis.load_scene("cornell", resolution=opts.pick((24, 24), (100, 100)))]
scenes += [opts.scene(name, TABLES[name] * opts.pick(8, 2)) for name in ("killeroo-gold", "tt")]
figure, axes = plot.canvas(len(scenes), 6, 25, 4 * len(scenes))
for line, scene in zip(axes, scenes, strict=True):
    about = {"settings": PATHS, "threads": opts.threads, "progress": show(scene.name)}
    oracle = make_oracle(scene, SPP, **about)
    rule = "second-moment:combiner=balance,bounces=separate,cost=no"
    learned = dmis.render(scene, rule, opts.pick(8, 64), seed=1, **about)
    bounces = dmis.render(scene, PerBounce(), SPP + 1, seed=2, **about)
    one, two = oracle.limit(), oracle.limit(apart=True)
    print(f"{scene.name:20} variance with the best weights, over that with 1/2: shared {one:.3f}, separate {two:.3f}")

    # Maps: the oracle's two, the rule's two.
    plot.picture(line[0], learned.image, scene.name)
    rows, columns = oracle.variance.shape[1:]
    covered = (0, rows * oracle.patch), (0, columns * oracle.patch)
    first, later = oracle.best_apart()
    plot.weights(line[1], first, f"best at the first surface\none weight: {one:.3f}", covered)
    plot.weights(line[2], later, f"best at later surfaces\ntwo weights: {two:.3f}", covered)
    plot.weights(line[3], learned.maps["patch"], "learned, first", covered)
    shown = plot.weights(line[4], learned.maps["later"], "learned, later", covered)
    plot.weight_bar(figure, shown, line[4], shrink=0.7)

    # Curves of the whole image, as shares of its variance at 1/2: what a bounce could save is how far it falls.
    curve, position = (bounces.maps[name].sum(axis=(-2, -1)) for name in ("curve", "position"))
    whole = position + curve[:, HALF].sum()
    for k, of in enumerate(curve):
        line[5].plot(GRID, of / whole, "o-", markersize=3, label=f"bounce {k + 1}")
    line[5].set_ylim(0, 2 * curve[:, HALF].max() / whole)
    line[5].set_title(f"not in weights' reach: {position / whole:.0%}", fontsize=10)
    line[5].set_xlabel("share of light samples w")
    line[5].set_ylabel("variance / that of the image at ½")
    line[5].legend(fontsize=8)
    paths = np.array([bounces.rays[f"bounce {k}"] for k in range(1, DEPTH)]) / bounces.rays["camera"]
    print(f"{'':20} paths that go on from each bounce: {', '.join(f'{share:.2f}' for share in paths)}")
opts.save(
    figure,
    "Weights per bounce",
    f"""Best and learned shares of light samples in path tracing, {DEPTH} surfaces deep: at the surface that the camera
    sees and at those behind it, for the pixel whose path met them. Numbers are the image's variance with the best
    weights over that with w = 1/2, for one weight and for two. Right: variance curves of the image, bounce by bounce.
    The rest of the variance, edges, textures and the paths themselves, no weight changes.""",
)
