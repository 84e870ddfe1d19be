"""The grid on the killeroo scenes' floor and walls: ``textures/grid.exr``, one cell, repeated by the scene files.

64x64 texels, light with one dark line of 8 texels each way; the scenes repeat it 16 times where the thesis's
files have one image of 1024x1024 with the same lines.
"""

from pathlib import Path

import numpy as np

from dmis.image import write_exr

LIGHT, DARK = 0.9214, 0.0784
CELL, BEGIN, END = 64, 32, 40

line = np.zeros(CELL, bool)
line[BEGIN:END] = True
grid = np.where(line[:, None] | line, DARK, LIGHT)
write_exr(Path(__file__).parent / "textures" / "grid.exr", {"RGB": np.repeat(grid[..., None], 3, axis=2)})
