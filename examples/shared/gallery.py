"""What the scripts of the gallery share: the thesis's scenes and numbers, three sizes, references, saved figures.

A script runs from a command line, or as a notebook, which has none. The thesis: Seo, Data-driven Multiple Importance
Sampling for Monte Carlo Rendering, KAIST 2014.
"""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from matplotlib.legend import Legend
from matplotlib.text import Text
from matplotlib.ticker import LogFormatter

from dmis import plot
from dmis.base.atomic_files import check_writable
from dmis.base.vectors import Array
from dmis.base.window import Window
from dmis.experiment.metrics import ratio_over_blocks, squared_error
from dmis.experiment.reference import Reference, make_reference
from dmis.experiment.runs import Budget, Run
from dmis.formats.load_scene import load_scene
from dmis.pipeline.result import Result
from dmis.scene.scene import Scene

T = TypeVar("T")


@dataclass(frozen=True)
class ThesisScene:
    """A scene of the thesis and its part of Table 4.1."""

    title: str
    name: str  # of the scene that comes with dmis
    original: str  # of the original pbrt-v2 file
    size: tuple[int, int]  # in the thesis
    equal_samples: float  # MSE over that of the balance heuristic, 128 = 6 + 122
    equal_time: float  # the same, 125 = 6 + 119
    overhead: float  # time at equal samples, over that of the balance heuristic, less one
    seconds: int  # that the balance heuristic took
    mse: float  # of the balance heuristic
    integrator: str = "direct"  # of the figures


SCENES = {
    scene.name: scene
    for scene in (
        ThesisScene("TEAPOT AREA LIGHT", "teapot-area-light", "teapot-area-light", (800, 800), 0.802, 0.981, 0.028, 340, 1.244e-6),  # noqa: E501
        ThesisScene("KILLEROO DIFFUSE", "killeroo-diffuse", "killeroo-diffuse", (1368, 1026), 0.935, 1.000, 0.070, 213, 3.250e-4),  # noqa: E501
        ThesisScene("KILLEROO GOLD", "killeroo-gold", "killeroo-gold", (1368, 1026), 1.119, 1.153, 0.071, 241, 5.751e-3, "path"),  # noqa: E501
        ThesisScene("TT", "tt", "env", (1500, 833), 1.286, 1.299, 0.037, 147, 8.252e-6),
    )
}  # fmt: skip
"""By name. Gold reflects little but its surroundings: figures of it are by paths. The original TT is not available: the
killeroo under an environment map, ``env.pbrt``, stands in for it."""

WEIGHT = "weight w of the heuristic"
"""What the colours of maps mean where w does not divide samples."""

SHRINK = {"quick": 32, "default": 5, "full": 1}
"""The thesis's size is divided by this."""
REFERENCE_SPP = {"quick": 32, "default": 256, "full": 128}
"""Camera samples per pixel of each half of a reference."""

PAGE_WIDTH = 700 / 96
"""Width of a page in inches: 700 pixels of 1/96 inch."""


