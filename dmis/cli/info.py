"""The command ``info``: versions, rules and scenes, the plan of a scene, and the layers or errors of images."""

from __future__ import annotations

import argparse
import platform
import time
from importlib.metadata import version
from importlib.util import find_spec
from pathlib import Path

from dmis import __version__
from dmis.base.atomic_files import check_writable
from dmis.base.validate import check_package
from dmis.cli.shared import describe, load, say
from dmis.experiment.metrics import flip, mse, relmse
from dmis.experiment.reference import load_reference
from dmis.fit.registry import RULES, about
from dmis.formats.shipped import SHIPPED
from dmis.image import read_exr
from dmis.pipeline.job import resolve


def info(options: argparse.Namespace) -> int:
    """Run ``info`` and return its exit code."""
    if len(options.scene) == 2:
        return _errors(options)
    if len(options.scene) > 2 or options.output is not None:
        raise ValueError(f"info takes a scene, an image, or two images and -o MAP.png; got {len(options.scene)}")
    if options.scenes:
        say(*SHIPPED)
    if options.rules:
        say(*(f"{name:18} {about(name)}\n{'':18} {make()!r}" for name, make in RULES.items()))
    if options.scenes or options.rules:
        return 0
    machine = f"{platform.system()} {platform.machine()}"
    names = ("numpy", "scipy", "trimesh", "embreex", "OpenEXR")
    packages = ", ".join(f"{name} {version(name) if find_spec(name) else 'missing'}" for name in names)
    say(f"dmis {__version__}, Python {platform.python_version()}, {machine}\n{packages}")
    for name in options.scene:
        if name.lower().endswith(".exr"):
            layers, attributes = read_exr(name)
            sizes = (f"  {layer}: {' x '.join(map(str, values.shape))}" for layer, values in layers.items())
            say("", f"image {name}, layers:", *sizes, *(f"  {key}: {text}" for key, text in attributes.items()))
        else:
            _plan(options, name)
    return 0


def _plan(options: argparse.Namespace, name: str) -> None:
    """Print the plan of a scene, and with a rule or settings among the options who decides each setting."""
    begin = time.perf_counter()
    scene, _ = load(options, name).in_float32
    scene.prepare()
    say(f"\n{describe(scene)}\nread and built in {time.perf_counter() - begin:.2f} s")
    if options.rule or options.given:
        job = resolve(scene, options.rule, None, 0, options.settings)
        decided = (f"  {name}: {value!r}, {job.sources[name]}" for name, value in vars(job.settings).items())
        say(f"settings with rule {job.rule_text}, and who decides each:", *decided, *job.notes.values())


def _errors(options: argparse.Namespace) -> int:
    """Print the errors of the first of two images against the second, draw their map, and return the exit code."""
    if options.output is not None:
        check_package("matplotlib", "a map", "pip install 'dmis[plot]'")
        check_writable(options.output)
    first, second = (load_reference(Path(path)) for path in options.scene)
    image = first.mean.astype("f")
    if image.shape != second.first.shape:
        sizes = " and ".join(f"{of.shape[1]}x{of.shape[0]}" for of in (image, second.first))
        raise ValueError(f"images must have one size; got {sizes}")
    say(f"MSE     {mse(image, second):.6g}", f"relMSE  {relmse(image, second):.6g}")
    if options.metric == "flip" or find_spec("flip_evaluator") is not None:
        say(f"FLIP    {flip(image, second).mean():.6g}")
    if options.output is not None:
        from dmis.report.figure import write_error_map  # imported where used: it brings matplotlib

        write_error_map(image, second, options.metric, options.output)
        say(options.output)
    return 0
