"""
Faults of multiple importance sampling, as they look
====================================================

Nine faults of benchmarks/doctor_faults.py, planted in tables of dmis's own samples: beside each right image, the
image that the balance heuristic makes of the same samples with the fault.
"""

import sys

import numpy as np
from common import ROOT, options, print_canvas, write_webp

from dmis import plot

sys.path.insert(0, str(ROOT / "benchmarks"))
import doctor_faults
from doctor_faults import dmis_table

PLATES = {
    "density": "teapot-area-light",
    "area": "teapot-area-light",
    "cosine": "teapot-area-light",
    "lights": "ten-lights",
    "twice": "veach-mis",
    "sine": "tt-overcast",
    "two-sided": "killeroo-diffuse",
    "normals": "teapot-area-light",
    "lobe": "tt",
}
"""Scene in which each fault is shown."""


def image(table: dict) -> np.ndarray:
    """Return the direct light of a table's samples, ``(H, W, 3)``, with the balance heuristic."""
    estimates = table["f"] / (table["p_l"] + table["p_b"])[:, None]
    height, width = table["shape"]
    sums = [np.bincount(table["pixel"], estimate, height * width) for estimate in estimates.T]
    return np.stack(sums, axis=1).reshape(height, width, 3) / (table["camera_sample"].max() + 1)


def blocks(pixels: np.ndarray) -> np.ndarray:
    """Return the means of 4x4 pixels."""
    height, width = (side // 4 for side in pixels.shape[:2])
    return pixels[: 4 * height, : 4 * width].reshape(height, 4, width, 4, 3).mean(axis=(1, 3, 4))


opts, given = options(__file__, __doc__, docs={"action": "store_true", "help": "also write the picture of docs/images"})
spp, side = opts.pick(2, 64), opts.pick(24, 160)
tables = {name: dmis_table.table(doctor_faults.small(name, side), spp) for name in set(PLATES.values())}
figure, axes = print_canvas(5, 6, 5.4)
for axis in axes.flat:
    axis.set_axis_off()
for trio, (fault, name) in zip(axes.reshape(-1, 3), PLATES.items()):
    right, wrong = image(tables[name]), image(doctor_faults.plant(fault, tables[name]))
    exposure = 0.7 / np.quantile(right.mean(axis=2), 0.97)
    plot.picture(trio[0], right, name, exposure=exposure)
    plot.picture(trio[1], wrong, f"{fault}: {wrong.sum() / right.sum() - 1:+.1%}", exposure=exposure)
    before, after = blocks(right), blocks(wrong)
    change = np.where(before > 0, after / np.where(before > 0, before, 1) - 1, 0)
    plot.heat(trio[2], change, "change", cmap="RdBu_r", vmin=-0.3, vmax=0.3)
    print(f"{fault}, {name}: mean {wrong.sum() / right.sum() - 1:+.2%}, blocks {np.quantile(change, [0.05, 0.95])}")
opts.save(
    figure,
    "Faults of multiple importance sampling, as they look",
    f"""Left: direct light, {spp} camera samples per pixel, balance heuristic. Middle: the same samples with a fault in
    a density or in f (docs/doctor.md), and the change of the mean. Right: the change in blocks of 4x4 pixels,
    from -30 % (blue) to +30 % (red).""",
)
if given.docs and opts.size != "quick":
    write_webp(opts.output, ROOT / "docs" / "images" / "doctor.webp")
