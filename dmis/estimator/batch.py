"""Batches: camera samples that are shaded together, and the state that the estimator shares while it shades them."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field

import numpy as np

from dmis.estimator.allocation import CameraSamples
from dmis.estimator.records import Record
from dmis.estimator.settings import Settings
from dmis.estimator.technique import Technique
from dmis.intersect import RayCaster
from dmis.samplers.streams import Numbers
from dmis.scene.scene import Scene


@dataclass(eq=False)
class Log:
    """What is written down of the camera samples of a tile.

    Attributes
    ----------
    rays
        Rays traced so far, by kind.
    colour_of_pixel
        Colour of each pixel of the tile, ``(P,)``, by which rays are counted as well; None: they are not.
    records
        Shading samples of one batch, for statistics; None: none is written down.
    """

    rays: Counter[str] = field(default_factory=Counter)
    colour_of_pixel: np.ndarray | None = None
    records: list[Record] | None = None


@dataclass(eq=False)
class Batch:
    """N camera samples of one tile, and what shading them needs.

    Attributes
    ----------
    scene, caster
        The scene, and what answers its ray queries.
    settings
        Estimator settings, without ``auto``.
    techniques
        The K techniques that share the shading samples.
    samples
        The camera samples, and the division of their shading samples between the techniques.
    numbers
        Their random numbers.
    log
        What is written down of them.
    """

    scene: Scene
    caster: RayCaster
    settings: Settings
    techniques: tuple[Technique, ...]
    samples: CameraSamples
    numbers: Numbers
    log: Log = field(default_factory=Log)
