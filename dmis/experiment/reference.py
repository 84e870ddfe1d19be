"""References: converged images as two independent halves, cached on disk.

They are rendered with the rule ``balance`` and Sobol points: a rule that learns may miss the same rare bright samples
in its renders and in its reference.

``mean[(x - r1)(x - r2)]`` has the expectation of the squared error against the exact image, free of the reference's own
noise (`dmis.experiment.metrics.mse`), because the errors of the halves are independent of each other and of x.
"""

from __future__ import annotations

import json
import os
import re
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from dmis.base.validate import whole
from dmis.base.vectors import Array
from dmis.estimator.settings import Settings, make_settings
from dmis.fit.rule import Rule, merge_settings
from dmis.image import check_image, read_exr, write_exr
from dmis.pipeline.checkpoint import UnusableCheckpoint, remove_checkpoint
from dmis.pipeline.executor import Parallel
from dmis.pipeline.fingerprint import fingerprint
from dmis.pipeline.job import MAX_SPP
from dmis.pipeline.progress import Progress, reporting
from dmis.pipeline.render import render
from dmis.pipeline.result import Result
from dmis.scene.scene import Scene

REFERENCE_SEED = 2**31
"""First seed of references and oracles, far from the seeds of renders."""
KEY = "dmis.key"
"""Attribute of a reference's file: what its image depends on, as JSON."""


@dataclass(frozen=True, eq=False)
class Reference:
    """Converged image of a scene, as two independent halves.

    Attributes
    ----------
    first, second
        ``(H, W, 3)`` float32 linear RGB.
    spp
        Camera samples per pixel of each half.
    """

    first: Array
    second: Array
    spp: int

    @property
    def mean(self) -> Array:
        """Mean of the halves, ``(H, W, 3)`` float64."""
        return (self.first.astype(np.float64) + self.second) / 2

    @property
    def mse(self) -> float:
        """Mean squared error of `mean`, which it adds to that of an image measured against it.

        That is a quarter of the mean squared difference of the halves; 0 for one image given as both.
        """
        return float(((self.first.astype(np.float64) - self.second) ** 2).mean() / 4)

    def cropped(self, area: tuple[slice, slice]) -> Reference:
        """Return the reference of an area of the image, rows and columns."""
        return Reference(self.first[area], self.second[area], self.spp)

    def save(self, path: str | os.PathLike[str], attributes: Mapping[str, str] | None = None) -> None:
        """Write both halves as layers ``first`` and ``second`` of an EXR file, which `load_reference` reads."""
        about = {"spp": str(self.spp), **(attributes or {})}
        write_exr(path, {"first": self.first, "second": self.second}, about)

    def text(self) -> str:
        """Return a line with the samples and the standard error of the reference."""
        if self.mse == 0:
            return "Reference: one image, or two equal ones, whose standard error is not known."
        samples = f" of 2 x {self.spp} samples per pixel" if self.spp else ""
        return (
            f"Reference{samples}: standard error {np.sqrt(self.mse):.2g}, mean squared error {self.mse:.2g} "
            f"(by its two halves)."
        )


def make_reference(
    scene: Scene,
    spp: int = 2048,
    *,
    settings: Settings | None = None,
    folder: str | os.PathLike[str] | None = None,
    parallel: Parallel = None,
    progress: Progress | bool | None = None,
    **options: Any,
) -> Reference:
    """Return the reference of `scene`, rendered with Sobol points at the first call and read from the cache later.

    Parameters
    ----------
    spp
        Camera samples per pixel of each half.
    settings, options
        See `dmis.pipeline.render.render`. Of these only ``integrator`` and ``max_depth`` count, because the expected
        image does not depend on the others: a reference of any preset, techniques or combiner is the same.
    folder
        Folder of the cache. Default: ``DMIS_CACHE``, or ``dmis`` in the user's cache folder.
    parallel, progress
        See `dmis.pipeline.render.render`. An interrupted half is resumed.
    """
    spp = whole("spp", spp, 1, MAX_SPP)
    given = make_settings(settings, **options)
    settings = Settings(integrator=given.integrator, max_depth=given.max_depth)
    key = {**expected_image_key(scene, settings), "spp": spp, "rule": "balance"}
    path = cache_path(scene, f"{spp}spp", key, folder, ".exr")
    reference = from_cache(path, load_reference, "reference")
    if reference is None:
        path.parent.mkdir(parents=True, exist_ok=True)
        check_image(path)
        more = {"settings": settings, "sampler": "sobol", "parallel": parallel, "progress": progress}
        with render_halves(path, scene, "balance", spp, REFERENCE_SEED, **more) as (first, second):
            reference = Reference(first.image, second.image, spp)
            reference.save(path, {KEY: json.dumps(key)})
    return reference


