"""
Speed, and what was to be reached
=================================

How fast renders are beside the floor, the time in Embree: machines differ and their speed varies; the ratio of total
to floor is the cost that NumPy adds.

    python benchmarks/speed.py my.pbrt --rules balance,auto

prints the table of one scene or more. Without a scene it measures those of the thesis; where the time goes; two
threads; memory; start-up. It prints each target and whether it is met. Rows go to docs/tables/speed.csv and
speed-targets.csv, which docs/performance.md is made of. Takes ten minutes on an idle machine. Exits with 1 if a ratio
misses its target by more than a fifth. Absolute times depend on the machine: they are reported.
"""

import argparse
import cProfile
import itertools
import math
import pstats
import statistics
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path, PurePath
from typing import Any

import numpy as np

import dmis
from dmis.pipeline.job import resolve
from dmis.pipeline.render import render_job

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT / "examples"))
from common import SCENES, show
from rows import markdown, read_rows, write_rows

SPEEDS, TARGETS = (ROOT / "docs" / "tables" / f"speed{part}.csv" for part in ("", "-targets"))
RESOLUTION = (342, 256)
SLACK = 1.2
"""A ratio may miss its target by this factor before it counts as a failure."""
TIME_PARTS = {
    "random numbers": {
        "streams.py": {"draw", "start", "stream"},
        "sobol.py": {"draw"},
        "stratified.py": {"draw"},
    },
    "statistics": {"curves.py": {"add", "sums"}, "objectives.py": {"add", "sums"}, "direct.py": {"_record"}},
    "film": {"moments.py": {"of", "merge", "add", "total"}},
}
"""Functions whose time, with that of their callees, is one part of a tile's time; the rest is shading."""

HEAD = "scene, rule, Msamples/s, Mrays/s, rays per sample, seconds, in Embree, total / floor, range".split(", ")
FIELDS = ("scene", "rule", "samples", "rays", "seconds", "in Embree")
"""Columns of `SPEEDS`: camera samples and rays of one render, its wall seconds, and those in its Embree calls."""
Rows = list[dict[str, Any]]


def bench(names: Sequence[str], rules: Sequence[str], spp: int, repeats: int, **settings: Any) -> Rows:
    """Render scenes by rules on one thread, `repeats` times in turns, and return a row for each render."""
    scenes = [dmis.load_scene(name, resolution=RESOLUTION) for name in names]
    progress, rows = show("bench"), Rows()
    for seed in range(repeats):
        for scene, rule in itertools.product(scenes, rules):
            job = resolve(scene, rule, spp, seed, dmis.Settings(**settings)).alone
            job.scene.prepare()  # once, before the first render
            result = render_job(job, 1)
            numbers = math.prod(scene.camera.resolution) * job.spp, sum(result.rays.values())
            seconds = (f"{result.seconds[part]:.5g}" for part in ("total", "embree"))
            rows.append(dict(zip(FIELDS, (scene.name, job.rule_text, *numbers, *seconds), strict=True)))
            if progress:
                progress(f"{scene.name} {rule}", len(rows), repeats * len(scenes) * len(rules))
    return rows


def cases(rows: Rows) -> dict[tuple[str, str], np.ndarray]:
    """Return samples, rays, seconds and those in Embree of each render ``(4, repeats)``, by scene and rule."""
    renders: dict[tuple[str, str], list[list[float]]] = {}
    for row in rows:
        renders.setdefault((row["scene"], row["rule"]), []).append([float(row[field]) for field in FIELDS[2:]])
    return {case: np.array(numbers).T for case, numbers in renders.items()}


def speed_table(rows: Rows) -> list[str]:
    """Return the lines of the table of speeds: medians over renders, and the range of total over floor."""
    lines = []
    for case, (samples, rays, seconds, floor) in cases(rows).items():
        total, embree, ratios = np.median(seconds), np.median(floor), seconds / floor
        rates = samples[0] / total / 1e6, rays[0] / total / 1e6, rays[0] / samples[0]
        lines.append(
            [
                *case,
                *(f"{x:.2f}" for x in (*rates, total, embree, np.median(ratios))),
                f"{ratios.min():.2f} – {ratios.max():.2f}",
            ]
        )
    return markdown(HEAD, lines)


