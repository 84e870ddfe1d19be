"""Choice of the heuristic of the final pass, from the variance curves of several that one pilot estimates.

Each heuristic has weights that are best for it (`dmis.variance.curves`), so what counts is the error times time that
each reaches with its own. It is estimated from patches of `CHOICE_PATCH` pixels: large enough that noise in their
curves, of which the least is taken, flatters none; and one choice for the whole image, because within an image the
same one won almost everywhere in all scenes that were measured. The balance heuristic is never much worse than another
whose weights are not negative (Veach and Guibas 1995); the power heuristic is better where one technique has nearly all
of the integrand to itself: then weights need not go as far from w = 1/2, which saves rays.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from dmis.base.vectors import Array
from dmis.estimator.combiner import combiner_by_name

CHOICE_PATCH = 16
"""Side of the patches by which the heuristic is chosen, in pixels."""
MIN_GAIN_ERRORS = 3.0
"""Standard errors of a gain for which the first heuristic is left: more than for a patch's share, because a mistake
has its effect in the whole image.
"""


def check_choice(names: Sequence[str]) -> None:
    """Raise a ValueError unless the combiners differ, and have variance curves of their own."""
    for name in names:
        if not combiner_by_name(name).has_curves:
            raise ValueError(
                f"combiners to choose from must be heuristics: balance, power, maximum or cutoff; got {name!r}"
            )
    if len(set(names)) < len(names):
        raise ValueError(f"combiners to choose from must differ; got {', '.join(names)}")


def choose(variance: Array, cost: Array, area: Array) -> int:
    """Return the index of the heuristic with the least error times time, ``sum V sum C`` over patches.

    The first is left only for a gain of more than `MIN_GAIN_ERRORS` standard errors. These are taken from the squares
    of the patches' gains, as if their mean were 0: too large, so that a gain in a few patches alone, which may be a few
    rare samples, is not significant.

    Parameters
    ----------
    variance, cost
        Of a camera sample at the best weights of each heuristic, ``(H, rows, columns)``.
    area
        Of patches, in pixels, ``(rows, columns)``.
    """
    v, c = variance * (area / area.sum()), cost * (area / area.sum())
    of_patches = v * c.sum(axis=(1, 2), keepdims=True)
    gains = of_patches - of_patches[0]
    total, error = gains.sum(axis=(1, 2)), np.sqrt((gains * gains).sum(axis=(1, 2)))
    significant = total < -MIN_GAIN_ERRORS * error
    significant[0] = True
    return int(np.where(significant, total, np.inf).argmin())
