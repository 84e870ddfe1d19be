"""A technique that a pilot taught: it samples directions in proportion to the light that arrived from them.

A statistic adds up the light from each cell of the sphere; the technique samples a sky that has these sums as radiance.

    python -m dmis render cornell --plugin examples/extending/guided.py --rule guided -o cornell.exr
"""

from functools import partial

import numpy as np

import dmis
from dmis.base.vectors import take


class Arriving:
    wants = dmis.Wants(directions=True)

    def __init__(self, pixels, shading_samples):
        self.light = np.zeros((8, 16, pixels))

    def add(self, records, radiance, count):
        pixel = np.arange(radiance.shape[1]) % self.light.shape[-1]
        for r in records:
            row = (np.arccos(r.wi[2].clip(-1, 1)) / np.pi * 7.99).astype(int)
            col = (np.arctan2(r.wi[1], r.wi[0]) / (2 * np.pi) % 1 * 15.99).astype(int)
            at = row, col, take(pixel, r.sample)
            np.add.at(self.light, at, r.value.mean(0) / (np.hypot(*r.wi[:2]) + 0.1))

    def sums(self):
        return {"light": self.light}


def sample(sky, surface, light, u):
    return light.hit(surface.p, sky.sample(surface.p, u).wi)


def pdf(sky, surface, directions, light_pdf):
    return sky.hit(surface.p, directions.wi).pdf


class Guided(dmis.Rule):
    def rounds(self, budget):
        film = yield budget.pilot(0.5, budget.spp // 4, Arriving)
        sky = dmis.EnvironmentLight(film.sums["light"].sum((2, 3))[..., None])
        own = dmis.Technique("table", "table", partial(sample, sky), partial(pdf, sky))
        fit = dmis.Fit((0.4, 0.4, 0.2))
        yield budget.final(fit, budget.spp // 4, techniques=("light", "brdf", own))


dmis.register_rule("guided", Guided)
