"""Write the reference: pages of the public API, one for each section of api.rst.txt, and of the internals.

A public name is described once, as ``dmis.name``. References by the module that defines it lead there, too.
"""

import inspect
import pkgutil
import re
from importlib import import_module
from itertools import groupby
from pathlib import Path

from docutils.nodes import Element
from sphinx.application import Sphinx
from sphinx.environment import BuildEnvironment

import dmis

DOCS = Path(__file__).parent
GENERATED = DOCS / "generated"
HOMES = dmis._HOMES
"""Public names, and the modules that define them."""


def heading(text: str, underline: str = "=") -> str:
    """Return a title of reStructuredText."""
    return f"{text}\n{underline * len(text)}\n"


def directive(name: str) -> str:
    """Return the directive that describes a public name; constants are documented where they are defined."""
    value = getattr(dmis, name)
    if inspect.ismodule(value):
        return f".. automodule:: dmis.{name}\n   :members:\n"
    if inspect.isclass(value):
        return f".. autoclass:: dmis.{name}\n   :members:\n"
    return f".. autofunction:: dmis.{name}\n" if callable(value) else f".. autodata:: {HOMES[name]}.{name}\n"


def public_pages() -> dict[str, str]:
    """Return the pages of the public API by path: its index, with tables, and one for each of the index's sections."""
    text = (DOCS / "api.rst.txt").read_text("utf-8")
    pages = {}
    _, *parts = re.split(r"^(.+)\n-{3,}\n", text, flags=re.M)
    for title, body in zip(parts[::2], parts[1::2], strict=True):
        page = title.lower().replace(" ", "-")
        names = re.findall(r"^   dmis\.(\w+)$", body, re.M)
        pages[f"api/{page}.rst"] = "\n".join([heading(title), *map(directive, names)])
    entries = "\n".join(f"   {Path(page).stem}" for page in pages)
    return {**pages, "api/index.rst": f"{text}\n.. toctree::\n   :hidden:\n\n{entries}\n"}


def folder(module: str) -> str:
    """Return the folder below which a module lies, the first after ``dmis/``."""
    first = module.partition(".")[0]
    return f"dmis/{first}/" if hasattr(import_module(f"dmis.{first}"), "__path__") else "dmis/"


def internal_pages() -> dict[str, str]:
    """Return the pages of the internals by path: an index by folder, and one for each module, without public names."""
    every = pkgutil.walk_packages(dmis.__path__, "dmis.")
    modules = sorted(m.name.removeprefix("dmis.") for m in every if m.name not in ("dmis.__main__", "dmis.plot"))
    pages = {}
    for module in modules:
        title = f"dmis.{module}"
        public = ", ".join(name for name, home in HOMES.items() if home == title)
        without = f"   :exclude-members: {public}\n" if public else ""
        pages[f"internals/{module}.rst"] = f"{heading(title)}\n.. automodule:: {title}\n   :members:\n{without}"
    parts = []
    for title, group in groupby(sorted(modules, key=lambda module: (folder(module), module)), folder):
        entries = "\n".join(f"   {module}" for module in group)
        parts.append(f"{heading(title, '-')}\n.. toctree::\n   :maxdepth: 1\n\n{entries}\n")
    about = "What :doc:`the public names </generated/api/index>` are made of, by folder; see :doc:`/code`."
    return {**pages, "internals/index.rst": "\n".join([heading("Internals"), about, "", *parts])}


def write_pages() -> None:
    """Write all pages that have changed, and remove those of names and modules that are no more."""
    pages = public_pages() | internal_pages()
    for path, text in pages.items():
        write(GENERATED / path, text)
    for path in [*GENERATED.glob("api/*.rst"), *GENERATED.glob("internals/*.rst")]:
        if path.relative_to(GENERATED).as_posix() not in pages:
            path.unlink()


def write(path: Path, text: str) -> None:
    """Write a file, unless it has this text already."""
    path.parent.mkdir(parents=True, exist_ok=True)
    if not path.exists() or path.read_text("utf-8") != text:
        path.write_text(text, "utf-8")


def find_public_name(app: Sphinx, env: BuildEnvironment, node: Element, content: Element) -> Element | None:
    """Resolve ``dmis.scene.camera.Camera.rays`` as ``dmis.Camera.rays`` if the former is described nowhere."""
    target = node.get("reftarget", "")
    for name, home in HOMES.items():
        place = f"{home}.{name}"
        if node.get("refdomain") == "py" and (target == place or target.startswith(f"{place}.")):
            public = f"dmis.{name}{target.removeprefix(place)}"
            domain = env.domains.python_domain
            return domain.resolve_xref(env, node["refdoc"], app.builder, "obj", public, node, content)
    return None
