"""Solution of exercise 24: add emission at the first surface and after mirrors only."""

import numpy as np


def radiance(gathered, emitted, factor, mirrored):
    """Return the radiance of each path, ``(N,)``."""
    total, throughput = np.zeros_like(gathered[0]), np.ones_like(gathered[0])
    counts = np.ones(gathered[0].shape, bool)  # the camera gathers nothing
    for k in range(len(gathered)):
        total = total + throughput * (gathered[k] + np.where(counts, emitted[k], 0))
        throughput = throughput * factor[k]
        counts = mirrored[k]
    return total