@dataclass(frozen=True)
class Target:
    """A figure to reach: at most, or (`least`) at least, `limit`."""

    name: str
    value: float
    limit: float
    unit: str = ""
    least: bool = False
    ratio: bool = True

    @property
    def miss(self) -> float:
        """How many times too much, or too little; at most 1 if the target is met."""
        return self.limit / self.value if self.least else self.value / self.limit

    def row(self) -> str:
        """The row of the table of targets."""
        sign = "≥" if self.least else "≤"
        met = "yes" if self.miss <= 1 else f"**no**, by {self.miss - 1:.0%}"
        value = f"{self.value:.{2 if self.value < 10 else 0}f}"
        return f"| {self.name} | {value}{self.unit} | {sign} {self.limit:g}{self.unit} | {met} |"


def target_table(targets: list[Target]) -> list[str]:
    """Return the lines of the page's table: a row for each target, its values by scene, bold where it is missed."""
    rows: dict[str, list[str]] = {}
    for target in targets:
        name, _, scene = target.name.rpartition(", ")
        if scene not in ("cornell", *SCENES):
            name, scene = target.name, ""
        value, limit = (cell.strip() for cell in target.row().split("|")[2:4])
        value = f"**{value}**" if target.miss > 1 else value
        rows.setdefault(f"| {name} | {limit} |", []).append(f"{scene} {value}".strip())
    return ["| target | to reach | measured |", "|---|---|---|", *(f"{k} {', '.join(v)} |" for k, v in rows.items())]


def time_by_part(name: str, rule: str, resolution: tuple[int, int], spp: int) -> dict[str, float]:
    """Return the shares of `TIME_PARTS` and of shading in the time of the tiles of a render, which add up to 1.

    With those of pilot and fit in its seconds. It is rendered once more under Python's profiler.
    """
    job = resolve(dmis.load_scene(name, resolution=resolution), rule, spp, 0, dmis.Settings())
    job.scene.prepare()  # now, so that it is not part of the seconds of the fit
    stages = render_job(job, 1).seconds
    profile = cProfile.Profile(time.thread_time)
    embree = profile.runcall(render_job, job, 1).seconds["embree"]
    seconds = {"embree": embree, **dict.fromkeys((*TIME_PARTS, "shading"), 0.0)}
    for (file, _, function), (_, _, _, inclusive, _) in pstats.Stats(profile).stats.items():  # type: ignore[attr-defined]
        name = PurePath(file).name
        if name == "tile.py" and function == "render_tile":
            seconds["shading"] += inclusive
        for part, files in TIME_PARTS.items():
            if "dmis" in file and function in files.get(name, ()):
                seconds[part] += inclusive
    total = seconds["shading"]
    seconds["shading"] -= sum(seconds[part] for part in ("embree", *TIME_PARTS))
    shares = {part: time_of_part / total for part, time_of_part in seconds.items()}
    return shares | {stage: stages[stage] / stages["total"] for stage in ("pilot", "fit")}


def peak_memory(source: str, rule: str, resolution: tuple[int, int], spp: int, parallel: int = 2) -> int:
    """Return the peak resident memory in bytes of a process that loads a scene and renders it (POSIX)."""
    code = (
        "import dmis, dmis.base.malloc; "
        f"dmis.render(dmis.load_scene({source!r}, resolution={resolution!r}), {rule!r}, {spp}, parallel={parallel}); "
        "print(dmis.base.malloc.peak())"
    )
    return int(fresh_python(code))


def fresh_python(code: str) -> str:
    """Return the output of a new Python process that runs `code`, which must be trusted."""
    return subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout


def floors(rows: Rows, kind: str, limit: float) -> Iterator[Target]:
    """Total over floor, of the balance heuristic."""
    for (scene, rule), (_, _, seconds, floor) in cases(rows).items():
        if rule == "balance":
            yield Target(f"total / floor, {kind}{scene}", float(np.median(seconds / floor)), limit)


