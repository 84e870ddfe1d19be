"""Commands and options of the command line, and the parsers of their values."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path
from typing import Any

from dmis import __version__
from dmis.estimator.presets import PRESETS
from dmis.fit.registry import RULES
from dmis.pipeline.executor import MAX_WORKERS
from dmis.samplers.streams import SAMPLERS
from dmis.scene import camera

_SAMPLERS = (
    f"{', '.join(SAMPLERS)}, or one of a plugin; auto: sobol, or independent with a combiner that needs it "
    "(default auto)"
)
REMOVED_OPTIONS = {
    "--ladder": "run benchmarks/print_ladder.py SCENE of a checkout, which prints and plots the ladder of bounds",
}
"""What takes the place of options that earlier versions had."""


def make_parser() -> argparse.ArgumentParser:
    """Return the parser of all commands and their options; its result has the name of the command in ``command``."""
    parser = argparse.ArgumentParser(prog="dmis", description="Data-driven multiple importance sampling.")
    parser.add_argument("--version", action="version", version=f"dmis {__version__}")
    commands = parser.add_subparsers(dest="command", required=True, metavar="COMMAND")
    add_options_by_command: dict[str, tuple[Callable[[argparse.ArgumentParser], None], str]] = {
        "render": (_render, "render a scene to an EXR file with layers"),
        "compare": (_compare, "compare rules on a scene: error, time, rays"),
        "oracle": (_oracle, "compute what the best weights and numbers of samples of a scene would save"),
        "info": (_info, "print versions, and the plan of a scene: what it needs, what is left out"),
        "check": (_check, "check lobes, lights, techniques and rules of your own"),
        "bench": (_bench, "measure the time of renders against that of their Embree calls alone"),
    }
    for name, (add_options, summary) in add_options_by_command.items():
        command = commands.add_parser(name, help=summary)
        add_options(command)
        command.add_argument(
            "--plugin",
            action="append",
            default=[],
            metavar="FILE.py",
            help="import this Python file first, so that the rules, techniques and samplers that it registers have "
            "names (repeatable)",
        )
    return parser


def _render(command: argparse.ArgumentParser) -> None:
    """Add the options of ``render``."""
    _add_scene_options(command)
    command.add_argument("scene", help="a pbrt file, a mesh file, or the name of a scene that comes with dmis")
    command.add_argument(
        "-o",
        "--output",
        required=True,
        metavar="OUT.exr",
        help="output image with the layers RGB, weight, variance, samples; or OUT.png, a preview alone",
    )
    command.add_argument("--png", metavar="OUT.png", help="also write a preview image")
    command.add_argument("--spp", type=int, help="camera samples per pixel, pilot included (default 128)")
    command.add_argument("--resolution", type=resolution, metavar="WxH", help="pixels (default: as the scene says)")
    _add_integrator(command)
    _add_as_in_file(command)
    command.add_argument(
        "--rule",
        help=f"weight rule: {', '.join(RULES)}; with options: thesis:patch=8,filter=none (default auto, or balance for "
        "fewer than 16 samples per pixel)",
    )
    command.add_argument("--seed", type=int, default=0, help="seed of the random numbers (default 0)")
    executor = command.add_mutually_exclusive_group()
    executor.add_argument("--threads", type=_workers, help="number of threads (default: one per processor)")
    executor.add_argument("--workers", type=_workers, metavar="N", help="number of processes, in place of threads")
    executor.add_argument(
        "--cluster", metavar="ADDRESS", help="address of a Dask scheduler, such as tcp://10.0.0.1:8786"
    )
    _add_setting(command, "--sampler", help=f"kind of sample points: {_SAMPLERS}")
    _add_preset(command)
    _add_setting(
        command, "--shading-samples", type=int, help="light and BRDF samples together per camera sample (default 2)"
    )
    _add_setting(
        command,
        "--replicates",
        type=int,
        choices=(1, 2, 4),
        help="divide the samples among independent copies of the sampler's points, so that the variance in the "
        "file is unbiased; the error itself is larger (default 1)",
    )
    _add_setting(
        command,
        "--lights",
        choices=("all", "one", "pbrt"),
        help="sample all lights at each shading point, or one chosen at random; pbrt: one at each vertex of a "
        "path, all in direct lighting (default all)",
    )
    _add_compensation(command, "0.9 with rules that learn from densities, such as auto, else 0")
    command.add_argument(
        "--checkpoint", metavar="DIR", help="folder for finished tiles; an interrupted render is resumed from it"
    )
    command.add_argument(
        "--stats",
        metavar="FILE.json",
        help="also write seconds, rays, memory and the time of Embree alone (renders the tiles once more)",
    )
    _add_verbosity(command, "the seconds of each stage and the number of rays")


def _compare(command: argparse.ArgumentParser) -> None:
    """Add the options of ``compare``."""
    _add_scene_options(command)
    _add_integrator(command)
    _add_as_in_file(command)
    command.add_argument("scene", help="a pbrt or mesh file, or the name of a scene that comes with dmis")
    command.add_argument(
        "--rules", default="balance,thesis,auto", help="rules separated by commas, or all (default balance,thesis,auto)"
    )
    command.add_argument(
        "--spp",
        type=_sample_counts,
        metavar="N,N,...",
        help="camera samples per pixel of each budget (default 128)",
    )
    command.add_argument("--seeds", type=int, default=5, metavar="K", help="number of seeds (default 5)")
    _add_setting(command, "--sampler", help=f"kind of sample points of all rules: {_SAMPLERS}")
    _add_preset(command)
    command.add_argument("--seed", type=int, default=0, help="first seed (default 0)")
    command.add_argument(
        "--reference",
        type=Path,
        metavar="REF",
        help=".exr or .npy file (default: rendered once, then read from the cache)",
    )
    command.add_argument(
        "--reference-spp",
        type=int,
        default=1024,
        help="camera samples per pixel of each half of a rendered reference (default 1024)",
    )
    command.add_argument(
        "--oracle-spp",
        type=int,
        metavar="N",
        help="also render the oracle with N samples per pixel (default: use it if it is in the cache)",
    )
    command.add_argument("--resolution", type=resolution, metavar="WxH", help="pixels (default: as the scene says)")
    command.add_argument("--threads", type=_workers, help="number of threads (default: one per processor)")
    command.add_argument(
        "-o",
        "--output",
        type=Path,
        required=True,
        metavar="DIR",
        help="output directory; an existing comparison in it is resumed",
    )
    _add_verbosity(command, "a line for each finished render")


def _oracle(command: argparse.ArgumentParser) -> None:
    """Add the options of ``oracle``."""
    _add_scene_options(command)
    _add_integrator(command)
    command.add_argument("scene", help="a pbrt or mesh file, or the name of a scene that comes with dmis")
    _add_compensation(command, "0.9, as rules that learn from densities; 0: as the balance heuristic")
    command.add_argument(
        "--spp", type=int, default=2048, help="camera samples per pixel, a multiple of 4 (default 2048)"
    )
    command.add_argument("--resolution", type=resolution, metavar="WxH", help="pixels (default: as the scene says)")
    command.add_argument("--threads", type=_workers, help="number of threads (default: one per processor)")
    command.add_argument(
        "-o", "--output", type=Path, required=True, metavar="DIR", help="output directory of table and plots"
    )
    command.add_argument("--quiet", action="store_true", help="print warnings and errors only")


def _add_compensation(command: argparse.ArgumentParser, default: str) -> None:
    """Add ``--compensation``, whose default the words describe."""
    _add_setting(
        command,
        "--compensation",
        type=float,
        metavar="SHARE",
        help="share of a sky's light samples that is drawn from what exceeds its mean radiance, from 0 to below 1 "
        f"(default: {default})",
    )


def _info(command: argparse.ArgumentParser) -> None:
    """Add the options of ``info``."""
    _add_scene_options(command)
    command.add_argument("scene", nargs="?", help="scene whose plan is printed (default: versions only)")
    command.add_argument("--resolution", type=resolution, metavar="WxH", help="pixels (default: as the scene says)")
    command.add_argument("--seed", type=int, default=0, help=argparse.SUPPRESS)


def _check(command: argparse.ArgumentParser) -> None:
    """Add the options of ``check``."""
    command.add_argument("file", metavar="FILE.py", help="Python file that defines lobes, lights, techniques or rules")
    command.add_argument(
        "-o",
        "--output",
        type=Path,
        metavar="DIR",
        help="directory of the pictures of what failed (default: that of the file)",
    )
    command.add_argument("--exercise", help=argparse.SUPPRESS)  # refused with the command that has replaced it


def _bench(command: argparse.ArgumentParser) -> None:
    """Add the options of ``bench``."""
    command.add_argument("scenes", nargs="*", metavar="SCENE", help="scenes (default: those that come with dmis)")
    command.add_argument("--rules", default="balance,thesis", help="rules separated by commas (default balance,thesis)")
    _add_integrator(command)
    command.add_argument(
        "--resolution", type=resolution, metavar="WxH", default=(342, 256), help="pixels (default 342x256)"
    )
    command.add_argument("--spp", type=int, default=64, help="camera samples per pixel (default 64)")
    command.add_argument("--threads", type=_workers, default=1, help="number of threads (default 1)")
    command.add_argument(
        "--repeats", type=int, default=3, help="renders of each scene and rule; the table has their medians (default 3)"
    )
    command.add_argument("--seed", type=int, default=0, help="first seed (default 0)")


def _add_setting(command: argparse.ArgumentParser, name: str, **arguments: Any) -> None:
    """Add an option for a field of `dmis.Settings`, which the result has only if it is given."""
    command.add_argument(name, default=argparse.SUPPRESS, **arguments)


def _add_preset(command: argparse.ArgumentParser) -> None:
    """Add --preset."""
    _add_setting(
        command,
        "--preset",
        choices=PRESETS,
        help="settings that no later version changes; thesis: the thesis's estimator, with its rule (default none)",
    )


def _add_integrator(command: argparse.ArgumentParser) -> None:
    """Add --integrator and --max-depth."""
    _add_setting(
        command,
        "--integrator",
        choices=("auto", "direct", "path"),
        help="direct: light that comes straight from the lights; path: also light that other surfaces scatter; auto: "
        "as the scene file says, or the default of its dialect (default auto)",
    )
    _add_setting(
        command,
        "--max-depth",
        type=_depth,
        metavar="D",
        help="largest number of surfaces on a path; direct: through mirrors and glass; path: that scatter light, where "
        "1 is direct lighting and none sets no limit (default: as the scene says, or 5)",
    )


def _add_as_in_file(command: argparse.ArgumentParser) -> None:
    """Add --as-in-file."""
    command.add_argument(
        "--as-in-file",
        action="store_true",
        help="take sampler, samples per pixel and light, and strategy from the scene file, unless other options say",
    )


def _add_scene_options(command: argparse.ArgumentParser) -> None:
    """Add the options of scene files."""
    command.add_argument(
        "--dialect", choices=("v2", "v3", "v4"), help="version of pbrt files (default: recognised by their words)"
    )
    command.add_argument(
        "--allow-outside", action="store_true", help="allow the scene to read files outside of its folder"
    )
    command.add_argument("--up", choices=("y", "z"), help="axis of a mesh file that is up (default: z; GLB: y)")


def _add_verbosity(command: argparse.ArgumentParser, details: str) -> None:
    """Add --quiet and --verbose, which also prints `details`."""
    verbosity = command.add_mutually_exclusive_group()
    verbosity.add_argument("--quiet", action="store_true", help="print warnings and errors only")
    verbosity.add_argument("--verbose", action="store_true", help=f"also print the plan of the scene, {details}")


def resolution(text: str) -> tuple[int, int]:
    """Return the width and height of WIDTHxHEIGHT."""
    width, x, height = text.lower().partition("x")
    if not (x and width.isdecimal() and height.isdecimal()):
        raise argparse.ArgumentTypeError(f"must be WIDTHxHEIGHT with the letter x, such as 342x256; got {text!r}")
    try:
        camera.check_resolution(int(width), int(height))
    except ValueError as error:
        raise argparse.ArgumentTypeError(str(error)) from error
    return int(width), int(height)


def _sample_counts(text: str) -> list[int]:
    """Return positive whole numbers from a text that separates them by commas."""
    numbers = text.split(",")
    if not all(number.strip().isdecimal() and int(number) > 0 for number in numbers):
        raise argparse.ArgumentTypeError(f"must be positive whole numbers separated by commas; got {text!r}")
    return [int(number) for number in numbers]


def _workers(text: str) -> int:
    """Return a number of threads or processes."""
    if not (text.isdecimal() and 1 <= int(text) <= MAX_WORKERS):
        raise argparse.ArgumentTypeError(f"must be a whole number from 1 to {MAX_WORKERS}; got {text!r}")
    return int(text)


def _depth(text: str) -> int | str | None:
    """Return a path depth: a number, ``auto``, or None for ``none``, which sets no limit."""
    return None if text == "none" else text if text == "auto" else int(text)
