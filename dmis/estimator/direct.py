"""Direct lighting: what surface points reflect of the lights, by multiple importance sampling.

The radiance reflected at p towards wo is the integral over wi of::

    f = f_r(wo, wi) L(wi) |n.wi| V(wi)                                  (docs/theory.md, Eq. 1)

with the BRDF f_r, the light's radiance L, and the visibility V, 0 or 1. Each light is sampled by two techniques or
more, S shading samples in all. With the densities p_l of light sampling, p_b of BRDF sampling, and the share w of
light samples, the balance heuristic estimates the integral by the mean over the shading samples of::

    f / p_w,    p_w = w p_l + (1 - w) p_b                               (Veach 1997, Eq. 9.8; docs/theory.md, Eq. 8)

and any other combiner by that of ``W f / (w_k p_k)``, W being its MIS weight of a sample of technique k. A *tilt* t
takes the place of w in p_w, while shares of samples stay: a sample of technique k counts t_k / w_k times
(docs/theory.md, Eq. 8a).
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from dmis.base.vectors import Array, Index, Selection, accumulate, compose, indices, size, take, take_optional
from dmis.brdf.lobe import Directions
from dmis.estimator.batch import Batch, Samples, Vertices
from dmis.estimator.draws import Draw, draws, shading_samples
from dmis.estimator.records import Record
from dmis.light.light_sample import LightSample
from dmis.scene.shading_points import ShadingPoints

SHADOW_END = np.float32(1 - 1e-4)
"""Occlusion rays end a little before the light, whose own surface must not shadow it."""


def add_direct_light(batch: Batch, vertices: Vertices) -> None:
    """Add the light that the vertices reflect, and that comes through from their other side."""
    for draw in draws(batch, vertices):
        if draw.light.delta:
            _add_delta_light(batch, draw)
            continue
        for samples in shading_samples(batch, draw):
            _add_samples(batch, draw, samples)


def _add_samples(batch: Batch, draw: Draw, samples: Samples) -> None:
    """Add ``f / p_w / S`` of each shading sample to its vertex."""
    vertices, k, light_sample = draw.vertices, samples.technique_index, samples.light_sample
    over_s = draw.over_probability / np.float32(batch.settings.shading_samples)
    lit = facing_light(samples.surface, light_sample)  # elsewhere f = 0
    if lit is not None and len(lit) == 0:
        return
    surface = samples.surface.take(lit)
    wi = take(light_sample.wi, lit)
    shares, tilt = take(samples.shares, lit), take_optional(samples.tilt, lit)
    directions = Directions(surface, wi)

    # p_l, p_b: the density of every technique in the sampled direction, whichever picked it
    light_pdf = take(light_sample.pdf, lit)
    pdf = [technique.pdf(surface, directions, light_pdf) for technique in batch.techniques]
    accepted = pdf[k] > 0  # others count as samples of value 0

    # 1 / p_w,  p_w = w p_l + (1 - w) p_b   (Veach 1997, Eq. 9.8);  of other heuristics  W / (w_k p_k)
    effective = [w * p for w, p in zip(shares if tilt is None else tilt, pdf, strict=True)]
    over_p_w = batch.combiner.heuristic(effective, k)
    if tilt is not None:
        # W / (w_k p_k) = (t_k / w_k) / (t_l p_l + t_b p_b),  W of a heuristic with the shares t   (Eq. 8a)
        over_p_w *= tilt[k] / shares[k]

    # f_r |n.wi| / p_w / S: what f / p_w would be with L = V = 1
    weighted_cosine = over_p_w * directions.cos_i
    weighted_cosine *= over_s
    unlit = surface.eval(directions) * (weighted_cosine * accepted)

    # V, where the rest is not 0
    brightest = unlit[0] if len(unlit) == 1 else unlit.max(axis=0)
    visible: Selection | None = indices(brightest > 0)
    f_over_p_w = np.zeros((3, 0), np.float32)
    if size(visible, 1):
        shadow_ray = take(surface.p, visible), take(wi, visible), _shadow_ends(light_sample, compose(lit, visible))
        camera_sample = compose(vertices.sample, compose(samples.vertex, compose(lit, visible)))
        occluded = batch.caster.occluded(batch.techniques[k].rays, *shadow_ray, camera_sample)
        visible = compose(visible, indices(~occluded))
        lit_and_visible = compose(lit, visible)

        # f / p_w / S,  f = f_r L |n.wi| V; L, such as a sky's, is looked up only where V = 1
        f_over_p_w = take(unlit, visible) * light_sample.radiance_at(lit_and_visible)
        accumulate(vertices.radiance, f_over_p_w, compose(samples.vertex, lit_and_visible))

    if batch.records is not None:
        pdf_all = np.stack([np.where(accepted, p, np.float32(j == k)) for j, p in enumerate(pdf)])
        _record(batch, vertices, samples, lit, pdf_all, f_over_p_w, visible)


def _record(
    batch: Batch,
    vertices: Vertices,
    samples: Samples,
    lit: Selection | None,
    pdf: Array,
    contribution: Array,
    visible: Selection | None,
) -> None:
    """Write down the samples `lit`, as they arrive at the camera, for statistics.

    Parameters
    ----------
    pdf
        Densities of all techniques, ``(K, L)``, of the L samples `lit`.
    contribution, visible
        ``W f / (w_k p_k S)``, ``(3, V)``, and which V of those L samples have it. The others' is 0.
    """
    assert batch.records is not None
    value = np.zeros((3, pdf.shape[1]), np.float32)
    value[:, slice(None) if visible is None else visible] = contribution * np.float32(batch.settings.shading_samples)
    vertex = compose(samples.vertex, lit)
    if vertices.throughput is not None:
        value *= take(vertices.throughput, vertex)
    camera_sample = compose(vertices.sample, vertex)
    record = Record(samples.technique_index, samples.key, samples.sample_index, camera_sample, value, pdf)
    if batch.records.directions:
        n = pdf.shape[1]
        wi, p = (np.broadcast_to(take(a, lit), (3, n)) for a in (samples.light_sample.wi, samples.surface.p))
        record = replace(record, wi=wi, p=p, surface=samples.surface.take(lit))
    batch.records.append(record)


def _add_delta_light(batch: Batch, draw: Draw) -> None:
    """Add ``f_r L |n.wi| V`` of a light that has a single direction, which no other technique finds."""
    vertices, index = draw.vertices, draw.index
    surface = vertices.surface.take(index)
    light_sample = draw.light.sample(surface.p)
    lit: Selection | None = indices(light_sample.emits & surface.same_side(light_sample.wi))
    visible: np.ndarray | bool = True
    if draw.traced and size(lit, 1):
        shadow_ray = take(surface.p, lit), take(light_sample.wi, lit), _shadow_ends(light_sample, lit)
        camera_sample = compose(vertices.sample, compose(index, lit))
        visible = ~batch.caster.occluded("delta", *shadow_ray, camera_sample)
        if 2 * np.count_nonzero(visible) < len(visible):  # few: to gather them takes less time than to shade all
            lit, visible = compose(lit, np.flatnonzero(visible)), True
    if not size(lit, 1):
        return
    surface = surface.take(lit)
    directions = Directions(surface, take(light_sample.wi, lit))
    reflected = surface.eval(directions) * (directions.cos_i * draw.over_probability) * light_sample.radiance_at(lit)
    accumulate(vertices.radiance, reflected * visible, compose(index, lit))


def facing_light(surface: ShadingPoints, light_sample: LightSample) -> Index | None:
    """Return the indices of directions that meet the light and for which f may be positive; None: all."""
    if 2 * np.count_nonzero(light_sample.emits) < len(light_sample.emits):  # few, as of BRDF samples and a small light
        met = np.flatnonzero(light_sample.emits)
        return met[surface.take(met).same_side(take(light_sample.wi, met))]
    return indices(light_sample.emits & surface.same_side(light_sample.wi))


def _shadow_ends(light_sample: LightSample, index: Selection | None) -> Array:
    """Return how far occlusion rays of the light samples `index` reach, ``(N,)``."""
    ends = take(light_sample.distance, index) * SHADOW_END
    return np.broadcast_to(ends, (size(index, light_sample.wi.shape[1]),))
