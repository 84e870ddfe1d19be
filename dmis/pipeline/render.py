"""Render a scene with a rule: it yields rounds, such as pilot and final pass, and is sent the film of each.

`dmis.pipeline.job` checks the arguments, `dmis.pipeline.passes` renders the rounds. The image is the mean of those that
are part of it, with weights that are fixed beforehand: unbiased, although the shares were learned.
"""

from __future__ import annotations

import os
import time
from collections.abc import Sequence
from contextlib import nullcontext
from typing import Any

from dmis.estimator.settings import Settings, make_settings
from dmis.fit.rule import Rule, next_round
from dmis.pipeline.executor import Parallel
from dmis.pipeline.job import Job, budget_of, resolve
from dmis.pipeline.passes import Passes
from dmis.pipeline.progress import Progress, reporting
from dmis.pipeline.result import Result, make_result
from dmis.pipeline.stopping import Stop
from dmis.scene.scene import Scene
from dmis.variance.moments import Film, average_films, pilot_shares


def render(
    scene: Scene,
    rule: Rule | str | None = None,
    spp: int | None = None,
    *,
    noise: float | None = None,
    seconds: float | None = None,
    seed: int = 0,
    settings: Settings | None = None,
    parallel: Parallel = None,
    progress: Progress | bool | None = None,
    checkpoint: str | os.PathLike[str] | None = None,
    layers: Sequence[str] = (),
    **options: Any,
) -> Result:
    """Render `scene`; the image depends on these arguments and, with `seconds` alone, on the machine.

    Parameters
    ----------
    rule
        A rule or its text, ``thesis:patch=16``, see `dmis.fit.registry.RULES`. None: `dmis.pipeline.job.default_rule`.
    spp, seed
        Camera samples per pixel, the rule's pilot included (None: 128); seed, not negative.
    noise, seconds
        Double the samples until the image's estimated noise (root of relMSE) or its time is reached, at most to `spp`
        (None: 2^20), see `dmis.pipeline.stopping`.
    settings, options
        Estimator settings; or fields of `dmis.Settings` by name in their place, such as ``sampler="stratified"``. It is
        an error to ask for another value than the rule's.
    parallel
        Number of threads (None: one per processor); ``dmis.Processes(n)``; or any `concurrent.futures.Executor`, such
        as Dask's ``Client.get_executor(pure=False)``, which is not shut down.
    progress
        True for a bar or a widget (extra ``progress``); or a `dmis.pipeline.progress.Progress`.
    checkpoint
        Folder of finished tiles, from which a render resumes, until `dmis.remove_checkpoint` removes it.
    layers
        Names of layers of the result, such as ``["albedo", "direct"]``, see `dmis.pipeline.image_layers`.

    Raises
    ------
    ValueError, OSError, ChildProcessError
        If arguments are wrong or disagree, shares or pixels are invalid, or a checkpoint is of another image; if the
        checkpoint cannot be written; if workers keep dying.
    """
    stop = None if noise is None and seconds is None else Stop(noise, seconds)
    job = resolve(scene, rule, spp, seed, make_settings(settings, **options), doubling=stop is not None)
    if layers:
        from dmis.pipeline.image_layers import with_layers  # needs the feature buffers

        job = with_layers(job, layers)
    return render_job(job, parallel, progress, checkpoint, stop)


def render_job(
    job: Job,
    parallel: Parallel = None,
    progress: Progress | bool | None = None,
    checkpoint: str | os.PathLike[str] | None = None,
    stop: Stop | None = None,
) -> Result:
    """Render the rounds that the rule of a job asks for, see `render`, and the last one doubled until a `stop`."""
    image: list[tuple[Film, int]] = []  # and weights
    bar, began = reporting(progress) if progress else nullcontext(), time.perf_counter()
    with bar as report, Passes(job, parallel, report, checkpoint) as passes:
        rounds, film = stop.rounds(job) if stop else job.rule.rounds(budget_of(job)), None
        while (requested := next_round(rounds, film, job.rule)) is not None:  # variance, fit, filter
            final, film = requested, None  # its statistics are large
            film = passes.render(final)  # samples
            if final.image_weight:
                earlier = final.before and final.before.mean  # its samples are in the film, too
                image = [*(part for part in image if part[0].mean is not earlier), (film.moments, final.image_weight)]
    if not image:
        raise ValueError(f"rule {job.rule_text} must yield a Round with an image_weight; got none")
    image.reverse()  # the final film first, whose arrays the average overwrites
    job, final = (stop.job, stop.final) if stop else (job, final)
    shares = pilot_shares(image) if len(image) > 1 else {}
    return make_result(job, final, average_films(image, job.gain), shares, passes, time.perf_counter() - began)
