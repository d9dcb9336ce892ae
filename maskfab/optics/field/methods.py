"""The ways to a far field, one interface: what each accepts, what it costs, how far it errs, and the field itself.

All paths give the same field and differ in what they need. Work is counted in flops of a matrix product, the unit in
which all of them are bounded. Fast Fourier transforms that skip what is dark and what is not asked for took two to
three times as long as the parity split wherever a grid suited them, from 500 to 4000 dots across.

**Structure** is for panels of many fine dots, cell by cell. A cell of d dots needs d waves along an axis, but waves
change little over a cell: a few Chebyshev nodes, some twenty more than the highest phase over half a cell, carry its
light at all frequencies (:mod:`maskfab.optics.field.waves`). One small matrix, the same for all cells because their
dots lie in the same places, takes each cell to its nodes; dots that the stop cuts enter with their moments. What
remains is a coarser lattice of sources, which the parity split transforms like dots.

Notes:
    Cells need not be alike. The classical structure factor, sums over like cells times the transform of one, must treat
    the cells that the stop cuts on their own; here they cost no more than others.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import NamedTuple, Protocol

import numpy as np

from maskfab.base.arrays import Complexes, Floats, Indices
from maskfab.base.errors import InternalError
from maskfab.optics.field.matrix import (
    ParityField,
    PreparedField,
    direct_field,
    fold,
    multiplications,
    parity_of,
    prepare,
    rim_orders,
    slim_term,
)
from maskfab.optics.field.waves import (
    Nodes,
    Positions,
    Precision,
    frequency_nodes,
    is_symmetric,
    node_count,
    nodes_for,
)
from maskfab.optics.pupil import Lattice, Pupil

_DOT_QUADRATURE = 8


def prepare_cells(pupil: Pupil, highest_u: float, highest_v: float, precision: Precision = "double") -> PreparedField:
    """Reduce every cell of a pupil to nodes, once for all wavelengths.

    Args:
        pupil: openings inside the stop, on symmetric lattices, nothing clear in the gutters.
        highest_u, highest_v: the highest frequencies that will be asked for, cycles per micrometre.
        precision: of the products that follow; the reduction itself is always done in double precision.
    """
    reason = cell_refusal(pupil)
    if reason:
        raise InternalError("MF901", reason)
    orders = rim_orders(pupil, highest_u, highest_v)
    along_x = _cell(pupil.x, highest_u, orders)
    along_y = along_x if pupil.x == pupil.y and highest_u == highest_v else _cell(pupil.y, highest_v, orders)
    strength = _whole_strengths(pupil, along_x, along_y)
    # Cut dots go to the nodes of their cells.
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
    """One axis of a cell and its nodes: strengths of whole dots, zero for the strip, and of the moments of cut ones."""

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


def _strips(lattice: Lattice) -> Indices:
    if not lattice.has_gutter:
        return np.zeros(0, dtype=np.intp)
    return (lattice.dots + 1) * np.arange(1, lattice.cells, dtype=np.intp) - 1


# What work takes besides products, in flops of those, fitted to the times of 39 scenes. Of
# waves, a value; of dots, one that is folded and one that is merely read; of a rim, itself, a cut dot, and a flop of
# its thin products; of cells, a row of them; of complex products, themselves, a wave, and a cut dot at a frequency.
_WAVE = 400.0
_DOT_WORK, _DOT_READ = 120.0, 20.0
_RIM, _CUT_DOT, _GATHERING, _RIM_ORDERS = 4e7, 2e5, 2.5, 8
_ROW_OF_CELLS = 1.5e6
_DIRECT, _DIRECT_WAVE, _DIRECT_CUT = 7.5e7, 1800.0, 1.25e4
_BYTES = 8


class Prepared(Protocol):
    """A pupil made ready once, for any wavelength."""

    def field(self, u: Floats, v: Floats) -> ParityField:
        """The field at non-negative, ascending frequencies, [nu] and [nv]."""


@dataclass(frozen=True, eq=False)
class FieldTask:
    """A pupil and a grid of frequencies, as far as a path's cost depends on them.

    Attributes:
        radius_um: half the stop's width.
        rim: number of dots that the stop cuts.
        strips_clear: whether light passes between cells.
        u, v: non-negative frequencies in cycles per micrometre, ascending, [nu] and [nv].
    """

    x: Lattice
    y: Lattice
    radius_um: float
    rim: int
    strips_clear: bool
    u: Floats
    v: Floats

    @classmethod
    def of(cls, pupil: Pupil, u: Floats, v: Floats) -> FieldTask:
        """The task of transforming a pupil."""
        strips_clear = not (is_symmetric(pupil.x) and is_symmetric(pupil.y)) or cell_refusal(pupil) is not None
        return cls(pupil.x, pupil.y, pupil.stop.diameter_um / 2, pupil.rim_row.size, strips_clear, u, v)

    @property
    def symmetric(self) -> bool:
        return is_symmetric(self.x) and is_symmetric(self.y)


class Work(NamedTuple):
    """Flops of a matrix product that making a pupil ready takes, in double precision always, and those of every line.

    Attributes:
        once: to make it ready.
        each: of the field at one wavelength.
    """

    once: float
    each: float


@dataclass(frozen=True, eq=False)
class FieldPath:
    """One way to the far field.

    Attributes:
        error: bound of the PSF's relative L2 error, by precision.
        refusal: why a task is not for this path; None if it is.
        memory: bytes beyond the pupil's own.
        prepare: makes a pupil ready for frequencies up to two highest ones, in a precision.
    """

    name: str
    purpose: str
    error: Mapping[Precision, float]
    refusal: Callable[[FieldTask], str | None]
    work: Callable[[FieldTask], Work]
    memory: Callable[[FieldTask], float]
    prepare: Callable[[Pupil, float, float, Precision], Prepared]

    def field(self, pupil: Pupil, u: Floats, v: Floats, precision: Precision = "double") -> ParityField:
        """The field on the quadrant u, v >= 0, whose symmetric grid ``intensity`` and ``amplitude`` give.

        Args:
            u, v: non-negative frequencies in cycles per micrometre, ascending, [nu] and [nv]; both begin at 0 or
                neither does.
        """
        for frequency in (u, v):
            if not frequency.size or frequency[0] < 0 or (np.diff(frequency) <= 0).any():
                raise InternalError("MF901", "frequencies must be non-negative and ascending")
        if (u[0] == 0) != (v[0] == 0):
            raise InternalError("MF901", "u and v must both begin at 0, or neither")
        reason = self.refusal(FieldTask.of(pupil, u, v))
        if reason:
            raise InternalError("MF901", f"the {self.name} path does not take this pupil: {reason}")
        return self.prepare(pupil, float(u[-1]), float(v[-1]), precision).field(u, v)

    @property
    def precisions(self) -> tuple[Precision, ...]:
        """The precisions that the path offers."""
        return tuple(self.error)

    def flops(self, task: FieldTask) -> float:
        """Work of one wavelength, preparation included, in flops of a matrix product."""
        return sum(self.work(task))

    def intensity(self, pupil: Pupil, u: Floats, v: Floats, precision: Precision = "double") -> Floats:
        """|F|² on the symmetric grid that the quadrant spans; arguments and errors as for :meth:`field`."""
        return self.field(pupil, u, v, precision).intensity()

    def amplitude(self, pupil: Pupil, u: Floats, v: Floats, precision: Precision = "double") -> Complexes:
        """F on the same grid as :meth:`intensity`."""
        return self.field(pupil, u, v, precision).amplitude()


def admissible(task: FieldTask) -> tuple[FieldPath, ...]:
    """The paths that take a task, cheapest first."""
    return tuple(sorted((path for path in PATHS if path.refusal(task) is None), key=lambda path: path.flops(task)))


def field(pupil: Pupil, u: Floats, v: Floats, precision: Precision = "double") -> ParityField:
    """The field by the cheapest path that takes the pupil; see :meth:`FieldPath.field`."""
    return admissible(FieldTask.of(pupil, u, v))[0].field(pupil, u, v, precision)


@dataclass(frozen=True, eq=False)
class _Direct:
    pupil: Pupil
    precision: Precision

    def field(self, u: Floats, v: Floats) -> ParityField:
        above, below = (direct_field(self.pupil, u, sign * v, self.precision) for sign in (1, -1))
        return parity_of(above, below, on_axis=bool(u[0] == 0))


def _intervals(lattice: Lattice) -> int:
    return lattice.cells * lattice.period


def _parity_refusal(task: FieldTask) -> str | None:
    return None if task.symmetric else "the parity split needs a lattice that is symmetric about the axis"


def _structure_refusal(task: FieldTask) -> str | None:
    strips = "light passes the strips between cells, which belong to no cell"
    return _parity_refusal(task) or (strips if task.strips_clear else None)


def _product_flops(task: FieldTask, cores: Sequence[tuple[int, int]], reach_um: tuple[float, float]) -> float:
    """Flops of the four parities of waves x cores x waves, and of the waves."""
    nu, nv = task.u.size, task.v.size
    nodes_u, nodes_v = (
        frequency_nodes(reach, float(frequency[-1]), "double")
        for reach, frequency in zip(reach_um, (task.u, task.v), strict=True)
    )
    products, by_nodes = multiplications(cores, nu, nv, nodes_u, nodes_v)
    ends_u, ends_v = (nodes_u.count, nodes_v.count) if by_nodes else (nu, nv)
    # Axes that are alike share their waves; interpolation from nodes counts as twice the waves.
    along_x = sum(nx for _, nx in cores) * ends_u + 2 * by_nodes * ends_u * nu
    along_y = sum(ny for ny, _ in cores) * ends_v + 2 * by_nodes * ends_v * nv
    shared = task.x == task.y and np.array_equal(task.u, task.v)
    return 8.0 * products + 2 * _WAVE * (along_x + (0 if shared else along_y))


def _rim_cores(task: FieldTask) -> list[tuple[int, int]]:
    """The two bands of a round stop's rim: between 45° and the axes a side is 0.71 long and 0.29 wide, in radii."""
    if not task.rim:
        return []
    highest = float(max(task.u[-1], task.v[-1]))
    long, narrow = node_count(0.71 * task.radius_um, highest), node_count(0.3 * task.radius_um, highest)
    return [(long, narrow), (narrow, long)]


