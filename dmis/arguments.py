"""What the command line takes: commands, options and how they are read."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path

from dmis import __version__, camera
from dmis.rules import RULES
from dmis.samplers import KINDS


def make_parser() -> argparse.ArgumentParser:
    """The commands and their options; ``command`` is the name of the one that was given."""
    parser = argparse.ArgumentParser(prog="dmis", description="Data-driven multiple importance sampling.")
    parser.add_argument("--version", action="version", version=f"dmis {__version__}")
    commands = parser.add_subparsers(dest="command", required=True, metavar="COMMAND")
    known: dict[str, tuple[Callable[[argparse.ArgumentParser], None], str]] = {
        "render": (_render, "render a scene to an EXR file with layers"),
        "compare": (_compare, "rules side by side: error, time, rays"),
        "info": (_info, "versions, and what a scene needs"),
        "bench": (_bench, "speed against the same Embree calls alone"),
    }
    for name, (add_options, explained) in known.items():
        add_options(commands.add_parser(name, help=explained))
    return parser


def _render(command: argparse.ArgumentParser) -> None:
    _add_scene_options(command)
    command.add_argument("scene", help="a pbrt file, a mesh file, or the name of a scene that comes with dmis")
    command.add_argument(
        "-o", "--output", required=True, metavar="OUT.exr", help="layers RGB, weight, variance, samples"
    )
    command.add_argument("--png", metavar="OUT.png", help="also write a preview")
    command.add_argument("--spp", type=int, default=128, help="camera samples per pixel, pilot included (default 128)")
    command.add_argument("--resolution", type=_resolution, metavar="WxH", help="default: the scene's")
    _add_integrator(command)
    command.add_argument(
        "--rule",
        help=f"{', '.join(RULES)}; with options, thesis:patch=8,filter=none (default auto; balance for few samples)",
    )
    command.add_argument("--seed", type=int, default=0)
    where = command.add_mutually_exclusive_group()
    where.add_argument("--threads", type=int, help="default: one per processor")
    where.add_argument("--workers", type=int, metavar="N", help="processes in place of threads")
    where.add_argument("--cluster", metavar="ADDRESS", help="a Dask scheduler, such as tcp://10.0.0.1:8786")
    command.add_argument("--sampler", choices=KINDS, default="independent")
    command.add_argument(
        "--shading-samples", type=int, default=2, help="light or BRDF samples per camera sample (default 2)"
    )
    command.add_argument(
        "--lights", choices=("all", "one"), default="all", help="sample all lights, or one picked at random"
    )
    command.add_argument(
        "--clamp", type=float, metavar="L", help="biased: scale camera samples down to this radiance (default: none)"
    )
    command.add_argument("--checkpoint", metavar="FILE", help="save finished tiles here, and go on from here")
    command.add_argument(
        "--stats", metavar="FILE.json", help="write seconds, rays and the Embree floor (renders once more)"
    )
    _add_talk(command, "where the time went, what was traced")


def _compare(command: argparse.ArgumentParser) -> None:
    _add_scene_options(command)
    _add_integrator(command)
    command.add_argument("scene", help="a pbrt or mesh file, or the name of a scene that comes with dmis")
    command.add_argument("--rules", default="balance,thesis,auto", help="separated by commas, or all")
    command.add_argument("--spp", type=_numbers, default=[128], metavar="N,N,...", help="budgets (default 128)")
    command.add_argument("--seeds", type=int, default=5, metavar="K", help="number of seeds (default 5)")
    command.add_argument("--sampler", choices=KINDS, default="independent", help="of all rules, balance too")
    command.add_argument("--seed", type=int, default=0, help="the first seed")
    command.add_argument("--reference", type=Path, metavar="REF", help=".exr or .npy; default: rendered once and kept")
    command.add_argument("--reference-spp", type=int, default=1024, help="of each half, if rendered (default 1024)")
    command.add_argument(
        "--oracle-spp", type=int, metavar="N", help="render the oracle too, and keep it (default: only if it is kept)"
    )
    command.add_argument("--resolution", type=_resolution, metavar="WxH", help="default: the scene's")
    command.add_argument("--threads", type=int, help="default: one per processor")
    command.add_argument(
        "-o", "--output", type=Path, required=True, metavar="DIR", help="what is there already is gone on from"
    )
    _add_talk(command, "a line for each render as it is finished")


def _info(command: argparse.ArgumentParser) -> None:
    _add_scene_options(command)
    command.add_argument("scene", nargs="?")
    command.add_argument("--resolution", type=_resolution, metavar="WxH")
    command.add_argument("--seed", type=int, default=0, help=argparse.SUPPRESS)


def _bench(command: argparse.ArgumentParser) -> None:
    command.add_argument("scenes", nargs="*", metavar="SCENE", help="default: the scenes that come with dmis")
    command.add_argument("--rules", default="balance,thesis", help="separated by commas (default balance,thesis)")
    _add_integrator(command)
    command.add_argument("--resolution", type=_resolution, metavar="WxH", default=(342, 256), help="default 342x256")
    command.add_argument("--spp", type=int, default=64)
    command.add_argument("--threads", type=int, default=1, help="default 1")
    command.add_argument("--repeats", type=int, default=3, help="in turns; the table has medians (default 3)")
    command.add_argument("--seed", type=int, default=0)


def _add_integrator(command: argparse.ArgumentParser) -> None:
    command.add_argument(
        "--integrator",
        choices=("auto", "direct", "path"),
        default="auto",
        help="light from the lights alone, or also what other surfaces scatter; auto, the default: what the scene "
        "asks for, or what its plan recommends",
    )
    command.add_argument(
        "--max-depth",
        type=_depth,
        default="auto",
        metavar="D",
        help="direct: surfaces visited through mirrors and glass; path: surfaces that scatter light, 1 being direct "
        "lighting, or none for any number (default: what the scene asks for, or 5)",
    )


def _add_scene_options(command: argparse.ArgumentParser) -> None:
    command.add_argument("--dialect", choices=("v2", "v3", "v4"), help="of pbrt files (default: by what they say)")
    command.add_argument(
        "--allow-outside", action="store_true", help="let the scene read files outside of its own folder"
    )


def _add_talk(command: argparse.ArgumentParser, more: str) -> None:
    talk = command.add_mutually_exclusive_group()
    talk.add_argument("--quiet", action="store_true", help="print warnings and errors only")
    talk.add_argument("--verbose", action="store_true", help=f"also print what the scene needs, {more}")


def _resolution(text: str) -> tuple[int, int]:
    width, x, height = text.lower().partition("x")
    if not (x and width.isdecimal() and height.isdecimal()):
        raise argparse.ArgumentTypeError(f"must be WIDTHxHEIGHT, such as 342x256; got {text!r}")
    try:
        camera.check_resolution(int(width), int(height))
    except ValueError as error:
        raise argparse.ArgumentTypeError(str(error)) from error
    return int(width), int(height)


def _numbers(text: str) -> list[int]:
    parts = text.split(",")
    if not all(part.strip().isdecimal() and int(part) > 0 for part in parts):
        raise argparse.ArgumentTypeError(f"must be positive whole numbers separated by commas; got {text!r}")
    return [int(part) for part in parts]


def _depth(text: str) -> int | str | None:
    return None if text == "none" else text if text == "auto" else int(text)
