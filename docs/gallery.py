"""What sphinx-gallery needs to know of the scripts: which are run, in which order their sections stand, where
their pictures are.

Tutorials are run. The scripts of ``examples`` are not, because at the size that can be trusted they take hours: the
page of each shows the figure that ``make figures`` has written to ``docs/figures``, with its caption.
"""

import json
import re
from pathlib import Path

from PIL import Image

ROOT = Path(__file__).resolve().parent.parent
FIGURES = ROOT / "docs" / "figures"
CAPTIONS = json.loads((FIGURES / "captions.json").read_text("utf-8"))
"""By script: title, caption, how the figure was made, and the rectangle of the panel that stands for it."""
SECTIONS = ("thesis", "explained", "measured")


def section_order(folder: str) -> int:
    """Return the place of a section on the page of the gallery."""
    name = Path(folder).name
    return SECTIONS.index(name) if name in SECTIONS else -1


def announce(conf: dict, script: dict) -> list[str]:
    """Print which tutorial begins to run; return the arguments of its command line, none."""
    source = Path(script["src_file"])
    script["example_globals"]["__file__"] = str(source)  # as it is when it is run as a script
    print(f"running {source.name}", flush=True)
    return []


def write_panels(folder: Path) -> None:
    """Write one panel of each figure where sphinx-gallery looks for the picture of a script, below `folder`."""
    for script in (ROOT / "examples").glob("*/plot_*.py"):
        if script.stem not in CAPTIONS:
            continue
        images = folder / script.parent.name / "images"
        images.mkdir(parents=True, exist_ok=True)
        with Image.open(FIGURES / f"{script.stem}.webp") as figure:
            width, height = figure.size
            left, top, right, bottom = CAPTIONS[script.stem]["panel"]
            panel = figure.crop((int(left * width), int(top * height), int(right * width), int(bottom * height)))
        panel.save(images / f"sphx_glr_{script.stem}_001.webp", quality=90)


def with_code(text: str) -> str:
    """Return the text of a script's page with the code of the thesis's fit below the cell that prints it."""
    code = "\n.. literalinclude:: /../dmis/fit/thesis.py\n   :pyobject: parabola_minimum\n"
    return re.sub(r"^ +print\(getsource\(parabola_minimum\)\)\n", lambda line: f"{line[0]}{code}", text, flags=re.M)


def with_figure(page: str, text: str) -> str:
    """Return the text of a script's page with its figure and caption below the title; a click shows it by itself."""
    stem = page.rpartition("/")[2]
    if stem not in CAPTIONS:
        return text
    about = CAPTIONS[stem]
    caption = re.sub(r"([\\*`|_])", r"\\\1", f"{about['caption']} ({about['made']}.)")
    target = f"{'../' * page.count('/')}_images/{stem}.webp"
    figure = f".. figure:: /figures/{stem}.webp\n   :alt: {about['title']}\n   :target: {target}\n\n   {caption}\n"
    return re.sub(r"^=+\n", lambda line: f"{line[0]}\n{figure}\n", text, count=1, flags=re.M)
