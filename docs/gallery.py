"""What sphinx-gallery needs to know of the scripts: how they are run, and where their pictures are.

A script whose figure `make figures` has written to ``docs/figures`` is not run: its page shows that figure, of the
default size, with its caption. The others run at their quick size.
"""

import json
import re
import shutil
from pathlib import Path

from sphinx_gallery.scrapers import figure_rst

FIGURES = Path(__file__).parent / "_build" / "figures"
PUBLISHED = {path.stem: path for path in sorted((Path(__file__).parent / "figures").glob("plot_*.webp"))}
"""Figures of the default size, by script."""
KEPT = {"plot_scale"}
"""Scripts that draw what was measured once, and is kept with the project, unless they are asked to be quick."""


def run_pattern() -> str:
    """Return the pattern of the scripts that are run: tutorials, and figures that are not published."""
    published = "|".join(re.escape(stem.removeprefix("plot_")) for stem in PUBLISHED)
    return rf"/(plot_(?!(?:{published})\.py)|\d_)" if published else r"/(plot_|\d_)"


def write_thumbnails(folder: Path, examples: Path) -> None:
    """Write the published figures where sphinx-gallery looks for the pictures of a script, below `folder`."""
    for script in examples.glob("*/plot_*.py"):
        if script.stem in PUBLISHED:
            images = folder / script.parent.name / "images"
            images.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(PUBLISHED[script.stem], images / f"sphx_glr_{script.stem}_001.webp")


def with_figure(page: str, text: str) -> str:
    """Return the text of a script's page with its published figure and caption below the title."""
    stem = page.rpartition("/")[2]
    if stem not in PUBLISHED:
        return text
    about = json.loads(PUBLISHED[stem].with_name("captions.json").read_text("utf-8"))[stem]
    caption = re.sub(r"([\\*`|_])", r"\\\1", f"{about['caption']} ({about['made']}.)")
    figure = f".. figure:: /figures/{stem}.webp\n   :alt: {about['title']}\n\n   {caption}\n"
    return re.sub(r"^=+\n", lambda line: f"{line[0]}\n{figure}\n", text, count=1, flags=re.M)


def arguments(conf: dict, script: dict) -> list[str]:
    """Command line of a script: `examples` run at their quick size, or draw what is kept; tutorials take nothing."""
    source = Path(script["src_file"])
    script["example_globals"]["__file__"] = str(source)  # as it is when it is run as a script
    if "examples" not in source.parts:
        return []
    quick = [] if source.stem in KEPT else ["--quick"]
    return [*quick, "-o", str(FIGURES / f"{source.stem}.png")]


def written(block: tuple, variables: dict, conf: dict) -> str:
    """The picture that a script of `examples` has written, if it has by now."""
    picture = FIGURES / f"{Path(variables['src_file']).stem}.png"
    if not picture.exists():
        return ""
    path = Path(next(variables["image_path_iterator"]))
    path.parent.mkdir(parents=True, exist_ok=True)
    picture.replace(path)
    return figure_rst([str(path)], conf["src_dir"], path.stem)


SECTIONS = ("thesis", "explained", "measured")


def section_order(folder: str) -> int:
    """Place of a section of the gallery on its page."""
    name = Path(folder).name
    return SECTIONS.index(name) if name in SECTIONS else -1
