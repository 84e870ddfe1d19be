"""Search the matrices of `dmis.samplers.sobol.COLUMNS`: ``python benchmarks/search_net.py`` (half an hour).

A new matrix is built column by column, so that the first 2^m samples are good for every m. At a column c:

* *Conditions.* Let t(m) be the bound on t for 2^m samples. In each earlier order the pair and the new one are four
  coordinates, and for each (d_1, .., d_4) of sum m - t(m) the first d_j rows of their generator matrices must be
  independent. Where they were not before column c, their one combination that vanishes must have a 1 there: a linear
  equation over GF(2) in the unknown digits of the column. Random solutions of these equations are candidates.
* *Merit.* The candidates with the smallest mean squared error for functions whose Walsh coefficients fall like edges
  make them (random, |coefficient|^2 ~ 2^(-1.5 digits) in each coordinate) go on to the next column.

The matrix of the light is also searched for 2 and 4 neighbouring light samples of each camera sample. That of the lens
(``--lens --runs 1 --seed 3``) is searched with those of `dmis.samplers.sobol.COLUMNS`. Of seeds 1 to 3, the third one
has the smallest mean squared error for half-spaces ``(x + a u) cos b + (y + a v) sin b < c`` of the place (x, y) in the
pixel and the point (u, v) on the lens: edges out of focus.
"""

from __future__ import annotations

import argparse
import itertools
import random
from collections.abc import Sequence

import numpy as np

from dmis.samplers.sobol import COLUMNS, DIGITS

CONSTANT = 64
"""Bit of a row above its digits in the earlier columns: the 1 of the affine form that its next digit is."""
Columns = list[int]
"""A matrix: column c is the index A(2^c)."""


def times(columns: Columns, i: int) -> int:
    """Return the product of a matrix and the digits of i."""
    out = 0
    for c, column in enumerate(columns):
        out ^= column * (i >> c & 1)
    return out


IDENTITY = [2**c for c in range(DIGITS)]
PASCAL = [sum(2**r for r in range(c + 1) if c & r == r) for c in range(DIGITS)]


def row(columns: Columns, r: int) -> int:
    """Return row r of the generator matrix with the `columns`."""
    return sum((column >> r & 1) << c for c, column in enumerate(columns))


def conditions(known: Columns, new: Columns, strength: int, shift: int) -> set[int] | None:
    """Return affine forms in the digits of the next column of `new` that must be 1; None if no column will do.

    The order `known` is that of camera samples, each of which has ``2^shift`` samples of the new order. Bit 0 of a form
    is its constant, bit j + 1 the coefficient of digit j.
    """
    c = len(new)
    rows: list[list[int]] = []
    for generator in (IDENTITY, PASCAL):
        earlier = [0] * shift + [times(generator, column) for column in known]
        rows.append([row(earlier[:c], r) | (earlier[c] >> r & 1) << CONSTANT for r in range(strength)])
    for generator in (IDENTITY, PASCAL):
        digits = [row([times(generator, column) for column in new], r) for r in range(strength)]
        # digit r of the product of the generator and the unknown column, whose digit c is 1
        forms = [row(generator[: c + 1], r) for r in range(strength)]
        forms = [f >> c & 1 | f % 2**c << 1 for f in forms]
        rows.append([d | f << CONSTANT for d, f in zip(digits, forms, strict=True)])

    found: set[int] = set()

    def extend(basis: dict[int, int], coordinate: int, left: int) -> bool:
        """Add rows of this coordinate and the later ones to the basis; False if `left` more cannot be independent."""
        if coordinate == 4:
            found.update(form for low, form in basis.items() if not low)
            return True
        for d in range(left + 1):
            if d:
                vector = rows[coordinate][d - 1]
                while (low := vector % 2**CONSTANT) and (low & -low) in basis:
                    vector ^= basis[low & -low]
                if not low and (0 in basis or vector == 0):
                    return False
                basis = {**basis, low & -low: vector if low else vector >> CONSTANT}
            if (coordinate < 3 or d == left) and not extend(basis, coordinate + 1, left - d):
                return False
        return True

    return found if extend({}, 0, strength) else None


def solution(forms: set[int], c: int, rng: random.Random) -> int | None:
    """Return a random column ``2^c + digits`` at which all `forms` are 1; None if there is none."""
    pivots: dict[int, int] = {}
    for form in forms:
        equation = form ^ 1
        for pivot, other in pivots.items():
            if equation >> pivot & 1:
                equation ^= other
        if equation == 1:
            return None
        if equation:
            new = equation.bit_length() - 1
            pivots = {p: e ^ equation if e >> new & 1 else e for p, e in pivots.items()} | {new: equation}
    digits = rng.getrandbits(c) << 1 | 1
    free = digits & ~sum(1 << p for p in pivots)
    for pivot, equation in pivots.items():
        free |= ((equation & free).bit_count() & 1) << pivot
    return 2**c + (free >> 1)


def kernel(columns: Columns) -> np.ndarray:
    """Return (1 + k(u_0)) (1 + k(u_1)) - 1 of the points of an order, ``(2^m,)``: the sum of its Walsh functions.

    k(u) is the sum of 2^(-1.5 digits of l) wal_l(u) over l = 1, 2, ...; it depends on the leading zeros of u.
    """
    out = np.ones(2 ** len(columns))
    leading = np.arange(DIGITS + 1)
    below = np.cumsum(np.append(0, 2 ** (leading[1:] - 1) * 2.0 ** (-1.5 * leading[1:])))
    of_zeros = below - np.where(leading < DIGITS, 2.0**leading * 2.0 ** (-1.5 * (leading + 1)), 0)
    for generator in (IDENTITY, PASCAL):
        reversed_digits = np.zeros(1, np.int64)
        for column in columns:
            reversed_digits = np.concatenate([reversed_digits, reversed_digits ^ times(generator, column)])
        # leading zeros of u are trailing zeros of its reversed digits
        lowest = np.where(reversed_digits, reversed_digits & -reversed_digits, 2**DIGITS)
        out *= 1 + of_zeros[np.log2(lowest).astype(int)]
    return out - 1


