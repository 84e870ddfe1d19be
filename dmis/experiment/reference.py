"""References: converged images as two independent halves, cached on disk.

They are rendered with the rule ``auto`` and Sobol points, whose error per second is the least.

``mean[(x - r1)(x - r2)]`` has the expectation of the squared error against the exact image, free of the reference's own
noise (`dmis.experiment.metrics.mse`), because the errors of the halves are independent of each other and of x.
"""

from __future__ import annotations

import json
import os
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from dmis.base.validate import whole
from dmis.base.vectors import Array
from dmis.estimator.settings import Settings, make_settings
from dmis.fit.rule import Rule
from dmis.image import check_image, read_exr, write_exr
from dmis.pipeline.checkpoint import UnusableCheckpoint, remove_checkpoint
from dmis.pipeline.executor import Parallel
from dmis.pipeline.fingerprint import fingerprint
from dmis.pipeline.job import MAX_SPP
from dmis.pipeline.progress import Progress
from dmis.pipeline.render import render
from dmis.pipeline.result import Result
from dmis.scene.scene import Scene

REFERENCE_SEED = 2**31
"""First seed of references and oracles, far from the seeds of renders."""


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

    @property
    def standard_error(self) -> float:
        """Standard error of `mean`: root of `mse`, in the unit of the image."""
        return float(np.sqrt(self.mse))

    def text(self) -> str:
        """Return a line with the samples and the standard error of the reference."""
        if self.mse == 0:
            return "Reference: one image, or two equal ones, whose standard error is not known."
        samples = f" of 2 x {self.spp} samples per pixel" if self.spp else ""
        return (
            f"Reference{samples}: standard error {self.standard_error:.2g}, mean squared error {self.mse:.2g} "
            f"(by its two halves)."
        )


def make_reference(
    scene: Scene,
    spp: int = 2048,
    *,
    rule: str = "auto",
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
    rule
        Rule that renders it; every rule converges to the same image.
    settings, options
        See `dmis.pipeline.render.render`. Of these only ``integrator`` and ``max_depth`` count, because the expected
        image does not depend on the others: a reference of any preset, techniques or combiner is the same.
    folder
        Folder of the cache. Default: ``DMIS_CACHE``, or ``dmis`` in the user's cache folder.
    parallel, progress
        See `dmis.pipeline.render.render`. An interrupted half is resumed, see `render_half`.

    Raises
    ------
    ValueError
        If an argument is out of range.
    OSError
        If it cannot be written.
    """
    spp = whole("spp", spp, 1, MAX_SPP)
    given = make_settings(settings, **options)
    settings = Settings(integrator=given.integrator, max_depth=given.max_depth)
    width, height = scene.camera.resolution
    key = json.dumps([fingerprint(scene, expected_image=True), width, height, spp, rule, *settings_key(settings)])
    import hashlib  # imported where used: it brings OpenSSL

    digest = hashlib.sha256(key.encode()).hexdigest()[:12]
    path = cache_folder(folder) / f"{scene.name}-{width}x{height}-{spp}spp-{digest}.exr"
    if not path.exists():
        path.parent.mkdir(parents=True, exist_ok=True)
        check_image(path)
        halves = [
            render_half(
                path, k, scene, rule, spp, seed=REFERENCE_SEED + k, settings=settings, sampler="sobol",
                parallel=parallel, progress=progress,
            ).image
            for k in range(2)
        ]  # fmt: skip
        write_exr(path, {"first": halves[0], "second": halves[1]}, {"spp": str(spp)})
        remove_halves(path)
    layers, _ = read_exr(path)
    return Reference(layers["first"], layers["second"], spp)


def render_half(path: Path, half: int, scene: Scene, rule: Rule | str, spp: int, **options: Any) -> Result:
    """Render one of two halves that a file of the cache is made of; an interrupted one is resumed.

    Its checkpoint lies beside the file, until `remove_halves` removes it. One that another version of dmis has left
    there, or a damaged one, is discarded: nothing else writes into the cache.

    Parameters
    ----------
    path, half
        File of the cache; 0 or 1.
    scene, rule, spp, options
        See `dmis.pipeline.render.render`.
    """
    checkpoint = _checkpoint(path, half)
    try:
        return render(scene, rule, spp, checkpoint=checkpoint, **options)
    except UnusableCheckpoint:
        remove_checkpoint(checkpoint)
        return render(scene, rule, spp, checkpoint=checkpoint, **options)


def remove_halves(path: Path) -> None:
    """Remove the checkpoints of both halves of a file of the cache, because it is written."""
    for half in range(2):
        remove_checkpoint(_checkpoint(path, half))


def _checkpoint(path: Path, half: int) -> Path:
    return path.with_suffix(f".{half}.tiles")


def settings_key(settings: Settings | None) -> list[dict[str, Any]]:
    """Return settings as a part of the key of a cached file; empty for the default settings.

    The sampler, `reuse_pilot`, `replicates` and the name of a preset do not change what is cached; a compensation that
    is None is left out.
    """
    default = Settings()
    relevant = replace(
        settings or default, preset=None, reuse_pilot=None, sampler=default.sampler, replicates=default.replicates
    )
    key = {**asdict(relevant), "sampler": "independent"}  # a constant, the one in the keys of files that exist
    del key["preset"], key["replicates"]
    if relevant.compensation is None:
        del key["compensation"]
    return [] if relevant == default else [key]


def cache_folder(folder: str | os.PathLike[str] | None = None) -> Path:
    """Return `folder` if given, or ``DMIS_CACHE``, or ``dmis`` in the user's cache folder."""
    home = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    return Path(folder or os.environ.get("DMIS_CACHE") or Path(home) / "dmis")
