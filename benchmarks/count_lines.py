"""
How much code one render runs through
=====================================

Renders a small scene of direct lighting with one rule, and counts the files of `dmis` and the lines of those functions
that it called. A line counts if it has code: docstrings, comments and blank lines do not. The last column counts
docstrings, too. Files come in the order in which docs/code.md says to read them, the others after them. The last line
is the sentence of that page; ``--write`` puts it there. The first two lines are the size of the package, the modules
that a fresh process imports for a render, and the classes whose methods the small render calls.

The scene has one lobe (Lambert) and one light (a quadrilateral). What is kept with it (its units, plan, triangle tables
and Embree scene) is made before.
"""

from __future__ import annotations

import argparse
import ast
import io
import re
import subprocess
import sys
import threading
import tokenize
from collections.abc import Iterable, Iterator
from pathlib import Path
from types import CodeType, FrameType
from typing import Any

import dmis
from dmis.geometry.shapes import quad, sphere
from dmis.geometry.transforms import translate

PACKAGE = Path(dmis.__file__).resolve().parent
PAGE = Path(__file__).resolve().parents[1] / "docs" / "code.md"
FRESH = """
import sys, dmis
dmis.render(dmis.load_scene("teapot-area-light", (16, 12)), "balance", 2)
print(*sorted(name for name in sys.modules if name.partition(".")[0] == "dmis"))
"""
"""Program that renders a scene of the thesis with equal shares, and prints the modules of `dmis` that it imported."""
SILENT = {tokenize.COMMENT, tokenize.NL, tokenize.NEWLINE, tokenize.INDENT, tokenize.DEDENT, tokenize.ENDMARKER}
"""Tokens that do not make a line one of code."""


def small_scene() -> dmis.Scene:
    """Return a matte ball on a matte floor under a quadrilateral light."""
    floor = dmis.Part(quad((-4, -4, 0), (8, 0, 0), (0, 8, 0)), dmis.matte(0.5))
    ball = dmis.Part(sphere(0.6, segments=16).transformed(translate((0, 0, 0.6))), dmis.matte((0.5, 0.2, 0.1)))
    lamp = dmis.QuadLight((-0.5, -0.5, 2.4), (0, 1, 0), (1, 0, 0), (6, 5, 4))
    camera = dmis.Camera.look_at((0, -3.6, 1.8), (0, 0, 0.7), fov=45, resolution=(16, 12))
    return dmis.Scene(camera, (floor, ball), (lamp,), "ball", dmis.Suggestions("direct"))


def called_functions(scene: dmis.Scene, rule: str, spp: int) -> set[CodeType]:
    """Return the code of all functions of `dmis` that a render calls."""
    codes: set[CodeType] = set()

    def note(frame: FrameType, event: str, _: Any) -> None:
        if event == "call":
            codes.add(frame.f_code)

    threading.setprofile(note)
    sys.setprofile(note)
    try:
        dmis.render(scene, rule, spp, seed=1, parallel=1)
    finally:
        sys.setprofile(None)
        threading.setprofile(None)
    return {code for code in codes if Path(code.co_filename).is_relative_to(PACKAGE)}


def classes_called(codes: set[CodeType]) -> set[tuple[str, str]]:
    """Return file and name of the classes whose methods, as the package's files write them, are among `codes`."""
    words = ((code.co_filename, code.co_qualname.split(".")) for code in codes)
    return {(file, names[0]) for file, names in words if len(names) > 1 and names[1] != "<locals>"}


def modules_imported() -> list[str]:
    """Return the modules of `dmis`, packages among them, that a render in a fresh process imports, see `FRESH`."""
    return subprocess.run([sys.executable, "-c", FRESH], capture_output=True, text=True, check=True).stdout.split()


def tokens_of(paths: Iterable[Path]) -> int:
    """Return the number of names, operators, numbers and texts of files, docstrings included."""
    kinds = {tokenize.NAME, tokenize.OP, tokenize.NUMBER, tokenize.STRING}
    lines = (io.StringIO(path.read_text("utf-8")).readline for path in paths)
    return sum(token.type in kinds for line in lines for token in tokenize.generate_tokens(line))


def code_lines(text: str) -> set[int]:
    """Return the numbers of the lines of a module that hold a token other than a comment, docstrings included."""
    lines: set[int] = set()
    for token in tokenize.generate_tokens(io.StringIO(text).readline):
        if token.type not in SILENT:
            lines.update(range(token.start[0], token.end[0] + 1))
    return lines


