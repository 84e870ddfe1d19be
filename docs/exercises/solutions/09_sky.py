"""Solution of exercise 9: inversion of two distribution functions.

A uniform number that has picked a cell has a uniform position within this cell. So the
same number also places the point in the cell.
"""

import numpy as np


def sample_table(table, u):
    """Return points (x, y) in [0, 1)^2, ``(2, N)``, and their density, ``(N,)``."""
    height, width = table.shape
    row, y = pick(np.broadcast_to(table.sum(axis=1), (u.shape[1], height)), u[1])
    column, x = pick(table[row], u[0])
    points = np.stack([(column + x) / width, (row + y) / height])
    return np.minimum(points, np.nextafter(1, 0)), table[row, column] / table.mean()


def pick(values, u):
    """Return a cell of each row of `values` ``(N, K)``, and a place in it, ``(N,)``."""
    ends = np.cumsum(values, axis=1)
    target = u[:, None] * ends[:, -1:]
    cell = np.minimum((ends <= target).sum(axis=1), (ends < ends[:, -1:]).sum(axis=1))
    value = np.take_along_axis(values, cell[:, None], axis=1)[:, 0]
    end = np.take_along_axis(ends, cell[:, None], axis=1)[:, 0]
    return cell, np.clip((target[:, 0] - (end - value)) / value, 0, 1)
