"""The public names of `dmis`: loaded where they are used, listed, and known to type checkers."""

from __future__ import annotations

import ast
import json
import subprocess
import sys
from pathlib import Path

import pytest
from helpers import fresh_python

import dmis

PACKAGE = Path(dmis.__file__).parent
HEAVY = ("numpy", "scipy", "trimesh", "matplotlib", "OpenEXR", "embreex")


def test_import_loads_no_other_package() -> None:
    loaded = json.loads(fresh_python("import sys, json, dmis; print(json.dumps(list(sys.modules)))"))
    assert not set(HEAVY) & {name.partition(".")[0] for name in loaded}


def test_all_names_load_without_packages_of_their_own() -> None:
    """NumPy and Embree are needed by most names; what reads meshes and writes figures is needed by `plot` only."""
    names = [name for name in dmis.__all__ if name != "plot"]
    code = f"import sys, json, dmis; [getattr(dmis, n) for n in {names}]; print(json.dumps(list(sys.modules)))"
    loaded = {name.partition(".")[0] for name in json.loads(fresh_python(code))}
    assert "numpy" in loaded and not loaded & {"scipy", "trimesh", "matplotlib", "OpenEXR", "tqdm", "dask"}


def test_dir_lists_public_names_only() -> None:
    assert dir(dmis) == sorted(["__version__", *dmis.__all__])
    assert {"light_part", "measure", "compare", "make_oracle", "plot", "Technique", "render", "matte"} <= set(
        dmis.__all__
    )


@pytest.mark.parametrize("name", dmis.__all__)
def test_name_is_imported_and_an_attribute(name: str) -> None:
    if name == "plot":
        pytest.importorskip("matplotlib")
    value = getattr(dmis, name)
    namespace: dict[str, object] = {}
    exec(f"from dmis import {name}", namespace)
    assert namespace[name] is value and vars(dmis)[name] is value


def test_type_checkers_see_the_same_names() -> None:
    """The imports of the stub, which type checkers read, are the public names, one on each line."""
    typed = {}
    for line in ast.parse((PACKAGE / "__init__.pyi").read_text("utf-8")).body:
        if isinstance(line, ast.ImportFrom):
            (alias,) = line.names
            assert alias.asname == alias.name
            typed[alias.name] = line.module
    assert typed.pop("plot") == "dmis"
    assert typed == dmis._HOMES and sorted([*typed, "plot"]) == dmis.__all__


def test_modules_are_attributes_of_their_packages() -> None:
    """Each module by its dotted name, in a Python that has imported `dmis` alone."""
    names = sorted(
        ".".join(path.relative_to(PACKAGE.parent).with_suffix("").parts)
        for path in PACKAGE.rglob("*.py")
        if not path.stem.startswith("_") and path.parent.name != "report" and path.stem != "plot"  # need matplotlib
    )
    code = f"import json, dmis; print(json.dumps([eval(n).__name__ for n in {names}]))"
    assert json.loads(fresh_python(code)) == names


def test_every_package_is_in_the_table() -> None:
    packages = {".".join(path.parent.relative_to(PACKAGE).parts) for path in PACKAGE.rglob("__init__.py")}
    assert set(dmis._ROOMS) == packages - {""}


@pytest.mark.parametrize("text", ["mate", "_nothing", "fit.nothing", "formats.pbrt.nothing"])
def test_unknown_names_are_missing_attributes(text: str) -> None:
    with pytest.raises(AttributeError, match=f"has no attribute '{text.rpartition('.')[2]}'"):
        eval(f"dmis.{text}")


def test_a_name_that_is_nearly_right_is_suggested() -> None:
    done = subprocess.run([sys.executable, "-c", "import dmis; dmis.mate"], capture_output=True, text=True)
    assert "Did you mean: 'matte'?" in done.stderr


def test_a_missing_package_is_not_a_missing_name(monkeypatch: pytest.MonkeyPatch) -> None:
    """An import that fails inside of a module says which package is missing."""
    assert dmis.image  # loaded
    monkeypatch.setitem(sys.modules, "zlib", None)
    monkeypatch.delitem(sys.modules, "dmis.image")
    monkeypatch.delattr(dmis, "image")
    with pytest.raises(ModuleNotFoundError, match="zlib"):
        dmis.image  # noqa: B018
