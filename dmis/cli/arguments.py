"""Commands of the command line, their options, and the parsers of their values.

`COMMANDS` is the table of both. Options that are fields of `dmis.Settings` come from those fields, with their help.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Container, Mapping, Sequence
from dataclasses import fields
from pathlib import Path
from typing import Any, NamedTuple, NoReturn

from dmis import __version__
from dmis.base.synonyms import COMMAND_LINE, advice
from dmis.base.text import printable
from dmis.base.window import MAX_SIDE
from dmis.estimator.settings import Settings
from dmis.fit.registry import RULES
from dmis.pipeline.executor import MAX_WORKERS

Options = Mapping[str, Mapping[str, Any]]
"""Arguments of ``add_argument`` by option, its names separated by spaces; options of a ``group`` exclude each other."""


class Command(NamedTuple):
    """A command: the module of `dmis.cli` that has its function, its summary and its options."""

    module: str
    summary: str
    options: Options


class _Parser(argparse.ArgumentParser):
    """A parser whose errors show control characters of the arguments, and do not send them to the terminal."""

    def error(self, message: str) -> NoReturn:
        super().error(printable(message))

    def parse_args(self, args: Sequence[str] | None = None, namespace: Any = None) -> Any:  # type: ignore[override]
        """Return the options; a word that is none ends the program with what to write in its place."""
        words = sys.argv[1:] if args is None else list(args)
        if words and not words[0].startswith("-") and words[0] not in COMMANDS:
            self.error(f"there is no command {words[0]}{advice(words[0], COMMAND_LINE, COMMANDS)}; see dmis --help")
        known, unknown = self.parse_known_args(words, namespace)
        if unknown:
            word = unknown[0].partition("=")[0]
            options = " ".join((*COMMANDS[known.command].options, *PLUGIN)).split()
            self.error(f"{known.command} has no {word}{advice(word, COMMAND_LINE, options)}")
        return known


def make_parser() -> argparse.ArgumentParser:
    """Return the parser of all commands and their options; its result has the name of the command in ``command``."""
    parser = _Parser(prog="dmis", description="Data-driven multiple importance sampling.")
    parser.add_argument("--version", action="version", version=f"dmis {__version__}")
    commands = parser.add_subparsers(dest="command", required=True, metavar="COMMAND")
    for name, (_, summary, options) in COMMANDS.items():
        command = commands.add_parser(name, help=summary)
        groups: dict[str, Any] = {"": command}
        for names, arguments in {**options, **PLUGIN}.items():
            group = arguments["group"]
            if group not in groups:
                groups[group] = command.add_mutually_exclusive_group()
            values = {key: value for key, value in arguments.items() if key != "group" and value is not None}
            groups[group].add_argument(*names.split(), **values)
    return parser


def _numbers(
    form: str, least: float, most: float, counts: Container[int] = (1,), separator: str = ",", parse: Any = int
) -> Any:
    """Return a parser of numbers from `least` to `most`, as many as `counts` allow; its message has their `form`."""

    def parsed(text: str) -> Any:
        try:
            values = tuple(map(parse, text.lower().split(separator)))
        except ValueError:
            values = ()
        if len(values) not in counts or not all(least <= value <= most for value in values):
            raise argparse.ArgumentTypeError(f"must be {form}; got {text!r}")
        return values if counts != (1,) else values[0]

    return parsed


def _number(least: float, most: float, parse: Any = int) -> Any:
    """Return a parser of one number from `least` to `most`, a whole one unless `parse` is float."""
    kind = "whole number" if parse is int else "number"
    return _numbers(f"a {kind} from {least} to {most}", least, most, parse=parse)


def settings_options(*without: str) -> dict[str, dict[str, Any]]:
    """Return the options for fields of `dmis.Settings`; the parsed result has those only that are given."""
    options = {}
    for name, about in ((field.name, field.metadata) for field in fields(Settings)):
        if about and name not in without:
            of_values = {"choices": about["choices"]} if about["choices"] else {"metavar": about["metavar"]}
            option = _option(about["help"], about["type"], argparse.SUPPRESS, **of_values)
            options[f"--{name.replace('_', '-')}"] = option
    return options


def _option(text: str, parse: Any = None, default: Any = None, group: str = "", **more: Any) -> dict[str, Any]:
    """Return the arguments of ``add_argument`` for an option with the help `text`."""
    return {"help": text, "type": parse, "default": default, "group": group, **more}


def _flag(text: str, group: str = "") -> dict[str, Any]:
    """Return the arguments of ``add_argument`` for an option without a value."""
    return {"help": text, "action": "store_true", "group": group}


POSITIVE = _number(1e-30, 1e30, float)
SIZE = f"WIDTHxHEIGHT with the letter x, such as 342x256, each from 1 to {MAX_SIDE}"
RESOLUTION = _numbers(SIZE, 1, MAX_SIDE, (2,), "x")
"""Parser of the width and height of an image."""
PLUGIN_HELP = "import this Python file first, to know the rules and samplers that it registers (repeatable)"
PLUGIN = {"--plugin": _option(PLUGIN_HELP, default=[], action="append", metavar="FILE.py")}
SCENE = {
    "scene": _option("a pbrt file, a mesh file, or the name of a scene that comes with dmis"),
    "--resolution": _option("pixels (default: those of the scene)", RESOLUTION, metavar="WxH"),
    "--dialect": _option("version of a pbrt file (default: recognised from the file)", choices=("v2", "v3", "v4")),
    "--allow-outside": _flag("allow the scene to read files outside of its folder"),
    "--up": _option("axis of a model that points up (default: y; PLY and STL: z)", choices=("y", "z")),
    "--camera": _option("camera of a model, by name or number from 0 (default: first)", group="view", metavar="NAME"),
    "--look-at": _option(
        "position of the camera for a model, and the point in the middle of the image", float, group="view",
        nargs=6, metavar=("X", "Y", "Z", "X", "Y", "Z"),
    ),
    "--fov": _option("field of view across the shorter side of the image, in degrees", float, metavar="F"),
    "--light": _option("sky that replaces a model's lights except surfaces: an image file or 'R G B'", metavar="SKY"),
}  # fmt: skip
METRIC = _option("error that is shown: relmse (default), mse or flip", str, "relmse", metavar="M")
AS_IN_FILE = {"--as-in-file": _flag("take sampler, samples and strategy from the scene file, unless given here")}
SPP_LIST = _numbers("whole numbers of at least 1, separated by commas", 1, 2**63, range(1, 2**16))
CROP = _numbers("x0,y0,x1,y1 in pixels, such as 0,0,64,48", 0, MAX_SIDE, (4,))
ALBEDO = _numbers("one number from 0 to 1, or four separated by commas", 0, 1, (1, 4), parse=float)
WORKERS = _number(1, MAX_WORKERS)
SEED = _number(0, 2**63)
THREADS = {"--threads": _option("number of threads (default: one per processor)", WORKERS, group="executor")}
QUIET = {"--quiet": _flag("print warnings and errors only", "output")}
VERBOSE = {"--verbose": _flag("also print the scene's plan, rays and seconds, or a line for each render", "output")}
RULES_HELP = f"""weight rule: {", ".join(RULES)}; with options: thesis:patch=8,filter=none (default auto, or balance for
fewer than 16 samples per pixel)"""
OUTPUT = "-o --output"
COMMANDS: Mapping[str, Command] = {
    "render": Command("rendering", "render a scene to an EXR file with layers", {
        **SCENE,
        OUTPUT: _option("image with layers; or OUT.png for a preview alone", required=True, metavar="OUT.exr"),
        "--png": _option("also write a preview image", metavar="OUT.png"),
        "--exposure": _option("factor of the preview (default 1; automatic for lit models)", POSITIVE, metavar="X"),
        "--crop": _option("window of the image in pixels, x1 and y1 excluded", CROP, metavar="x0,y0,x1,y1"),
        "--layers": _option("more layers, such as albedo,normal,direct,light:0 (docs/cli.md)", metavar="NAME,NAME,..."),
        "--spp": _option("camera samples per pixel, pilot included (default 128); maximum for --noise, --seconds", int),
        "--noise": _option("double the samples until the root of the estimated relMSE is <= X", float, metavar="X"),
        "--seconds": _option("double the samples unless this would exceed S seconds", float, metavar="S"),
        "--rule": _option(RULES_HELP),
        "--seed": _option("seed of the random numbers (default 0)", SEED, 0),
        **settings_options(),
        **AS_IN_FILE,
        **THREADS,
        "--workers": _option("number of processes, in place of threads", WORKERS, metavar="N", group="executor"),
        "--cluster": _option("Dask scheduler, such as tcp://10.0.0.1:8786", metavar="ADDRESS", group="executor"),
        "--checkpoint": _option("folder for finished tiles; the same command resumes a render", metavar="DIR"),
        "--stats": _option("also write seconds, rays, memory and the time in Embree", metavar="FILE.json"),
        **QUIET,
        **VERBOSE,
    }),
    "compare": Command("reports", "compare rules on one scene or several: error, time, rays", {
        **SCENE,
        "scene": _option("one scene, or several with a folder for each in DIR", nargs="+", metavar="SCENE"),
        OUTPUT: _option("output directory; a comparison in it is resumed", Path, required=True, metavar="DIR"),
        "--rules": _option("rules separated by commas, or all (default %(default)s)", str, "balance,thesis,auto"),
        "--spp": _option("budgets of camera samples per pixel (default 128)", SPP_LIST, metavar="N,N,..."),
        "--seeds": _option("number of seeds, from --seed on (default 5)", _number(1, 10_000), 5, metavar="K"),
        "--seed": _option("first seed (default 0)", SEED, 0),
        **settings_options(),
        **AS_IN_FILE,
        "--reference": _option(".exr file (default: rendered once, then cached)", Path, metavar="REF"),
        "--reference-spp": _option("camera samples per pixel of each half of a reference (default 1024)", int, 1024),
        "--crop": _option("window that is rendered and compared, in pixels", CROP, metavar="x0,y0,x1,y1"),
        **THREADS,
        **QUIET,
        **VERBOSE,
    }),
    "figure": Command("reports", "draw a figure or a table of a comparison for a paper", {
        "folder": _option("folder of a comparison, written by compare", Path, metavar="DIR"),
        OUTPUT: _option(
            "figure: .pdf, .png, .svg, or .html with linked zoom; table: .tex, .md, .csv", Path, required=True,
            metavar="FILE",
        ),
        "--rules": _option("rules separated by commas (default: all)", str, "", metavar="A,B,..."),
        "--crops": _option(
            "windows in pixels, of one size (default: two, where the rules differ most)", CROP, (), nargs="+",
            metavar="x0,y0,x1,y1",
        ),
        "--metric": _option(f"{METRIC['help']}; of a table: relmse or mse (default: both)", str, "", metavar="M"),
        "--exposure": _option("factor of the images (default 1)", POSITIVE, 1.0, metavar="X"),
        "--width": _option("inches: 7 for a page (default), 3.33 for a column", _number(2, 20, float), 7, metavar="IN"),
        "--errors": _flag("also draw maps of errors, on one scale"),
    }),
    "play": Command("reports", "write a page to paint weights on, which shows the resulting error times time", {
        **SCENE,
        OUTPUT: _option("page for a browser, usable offline", Path, required=True, metavar="OUT.html"),
        "--resolution": _option("pixels (default 160x120)", RESOLUTION, (160, 120), metavar="WxH"),
        "--spp": _option("camera samples per pixel for the curves, a multiple of 4 (default 512)", int, 512),
        "--patch": _option("side of a patch in pixels, a multiple of 4 (default 4)", _number(1, 65_536), 4),
        **settings_options("sampler", "preset"),
        **THREADS,
        **QUIET,
    }),
    "info": Command("info", "print versions, the plan of a scene, or the layers or errors of images", {
        **SCENE,
        "scene": _option("scene, image, or two images, the second a reference (default: versions only)", nargs="*"),
        OUTPUT: _option("also draw a map of the errors of the first image against the second", Path, metavar="MAP.png"),
        "--metric": METRIC,
        "--rules": _flag("list the rules, with the options of each"),
        "--scenes": _flag("list the scenes that come with dmis"),
        "--rule": _option("rule for which all settings are printed, and who decides each: caller, rule, preset, ..."),
        **settings_options(),
    }),
    "check": Command("checks", "check lobes, lights, techniques, rules and samplers of your own", {
        "file": _option("Python file that defines lobes, lights, techniques, rules or samplers", metavar="FILE.py"),
        "--albedo": _option(
            "largest channel of the albedo that a lobe must have: one number, or four separated by commas, for wo at "
            "0, 35, 70 and 85 degrees (default: any, at most 1)", ALBEDO, (), metavar="A",
        ),
    }),
    "doctor": Command("checks", "find faults of multiple importance sampling in a table of any renderer's samples", {
        "table": _option("file of shading samples (docs/doctor.md lists the columns)", metavar="SAMPLES.npz"),
        "--report": _option("also write a page for a browser", Path, metavar="OUT.html"),
    }),
    "bench-rules": Command("checks", "score weight rules on MIS-Bench, without rendering", {
        "rules": _option("Python files or names of rules (default: those of the page)", nargs="*", metavar="RULE"),
        "--scenes": _option("scenes or data files: small,kitchen.npz (default: all eight)", str, "", metavar="A,B,..."),
        "--seeds": _option("number of seeds of the pilots (default %(default)s)", _number(1, 100), 4, metavar="K"),
        "--format": _option("text (default), or json: columns of each seed", None, "text", choices=("text", "json")),
    }),
}  # fmt: skip
"""The commands by name."""
