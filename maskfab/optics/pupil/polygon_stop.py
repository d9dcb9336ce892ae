r"""Parts of dots inside a stop of straight sides that cuts them.

By Green's theorem an integral over what a polygon and a box have in common is one along the polygon's edges,

    ∫∫ P_q(η) P_p(ξ) dξ dη = ∮ A_p(ξ) P_q(η) dη,    A_p(ξ) = ∫_{-1}^ξ P_p,

in the box's own coordinates ξ, η, both kept within [-1, 1]. On an edge the integrand is a polynomial between the points
at which it enters and leaves the box's width, so Gauss-Legendre nodes between these give it exactly.
"""

from __future__ import annotations

import numpy as np
from numpy.polynomial.legendre import leggauss
from numpy.typing import NDArray

from maskfab.base.arrays import Floats, Indices
from maskfab.optics.functions.legendre import legendre, legendre_integrals

# Edges this near to a lattice's line, in shares of the polygon's extent, lie on it.
_ON_LINE = 1e-9


def polygon_cover(x: Floats, y: Floats, corners: Floats) -> tuple[NDArray[np.bool_], Indices, Indices]:
    """Which intervals of a lattice a polygon holds wholly, and which its edges cross.

    Args:
        x, y: edges of the intervals, ascending.
        corners: [n, 2] of a polygon whose sides do not cross, counter-clockwise.

    Returns:
        bool [ny, nx] of those held; rows and columns of those crossed, row by row.
    """
    tolerance = _ON_LINE * float(abs(corners).max())
    middle_x, middle_y = (x[1:] + x[:-1]) / 2, (y[1:] + y[:-1]) / 2
    crossed = np.zeros((middle_y.size, x.size), dtype=np.int16)
    turns = np.zeros((middle_y.size, x.size), dtype=np.int16)
    for (px, py), (qx, qy) in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        low, high = min(py, qy), max(py, qy)
        first, last = _met(y, low, high, tolerance)
        row = np.arange(int(first), int(last))
        ends = [_along(px, py, qx, qy, np.clip(side, low, high)) for side in (y[row], y[row + 1])]
        if py == qy:
            ends = [np.full(row.size, px), np.full(row.size, qx)]
        begin, end = _met(x, np.minimum(*ends), np.maximum(*ends), tolerance)
        some = begin < end
        np.add.at(crossed, (row[some], begin[some]), 1)
        np.add.at(crossed, (row[some], end[some]), -1)
        passed = np.flatnonzero((py <= middle_y) != (qy <= middle_y))
        column = np.searchsorted(middle_x, _along(px, py, qx, qy, middle_y[passed]))
        np.add.at(turns, (passed, column), 1 if qy < py else -1)
    met = np.cumsum(crossed, axis=1)[:, :-1] > 0
    inside = (np.cumsum(turns, axis=1)[:, :-1] != 0) & ~met
    row, column = np.nonzero(met)
    return inside, row, column


def polygon_moments(boxes: Floats, corners: Floats, orders: int) -> Floats:
    """Means over boxes of P_q(eta) P_p(xi) inside a polygon, [k, orders, orders].

    Args:
        boxes: [k, 4], x0, x1, y0, y1.
        corners: [n, 2] of a polygon whose sides do not cross, counter-clockwise.
        orders: of the moments.
    """
    moments = np.zeros((len(boxes), orders, orders))
    nodes, weights = leggauss(orders + 1)
    for (px, py), (qx, qy) in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        if py == qy:
            continue
        low, high = min(py, qy), max(py, qy)
        met = np.flatnonzero((boxes[:, 3] > low) & (boxes[:, 2] < high) & (boxes[:, 0] < max(px, qx)))
        x0, x1, y0, y1 = boxes[met].T
        ends = np.clip(np.stack([y0, y1], axis=1), low, high)
        if px != qx:
            sides = np.stack([_along(py, px, qy, qx, side) for side in (x0, x1)], axis=1)
            ends = np.sort(np.concatenate([ends, np.clip(sides, ends[:, :1], ends[:, 1:])], axis=1), axis=1)
        length = np.diff(ends, axis=1)[:, :, None]
        samples = (met.size, (ends.shape[1] - 1) * nodes.size)
        y = (ends[:, :-1, None] + length * (nodes + 1) / 2).reshape(samples)
        height, width = (y1 - y0)[:, None], (x1 - x0)[:, None]
        weight = np.sign(qy - py) * (length * weights / 2).reshape(samples) / (2 * height)
        xi = np.clip(2 * (_along(px, py, qx, qy, y) - x0[:, None]) / width - 1, -1, 1)
        eta = np.clip(2 * (y - y0[:, None]) / height - 1, -1, 1)
        moments[met] += np.einsum(
            "qks,ks,pks->kqp", legendre(eta, orders), weight, legendre_integrals(xi, orders), optimize=True
        )
    return moments


def _along(px: float, py: float, qx: float, qy: float, y: Floats) -> Floats:
    """x where the line through two points has these y."""
    if py == qy:
        return np.full(y.shape, px)
    return np.asarray(px + (y - py) * ((qx - px) / (qy - py)))


def _met(edges: Floats, low: Floats, high: Floats, tolerance: float) -> tuple[Indices, Indices]:
    """First and last + 1 of the intervals that low to high reaches into, lines themselves belonging to none."""
    begin = np.searchsorted(edges, low + tolerance, "right") - 1
    end = np.searchsorted(edges, high - tolerance, "left")
    return np.clip(begin, 0, edges.size - 1), np.clip(end, 0, edges.size - 1)
