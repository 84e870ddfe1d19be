"""The command line: ``python -m dmis render | compare | info | bench``.

Bad input ends with exit code 2 and one message. An interrupted render ends with 130 and keeps its checkpoint.
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
from contextlib import contextmanager
from dataclasses import replace
from importlib.metadata import version
from pathlib import Path

from dmis import __version__, memory
from dmis.arguments import make_parser
from dmis.bench import HEADER, bench
from dmis.compare import compare, load_reference, split_rules, summary
from dmis.files import check_writable, replacing
from dmis.image import write_image, write_png
from dmis.load import SHIPPED, load_scene
from dmis.oracle import make_oracle
from dmis.passes import Progress
from dmis.reference import make_reference
from dmis.render import Result, render
from dmis.replay import embree_seconds
from dmis.scene import Scene
from dmis.settings import Settings

PATIENCE = 30.0
"""Seconds to wait for a cluster."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line; returns the exit code."""
    options = make_parser().parse_args(arguments)
    try:
        with warnings.catch_warnings():
            warnings.showwarning = lambda message, *_, **__: print(f"dmis: warning: {message}", file=sys.stderr)  # type: ignore[assignment]
            return _COMMANDS[options.command](options)
    except (ValueError, OSError) as error:
        print(f"dmis: error: {error}", file=sys.stderr)
        return 2
    except MemoryError as error:
        print(f"dmis: error: there is not enough memory: {error}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        print(f"dmis: interrupted{_kept(options, arguments)}", file=sys.stderr)
        return 130


def _kept(options: argparse.Namespace, arguments: Sequence[str] | None) -> str:
    """What an interrupted command leaves, and how to go on."""
    if options.command == "compare":
        return f"; finished renders are kept in {options.output}: the same command goes on from there"
    path = getattr(options, "checkpoint", None)
    if path is None or not Path(path).exists():
        return ""
    command = shlex.join(["python", "-m", "dmis", *(sys.argv[1:] if arguments is None else arguments)])
    return f"; finished tiles are kept in {path}. To go on, give the same command:\n  {command}"


def _load(options: argparse.Namespace) -> Scene:
    return load_scene(
        options.scene, resolution=options.resolution, dialect=options.dialect, outside=options.allow_outside
    )


def _compare(options: argparse.Namespace) -> int:
    if not 1 <= options.seeds <= 10_000:
        raise ValueError(f"--seeds must be at least 1 and at most 10000; got {options.seeds}")
    rules = split_rules(options.rules)
    settings = Settings(integrator=options.integrator, max_depth=options.max_depth)
    scene = _load(options)
    if options.verbose:
        print(_described(scene), flush=True)
    with _progress_bar(options.quiet) as progress:
        if options.reference is not None:
            reference = load_reference(options.reference)
        else:
            reference = make_reference(
                scene, options.reference_spp, settings=settings, threads=options.threads, progress=progress
            )
        seeds = range(options.seed, options.seed + options.seeds)
        oracle = None
        if options.oracle_spp is not None:
            oracle = make_oracle(
                scene, options.oracle_spp, settings=settings, threads=options.threads, progress=progress
            )
        comparison = compare(
            scene, rules, options.spp, seeds, reference, options.output,
            settings=replace(settings, sampler=options.sampler), oracle=oracle, threads=options.threads,
            progress=_counted if options.verbose else progress,
        )  # fmt: skip
    missing = [(rule, n) for n in options.spp for rule in rules if (rule, n) not in comparison.runs]
    for rule, n in missing:
        print(f"dmis: {rule} is left out at {n} samples, because its pilot takes them all", file=sys.stderr)
    if not options.quiet:
        print(summary(comparison.runs))
        for name in ("results.csv", "report.html"):
            if (options.output / name).exists():
                print(options.output / name)
    return 0


def _counted(rule: str, done: int, total: int) -> None:
    """A line for a render that is finished."""
    print(f"{time.strftime('%H:%M:%S')} [{done}/{total}] {rule}", flush=True)


def _render(options: argparse.Namespace) -> int:
    output = Path(options.output)
    if output.suffix.lower() not in (".exr", ".png"):
        raise ValueError(f"-o must end in .exr (or .png for a preview); got {output}")
    files = [path for path in (output, options.png, options.stats, options.checkpoint) if path is not None]
    for path in files:
        check_writable(path)
    names = [Path(path).resolve() for path in (*files, options.scene)]
    if twice := [path for path in files if names.count(Path(path).resolve()) > 1]:
        raise ValueError(f"files to write must differ from each other and from the scene; got {twice[0]} twice")
    threads = options.threads or options.workers or os.cpu_count() or 1
    scene = _load(options)
    for path in files:
        check_writable(path, 32 * math.prod(scene.camera.resolution) + 2**16)  # eight channels and their description
    with _cluster(options.cluster) as executor, _progress_bar(options.quiet) as progress:
        result = render(
            scene,
            options.rule,
            options.spp,
            seed=options.seed,
            sampler=options.sampler,
            settings=Settings(
                shading_samples=options.shading_samples,
                lights=options.lights,
                integrator=options.integrator,
                max_depth=options.max_depth,
                clamp=options.clamp,
            ),
            threads=options.threads,
            workers=options.workers,
            executor=executor,
            progress=progress,
            checkpoint=options.checkpoint,
        )
    write_image(output, result)
    if options.png:
        write_png(options.png, result.image)
    if options.stats:
        most = memory.peak()  # before the replay, which keeps the rays of some tiles
        floor = embree_seconds(scene, result.tiles, threads)
        with replacing(options.stats) as partial:
            partial.write_text(json.dumps(_stats(result, floor, most, threads), indent=2) + "\n")
    if not options.quiet:
        seconds = result.seconds["total"]
        rate = result.image.shape[0] * result.image.shape[1] * options.spp / seconds / 1e6
        rule = result.provenance["rule"]
        print(f"{output}: {rule}, {options.spp} spp, {seconds:.2f} s, {rate:.2f} Msamples/s{_doubts(result)}")
    if options.verbose:
        print("\n".join([f"  {_described(scene)}", *_spent(result)]))
    return 0


def _described(scene: Scene) -> str:
    width, height = scene.camera.resolution
    unseen = 0 if scene.seeing is None else int((~scene.seeing).sum())
    known = f" ({unseen:,} of them see nothing, and are not sampled)" if unseen else ""
    return f"scene {scene.name}: {width}x{height} pixels{known}, {scene.plan.describe()}"


def _spent(result: Result) -> list[str]:
    """Where the time went, and what was traced."""
    stages = ", ".join(f"{name} {result.seconds[name]:.2f}" for name in ("pilot", "fit", "render"))
    rays = ", ".join(f"{kind} {n:,}" for kind, n in result.rays.items())
    return [f"  seconds: {stages}", f"  rays: {rays}", f"  light samples: {result.weight.mean():.0%}"]


def _doubts(result: Result) -> str:
    """What is to be known about an image."""
    found = int(result.fireflies.sum())
    doubts = [f"biased: {what}" for what in result.provenance.get("bias", ())]
    doubts += [f"{found} pixel{'s look' if found > 1 else ' looks'} like fireflies"] * (found > 0)
    return "".join(f"; {doubt}" for doubt in doubts)


@contextmanager
def _cluster(address: str | None) -> Iterator[Executor | None]:
    """The Dask cluster at `address`; None: none."""
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
        client = Client(address, timeout=PATIENCE, set_as_default=False)
    except OSError as error:
        raise ValueError(f"no Dask scheduler answers at {address}: {error}") from error
    with client:
        try:
            client.wait_for_workers(1, timeout=PATIENCE)
        except TimeoutError as error:
            raise ValueError(f"the Dask scheduler at {address} has no workers") from error
        yield client.get_executor(pure=False)


def _stats(result: Result, floor: float, most: int, threads: int) -> dict[str, object]:
    samples = int(result.image.shape[0] * result.image.shape[1] * result.provenance["spp"])
    seconds = result.seconds["total"]
    return {
        "seconds": seconds,
        "seconds_by_stage": dict(result.seconds),
        "samples": samples,
        "samples_per_second": samples / seconds,
        "rays": dict(result.rays),
        "fireflies": int(result.fireflies.sum()),
        "embree_seconds": floor,
        "peak_rss_bytes": most,
        "threads": threads,
        "provenance": dict(result.provenance),
    }


def _info(options: argparse.Namespace) -> int:
    packages = ", ".join(f"{name} {version(name)}" for name in ("numpy", "scipy", "trimesh", "embreex", "OpenEXR"))
    print(
        f"dmis {__version__}, Python {platform.python_version()}, {platform.system()} {platform.machine()}\n{packages}"
    )
    if options.scene:
        begin = time.perf_counter()
        scene = _load(options)
        scene.prepare()
        print(f"\n{_described(scene)}\nread and built in {time.perf_counter() - begin:.2f} s")
    return 0


def _bench(options: argparse.Namespace) -> int:
    settings = Settings(integrator=options.integrator, max_depth=options.max_depth)
    with _progress_bar(False) as progress:
        speeds = bench(
            options.scenes or SHIPPED, split_rules(options.rules), options.resolution, options.spp,
            options.threads, options.repeats, options.seed, settings, progress,
        )  # fmt: skip
    print(HEADER, *(speed.row() for speed in speeds), sep="\n")
    return 0


class _progress_bar:
    """A bar on standard error where someone is watching; silent in a log."""

    def __init__(self, quiet: bool) -> None:
        self._bar = None
        self._show = not quiet and sys.stderr.isatty()

    def __enter__(self) -> Progress | None:
        if not self._show:
            return None
        try:
            from tqdm import tqdm
        except ImportError:
            return None
        self._bar = tqdm(unit=" samples", unit_scale=True, leave=False)
        return self._update

    def _update(self, stage: str, done: int, total: int) -> None:
        if self._bar is not None:
            self._bar.total, self._bar.n = total, done
            self._bar.set_description(stage, refresh=False)
            self._bar.refresh()

    def __exit__(self, *_: object) -> None:
        if self._bar is not None:
            self._bar.close()


_COMMANDS = {"render": _render, "compare": _compare, "info": _info, "bench": _bench}

if __name__ == "__main__":
    sys.exit(main())
