"""Reader of Wavefront OBJ files: positions, texture coordinates, normals, polygons and names of materials.

`read_obj` reads the statements ``v``, ``vt``, ``vn``, ``f``, ``usemtl`` and ``mtllib``, and refuses those that make
other surfaces or read other geometry; all others, such as ``o`` and ``s``, do not change the triangles. Source:
Wavefront Technologies, *Advanced Visualizer Manual*, appendix B1.
"""

from __future__ import annotations

import re
from typing import Any

import numpy as np

from dmis.base.text import decode
from dmis.base.vectors import Floats
from dmis.geometry.mesh import Ints, Mesh, flat_normals, repair_normals
from dmis.geometry.polygons import triangulate

_CORNER = re.compile(r"(-?\d{1,12})(?:/(-?\d{1,12})?(?:/(-?\d{1,12})?)?)?", re.ASCII)
"""A corner of a face: the index of its position, and those of its texture coordinates and its normal, if it has any."""
NUMBER = re.compile(r"[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?", re.ASCII)
_ABSENT = 2**40
"""Index of what a corner lacks: larger than any of a file."""
_UNREAD_STATEMENTS = "fo", "surf", "bsp", "bzp", "call"
"""Statements that are refused, because they make surfaces or read other files."""


def read_obj(data: bytes) -> tuple[dict[str, Mesh], tuple[str, ...], dict[str, bool]]:
    """Return the meshes of the bytes of an OBJ file, by the name of their material, "" above any ``usemtl``; what
    follows ``mtllib``, names of files with the materials; and whether the file has what is not read.

    A polygon is a fan about its first corner, or is cut along its ears, if it is concave. If some faces of a mesh have
    normals, the others have their geometric normal; if some have texture coordinates, those of the others are 0. A
    ValueError if the file is not text, has no faces, or a line cannot be read; the message begins with its number.
    """
    lines = _lines(data)
    heads = np.array([(line.lstrip()[:8].lower().split() or [""])[0] for line in lines])
    if (unread := np.isin(heads, _UNREAD_STATEMENTS)).any():
        raise _fault(lines, int(np.argmax(unread)), "is not supported; export triangles, to one file")
    positions, coloured = _numbers(lines, heads, "v", 3, 3)
    tables = positions, _numbers(lines, heads, "vt", 1, 2)[0], _numbers(lines, heads, "vn", 3, 3)[0]
    corners, sides, rows = _corners(lines, heads)
    uses = np.flatnonzero(heads == "usemtl")
    used = ["", *(" ".join(lines[k].split()[1:]) for k in uses)]
    names = {name: number for number, name in enumerate(dict.fromkeys(used))}
    material = np.array([names[name] for name in used])[np.searchsorted(uses, rows)]
    libraries = tuple(dict.fromkeys(" ".join(lines[k].split()[1:]) for k in np.flatnonzero(heads == "mtllib")))
    corners = corners[triangulate(sides, positions[corners[:, 0]])]
    material = np.repeat(material, sides - 2)
    meshes = {name: _mesh(tables, corners[material == names[name]]) for name in names if names[name] in material}
    groups = (lines[k].lower().split()[1:] for k in np.flatnonzero(heads == "s"))
    smooth = not len(tables[2]) and any(group not in ([], ["0"], ["off"]) for group in groups)
    return meshes, libraries, {"vertex colours": coloured, "smoothing groups (it has no normals, it is flat)": smooth}


def uncommented(text: str) -> str:
    """Return the text of an OBJ or MTL file without comments, which follow a blank or begin a line.

    Names may hold numbers and colours, ``Material #25`` and ``#FF8000``, which stay.
    """
    return re.sub(r"(?m)^[ \t]*#.*$|[ \t]#(?![\dA-Fa-f]*\d|[\dA-F]{6}\b).*$", "", text)


def _lines(data: bytes) -> list[str]:
    """Return the lines without comments; a line that others continue holds them all, each behind a vertical tab."""
    text = uncommented(decode(data, "it").replace("\v", " "))
    if "#" in text:  # behind numbers anything is a comment
        text = re.sub(r"(?mi)^([ \t]*[vf][^#\n]*)#.*$", r"\1", text)
    return re.sub(r"\\[ \t]*\n", "\v", text).split("\n")