@dataclass(frozen=True)
class Options:
    """How large a script's images are, and where its figure goes.

    Attributes
    ----------
    size
        ``quick``, ``default`` or ``full``.
    scene_dir
        Folder of the original pbrt-v2 scenes; None: the scenes that come with dmis.
    threads
        Number of threads; None: one per processor.
    output
        File of the figure, PNG.
    """

    size: str
    scene_dir: Path | None
    threads: int | None
    output: Path

    @property
    def spp(self) -> int:
        """Camera samples per pixel of a render: the thesis's 128, or fewer to be quick."""
        return 16 if self.size == "quick" else 128

    @property
    def shrink(self) -> int:
        """Usual divisor of the thesis's resolution."""
        return SHRINK[self.size]

    @property
    def progress(self) -> bool:
        """Whether renders show a bar: on a terminal or in a notebook, if tqdm is there, and not in a log."""
        return (in_notebook() or sys.stderr.isatty()) and find_spec("tqdm") is not None

    def pick(self, quick: T, default: T, full: T | None = None) -> T:
        """Return one of the values, by size."""
        return {"quick": quick, "default": default, "full": default if full is None else full}[self.size]

    def scene(self, name: str, shrink: int | None = None) -> Scene:
        """Return one of the four scenes, the original if there is a `scene_dir`; `shrink` replaces the usual one."""
        about = SCENES[name]
        width, height = about.size
        source: str | Path = about.name
        if self.scene_dir is not None:
            source = self.scene_dir / f"{about.original}.pbrt"
            if about.original == "env":
                width, height = SCENES["killeroo-gold"].size
        shrink = shrink or self.shrink
        return load_scene(source, resolution=(round(width / shrink), round(height / shrink)))

    def reference(self, scene: Scene, spp: int | None = None, integrator: str = "auto") -> Reference:
        """Return the reference of a scene in two halves: rendered the first time, read from disk afterwards."""
        more = {"integrator": integrator, "parallel": self.threads, "progress": self.progress}
        return make_reference(scene, spp or REFERENCE_SPP[self.size], **more)

    def save(self, figure: Any, title: str, caption: str, panel: Any = None, dpi: int = 200) -> None:
        """Write the figure as PNG, title, caption and panel in its metadata; print the caption, show it or its path.

        The metadata also have the number of legends, and the size of the smallest letters where it fills a page.

        `panel` is the axes that stand for the figure where there is room for one alone, the first if it is None. Its
        rectangle, labels included, is left, top, right and bottom as fractions of the picture.
        """
        caption = " ".join(caption.split())
        plain_exponents(figure)  # a raised exponent has 0.7 times the size of its label
        lay_out(figure)
        box = (panel or figure.axes[0]).get_tightbbox().transformed(figure.transFigure.inverted())
        sides = np.clip((box.x0, 1 - box.y1, box.x1, 1 - box.y0), 0, 1)
        rectangle = " ".join(f"{side:.4f}" for side in sides)
        metadata = {"Title": title, "Description": caption, "Software": "dmis", "Panel": rectangle}
        metadata |= {"Letters": f"{smallest_letters(figure):.2f}", "Legends": str(len(figure.findobj(Legend)))}
        figure.savefig(self.output, dpi=dpi, metadata=metadata)
        print(caption)
        self._show()

    def save_for_print(self, figure: Any, title: str, caption: str, panel: Any = None, dpi: int = 200) -> None:
        """Write the figure as PDF, and as PNG as `save` does; title and caption are in the metadata of both."""
        plain_exponents(figure)
        metadata = {"Title": title, "Subject": " ".join(caption.split())}
        lay_out(figure)
        figure.savefig(self.output.with_suffix(".pdf"), dpi=dpi, metadata=metadata)
        self.save(figure, title, caption, panel, dpi)

    def _show(self) -> None:
        """Show the picture in a notebook, and print its path elsewhere."""
        if in_notebook():
            from IPython.display import Image, display

            display(Image(filename=str(self.output)))  # type: ignore[no-untyped-call]
        else:
            print(self.output)


def lay_out(figure: Any) -> None:
    """Place the axes of a figure, once for all files that it is written to: that takes as long as drawing it."""
    if (engine := figure.get_layout_engine()) is not None:
        engine.execute(figure)
        figure.set_layout_engine("none")


def smallest_letters(figure: Any) -> float:
    """Return the size in points of the smallest letters of a figure where it is as wide as a page, 700 pixels."""
    texts = (text for text in figure.findobj(Text) if text.get_visible() and text.get_text().strip())
    return min(text.get_fontsize() for text in texts) * PAGE_WIDTH / figure.get_size_inches()[0]


def in_notebook() -> bool:
    """Whether a Jupyter kernel runs this process: its command line is the kernel's, and not a script's."""
    return "kernel_launcher" in Path(sys.argv[0]).name


