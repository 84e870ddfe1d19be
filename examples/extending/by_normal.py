"""A rule that looks at the scene: pixels with about the same angle between normal and z axis get the same share.

python -m dmis render tt --plugin examples/extending/by_normal.py --rule by-normal -o tt.exr
"""

import numpy as np

import dmis


class ByNormal(dmis.Rule):
    pilot = {0.3: 2, 0.5: 2, 0.7: 2}
    needs_features = "pixels"

    def __init__(self, bins=6):
        self.bins = bins

    def fit(self, pilot):
        # angle between normal and z axis, as the number of a bin
        z = pilot[0.5].features["normal"][2]
        angle = np.arccos(z.clip(-1, 1)) / np.pi
        number = np.minimum(angle * self.bins, self.bins - 1).astype(int)
        # the share with the least variance in each bin
        noise = (film.variance().mean(2) for film in pilot.values())
        sums = [np.bincount(number.ravel(), v.ravel(), self.bins) for v in noise]
        best = np.array(list(pilot))[np.argmin(sums, axis=0)]
        return dmis.Fit(best[number])


dmis.register_rule("by-normal", ByNormal)
