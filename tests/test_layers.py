"""The order of the rooms of `dmis`: imports only point downwards, and there is no circle of modules."""

from __future__ import annotations

import ast
from functools import cache
from graphlib import TopologicalSorter
from pathlib import Path

import pytest

import dmis

PACKAGE = Path(dmis.__file__).parent
LEVELS = (
    ("cli", "examples"),
    ("report", "doctor", "testing"),
    ("bench",),
    ("experiment",),
    ("pipeline",),
    ("fit",),
    ("variance", "formats"),
    ("estimator",),
    ("scene",),
    ("light",),
    ("brdf", "plot"),
    ("image_reader",),
    ("samplers", "geometry", "intersect", "filter", "image"),
    ("base",),
)
"""Rooms from the top to the bottom; those of one level do not know each other, except that `plot` is beside `brdf`."""
LEVEL = {room: len(LEVELS) - k for k, rooms in enumerate(LEVELS) for room in rooms}
SPECIAL = ("__init__", "__main__")


def modules() -> dict[str, Path]:
    """Return the file of each module by its dotted name below ``dmis.``, packages without ``.__init__``."""
    out = {}
    for path in sorted(PACKAGE.rglob("*.py")):
        parts = path.relative_to(PACKAGE).with_suffix("").parts
        out[".".join(parts[:-1] if parts[-1] == "__init__" and len(parts) > 1 else parts)] = path
    return out


def imports(tree: ast.AST, known: frozenset[str]) -> set[str]:
    """Return the modules of dmis that `tree` imports: at the top, in functions and under ``TYPE_CHECKING``."""
    found = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            found |= {a.name.removeprefix("dmis.") for a in node.names if a.name.startswith("dmis.")}
        elif isinstance(node, ast.ImportFrom) and node.module and node.module.split(".")[0] == "dmis":
            base = node.module.removeprefix("dmis").removeprefix(".")
            for alias in node.names:
                full = f"{base}.{alias.name}".removeprefix(".")
                if full in known or base in known:
                    found.add(full if full in known else base)
    return found


@cache
def graph() -> dict[str, set[str]]:
    """Return what each module imports, the package's own ``__init__`` and ``__main__`` left out."""
    files = modules()
    known = frozenset(files)
    trees = {name: ast.parse(path.read_text("utf-8")) for name, path in files.items() if name not in SPECIAL}
    return {name: imports(tree, known) - {name} for name, tree in trees.items()}


def upward(arrows: dict[str, set[str]]) -> list[str]:
    """Return the imports that do not point downwards, as ``importer -> imported``."""
    wrong = []
    for name, targets in arrows.items():
        room = name.split(".")[0]
        for target in sorted(targets):
            other = target.split(".")[0]
            if other != room and LEVEL[other] >= LEVEL[room] and target not in SPECIAL:
                wrong.append(f"{name} -> {target}")
    return wrong


def test_every_module_has_a_room() -> None:
    assert {name.split(".")[0] for name in modules() if name not in SPECIAL} <= set(LEVEL)
    # imports point downwards and there is no circle
    assert upward(graph()) == []
    TopologicalSorter(graph()).prepare()  # raises an error that names the circle
    # no top level module hides a public function
    functions = {name for name in dir(dmis) if callable(getattr(dmis, name))}
    assert functions & {name for name in modules() if "." not in name} == set()
    # a package's ``__init__`` has a docstring and nothing else, so that no room is a facade of another
    for name, path in modules().items():
        if path.name == "__init__.py" and name != "__init__":
            (docstring,) = ast.parse(path.read_text("utf-8")).body
            assert isinstance(docstring, ast.Expr), name


@pytest.mark.parametrize(
    "code", ["def f():\n    from dmis.pipeline import render", "if TYPE_CHECKING:\n    import dmis.pipeline.render"]
)
def test_an_upward_import_is_found(code: str) -> None:
    known = frozenset({"pipeline", "pipeline.render", "light.area"})
    assert upward({"light.area": imports(ast.parse(code), known)}) == ["light.area -> pipeline.render"]
