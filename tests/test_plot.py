"""Pictures: coordinates, colours, captions in the file."""

import numpy as np
import pytest

pytest.importorskip("matplotlib")

from matplotlib.image import imread
from PIL import Image

from dmis import plot


def test_coordinates_are_pixels():
    """A window keeps the pixel numbers of the whole image."""
    figure, axes = plot.canvas(1, 2, 6, 3)
    plot.picture(axes[0, 0], np.zeros((20, 30, 3)), "whole")
    plot.picture(axes[0, 1], np.zeros((20, 30, 3)), "part", ((5, 10), (10, 25)))
    assert axes[0, 0].get_xlim() == (0, 30) and axes[0, 0].get_ylim() == (20, 0)
    assert axes[0, 1].get_xlim() == (10, 25) and axes[0, 1].get_ylim() == (10, 5)
    assert axes[0, 1].get_xlabel() == "x (pixels)" and axes[0, 1].get_title() == "part"


def test_weights_are_red_for_brdf_and_blue_for_light(tmp_path):
    """As in the thesis; and 1/2 is nearly white."""
    figure, axes = plot.canvas(1, 1, 4, 3)
    shown = plot.weights(axes[0, 0], np.array([[0.0, 0.5, 1.0]]))
    brdf, both, light = shown.cmap(shown.norm(np.array([0.0, 0.5, 1.0])))[:, :3]
    assert brdf[0] > 0.3 > max(brdf[1:]) and light[2] > 0.3 > light[0] and min(both) > 0.9


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


def test_shared_scale_ignores_spikes():
    """One pixel in a thousand does not darken all the others."""
    values = np.ones(10_000)
    values[0] = 1e9
    assert plot.shared_scale([values, values / 2]) == 1
