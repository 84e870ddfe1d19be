"""A sampler of one's own: the points of Roberts's R2 sequence, shuffled and shifted anew for each draw.

python -m dmis render teapot-area-light --plugin examples/extending/r2.py --sampler r2 -o teapot.exr
"""

import numpy as np

import dmis
from dmis.base.vectors import take

# the inverse plastic number and its square: Roberts's R2
STEP = np.array([[0.7548776662466927], [0.5698402909980532]])


class R2:
    def __init__(self, block):
        self.block, self.random = block, {}

    def start(self, pixel, number):
        self.pixel, self.number = pixel, number

    def draw(self, key, index, number=None):
        rng, spp = self.block.rng, self.block.stops[-1]
        if key not in self.random:
            # per draw an order, and a shift of each pixel (Cranley and Patterson 1976)
            shifts = rng.random((2, len(self.block.pixels)))
            self.random[key] = rng.permutation(spp), shifts
        order, shifts = self.random[key]
        i = take(self.number, index) if number is None else number
        k = i - i % spp + order[i % spp]
        u = (k * STEP + shifts[:, take(self.pixel, index)]) % 1
        return np.minimum(u, 1 - 2**-24).astype(np.float32)


dmis.register_sampler("r2", R2)
