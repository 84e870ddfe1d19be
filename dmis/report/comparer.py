"""The image comparer of reports, of notebooks, and of the page that `dmis.show` makes.

The template ``show.html`` beside this module is its page; ``comparer.html``, ``.css`` and ``.js`` have its elements,
style and script.
"""

from __future__ import annotations

import base64
import html
import os
from collections.abc import Mapping, Sequence

import numpy as np

from dmis.base.vectors import Array
from dmis.experiment.reference import Reference
from dmis.image import encode_png
from dmis.pipeline.result import Result
from dmis.report.templates import filled, write_page

FIRST_HEIGHT = 700
"""Height of a comparer in a notebook before its script has measured it, CSS pixels."""


class Comparer:
    """Images side by side in a page that needs no network, made by `show`.

    A notebook shows it as a cell's result; `save` writes it as a file for a browser.

    Attributes
    ----------
    page
        The whole page, HTML.
    """

    def __init__(self, page: str) -> None:
        self.page = page

    def __repr__(self) -> str:
        return "<Comparer: a notebook shows it, .save(path) writes it for a browser>"

    def _repr_html_(self) -> str:
        """Return the page in a frame, which keeps its style and its script apart from the notebook's."""
        frame = f'style="width:100%;height:{FIRST_HEIGHT}px;border:0" title="image comparer"'
        return f'<iframe {frame} srcdoc="{html.escape(self.page)}"></iframe>'

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the page to `path`, which replaces a file that is there; its folder is made."""
        write_page(path, self.page)


def show(
    images: Mapping[str, Array | Result], reference: Array | Reference | None = None, title: str = "Images"
) -> Comparer:
    """Return a comparer of images: flip, split, zoom, magnify, expose, and crops of one place in all of them.

    In a notebook, ``dmis.show({"balance": a, "thesis": b})`` as the last line of a cell shows it.

    Parameters
    ----------
    images
        By label: linear radiance ``(H, W, 3)``, or one value per pixel ``(H, W)``, or a `dmis.Result`; of one size.
    reference
        What the images should be, of the same size; shown first, and errors are measured against it.
    title
        Of the page.

    Raises
    ------
    ImportError
        If Jinja2 (extra ``plot``) is missing, or matplotlib, which has the colours of errors from a `reference`.
    """
    if not isinstance(images, Mapping) or not images:
        raise TypeError(
            f"images must be a dict of labels and at least one image; got {type(images).__name__}. "
            'Write dmis.show({"balance": image}).'
        )
    first = {} if reference is None else {"reference": reference}
    if first and "reference" in images:
        raise ValueError("label 'reference' is reserved for the reference; an image has it, too. Rename the image.")
    pictures = {str(label): _linear(str(label), image) for label, image in {**first, **images}.items()}
    if len({image.shape for image in pictures.values()}) > 1:
        given = ", ".join(f"{label} {image.shape[1]}×{image.shape[0]}" for label, image in pictures.items())
        raise ValueError(f"images must have one size, got {given}. Render them at one resolution.")
    data = comparer_data([viewer_data(title, pictures, bool(first))])
    return Comparer(filled("show.html", title=title, data=data))


def _linear(label: str, image: Array | Result | Reference) -> Array:
    """Return an image as linear RGB ``(H, W, 3)``."""
    given = image.image if isinstance(image, Result) else image.mean if isinstance(image, Reference) else image
    pixels = np.asarray(given)
    if pixels.ndim == 2:
        pixels = np.repeat(pixels[..., None], 3, axis=2)
    if pixels.dtype.kind not in "fiub" or pixels.ndim != 3 or pixels.shape[2] != 3 or not pixels.size:
        got = f"{type(image).__name__} of shape {pixels.shape}"
        raise ValueError(f"image {label!r} must be numbers (H, W, 3) or (H, W), or a dmis.Result; got {got}")
    return pixels.astype(np.float32)


def viewer_data(scene: str, images: Mapping[str, Array], reference: bool = True) -> dict[str, object]:
    """Return the data of one comparer: its images, the first a `reference` or not, and the scale of errors.

    Errors have one scale for all images: the largest colour is the 98 % quantile of the second image's errors.
    """
    scale, (first, *others) = 1.0, images.values()
    if reference and others:
        errors = np.sqrt(((others[0] - first) ** 2).mean(axis=2))  # as the script computes them
        scale = float(np.nan_to_num(np.quantile(errors, 0.98))) or 1.0
    return {
        "scene": scene,
        "width": first.shape[1],
        "height": first.shape[0],
        "scale": scale,
        "reference": reference,
        "images": [{"label": label, "png": linear_png(image)} for label, image in images.items()],
    }


def png(pixels: Array) -> str:
    """Return an image ``(H, W, 3)`` or ``(H, W)`` uint8 as a PNG in a data URI."""
    return "data:image/png;base64," + base64.b64encode(encode_png(pixels)).decode("ascii")


def linear_png(image: Array) -> str:
    """Return linear RGB ``(H, W, 3)`` as a PNG of its half floats, in a data URI.

    The PNG has twice the height: high bytes above, low bytes below.
    """
    bits = np.clip(np.nan_to_num(image), -65504, 65504).astype(np.float16).view(np.uint16)
    return png(np.concatenate([bits >> 8, bits & 255]).astype(np.uint8))


def comparer_data(scenes: Sequence[Mapping[str, object]]) -> dict[str, object]:
    """Return what the script of a page with comparers reads: `viewer_data` of each, and the colours of errors."""
    colours: list[str] = []
    if any(scene["reference"] for scene in scenes):
        from dmis import plot  # imported where used: it brings matplotlib

        colours = plot.palette("magma")
    return {"scenes": scenes, "palette": colours}
