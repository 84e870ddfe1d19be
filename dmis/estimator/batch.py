"""Batches: camera samples that are shaded together, and the state that the estimator shares while it shades them."""

from __future__ import annotations

from dataclasses import dataclass

from dmis.estimator.allocation import CameraSamples
from dmis.estimator.mis import Combiner
from dmis.estimator.records import Records
from dmis.estimator.settings import Settings
from dmis.estimator.technique import Technique
from dmis.intersect import CountingCaster
from dmis.samplers.streams import Numbers
from dmis.scene.scene import Scene


@dataclass(eq=False)
class Batch:
    """N camera samples of one tile, and what shading them needs.

    Attributes
    ----------
    scene, caster
        The scene, and what answers and counts its ray queries.
    settings
        Estimator settings, without ``auto`` but for that of `lights`.
    techniques, combiner
        The K techniques that share the shading samples, and what weights them.
    samples
        The camera samples, and the division of their shading samples between the techniques.
    numbers
        Their random numbers.
    records
        Where shading samples are written down for statistics; None: nowhere.
    """

    scene: Scene
    caster: CountingCaster
    settings: Settings
    techniques: tuple[Technique, ...]
    combiner: Combiner
    samples: CameraSamples
    numbers: Numbers
    records: Records | None = None
