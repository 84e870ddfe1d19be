"""A metric of one's own: the mean difference of each render from the reference.

The halves of a reference are independent, so its noise does not bias means of (x - r1) (x - r2), either.
"""

import dmis


def bias(image, first, second):
    return float((image - (first + second) / 2).mean())


scene = dmis.load_scene("teapot-area-light", resolution=(32, 24))
reference = dmis.make_reference(scene, 64)
errors = {}


def record(run, result):
    errors.setdefault((run.rule, run.spp), []).append(bias(result.image, reference.first, reference.second))


budgets = [("balance", 8), ("thesis", 8)]
dmis.measure(scene, budgets, range(3), reference, record=record)
