"""The ways to a far field, one interface: what each accepts, what it costs, how far it errs, and the field itself.

All paths give the same field and differ in what they need. Work is counted in flops of a matrix product, the unit in
which all of them are bounded; a flop of a Fourier transform moves more data and counts as several.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from math import log2
from types import MappingProxyType
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from maskfab.base.arrays import Floats
from maskfab.errors import InternalError
from maskfab.optics.field.cellwise import cell_nodes, cell_refusal, prepare_cells
from maskfab.optics.field.interval_nodes import node_count
from maskfab.optics.field.parity import ParityField, direct_field, parity_of, prepare
from maskfab.optics.field.pruned import prepare_pruned, pruned_refusal, transform_size
from maskfab.optics.field.waves import Precision, is_symmetric
from maskfab.optics.pupil.aperture import Lattice
from maskfab.optics.pupil.pupil import Pupil

# Measured at 512² samples: products of a few hundred rows against transforms of about a thousand points.
_TRANSFORM_FLOP = 12.0
# The same for element-wise work on a grid of frequencies, per point of the quadrant: waves, folding, squares.
_POINT_WORK = 250.0
# Folding an interval into the quadrant, and merely reading it: memory, not arithmetic, sets the pace.
_DOT_WORK = 250.0
_DOT_READ = 80.0
# Moments are gathered into products too thin to run at full speed.
_GATHERING = 4.0
_BYTES = 8


class Prepared(Protocol):
    """A pupil made ready once, for any wavelength."""

    def field(self, u: Floats, v: Floats) -> ParityField:
        """The field at non-negative, ascending frequencies, [nu] and [nv]."""


@dataclass(frozen=True, eq=False)
class FieldTask:
    """A pupil and a grid of frequencies, as far as a path's cost depends on them.

    Attributes:
        x, y: the pupil's lattices.
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


@dataclass(frozen=True, eq=False)
class FieldPath:
    """One way to the far field.

    Attributes:
        name: parity, direct, structure or pruned.
        purpose: what it is good for.
        error: bound of the PSF's relative L2 error, by precision.
        refusal: why a task is not for this path; None if it is.
        flops: work of one wavelength, preparation included, in flops of a matrix product.
        memory: bytes beyond the pupil's own.
        prepare: makes a pupil ready for frequencies up to two highest ones, in a precision.
    """

    name: str
    purpose: str
    error: Mapping[Precision, float]
    refusal: Callable[[FieldTask], str | None]
    flops: Callable[[FieldTask], float]
    memory: Callable[[FieldTask], float]
    prepare: Callable[[Pupil, float, float, Precision], Prepared]

    def field(self, pupil: Pupil, u: Floats, v: Floats, precision: Precision = "double") -> ParityField:
        """The field on the quadrant u, v >= 0, whose symmetric grid ``intensity`` and ``amplitude`` give.

        Args:
            pupil: openings inside the stop.
            u, v: non-negative frequencies in cycles per micrometre, ascending, [nu] and [nv]; both begin at 0 or
                neither does.
            precision: of waves and products.

        Raises:
            InternalError: MF901 if the path refuses the task, or the frequencies are not as they must be.
        """
        _require_quadrant(u, v)
        reason = self.refusal(FieldTask.of(pupil, u, v))
        if reason:
            raise InternalError("MF901", f"the {self.name} path does not take this pupil: {reason}")
        return self.prepare(pupil, float(u[-1]), float(v[-1]), precision).field(u, v)

    @property
    def precisions(self) -> tuple[Precision, ...]:
        """The precisions that the path offers."""
        return tuple(self.error)

    def accepts(self, pupil: Pupil, u: Floats, v: Floats) -> bool:
        """Whether the path takes a pupil and frequencies."""
        return self.refusal(FieldTask.of(pupil, u, v)) is None

    def intensity(self, pupil: Pupil, u: Floats, v: Floats, precision: Precision = "double") -> Floats:
        """|F|² on the symmetric grid that the quadrant spans; arguments and errors as for :meth:`field`."""
        return self.field(pupil, u, v, precision).intensity()

    def amplitude(self, pupil: Pupil, u: Floats, v: Floats, precision: Precision = "double") -> NDArray[np.complex128]:
        """F on the same grid as :meth:`intensity`."""
        return self.field(pupil, u, v, precision).amplitude()


