"""The command ``render``: a scene to an image, with its preview, its checkpoint and its statistics."""

from __future__ import annotations

import argparse
import json
import math
import os
import re
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from dmis.base import malloc
from dmis.base.atomic_files import check_writable, replacing
from dmis.base.color import LUMINANCE
from dmis.cli.shared import describe, load, progress_bar, say, settings_of
from dmis.image import check_image, write_png
from dmis.pipeline.checkpoint import remove_checkpoint
from dmis.pipeline.executor import Parallel, Processes
from dmis.pipeline.image_layers import with_layers
from dmis.pipeline.job import Job, resolve
from dmis.pipeline.render import render_job
from dmis.pipeline.result import Result, write_image
from dmis.pipeline.stopping import Stop
from dmis.scene.scene import Scene

CLUSTER_TIMEOUT = 30.0
"""Seconds to wait for a Dask scheduler to answer, and again for its first worker."""
EXPOSED = 0.6
"""Linear value in the preview of a model that 5 % of its pixels exceed."""
BYTES_OF_PIXEL, BYTES_OF_DESCRIPTION = 32, 2**16
"""Bytes of a pixel in an image file, of eight channels, and of all that describes the image."""


def render(options: argparse.Namespace) -> int:
    """Run ``render`` and return its exit code."""
    files = _check_files(options)
    scene = load(options, options.scene)
    if options.crop is not None:
        scene = scene.crop(options.crop)
    for path in files:
        check_writable(path, BYTES_OF_PIXEL * math.prod(scene.camera.resolution) + BYTES_OF_DESCRIPTION)
    with _executor(options) as parallel, progress_bar(options.quiet) as progress:
        spp = scene.suggested.spp if options.spp is None and options.as_in_file else options.spp
        limits = options.noise, options.seconds
        stop = None if limits == (None, None) else Stop(*limits)
        settings = settings_of(options, scene)
        job = resolve(scene, options.rule, spp, options.seed, settings, doubling=stop is not None)
        job = with_layers(job, options.layers.split(",")) if options.layers else job
        result = render_job(job, parallel, progress, options.checkpoint, stop=stop)
    has_preview = any(path.suffix.lower() == ".png" for path in files)
    exposure = _exposure(options, scene, result) if has_preview else 1.0
    write_image(options.output, result, exposure)
    if options.png:
        write_png(options.png, result.image, exposure)
    if options.stats:
        with replacing(options.stats) as partial:
            partial.write_text(json.dumps(_stats(options, result), indent=2) + "\n")
    if options.checkpoint:
        remove_checkpoint(options.checkpoint)
    if options.quiet:
        return 0
    say(*_summary(options, job, result))
    if exposure != 1:
        say(f"  exposure of the preview: {exposure:.3g}")
    if options.verbose:
        say(*_details(scene, result))
    elif "added" in scene.source:
        say(f"  added to the file: {'; '.join(scene.source['added'])}")
    if "lit" in scene.source and options.light is None and not options.verbose:
        say(f"  lit by {scene.source['lit']}")
    return 0


def _exposure(options: argparse.Namespace, scene: Scene, result: Result) -> float:
    """Return the exposure of a preview: 1, or for a model with lights, whose units are unknown, an automatic one.

    It maps the 95th percentile of the luminance to `EXPOSED`.
    """
    if options.exposure is not None:
        return float(options.exposure)
    bright = float(np.quantile(result.image @ LUMINANCE, 0.95)) if scene.source.get("lit") else 0.0
    return EXPOSED / bright if bright > 0 else 1.0


def _check_files(options: argparse.Namespace) -> list[Path]:
    """Return the files that will be written, after a check of their names, or raise a ValueError or an OSError."""
    check_image(options.output)
    if options.png is not None and Path(options.png).suffix.lower() != ".png":
        raise ValueError(f"--png must end in .png; got {options.png}")
    files = [Path(path) for path in (options.output, options.png, options.stats) if path is not None]
    for path in files:
        check_writable(path)
    paths = [*files, *(Path(path) for path in (options.checkpoint, options.scene) if path is not None)]
    resolved = [path.resolve() for path in paths]
    if repeated := [path for path in paths if resolved.count(path.resolve()) > 1]:
        raise ValueError(f"files to write must differ from each other and from the scene; got {repeated[0]} twice")
    return files


