"""Product sampling by resampling: of M light samples take one, in proportion to what it would reflect if it were seen.

Candidates x_j come from light sampling; with the target ``g = mean over channels of f_r L |n.wi|``, which leaves out
visibility, x_k is taken in proportion to the weights ``v_j = g(x_j) / p_l(x_j)``. Then for any f that is 0 where g is 0

    E[f(x_k) / p_l(x_k) * mean(v) / v_k] = integral of f

(Talbot, Cline and Egbert 2005; Burke, Ghosh and Heidrich 2005). As M grows, x_k follows the product of BRDF and light,
at the cost of M evaluations and one occlusion ray. Known failures: shadows, of which the target knows nothing; lobes
so sharp that no candidate falls into them, where mean(v) is a rare spike.

The density of x_k has no closed form. MIS weights need none: they must add up to 1 in each direction, whatever they
are, so that of light sampling stands in for it, and the factor ``mean(v) / v_k`` multiplies the radiance. That rules
out whatever takes the stand-in for the density: curves of V(w) from one pilot, and the optimal combiners.

What it saves: docs/results.md, *Several techniques*.
"""

from dataclasses import dataclass

import numpy as np

import dmis
from dmis.base.vectors import take
from dmis.brdf.lobe import Directions
from dmis.estimator.mis import LIGHT
from dmis.fit.fixed import Fixed
from dmis.light.light_sample import LightSample

CANDIDATES = 8
"""M, number of candidates: more of them gain little, because the shadows stay."""
_PLASTIC = 1.32471795724474602596
SHIFTS = (np.arange(CANDIDATES)[:, None] / np.array([_PLASTIC, _PLASTIC**2]) % 1).astype(np.float32)[..., None]
"""Shifts from one candidate's numbers to the others', points of the R2 sequence: each is uniform, together they cover
the light. The estimate stays unbiased, because it is linear in the candidates once the choice is averaged over.
"""


def resampled(surface, light, u):
    """Return one of M light samples for each of the points; `u` is ``(3, N)``, the last for the choice."""
    weights = np.stack([_weight(surface, light.sample(surface.p, _shifted(u, shift))) for shift in SHIFTS])
    cumulative = np.cumsum(weights, axis=0)
    total = cumulative[-1]
    chosen = np.minimum((cumulative <= u[2] * total).sum(axis=0), CANDIDATES - 1)
    weight = np.take_along_axis(weights, chosen[None], axis=0)[0]
    possible = weight > 0
    factor = np.divide(total, CANDIDATES * weight, out=np.zeros_like(total), where=possible)
    light_sample = light.sample(surface.p, _shifted(u, SHIFTS[chosen, :, 0].T))
    return LightSample(
        light_sample.wi,
        light_sample.distance,
        light_sample.radiance_at(None) * factor,
        light_sample.pdf,
        light_sample.emits & possible,
    )


def _shifted(u, shift):
    """Return the first two rows of `u`, moved by `shift` on the torus."""
    moved = u[:2] + shift
    return moved - (moved >= 1)


def _weight(surface, light_sample):
    """Return g / p_l of light samples, ``(N,)``."""
    weight = np.zeros(len(light_sample.pdf), np.float32)
    index = np.flatnonzero(light_sample.emits & surface.same_side(light_sample.wi) & (light_sample.pdf > 0))
    if len(index):
        lit = surface.take(index)
        directions = Directions(lit, take(light_sample.wi, index))
        reflected = (lit.eval(directions) * light_sample.radiance_at(index)).mean(axis=0)
        weight[index] = reflected * directions.cos_i / light_sample.pdf.take(index)
    return weight


@dataclass(frozen=True)
class Resampled(Fixed):
    """Resample light samples in proportion to what they add (RIS), in place of light sampling: ``resampled:0.5``."""

    techniques: tuple[str, ...] = ("resampled", "brdf")


# cost of a sample before its ray: 2.3 on the teapot, 1.8 and 1.9 on the killeroos, 3.6 on tt, whose candidates look up
# a sky; where all samples are resampled, in large batches, half as much
dmis.register_technique(
    dmis.Technique("resampled", "resampled", resampled, LIGHT.pdf, numbers=3, exact=False, cost=2.3)
)
dmis.register_rule("resampled", Resampled)
