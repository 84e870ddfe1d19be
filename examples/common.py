"""What the scripts beside the gallery share: tables of pages, progress on a line.

What they share with the gallery, too, is in `dmis.examples.gallery`.
"""

import argparse
import os
import platform
import re
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path

from dmis.base.atomic_files import check_writable
from dmis.examples import gallery
from dmis.examples.gallery import SCENES, Options, print_canvas  # noqa: F401  # for other scripts

ROOT = Path(__file__).resolve().parent.parent
TABLES = {"teapot-area-light": 4, "killeroo-diffuse": 6, "killeroo-gold": 6, "tt": 5}
"""The thesis's size is divided by this for published tables: 200x200, 228x171, 228x171 and 300x167 pixels."""


def options(script: str, description: str, **more: dict) -> tuple[Options, argparse.Namespace]:
    """Read the command line; `more` are options of a script's own; ``page`` and ``csv`` are files that it writes."""
    opts, given = gallery.options(Path(script).stem, description, **more)
    for name in {"page", "csv"} & vars(given).keys():
        path = getattr(given, name)
        if path is not None:
            path.parent.mkdir(parents=True, exist_ok=True)
            check_writable(path)
            if opts.size == "quick" and path.resolve().is_relative_to(ROOT / "docs"):
                # numbers of tiny images are not for the pages of the project
                setattr(given, name, opts.output.parent / path.name)
    return opts, given


def show(title: str):
    """Progress on one line, where someone is watching; None in a log."""
    if not sys.stderr.isatty():
        return None

    def progress(stage: str, done: int, total: int) -> None:
        end = "\r" + " " * 79 + "\r" if done == total else ""
        print(f"\r{title}: {stage} {100 * done // total:3d} %", end=end, file=sys.stderr, flush=True)

    return progress


def bold(value: float, half: float) -> str:
    """A ratio and half of its interval, bold if the interval is below 1."""
    text = f"{value:.3f} ± {half:.3f}"
    return f"**{text}**" if value + half < 1 else text


def machine() -> str:
    """What a table was made on: processors, their name, where the system tells."""
    cpu = platform.processor() or platform.machine()
    if Path("/proc/cpuinfo").exists():
        names = re.findall(r"^model name\s*: (.*)$", Path("/proc/cpuinfo").read_text("utf-8"), re.M)
        cpu = names[0] if names else cpu
    return f"{os.cpu_count()} cores of {cpu}"


def write_webp(picture: Path, to: Path) -> None:
    """Write a picture for the pages, as WebP; print its path."""
    from PIL import Image

    with Image.open(picture) as image:
        image.convert("RGB").save(to, quality=85, method=6)
    print(to)


def replace_tables(tables: Mapping[str, Sequence[str]]) -> None:
    """Write the lines of blocks such as ``"results.md: steps"`` into the pages."""
    for block, lines in tables.items():
        page, mark = page_of(block)
        replace_table(page, mark, *lines)


def page_of(block: str) -> tuple[Path, str]:
    """Return the page and the mark of a block such as ``"results.md: steps"``."""
    name, _, mark = block.partition(": ")
    return (ROOT if name == "README.md" else ROOT / "docs") / name, mark


def replace_table(page: Path, kind: str, *lines: str) -> None:
    """Put the lines between the page's two marks of this kind, at the end of the page if it has none; say where."""
    begin, end = f"<!-- {kind}: begin -->", f"<!-- {kind}: end -->"
    text = page.read_text("utf-8") if page.exists() else ""
    if begin not in text:
        text += f"\n{begin}\n{end}\n"
    before, _, rest = text.partition(begin)
    _, found, after = rest.partition(end)
    if not found:
        raise ValueError(f"{page} has no {end} after {begin}")
    page.parent.mkdir(parents=True, exist_ok=True)
    page.write_text("\n".join([before + begin, *lines, end + after]), "utf-8")
    print(page)
