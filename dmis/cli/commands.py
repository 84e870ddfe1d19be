"""Commands of the command line: ``python -m dmis render | compare | oracle | info | check | bench``.

Bad input ends with exit code 2 and one message. An interrupted command ends with 130, and its message has the command
that resumes it.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import platform
import re
import shlex
import sys
import time
import warnings
from collections.abc import Iterator, Sequence
from concurrent.futures import Executor
from contextlib import AbstractContextManager, contextmanager
from dataclasses import fields
from importlib.metadata import version
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from dmis import __version__
from dmis.base import malloc
from dmis.base.atomic_files import check_folder, check_package, check_writable, replacing
from dmis.base.plugins import load_plugin
from dmis.cli.arguments import REMOVED_OPTIONS, make_parser
from dmis.cli.check import check
from dmis.estimator.settings import Settings, make_settings
from dmis.experiment.compare import check_output, compare, load_reference, parse_rules, summary
from dmis.experiment.oracle import make_oracle
from dmis.experiment.reference import cache_folder, make_reference
from dmis.experiment.speed.bench import HEADER, bench
from dmis.experiment.speed.embree_floor import embree_seconds
from dmis.fit.registry import make_rule
from dmis.formats.load_scene import SHIPPED, load_scene
from dmis.image import check_image, write_png
from dmis.pipeline.checkpoint import remove_checkpoint
from dmis.pipeline.executor import Processes
from dmis.pipeline.job import Job
from dmis.pipeline.progress import Progress, reporting
from dmis.pipeline.render import render_job
from dmis.pipeline.result import Result, write_image
from dmis.pipeline.tile import Tile
from dmis.scene.rescale import rescale_for_float32
from dmis.scene.scene import Scene

DEFAULT_SPP = 128
"""Camera samples per pixel where neither an option nor the scene's file says."""
CLUSTER_TIMEOUT = 30.0
"""Seconds to wait for a Dask scheduler to answer, and again for its first worker."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line and return its exit code."""
    parser = make_parser()
    options, unknown = parser.parse_known_args(arguments)
    if unknown:
        command = options.command
        fix = REMOVED_OPTIONS.get(unknown[0], f"python -m dmis {command} --help lists its options")
        parser.error(f"{command} does not take {' '.join(unknown)}; {fix}")
    try:
        with warnings.catch_warnings():
            warnings.showwarning = lambda message, *_, **__: print(f"dmis: warning: {message}", file=sys.stderr)  # type: ignore[assignment]
            for file in options.plugin:
                load_plugin(file)
            code = _COMMANDS[options.command](options)
            sys.stdout.flush()
            return code
    except BrokenPipeError:  # nothing reads standard output any more, as behind ``| head``
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())  # Python flushes what is left at exit
        return 141  # as the shell has it for a command that SIGPIPE ends
    except (ValueError, OSError) as error:
        print(f"dmis: error: {error}", file=sys.stderr)
        return 2
    except MemoryError as error:
        print(f"dmis: error: there is not enough memory: {error}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        print(f"dmis: interrupted{_how_to_resume(options, arguments)}", file=sys.stderr)
        return 130


def _how_to_resume(options: argparse.Namespace, arguments: Sequence[str] | None) -> str:
    """Return what an interrupted command has saved, and the command that resumes it."""
    if options.command == "compare":
        if (options.output / "results.csv").exists():
            return f"; finished renders are kept in {options.output}. Run the same command to resume."
        if options.reference is not None:
            return "; nothing is kept, because no render was finished"
        return (
            f"; no render was finished. Finished tiles of the reference are kept in {cache_folder()}. Run the same "
            f"command to resume."
        )
    if options.command == "oracle":
        return f"; finished tiles are kept in {cache_folder()}. Run the same command to resume."
    if options.command != "render":
        return ""
    path, words = options.checkpoint, ["python", "-m", "dmis", *(sys.argv[1:] if arguments is None else arguments)]
    if path is None:
        command = shlex.join([*words, "--checkpoint", str(Path(options.output).with_suffix(".checkpoint"))])
        return (
            f"; nothing is kept. With --checkpoint finished tiles are kept, and the same command resumes:\n  {command}"
        )
    if not Path(path).exists():
        return ""
    command = shlex.join(words)
    return f"; finished tiles are kept in {path}. Run the same command to resume:\n  {command}"


def _load(options: argparse.Namespace) -> Scene:
    """Return the scene that the options name."""
    return load_scene(
        options.scene,
        resolution=options.resolution,
        dialect=options.dialect,
        outside=options.allow_outside,
        up=options.up,
    )


def _given_settings(options: argparse.Namespace) -> dict[str, Any]:
    """Return the fields of `Settings` that were given as options, by name."""
    return {field.name: getattr(options, field.name) for field in fields(Settings) if hasattr(options, field.name)}


def _settings(options: argparse.Namespace, scene: Scene) -> dict[str, Any]:
    """Return fields of `Settings` by name: those given, and with --as-in-file the scene file's."""
    given = _given_settings(options)
    return vars(Settings.as_in_file(scene, **given)) if options.as_in_file else given


def _spp(options: argparse.Namespace, scene: Scene) -> int:
    """Return the camera samples per pixel where no option says."""
    return (scene.suggested.spp if options.as_in_file else None) or DEFAULT_SPP


def _compare(options: argparse.Namespace) -> int:
    """Run ``compare`` and return its exit code."""
    if not 1 <= options.seeds <= 10_000:
        raise ValueError(f"--seeds must be from 1 to 10000; got {options.seeds}")
    rules = parse_rules(options.rules)
    make_settings(**_given_settings(options))  # a bad one ends the command before the scene is read
    check_output(options.output)  # before the reference is rendered
    scene = _load(options)
    counts = options.spp or [_spp(options, scene)]
    settings = _settings(options, scene)
    expected = {name: settings[name] for name in ("integrator", "max_depth") if name in settings}  # of the image
    curves = {name: value for name, value in settings.items() if name != "sampler"}
    if options.verbose:
        print(_description(scene), flush=True)
    with _progress(options.quiet) as progress:
        if options.reference is not None:
            reference = load_reference(options.reference, scene, make_settings(**expected))
        else:
            reference = make_reference(
                scene, options.reference_spp, parallel=options.threads, progress=progress, **expected
            )
        seeds = range(options.seed, options.seed + options.seeds)
        oracle = None
        if options.oracle_spp is not None:
            oracle = make_oracle(scene, options.oracle_spp, parallel=options.threads, progress=progress, **curves)
        comparison = compare(
            scene, rules, counts, seeds, reference, options.output,
            oracle=oracle, progress=_print_run if options.verbose else progress, parallel=options.threads,
            **settings,
        )  # fmt: skip
    missing = [(rule, n) for n in counts for rule in rules if (rule, n) not in comparison.runs]
    for rule, n in missing:
        pilot = sum(make_rule(rule).pilot.values())
        print(
            f"dmis: {rule} is left out at {n} samples per pixel, because its pilot takes {pilot}: "
            f"use --spp {pilot + 1} or more",
            file=sys.stderr,
        )
    if not options.quiet:
        print(summary(comparison.runs, comparison.reference))
        for name in ("results.csv", "report.html"):
            if (options.output / name).exists():
                print(options.output / name)
    return 0


def _print_run(rule: str, done: int, total: int) -> None:
    """Print a line about a finished render."""
    print(f"{time.strftime('%H:%M:%S')} [{done}/{total}] {rule}", flush=True)


def _render(options: argparse.Namespace) -> int:
    """Run ``render`` and return its exit code."""
    output = Path(options.output)
    if output.suffix.lower() not in (".exr", ".png"):
        raise ValueError(f"-o must end in .exr (or .png for a preview); got {output}")
    if options.png is not None and Path(options.png).suffix.lower() != ".png":
        raise ValueError(f"--png must end in .png; got {options.png}")
    files = [path for path in (output, options.png, options.stats) if path is not None]
    check_image(output)
    for path in files:
        check_writable(path)
    given = [path for path in (*files, options.checkpoint, options.scene) if path is not None]
    names = [Path(path).resolve() for path in given]
    if repeated := [path for path in given if names.count(Path(path).resolve()) > 1]:
        raise ValueError(f"files to write must differ from each other and from the scene; got {repeated[0]} twice")
    threads = options.threads or options.workers or os.cpu_count() or 1
    scene = _load(options)
    spp = _spp(options, scene) if options.spp is None else options.spp
    for path in files:
        check_writable(path, 32 * math.prod(scene.camera.resolution) + 2**16)  # eight channels and their description
    tiles: list[Tile] = []
    with _cluster(options.cluster) as executor, _progress(options.quiet) as progress:
        job = Job.of(scene, options.rule, spp, options.seed, make_settings(**_settings(options, scene)))
        parallel = executor or (Processes(options.workers) if options.workers else options.threads)
        result = render_job(job, parallel, progress, options.checkpoint, tiles.extend if options.stats else None)
    write_image(output, result)
    if options.png:
        write_png(options.png, result.image)
    if options.stats:
        peak_bytes = malloc.peak()  # before the Embree-only run, which keeps the rays of some tiles
        embree_floor = embree_seconds(job.scene, tiles, threads)
        with replacing(options.stats) as partial:
            partial.write_text(json.dumps(_stats(result, embree_floor, peak_bytes, threads), indent=2) + "\n")
    if options.checkpoint:
        remove_checkpoint(options.checkpoint)
    if not options.quiet:
        seconds = result.seconds["total"]
        rate = _samples(result) / seconds / 1e6
        rule, reason = result.provenance["rule"], result.provenance.get("fallback")
        taken = f", sampler {job.settings.sampler}, {job.settings.shading_samples} shading samples"
        about = f"{rule}, {spp} spp{taken if options.as_in_file else ''}"
        print(f"{output}: {about}, {seconds:.2f} s, {rate:.2f} Msamples/s{_fireflies(result)}")
        if reason:
            print(f"  {rule} at {spp} spp: {reason}")
    if options.verbose:
        print("\n".join([f"  {_description(scene)}", *_time_and_rays(result)]))
    return 0


def _description(scene: Scene) -> str:
    """Return the name, resolution and plan of a scene."""
    width, height = scene.camera.resolution
    unseen = 0 if scene.covered_pixels is None else int((~scene.covered_pixels).sum())
    empty = f" ({unseen:,} of them see no surface or light and are not sampled)" if unseen else ""
    return f"scene {scene.name}: {width}x{height} pixels{empty}, {scene.describe()}"


def _time_and_rays(result: Result) -> list[str]:
    """Return lines with the seconds of each stage, the rays of each kind and the mean share of light samples."""
    stages = ", ".join(f"{name} {result.seconds[name]:.2f}" for name in ("pilot", "fit", "render"))
    rays = ", ".join(f"{kind} {n:,}" for kind, n in result.rays.items())
    return [f"  seconds: {stages}", f"  rays: {rays}", f"  light samples: {result.weight.mean():.0%}"]


def _fireflies(result: Result) -> str:
    """Return a line that counts the pixels that look like fireflies and says what helps; empty if there are none."""
    number = int(result.fireflies.sum())
    if not number:
        return ""
    are, fades = (
        ("is a noisy speck (firefly)", "it fades") if number == 1 else ("are noisy specks (fireflies)", "they fade")
    )
    return (
        f"\n  {number} of {result.fireflies.size:,} pixels {are}, made by a few rare bright samples: the image is "
        f"right on average, and {fades} with a larger --spp"
    )


@contextmanager
def _cluster(address: str | None) -> Iterator[Executor | None]:
    """Yield an executor on the Dask cluster at `address`, or None if there is no address."""
    if address is None:
        yield None
        return
    if "://" not in address and not re.fullmatch(r"([^\s:/]+|\[[\da-fA-F:.]+\]):\d{1,5}", address):
        raise ValueError(
            f"--cluster must be the address of a Dask scheduler, HOST:PORT or tcp://HOST:PORT; got {address}"
        )
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
            raise ValueError(
                f"the Dask scheduler at {address} has no workers. Start one with: dask worker {address}"
            ) from error
        yield client.get_executor(pure=False)


def _samples(result: Result) -> int:
    """Return the number of camera samples that were taken, none in pixels that are known to see nothing."""
    return result.rays.get("camera", 0)


def _stats(result: Result, embree_floor: float, peak_bytes: int, threads: int) -> dict[str, object]:
    """Return the content of the ``--stats`` file, see docs/cli.md."""
    samples = _samples(result)
    seconds = result.seconds["total"]
    return {
        "seconds": seconds,
        "seconds_by_stage": dict(result.seconds),
        "samples": samples,
        "samples_per_second": samples / seconds,
        "rays": dict(result.rays),
        "fireflies": int(result.fireflies.sum()),
        "embree_seconds": embree_floor,
        "peak_rss_bytes": peak_bytes,
        "threads": threads,
        "provenance": dict(result.provenance),
    }


def _oracle(options: argparse.Namespace) -> int:
    """Run ``oracle`` and return its exit code."""
    check_package("matplotlib", "the plot of an oracle", "pip install 'dmis[plot]'")
    check_folder(options.output)
    scene, settings = _load(options), make_settings(**_given_settings(options))
    with _progress(options.quiet) as progress:
        oracle = make_oracle(scene, options.spp, settings=settings, parallel=options.threads, progress=progress)
    if not oracle.variance.any():
        raise ValueError(f"an oracle needs noise; every sample of scene {scene.name!r} is the same")
    from dmis.experiment.report.plots import write_best_shares

    options.output.mkdir(parents=True, exist_ok=True)
    text, paths = oracle.text(), [options.output / name for name in ("oracle.md", "best_shares.png")]
    write_best_shares(oracle, paths[1], scene.name)
    with replacing(paths[0]) as partial:
        partial.write_text(f"{text}\n", "utf-8")
    if not options.quiet:
        print(text, *paths, sep="\n")
    return 0


def _info(options: argparse.Namespace) -> int:
    """Run ``info`` and return its exit code."""
    packages = ", ".join(f"{name} {version(name)}" for name in ("numpy", "scipy", "trimesh", "embreex", "OpenEXR"))
    print(
        f"dmis {__version__}, Python {platform.python_version()}, {platform.system()} {platform.machine()}\n{packages}"
    )
    if options.scene:
        begin = time.perf_counter()
        loaded = _load(options)
        scene, _ = rescale_for_float32(loaded)
        scene.prepare()
        added = sum(part.mesh.triangles for part in scene.parts) - sum(part.mesh.triangles for part in loaded.parts)
        refined = f"\n  {added:,} triangles added: huge ones are split near small bodies" if added else ""
        print(f"\n{_description(scene)}{refined}\nread and built in {time.perf_counter() - begin:.2f} s")
    return 0


def _bench(options: argparse.Namespace) -> int:
    """Run ``bench`` and return its exit code."""
    with _progress(False) as progress:
        speeds = bench(
            options.scenes or SHIPPED, parse_rules(options.rules), options.resolution, options.spp,
            parallel=options.threads, repeats=options.repeats, seed=options.seed, progress=progress,
            **_given_settings(options),
        )  # fmt: skip
    print(HEADER, *(speed.row() for speed in speeds), sep="\n")
    return 0


def _progress(quiet: bool) -> AbstractContextManager[Progress | None]:
    """Give a progress bar if standard error is a terminal and tqdm is there; it prints nothing into a log."""
    return reporting(not quiet and sys.stderr.isatty() and find_spec("tqdm") is not None)


_COMMANDS = {
    "render": _render, "compare": _compare, "oracle": _oracle, "info": _info, "check": check, "bench": _bench,
}  # fmt: skip
if __name__ == "__main__":
    sys.exit(main())
