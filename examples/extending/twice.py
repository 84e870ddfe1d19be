"""A rule of two rounds: the second takes more samples where the first is noisy. The image includes both.

    python -m dmis compare teapot-area-light --plugin examples/extending/twice.py --rules balance,twice \\
        --sampler independent --spp 32 --seeds 8 --resolution 64x48 -o twice

The error of ``twice`` is 0.52 ± 0.09 times the error of ``balance``.
"""

from dataclasses import replace

import numpy as np

import dmis
import dmis.filter


class Twice(dmis.Rule):
    settings = {"sampler": "independent"}

    def rounds(self, budget):
        half = budget.spp // 2
        first = budget.final(dmis.Fit(0.5), spent=budget.spp - half)
        film = yield replace(first, stage="pilot")
        noise = dmis.filter.gaussian(film.variance().mean(2), sigma=2, radius=8)
        yield budget.final(dmis.Fit(0.5, samples=np.sqrt(noise) + 1e-4), spent=half)


dmis.register_rule("twice", Twice)