def merit(earlier: Sequence[Columns], new: Columns, shifts: Sequence[int]) -> float:
    """Return the logarithm of the mean squared error of products of the new pair and earlier ones, added up."""
    m, pair = len(new), kernel(new)
    total = 0.0
    for shift in (s for s in shifts if s < m):
        kernels = [kernel(columns[: m - shift]).repeat(2**shift) for columns in earlier]
        errors = [np.mean(pair * k) for k in kernels]
        if len(kernels) > 1:
            errors.append(np.mean(pair * (np.prod([1 + k for k in kernels], axis=0) - 1)))
        total += sum(np.log(max(error, 1e-30)) for error in errors)
    return total


def search(
    earlier: Sequence[Columns],
    bounds: Sequence[Sequence[int]],
    shifts: Sequence[int],
    width: int,
    tries: int,
    rng: random.Random,
    begin: Sequence[int] = (),
) -> Columns:
    """Return a matrix of as many columns as there are `bounds` on t, or of as many as were found; `begin` are given.

    There are as many lists of bounds as earlier matrices.
    """
    beam: list[tuple[float, Columns]] = [(0.0, list(begin))]
    for c in range(len(begin), len(bounds[0])):
        candidates: dict[tuple[int, ...], float] = {}
        for score, columns in beam:
            forms: set[int] | None = set()
            for (known, of_known), shift in itertools.product(zip(earlier, bounds, strict=True), shifts):
                strength = c + 1 - shift - of_known[max(c - shift, 0)]
                more = conditions(known, columns, strength, shift) if strength > 0 else set()
                forms = None if forms is None or more is None else forms | more
            for _ in range(0 if forms is None else tries):
                column = solution(forms or set(), c, rng)
                if column is None:
                    break
                extended = [*columns, column]
                if tuple(extended) not in candidates:
                    candidates[tuple(extended)] = score + merit(earlier, extended, shifts)
        if not candidates:
            break
        best = sorted(candidates.items(), key=lambda item: item[1])[:width]
        beam = [(score, list(columns)) for columns, score in best]
    return beam[0][1]


def t_bounds(text: str) -> list[int]:
    """Return bounds on t for m = 1, 2, ..., 16, the last of the numbers repeated."""
    bounds = [int(word) for word in text.split()]
    return bounds + bounds[-1:] * (16 - len(bounds))


BOUNDS = ["0 1 1 2 2 2 2 3", "0 1 2 2 2 3 3 3 3 3 3 3 4", "0 1 2 2 3 3 3 4", *["0 1 2 3 3 4 4 4 5"] * 4]
"""Bounds on t with each earlier order, for the light, the second vertex, the rounding of counts, and later vertices."""
LENS_BOUNDS = ["0 1 1 2 2 2 3 3 3 3 3 3 4", "0 1 2 3 3 3 4 4 4 4 4 5", "0 1 2 3 3 4 4 5"]
"""Bounds on t of the lens with the place in the pixel, the light, and the next vertex."""
LENS_BEGIN = (1, 3)
"""First columns of the lens. By these, halves of 4 samples are even together in x of pixel and lens, and in y. In x of
the one and y of the other they are not: on 4 points there are three linear functions, and the two pairs need four.
"""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--width", type=int, default=24, help="matrices that go on at each column")
    parser.add_argument("--tries", type=int, default=12, help="columns tried for each of them")
    parser.add_argument("--runs", type=int, default=4, help="searches of which the best is taken")
    parser.add_argument("--matrices", type=int, default=len(BOUNDS), help="number of matrices")
    parser.add_argument("--lens", action="store_true", help="search the matrix of the lens alone")
    parser.add_argument("--seed", type=int, default=1)
    arguments = parser.parse_args()
    if arguments.lens:
        earlier = [IDENTITY, *(list(COLUMNS[order]) for order in (1, 2))]
        limits, rng = list(map(t_bounds, LENS_BOUNDS)), random.Random(arguments.seed)
        sizes = arguments.width, arguments.tries
        results = [search(earlier, limits, (0,), *sizes, rng, LENS_BEGIN) for _ in range(arguments.runs)]
        new = min(results, key=lambda columns: (-len(columns), merit(earlier, columns, (0,))))
        print(len(new), "columns:", tuple(new), f"merit {merit(earlier, new, (0,)):.3f}")
        return
    rng, orders = random.Random(arguments.seed), [IDENTITY]
    for text in BOUNDS[: arguments.matrices]:
        shifts = (0, 1, 2) if len(orders) == 1 else (0,)
        bounds = [t_bounds(text)] * len(orders)
        results = [search(orders, bounds, shifts, arguments.width, arguments.tries, rng) for _ in range(arguments.runs)]
        new = min(results, key=lambda columns: (-len(columns), merit(orders, columns, shifts)))
        print(len(new), "columns:", tuple(new), f"merit {merit(orders, new, shifts):.3f}", flush=True)
        if len(new) < len(bounds[0]):
            break
        orders.append(new)


if __name__ == "__main__":
    main()
