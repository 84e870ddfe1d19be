"""Direct lighting: what surface points reflect of the lights, by multiple importance sampling.

The radiance reflected at p towards wo is the integral over wi of::

    f = f_r(wo, wi) L(wi) |n.wi| V(wi)                                  (docs/theory.md, Eq. 1)

with the BRDF f_r, the light's radiance L, and the visibility V, 0 or 1. Each light is sampled by two techniques or
more, S shading samples in all. With the densities p_l of light sampling, p_b of BRDF sampling, and the share w of
light samples, the balance heuristic estimates the integral by the mean over the shading samples of::

    f / p_w,    p_w = w p_l + (1 - w) p_b                               (Veach 1997, Eq. 9.8; docs/theory.md, Eq. 8)

and any other combiner by that of ``W f / (w_k p_k)``, W being its MIS weight of a sample of technique k. A *tilt* t
takes the place of w in p_w alone, while shares of samples stay (docs/theory.md, Eq. 8a).
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from dmis.base.vectors import Selection, compose, indices, size, take
from dmis.brdf.cosines import Directions
from dmis.estimator.batch import Batch
from dmis.estimator.batching import accumulate, facing_light, shading_samples, take_optional, unoccluded
from dmis.estimator.mis import combiner_by_name
from dmis.estimator.samples import Samples, Vertices, record_samples
from dmis.estimator.technique import technique_by_name
from dmis.light.light import DeltaLight


def add_direct_light(batch: Batch, vertices: Vertices) -> None:
    """Add the light that the vertices reflect: of all lights, or of one that is picked for each vertex."""
    plan = batch.scene.plan
    sampled = plan.sampled_lights(batch.settings.lights, batch.settings.sky_compensation)
    lights = (*sampled, *plan.deltas)
    picked = None
    if batch.settings.one_light and len(lights) > 1:
        picked = batch.rng.integers(len(lights), size=vertices.radiance.shape[1], dtype=np.int16)
    # 1 / P(light): a light that is picked with probability 1 / n stands for n
    over_probability = np.float32(1 if picked is None else len(lights))
    subsets = None if vertices.path or vertices.beyond else batch.light_subsets
    for number, light in enumerate(lights):
        index, target = None if picked is None else indices(picked == number), vertices
        subset = subsets and subsets.of_light(min(number, len(sampled)), vertices.sample)  # delta lights share the last
        if subset:
            index, target = subset[0], replace(vertices, radiance=np.zeros_like(vertices.radiance))
        if index is not None and len(index) == 0:
            continue
        if light.delta:
            headlight = not vertices.path and number - len(sampled) in plan.headlights
            _add_delta_light(batch, target, light, index, over_probability, traced=not headlight)  # type: ignore[arg-type]
        else:
            key = (*vertices.path, number + len(lights) * vertices.beyond)
            for samples in shading_samples(batch, target, light, index, key):  # type: ignore[arg-type]
                _add_samples(batch, target, samples, over_probability)
        if subset:
            # sum of f / p_w over all m camera samples of a pixel ~ m / m' times that over the m' of the subset
            assert batch.subset_radiance is not None
            index, weight, block = subset
            values = target.radiance.take(index, axis=1) * weight
            batch.subset_radiance[block, :, compose(vertices.sample, index)] += values.T


def _add_samples(batch: Batch, vertices: Vertices, samples: Samples, over_probability: np.float32) -> None:
    """Add ``f / p_w / S`` of each shading sample to its vertex."""
    settings, k, light_sample = batch.settings, samples.technique_index, samples.light_sample
    techniques = [technique_by_name(name) for name in settings.techniques]
    over_s = over_probability / np.float32(settings.shading_samples)
    lit = facing_light(samples.surface, light_sample)  # elsewhere f = 0
    if lit is not None and len(lit) == 0:
        return
    surface, wi, shares = samples.surface.take(lit), take(light_sample.wi, lit), take(samples.shares, lit)
    tilt = take_optional(samples.tilt, lit)
    directions = Directions(surface, wi)

    # p_l, p_b: the density of every technique in the sampled direction, whichever picked it
    light_pdf = take(light_sample.pdf, lit)
    pdf = [sampling.pdf(surface, directions, light_pdf) for sampling in techniques]
    accepted = pdf[k] > 0  # others count as samples of value 0

    # 1 / p_w,  p_w = w p_l + (1 - w) p_b   (Veach 1997, Eq. 9.8);  of other heuristics  W / (w_k p_k)
    over_p_w = combiner_by_name(settings.combiner).weight(shares if tilt is None else tilt, pdf, k)
    if tilt is not None:
        # W / (w_k p_k) = (t_k / w_k) / (t_l p_l + t_b p_b),  W of a heuristic with the shares t   (Eq. 8a)
        over_p_w *= tilt[k] / shares[k]

    # f_r |n.wi| / p_w / S: what f / p_w would be with L = V = 1
    weighted_cosine = over_p_w * directions.cos_i
    weighted_cosine *= over_s
    unlit = surface.eval(directions) * (weighted_cosine * accepted)

    # V, where the rest is not 0
    visible: Selection | None = indices((unlit if len(unlit) == 1 else unlit.max(axis=0, keepdims=True))[0] > 0)
    f_over_p_w = np.zeros((3, 0), np.float32)
    if size(visible, 1):
        shadow_ray = take(surface.p, visible), take(wi, visible), take(take(light_sample.distance, lit), visible)
        camera_sample = compose(vertices.sample, compose(samples.vertex, compose(lit, visible)))
        visible = compose(visible, indices(unoccluded(batch, techniques[k].rays, *shadow_ray, camera_sample)))
        lit_and_visible = compose(lit, visible)

        # f / p_w / S,  f = f_r L |n.wi| V; L, such as a sky's, is looked up only where V = 1
        f_over_p_w = take(unlit, visible) * light_sample.radiance_at(lit_and_visible)
        accumulate(vertices.radiance, f_over_p_w, compose(samples.vertex, lit_and_visible))

    if batch.records is not None:
        pdf_all = np.stack([np.where(accepted, p, np.float32(j == k)) for j, p in enumerate(pdf)])
        record_samples(batch, vertices, samples, lit, pdf_all, f_over_p_w, visible)


def _add_delta_light(
    batch: Batch,
    vertices: Vertices,
    light: DeltaLight,
    index: Selection | None,
    over_probability: np.float32,
    traced: bool,
) -> None:
    """Add ``f_r L |n.wi| V`` of a light that has a single direction, which no other technique finds."""
    surface = vertices.surface.take(index)
    light_sample = light.sample(surface.p)
    lit: Selection | None = indices(light_sample.emits & surface.same_side(light_sample.wi))
    visible: np.ndarray | bool = True
    if traced and size(lit, 1):
        shadow_ray = take(surface.p, lit), take(light_sample.wi, lit), take(light_sample.distance, lit)
        visible = unoccluded(batch, "delta", *shadow_ray, compose(vertices.sample, compose(index, lit)))
        if 2 * np.count_nonzero(visible) < len(visible):  # few: to gather them takes less time than to shade all
            lit, visible = compose(lit, np.flatnonzero(visible)), True
    if not size(lit, 1):
        return
    surface = surface.take(lit)
    directions = Directions(surface, take(light_sample.wi, lit))
    reflected = surface.eval(directions) * (directions.cos_i * over_probability) * light_sample.radiance_at(lit)
    accumulate(vertices.radiance, reflected * visible, compose(index, lit))
