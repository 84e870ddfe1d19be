"""Render a scene with a rule: it yields rounds, such as pilot and final pass, and is sent the film of each.

`dmis.pipeline.job` checks the arguments, `dmis.pipeline.passes` renders the rounds, and the image is the average of
those that are part of it, with weights that are fixed beforehand: unbiased, although the shares were learned. (With
weights by estimated variance it would not be.) The budget `spp` includes the pilot.
"""

from __future__ import annotations

import os
import time
from contextlib import nullcontext
from typing import Any

from dmis.estimator.settings import Settings, make_settings
from dmis.fit.rule import Rule, next_round
from dmis.pipeline.executor import Parallel
from dmis.pipeline.film import average_films
from dmis.pipeline.job import Job, resolve
from dmis.pipeline.passes import Observer, Passes
from dmis.pipeline.progress import Progress, reporting
from dmis.pipeline.result import Result, make_result
from dmis.scene.scene import Scene


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
        If an argument is out of range, settings and rule disagree, a rule's shares are invalid, a pixel is infinite or
        NaN, or the checkpoint is damaged or of a different image.
    OSError
        If the checkpoint cannot be written; a ``ChildProcessError`` if workers keep dying.
    """
    job = resolve(scene, rule, spp, seed, make_settings(settings, **options))
    return render_job(job, parallel, progress, checkpoint)


def render_job(
    job: Job,
    parallel: Parallel = None,
    progress: Progress | bool | None = None,
    checkpoint: str | os.PathLike[str] | None = None,
    observer: Observer | None = None,
) -> Result:
    """Render the rounds that the rule of a job asks for, and send it the film of each.

    Parameters and errors are those of `render`; `observer` gets the tiles of each round before they are rendered.
    """
    image, bar = [], reporting(progress) if progress else nullcontext()
    with bar as report, Passes(job, parallel, report, checkpoint, observer) as passes:
        began, rounds = time.perf_counter(), job.rule.rounds(job.budget)
        requested = next_round(rounds, None)
        while requested is not None:
            film, last = passes.render(requested), requested  # samples
            if requested.image_weight:
                image.append((film.moments, requested.image_weight))
            requested = next_round(rounds, film)  # variance, fit, filter
            del film  # its statistics are large
        total = time.perf_counter() - began
    if not image:
        raise ValueError(f"rule {job.rule_text} must yield a Round with an image_weight; got none")
    image.reverse()  # the final film first, whose arrays the average overwrites
    return make_result(job, last, average_films(image, job.gain), passes, total)
