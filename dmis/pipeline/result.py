"""The result of a render, and writing it to a file."""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from functools import cached_property, partial
from pathlib import Path
from typing import Any

import numpy as np

from dmis import no_attribute
from dmis.base.vectors import Array
from dmis.fit.round import Round
from dmis.intersect import UNTRACED
from dmis.pipeline.job import Job
from dmis.pipeline.passes import Passes
from dmis.samplers.streams import is_sequence

COSTLY = 0.2
"""Least share of a pilot in the variance of an image that is worth a line in reports."""
CHANNELS = {"normal": ("N", "XYZ"), "position": ("P", "XYZ"), "uv": ("UV", "UV"), "depth": ("Z", "")}
"""Names and letters of layers in files, where they are not the layer's own with R, G and B."""


def write_image(path: str | os.PathLike[str], result: Result | Array, exposure: float = 1.0) -> None:
    """Write a rendered image: ``.exr`` with all layers, or ``.png`` for a look at it; or an array ``(H, W, 3)`` alone.

    `exposure` is a factor of the brightness of a PNG file.

    Raises
    ------
    ValueError
        If the extension is neither.
    OSError
        If the directory does not exist.
    """
    from dmis.image import write_exr, write_png

    image = result.image if isinstance(result, Result) else np.asarray(result)
    if Path(path).suffix.lower() == ".png":
        return write_png(path, image, exposure)
    if not isinstance(result, Result):
        return write_exr(path, {"RGB": image})
    variance = np.minimum(result.variance, np.finfo(np.float32).max)  # squares may be beyond what the file can hold
    layers = {"RGB": result.image, "weight": result.weight, "variance": variance, "samples": result.samples}
    layers |= {"light_samples": result.light_samples, "brdf_samples": result.brdf_samples}
    for name, values in result.layers.items():
        prefix, letters = CHANNELS.get(name, (name, ""))
        layers |= {f"{prefix}.{letter}": values[..., k] for k, letter in enumerate(letters)} or {prefix: values}
    provenance = dict(result.provenance)
    header: dict[str, Any] = {"dmis.provenance": json.dumps(provenance)}
    if "crop" in provenance:
        (left, top, right, bottom), (width, height) = provenance["crop"], provenance["frame"]
        header["dataWindow"] = (left, top), (right - 1, bottom - 1)
        header["displayWindow"] = (0, 0), (width - 1, height - 1)
    write_exr(path, layers, header)


@dataclass(frozen=True, eq=False)
class Result:
    """An image and how it came about.

    Attributes
    ----------
    image
        ``(H, W, 3)`` float32 linear RGB, row 0 on top.
    deviation
        ``(H, W, 3)`` float32: estimated standard deviation of `image` itself (of the mean, not of one sample); NaN at
        one sample. Its square is `variance`.
    deviation_of
        What `deviation` is estimated from. ``samples``: the variance of samples that are taken to be independent; it is
        too large where systematic rounding or a structured sampler spreads them. ``sub-blocks``: the spread of four
        parts of a sequence (`dmis.variance.moments.SubBlocks`), too large because four parts do not fill each other's
        gaps as one sequence does: of ``auto`` by a factor of 1.1 with 16 samples to 2.6 with 256, on ``cornell``.
    weight
        ``(H, W)`` float32: share of light samples in the final pass, or whichever technique is the first. Of the rules
        ``auto`` and ``counts``, share among all samples of the image. With ``weigh=heuristic``, the heuristic's share.
    light_share
        ``(H, W)`` float32: share of light samples; `weight`, unless that is the heuristic's.
    samples
        ``(H, W)`` float32: camera samples spent, pilot included, whether or not it is part of the image; a pilot's
        with twice the shading samples count for two. Of the rules ``auto`` and ``counts``, those of the image.
    shading_samples
        ``(H, W)`` float32: shading samples of each of the `samples`, on average.
    seconds
        ``pilot``, ``fit``, ``render`` (the final pass) and their sum ``total``; ``embree``: CPU seconds of the ray
        queries of all threads and processes, without tiles from a checkpoint; ``workers``: CPU seconds of the tiles of
        other processes.
    rays
        Rays traced, by kind: ``camera`` (one per camera sample, but for pixels that are known to see nothing),
        ``shadow`` (of light samples), ``brdf``, ``uniform``, ``resampled``, ``delta`` (towards lights of a single
        direction), ``specular`` (through mirrors and glass), ``bounce 1``, ``bounce 2``, ... (of paths that went on
        from so many surfaces); ``guide``, of the feature buffers that a rule's filter compares.
    maps
        Diagnostics of the rule. Those with one axis, what it decided for the image, are in the provenance, ``decided``.
    describe
        Makes `provenance`.
    layers
        Layers that were asked for, ``(H, W)`` or ``(H, W, C)`` float32, see `dmis.pipeline.image_layers`.
    """

    image: Array
    deviation: Array
    deviation_of: str
    weight: Array
    light_share: Array
    samples: Array
    shading_samples: Array
    seconds: Mapping[str, float]
    rays: Mapping[str, int]
    maps: Mapping[str, np.ndarray]
    describe: Callable[[], Mapping[str, Any]] = field(repr=False)
    layers: Mapping[str, Array] = field(default_factory=dict, repr=False)
    __getattr__ = no_attribute

    def __getstate__(self) -> dict[str, Any]:
        """Return what is pickled: the fields, with the provenance in the place of what makes it."""
        state = {f.name: getattr(self, f.name) for f in fields(self)}
        return {**state, "describe": partial(dict, self.provenance)}

    def __repr__(self) -> str:
        height, width = self.image.shape[:2]
        scene, rule, spp = (self.provenance.get(key, "unknown") for key in ("scene", "rule", "spp"))
        return f"Result({scene} {width}x{height}, rule {rule}, {spp} spp, {self.seconds.get('total', 0):.1f} s)"

    def _repr_png_(self) -> bytes:
        """Return `image` as a PNG file, which notebooks show: sRGB, exposure 1, clipped."""
        from dmis.image import png_of

        return png_of(self.image)

    @cached_property
    def provenance(self) -> Mapping[str, Any]:
        """Description from which the image can be made again; plain JSON data. It is made when it is first read.

        Its ``scene_hash`` is None if a part of the scene has no content to be hashed.
        """
        return self.describe()

    @property
    def variance(self) -> Array:
        """``(H, W, 3)`` float64: square of `deviation`, which may be beyond float32."""
        return np.square(self.deviation, dtype=np.float64)

    @property
    def light_samples(self) -> Array:
        """``(H, W)`` float32: samples of each light, or of the first technique, if all camera samples take them."""
        return self.samples * self.shading_samples * self.light_share

    @property
    def brdf_samples(self) -> Array:
        """``(H, W)`` float32: BRDF samples of each pixel, or those of all techniques but the first."""
        return self.samples * self.shading_samples * (1 - self.light_share)

    @property
    def fireflies(self) -> np.ndarray:
        """``(H, W)`` bool: pixels that look like fireflies, see `dmis.variance.fireflies.find_fireflies`."""
        from dmis.variance.fireflies import find_fireflies

        return find_fireflies(self.image, self.variance, self.samples)


