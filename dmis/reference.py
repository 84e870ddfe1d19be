"""References: what an image converges to, as two independent halves, kept on disk.

``mean[(x - r1)(x - r2)]`` has the expectation of the squared error against the exact image, free of the reference's own
noise (`dmis.metrics.mse`), because the errors of the halves are independent of each other and of x.
"""

from __future__ import annotations

import json
import os
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from dmis import __version__
from dmis.checks import whole
from dmis.image import read_exr, write_exr
from dmis.passes import Progress
from dmis.render import MOST_SPP, fingerprint, render
from dmis.scene import Scene
from dmis.settings import Settings
from dmis.vec import Array

SEED = 2**31
"""Seeds of references begin here, far from those that anyone gives to a render."""


@dataclass(frozen=True, eq=False)
class Reference:
    """Two independent images of the same scene.

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
        """The average of the halves, ``(H, W, 3)`` float64: the best image there is."""
        return (self.first.astype(np.float64) + self.second) / 2

    @property
    def mse(self) -> float:
        """Mean squared error of `mean`: a quarter of the mean squared difference of the halves."""
        return float(((self.first.astype(np.float64) - self.second) ** 2).mean() / 4)


def make_reference(
    scene: Scene,
    spp: int = 2048,
    *,
    rule: str = "balance",
    settings: Settings | None = None,
    folder: str | os.PathLike[str] | None = None,
    threads: int | None = None,
    progress: Progress | None = None,
) -> Reference:
    """The reference of `scene`: rendered once with Sobol samples, read from disk afterwards.

    Parameters
    ----------
    spp
        Camera samples per pixel of each half.
    rule
        What renders it; every rule converges to the same image.
    settings
        Such as the integrator, see `dmis.render.render`.
    folder
        Where it is kept. Default: ``DMIS_CACHE``, or ``dmis`` in the user's cache folder.
    threads, progress
        See `dmis.render.render`. An interrupted half goes on where it stopped.

    Raises
    ------
    ValueError
        If an argument is out of range, or another process is rendering the same reference.
    OSError
        If it cannot be written.
    """
    spp = whole("spp", spp, 1, MOST_SPP)
    width, height = scene.camera.resolution
    key = json.dumps([__version__, fingerprint(scene), width, height, spp, rule, *described(settings)])
    import hashlib  # imported where used: it brings OpenSSL

    digest = hashlib.sha256(key.encode()).hexdigest()[:12]
    path = cache_folder(folder) / f"{scene.name}-{width}x{height}-{spp}spp-{digest}.exr"
    if not path.exists():
        path.parent.mkdir(parents=True, exist_ok=True)
        halves = [
            render(
                scene,
                rule,
                spp,
                seed=SEED + k,
                sampler="sobol",
                settings=settings,
                threads=threads,
                progress=progress,
                checkpoint=path.with_suffix(f".{k}.checkpoint"),
            ).image
            for k in range(2)
        ]
        write_exr(path, {"first": halves[0], "second": halves[1]}, {"spp": str(spp)})
    layers, _ = read_exr(path)
    return Reference(layers["first"], layers["second"], spp)


def described(settings: Settings | None) -> list[dict[str, Any]]:
    """Settings as a part of the key that names a file; nothing if they are the default. There is no pilot to reuse."""
    asked = replace(settings or Settings(), reuse_pilot=None)
    return [] if asked == Settings() else [asdict(asked)]


def cache_folder(folder: str | os.PathLike[str] | None = None) -> Path:
    """`folder` if given, or ``DMIS_CACHE``, or ``dmis`` in the user's cache folder."""
    home = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    return Path(folder or os.environ.get("DMIS_CACHE") or Path(home) / "dmis")
