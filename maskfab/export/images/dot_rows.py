"""Rows of a plotter's dots, one after the other, never the whole plate: dies from their grids, marks by their edges.

Rows between two edges are alike and made once; a plate has far fewer of these than rows.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from maskfab.base.arrays import Ints
from maskfab.geometry.die_grid import die_edges_nm, die_raster
from maskfab.geometry.dot_grid import NM_PER_INCH, DotGrid
from maskfab.jobfile.order import Tone
from maskfab.model import Die, Plate, Polygon

Flags = NDArray[np.bool_]

_MOST_PRODUCT = 2.0**62
"""Beyond it, products are worked out in whole numbers of any length."""


def dot_rows(plate: Plate, grid: DotGrid, tone: Tone, *, upwards: bool) -> Iterator[tuple[bytes, int]]:
    """Rows of dots, eight to a byte, the leftmost in the highest bit; and how often in a row each comes.

    A dot is 1 where the digitized data are: in openings, or where they are dark in the chrome of the writable area.

    Args:
        plate: what is written.
        grid: of dots over its blank.
        tone: of the data.
        upwards: the lowest row first, or the highest.
    """
    dies = [_LaidDie.on(die, grid) for die in plate.dies]
    marks = _Spans.of([p for mark in plate.furniture if mark.layer.written for p in mark.polygons], grid)
    half = plate.writable_nm // 2
    low, high = grid.first(np.array([-half, half])).tolist()
    starts = np.unique(np.concatenate([[0, low, high, grid.side], marks.changes, *(each.rows for each in dies)]))
    parts = list(zip(starts[:-1].tolist(), starts[1:].tolist(), strict=True))
    dots = np.zeros(grid.side, dtype=np.bool_)
    for start, stop in parts if upwards else reversed(parts):
        dots[:] = False
        for die in dies:
            die.add_to(dots, start)
        for left, right in marks.at(start):
            dots[left:right] = True
        if tone == "dark":
            if low <= start < high:
                np.logical_not(dots, out=dots)
                dots[:low] = dots[high:] = False
            else:
                dots[:] = False
        yield np.packbits(dots).tobytes(), stop - start


@dataclass(frozen=True, eq=False)
class _LaidDie:
    """A die over dots.

    Attributes:
        clear: bool [y, x] on the die's own grid.
        across: dots in each column of that grid.
        left: the first of them.
        rows: first dot of each row of that grid, and the one beyond the last.
    """

    clear: Flags
    across: Ints
    left: int
    rows: Ints

    @classmethod
    def on(cls, die: Die, grid: DotGrid) -> _LaidDie:
        x, y = (grid.first(np.rint(edges).astype(np.int64)) for edges in die_edges_nm(die))
        return cls(die_raster(die), np.diff(x), int(x[0]), y)

    def add_to(self, dots: Flags, row: int) -> None:
        if self.rows[0] <= row < self.rows[-1]:
            line = np.repeat(self.clear[int(np.searchsorted(self.rows, row, side="right")) - 1], self.across)
            dots[self.left : self.left + line.size] |= line


@dataclass(frozen=True, eq=False)
class _Spans:
    """Dots of marks, as runs in rows.

    Attributes:
        row: of every run, ascending.
        ends: int64 [n, 2], first dot and the one beyond the last.
        changes: rows that differ from the one below.
    """

    row: Ints
    ends: Ints
    changes: Ints

    @classmethod
    def of(cls, polygons: list[Polygon], grid: DotGrid) -> _Spans:
        found = [_runs(polygon, grid) for polygon in polygons]
        table = np.concatenate(found) if found else np.empty((0, 3), dtype=np.int64)
        table = table[np.lexsort(table.T[::-1])]
        row, ends = table[:, 0], table[:, 1:]
        return cls(row, ends, _changes(row, ends))

    def at(self, row: int) -> list[list[int]]:
        first, last = np.searchsorted(self.row, [row, row + 1])
        runs: list[list[int]] = self.ends[first:last].tolist()
        return runs


def _changes(row: Ints, ends: Ints) -> Ints:
    """Rows whose runs are not those of the row below."""
    rows, first, count = np.unique(row, return_index=True, return_counts=True)
    below = np.searchsorted(rows, rows - 1)
    has = (below < rows.size) & (rows[np.minimum(below, rows.size - 1)] == rows - 1)
    alike = has & (count == count[np.where(has, below, 0)]) if rows.size else has
    of_run = np.repeat(np.arange(rows.size), count)
    place = np.arange(row.size) - first[of_run]
    other = np.where(alike[of_run], first[np.where(has, below, 0)][of_run] + place, np.arange(row.size))
    differs = np.bincount(of_run, weights=(ends[other] != ends).any(axis=1), minlength=rows.size) > 0
    changed = rows[~alike | differs]
    ended = rows[~np.isin(rows + 1, rows)] + 1
    return np.union1d(changed, ended)


def _runs(polygon: Polygon, grid: DotGrid) -> Ints:
    """Runs of dots in a polygon, int64 [n, 3] of row, first dot and the one beyond the last."""
    start = np.array(polygon, dtype=np.int64)
    stop = np.roll(start, -1, axis=0)
    rising = np.where((start[:, 1] <= stop[:, 1])[:, None], np.hstack([start, stop]), np.hstack([stop, start]))
    low, high = grid.first(rising[:, 1]), grid.first(rising[:, 3])
    edge = np.repeat(np.arange(low.size), high - low)
    rows = np.arange(edge.size) - np.repeat(np.cumsum(high - low) - (high - low), high - low) + low[edge]
    dots = _crossed(rising[edge], rows, grid)
    # Along a row, a polygon begins at every odd edge and ends at every even one.
    order = np.lexsort((dots, rows))
    table = np.column_stack([rows[order][::2], dots[order].reshape(-1, 2)])
    return table[table[:, 1] < table[:, 2]]


def _crossed(edges: Ints, rows: Ints, grid: DotGrid) -> Ints:
    """First dots whose centres lie on or to the right of rising edges, int64 [n, 4], in the middle of rows; exact."""
    if not edges.size:
        return rows
    x0, y0, x1, y1 = edges.T
    across, up, inch, scale = x1 - x0, y1 - y0, NM_PER_INCH, 2 * grid.dpi
    above = (2 * rows + 1 - grid.side) * inch - scale * y0
    whole, rest = np.divmod(scale * x0 + (grid.side - 1) * inch, 2 * inch)
    largest = float(np.abs(above).max()) * float(np.abs(across).max()) + 2.0 * inch * float(up.max())
    kind = np.int64 if largest < _MOST_PRODUCT else object
    beyond = rest.astype(kind) * up.astype(kind) + above.astype(kind) * across.astype(kind)
    dots: Ints = np.clip(whole + (-(-beyond // (2 * inch * up.astype(kind)))).astype(np.int64), 0, grid.side)
    return dots
