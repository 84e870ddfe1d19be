"""What sphinx-gallery needs to know of the scripts: how they are run, and where their pictures are."""

from pathlib import Path

from sphinx_gallery.scrapers import figure_rst

FIGURES = Path(__file__).parent / "_build" / "figures"
KEPT = {"plot_scale"}
"""Scripts that draw what was measured once, and is kept with the project, unless they are asked to be quick."""


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
