"""Pictures: coordinates, colours, captions in the file; the state of matplotlib stays that of the user."""

import numpy as np
import pytest

pytest.importorskip("matplotlib")

from helpers import fresh_python
from matplotlib.image import imread
from PIL import Image

from dmis import plot


def test_coordinates_are_pixels(tmp_path):
    """A window keeps the pixel numbers of the whole image."""
    figure, axes = plot.canvas(1, 2, 6, 3)
    plot.picture(axes[0, 0], np.zeros((20, 30, 3)), "whole")
    plot.picture(axes[0, 1], np.zeros((20, 30, 3)), "part", (10, 5, 25, 10))
    assert axes[0, 0].get_xlim() == (0, 30) and axes[0, 0].get_ylim() == (20, 0)
    assert axes[0, 1].get_xlim() == (10, 25) and axes[0, 1].get_ylim() == (10, 5)
    assert axes[0, 1].get_title() == "part" and not len(axes[0, 1].get_xticks())
    # As in the thesis; and 1/2 is nearly white
    figure, axes = plot.canvas(1, 1, 4, 3)
    mappable = plot.weights(axes[0, 0], np.array([[0.0, 0.5, 1.0]]))
    brdf, half, light = mappable.cmap(mappable.norm(np.array([0.0, 0.5, 1.0])))[:, :3]
    assert brdf[0] > 0.3 > max(brdf[1:]) and light[2] > 0.3 > light[0] and min(half) > 0.9


def test_saved_figure_has_its_caption(tmp_path):
    """In the picture, below the axes, and in the metadata."""
    path = tmp_path / "folder" / "figure.png"
    sizes = []
    for caption in ("Short.", "Long. " * 200):
        figure, axes = plot.canvas(1, 1, 4, 3)
        plot.heat(axes[0, 0], np.eye(3))
        plot.save(figure, path, "A title", caption)
        with Image.open(path) as image:
            about = image.info
        assert about["Title"] == "A title" and about["Description"] == caption
        sizes.append(imread(path).shape[0])
    assert sizes[1] > sizes[0] + 200


def test_figures_for_files_leave_pyplot_alone(tmp_path):
    """Backend, open figures and settings of the process are the same before and after; ``pyplot`` is not imported.

    The backend is ``svg`` here, which like a notebook's is neither Agg nor a window. A change of backend, or a figure
    of the library in ``pyplot``, would keep a notebook from showing its own.
    """
    draw = f"""
import sys
import matplotlib, numpy as np
matplotlib.use("svg")
matplotlib.rcParams["font.size"] = 7.5
from types import SimpleNamespace
from dmis import plot
from dmis.experiment.runs import Run
from dmis.report.plots import convergence, error_svg, map_png
run = Run("balance", 4, 0, 100, 0.0, 0.0, 1.0, 0.1, 0.01, 0.1, 1.0)
comparison = SimpleNamespace(scene="s", seeds=1, oracle=None, runs={{("balance", 4): [run]}})
def draw():
    figure, axes = plot.canvas(1, 2, 6, 3)
    plot.weight_bar(figure, plot.weights(axes[0, 0], np.eye(3)), axes)
    plot.save(figure, {str(tmp_path / "a.png")!r}, "title", "caption")
    convergence(comparison, {str(tmp_path / "b.png")!r})
    assert "<svg" in error_svg(comparison, "seconds")
    map_png(np.eye(3), "magma")
"""
    fresh_python(f"""{draw}
draw()
assert "matplotlib.pyplot" not in sys.modules and matplotlib.get_backend() == "svg"
import matplotlib.pyplot as plt
mine = plt.figure()
before = dict(matplotlib.rcParams)
draw()
assert plt.get_backend() == "svg" and plt.get_fignums() == [1] and plt.gcf() is mine
assert dict(matplotlib.rcParams) == before
""")


def test_show_writes_the_open_figures_where_there_is_no_screen(tmp_path):
    """With Agg each figure of ``pyplot`` becomes a file and is closed; those of `dmis.plot.canvas` do not."""
    fresh_python(f"""
import matplotlib
matplotlib.use("Agg")
import matplotlib.pyplot as plt
from dmis import plot
plot.canvas(1, 1, 3, 2)
for _ in range(2):
    plt.subplots(figsize=(2, 2))
paths = plot.show("t", {str(tmp_path)!r})
assert [path.name for path in paths] == ["t-1.png", "t-2.png"] and plt.get_fignums() == []
""")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["t-1.png", "t-2.png"]