def docstrings(tree: ast.AST) -> Iterator[range]:
    """Yield the lines of each docstring of a module, its classes and functions."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef) and ast.get_docstring(node) is not None:
            yield range(node.body[0].lineno, (node.body[0].end_lineno or 0) + 1)


def count(path: Path, codes: set[CodeType]) -> tuple[int, int]:
    """Return the lines of code of the functions of a file with these codes, without and with their docstrings.

    A function has all its lines, those of decorators and of the functions inside it, whether or not they were run. The
    code of a module or class, which runs at import, is that of no function and does not count.
    """
    text = path.read_text("utf-8")
    tree = ast.parse(text)
    first = {(code.co_firstlineno, code.co_name) for code in codes}
    inside: set[int] = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.FunctionDef):
            begin = min([node.lineno, *(decorator.lineno for decorator in node.decorator_list)])
            if (begin, node.name) in first:
                inside.update(range(begin, (node.end_lineno or begin) + 1))
    documented = code_lines(text) & inside
    blank = {k for k, line in enumerate(text.split("\n"), 1) if not line.strip()}
    described = {line for lines in docstrings(tree) for line in lines}
    return len(documented - described), len(documented - blank)


def style(paths: Iterable[Path]) -> tuple[int, float, float]:
    """Return the lines of code of files, the tokens of each line, and the joined assignments in 1,000 lines.

    Comments and docstrings do not count. A joined assignment gives several names the values of a tuple, as in
    ``a, b = 1, 2``.
    """
    lines = tokens = joined = 0
    for path in paths:
        text = path.read_text("utf-8")
        tree = ast.parse(text)
        described = {line for of_one in docstrings(tree) for line in of_one}
        starts = [token.start[0] for token in tokenize.generate_tokens(io.StringIO(text).readline) if is_code(token)]
        starts = [line for line in starts if line not in described]
        lines += len(set(starts))
        tokens += len(starts)
        assignments = [node for node in ast.walk(tree) if isinstance(node, ast.Assign)]
        joined += sum(isinstance(a.targets[0], ast.Tuple) and isinstance(a.value, ast.Tuple) for a in assignments)
    return lines, tokens / lines, 1000 * joined / lines


def is_code(token: tokenize.TokenInfo) -> bool:
    """Return whether a token is one of code, and no text that describes a name above it."""
    return token.type not in SILENT and not (token.type == tokenize.STRING and token.string.startswith('"""'))


def lines_called(called: set[CodeType]) -> dict[str, tuple[int, int]]:
    """Return the lines of code of `called_functions` by file, without and with docstrings, see `count`."""
    by_file: dict[str, set[CodeType]] = {}
    for code in called:
        by_file.setdefault(Path(code.co_filename).relative_to(PACKAGE).as_posix(), set()).add(code)
    lines = {name: count(PACKAGE / name, codes) for name, codes in by_file.items()}
    return {name: pair for name, pair in lines.items() if pair[0]}


def reading_path(page: Path = PAGE) -> list[str]:
    """Return the files that docs/code.md says to read for such a render, in its order."""
    steps = page.read_text("utf-8").partition("the files in this order:\n\n")[2].partition("\n\n")[0]
    return list(dict.fromkeys(re.findall(r"`([a-z_]+(?:/[a-z_]+)*\.py)`", steps)))


def write_sentence(sentence: str, page: Path = PAGE) -> None:
    """Put the sentence between the marks of the page, see `main`."""
    text = page.read_text("utf-8")
    new = re.sub(r"(?<=<!-- lines: begin -->\n).*?(?=<!-- lines: end -->)", f"{sentence}\n", text, flags=re.S)
    page.write_text(new, "utf-8")


def main() -> None:
    """Count and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rule", default="thesis", help="rule with its options (default thesis)")
    parser.add_argument("--spp", type=int, default=16, help="camera samples per pixel (default 16)")
    parser.add_argument("--write", action="store_true", help="put the last sentence into docs/code.md")
    arguments = parser.parse_args()
    scene = small_scene()
    dmis.render(scene, arguments.rule, arguments.spp, seed=1, parallel=1)  # its plan and Embree scene are kept with it
    called = called_functions(scene, arguments.rule, arguments.spp)
    lines, path, files = lines_called(called), reading_path(), sorted(PACKAGE.rglob("*.py"))
    total = sum(file.read_text("utf-8").count("\n") for file in files)
    print(f"{total:,} lines and {tokens_of(files):,} tokens in dmis, {len(modules_imported())} modules of it imported;")
    print(f"the render below calls methods of {len(classes_called(called))} classes")
    print(f"{'file':38} {'lines':>6} {'with docstrings':>16}")
    for name in [*path, *sorted(lines.keys() - set(path))]:
        without, documented = lines.get(name, (0, 0))
        print(f"{name:38} {without:6} {documented:16}{'' if name in path else '   not on the reading path'}")
    total, described = (sum(column) for column in zip(*lines.values(), strict=True))
    print(f"{f'{len(lines)} files':38} {total:6} {described:16}")
    read, described = (sum(lines[name][k] for name in path if name in lines) for k in (0, 1))
    print(f"{f'{len(path)} on the reading path':38} {read:6} {described:16}")
    sentence = (
        f"Such a render calls some {round(total, -2):,} lines of code in {len(lines)} files, "
        f"{round(read, -2):,} of them in the {len(path)} files above."
    )
    print(sentence)
    if arguments.write:
        write_sentence(sentence)


if __name__ == "__main__":
    main()
