"""Records of shading samples, and the protocol of statistics that are gathered from them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal, Protocol

from dmis.base.vectors import Array, Selection
from dmis.scene.shading_points import ShadingPoints

BLOCKS = 4
"""Sub-blocks of the camera samples of a pixel; a pixel of fewer samples has one for each."""
PIXEL_SUMS = ("closest hits", "occlusion rays", "squares")
"""Sums of a film whose statistic wants ``pixel_sums``: rays of the pixels, and their samples squared."""


@dataclass(frozen=True)
class Wants:
    """What a statistic wants to be sent, and how its sums are kept: its class attribute ``wants``.

    Parameters
    ----------
    records
        Whether it is sent records of the shading samples; without, their time is saved.
    directions
        Whether these have `Record.wi`, `Record.p` and `Record.surface`.
    pixel_sums
        Whether the film has `PIXEL_SUMS` beside the sums of the statistic.
    sums
        Over all pixels of each of the ``patches``; over those of each of four ``colours``
        (`dmis.base.patches.COLOURS`); or of each of the ``pixels`` (`dmis.base.patches.pixels_apart`).
    """

    records: bool = True
    directions: bool = False
    pixel_sums: bool = False
    sums: Literal["patches", "colours", "pixels"] = "patches"


_EARLIER = {"directions": "directions=True", "by_colour": 'sums="colours"', "by_pixel": 'sums="pixels"'}
"""Attributes of statistics that `Wants` replaced, and its arguments."""


def wants_of(statistic: Any) -> Wants:
    """Return what a statistic, or what makes it, wants; by default records alone.

    A ValueError if it says so as in earlier versions.
    """
    for name, argument in _EARLIER.items():
        if getattr(statistic, name, None) is True:
            raise ValueError(f"a statistic must have wants = dmis.Wants({argument}) in place of {name} = True")
    wants: Wants = getattr(statistic, "wants", Wants())
    return wants


@dataclass(frozen=True, eq=False)
class Record:
    """Shading samples of one technique whose directions meet a light.

    Attributes
    ----------
    technique_index
        k, number of the technique, 0 for the first.
    key
        Which light, in the last place, counted on for light that comes through a rough surface; before it, by way of
        which delta lobes, or in path tracing the number of surfaces before.
    sample_index
        Which of the camera sample's samples of this technique it is, from 0.
    sample
        Numbers of their camera samples, ``(N,)``, each at most once; None: all, in order.
    value
        What each would estimate alone, ``W f / (w_k p_k)``, with the throughput of its path, ``(3, N)``; 0 where
        something is in between.
    pdf
        Densities of all techniques in its direction, ``(K, N)``.
    wi, p
        Its direction, of unit length, and the point that it leaves, pushed off its surface, in the units of
        `dmis.scene.scene.Scene.in_float32`; ``(3, N)`` each. None if no statistic asks for ``directions``.
    surface
        The surface points that it leaves; None as before.
    """

    technique_index: int
    key: tuple[int, ...]
    sample_index: int
    sample: Selection | None
    value: Array
    pdf: Array
    wi: Array | None = None
    p: Array | None = None
    surface: ShadingPoints | None = None


@dataclass(eq=False)
class Records(list[Record]):
    """The records of one batch; `directions` says whether they have `Record.wi` and `Record.p`."""

    directions: bool = False


class Statistic(Protocol):
    """Sums over the shading samples of a tile; made with its number of pixels and of shading samples.

    `dmis.variance.curves.Curves` is one. A class attribute ``wants`` says what else it needs, see `Wants`.
    """

    def add(self, records: Sequence[Record], radiance: Array, count: int) -> None:
        """Add one batch: `count` camera samples of every pixel, sample-major, their radiance ``(3, N)``."""
        ...

    def sums(self) -> Mapping[str, Array]:
        """Return the sums by name, pixels in the last axis; the tile adds them up over patches."""
        ...
