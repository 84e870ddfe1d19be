"""What the figure scripts share: the thesis's four scenes and numbers, three sizes, references, where figures go.

The thesis: Seo, Data-driven Multiple Importance Sampling for Monte Carlo Rendering, KAIST 2014.
"""

import argparse
import os
import platform
import re
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import table_ages

import dmis
from dmis import plot
from dmis.base.atomic_files import check_writable
from dmis.experiment.convergence import error_times
from dmis.experiment.metrics import ratio, ratio_over_blocks, squared_error
from dmis.experiment.runs import Budget, Run

ROOT = Path(__file__).resolve().parent.parent
FIGURES = ROOT / "figures"


@dataclass(frozen=True)
class ThesisScene:
    """A scene of the thesis and its row in Table 4.1: MSE over that of the balance heuristic, extra time, seconds."""

    title: str
    name: str  # of the scene that comes with dmis
    original: str  # of the original pbrt-v2 file
    size: tuple[int, int]  # in the thesis
    equal_samples: float  # 128 = 6 + 122
    equal_time: float  # 125 = 6 + 119
    overhead: float  # time at equal samples, over that of the balance heuristic, less one
    seconds: int  # that the balance heuristic took


SCENES = {
    scene.name: scene
    for scene in (
        ThesisScene("TEAPOT AREA LIGHT", "teapot-area-light", "teapot-area-light", (800, 800), 0.802, 0.981, 0.028, 340),  # noqa: E501
        ThesisScene("KILLEROO DIFFUSE", "killeroo-diffuse", "killeroo-diffuse", (1368, 1026), 0.935, 1.000, 0.070, 213),
        ThesisScene("KILLEROO GOLD", "killeroo-gold", "killeroo-gold", (1368, 1026), 1.119, 1.153, 0.071, 241),
        ThesisScene("TT", "tt", "env", (1500, 833), 1.286, 1.299, 0.037, 147),
    )
}  # fmt: skip
"""By name. The original TT is not available: the killeroo under an environment map, ``env.pbrt``, stands in for it."""

SHRINK = {"quick": 16, "default": 5, "full": 1}
"""The thesis's size is divided by this."""
TABLES = {"teapot-area-light": 4, "killeroo-diffuse": 6, "killeroo-gold": 6, "tt": 5}
"""The same for the tables of docs/rules.md."""
REFERENCE_SPP = {"quick": 64, "default": 256, "full": 128}
"""Camera samples per pixel of each half of a reference."""


@dataclass(frozen=True)
class Options:
    """How large and where."""

    size: str  # quick, default or full
    scene_dir: Path | None
    threads: int | None
    output: Path

    @property
    def spp(self) -> int:
        """The budget of a render: the thesis's 128 samples, or fewer to be quick."""
        return 16 if self.size == "quick" else 128

    @property
    def shrink(self) -> int:
        """The usual divisor of the thesis's size."""
        return SHRINK[self.size]

    def pick(self, quick, default, full=None):
        """One of the values, by size."""
        return {"quick": quick, "default": default, "full": default if full is None else full}[self.size]

    def scene(self, name: str, shrink: int | None = None) -> dmis.Scene:
        """One of the four scenes, the original if ``--scene-dir`` was given; `shrink` in place of the usual one."""
        about = SCENES[name]
        width, height = about.size
        source = about.name
        if self.scene_dir is not None:
            source = self.scene_dir / f"{about.original}.pbrt"
            if about.original == "env":
                width, height = SCENES["killeroo-gold"].size
        shrink = shrink or self.shrink
        return dmis.load_scene(source, resolution=(round(width / shrink), round(height / shrink)))

    def reference(self, scene: dmis.Scene, spp: int | None = None) -> dmis.Reference:
        """The reference of a scene in two halves: rendered the first time, read from disk afterwards."""
        spp = spp or REFERENCE_SPP[self.size]
        return dmis.make_reference(scene, spp, parallel=self.threads, progress=show(f"reference of {scene.name}"))

    def save(self, figure, title: str, caption: str) -> None:
        """Write the figure with title and caption in the picture, and say where it is."""
        plot.save(figure, self.output, title, caption)
        print(self.output)

    def save_for_print(self, figure, title: str, caption: str, dpi: int = 200) -> None:
        """Write the figure as PNG and as PDF; title and caption are in the metadata of both. Say where they are."""
        caption = " ".join(caption.split())
        figure.savefig(self.output.with_suffix(".pdf"), dpi=dpi, metadata={"Title": title, "Subject": caption})
        figure.savefig(self.output, dpi=dpi, metadata={"Title": title, "Description": caption, "Software": "dmis"})
        print(caption, self.output, sep="\n")


def options(script: str, description: str, **more: dict) -> tuple[Options, argparse.Namespace]:
    """Read the command line; `more` are options of a script's own, as arguments of ``add_argument``."""
    parser = argparse.ArgumentParser(description=description.strip().split("\n")[0])
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
    parser.add_argument("-o", "--output", type=Path, default=FIGURES / f"{Path(script).stem}.png")
    for name, arguments in more.items():
        parser.add_argument(f"--{name}", **arguments)
    given = parser.parse_args()
    for path in (given.output, getattr(given, "page", None)):  # before anything is rendered for them
        if path is not None:
            path.parent.mkdir(parents=True, exist_ok=True)
            check_writable(path)
    if given.size == "quick" and "page" in more and given.page == more["page"].get("default") is not None:
        given.page = (
            given.output.parent / given.page.name
        )  # numbers of tiny images are not for the pages of the project
    return Options(given.size or "default", given.scene_dir, given.threads, given.output), given


