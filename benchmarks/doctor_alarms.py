"""Measure the false alarms of the doctor: right tables of nine kinds, samples of a floor under square lamps.

Sizes, lamps and lobes vary by the seed. Prints the alarms of each kind, and their share of all tables with its 95 %
interval (Wilson). At 9db2350c this script also had `dmis.samples` of shipped and of random scenes.

Run: python benchmarks/doctor_alarms.py [PER_KIND]               (100: six minutes of CPU)
"""

from __future__ import annotations

import sys
from typing import Any

import numpy as np

import dmis

KINDS: dict[str, dict[str, Any]] = {
    "one lamp": {"spp": 128},
    "many lamps": {"lamps": 9, "spp": 48},
    "one of the lamps is picked": {"lamps": 9, "picks": True, "spp": 64},
    "few BRDF rows": {"pixels": 4, "spp": 200, "size": (0.03, 1), "gloss": 0},
    "few light rows": {"pixels": 12, "spp": 64, "size": (2, 6), "exponent": (10, 1e5)},
    "unequal counts": {"lamps": 4, "counts": (4, 0.25), "spp": 96},
    "columns that must be there": {
        "lamps": 4, "picks": True, "spp": 96, "columns": ("pixel", "camera_sample", "technique", "f", "p_l", "p_b"),
    },
    "few camera samples": {"pixels": 3, "spp": 12, "lamps": 4, "counts": (64, 64), "size": (0.6, 3)},
    "fireflies": {"lamps": 9, "bright": 4, "spp": 48},
}  # fmt: skip
"""Arguments of `floor`."""


def direction_about(axis: np.ndarray, cos: np.ndarray, angle: np.ndarray) -> np.ndarray:
    """Return unit vectors at an angle to unit vectors ``(N, 3)``."""
    across = np.cross(axis, np.where(np.abs(axis[:, :1]) < 0.6, [[1, 0, 0]], [[0, 1, 0]]))
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    turned = np.cos(angle)[:, None] * across + np.sin(angle)[:, None] * np.cross(axis, across)
    return cos[:, None] * axis + np.sqrt(np.maximum(1 - cos**2, 0))[:, None] * turned


