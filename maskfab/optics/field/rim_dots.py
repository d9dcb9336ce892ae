r"""The rim as a small grid of sources: dots that the stop cuts, moved to the nodes of two bands.

A rim has few dots but a column of moments each, and as a matrix over all intervals it costs more than everything that
is not cut. Folded into one quadrant it lies in two bands: dots nearer to the x axis fill a tall, narrow one, the
others a low, wide one. Each is narrow one way, so its sources on Chebyshev nodes (see ``nodes``) are a slim matrix,
and the frequencies alone decide how many there are, not the dots.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from maskfab.base.arrays import Floats
from maskfab.optics.field.interval_nodes import nodes_for
from maskfab.optics.field.waves import Positions, point_sources
from maskfab.optics.functions.bessel import spherical_bessel_bounds
from maskfab.optics.pupil.pupil import Pupil

# Bound of the field's relative L2 error from the orders left out.
_TOLERANCE = 2e-13
_MOST_ORDERS = 64
# Squares of amplitudes below 1e-150 are not told from nothing.
_LEAST_ENERGY_UM2 = 1e-290


@dataclass(frozen=True, eq=False)
class NodeGrid:
    """Sources on a grid of nodes right of and above the axis.

    Attributes:
        x, y: the nodes' positions along either axis.
        strength: float64 [2, 2, y.count, x.count] in square micrometres, for the parts of the field that are even or
            odd in y and in x.
    """

    x: Positions
    y: Positions
    strength: Floats


def rim_bands(pupil: Pupil, highest_u: float, highest_v: float) -> tuple[NodeGrid, ...]:
    """The cut dots of a pupil as at most two bands of sources, good for frequencies up to the highest given."""
    if not pupil.rim_row.size:
        return ()
    x, y = pupil.x.edges_um(), pupil.y.edges_um()
    column, row = _folded(pupil.rim_column, x.size - 1), _folded(pupil.rim_row, y.size - 1)
    beside = x[column] + x[column + 1] >= y[row] + y[row + 1]
    orders = rim_orders(pupil, highest_u, highest_v)
    if pupil.x == pupil.y and highest_u == highest_v:
        # The bands are each other's mirror images, and share nodes and waves.
        narrow = _side(x, np.concatenate([column[beside], row[~beside]]), highest_u, orders)
        long = _side(x, np.concatenate([row[beside], column[~beside]]), highest_u, orders)
        bands = [(beside, narrow, long), (~beside, long, narrow)]
    else:
        bands = [
            (chosen, _side(x, column[chosen], highest_u, orders), _side(y, row[chosen], highest_v, orders))
            for chosen in (beside, ~beside)
            if chosen.any()
        ]
    return tuple(
        _band(pupil, np.flatnonzero(chosen), along_x, along_y) for chosen, along_x, along_y in bands if chosen.any()
    )


def rim_orders(pupil: Pupil, highest_u: float, highest_v: float) -> int:
    """Number of Legendre orders of the rim that matter at the highest frequency; at least one.

    What cut dots hold in orders from P on is their clear share less the squares of the moments before (Parseval). At
    most (2P + 1) j_P² of that lies within the phase that j_P is taken at.
    """
    if not pupil.rim_row.size:
        return 1
    widths, heights = np.diff(pupil.x.edges_um())[pupil.rim_column], np.diff(pupil.y.edges_um())[pupil.rim_row]
    phase = np.pi * np.maximum(highest_u * widths.max(), highest_v * heights.max())
    size = (2 * np.arange(_MOST_ORDERS) + 1) * spherical_bessel_bounds(phase, _MOST_ORDERS) ** 2
    needed = np.flatnonzero(size * _left_out(pupil, widths * heights) >= _TOLERANCE**2)
    return int(needed[-1]) + 1 if needed.size else 1


def _left_out(pupil: Pupil, area_um2: Floats) -> Floats:
    """Share of the field's energy in the rim's orders from P on, float64 [_MOST_ORDERS]."""
    shape = pupil.rim_moments / pupil.rim_transmission[:, None, None]
    weight = 2 * np.arange(shape.shape[1]) + 1
    squares, energy_um2 = pupil.rim_transmission**2, pupil.energy_um2
    if energy_um2 < _LEAST_ENERGY_UM2:
        # As if the rim held all the light, which asks for no fewer orders.
        squares, energy_um2 = np.ones_like(squares), float(area_um2.sum())
    light = area_um2 * squares / energy_um2
    held = weight[:, None] * weight * np.einsum("k,kqp->qp", light, shape**2)
    before = np.array([held[:order, :order].sum() for order in range(len(held) + 1)])
    left = np.clip(light @ shape[:, 0, 0] - before, 0, None)
    return np.append(left, np.full(_MOST_ORDERS - left.size, left[-1]))


@dataclass(frozen=True, eq=False)
class _Side:
    """One axis of a band: its nodes, and what the intervals that it holds send to them.

    Attributes:
        positions: of the nodes.
        index: intp [k] numbers of the intervals, ascending.
        moments: float64 [k, orders, count], see :meth:`Nodes.moments`.
    """

    positions: Positions
    index: NDArray[np.intp]
    moments: Floats

    def of(self, index: NDArray[np.intp]) -> Floats:
        found: Floats = self.moments[np.searchsorted(self.index, index)]
        return found


def _side(edges: Floats, index: NDArray[np.intp], highest: float, orders: int) -> _Side:
    held = np.unique(index)
    low, high = edges[held], edges[held + 1]
    nodes = nodes_for(float(low[0]), float(high[-1]), highest)
    moments = nodes.moments(low, high, orders, orders + 2)
    return _Side(point_sources(nodes.position_um), held, moments)


def _folded(index: NDArray[np.intp], count: int) -> NDArray[np.intp]:
    """Intervals left of the axis replaced by their mirror images; one that straddles it stays."""
    return np.maximum(index, count - 1 - index)


def _band(pupil: Pupil, chosen: NDArray[np.intp], along_x: _Side, along_y: _Side) -> NodeGrid:
    rows, columns = pupil.whole.shape
    row, column = _folded(pupil.rim_row[chosen], rows), _folded(pupil.rim_column[chosen], columns)
    below, left = row != pupil.rim_row[chosen], column != pupil.rim_column[chosen]
    orders = along_x.moments.shape[1]
    rim = pupil.moments(orders)
    signs = (-1.0) ** np.arange(orders)
    ny, nx = along_y.positions.count, along_x.positions.count
    quadrants = np.empty((2, 2, ny, nx))
    for flip_y in (0, 1):
        for flip_x in (0, 1):
            cells = np.flatnonzero((below == flip_y) & (left == flip_x))
            # Mirroring an interval multiplies P_p by (-1)^p.
            moments = rim[chosen[cells]] * np.where(flip_y, signs, 1.0)[:, None] * np.where(flip_x, signs, 1.0)
            across = (moments @ along_x.of(column[cells])).reshape(-1, nx)
            np.matmul(along_y.of(row[cells]).reshape(-1, ny).T, across, out=quadrants[flip_y, flip_x])
    # Mirror images add in the even part and subtract in the odd one.
    for turned in (quadrants, quadrants.transpose(1, 0, 2, 3)):
        odd = turned[0] - turned[1]
        turned[0] += turned[1]
        turned[1] = odd
    return NodeGrid(along_x.positions, along_y.positions, quadrants)