def print_canvas(rows: int, columns: int, height: float, width: float = 7, **options):
    """Return a figure that is printed `width` x `height` inches large, and its axes: letters are 7 points or larger."""
    import matplotlib

    sizes = {"font.size": 8, "axes.titlesize": "medium", "axes.labelsize": "medium", "legend.fontsize": 7.5}
    lines = {"lines.linewidth": 1.2, "lines.markersize": 4, "pdf.fonttype": 42}
    matplotlib.rcParams.update({**sizes, **lines, "xtick.labelsize": 7.5, "ytick.labelsize": 7.5})
    return plot.canvas(rows, columns, width, height, **options)


def draw_curve(axis, colour: str, label: str, curve: tuple, fit: tuple, pilots: tuple) -> None:
    """Draw the error of a patch against the share w of light samples, with the parabola of the thesis's rule.

    Parameters
    ----------
    curve
        Shares, errors of the patch over its error at w = 1/2, and half-lengths of their bars.
    fit
        Coefficients of the parabola, that of w² first, and the weight of the patch, its minimum in [0, 1].
    pilots
        Weights of the patch by pilots with other random numbers, and the height at which they are marked.
    """
    colour, dense = f"tab:{colour}", np.linspace(0, 1, 201)
    (coefficients, weight), (learned, level) = fit, pilots
    axis.plot(*curve[:2], "o-", color=colour, label=label)
    axis.errorbar(*curve, fmt="none", color=colour)
    axis.plot(dense, np.polyval(coefficients, dense), "--", color=colour, label="parabola through V(0), V(½), V(1)")
    marker = {"color": colour, "markersize": 8, "markeredgecolor": "black", "label": f"its minimum, w = {weight:.2f}"}
    axis.plot(weight, np.polyval(coefficients, weight), "v", **marker)
    ticks = {"color": colour, "markersize": 7, "label": f"minima of {len(learned)} pilots"}
    axis.plot(learned, np.full(len(learned), level), "|", **ticks)


def show(title: str):
    """Progress on one line, where someone is watching; None in a log."""
    if not sys.stderr.isatty():
        return None

    def progress(stage: str, done: int, total: int) -> None:
        end = "\r" + " " * 79 + "\r" if done == total else ""
        print(f"\r{title}: {stage} {100 * done // total:3d} %", end=end, file=sys.stderr, flush=True)

    return progress


def window(scene: dmis.Scene, rows: tuple[float, float], columns: tuple[float, float]) -> plot.Window:
    """A window given in shares of the image, in pixels."""
    width, height = scene.camera.resolution
    return (round(rows[0] * height), round(rows[1] * height)), (round(columns[0] * width), round(columns[1] * width))


def cell(runs: Sequence[Run], baseline: Sequence[Run]) -> str:
    """MSE over that of the baseline, same seeds, with its 95 % confidence interval; bold if the interval is below 1."""
    return bold(*ratio(np.array([run.mse for run in runs]), np.array([run.mse for run in baseline])))


IN_TIME = "Intervals in equal time have the scatter of the seconds in them, and are corrected for several rules (Holm)."
"""What a page says of the cells of `in_time`."""


def in_time(rules: Sequence[Sequence[Run]], baseline: Sequence[Run]) -> list[str]:
    """MSE times CPU seconds of each rule over that of the baseline, same seeds, with its 95 % confidence interval; bold
    if the interval is below 1.

    That is the MSE in equal time where error falls as 1 / time; see `dmis.experiment.convergence.error_times`.
    """
    texts = []
    for value, low, high in error_times(rules, baseline):
        text = f"{value:.3f} ({low:.3f} – {high:.3f})"
        texts.append(f"**{text}**" if high < 1 else text)
    return texts


def bold(value: float, half: float) -> str:
    """A ratio and half of its interval, bold if the interval is below 1."""
    text = f"{value:.3f} ± {half:.3f}"
    return f"**{text}**" if value + half < 1 else text


class Errors(dict):
    """Squared errors of pixels by budget, sums over the seeds: `keep` is for `dmis.measure`."""

    def __init__(self, reference: dmis.Reference) -> None:
        super().__init__()
        self._reference = reference

    def keep(self, budget: Budget, result: dmis.Result) -> None:
        """Add those of a render."""
        self[budget] = self.get(budget, 0) + squared_error(result.image, self._reference.first, self._reference.second)

    def ratio(self, budget: Budget, baseline: Budget) -> tuple[float, float]:
        """MSE over that of the baseline, and half of its 95 % interval: of a large image one seed is enough."""
        return ratio_over_blocks(self[budget], self[baseline])


def machine() -> str:
    """What a table was made on: processors, their name, where the system tells."""
    cpu = platform.processor() or platform.machine()
    if Path("/proc/cpuinfo").exists():
        names = re.findall(r"^model name\s*: (.*)$", Path("/proc/cpuinfo").read_text("utf-8"), re.M)
        cpu = names[0] if names else cpu
    return f"{os.cpu_count()} cores of {cpu}"


def replace_table(page: Path, kind: str, *lines: str) -> None:
    """Put the lines between the page's two marks of this kind, at the end of the page if it has none; say where.

    Behind them comes the line that `table_ages` reads: command, date, commit, and the paths that the old block named.
    """
    begin, end = f"<!-- {kind}: begin -->", f"<!-- {kind}: end -->"
    text = page.read_text("utf-8") if page.exists() else ""
    if begin not in text:
        text += f"\n{begin}\n{end}\n"
    before, _, rest = text.partition(begin)
    old, found, after = rest.partition(end)
    if not found:
        raise ValueError(f"{page} has no {end} after {begin}")
    page.parent.mkdir(parents=True, exist_ok=True)
    page.write_text("\n".join([before + begin, *lines, table_ages.marker(old), end + after]), "utf-8")
    print(page)