@contextmanager
def _executor(options: argparse.Namespace) -> Iterator[Parallel]:
    """Yield what the render runs on: threads, processes, or an executor of the Dask cluster at an address."""
    address = options.cluster
    if address is None:
        yield Processes(options.workers) if options.workers else options.threads
        return
    if "://" not in address and not re.fullmatch(r"([^\s:/]+|\[[\da-fA-F:.]+\]):\d{1,5}", address):
        form = "the address of a Dask scheduler, HOST:PORT or tcp://HOST:PORT"
        raise ValueError(f"--cluster must be {form}; got {address}")
    try:
        from distributed import Client
    except ImportError as error:
        raise ValueError("--cluster needs Dask: pip install 'dmis[cluster]'") from error
    try:
        client = Client(address, timeout=CLUSTER_TIMEOUT, set_as_default=False)
    except OSError as error:
        raise ValueError(f"no Dask scheduler answers at {address}: {error}. Start one with: dask scheduler") from error
    with client:
        try:
            client.wait_for_workers(1, timeout=CLUSTER_TIMEOUT)
        except TimeoutError as error:
            fix = f"Start one with: dask worker {address}"
            raise ValueError(f"the Dask scheduler at {address} has no workers. {fix}") from error
        yield client.get_executor(pure=False)


def _summary(options: argparse.Namespace, job: Job, result: Result) -> list[str]:
    """Return lines with what was rendered and how fast, why by another rule, and the number of fireflies."""
    about, seconds = result.provenance, result.seconds["total"]
    text = f"{options.output}: {about['rule']}, {about['spp']} spp"
    if options.as_in_file:
        text += f", sampler {job.settings.sampler}, {job.settings.shading_samples} shading samples"
    if noise := about.get("noise"):
        text += f", rounds: {about['rounds']}, noise {noise:.2g}"
        text += f" ({options.noise:g} was not reached)" if options.noise and noise > options.noise else ""
    lines = [f"{text}, {seconds:.2f} s, {result.rays.get('camera', 0) / seconds / 1e6:.2f} Msamples/s"]
    if number := int(result.fireflies.sum()):
        lines.append(
            f"  {number} of {result.fireflies.size:,} pixels look like noisy specks (fireflies), made by a few rare "
            f"bright samples: the image is right on average, and a larger --spp removes them"
        )
    if pixels := job.notes.get("window"):
        lines.append(f"  window: {pixels}")
    if reason := about.get("fallback"):
        lines.append(f"  {about['rule']} at {job.spp} spp: {reason}")
    return lines


def _details(scene: Scene, result: Result) -> list[str]:
    """Return lines with the plan, seconds and rays by kind, mean share of light samples, and what was decided."""
    stages = ", ".join(f"{name} {result.seconds[name]:.2f}" for name in ("pilot", "fit", "render"))
    rays = ", ".join(f"{kind} {n:,}" for kind, n in result.rays.items())
    decided = result.provenance.get("decided", {})
    return [
        f"  {describe(scene)}",
        f"  seconds: {stages}",
        f"  rays: {rays}",
        f"  light samples: {result.light_share.mean():.0%}",
        *(f"  {name}: {', '.join(f'{value:g}' for value in values)}" for name, values in decided.items()),
    ]


def _stats(options: argparse.Namespace, result: Result) -> dict[str, object]:
    """Return the content of the ``--stats`` file, see docs/cli.md."""
    samples, threads = result.rays.get("camera", 0), options.threads or options.workers or os.cpu_count() or 1
    seconds = {stage: time for stage, time in result.seconds.items() if stage != "workers"}
    return {
        "embree_seconds": seconds.pop("embree") / threads,
        "seconds": seconds["total"],
        "seconds_by_stage": seconds,
        "samples": samples,
        "samples_per_second": samples / seconds["total"],
        "rays": dict(result.rays),
        "fireflies": int(result.fireflies.sum()),
        "peak_rss_bytes": malloc.peak(),
        "threads": threads,
        "provenance": dict(result.provenance),
    }
