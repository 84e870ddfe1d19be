"""The runner of a job's passes: the executor, the checkpoint and the passes of a render, released however it ends."""

from __future__ import annotations

import math
import os
from collections import Counter
from dataclasses import replace
from types import TracebackType
from typing import Any

from dmis.base.atomic_files import check_writable
from dmis.base.malloc import release
from dmis.estimator.allocation import shares_of
from dmis.fit.rule import Pilot
from dmis.pipeline.checkpoint import Store
from dmis.pipeline.executor import Parallel, Workers, check_parallel
from dmis.pipeline.job import FinalPass, Job
from dmis.pipeline.passes import Passes, Progress
from dmis.scene.feature_buffers import guides
from dmis.variance.moments import Film

_CHECKPOINT_BYTES = 24  # of a pixel in a pass, statistics not counted


class PassRunner:
    """Renders the passes of a job; a context manager that closes the executor and keeps or removes the checkpoint.

    Parameters
    ----------
    parallel, progress, checkpoint
        As those of `dmis.pipeline.render.render`.

    Raises
    ------
    ValueError
        If `parallel` is not right, or the checkpoint belongs to a different image.
    OSError
        If the checkpoint cannot be written.
    """

    def __init__(
        self,
        job: Job,
        parallel: Parallel,
        progress: Progress | None,
        checkpoint: str | os.PathLike[str] | None,
    ) -> None:
        self._job, self._pixels = job, math.prod(job.scene.camera.resolution)
        parallel = check_parallel(parallel)
        if checkpoint is not None:
            check_writable(checkpoint, _CHECKPOINT_BYTES * self._pixels * (len(job.rule.pilot) + 1))
        self._store = Store(checkpoint, job.provenance if checkpoint is None else job.key)
        self._workers = Workers(job.scene, parallel)
        self.passes = Passes(job.scene, job.seed, self._workers, progress, self._store)

    def __enter__(self) -> PassRunner:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if kind is None:
            self._workers.close()
            return
        self._store.close()
        self._workers.close(now=True)

    @property
    def rays(self) -> Counter[str]:
        """Rays traced so far, by kind."""
        return self.passes.rays

    def pilot(self) -> dict[Any, Pilot]:
        """Render the pilot: one pass for each weight, and the feature buffers if the rule needs them."""
        job = self._job
        pilot = {
            w: self.passes.render(number, "pilot", spp, shares_of(w), job.pilot_settings, job.statistic)
            for number, (w, spp) in enumerate(job.pilot_samples.items())
        }
        if job.rule.needs_features:
            features, rays = guides(job.scene)
            self.rays["guide"] += rays
            pilot = {w: replace(p, guides=features) for w, p in pilot.items()}
            release(self._pixels)
        return pilot

    def final(self, final: FinalPass) -> Film:
        """Render the final pass; its moments per pixel."""
        number = len(self._job.rule.pilot)
        return self.passes.render(
            number, "final", final.samples, final.shares, final.settings, control=final.control
        ).moments

    def finish(self) -> None:
        """Remove the checkpoint, once the image is made."""
        self._store.remove()