def _rim_flops(task: FieldTask, cores: Sequence[tuple[int, int]]) -> float:
    if not cores:
        return 0.0
    long, narrow = cores[0]
    return _RIM + task.rim * (_CUT_DOT + _GATHERING * _RIM_ORDERS * long * narrow)


def _parity_work(task: FieldTask) -> Work:
    ny, nx = _intervals(task.y), _intervals(task.x)
    bands = _rim_cores(task)
    reach = task.x.length_um / 2, task.y.length_um / 2
    products = _product_flops(task, [(ny // 2, nx // 2), *bands], reach)
    return Work(_DOT_WORK * ny * nx + _rim_flops(task, bands), products)


def _parity_memory(task: FieldTask) -> float:
    ny, nx, nv, nu = _intervals(task.y), _intervals(task.x), task.v.size, task.u.size
    return _BYTES * (2 * ny * nx + 2 * (nx * nu + ny * nv) + 12 * nu * nv)


def _direct_work(task: FieldTask) -> Work:
    ny, nx, nv, nu = _intervals(task.y), _intervals(task.x), 2 * task.v.size, task.u.size
    rim = _RIM_ORDERS * 8 * nv * nx * nu + _DIRECT_CUT * task.rim * nv if task.rim else 0.0
    return Work(0.0, _DIRECT + 8.0 * nv * nx * (ny + nu) + _DIRECT_WAVE * (nx * nu + ny * nv) + rim)


def _direct_memory(task: FieldTask) -> float:
    ny, nx, nv, nu = _intervals(task.y), _intervals(task.x), task.v.size, task.u.size
    return 2.0 * _BYTES * (ny * nx + 10 * (nx * nu + ny * nv) + 8 * nu * nv)


def _cell_sources(task: FieldTask) -> tuple[int, int]:
    """Sources along y and x after every cell is reduced to its nodes."""
    return (
        task.y.cells * cell_nodes(task.y, float(task.v[-1])).count,
        task.x.cells * cell_nodes(task.x, float(task.u[-1])).count,
    )


def _structure_work(task: FieldTask) -> Work:
    sources_y, sources_x = _cell_sources(task)
    per_cell_x, per_cell_y = sources_x / task.x.cells, sources_y / task.y.cells
    ny, nx = _intervals(task.y), _intervals(task.x)
    reduction = 2 * per_cell_y * ny * nx + 2 * sources_y * nx * per_cell_x
    rim = (_RIM + 2 * task.rim * _RIM_ORDERS * per_cell_x * per_cell_y) if task.rim else 0.0
    products = _product_flops(task, [(sources_y // 2, sources_x // 2)], (task.x.length_um / 2, task.y.length_um / 2))
    passes = _DOT_READ * ny * nx + _DOT_WORK * sources_x * sources_y + _ROW_OF_CELLS * task.y.cells
    return Work(reduction + passes + rim, products)


def _structure_memory(task: FieldTask) -> float:
    sources_y, sources_x = _cell_sources(task)
    nv, nu = task.v.size, task.u.size
    return _BYTES * (3.0 * sources_x * sources_y + 2 * (sources_x * nu + sources_y * nv) + 12 * nu * nv)


def _errors(single: float) -> Mapping[Precision, float]:
    return MappingProxyType({"double": 1e-12, "single": single})


# Sums of hundreds of like terms in single precision are rounded the same way each time, those of cells' equal nodes the
# most.
_OF_PRODUCTS, _OF_CELLS = _errors(5e-6), _errors(2e-5)

PARITY = FieldPath(
    "parity",
    "any grid of frequencies, any gutters; the best for hundreds of dots across the stop",
    _OF_PRODUCTS,
    _parity_refusal,
    _parity_work,
    _parity_memory,
    prepare,
)
DIRECT = FieldPath(
    "direct",
    "lattices that are not symmetric about the axis; a check of all others",
    _OF_PRODUCTS,
    lambda task: None,
    _direct_work,
    _direct_memory,
    lambda pupil, highest_u, highest_v, precision: _Direct(pupil, precision),
)
STRUCTURE = FieldPath(
    "structure",
    "cells of many fine dots, thousands across the stop",
    _OF_CELLS,
    _structure_refusal,
    _structure_work,
    _structure_memory,
    prepare_cells,
)
PATHS = (PARITY, DIRECT, STRUCTURE)
