"""
Which scene files load
======================

Loads every scene file below a folder and prints a table: loaded, or the reasons why not, most frequent first, with the
number of places. ``python benchmarks/read_scenes.py FOLDER``; files without WorldBegin, which others include, are left
out. An exception that is no refusal is named as an error of dmis.
"""

from __future__ import annotations

import argparse
import re
import time
import warnings
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import dmis

SUFFIXES = ".pbrt", ".glb", ".gltf", ".obj"


def scene_files(folder: Path) -> Iterator[Path]:
    """Yield the files below a folder that are scenes by themselves, in order."""
    for path in sorted(path for path in folder.rglob("*") if path.suffix.lower() in SUFFIXES):
        if path.suffix.lower() != ".pbrt" or "WorldBegin" in path.read_text("utf-8", "replace"):
            yield path


def reasons(message: str) -> Counter[str]:
    """Return the reasons of a refusal, without file, line and list of what is allowed, with their numbers of places."""
    counts: Counter[str] = Counter()
    for line in message.split("\n"):
        if match := re.match(r".*?:\d+: token (.*?)(?: \(and (\d+) more places\))?$", line):
            counts[match[1].split(";")[0][:100]] += 1 + int(match[2] or 0)
    return counts or Counter([message.split("\n")[0][:100]])


def load(path: Path) -> tuple[str, Counter[str], int]:
    """Return the outcome of a file, loaded, refused or error; the reasons; and the number of warnings."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        try:
            dmis.load_scene(path)
        except (ValueError, OSError, ImportError) as error:
            return "refused", reasons(str(error)), len(caught)
        except Exception as error:
            return "error", Counter([f"{type(error).__name__}: {error}"[:100]]), len(caught)
    return "loaded", Counter(), len(caught)


def main(arguments: list[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n")[1])
    parser.add_argument("folder", type=Path)
    folder = parser.parse_args(arguments).folder
    outcomes, everything = Counter[str](), Counter[str]()
    print("| file | outcome | seconds | warnings | reasons |\n|---|---|---|---|---|")
    for path in scene_files(folder):
        begin = time.perf_counter()
        outcome, why, warned = load(path)
        seconds = time.perf_counter() - begin
        outcomes[outcome] += 1
        everything.update(dict.fromkeys(why, 1))
        text = "; ".join(f"{reason} ({count})" for reason, count in why.most_common(5))
        print(f"| {path.relative_to(folder)} | {outcome} | {seconds:.1f} | {warned} | {text} |", flush=True)
    print(f"\n{', '.join(f'{count} {outcome}' for outcome, count in outcomes.items())}")
    for reason, count in everything.most_common(20):
        print(f"{count} files: {reason}")


if __name__ == "__main__":
    main()
