"""Parameters of lobes that differ from point to point: colours and scalars, as tables or textures."""

from __future__ import annotations

from typing import ClassVar, Protocol, runtime_checkable


@runtime_checkable
class Parameters(Protocol):
    """A frozen dataclass, a lobe or what is nested in one, some of whose fields differ from point to point.

    Attributes
    ----------
    colours
        Fields that are numbers, RGB triples or images; bound to N points ``(1 or 3, N)`` or ``(1 or 3, 1)``.
    scalars
        Fields that are numbers or images; bound to points ``(N,)`` or one number.
    anisotropic
        Whether tangents are needed.

    Fields that hold `Parameters` are bound, too. Other fields are the same for all points of a batch, and hashable:
    surfaces that differ in one of them are batches of their own.
    """

    colours: ClassVar[tuple[str, ...]] = ()
    scalars: ClassVar[tuple[str, ...]] = ()
    anisotropic: ClassVar[bool] = False
