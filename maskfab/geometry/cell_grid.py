"""Grids of cells, placed in a layout by records of GDSII in memory.

Inserted one by one, ten thousand references of klayout take longer than all else that a plate is drawn by.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from klayout import db
from numpy.typing import NDArray

from maskfab.geometry.outline_records import LIBRARY, LIBRARY_END, STRUCTURE_END, read_records, structure
from maskfab.model import Point

DBU_UM = 0.001

_SREF, _SNAME, _XY, _ENDEL = b"\x00\x04\x0a\x00", b"\x12\x06", b"\x00\x0c\x10\x03", b"\x00\x04\x11\x00"
_AT_ORIGIN = _XY + bytes(8) + _ENDEL


@dataclass(frozen=True, eq=False)
class CellArray:
    """Cells in rows and columns, none mirrored, turned or scaled.

    Attributes:
        cells: names.
        index: int64 [rows, columns] into ``cells``, row 0 lowest.
        origin_nm: of the cell [0, 0], in coordinates of the die.
        step_nm: along x and y.
    """

    cells: tuple[str, ...]
    index: NDArray[np.int64]
    origin_nm: Point
    step_nm: Point


def placed(names: Iterable[str], grids: Mapping[str, Sequence[CellArray]]) -> db.Layout:
    """A layout of empty cells and of the grids in some of them.

    A grid of one cell is one array; of others every place has a reference. Database unit: 1 nm. Cells are in the order
    of their names, except that one comes first which neither has grids nor is in any.

    Args:
        names: of all cells; one at least, such as the top cell, neither has grids nor is in any.
        grids: by the name of the cell that they fill; not all cells have some.
    """
    ordered = sorted(names)
    among = {*grids, *(cell for filled in grids.values() for grid in filled for cell in grid.cells)}
    first = next(name for name in ordered if name not in among)
    ordered.remove(first)
    # Cells are made where they are first named: so the first one places all others, for a moment.
    stream = [LIBRARY, structure(first), *(_head(name) + _AT_ORIGIN for name in ordered), STRUCTURE_END]
    for name in ordered:
        stream += [structure(name), *(_references(grid) for grid in grids.get(name, ())), STRUCTURE_END]
    layout = db.Layout()
    read_records(layout, b"".join([*stream, LIBRARY_END]))
    layout.cell(first).clear_insts()
    layout.clear_meta_info()  # of the stream, which would be written with the plate
    layout.dbu = DBU_UM
    for name, filled in grids.items():
        for grid in filled:
            if len(grid.cells) == 1:
                layout.cell(name).insert(_array(layout, grid))
    return layout


def _array(layout: db.Layout, grid: CellArray) -> db.CellInstArray:
    (dx, dy), (rows, columns) = grid.step_nm, grid.index.shape
    index = layout.cell(grid.cells[0]).cell_index()
    return db.CellInstArray(index, db.Trans(*grid.origin_nm), db.Vector(dx, 0), db.Vector(0, dy), columns, rows)


def _references(grid: CellArray) -> bytes:
    if len(grid.cells) == 1:
        return b""
    width = max(map(len, grid.cells))
    heads = [_head(name, width) for name in grid.cells]
    # A record for each kind of cell, its place still to be written.
    kinds = np.frombuffer(b"".join(head + _AT_ORIGIN for head in heads), dtype=np.uint8).reshape(len(heads), -1)
    rows, columns = grid.index.shape
    places = np.empty((rows, columns, 2), dtype=">i4")
    places[..., 0] = grid.origin_nm[0] + grid.step_nm[0] * np.arange(columns)
    places[..., 1] = grid.origin_nm[1] + grid.step_nm[1] * np.arange(rows)[:, None]
    records, start = kinds[grid.index.ravel()], len(heads[0]) + len(_XY)
    records[:, start : start + places.itemsize * 2] = places.reshape(-1, 2).view(np.uint8)
    return records.tobytes()


def _head(name: str, width: int = 0) -> bytes:
    """SREF and SNAME, the name filled up to that width."""
    width = max(width, len(name))
    width += width % 2
    return _SREF + (4 + width).to_bytes(2, "big") + _SNAME + name.encode("ascii").ljust(width, b"\0")