def admissible(task: FieldTask) -> tuple[FieldPath, ...]:
    """The paths that take a task, cheapest first."""
    return tuple(sorted((path for path in PATHS if path.refusal(task) is None), key=lambda path: path.flops(task)))


def field(pupil: Pupil, u: Floats, v: Floats, precision: Precision = "double") -> ParityField:
    """The field by the cheapest path that takes the pupil; see :meth:`FieldPath.field`."""
    return admissible(FieldTask.of(pupil, u, v))[0].field(pupil, u, v, precision)


def _require_quadrant(u: Floats, v: Floats) -> None:
    for frequency in (u, v):
        if not frequency.size or frequency[0] < 0 or (np.diff(frequency) <= 0).any():
            raise InternalError("MF901", "frequencies must be non-negative and ascending")
    if (u[0] == 0) != (v[0] == 0):
        raise InternalError("MF901", "u and v must both begin at 0, or neither")


@dataclass(frozen=True, eq=False)
class _Direct:
    pupil: Pupil
    precision: Precision

    def field(self, u: Floats, v: Floats) -> ParityField:
        above, below = (direct_field(self.pupil, u, sign * v, self.precision) for sign in (1, -1))
        return parity_of(above, below, on_axis=bool(u[0] == 0))


def _prepare_direct(pupil: Pupil, highest_u: float, highest_v: float, precision: Precision) -> Prepared:
    return _Direct(pupil, precision)


def _intervals(lattice: Lattice) -> int:
    return lattice.cells * lattice.period


def _parity_refusal(task: FieldTask) -> str | None:
    return None if task.symmetric else "the parity split needs a lattice that is symmetric about the axis"


def _direct_refusal(task: FieldTask) -> str | None:
    return None


def _structure_refusal(task: FieldTask) -> str | None:
    if not task.symmetric:
        return "the parity split needs a lattice that is symmetric about the axis"
    return "light passes the strips between cells, which belong to no cell" if task.strips_clear else None


def _pruned_refusal(task: FieldTask) -> str | None:
    return pruned_refusal(task.x, task.y, task.rim > 0, task.u, task.v)


def _products(ny: float, nx: float, nv: int, nu: int) -> float:
    """Flops of four parities of waves x core x waves, in the better order."""
    return 8 * min(nv * nx * (ny + nu), nu * ny * (nx + nv))


def _rim_flops(task: FieldTask) -> float:
    """The two bands of a round stop's rim: between 45° and the axes a side is 0.71 long and 0.29 wide, in radii."""
    if not task.rim:
        return 0.0
    long, narrow = _rim_nodes(task)
    orders = 8
    gathering = _GATHERING * 2 * task.rim * orders * long * narrow
    return gathering + 2 * _products(long, narrow, task.v.size, task.u.size)


def _rim_nodes(task: FieldTask) -> tuple[int, int]:
    highest = max(task.u[-1], task.v[-1])
    return node_count(0.71 * task.radius_um, highest), node_count(0.3 * task.radius_um, highest)


def _grid_flops(task: FieldTask) -> float:
    return _POINT_WORK * task.u.size * task.v.size


def _parity_flops(task: FieldTask) -> float:
    ny, nx = _intervals(task.y), _intervals(task.x)
    folding = _DOT_WORK * ny * nx
    return _products(ny / 2, nx / 2, task.v.size, task.u.size) + folding + _rim_flops(task) + _grid_flops(task)


def _parity_memory(task: FieldTask) -> float:
    ny, nx, nv, nu = _intervals(task.y), _intervals(task.x), task.v.size, task.u.size
    return _BYTES * (2 * ny * nx + 2 * (nx * nu + ny * nv) + 12 * nu * nv)


def _direct_flops(task: FieldTask) -> float:
    ny, nx, nv, nu = _intervals(task.y), _intervals(task.x), 2 * task.v.size, task.u.size
    return 8.0 * nv * nx * (ny + nu) + 100 * 8 * nv * (task.rim + nx * nu) * (task.rim > 0) + _grid_flops(task)


