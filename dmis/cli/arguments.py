"""Commands of the command line, their options, and the parsers of their values.

`COMMANDS` is the table of both. Options that are fields of `dmis.Settings` come from those fields, with their help.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Container, Mapping, Sequence
from dataclasses import fields
from pathlib import Path
from typing import Any, NoReturn

from dmis import __version__
from dmis.base.synonyms import COMMAND_LINE, advice
from dmis.base.text import printable
from dmis.bench.data import SCENES as BENCH_SCENES
from dmis.bench.judge import STYLES
from dmis.estimator.settings import Settings
from dmis.experiment.convergence import METRICS
from dmis.fit.registry import RULES
from dmis.fit.round import WEIGH
from dmis.image import MAX_SIDE
from dmis.pipeline.executor import MAX_WORKERS

Options = Mapping[str, Mapping[str, Any]]
"""Arguments of ``add_argument`` by option, its names separated by spaces; options of a ``group`` exclude each other."""


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
            options = " ".join((*COMMANDS[known.command][1], *PLUGIN)).split()
            self.error(f"{known.command} has no {word}{advice(word, COMMAND_LINE, options)}")
        return known


def make_parser() -> argparse.ArgumentParser:
    """Return the parser of all commands and their options; its result has the name of the command in ``command``."""
    parser = _Parser(prog="dmis", description="Data-driven multiple importance sampling.")
    parser.add_argument("--version", action="version", version=f"dmis {__version__}")
    commands = parser.add_subparsers(dest="command", required=True, metavar="COMMAND")
    for name, (summary, options) in COMMANDS.items():
        command = commands.add_parser(name, help=summary)
        groups: dict[str, Any] = {"": command}
        for names, arguments in {**options, **PLUGIN}.items():
            group = arguments["group"]
            if group not in groups:
                groups[group] = command.add_mutually_exclusive_group()
            values = {key: value for key, value in arguments.items() if key != "group" and value is not None}
            groups[group].add_argument(*names.split(), **values)
    return parser


def _number(most: float, least: float = 1, parse: Any = int) -> Any:
    """Return a parser of numbers from `least` to `most`, whole ones unless `parse` is float."""

    def parsed(text: str) -> Any:
        try:
            value = parse(text)
        except ValueError:
            value = None
        if value is None or not least <= value <= most:
            kind = "whole number" if parse is int else "number"
            raise argparse.ArgumentTypeError(f"must be a {kind} from {least} to {most}; got {text!r}")
        return value

    return parsed


def _numbers(form: str, number: Any, counts: Container[int], separator: str = ",") -> Any:
    """Return a parser of numbers with separators between them, `counts` of which are allowed; messages have `form`."""

    def parsed(text: str) -> tuple[Any, ...]:
        parts = text.lower().split(separator)
        if len(parts) not in counts:
            raise argparse.ArgumentTypeError(f"must be {form}; got {text!r}")
        return tuple(map(number, parts))

    return parsed


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


POSITIVE = _number(1e30, 1e-30, float)
RESOLUTION = _numbers("WIDTHxHEIGHT with the letter x, such as 342x256", _number(MAX_SIDE), (2,), "x")
"""Parser of the width and height of an image."""
PLUGIN_HELP = "import this Python file first, to know the rules and samplers that it registers (repeatable)"
PLUGIN = {"--plugin": _option(PLUGIN_HELP, default=[], action="append", metavar="FILE.py")}
SCENE = {
    "scene": _option("a pbrt file, a mesh file, or the name of a scene that comes with dmis"),
    "--resolution": _option("pixels (default: those of the scene)", RESOLUTION, metavar="WxH"),
    "--dialect": _option("version of a pbrt file (default: recognised from the file)", choices=("v2", "v3", "v4")),
    "--allow-outside": _flag("allow the scene to read files outside of its folder"),
    "--up": _option("axis of a model that points up (default: y; PLY and STL: z)", choices=("y", "z")),
    "--camera": _option(
        "camera in a model's file, by name or number from 0 on (default: the first, or a camera that sees all)",
        group="view",
        metavar="NAME",
    ),
    "--look-at": _option(
        "position of the camera for a model, and the point in the middle of the image",
        float,
        nargs=6,
        group="view",
        metavar=("X", "Y", "Z", "X", "Y", "Z"),
    ),
    "--fov": _option("field of view across the shorter side of the image, in degrees", float, metavar="F"),
    "--light": _option("sky that replaces a model's lights except surfaces: an image file or 'R G B'", metavar="SKY"),
    "--material": _option(
        "material that replaces all materials of a model, such as 'metallic_roughness:base=0.9 0.6 0.2,metallic=1'",
        metavar="M",
    ),
}
AS_IN_FILE = {"--as-in-file": _flag("take sampler, samples and strategy from the scene file, unless given here")}
SPP_LIST = _numbers("", _number(2**63), range(1, 2**16))
CROP = _numbers("x0,y0,x1,y1 in pixels, such as 0,0,64,48", _number(MAX_SIDE, 0), (4,))
ALBEDO = _numbers("one number, or four separated by commas", _number(1, 0, float), (1, 4))
WORKERS, SEED = _number(MAX_WORKERS), _number(2**63, 0)
THREADS = {"--threads": _option("number of threads (default: one per processor)", WORKERS, group="executor")}
QUIET = {"--quiet": _flag("print warnings and errors only", "output")}
VERBOSE = {"--verbose": _flag("also print the scene's plan, rays and seconds, or a line for each render", "output")}
RULES_HELP = f"""weight rule: {", ".join(RULES)}; with options: thesis:patch=8,filter=none (default auto, or balance for
fewer than 16 samples per pixel)"""
OUTPUT = "-o --output"
FOLDER: dict[str, Any] = {"parse": Path, "required": True, "metavar": "DIR"}
COMMANDS: Mapping[str, tuple[str, Options]] = {
    "render": ("render a scene to an EXR file with layers", {
        **SCENE,
        OUTPUT: _option("image with layers; or OUT.png for a preview alone", required=True, metavar="OUT.exr"),
        "--png": _option("also write a preview image", metavar="OUT.png"),
        "--exposure": _option(
            "brightness factor of the preview (default 1; automatic for a model with lights)", POSITIVE, metavar="X"
        ),
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
    "compare": ("compare rules on one scene or several: error, time, rays", {
        **SCENE,
        "scene": _option("one scene, or several with a folder for each in DIR", nargs="+", metavar="SCENE"),
        OUTPUT: _option("output directory; an existing comparison in it is resumed", **FOLDER),
        "--rules": _option("rules separated by commas, or all (default %(default)s)", str, "balance,thesis,auto"),
        "--spp": _option("budgets of camera samples per pixel (default 128)", SPP_LIST, metavar="N,N,..."),
        "--seeds": _option("number of seeds, from --seed on (default 5)", _number(10_000), 5, metavar="K"),
        "--seed": _option("first seed (default 0)", SEED, 0),
        **settings_options(),
        **AS_IN_FILE,
        "--reference": _option(".exr or .npy file (default: rendered once, then cached)", Path, metavar="REF"),
        "--reference-spp": _option("camera samples per pixel of each half of a reference (default 1024)", int, 1024),
        "--crop": _option("window of the errors in pixels, x1 and y1 excluded", CROP, metavar="x0,y0,x1,y1"),
        "--oracle-spp": _option("also render the oracle, N samples per pixel, or read the cache", int, metavar="N"),
        **THREADS,
        **QUIET,
        **VERBOSE,
    }),
    "figure": ("draw a figure of a comparison for a paper: the image, and crops of each rule", {
        "folder": _option("folder of a comparison, written by compare", Path, metavar="DIR"),
        OUTPUT: _option("figure: .pdf, .png, or an .html page with linked zoom", Path, required=True, metavar="FILE"),
        "--rules": _option("rules separated by commas (default: all)", str, "", metavar="A,B,..."),
        "--crops": _option(
            "windows in pixels, of one size (default: two, where the rules differ most)", CROP, (),
            nargs="+", metavar="x0,y0,x1,y1",
        ),
        "--metric": _option("error below each rule (default %(default)s)", str, "relmse", choices=tuple(METRICS)),
        "--exposure": _option("factor of the images (default 1)", POSITIVE, 1.0, metavar="X"),
        "--width": _option("inches: 7 for a page (default), 3.33 for a column", POSITIVE, 7.0, metavar="IN"),
        "--errors": _flag("also draw maps of errors, on one scale"),
    }),
    "table": ("write the table of a comparison for a paper: LaTeX, Markdown or CSV", {
        "folder": _option("folder of a comparison, written by compare", Path, metavar="DIR"),
        OUTPUT: _option("table: .tex, .md or .csv", Path, required=True, metavar="FILE"),
    }),
    "diff": ("measure the error of one image against another: MSE, relMSE, FLIP", {
        "image": _option("EXR or .npy file", Path, metavar="A.exr"),
        "reference": _option("EXR or .npy file of the reference", Path, metavar="B.exr"),
        "--metric": _option("error drawn in the map (default %(default)s)", str, "relmse", choices=tuple(METRICS)),
        OUTPUT: _option("also draw a map of the errors", Path, metavar="MAP.png"),
    }),
    "oracle": ("compute how much the best weights and numbers of samples would save", {
        **SCENE,
        OUTPUT: _option("output directory of table and plots", **FOLDER),
        "--spp": _option("camera samples per pixel, a multiple of 4 (default 2048)", int, 2048),
        "--weigh": _option("meaning of w: share of samples (default), or heuristic", str, WEIGH[0], choices=WEIGH),
        **settings_options("sampler", "preset"),
        **THREADS,
        **QUIET,
    }),
    "play": ("write a page to paint weights on, which shows the resulting error times time", {
        **SCENE,
        OUTPUT: _option("page for a browser, usable offline", Path, required=True, metavar="OUT.html"),
        "--resolution": _option("pixels (default 160x120)", RESOLUTION, (160, 120), metavar="WxH"),
        "--spp": _option("camera samples per pixel for the curves, a multiple of 4 (default 512)", int, 512),
        "--patch": _option("side of a patch in pixels, a multiple of 4 (default 4)", _number(65_536), 4),
        **settings_options("sampler", "preset"),
        **THREADS,
        **QUIET,
    }),
    "info": ("print versions, and the plan of a scene: the work to do and to skip", {
        **SCENE,
        "scene": _option("scene whose plan is printed (default: versions only)", nargs="?"),
        "--rules": _flag("list the rules, with the options of each"),
        "--scenes": _flag("list the scenes that come with dmis"),
        "--rule": _option("rule for which all settings are printed, and who decides each: caller, rule, preset, ..."),
        **settings_options(),
    }),
    "check": ("check lobes, lights, techniques, rules and samplers of your own", {
        "file": _option("Python file that defines lobes, lights, techniques, rules or samplers", metavar="FILE.py"),
        "--albedo": _option(
            "largest channel of the albedo that a lobe must have: one number, or four separated by commas, for wo at "
            "0, 35, 70 and 85 degrees (default: any, at most 1)", ALBEDO, (), metavar="A",
        ),
    }),
    "doctor": ("find faults of multiple importance sampling in a table of any renderer's samples", {
        "table": _option("file of shading samples (docs/doctor.md lists the columns)", metavar="SAMPLES.npz"),
        "--report": _option("also write a page for a browser", Path, metavar="OUT.html"),
    }),
    "bench-rules": ("score weight rules on MIS-Bench, without rendering", {
        "rules": _option("Python files or names of rules (default: those of the page)", nargs="*", metavar="RULE"),
        "--scenes": _option(
            "scenes or data files separated by commas, such as small,kitchen.npz (default: all eight)", str,
            ",".join(BENCH_SCENES),
        ),
        "--render": _flag("also render the learned shares with Sobol points, and print errors over balance"),
        "--seeds": _option("number of seeds of the pilots (default %(default)s)", _number(100), 4, metavar="K"),
        "--format": _option("format of the tables (default %(default)s)", str, "text", choices=STYLES),
    }),
}  # fmt: skip
"""Summary and options of each command."""
