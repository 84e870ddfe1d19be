"""The directives of pbrt files that change the current transform, as a table: phase, function, arguments."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from dmis.base.vectors import Floats
from dmis.formats.pbrt.reader import MATRIX, Directive, Reader
from dmis.formats.pbrt.tokens import Token, blame
from dmis.geometry import transforms


def set_transform(reader: Reader, matrix: Floats) -> None:
    """Make `matrix` (4, 4) the current transform."""
    if not np.isfinite(matrix).all() or np.linalg.cond(matrix[:3, :3]) > 1e12:
        raise reader.token.error(f"the current transform must be invertible and finite; it becomes {matrix.tolist()}")
    if not np.allclose(matrix[3], [0, 0, 0, 1], rtol=0, atol=1e-9):
        raise reader.token.error(f"a transform must be affine, with last row 0 0 0 1; it has {matrix[3].tolist()}")
    matrix[3] = 0, 0, 0, 1
    reader.change(to_world=matrix)


def _concatenated(make: Callable[[Floats], Floats]) -> Callable[[Reader, Floats], None]:
    """Return the directive that multiplies the current transform by a matrix made of its numbers."""

    def run(reader: Reader, numbers: Floats) -> None:
        with blame(reader.token):
            set_transform(reader, reader.state.to_world @ make(numbers))

    return run


def _name_system(reader: Reader, name: Token) -> None:
    reader.systems[name.name] = reader.state.to_world


def _return_to_system(reader: Reader, name: Token) -> None:
    reader.change(to_world=name.find("coordinate system", name.name, reader.systems))


TRANSFORMS: dict[str, Directive] = {
    "Identity": ("any", lambda reader: set_transform(reader, np.eye(4)), ()),
    "Translate": ("any", _concatenated(transforms.translate), (3,)),
    "Scale": ("any", _concatenated(transforms.scale), (3,)),
    "Rotate": ("any", _concatenated(lambda numbers: transforms.rotate(numbers[0], numbers[1:])), (4,)),
    "LookAt": ("any", _concatenated(lambda numbers: transforms.look_at(*numbers.reshape(3, 3))), (9,)),
    "Transform": ("any", lambda reader, matrix: set_transform(reader, matrix.copy()), (MATRIX,)),
    "ConcatTransform": ("any", _concatenated(lambda matrix: matrix), (MATRIX,)),
    "CoordinateSystem": ("any", _name_system, ("a name",)),
    "CoordSysTransform": ("any", _return_to_system, ("a name",)),
}
"""Directives by name."""
