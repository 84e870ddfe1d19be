"""Speed against the Embree floor: ``python -m dmis bench``."""

from __future__ import annotations

from dmis.load import load_scene
from dmis.render import render
from dmis.replay import embree_seconds
from dmis.settings import Settings

HEADER = """| scene | rule | Msamples/s | rays per sample | seconds | Embree alone | total / floor |
|---|---|---|---|---|---|---|"""


def bench_row(
    source: str,
    rule: str,
    resolution: tuple[int, int],
    spp: int,
    threads: int,
    repeats: int = 3,
    seed: int = 0,
    settings: Settings | None = None,
) -> str:
    """One row of the table: the median of `repeats` renders, each followed by the replay of its Embree calls."""
    scene = load_scene(source, resolution=resolution)
    runs = []
    for k in range(repeats):
        result = render(scene, rule, spp, seed=seed + k, settings=settings, threads=threads)
        runs.append((result.seconds["total"], embree_seconds(scene, result.tiles, threads), result))
    seconds, floor, result = sorted(runs, key=lambda run: run[0] / run[1])[repeats // 2]
    samples = resolution[0] * resolution[1] * spp
    rays = sum(result.rays.values()) / samples
    return (
        f"| {scene.name} | {rule} | {samples / seconds / 1e6:.2f} | {rays:.2f} | {seconds:.2f} | {floor:.2f} "
        f"| {seconds / floor:.2f} |"
    )
