"""Exercise 24 (hard): the radiance of paths, each light once.

At each surface of a path, light samples and BRDF samples estimate the direct light. The
next ray of the path may also hit a lamp. Add up the path's radiance without counting
light twice.

Copy this file to mine_24.py, and check it:
``python docs/exercises/checks 24 mine_24.py``.
"""

import numpy as np


def radiance(gathered, emitted, factor, mirrored):
    """Return the radiance of each path, ``(N,)``.

    Parameters
    ----------
    gathered
        Direct light at each surface, from both techniques together, ``(D, N)``.
    emitted
        Light that each surface itself emits back along the path, ``(D, N)``.
    factor
        f cos / p of the step from each surface to the next one, ``(D, N)``; 0 after the
        end of the path.
    mirrored
        Whether a mirror reflects the path at each surface, bool ``(D, N)``; there
        `gathered` is 0.
    """
    total, throughput = np.zeros_like(gathered[0]), np.ones_like(gathered[0])
    for k in range(len(gathered)):
        here = gathered[k] + emitted[k]  # wrong: twice the light
        total = total + throughput * here
        throughput = throughput * factor[k]
    return total
