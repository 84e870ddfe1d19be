"""Reader of Wavefront OBJ text: rewrites lines that trimesh misreads, and finds the triangles that it should read.

trimesh 5.2 counts relative indices from the end of the file, passes over lines whose keyword does not stand at the
beginning with a blank behind it, joins the numbers on both sides of a line's continuation, and takes all corners of
a material for written alike (``1``, ``1/2``, ``1//3``, ``1/2/3``) if they have equally many numbers. Lines that it
reads rightly stay as they are. Source: Wavefront Technologies, *Advanced Visualizer Manual*, appendix B1.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from dmis.base.vectors import Floats

_NO_INDEX = 2**40
"""Placeholder for an index that a corner of a face lacks."""
_CORNER = re.compile(r"-?\d+/*|-?\d+/-?\d+/*|-?\d+/(-?\d+)?/-?\d+", re.ASCII)
_UNREAD_STATEMENTS = {
    "fo": "write f in place of fo",
    "surf": "free-form surfaces are not read; export triangles",
    "bsp": "patches are not read; export triangles",
    "bzp": "patches are not read; export triangles",
    "call": "other files are not read; put their lines in its place",
}
"""Statements that are refused, because they make surfaces or read other files, with the remedy of each."""


@dataclass(frozen=True, eq=False)
class Obj:
    """Contents of an OBJ file.

    Attributes
    ----------
    text
        UTF-8 that trimesh reads rightly.
    triangles
        Corners of its triangles, (F, 3, 3); a polygon is a fan about its first corner.
    materials
        Names after ``usemtl``, each once.
    coloured
        Whether vertices have colours.
    """

    text: bytes
    triangles: Floats
    materials: tuple[str, ...]
    coloured: bool


def read_obj(data: bytes) -> Obj:
    """Read the lines of an OBJ file that make triangles.

    Raises
    ------
    ValueError
        If it is not text, has no faces, or a line cannot be read; the message begins with the line's number.
    """
    lines = _lines(data)
    heads = np.array([line[:7].partition(" ")[0] for line in lines])
    for word, remedy in _UNREAD_STATEMENTS.items():
        if (heads == word).any():
            raise ValueError(f"line {int(np.argmax(heads == word)) + 1}: {word!r} is not supported; {remedy}")
    rows, sides = _words(lines, heads == "vt", 1)
    for k in rows[sides == 1].tolist():  # u alone, beside which trimesh reads no v of the others
        lines[k] += " 0"
    _words(lines, heads == "vn", 3)
    positions, coloured = _positions(lines, *_words(lines, heads == "v", 3))
    rows, sides = _words(lines, heads == "f", 0)
    for k in rows[sides < 3].tolist():  # without area
        lines[k] = ""
    rows, sides = rows[sides >= 3], sides[sides >= 3]
    if not len(rows):
        raise ValueError("it has no faces, lines such as 'f 1 2 3'; got points or lines, or another format")
    used = np.flatnonzero(heads == "usemtl")
    names = ["", *(lines[k][7:] for k in used.tolist())]
    faces = _Faces(rows, sides, np.cumsum(sides) - sides)
    written = _corners(lines, faces)
    corners = _absolute(lines, heads, faces, written)
    present = written[:, 1:] != _NO_INDEX
    mixed = bool((present.any(axis=0) != present.all(axis=0)).any())
    if mixed or (written < 0).any():
        present = np.logical_and.reduceat(present, faces.first)  # by all corners of a face
        _rewrite(lines, faces, corners, present, [names[k] for k in np.searchsorted(used, rows)] if mixed else None)
    materials = tuple(dict.fromkeys(name for name in names if name))
    return Obj("\n".join(lines).encode(), positions[corners[_fans(faces), 0] - 1], materials, coloured)


def check_triangles(expected: Floats, triangles: Floats) -> None:
    """Raise a ValueError unless `triangles` (F, 3, 3) are the `expected` ones, in any order."""
    if len(expected) != len(triangles):
        raise ValueError(f"its lines make {len(expected)} triangles, trimesh read {len(triangles)}")
    if _digest(expected) != _digest(triangles):
        raise ValueError("its lines make other triangles than trimesh read; export it as PLY or GLB")


@dataclass(frozen=True, eq=False)
class _Faces:
    """Faces as arrays (N,): their lines, their numbers of corners, and the index of the first corner among all."""

    rows: npt.NDArray[np.intp]
    sides: npt.NDArray[np.int64]
    first: npt.NDArray[np.int64]


def _lines(data: bytes) -> list[str]:
    """Return lines with single blanks between words; lines that continue others become empty, so that numbers stay."""
    if data[:2] in (b"\xff\xfe", b"\xfe\xff") or b"\0" in data:
        raise ValueError("it is UTF-16 or binary; an OBJ file is text, save it as UTF-8")
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError:  # in comments and names
        text = data.decode("latin-1")
    text = text.replace("\r\n", "\n").replace("\r", "\n")
    lines = text.split("\n")
    if text[:1] == " " or any(blanks in text for blanks in ("\t", "\v", "\f", "  ", "\n ", " \n", "\\")):
        lines = _join_continued([" ".join(line.split()) for line in lines])
    if "#" in text:  # whole lines, and behind numbers
        lines = [line.partition("#")[0].rstrip() if line[:1] in ("#", "v", "f") else line for line in lines]
    return lines


def _join_continued(lines: list[str]) -> list[str]:
    """Join each line that ends in a backslash with the lines that continue it, which become empty."""
    start = 0
    for k, line in enumerate(lines):
        if k > start:  # the line before is continued
            lines[start], lines[k] = f"{lines[start]} {line}".strip(), ""
        if line.endswith("\\") and not lines[start].startswith("#"):
            lines[start] = lines[start][:-1].rstrip()
        else:
            start = k + 1
    return lines


def _words(lines: list[str], chosen: Any, least: int) -> tuple[npt.NDArray[np.intp], npt.NDArray[np.int64]]:
    """Return the indices of the lines `chosen` and their numbers of words after the keyword, at least `least`, (N,)."""
    rows = np.flatnonzero(chosen)
    count = np.array([lines[k].count(" ") for k in rows.tolist()], np.int64)
    if (count < least).any():
        raise _fault(lines, rows[np.argmax(count < least)], f"needs {least} numbers")
    return rows, count


def _positions(lines: list[str], rows: npt.NDArray[np.intp], count: npt.NDArray[np.int64]) -> tuple[Floats, bool]:
    """Return the positions of the vertices, (V, 3), and whether a vertex has a colour."""
    first = (np.cumsum(count) - count)[:, None] + np.arange(3)
    numbers = _parse(" ".join([lines[k][2:] for k in rows.tolist()]), np.float64)
    if len(numbers) != count.sum():
        for k in rows.tolist():
            if len(_parse(lines[k][2:], np.float64)) != lines[k].count(" "):
                raise _fault(lines, k, "must have numbers only")
    return numbers[first], bool((count >= 6).any())


def _parse(text: str, kind: Any) -> npt.NDArray[Any]:
    """Return the numbers in a text, fewer than its words if a word is not a number."""
    try:
        return np.fromstring(text, kind, sep=" ")
    except (ValueError, DeprecationWarning):  # which older versions of NumPy have
        return np.empty(0, kind)


def _corners(lines: list[str], faces: _Faces) -> npt.NDArray[np.int64]:
    """Return the indices of position, texture coordinates and normal of each corner as written, (C, 3)."""
    text = " ".join([lines[k][2:] for k in faces.rows.tolist()])
    if "/ " in text or text.endswith("/"):
        text = re.sub(r"/+(?= |$)", "", text)
    letters = np.frombuffer(text.encode("ascii", "replace"), np.uint8)
    words = np.concatenate([[0], np.flatnonzero(letters == ord(" ")) + 1])
    count = 1 + np.add.reduceat(letters == ord("/"), words, dtype=np.int64)
    flat = _parse(text.replace("//", f"/{_NO_INDEX}/").replace("/", " "), np.int64)
    if len(flat) != count.sum() or count.max() > 3 or (flat == 0).any() or np.abs(flat).max() > _NO_INDEX:
        for k in faces.rows.tolist():
            for word in lines[k].split()[1:]:
                if not _CORNER.fullmatch(word) or any(int(i or 1) == 0 or len(i) > 12 for i in word.split("/")):
                    raise _fault(lines, k, f"has the corner {word!r}; write 1, 1/2, 1//3 or 1/2/3, counted from 1")
    corners = np.full((len(words), 3), _NO_INDEX, np.int64)
    start = np.cumsum(count) - count
    for j in range(3):
        corners[count > j, j] = flat[start[count > j] + j]
    return corners


def _absolute(lines: list[str], heads: Any, faces: _Faces, written: npt.NDArray[np.int64]) -> npt.NDArray[np.int64]:
    """Return indices counted from 1; negative ones as written count back from the face's line, -1 is the last above."""
    absolute = written.copy()
    for j, (word, what) in enumerate((("v", "vertex"), ("vt", "texture coordinate"), ("vn", "normal"))):
        above = np.cumsum(heads == word)
        if j and not above[-1]:
            continue  # trimesh does without
        here = np.repeat(above[faces.rows], faces.sides)
        column = np.where(written[:, j] < 0, written[:, j] + 1 + here, written[:, j])
        wrong = (written[:, j] != _NO_INDEX) & ((column < 1) | (column > above[-1]))
        if wrong.any():
            k = int(np.argmax(wrong))
            row = np.repeat(faces.rows, faces.sides)[k]
            count = f"{here[k]} above it" if written[k, j] < 0 else f"{above[-1]}"
            raise _fault(lines, row, f"has the {what} {written[k, j]}, but there are {count}")
        absolute[:, j] = column
    return absolute


