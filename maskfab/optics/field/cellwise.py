r"""The far field of a panel of many fine dots, cell by cell.

A cell of d dots needs d waves along an axis, but waves change little over a cell: a few Chebyshev nodes, some twenty
more than the highest phase over half a cell, carry its light at all frequencies (see ``nodes``). One small matrix, the
same for all cells because their dots lie in the same places, takes each cell to its nodes; dots that the stop cuts
enter with their moments. What remains is a coarser lattice of sources, which the parity split transforms like dots.

Notes:
    Cells need not be alike. The classical structure factor, sums over like cells times the transform of one, must treat
    the cells that the stop cuts on their own; here they cost no more than others.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from maskfab.base.arrays import Floats
from maskfab.errors import InternalError
from maskfab.optics.field.interval_nodes import Nodes, nodes_for
from maskfab.optics.field.parity import PreparedField, fold, slim_term
from maskfab.optics.field.rim_dots import rim_orders
from maskfab.optics.field.waves import Positions, Precision, is_symmetric
from maskfab.optics.pupil.aperture import Lattice
from maskfab.optics.pupil.pupil import Pupil

_DOT_QUADRATURE = 8


def prepare_cells(pupil: Pupil, highest_u: float, highest_v: float, precision: Precision = "double") -> PreparedField:
    """Reduce every cell of a pupil to nodes, once for all wavelengths.

    Args:
        pupil: openings inside the stop, on symmetric lattices, nothing clear in the gutters.
        highest_u, highest_v: the highest frequencies that will be asked for, cycles per micrometre.
        precision: of the products that follow; the reduction itself is always done in double precision.

    Raises:
        InternalError: MF901 if :func:`cell_refusal` gives a reason.
    """
    reason = cell_refusal(pupil)
    if reason:
        raise InternalError("MF901", reason)
    orders = rim_orders(pupil, highest_u, highest_v)
    along_x = _cell(pupil.x, highest_u, orders)
    along_y = along_x if pupil.x == pupil.y and highest_u == highest_v else _cell(pupil.y, highest_v, orders)
    strength = _whole_strengths(pupil, along_x, along_y)
    _add_rim(pupil, along_x, along_y, strength)
    rows, columns = strength.shape[0] * strength.shape[1], strength.shape[2] * strength.shape[3]
    core = fold(strength.reshape(rows, columns))
    return PreparedField(
        (slim_term(along_x.right_half, along_y.right_half, core, precision),), highest_u, highest_v, precision
    )


def cell_refusal(pupil: Pupil) -> str | None:
    """Why a pupil cannot be reduced cell by cell; None if it can."""
    if not (is_symmetric(pupil.x) and is_symmetric(pupil.y)):
        return "the parity split needs a lattice that is symmetric about the axis"
    across, up = _strips(pupil.x), _strips(pupil.y)
    if pupil.whole[:, across].any() or pupil.whole[up].any():
        return "light passes the strips between cells, which belong to no cell"
    if np.isin(pupil.rim_column, across).any() or np.isin(pupil.rim_row, up).any():
        return "light passes the strips between cells, which belong to no cell"
    return None


def cell_nodes(lattice: Lattice, highest: float) -> Nodes:
    """The nodes of one cell, from the cell's own lower edge."""
    return nodes_for(0.0, lattice.dots * lattice.dot_um, highest)


@dataclass(frozen=True, eq=False)
class _Cell:
    """One axis of a cell and its nodes.

    Attributes:
        whole: float64 [intervals in a period, nodes] strengths from a dot that is clear; zero for the strip.
        rim: float64 [dots, orders, nodes] strengths from a dot's moments.
        right_half: where the nodes of all cells are.
    """

    whole: Floats
    rim: Floats
    right_half: Positions

    @property
    def nodes(self) -> int:
        return int(self.whole.shape[1])


