"""How Sphinx makes the site: Markdown pages, the gallery, the public API and the internals.

The pages are plain Markdown that also reads well on a code host, so what only the site needs is here: the table of
contents, pages made of files at the root, formulas as MathML (no script and no network is needed to see them).
"""

import os
import re
import sys
import types
from pathlib import Path

import ziamath
from latex2mathml.converter import convert

import dmis

DOCS = Path(__file__).parent
sys.path.insert(0, str(DOCS))
import gallery  # noqa: E402
import links  # noqa: E402
import redirects  # noqa: E402
import reference  # noqa: E402

os.environ.setdefault("DMIS_CACHE", str(DOCS / "_build" / "cache"))
os.environ.pop("DMIS_PBRT_SCENES", None)  # the gallery shows the scenes that everyone has

project = "dmis"
author = "the dmis authors"
copyright = author
release = version = dmis.__version__

extensions = [
    "myst_parser",
    "numpydoc",
    "sphinx.ext.autodoc",
    "sphinx.ext.autosummary",
    "sphinx.ext.viewcode",
    "sphinx_copybutton",
    "sphinx_gallery.gen_gallery",
]
source_suffix = {".md": "markdown", ".rst": "restructuredtext"}
exclude_patterns = ["_build", "tutorials", "generated/**/*.ipynb"]
default_role = "py:obj"
python_maximum_signature_line_length = 88
autodoc_default_options = {"members": True, "member-order": "bysource"}
autodoc_typehints_format = "short"
autosummary_generate = False
numpydoc_show_class_members = False
myst_enable_extensions = ["dollarmath"]
myst_heading_anchors = 3

html_theme = "furo"
html_title = f"dmis {version}"
html_static_path = ["_static", str(Path(ziamath.__file__).parent / "fonts")]  # STIX Two Math, for the formulas
html_css_files = ["dmis.css"]
html_search_scorer = str(DOCS / "search_scorer.js")
html_show_sourcelink = False
html_show_copyright = False
html_show_sphinx = False

sphinx_gallery_conf = {
    "examples_dirs": ["tutorials", "../examples"],
    "gallery_dirs": ["generated/tutorials", "generated/figures"],
    "filename_pattern": r"/\d_",
    "ignore_pattern": r"^(?!plot_|\d_)",
    "within_subsection_order": "FileNameSortKey",
    "reset_argv": "gallery.announce",
    "abort_on_example_error": True,
    "download_all_examples": False,
    "show_memory": False,
    "show_signature": False,
    "min_reported_time": 1,
    "remove_config_comments": True,
    "write_computation_times": False,
    "backreferences_dir": None,
    "nested_sections": True,
    "subsection_order": "gallery.section_order",
    "plot_gallery": "True",
}

# The table of contents ------------------------------------------------------------------------------------------------

CONTENTS = {
    "Study and teach": [
        "quickstart",
        "play",
        "estimator",
        "generated/tutorials/index",
        "theory",
        "sampling",
        "syllabus",
        "thesis",
    ],
    "Invent rules": ["rules", "extending", "mis-bench", "report", "results", "performance", "does-not-pay"],
    "Find faults": ["doctor", "explain", "brdfs", "stability"],
    "Render": ["scenes", "cli", "cluster", "faq", "paths"],
    "Look up": [
        "glossary",
        "references",
        "generated/figures/index",
        "generated/api/index",
        "generated/internals/index",
        "code",
        "generated/contributing",
        "generated/changes",
    ],
}
"""Sections of the site, in the order of the five paths of the front page."""
ELSEWHERE = {"CONTRIBUTING.md": "contributing", "CHANGELOG.md": "changes"}
"""Pages that are kept at the root, by their names here."""


def contents() -> str:
    """Hidden tables of contents for the front page; pages that nobody listed come last."""
    listed = {name for names in CONTENTS.values() for name in names} | {"index"}
    more = sorted({page.stem for page in DOCS.glob("*.md")} - listed)
    blocks = []
    for caption, names in {**CONTENTS, "More": more}.items():
        there = [name for name in names if name.startswith("generated/") or (DOCS / f"{name}.md").exists()]
        if there:
            blocks.append("\n".join(["```{toctree}", ":hidden:", f":caption: {caption}", "", *there, "```"]))
    return "\n\n".join(blocks)


