"""Batches of camera samples, of the vertices of their paths, and of the shading samples that are taken there."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dmis.base.vectors import Array, Selection
from dmis.estimator.allocation import CameraSamples
from dmis.estimator.mis import Combiner, Technique
from dmis.estimator.records import Records
from dmis.estimator.settings import Settings
from dmis.intersect import CountingCaster
from dmis.light.light_sample import LightSample
from dmis.samplers.streams import Numbers
from dmis.scene.scene import Scene
from dmis.scene.shading_points import ShadingPoints


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


@dataclass(eq=False)
class Vertices:
    """Path vertices: N surface points of one group, and the radiance that each reflects.

    Attributes
    ----------
    sample
        Camera sample numbers, ``(N,)``; None: all, in order.
    throughput
        Of their paths up to the vertex, ``(3, N)``; None: 1.
    path
        Delta lobes that led here, or in path tracing the number of vertices before: keys of random numbers.
    radiance
        Radiance reflected or emitted towards the vertex before, ``(3, N)``, added to.
    scattered
        Whether a lobe other than a delta lobe sent the path here, ``(N,)`` bool, or one for all.
    """

    surface: ShadingPoints
    sample: Selection | None
    throughput: Array | None
    path: tuple[int, ...]
    radiance: Array
    scattered: np.ndarray | bool = False


@dataclass(eq=False)
class Samples:
    """Shading samples: N directions that one technique picked, towards one light.

    Attributes
    ----------
    technique_index
        k, number of the technique, from 0.
    sample_index
        Which of the camera sample's samples of this technique it is, from 0; of merged ones, that of the first.
    key
        Which light and which path, see `dmis.estimator.records.Record`.
    vertex
        The vertices that they belong to, in `Vertices`; a vertex may have several.
    surface
        Those vertices' surface points.
    light_sample
        Directions, and what they see of the light.
    shares
        Shares w_k of the techniques, as in `dmis.estimator.allocation.CameraSamples`.
    tilt
        Shares of the heuristic, as in `dmis.estimator.allocation.CameraSamples`.
    """

    technique_index: int
    sample_index: int
    key: tuple[int, ...]
    vertex: Selection | None
    surface: ShadingPoints
    light_sample: LightSample
    shares: Array
    tilt: Array | None
