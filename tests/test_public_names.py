"""The public names of `dmis`: loaded where they are used, listed, and known to type checkers."""

from __future__ import annotations

import json
import re
import sys
from pathlib import Path

import pytest
from helpers import fresh_python

import dmis

PACKAGE = Path(dmis.__file__).parent
HEAVY = {"numpy", "scipy", "trimesh", "matplotlib", "OpenEXR", "embreex", "tqdm", "dask"}


@pytest.mark.parametrize(("names", "packages"), [([], set()), ([n for n in dmis.__all__ if n != "plot"], {"numpy"})])
def test_names_load_what_they_need(names: list[str], packages: set[str]) -> None:
    """`import dmis` loads no other package; names but `plot` need NumPy alone."""
    code = f"import sys, json, dmis; [getattr(dmis, n) for n in {names}]; print(json.dumps(list(sys.modules)))"
    loaded = json.loads(fresh_python(code))
    assert HEAVY & {name.partition(".")[0] for name in loaded} == packages
    assert names or [name for name in loaded if name.startswith("dmis")] == ["dmis"]


@pytest.mark.parametrize("name", dmis.__all__)
def test_name_is_an_attribute_of_its_module(name: str) -> None:
    """It stands in one line of the stub, which type checkers read, and is loaded once."""
    if name == "plot":
        pytest.importorskip("matplotlib")
    stub = (PACKAGE / "__init__.pyi").read_text("utf-8")
    (module,) = re.findall(rf"^from (\S+) import {name} as {name}$", stub, re.M)
    namespace: dict[str, object] = {}
    exec(f"from {module} import {name}", namespace)
    assert getattr(dmis, name) is namespace[name] is vars(dmis)[name]


def test_modules_are_attributes_of_their_packages() -> None:
    """Each module by its dotted name, in a Python that has imported `dmis` alone, or one module of each package."""
    names = sorted(
        ".".join(path.relative_to(PACKAGE.parent).with_suffix("").parts)
        for path in PACKAGE.rglob("*.py")
        if not path.stem.startswith("_") and path.parent.name != "report" and path.stem != "plot"  # need matplotlib
    )
    first = sorted({name.rpartition(".")[0]: name for name in names}.values())
    for imported in ("dmis", ", ".join(first)):
        code = f"import json; import {imported}; print(json.dumps([eval(n).__name__ for n in {names}]))"
        assert json.loads(fresh_python(code)) == names


@pytest.mark.parametrize("text", ["mate", "_nothing", "fit.nothing", "formats.pbrt.nothing"])
def test_unknown_names_are_missing_attributes(text: str) -> None:
    with pytest.raises(AttributeError, match=f"has no attribute '{text.rpartition('.')[2]}'"):
        eval(f"dmis.{text}")


def test_a_missing_package_is_not_a_missing_name(monkeypatch: pytest.MonkeyPatch) -> None:
    """An import that fails inside of a module says which package is missing."""
    assert dmis.image  # loaded
    monkeypatch.setitem(sys.modules, "zlib", None)
    monkeypatch.delitem(sys.modules, "dmis.image")
    monkeypatch.delattr(dmis, "image")
    with pytest.raises(ModuleNotFoundError, match="zlib"):
        dmis.image  # noqa: B018
    # dir lists public names only
    assert dir(dmis) == sorted(["__version__", *dmis.__all__])
    assert {"light_part", "measure", "compare", "plot", "Technique", "render", "matte"} <= set(dmis.__all__)