# Markdown that reads well on a code host, too ---------------------------------------------------------------------


def source_read(app, page: str, text: list[str]) -> None:
    """Links that lead out of docs/ lead to the pages that the site has for them."""
    if page.startswith("generated/"):
        text[0] = gallery.with_figure(page, gallery.with_code(text[0]))
        return
    for file, name in ELSEWHERE.items():
        text[0] = text[0].replace(f"](../{file}", f"](generated/{name}.md")
    text[0] = re.sub(r"\(figures/\w+\.webp\), \[script\]", "", text[0])  # the script's page shows the figure
    text[0] = re.sub(r"\]\(\.\./examples(?:/(\w+/plot_\w+)\.py)?\)", _gallery_page("figures"), text[0])
    text[0] = re.sub(r"\]\(tutorials(?:/(\d_\w+)\.py)?\)", _gallery_page("tutorials"), text[0])
    if page == "index":
        text[0] += "\n\n" + contents()


def _gallery_page(folder: str):
    return lambda link: f"](generated/{folder}/{link[1] or 'index'}.rst)"


def generate(app) -> None:
    """Write the pages that are made of other files: those at the root, the reference, panels of figures."""
    gallery.write_panels(DOCS / "generated" / "figures")
    for file, name in ELSEWHERE.items():
        text = (DOCS.parent / file).read_text("utf-8")
        text = re.sub(r"\]\(docs/", "](../", text)
        for other, page in ELSEWHERE.items():
            text = text.replace(f"]({other}", f"]({page}.md")
        reference.write(DOCS / "generated" / f"{name}.md", text)
    reference.write_pages()


def count_pages(app, env, pages: list[str]) -> None:
    """Count the pages that will be read, for `print_page`."""
    app.pages_left = len(pages)


def print_page(app, page: str, text: list[str]) -> None:
    """Print one line for each page: how many are left, and its name."""
    print(f"{app.pages_left:4} {page}", flush=True)
    app.pages_left -= 1


# Formulas ---------------------------------------------------------------------------------------------------------


def inline_math(self, node) -> None:
    """A formula in a line."""
    from docutils.nodes import SkipNode

    self.body.append(mathml(node.astext()))
    raise SkipNode


def display_math(self, node) -> None:
    r"""A formula of its own, in a box that scrolls where it is wider; its number is what ``\tag`` says."""
    from docutils.nodes import SkipNode

    formula, _, rest = node.astext().partition(r"\tag{")
    number = rest.partition("}")[0]
    anchor = f' id="eq-{number}"' if number else ""
    shown = f'<span class="eqno">({number})</span>' if number else ""
    box = f'<div class="formula">{mathml(formula.strip(), "block")}</div>'
    self.body.append(f'<div class="math"{anchor}>{box}{shown}</div>\n')
    raise SkipNode


def mathml(formula: str, display: str = "inline") -> str:
    """Return a formula as MathML; bars stand close to what they enclose, not apart as between two terms."""
    return convert(formula, display=display).replace(
        '<mo stretchy="false">&#x0007C;</mo>', '<mo stretchy="false" lspace="0" rspace="0">&#x0007C;</mo>'
    )


def skip_aliases(app, what: str, name: str, value, skip: bool, options) -> bool | None:
    """Leave out names of types such as ``Array``: signatures spell them out."""
    return True if isinstance(value, types.GenericAlias) else None


def setup(app) -> None:
    """Connect all that."""
    app.add_html_math_renderer("mathml", (inline_math, None), (display_math, None))
    app.connect("builder-inited", generate, priority=100)
    app.connect("env-before-read-docs", count_pages)
    app.connect("source-read", print_page)
    app.connect("source-read", source_read)
    app.connect("missing-reference", reference.find_public_name)
    app.connect("autodoc-skip-member", skip_aliases)
    app.connect("build-finished", redirects.write_stubs, priority=400)
    app.connect("build-finished", links.warn_of_broken_links)


html_math_renderer = "mathml"