def _direct_memory(task: FieldTask) -> float:
    ny, nx, nv, nu = _intervals(task.y), _intervals(task.x), task.v.size, task.u.size
    return 2.0 * _BYTES * (ny * nx + 10 * (nx * nu + ny * nv) + 8 * nu * nv)


def _cell_sources(task: FieldTask) -> tuple[int, int]:
    """Sources along y and x after every cell is reduced to its nodes."""
    return (
        task.y.cells * cell_nodes(task.y, float(task.v[-1])).count,
        task.x.cells * cell_nodes(task.x, float(task.u[-1])).count,
    )


def _structure_flops(task: FieldTask) -> float:
    sources_y, sources_x = _cell_sources(task)
    per_cell_x, per_cell_y = sources_x / task.x.cells, sources_y / task.y.cells
    ny, nx = _intervals(task.y), _intervals(task.x)
    reduction = 2 * per_cell_y * ny * nx + 2 * sources_y * nx * per_cell_x
    rim = 2 * task.rim * 8 * per_cell_x * per_cell_y
    products = _products(sources_y / 2, sources_x / 2, task.v.size, task.u.size)
    passes = _DOT_READ * ny * nx + _DOT_WORK * sources_x * sources_y
    return reduction + passes + rim + products + _grid_flops(task)


def _structure_memory(task: FieldTask) -> float:
    sources_y, sources_x = _cell_sources(task)
    nv, nu = task.v.size, task.u.size
    return _BYTES * (3.0 * sources_x * sources_y + 2 * (sources_x * nu + sources_y * nv) + 12 * nu * nv)


def _pruned_flops(task: FieldTask) -> float:
    along_x, along_y = transform_size(task.x, task.u), transform_size(task.y, task.v)
    # Off the axis the phases of half a step make the rows complex.
    rows = (2.5 if task.u[0] == 0 else 5.0) * _intervals(task.y) * along_x * log2(along_x)
    columns = 5.0 * task.u.size * along_y * log2(along_y)
    return _TRANSFORM_FLOP * (rows + columns) + _rim_flops(task) + _grid_flops(task)


def _pruned_memory(task: FieldTask) -> float:
    along_x, along_y = transform_size(task.x, task.u), transform_size(task.y, task.v)
    return _BYTES * (
        _intervals(task.y) * (_intervals(task.x) + along_x)
        + 4.0 * task.u.size * along_y
        + 16 * task.u.size * task.v.size
    )


def _errors(single: float) -> Mapping[Precision, float]:
    return MappingProxyType({"double": 1e-12, "single": single})


# Sums of hundreds of like terms in single precision are rounded the same way each time, those of cells' equal nodes the
# most; a transform's tree of sums is not.
_OF_PRODUCTS, _OF_CELLS, _OF_TRANSFORMS = _errors(5e-6), _errors(2e-5), _errors(1e-6)

PARITY = FieldPath(
    "parity",
    "any grid of frequencies, any gutters; the best for hundreds of dots across the stop",
    _OF_PRODUCTS,
    _parity_refusal,
    _parity_flops,
    _parity_memory,
    prepare,
)
DIRECT = FieldPath(
    "direct",
    "lattices that are not symmetric about the axis; a check of all others",
    _OF_PRODUCTS,
    _direct_refusal,
    _direct_flops,
    _direct_memory,
    _prepare_direct,
)
STRUCTURE = FieldPath(
    "structure",
    "cells of many fine dots, thousands across the stop",
    _OF_CELLS,
    _structure_refusal,
    _structure_flops,
    _structure_memory,
    prepare_cells,
)
PRUNED = FieldPath(
    "pruned",
    "uniform lattices on a sensor whose step divides λf / dot a whole number of times",
    _OF_TRANSFORMS,
    _pruned_refusal,
    _pruned_flops,
    _pruned_memory,
    prepare_pruned,
)
PATHS = (PARITY, DIRECT, STRUCTURE, PRUNED)