def _fans(faces: _Faces) -> npt.NDArray[np.int64]:
    """Return the corners of the triangles (0, 1, 2), (0, 2, 3), ... of each polygon, (F, 3)."""
    count = faces.sides - 2
    first = np.repeat(faces.first, count)
    second = np.arange(count.sum()) - np.repeat(np.cumsum(count) - count, count) + first + 1
    return np.stack([first, second, second + 1], axis=1)


def _rewrite(
    lines: list[str], faces: _Faces, corners: npt.NDArray[np.int64], present: Any, names: list[str] | None
) -> None:
    """Write the faces with `corners`; `present` (N, 2) says whether all of a face have texture coordinates and normals.

    With the `names` of their materials, faces that are written in another form get another material.
    """
    forms = ("{0}", "{0}/{1}", "{0}//{2}", "{0}/{1}/{2}")
    table, chosen, last = corners.tolist(), (present @ [1, 2]).tolist(), ""
    for n, (k, begin, count) in enumerate(
        zip(*(column.tolist() for column in (faces.rows, faces.first, faces.sides)), strict=True)
    ):
        form = forms[chosen[n]]
        lines[k] = "f " + " ".join([form.format(*corner) for corner in table[begin : begin + count]])
        if names is not None and (material := f"usemtl {names[n]} {form}") != last:
            lines[k], last = f"{material}\n{lines[k]}", material