def floor(
    seed: int,
    pixels: int = 16,
    spp: int = 16,
    lamps: int = 1,
    picks: bool = False,
    size: tuple[float, float] = (0.3, 3),
    exponent: tuple[float, float] = (5, 1e4),
    gloss: float = 0.5,
    counts: tuple[float, float] = (1, 1),
    bright: float = 1,
    columns: tuple[str, ...] = (),
) -> dict[str, Any]:
    """Return a right table of a floor of matte and glossy squares under square lamps at height 1, 9 at most.

    Light samples are of each lamp, or `picks` one of them; `gloss` is the share of camera samples with a Phong lobe,
    whose `exponent`, as the lamps' width, is between limits; `bright` the standard deviation of log radiance.
    """
    rng = np.random.default_rng(seed)
    width, power = (np.exp(rng.uniform(*np.log(limits))) for limits in (size, exponent))
    width /= 3 if lamps > 1 else 1  # lamps do not overlap
    centre = np.stack(np.meshgrid([-1, 0, 1], [-1, 0, 1]), axis=-1).reshape(-1, 2)[:lamps] * 1.2 * width
    radiance, chance = np.exp(bright * rng.normal(size=lamps)), rng.dirichlet(np.full(lamps, 3))
    n = pixels * pixels * spp
    place = np.c_[rng.uniform(-1, 1, (n, 2)) * max(1, width), np.zeros(n)]
    shiny = np.arange(n) // spp % 16 < 16 * gloss
    mirrored = place - [0, -4, 2]  # seen from (0, -4, 2)
    mirrored *= [1, 1, -1] / np.linalg.norm(mirrored, axis=1, keepdims=True)

    def rows(sample: np.ndarray, technique: int, lamp: np.ndarray | None, met: np.ndarray) -> dict[str, np.ndarray]:
        """Return rows of directions from camera samples to points of the lamps' plane, `met`."""
        to = met - place[sample]
        distance = np.linalg.norm(to, axis=1)
        wi = to / distance[:, None]
        inside = (np.abs(met[:, None, :2] - centre) <= width / 2).all(axis=2)
        lamp = inside.argmax(axis=1) if lamp is None else lamp
        q = chance[lamp] if picks else 1
        cos = np.maximum(wi[:, 2], 1e-6)
        p_l = np.where(inside[np.arange(len(met)), lamp], q * distance**2 / (cos * width**2), 0)
        about = np.clip((wi * mirrored[sample]).sum(axis=1), 0, 1)
        p_b = np.where(shiny[sample], (power + 1) / (2 * np.pi) * about**power, cos / np.pi)
        seen = np.cos(5 * met[:, 0] + 3 * place[sample, 1]) > -0.5
        f = p_b * radiance[lamp] * seen * (p_l > 0) * np.exp(bright * np.sin(9 * met[:, 1]))
        up = np.broadcast_to([0.0, 0.0, 1.0], wi.shape)
        table = {
            "pixel": sample // spp, "camera_sample": sample % spp, "technique": np.full(len(sample), technique),
            "f": f, "p_l": p_l, "p_b": p_b, "light": lamp, "lobe": shiny[sample].astype(int), "direction": wi,
            "normal": up, "geometric_normal": up, "light_normal": -up, "distance": distance,
        }  # fmt: skip
        kept = (p_l > 0) & (p_b > 0)
        return {name: column[kept] for name, column in table.items() if not columns or name in columns}

    def drawn(count: float, times: int) -> np.ndarray:
        """Return camera samples, each `count` times on average, and that `times`."""
        return np.repeat(np.tile(np.arange(n), times), rng.binomial(1, count, n * times) if count < 1 else int(count))

    sample = drawn(counts[0], 1 if picks else lamps)
    lamp = rng.choice(lamps, len(sample), p=chance) if picks else np.arange(len(sample)) * lamps // len(sample)
    met = np.c_[centre[lamp] + width * rng.uniform(-0.5, 0.5, (len(sample), 2)), np.ones(len(sample))]
    of_light = rows(sample, 0, lamp, met)
    sample = drawn(counts[1], 1)
    u = rng.random(len(sample))
    axis = np.where(shiny[sample, None], mirrored[sample], [0, 0, 1])
    cos = np.where(shiny[sample], u ** (1 / (power + 1)), np.sqrt(u))
    wi = direction_about(axis, cos, 2 * np.pi * rng.random(len(sample)))
    up = wi[:, 2] > 1e-6
    of_brdf = rows(sample[up], 1, None, place[sample[up]] + wi[up] / wi[up, 2:])
    table = {name: np.concatenate([column, of_brdf[name]]) for name, column in of_light.items()}
    header = {"version": 1, "light_samples": counts[0], "brdf_samples": counts[1]}
    return table | header | ({} if columns else {"shape": (pixels, pixels)})


def trial(kind: str, seed: int) -> tuple[bool, str]:
    """Return whether a right table of `KINDS` alarms, and why; one with too few rows for a test does not."""
    try:
        diagnosis = dmis.diagnose(floor(seed, **KINDS[kind]))
    except ValueError as error:
        if "both can draw" not in str(error):
            raise
        return False, ""
    beyond = [f"{t.name} {t.where} {t.z:.1f}" for t in diagnosis.tests if t.trusted and abs(t.z) > diagnosis.limit]
    return not diagnosis.healthy, f"{kind} {seed}: p {diagnosis.joint}, {', '.join(beyond[:3])}"


def run(per_kind: int = 100) -> None:
    """Print the shares of alarms."""
    alarms, tables = 0, per_kind * len(KINDS)
    for kind in KINDS:
        said = [text for wrong, text in (trial(kind, seed) for seed in range(per_kind)) if wrong]
        alarms += len(said)
        print(f"{kind}: {len(said)} of {per_kind}", *said[:9], sep="\n  ", flush=True)
    share, z = alarms / tables, 1.96
    middle = (share + z * z / 2 / tables) / (1 + z * z / tables)
    half = z * np.sqrt(share * (1 - share) / tables + (z / 2 / tables) ** 2) / (1 + z * z / tables)
    print(f"{alarms} of {tables} right tables alarm: {share:.1%} ({middle - half:.1%} to {middle + half:.1%})")


if __name__ == "__main__":
    run(*map(int, sys.argv[1:]))