def expected_image_key(scene: Scene, settings: Settings) -> dict[str, Any]:
    """Return what the expected image of a scene depends on, as a part of keys."""
    resolved = merge_settings(settings, scene)[0]
    about = {"scene": fingerprint(scene, expected_image=True), "resolution": list(scene.camera.resolution)}
    return {**about, "integrator": resolved.integrator, "max_depth": resolved.max_depth}


@contextmanager
def render_halves(
    path: Path, scene: Scene, rule: Rule | str, spp: int, seed: int, **options: Any
) -> Iterator[list[Result]]:
    """Render and yield the two halves that a file of the cache is made of, which the block writes.

    Interrupted halves are resumed: checkpoints lie beside the file `path`, until it is written. One that another
    version of dmis has left there, or a damaged one, is discarded: nothing else writes into the cache. Other arguments
    are those of `dmis.pipeline.render.render`; `seed` is that of the first half, and the second has the next one.
    """
    results, checkpoints = [], [path.with_suffix(f".{half}.tiles") for half in range(2)]
    with reporting(options.pop("progress", None)) as report:
        for half, checkpoint in enumerate(checkpoints):
            if report is not None:  # of both halves
                options["progress"] = lambda stage, n, of, k=half: report(stage, k * of + n, 2 * of)
            render_half = partial(render, scene, rule, spp, seed=seed + half, checkpoint=checkpoint, **options)
            try:
                results.append(render_half())
            except UnusableCheckpoint:
                remove_checkpoint(checkpoint)
                results.append(render_half())
    yield results
    for checkpoint in checkpoints:
        remove_checkpoint(checkpoint)


def cache_path(
    scene: Scene, kind: str, key: Mapping[str, Any], folder: str | os.PathLike[str] | None, suffix: str
) -> Path:
    """Return the path of a file of the cache. Of the scene's name at most 64 letters, digits, dots and dashes are kept.

    Parameters
    ----------
    kind
        Part of the name that says what the file is, for people.
    key
        All that the content depends on, as JSON data; its hash tells files apart.
    folder, suffix
        See `cache_folder`; the extension, with its dot.
    """
    import hashlib  # imported where used: it brings OpenSSL

    width, height = scene.camera.resolution
    digest = hashlib.sha256(json.dumps(key).encode()).hexdigest()[:12]
    name = re.sub(r"[^A-Za-z0-9._-]+", "-", scene.name).lstrip(".-")[:64] or "scene"
    return cache_folder(folder) / f"{name}-{width}x{height}-{kind}-{digest}{suffix}"


def from_cache(path: Path, read: Callable[[Path], Any], kind: str) -> Any:
    """Return the content of a file of the cache by the function `read`, or None if there is none.

    A ValueError if the file, of a `kind` such as "oracle", is damaged.
    """
    if not path.exists():
        return None
    try:
        return read(path)
    except Exception as error:  # a damaged archive may raise anything
        raise ValueError(f"{kind} {path} is damaged ({error}); remove it, and it is rendered again") from error


def cache_folder(folder: str | os.PathLike[str] | None = None) -> Path:
    """Return `folder` if given, or ``DMIS_CACHE``, or ``dmis`` in the user's cache folder."""
    home = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    return Path(folder or os.environ.get("DMIS_CACHE") or Path(home) / "dmis")


def load_reference(path: Path, scene: Scene | None = None, settings: Settings | None = None) -> Reference:
    """Return the reference in an EXR file, with layers ``first`` and ``second`` or with one image.

    A FileNotFoundError if there is no such file, a ValueError if it holds no image of three finite channels, or its key
    is not that of `scene` with `settings`. Whether a file without a key is an image of what is compared,
    `dmis.experiment.alarm` finds out.
    """
    if not path.is_file():
        raise FileNotFoundError(f"there is no reference {path}: give an .exr file")
    layers, attributes = read_exr(path)
    if scene is not None and KEY in attributes:
        key = json.loads(attributes[KEY])
        expected = expected_image_key(scene, settings or Settings())
        if changes := [f"{name} is {key.get(name)}, not {v}" for name, v in expected.items() if key.get(name) != v]:
            advice = f"Give a reference of scene {scene.name}, or none, and it is rendered"
            raise ValueError(f"reference {path} does not match: {'; '.join(changes)}. {advice}")
    first = layers.get("first", layers.get("RGB"))
    second = layers.get("second", first)
    for half in (first, second):
        if half is None or half.shape[2:] != (3,) or half.dtype.kind != "f" or not np.isfinite(half).all():
            what = "an image of three channels, or halves first and second, of finite numbers"
            raise ValueError(f"reference {path} must hold {what}")
    assert first is not None and second is not None
    return Reference(first, second, int(attributes.get("spp", 0)))