def _digest(triangles: Floats) -> int:
    """Return a hash of 64 bits that depends neither on the order of the triangles nor on their first corners."""
    factors = np.array([0x9E3779B97F4A7C15, 0xC2B2AE3D27D4EB4F, 0x165667B19E3779F9], np.uint64)
    bits = np.ascontiguousarray(triangles + 0.0).view(np.uint64)  # of -0 those of 0
    corner = _mix_bits((bits * factors).sum(axis=2, dtype=np.uint64))
    edge = _mix_bits(corner * factors[0] + np.roll(corner, -1, axis=1) * factors[1])
    return int(_mix_bits(edge.sum(axis=1, dtype=np.uint64)).sum(dtype=np.uint64))


def _mix_bits(values: npt.NDArray[np.uint64]) -> npt.NDArray[np.uint64]:
    """Return hashes in which each bit depends on all bits of the value (xor-shift and multiplication)."""
    for shift in (32, 29):
        values = (values ^ (values >> np.uint64(shift))) * np.uint64(0xD6E8FEB86659FD93)
    return values ^ (values >> np.uint64(32))


def _fault(lines: list[str], row: Any, what: str) -> ValueError:
    """Return the error that line `row` has the fault `what`."""
    line = lines[row] if len(lines[row]) < 60 else f"{lines[row][:57]}..."
    return ValueError(f"line {row + 1}: {line!r} {what}")