def _numbers(lines: list[str], heads: Any, word: str, least: int, columns: int) -> tuple[Floats, bool]:
    """Return the first `columns` numbers of the lines of a statement, (N, columns), and whether a line has six or more.

    A line must have at least `least` numbers; those that it lacks are 0.
    """
    rows = np.flatnonzero(heads == word).tolist()
    words = [lines[k].split()[1:] for k in rows]
    counts = np.fromiter(map(len, words), np.int64, len(rows))
    if (counts < least).any():
        raise _fault(lines, rows[int(np.argmax(counts < least))], f"needs {least} numbers")
    try:
        flat = np.array([number for line in words for number in line] + [0], np.float64)
    except ValueError:
        bad = next(k for k, line in zip(rows, words, strict=True) if not all(map(NUMBER.fullmatch, line)))
        raise _fault(lines, bad, "must have numbers only") from None
    place = (np.cumsum(counts) - counts)[:, None] + np.arange(columns)
    return flat[np.where(np.arange(columns) < counts[:, None], place, -1)], bool((counts >= 6).any())


def _corners(lines: list[str], heads: Any) -> tuple[Ints, Ints, Ints]:
    """Return the indices of the corners of all faces into the tables of v, vt and vn, (C, 3); and the faces' numbers of
    sides and rows.

    Indices count from 0; -1 stands for one that a corner of the face lacks, or whose table is empty. A negative index
    of the file counts back from the face's line: -1 is the last one above.
    """
    faces = {int(k): lines[k].split()[1:] for k in np.flatnonzero(heads == "f")}
    faces = {k: words for k, words in faces.items() if len(words) > 2}  # others have no area
    if not faces:
        raise ValueError("it has no faces, lines such as 'f 1 2 3'; got points or lines, or another format")
    sides = np.fromiter(map(len, faces.values()), np.int64)
    row = np.repeat(np.fromiter(faces, np.int64), sides)
    codes: dict[str, int] = {}
    code = np.array([codes.setdefault(word, len(codes)) for words in faces.values() for word in words])
    groups = [match.groups(_ABSENT) if (match := _CORNER.fullmatch(word)) else (0, 0, 0) for word in codes]
    written = np.array(groups, np.int64)[code]
    if not written.all():
        k = int(np.argmin(written.all(axis=1)))
        what = f"has the corner {list(codes)[code[k]]!r}; write 1, 1/2, 1//3 or 1/2/3, counted from 1"
        raise _fault(lines, row[k], what)
    corners = np.full_like(written, -1)
    for j, (head, what) in enumerate((("v", "vertex"), ("vt", "texture coordinate"), ("vn", "normal"))):
        above = np.cumsum(heads == head)
        index = written[:, j]
        here = above[row]
        count = above[-1]
        if j and not count:
            continue
        absolute = np.where(index < 0, index + here, index - 1)
        wrong = (index != _ABSENT) & ((absolute < 0) | (absolute >= count))
        if wrong.any():
            k = int(np.argmax(wrong))
            there = f"{here[k]} above it" if index[k] < 0 else f"{count}"
            raise _fault(lines, row[k], f"has the {what} {index[k]}, but there are {there}")
        corners[:, j] = np.where(index == _ABSENT, -1, absolute)
    whole = np.logical_and.reduceat(corners >= 0, np.cumsum(sides) - sides)
    return np.where(np.repeat(whole, sides, axis=0), corners, -1), sides, np.fromiter(faces, np.int64)


def _mesh(tables: tuple[Floats, Floats, Floats], corners: Ints) -> Mesh:
    """Return the mesh of triangles whose corners are indices into the tables, (F, 3, 3); -1 if absent.

    Corners of equal indices are one vertex.
    """
    positions, uv, normals = tables
    flat = corners[:, 0, 2] < 0
    smooth = not flat.all()
    if smooth and flat.any():
        corners[flat, :, 2] = (len(normals) + np.arange(flat.sum()))[:, None]
        normals = np.concatenate([normals, flat_normals(positions, corners[flat, :, 0])])
    textured = (corners[:, 0, 1] >= 0).any()
    key = corners[..., 0].ravel()
    for j in (1, 2):  # keys are numbered anew, or the product of three sizes might overflow
        _, key = np.unique(key * (corners[..., j].max() + 2) + corners[..., j].ravel() + 1, return_inverse=True)
    _, first, faces = np.unique(key, return_index=True, return_inverse=True)
    a, b, c = corners.reshape(-1, 3)[first].T
    vertices = positions[a]
    faces = faces.reshape(-1, 3)
    return Mesh(
        vertices,
        faces,
        repair_normals(vertices, faces, normals[c]) if smooth else None,
        np.append(uv, [[0.0, 0.0]], axis=0)[b] if textured else None,
    )


def _fault(lines: list[str], row: int, what: str) -> ValueError:
    """Return the error that line `row` has the fault `what`."""
    number = row + 1 + sum(line.count("\v") for line in lines[:row])
    line = " ".join(lines[row].split())
    return ValueError(f"line {number}: {line if len(line) < 60 else f'{line[:57]}...'!r} {what}")
