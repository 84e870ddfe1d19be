"""Rendering with a rule: pilot, fit, final pass, one image.

`dmis.pipeline.job` checks the arguments and decides what is rendered, `dmis.pipeline.passes` renders it, pass by pass.
The budget `spp` includes the pilot. Pilot and final image are both unbiased. Where the pilot is part of the image they
are averaged with weights fixed beforehand, their camera samples: so the result is unbiased although the weights were
learned. (Weighting by estimated variance would not be.)
"""

from __future__ import annotations

import os
import time
from collections import Counter
from collections.abc import Mapping
from typing import Any

import numpy as np

from dmis.base.vectors import Array
from dmis.estimator.cost import UNTRACED, rays_of_all_pixels
from dmis.estimator.settings import Settings, make_settings
from dmis.fit.rule import Rule
from dmis.pipeline.executor import Parallel
from dmis.pipeline.job import FinalPass, Job
from dmis.pipeline.passes import Observer, Passes
from dmis.pipeline.progress import Progress, reporting
from dmis.pipeline.result import Result
from dmis.samplers.streams import is_sequence
from dmis.scene.scene import Scene
from dmis.variance.moments import Film


def render(
    scene: Scene,
    rule: Rule | str | None = None,
    spp: int = 128,
    *,
    seed: int = 0,
    settings: Settings | None = None,
    parallel: Parallel = None,
    progress: Progress | bool | None = None,
    checkpoint: str | os.PathLike[str] | None = None,
    **options: Any,
) -> Result:
    """Render `scene`; the image depends on these arguments and on nothing in the machine.

    Parameters
    ----------
    rule
        A rule or its text, ``balance``, ``fixed:0.25``, ``thesis:patch=16``; see `dmis.fit.registry.RULES`. None:
        see `dmis.pipeline.job.default_rule`.
    spp, seed
        Camera samples per pixel, the rule's pilot included; seed, not negative.
    settings, options
        Estimator settings; or fields of `dmis.Settings` by name, which take the place of those of `settings`:
        ``sampler="stratified"``, ``preset="thesis"`` (`dmis.estimator.presets.PRESETS`). A rule has some of its own,
        such as its combiner; it is an error to ask for others here.
    parallel
        Number of threads (None: one per processor); ``dmis.Processes(n)``; or any `concurrent.futures.Executor`,
        Dask's ``Client.get_executor(pure=False)`` among them, which is not shut down.
    progress
        True for a bar (extra ``progress``), a widget in a notebook; or a function that is called in this thread after
        each tile, see `dmis.pipeline.progress.Progress`.
    checkpoint
        Folder that every finished tile is saved to; a render resumes from it if it exists. It is left there, because
        the image is not written yet: `dmis.remove_checkpoint` removes it. Several processes may share it.

    Raises
    ------
    ValueError
        If an argument is out of range, settings and rule disagree, a rule's weights are none, a pixel is infinite or
        NaN, or the checkpoint is damaged or of a different image.
    OSError
        If the checkpoint cannot be written; a ``ChildProcessError`` if workers keep dying.
    """
    job = Job.of(scene, rule, spp, seed, make_settings(settings, **options))
    return render_job(job, parallel, progress, checkpoint)


