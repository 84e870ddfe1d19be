"""Exercise 24 (hard): the radiance of paths, each light once.

At each surface of a path, light samples and BRDF samples have gathered what lamps send
there. The path's own next ray may meet a lamp, too. Add up what counts.

Copy this file to mine.py, and check it: ``python docs/exercises/checks 24 mine.py``.
"""

import numpy as np


def radiance(gathered, emitted, factor, mirrored):
    """Return the radiance of each path, ``(N,)``.

    Parameters
    ----------
    gathered
        Direct light that both techniques gathered at each surface, ``(D, N)``.
    emitted
        Light that each surface itself sends back along the path, ``(D, N)``.
    factor
        f cos / p of the step from each surface to the next one, ``(D, N)``; 0 where the
        path ended.
    mirrored
        Whether a mirror sent this step, bool ``(D, N)``. Mirrors gather nothing.
    """
    total, throughput = np.zeros_like(gathered[0]), np.ones_like(gathered[0])
    for k in range(len(gathered)):
        here = gathered[k] + emitted[k]  # wrong: twice the light
        total = total + throughput * here
        throughput = throughput * factor[k]
    return total
