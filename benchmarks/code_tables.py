"""Tables of the pages that come from the code itself: options, layers, rules, and what the readers of scenes read.

python benchmarks/code_tables.py    write them into docs/cli.md and docs/scenes.md
"""

from __future__ import annotations

import argparse
import inspect
import re
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(ROOT / "benchmarks"), str(ROOT / "examples")]

from common import replace_tables
from rows import markdown

from dmis.cli.arguments import PLUGIN, SCENE, make_parser, settings_options
from dmis.fit.registry import RULES
from dmis.formats.gltf.gltf_file import EXTENSIONS
from dmis.formats.obj.mtl import READ
from dmis.formats.pbrt.dialect import DIALECTS
from dmis.formats.pbrt.lights import LIGHTS
from dmis.formats.pbrt.make_material import materials_of
from dmis.formats.pbrt.options import CAMERAS
from dmis.formats.pbrt.pbrt_shapes import SHAPES
from dmis.formats.pbrt.textures import TEXTURES
from dmis.image_reader import IMAGE_SUFFIXES
from dmis.pipeline import image_layers

LISTED_RULES = ("fixed", "thesis", "second-moment", "auto")
"""Rules whose options are in the table; the other rules are made of these."""
OF_SETTINGS = {"techniques", "allocation", "combiner", "sampler", "compensation"}
"""Options of rules that `dmis.Settings` describes."""


def code(names: Iterable[str]) -> str:
    """Return names in backticks, separated by spaces."""
    return " ".join(f"`{name}`" for name in names)


def prose(text: str) -> str:
    """Return text of a docstring or of a help as one line of Markdown; files of docs become links."""
    line = " ".join(text.replace("``", "`").split()).replace("|", "\\|")
    return re.sub(r"\bdocs/([\w-]+)\.md", r"[\1](\1.md)", line)


def definitions(docstring: str) -> Iterator[tuple[str, str]]:
    """Return the terms of a docstring, lines at its margin, with the indented paragraphs below them."""
    for term, body in re.findall(r"^(\S.*)\n((?: {4}.*\n?)+)", docstring + "\n", re.M):
        yield term, prose(body)


# The command line -----------------------------------------------------------------------------------------------------


def option_row(action: argparse.Action) -> list[str]:
    """Return the names and the help of an option."""
    formatter = argparse.HelpFormatter("")
    value = "" if action.nargs == 0 else formatter._format_args(action, action.dest.upper())
    names = list(action.option_strings) or [action.dest]
    if value and action.option_strings:
        names[-1] += f" {value}"
    help_text = formatter._expand_help(action)
    return [", ".join(f"`{name}`" for name in names), prose(help_text)]


def commands() -> list[str]:
    """Return a table of options for each command, and two of the options that several commands share."""
    (subparsers,) = (a for a in make_parser()._actions if isinstance(a, argparse._SubParsersAction))
    summaries = {choice.dest: choice.help or "" for choice in subparsers._choices_actions}
    shared = {"scenes": names_of(SCENE) - {"scene", "--resolution"}, "settings": names_of(settings_options())}
    tables: dict[str, dict[str, list[str]]] = {kind: {} for kind in shared}
    lines: list[str] = []
    for command, parser in subparsers.choices.items():
        rows, kinds = [], set()
        for action in parser._actions:
            name = (action.option_strings or [action.dest])[-1]
            kind = next((kind for kind, names in shared.items() if name in names), "")
            if kind:
                kinds.add(kind)
                tables[kind][name] = option_row(action)
            elif name not in ("--help", *PLUGIN):
                rows.append(option_row(action))
        also = " and ".join(f"[{kind}](#options-of-{kind})" for kind in shared if kind in kinds)
        ending = f" The command also takes the options of {also}." if also else ""
        about_it = f"{summaries[command][0].upper()}{summaries[command][1:]}.{ending}"
        lines += [f"## `{command}`", "", about_it, "", *markdown(["option", "what it does"], rows), ""]
    for kind, rows_of in tables.items():
        lines += [f"## Options of {kind}", "", *markdown(["option", "what it does"], rows_of.values()), ""]
    return lines[:-1]


