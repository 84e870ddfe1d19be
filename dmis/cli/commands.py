"""Commands of ``python -m dmis``, which `dmis.cli.arguments` lists.

Bad input ends with exit code 2 and one message. An interrupted command ends with 130, and its message has the command
that resumes it.
"""

from __future__ import annotations

import argparse
import os
import platform
import shlex
import sys
import time
import warnings
from collections.abc import Sequence
from importlib.metadata import version
from importlib.util import find_spec
from pathlib import Path

from dmis import __version__
from dmis.base.atomic_files import check_folder, check_package, check_writable, replacing
from dmis.base.plugins import load_plugin
from dmis.cli.arguments import make_parser
from dmis.cli.bench_rules import bench_rules
from dmis.cli.check import check
from dmis.cli.doctor import doctor
from dmis.cli.figures import diff, figure, table
from dmis.cli.rendering import render
from dmis.cli.shared import describe, given_settings, load, progress_bar, say, settings_of, spp_of
from dmis.estimator.settings import make_settings
from dmis.experiment.oracle_renders import make_oracle
from dmis.experiment.reference import cache_folder, load_reference, make_reference
from dmis.experiment.table import Comparison
from dmis.fit.registry import RULES, about, make_rule
from dmis.formats.load_scene import SHIPPED
from dmis.image import read_exr
from dmis.pipeline.job import resolve
from dmis.report.compare import can_draw, check_output, compare, parse_rules
from dmis.report.tables import overview, summary
from dmis.scene.scene import Scene


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line and return its exit code."""
    options = make_parser().parse_args(arguments)
    try:
        with warnings.catch_warnings():
            warnings.showwarning = lambda message, *_, **__: say(f"dmis: warning: {message}", error=True)  # type: ignore[assignment]
            for file in options.plugin:
                load_plugin(file)
            code = _COMMANDS[options.command](options)
            sys.stdout.flush()
            return code
    except BrokenPipeError:  # nothing reads standard output any more, as behind ``| head``
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())  # Python flushes what is left at exit
        return 141  # as the shell has it for a command that SIGPIPE ends
    except (ValueError, OSError) as error:
        say(f"dmis: error: {error}", error=True)
        return 2
    except MemoryError as error:
        say(f"dmis: error: there is not enough memory: {error}", error=True)
        return 2
    except KeyboardInterrupt:
        say(f"dmis: interrupted{_how_to_resume(options, arguments)}", error=True)
        return 130


def _how_to_resume(options: argparse.Namespace, arguments: Sequence[str] | None) -> str:
    """Return what an interrupted command has saved, and the command that resumes it."""
    again, command = "Run the same command to resume.", options.command
    if command == "compare" and any(options.output.glob("**/results.csv")):
        return f"; finished renders are kept in {options.output}. {again}"
    if command == "compare" and options.reference is not None:
        return "; nothing is kept, because no render was finished"
    if command in ("compare", "oracle", "play"):
        return f"; finished tiles are kept in {cache_folder()}. {again}"
    if command != "render":
        return ""
    words = ["python", "-m", "dmis", *(sys.argv[1:] if arguments is None else arguments)]
    if options.checkpoint is not None:
        return f"; finished tiles are kept in {options.checkpoint}. {again}\n  {shlex.join(words)}"
    words += ["--checkpoint", str(Path(options.output).with_suffix(".checkpoint"))]
    return f"; nothing is kept. With --checkpoint finished tiles are kept:\n  {shlex.join(words)}"


def _compare(options: argparse.Namespace) -> int:
    """Run ``compare`` and return its exit code."""
    parse_rules(options.rules)
    make_settings(**given_settings(options))  # a bad one ends the command before a scene is read
    names = [Path(scene).stem for scene in options.scene]
    if len(set(names)) < len(names):
        raise ValueError(f"scenes must have different names, which are those of their folders; got {', '.join(names)}")
    many = len(names) > 1
    if many and options.reference is not None:
        raise ValueError(f"--reference needs one scene; got {len(names)}. Without --reference dmis renders references")
    folders = [options.output / name if many else options.output for name in names]
    for folder in folders:
        check_output(folder)  # before a reference is rendered
    scenes = [load(argparse.Namespace(**{**vars(options), "scene": scene})) for scene in options.scene]
    comparisons = [_compare_scene(options, *each) for each in zip(scenes, folders, strict=True)]
    if not many:
        return 0
    if not options.quiet:
        say(overview(comparisons).text())
    if can_draw():
        from dmis.report.page import write_report  # imported where used: it brings matplotlib

        page = options.output / "report.html"
        write_report(comparisons, page)
        if not options.quiet:
            say(page)
    return 0


def _compare_scene(options: argparse.Namespace, scene: Scene, output: Path) -> Comparison:
    """Compare the rules on a scene, write the results into the folder `output`, and return the comparison."""
    rules = parse_rules(options.rules)
    spp = options.spp or [spp_of(options, scene)]
    settings = settings_of(options, scene)
    if options.verbose:
        say(describe(scene))
    with progress_bar(options.quiet) as progress:
        of_renders = {"parallel": options.threads, "progress": progress}
        if options.reference is not None:
            reference = load_reference(options.reference, scene, make_settings(**settings))
        else:
            reference = make_reference(scene, options.reference_spp, **of_renders, **settings)
        oracle = None
        if options.oracle_spp is not None:
            oracle = make_oracle(scene, options.oracle_spp, **of_renders, **settings)
        comparison = compare(
            scene, rules, spp, range(options.seed, options.seed + options.seeds), reference, output,
            oracle=oracle, progress=_print_run if options.verbose else progress, crop=options.crop,
            parallel=options.threads, **settings,
        )  # fmt: skip
    for rule, n in [(rule, n) for n in spp for rule in rules if (rule, n) not in comparison.runs]:
        pilot = sum(make_rule(rule).pilot.values())
        why = f"because its pilot takes {pilot}: use --spp {pilot + 1} or more"
        say(f"dmis: {rule} is skipped at {n} samples per pixel, {why}", error=True)
    if not options.quiet:
        say(summary(comparison))
        say(*filter(Path.exists, (output / name for name in ("results.csv", "report.html"))))
    return comparison


def _print_run(rule: str, done: int, total: int) -> None:
    """Print a line about a finished render."""
    say(f"{time.strftime('%H:%M:%S')} [{done}/{total}] {rule}")


def _oracle(options: argparse.Namespace) -> int:
    """Run ``oracle`` and return its exit code."""
    check_package("matplotlib", "the plot of an oracle", "pip install 'dmis[plot]'")
    check_folder(options.output)
    scene, settings = load(options), make_settings(**given_settings(options))
    with progress_bar(options.quiet) as progress:
        curves = {"settings": settings, "weigh": options.weigh}
        oracle = make_oracle(scene, options.spp, **curves, parallel=options.threads, progress=progress)
    from dmis.report.plots import write_best_shares

    options.output.mkdir(parents=True, exist_ok=True)
    text, paths = oracle.text(), [options.output / name for name in ("oracle.md", "best_shares.png")]
    write_best_shares(oracle, paths[1], scene.name)
    with replacing(paths[0]) as partial:
        partial.write_text(f"{text}\n", "utf-8")
    if not options.quiet:
        say(text, *paths)
    return 0


def _play(options: argparse.Namespace) -> int:
    """Run ``play`` and return its exit code."""
    from dmis.report.play import play_page

    if options.output.suffix.lower() not in (".html", ".htm"):
        raise ValueError(f"-o of play must end in .html, the page that it writes; got {str(options.output)!r}")
    check_package("jinja2", "a page", "pip install 'dmis[plot]'")
    check_writable(options.output)
    scene, settings = load(options), make_settings(**given_settings(options))
    with progress_bar(options.quiet) as progress:
        page = play_page(scene, options.spp, options.patch, settings, parallel=options.threads, progress=progress)
    with replacing(options.output) as partial:
        partial.write_text(page, "utf-8")
    if not options.quiet:
        say(f"{options.output}: open it in a browser")
    return 0


def _info(options: argparse.Namespace) -> int:
    """Run ``info`` and return its exit code."""
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
    if options.scene and options.scene.lower().endswith(".exr"):
        layers, attributes = read_exr(options.scene)
        sizes = (f"  {name}: {' x '.join(map(str, layer.shape))}" for name, layer in layers.items())
        say("", f"image {options.scene}, layers:", *sizes, *(f"  {name}: {text}" for name, text in attributes.items()))
    elif options.scene:
        begin = time.perf_counter()
        scene, _ = load(options).in_float32
        scene.prepare()
        say(f"\n{describe(scene)}\nread and built in {time.perf_counter() - begin:.2f} s")
        if options.rule or given_settings(options):
            job = resolve(scene, options.rule, None, 0, make_settings(**given_settings(options)))
            decided = (f"  {name}: {value!r}, {job.sources[name]}" for name, value in vars(job.settings).items())
            say(f"settings with rule {job.rule_text}, and who decides each:", *decided, *job.notes.values())
    return 0


_COMMANDS = {
    "render": render,
    "compare": _compare,
    "figure": figure,
    "table": table,
    "diff": diff,
    "oracle": _oracle,
    "play": _play,
    "info": _info,
    "check": check,
    "doctor": doctor,
    "bench-rules": bench_rules,
}
if __name__ == "__main__":
    sys.exit(main())
