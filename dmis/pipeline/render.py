"""Rendering with a rule: it asks for rounds, such as pilot and final pass, and is sent their films; then the image.

`dmis.pipeline.job` checks the arguments, `dmis.pipeline.passes` renders the rounds. The budget `spp` includes the
pilot. Pilot and final image are both unbiased. Where the pilot is part of the image they are averaged with weights
fixed beforehand, their camera samples: so the result is unbiased although the shares were learned. (Weighting by
estimated variance would not be.)
"""

from __future__ import annotations

import os
import time
from collections import Counter
from collections.abc import Generator
from typing import Any

from dmis.estimator.cost import rays_of_all_pixels
from dmis.estimator.settings import Settings, make_settings
from dmis.fit.round import Pilot, Round
from dmis.fit.rule import Rule
from dmis.pipeline.executor import Parallel
from dmis.pipeline.film import average_films
from dmis.pipeline.job import Job, resolve
from dmis.pipeline.passes import Observer, Passes
from dmis.pipeline.progress import Progress, reporting
from dmis.pipeline.result import Result, make_result
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

    Parameters and errors are those of `render`; `observer` gets the tiles of each round, in row order, before they are
    rendered.
    """
    _ = job.scene.plan.sampled_lights(job.settings.sky_compensation)  # tables, before workers get the scene
    seconds = {"pilot": 0.0, "fit": 0.0, "final": 0.0}
    image: list[tuple[Film, int]] = []
    pilot_rays: Counter[str] = Counter()
    with reporting(progress) as report, Passes(job, parallel, report, checkpoint, observer) as passes:
        job.scene.prepare()
        rounds, film, began = job.rule.rounds(job.budget), None, time.perf_counter()
        while (round_ := _next_round(rounds, film)) is not None:  # variance, fit, filter
            seconds["fit"] += time.perf_counter() - began
            began, film = time.perf_counter(), None
            film, last = passes.render(round_), round_  # samples
            if round_.weight:
                image.append((film.moments, round_.weight))
            if round_.stage == "pilot":
                pilot_rays.update(rays_of_all_pixels(film.rays))
            seconds[round_.stage] += time.perf_counter() - began
            began = time.perf_counter()
    times = {"pilot": seconds["pilot"], "fit": seconds["fit"], "render": seconds["final"]}
    times |= {"total": sum(times.values()), "embree": passes.embree_seconds}
    mean_and_deviation = average_films(image[::-1], job.gain)
    return make_result(job, last, mean_and_deviation, times, (passes.rays, pilot_rays))


def _next_round(rounds: Generator[Round, Pilot, None], film: Pilot | None) -> Round | None:
    """Return the next round of a rule, which is sent the film of the last one; None if there are no more."""
    try:
        return next(rounds) if film is None else rounds.send(film)
    except StopIteration:
        return None