def names_of(options: Mapping[str, object]) -> set[str]:
    """Return the last name of each option of `dmis.cli.arguments`."""
    return {names.split()[-1] for names in options}


def layers() -> list[str]:
    """Return the table of layers, from the docstring of their module."""
    return markdown(
        ["layer", "content"], [[prose(term), text] for term, text in definitions(image_layers.__doc__ or "")]
    )


def options_of(make: Callable[..., object]) -> Iterator[list[str]]:
    """Return the options of a rule with their defaults, and what they do, from docstrings."""
    kind = type(make())
    parameters = inspect.signature(kind).parameters
    for base in kind.__mro__:
        section = inspect.cleandoc(base.__doc__ or "").partition("Parameters\n----------\n")[2].partition("\n---")[0]
        for term, text in definitions(section):
            names = [name for name in term.split(", ") if name in parameters and name not in OF_SETTINGS]
            if names:
                yield [" ".join(map(written, names, (parameters[name].default for name in names))), text]


def written(name: str, default: object) -> str:
    """Return an option of a rule with its default, as the command line reads it."""
    values = {True: "yes", False: "no", None: "", "": ""}
    value = values[default] if isinstance(default, bool | None) or default == "" else f"{default}"
    return f"`{name}={value}`" if value else f"`{name}`"


def rules() -> list[str]:
    """Return a table of the rules' options."""
    rows = [[f"`{name}`", *row] for name in LISTED_RULES for row in options_of(RULES[name])]
    return markdown(["rule", "option and default", "what it sets"], rows)


# Scenes ---------------------------------------------------------------------------------------------------------------


def pbrt() -> list[str]:
    """Return what a file of each dialect may hold, by directive."""
    columns: dict[str, Mapping[str, Iterable[str]]] = {
        "integrator, as paths": {name: dialect.integrators[0] for name, dialect in DIALECTS.items()},
        "camera": {name: CAMERAS[name] for name in DIALECTS},
        "film": {name: dialect.film for name, dialect in DIALECTS.items()},
        "material": {name: materials_of(name) for name in DIALECTS},
        "texture": dict.fromkeys(DIALECTS, TEXTURES),
        "light": dict.fromkeys(DIALECTS, LIGHTS),
        "shape": dict.fromkeys(DIALECTS, SHAPES),
    }
    rows = [[row, *(code(names) for names in cells.values())] for row, cells in columns.items()]
    return markdown(["", *DIALECTS], rows)


def models() -> list[str]:
    """Return the extensions, statements and images that the readers of models read."""
    rows = [["glTF extensions", code(EXTENSIONS)], ["MTL statements", code(READ)], ["images", code(IMAGE_SUFFIXES)]]
    return markdown(["in the file", "read"], rows)


# Exercises ------------------------------------------------------------------------------------------------------------


def exercises(week: int) -> list[str]:
    """Return the six exercises of a week, with their solutions."""
    rows = []
    for path in sorted((ROOT / "docs" / "exercises").glob("[0-9]*.py"))[6 * week - 6 : 6 * week]:
        title = re.match(r'"""Exercise (\d+) \((\w+)\): (.*)[.?]', path.read_text("utf-8"))
        assert title, path
        number, grade, text = title.groups()
        starter = f"[{text[0].upper()}{text[1:]}](exercises/{path.name})"
        rows.append([number, grade, starter, f"[solution](exercises/solutions/{path.name})"])
    return markdown(["", "grade", "starter", "solution"], rows)


def tables() -> dict[str, list[str]]:
    """Return the lines of the blocks."""
    return {
        **{f"syllabus.md: week {week}": exercises(week) for week in range(1, 5)},
        "cli.md: commands": commands(),
        "cli.md: layers": layers(),
        "cli.md: rules": rules(),
        "scenes.md: pbrt": pbrt(),
        "scenes.md: models": models(),
    }


if __name__ == "__main__":
    replace_tables(tables())