def threads(names: list[str], spp: int, repeats: int) -> Iterator[Target]:
    """What a second thread brings."""
    for name in names:
        scene = dmis.load_scene(name, resolution=RESOLUTION)
        gains = []
        for seed in range(repeats):
            one, two = (dmis.render(scene, "balance", spp, seed=seed, parallel=n).seconds["total"] for n in (1, 2))
            gains.append(one / two)
        yield Target(f"2 threads over 1, {name}", statistics.median(gains), 1.7, " ×", least=True)


def learning(names: list[str]) -> Iterator[Target]:
    """Statistics, filter and fit at 128 samples per pixel."""
    for name in names:
        case = "second-moment", (228, 171), 128
        parts = time_by_part(name, *case)
        share = parts["fit"] + parts["statistics"]
        yield Target(f"statistics and fit at 128 spp, {name}", 100 * share, 3, " %")


def memory() -> Iterator[Target]:
    """Peak memory of a large image on two threads, and whether it grows with the samples."""
    few, many = (peak_memory("tt", "auto", (1500, 833), spp) for spp in (16, 64))
    yield Target("peak memory, tt 1500×833, auto, 2 threads", many / 1e6, 250, " MB", ratio=False)
    yield Target("the same, 64 spp over 16", many / few, 1.1)


def starting(repeats: int) -> Iterator[Target]:
    """Import, and loading the largest scene."""
    clock = "import time; begin = time.perf_counter(); {}; print(time.perf_counter() - begin)"
    for name, code, limit in (
        ("import dmis", "import dmis", 0.3),
        ("load killeroo-gold (622 K triangles), import included", "import dmis; dmis.load_scene('killeroo-gold')", 3.0),
    ):
        value = statistics.median(float(fresh_python(clock.format(code))) for _ in range(repeats))
        yield Target(name, value, limit, " s", ratio=False)


def tables() -> dict[str, list[str]]:
    """Return the lines of the blocks."""
    targets = [
        Target(r["name"], float(r["value"]), float(r["limit"]), r["unit"], r["least"] == "True", r["ratio"] == "True")
        for r in read_rows(TARGETS)
    ]
    return {"performance.md: targets": target_table(targets), "performance.md: speed": speed_table(read_rows(SPEEDS))}


def main() -> int:
    """Measure, print, and write rows."""
    parser = argparse.ArgumentParser(description="speed beside the Embree floor, and the targets")
    parser.add_argument("scenes", nargs="*", help="scenes, of which nothing but the table is printed")
    parser.add_argument("--rules", default="balance,thesis:weigh=samples,auto", help="separated by commas")
    parser.add_argument("--spp", type=int, default=32)
    parser.add_argument("--repeats", type=int, default=5)
    given = parser.parse_args()
    names = given.scenes or list(SCENES)
    speeds = bench(names, given.rules.split(","), given.spp, given.repeats)
    print(*speed_table(speeds), sep="\n")
    if given.scenes:
        return 0
    for scene, rule in cases(speeds):
        parts = time_by_part(scene, rule, RESOLUTION, given.spp)
        print(f"{scene}, {rule}:", ", ".join(f"{part} {share:.0%}" for part, share in parts.items()), flush=True)
    # paths of six surfaces, and in the box of colours
    paths = bench(["cornell", *names], ["balance"], given.spp, given.repeats, integrator="path", max_depth=6)
    targets = []
    for group in (
        floors(speeds, "", 1.6),
        floors(paths, "paths, ", 1.8),
        threads(names, given.spp, given.repeats),
        learning(names),
        memory(),
        starting(given.repeats),
    ):
        for target in group:
            print(target.row(), flush=True)
            targets.append(target)
    write_rows(SPEEDS, speeds, FIELDS)
    rows = [asdict(target) | {"value": f"{target.value:.5g}"} for target in targets]
    write_rows(TARGETS, rows, list(rows[0]))
    failed = [target for target in targets if target.ratio and target.miss > SLACK]
    for target in failed:
        print(f"missed by more than {SLACK - 1:.0%}: {target.name}", file=sys.stderr)
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