def make_result(
    job: Job,
    final: Round,
    image: tuple[Array, Array],
    pilot_shares: Mapping[str, float],
    passes: Passes,
    total: float,
) -> Result:
    """Return the result of a job, whose last round was `final`.

    Parameters
    ----------
    image
        The image and its deviation.
    pilot_shares
        Shares of the image that a pilot has, for the provenance, see `dmis.variance.moments.pilot_shares`.
    passes
        The passes that rendered the rounds.
    total
        Seconds of all rounds and of the rule between them.
    """
    rays = {kind: number for kind, number in passes.rays.items() if kind != UNTRACED}
    pilot, rounds = passes.seconds["pilot"], sum(passes.seconds.values())
    seconds = {"pilot": pilot, "fit": total - rounds, "render": rounds - pilot, "total": total}
    shape, settings = image[0].shape[:2], final.settings
    if final.patterns is not None:
        samples, light, brdf = final.technique_samples()
        share, shading_samples = light / (light + brdf), (light + brdf) / samples
    else:
        earlier = job.spp - final.image_weight if final.before is None else final.begin
        samples = np.add(earlier, final.spp, dtype=np.float32)
        share, shading_samples = final.shares[0], np.full(shape, settings.shading_samples)
    # the provenance does without the tables of the scene and Embree's copy
    bare = job.given_scene.changed()
    described = replace(job, scene=bare, given_scene=bare, layers=dict)
    deviation_of = "sub-blocks" if is_sequence(settings.sampler) else "samples"
    of_image = {"combiner": settings.combiner, "rays": rays, "pilot_rays": dict(passes.pilot_rays)}
    of_image["deviation_of"] = deviation_of
    # what a rule decided for the whole image
    decided = {name: np.round(values, 3).tolist() for name, values in final.maps.items() if np.ndim(values) == 1}
    of_image |= {"decided": decided} if decided else {}
    return Result(
        image=image[0],
        deviation=image[1],
        deviation_of=deviation_of,
        weight=np.full(shape, share if final.tilt is None else final.tilt[0], np.float32),
        light_share=np.full(shape, share, np.float32),
        samples=np.full(shape, samples, np.float32),
        shading_samples=np.asarray(shading_samples, np.float32),
        seconds={**seconds, "embree": passes.embree_seconds, "workers": passes.worker_seconds},
        rays=rays,
        maps=final.maps,
        describe=lambda: {**described.provenance, **of_image, **pilot_shares},
        layers=job.layers(),
    )


def costly_pilot(provenance: Mapping[str, Any]) -> str:
    """Return a text if a pilot that is part of the image makes too much of its variance; else "".

    That is more than `COSTLY`, and than twice its share of the samples.
    """
    samples, variance = (provenance.get(key, 0) for key in ("pilot_samples", "pilot_variance"))
    if variance <= max(COSTLY, 2 * samples):
        return ""
    return (
        f"the pilot is {samples:.0%} of the image's samples and makes {variance:.0%} of its variance; leave it out "
        f"by reuse_pilot=False, or by an image_weight of 0 in its round"
    )


def average(results: Sequence[Result]) -> tuple[Array, Array]:
    """Return the mean of independent renders, such as of different seeds, and the unbiased variance of that mean.

    Of R images x_r with the mean m the variance is ``sum_r (x_r - m)^2 / (R (R - 1))``, whatever their points are, with
    R - 1 degrees of freedom in each pixel. R renders of n samples have a larger error than one of R n low-discrepancy
    points.

    Returns
    -------
    mean, variance
        ``(H, W, 3)`` float64 each.

    Raises
    ------
    ValueError
        If there are fewer than two results.
    """
    if not isinstance(results, Sequence) or len(results) < 2 or not all(isinstance(r, Result) for r in results):
        raise ValueError(f"results must be two renders or more, because a variance needs two; got {results!r}")
    images = np.array([result.image for result in results], np.float64)
    return images.mean(axis=0), images.var(axis=0, ddof=1) / len(results)
