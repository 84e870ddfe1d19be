"""A statistic of one's own: the largest shading sample of each pixel. The rule takes more samples where it is large.

    python -m dmis render killeroo-gold --plugin examples/extending/largest.py --rule largest -o gold.exr

The samples of the pilot are not in the image, so the image stays unbiased.
"""

import numpy as np

import dmis
from dmis.base.patches import pixels_together
from dmis.base.vectors import take


class Largest:
    wants = dmis.Wants(sums="pixels")  # a maximum must not be summed over patches

    def __init__(self, pixels, shading_samples):
        self.largest = np.zeros(pixels)

    def add(self, records, radiance, count):
        # the batch has `count` camera samples of each pixel, all pixels before the next sample
        pixel = np.arange(radiance.shape[1]) % len(self.largest)
        for record in records:
            # value = f / p_w by the balance heuristic, times the throughput of the path
            np.maximum.at(self.largest, take(pixel, record.sample), record.value.mean(0))

    def sums(self):
        return {"largest": self.largest}


class ByLargest(dmis.Rule):
    def rounds(self, budget):
        film = yield budget.pilot(0.5, budget.spp // 4, Largest)
        largest = pixels_together(film.sums["largest"], budget.shape)
        yield budget.final(dmis.Fit(0.5, samples=largest + largest.mean() + 1e-9), budget.spp // 4)


dmis.register_rule("largest", ByLargest)