def options(name: str, description: str | None, **more: dict[str, Any]) -> tuple[Options, argparse.Namespace]:
    """Read the command line of a script; a notebook has none, and gets the defaults.

    With ``DMIS_QUICK=1`` the default size is ``quick``.

    Parameters
    ----------
    name
        Name of the script: its figure is ``figures/<name>.png`` in the working directory.
    description
        The script's docstring.
    more
        Options of the script's own, by name, as arguments of ``add_argument``.

    Raises
    ------
    OSError
        If the figure cannot be written, before anything is rendered for it.
    """
    parser = argparse.ArgumentParser(description=(description or "").strip().split("\n")[0])
    size = parser.add_mutually_exclusive_group()
    size.add_argument("--quick", action="store_const", const="quick", dest="size", help="tiny images: seconds")
    size.add_argument("--full", action="store_const", const="full", dest="size", help="the thesis's resolution")
    parser.add_argument(
        "--scene-dir",
        type=Path,
        default=os.environ.get("DMIS_PBRT_SCENES") or None,
        help="folder of the original pbrt-v2 scenes (default: DMIS_PBRT_SCENES, or the scenes that come with dmis)",
    )
    parser.add_argument("--threads", type=int, help="default: one per processor")
    parser.add_argument("-o", "--output", type=Path, default=Path("figures") / f"{name}.png")
    for option, arguments in more.items():
        parser.add_argument(f"--{option}", **arguments)
    given = parser.parse_args([] if in_notebook() else None)
    given.output.parent.mkdir(parents=True, exist_ok=True)
    check_writable(given.output)
    usual = "quick" if os.environ.get("DMIS_QUICK", "0") not in ("", "0") else "default"
    return Options(given.size or usual, given.scene_dir, given.threads, given.output), given


def print_canvas(rows: int, columns: int, height: float, width: float = 7, **options: Any) -> tuple[Any, Any]:
    """Return a figure that is `width` x `height` inches large in print or on a page, and its axes.

    All letters have 8 points: 7.2 if a figure of 7 inches is printed in a column of 6.3 inches.
    """
    import matplotlib

    style: dict[str, Any] = {"font.size": 8, "axes.titlesize": "medium", "axes.labelsize": "medium"}
    style |= {"legend.fontsize": "medium", "xtick.labelsize": "medium", "ytick.labelsize": "medium"}
    style |= {"lines.linewidth": 1.2, "lines.markersize": 4, "pdf.fonttype": 42}
    matplotlib.rcParams.update(style)  # type: ignore[arg-type]
    return plot.canvas(rows, columns, width, height, **options)


def name_rows(axes: Array, names: Sequence[str]) -> None:
    """Write a name at the left of each row of pictures ``(R, C)``, and hide their coordinates."""
    for axis in axes.flat:
        axis.set(xticks=[], yticks=[], xlabel="", ylabel="", frame_on=False)
    for axis, name in zip(axes[:, 0], names, strict=True):
        axis.set_ylabel(name, fontsize="medium")


def window(scene: Scene, shares: tuple[float, float, float, float]) -> Window:
    """Return a window ``(x0, y0, x1, y1)``, given in shares of the image, in pixels."""
    width, height = scene.camera.resolution
    x0, y0, x1, y1 = shares
    return round(x0 * width), round(y0 * height), round(x1 * width), round(y1 * height)


class Errors(dict[Budget, Array]):
    """Squared errors of pixels by budget, sums over the seeds: `record` is for `dmis.measure`."""

    def __init__(self, reference: Reference) -> None:
        super().__init__()
        self._reference = reference

    def record(self, run: Run, result: Result) -> None:
        """Add the errors of a render."""
        budget = run.rule, run.spp
        errors = squared_error(result.image, self._reference.first, self._reference.second)
        self[budget] = errors + self.get(budget, np.zeros(()))

    def ratio(self, budget: Budget, baseline: Budget) -> tuple[float, float]:
        """Return the MSE over that of the baseline, and half of its 95 % interval; one seed of a large image does."""
        return ratio_over_blocks(self[budget], self[baseline])


def plain_exponents(figure: Any) -> None:
    """Write 1e-5 in place of ten to a small raised -5 at the logarithmic axes and colour bars of a figure."""
    for side in (side for axes in figure.axes for side in (axes.xaxis, axes.yaxis)):
        if isinstance(side.get_major_formatter(), LogFormatter):
            side.set_major_formatter(PlainLogFormatter())
            side.set_minor_formatter(PlainLogFormatter())


class PlainLogFormatter(LogFormatter):
    """The tick labels of `LogFormatter`, written by `dmis.plot.tick_text`."""

    def __call__(self, value: float, pos: int | None = None) -> str:
        """Return the label of a tick; empty where `LogFormatter` has none."""
        return plot.tick_text(value) if super().__call__(value, pos) else ""
