"""Moments that the rules of this folder gather in their pilots of one light and one BRDF sample towards each light."""

import numpy as np

from dmis.base.vectors import TINY, take


class PilotMoments:
    """Mean ``m1`` and second moment ``m2`` of sums over a camera sample's shading samples, in grey: ``(C, P)`` each.

    A `dmis.estimator.records.Statistic`. Emission that the camera sees and delta lights are left out, because no weight
    changes them.
    """

    size = 2
    """C, number of sums of a camera sample."""

    def __init__(self, pixels: int, shading_samples: int) -> None:
        self.shading_samples = shading_samples
        self.n = 0
        self.m1, self.m2 = np.zeros((2, self.size, pixels))

    def values(self, k, x, r_l, r_b):
        """Return what samples of technique k add to each sum, ``(C, N)``; x is ``f / q / S``, r are ``p / (2 q)``."""
        raise NotImplementedError

    def add(self, records, radiance, count) -> None:
        """See `dmis.estimator.records.Statistic.add`."""
        self.n += count
        total = np.zeros((self.size, radiance.shape[1]))
        every = np.arange(radiance.shape[1])
        for record in records:
            x = record.value.mean(axis=0) / self.shading_samples
            r_l, r_b = record.pdf / np.maximum(record.pdf.sum(axis=0), TINY)
            total[:, take(every, record.sample)] += self.values(record.technique_index, x, r_l, r_b)
        per_sample = total.reshape(self.size, count, -1)
        self.m1 += per_sample.sum(axis=1)
        self.m2 += np.square(per_sample).sum(axis=1)

    def sums(self):
        """Return ``m1`` and ``m2`` per camera sample."""
        return {"m1": self.m1 / self.n, "m2": self.m2 / self.n}


class SingleTechnique(PilotMoments):
    """Moments of f / p_k, which each technique estimates alone: light sampling, BRDF sampling."""

    def values(self, k, x, r_l, r_b):
        """See `PilotMoments.values`."""
        alone = np.zeros((2, len(x)))
        # f / p_k = (f / q) / (2 r_k), and there are S / 2 samples of each technique
        alone[k] = x / np.maximum((r_l, r_b)[k], 1e-6)
        return alone
