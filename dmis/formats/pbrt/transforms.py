"""The directives of pbrt files that change the current transform."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from dmis.base.vectors import Floats
from dmis.formats.pbrt.cursor import Cursor
from dmis.formats.pbrt.reader import Directive, Reader
from dmis.formats.pbrt.tokens import Token, blame
from dmis.geometry import transforms


def set_transform(reader: Reader, token: Token, matrix: Floats) -> None:
    """Make `matrix` the current transform."""
    linear = matrix[:3, :3]
    if not np.isfinite(matrix).all() or np.linalg.cond(linear) > 1e12:
        raise token.error(f"the current transform must be invertible and finite; it becomes {matrix.tolist()}")
    if not np.allclose(matrix[3], [0, 0, 0, 1], rtol=0, atol=1e-9):
        raise token.error(f"a transform must be affine, with last row 0 0 0 1; it has {matrix[3].tolist()}")
    matrix[3] = 0, 0, 0, 1
    reader.state = replace(reader.state, to_world=matrix)


def _identity(reader: Reader, token: Token, cursor: Cursor) -> None:
    set_transform(reader, token, np.eye(4))


def _translate(reader: Reader, token: Token, cursor: Cursor) -> None:
    set_transform(reader, token, reader.state.to_world @ transforms.translate(cursor.numbers(token, 3)))


def _scale(reader: Reader, token: Token, cursor: Cursor) -> None:
    set_transform(reader, token, reader.state.to_world @ transforms.scale(cursor.numbers(token, 3)))


def _rotate(reader: Reader, token: Token, cursor: Cursor) -> None:
    degrees, *axis = cursor.numbers(token, 4)
    with blame(token):
        set_transform(reader, token, reader.state.to_world @ transforms.rotate(degrees, axis))


def _look_at(reader: Reader, token: Token, cursor: Cursor) -> None:
    eye, at, up = cursor.numbers(token, 9).reshape(3, 3)
    with blame(token):
        set_transform(reader, token, reader.state.to_world @ transforms.look_at(eye, at, up))


def _transform(reader: Reader, token: Token, cursor: Cursor) -> None:
    set_transform(reader, token, cursor.matrix(token).copy())


def _concat_transform(reader: Reader, token: Token, cursor: Cursor) -> None:
    set_transform(reader, token, reader.state.to_world @ cursor.matrix(token))


def _coordinate_system(reader: Reader, token: Token, cursor: Cursor) -> None:
    reader.systems[cursor.string(token, "a name").name] = reader.state.to_world


def _coord_sys_transform(reader: Reader, token: Token, cursor: Cursor) -> None:
    name = cursor.string(token, "a name")
    if name.name not in reader.systems:
        names = ", ".join(map(repr, reader.systems)) or "none yet"
        raise name.error(f"there is no coordinate system of this name; there are: {names}")
    reader.state = replace(reader.state, to_world=reader.systems[name.name])


def _active_transform(reader: Reader, token: Token, cursor: Cursor) -> None:
    which = cursor.next()
    if which.text != "All":
        raise which.error("ActiveTransform must be All, because motion is not supported; remove the line")


def _transform_times(reader: Reader, token: Token, cursor: Cursor) -> None:
    cursor.numbers(token, 2)
    reader.skip(token)


TRANSFORMS: dict[str, tuple[str, Directive]] = {
    "Identity": ("any", _identity),
    "Translate": ("any", _translate),
    "Scale": ("any", _scale),
    "Rotate": ("any", _rotate),
    "LookAt": ("any", _look_at),
    "Transform": ("any", _transform),
    "ConcatTransform": ("any", _concat_transform),
    "CoordinateSystem": ("any", _coordinate_system),
    "CoordSysTransform": ("any", _coord_sys_transform),
    "ActiveTransform": ("any", _active_transform),
    "TransformTimes": ("options", _transform_times),
}