def render_job(
    job: Job,
    parallel: Parallel = None,
    progress: Progress | bool | None = None,
    checkpoint: str | os.PathLike[str] | None = None,
    observer: Observer | None = None,
) -> Result:
    """Render a job: pilot, fit, final pass.

    Parameters and errors are those of `render`; `observer` gets the tiles of each pass, in row order, before they are
    rendered.
    """
    _ = job.scene.plan.sampled_lights(job.settings.sky_compensation)  # tables, before workers get the scene
    with reporting(progress) as report, Passes(job, parallel, report, checkpoint, observer) as passes:
        job.scene.prepare()
        times = [time.perf_counter()]
        pilot, first_round = passes.pilot()  # samples
        times.append(time.perf_counter())
        final_pass = job.final_pass(pilot)  # variance, fit, filter
        films = [(p.moments, int(np.mean(p.moments.n))) for p in pilot.values()] if job.settings.reuse_pilot else []
        pilot_rays = sum((Counter(rays_of_all_pixels(p.rays)) for p in pilot.values()), Counter[str]())
        del pilot  # its statistics are large, and nothing else of them is needed
        times.append(time.perf_counter())
        final = passes.final(final_pass, first_round)  # samples again
        times.append(time.perf_counter())
    # weights are the budgets: those of adaptive samples depend on the pilot, and would bias the mean
    image, deviation = _average([(final, job.final_spp), *films], job.gain)
    seconds = dict(zip(("pilot", "fit", "render"), np.diff(times).tolist(), strict=True))
    seconds |= {"total": times[-1] - times[0], "embree": passes.embree_seconds}
    return _result(job, final_pass, (image, deviation), seconds, (passes.rays, pilot_rays))


def _result(
    job: Job,
    final: FinalPass,
    image: tuple[Array, Array],
    seconds: Mapping[str, float],
    counts: tuple[Mapping[str, int], Mapping[str, int]],
) -> Result:
    """Return the result of a job; `counts` are all rays and those of the pilot, by kind."""
    rays = {kind: number for kind, number in counts[0].items() if kind != UNTRACED}
    shape = image[0].shape[:2]
    replicates, settings = final.settings.replicates, final.settings
    if final.patterns is not None:
        light, brdf = final.patterns.shading_samples(np.asarray(final.samples))
        samples = replicates * (final.samples + final.patterns.begin)
        weight, shading_samples = light / (light + brdf), replicates * (light + brdf) / samples
    else:
        samples = job.spp - job.final_spp + replicates * np.asarray(final.samples, np.float32)
        weight, shading_samples = final.shares[0], np.full(shape, job.settings.shading_samples)
    described = job.without_tables()
    deviation_of = "sub-blocks" if is_sequence(settings.sampler) else "samples"
    deviation_of = "replicates" if replicates > 1 else deviation_of
    of_image = {"combiner": settings.combiner, "rays": rays, "pilot_rays": dict(counts[1])}
    of_image["deviation_of"] = deviation_of
    return Result(
        image=image[0],
        deviation=image[1],
        deviation_of=deviation_of,
        weight=np.full(shape, weight, np.float32),
        samples=np.full(shape, samples, np.float32),
        shading_samples=np.asarray(shading_samples, np.float32),
        seconds=seconds,
        rays=rays,
        maps=final.fit.maps,
        describe=lambda: {**described.provenance, **of_image},
    )


def _average(parts: list[tuple[Film, int]], gain: float) -> tuple[Array, Array]:
    """Return the average of images with weights fixed beforehand, their budgets of samples, and its deviation.

    The results overwrite the arrays of the first part, row by row, because images are large. Both are in the
    units of the scene that was given, which has `gain` times the radiance of the one that was rendered.
    The actual numbers of adaptive samples depend on the pilot, and must not be weights: that would be biased.
    """
    total = sum(n for _, n in parts)
    image, deviation = parts[0][0].mean, parts[0][0].root
    shape = image.shape
    for row in range(len(image)):
        mean, variance = np.zeros((2, *shape[1:]))
        for part, n in parts:
            share = n / total
            mean += part.mean[row] * share
            n_each = np.broadcast_to(np.asarray(part.n, np.float64), (*shape[:2], 1))[row]
            freedom = np.where(n_each > 1, n_each - 1, np.nan)  # one sample has no variance
            variance += np.square(part.root[row], dtype=np.float64) / (freedom * n_each) * share**2
        mean *= gain
        if not (np.abs(mean) <= np.finfo(np.float32).max).all():
            most = np.abs(mean).max()
            raise ValueError(f"radiance must be below 3.4e38, the largest float32; the image has {most:g}")
        with np.errstate(over="ignore"):  # a deviation may be beyond float32 where the mean is not
            image[row], deviation[row] = mean, np.sqrt(variance) * gain
    return image, deviation