def _cell(lattice: Lattice, highest: float, orders: int) -> _Cell:
    nodes = cell_nodes(lattice, highest)
    edges = lattice.dot_um * np.arange(lattice.dots + 1, dtype=np.float64)
    quadrature = max(_DOT_QUADRATURE, orders + 2)
    rim = nodes.moments(edges[:-1], edges[1:], orders, quadrature)
    whole = np.concatenate([rim[:, 0], np.zeros((1 if lattice.has_gutter else 0, nodes.count))])
    total = lattice.cells * nodes.count
    cell, first = divmod(total // 2, nodes.count)
    coarse = lattice.start_um + lattice.pitch_um * np.arange(cell, lattice.cells, dtype=np.float64)
    return _Cell(whole, rim, Positions(coarse, nodes.position_um, None, first, total - total // 2))


def _whole_strengths(pupil: Pupil, along_x: _Cell, along_y: _Cell) -> Floats:
    """Strengths of all nodes from the dots that the stop leaves whole, [cells y, nodes y, cells x, nodes x]."""
    strength = np.zeros((pupil.y.cells, along_y.nodes, pupil.x.cells, along_x.nodes))
    radius = pupil.stop.diameter_um / 2
    bottom = pupil.y.start_um + pupil.y.pitch_um * np.arange(pupil.y.cells, dtype=np.float64)
    height = pupil.y.dots * pupil.y.dot_um
    nearest = np.clip(np.maximum(bottom, -bottom - height), 0, None)
    left = pupil.x.start_um + pupil.x.pitch_um * np.arange(pupil.x.cells, dtype=np.float64)
    width = pupil.x.dots * pupil.x.dot_um
    of_rows = np.ascontiguousarray(along_y.whole[: pupil.y.dots].T)
    for j in range(pupil.y.cells):
        rows = slice(j * pupil.y.period, j * pupil.y.period + pupil.y.dots)
        chord = np.sqrt(max(radius**2 - nearest[j] ** 2, 0.0)) if pupil.stop.round else radius
        met = np.flatnonzero((left < chord) & (left + width > -chord))
        begin, end = (int(met[0]), int(met[-1]) + 1) if met.size and nearest[j] < radius else (0, 0)
        if pupil.whole[rows, : begin * pupil.x.period].any() or pupil.whole[rows, end * pupil.x.period :].any():
            # A pupil made by hand may have light outside its stop.
            begin, end = 0, pupil.x.cells
        if begin == end:
            continue
        dots = pupil.whole[rows, begin * pupil.x.period : end * pupil.x.period]
        summed = np.zeros((along_y.nodes, (end - begin) * pupil.x.period))
        # The last cell has no strip after it.
        np.matmul(of_rows, dots, out=summed[:, : dots.shape[1]])
        strength[j, :, begin:end] = summed.reshape(along_y.nodes, end - begin, -1) @ along_x.whole
    return strength


def _add_rim(pupil: Pupil, along_x: _Cell, along_y: _Cell, strength: Floats) -> None:
    """Add the cut dots to the nodes of their cells."""
    row, dot_y = np.divmod(pupil.rim_row, pupil.y.period)
    column, dot_x = np.divmod(pupil.rim_column, pupil.x.period)
    orders = along_x.rim.shape[1]
    moments = pupil.moments(orders)
    place = row * pupil.x.cells + column
    order = np.argsort(place, kind="stable")
    for members in np.split(order, np.flatnonzero(np.diff(place[order])) + 1) if order.size else []:
        across = moments[members] @ along_x.rim[dot_x[members]]
        up = along_y.rim[dot_y[members]]
        sources = up.reshape(-1, along_y.nodes).T @ across.reshape(-1, along_x.nodes)
        strength[row[members[0]], :, column[members[0]]] += sources


def _strips(lattice: Lattice) -> NDArray[np.intp]:
    """Numbers of the intervals between cells."""
    if not lattice.has_gutter:
        return np.zeros(0, dtype=np.intp)
    return (lattice.dots + 1) * np.arange(1, lattice.cells, dtype=np.intp) - 1
