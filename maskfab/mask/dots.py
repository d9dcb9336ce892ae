"""Rasters of dots: a die as its own grid of dots and gutters, a plate as a plotter's rows, and their narrowest runs.

A plotter's dots are a square grid about the plate's centre, so that a house that centres the picture moves nothing. A
dot is open if its centre lies in an opening; a centre on the very edge of one does if the opening lies to the right of
it or above: intervals are half-open, so that dots of two that share an edge are neither lost nor told twice. Rows are
made one after the other, never the whole plate, dies from their grids and marks by their edges; those between two edges
are alike and made once, and a plate has far fewer of these than rows.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import scipy

from maskfab.base.arrays import Floats, Ints, Mask
from maskfab.base.model import Die, Plate, Polygon, side_by_side
from maskfab.job.order import Tone

# Shares of pixels that are whole but for rounding become whole.
_DIGITS = 12


def die_edges_nm(die: Die) -> tuple[Floats, Floats]:
    """Grid lines of a die along x and y: the borders of all its dots, cells and gutters."""
    rows, columns = die.panel.orientations.shape
    (x0, y0), cell = die.origin_nm, die.panel.cell_size.edges_nm
    x, y = (
        np.append((np.arange(n)[:, None] * die.panel.pitch_nm + cell[:-1]).ravel(), n * die.panel.pitch_nm)
        for n in (columns, rows)
    )
    return (x + x0).astype(np.float64), (y + y0).astype(np.float64)


def die_raster(die: Die) -> Mask:
    """Raster of a die, bool [y, x], from opening and orientations, on the grid of :func:`die_edges_nm`."""
    panel = die.panel
    pad = 1 if panel.gutter_nm else 0
    variants = np.pad(panel.patterns, ((0, 0), (pad, pad), (pad, pad)))
    return side_by_side(variants[panel.orientations])


def pixel_overlaps(edges: Floats, pixels: Floats) -> scipy.sparse.csr_array:
    """Share of every pixel that lies in every interval, float64 [pixels, intervals].

    With the rows of two axes, ``pixel_overlaps(y) @ raster @ pixel_overlaps(x).T`` is the share of every pixel that
    is clear.

    Args:
        edges: ascending borders of the intervals.
        pixels: ascending borders of the pixels, in the same unit.
    """
    cuts = np.union1d(edges, pixels)
    cuts = cuts[(cuts >= max(edges[0], pixels[0])) & (cuts <= min(edges[-1], pixels[-1]))]
    shape = (pixels.size - 1, edges.size - 1)
    if cuts.size < 2:
        return scipy.sparse.csr_array(shape)
    middles = (cuts[:-1] + cuts[1:]) / 2
    rows = np.searchsorted(pixels, middles, side="right") - 1
    columns = np.searchsorted(edges, middles, side="right") - 1
    shares = np.round(np.diff(cuts) / np.diff(pixels)[rows], _DIGITS)
    return scipy.sparse.csr_array((shares, (rows, columns)), shape=shape)


NM_PER_INCH = 25_400_000


@dataclass(frozen=True)
class DotGrid:
    """Dots of a square picture, ``side`` along x and along y, their distance the whole part of an inch."""

    dpi: int
    side: int

    @classmethod
    def of(cls, plate: Plate, dpi: int) -> DotGrid:
        """The fewest dots that cover the blank."""
        return cls(dpi, -(-plate.blank_nm * dpi // NM_PER_INCH))

    @property
    def dot_nm(self) -> float:
        """Side of a dot."""
        return NM_PER_INCH / self.dpi

    def first(self, edges_nm: Ints) -> Ints:
        """First dots, along x or y, whose centres lie at edges or beyond; exact, and within 0 to ``side``."""
        # The centre of dot k lies at (2 k + 1 - side) inches / (2 dpi).
        beyond = 2 * self.dpi * np.asarray(edges_nm, dtype=np.int64) + (self.side - 1) * NM_PER_INCH
        return np.clip(-(-beyond // (2 * NM_PER_INCH)), 0, self.side)

    def lines_nm(self, dots: Ints) -> Floats:
        """Where dots begin, along x or y."""
        return (2.0 * dots - self.side) * (NM_PER_INCH / 2) / self.dpi


_MOST_PRODUCT = 2.0**62
"""Beyond it, products are worked out in whole numbers of any length."""


def dot_rows(plate: Plate, grid: DotGrid, tone: Tone, *, upwards: bool) -> Iterator[tuple[bytes, int]]:
    """Rows of dots, eight to a byte, the leftmost in the highest bit; and how often in a row each comes.

    A dot is 1 where the digitized data are: in openings, or where they are dark in the chrome of the writable area.
    """
    # Of every die its raster, the dots in each column of it, the first of them, and the first dot of each row.
    dies = []
    for die in plate.dies:
        x, y = (grid.first(np.rint(edges).astype(np.int64)) for edges in die_edges_nm(die))
        dies.append((die_raster(die), np.diff(x), int(x[0]), y))
    row_of_run, ends = _runs_of_marks(plate, grid)
    half = plate.writable_nm // 2
    low, high = grid.first(np.array([-half, half])).tolist()
    starts = np.unique(
        np.concatenate([[0, low, high, grid.side], _changes(row_of_run, ends), *(rows for *_, rows in dies)])
    )
    parts = list(zip(starts[:-1].tolist(), starts[1:].tolist(), strict=True))
    dots = np.zeros(grid.side, dtype=np.bool_)
    for start, stop in parts if upwards else reversed(parts):
        dots[:] = False
        for clear, across, left, rows in dies:
            if rows[0] <= start < rows[-1]:
                line = np.repeat(clear[int(np.searchsorted(rows, start, side="right")) - 1], across)
                dots[left : left + line.size] |= line
        first, last = np.searchsorted(row_of_run, [start, start + 1])
        for left, right in ends[first:last].tolist():
            dots[left:right] = True
        if tone == "dark":
            if low <= start < high:
                np.logical_not(dots, out=dots)
                dots[:low] = dots[high:] = False
            else:
                dots[:] = False
        yield np.packbits(dots).tobytes(), stop - start


def _runs_of_marks(plate: Plate, grid: DotGrid) -> tuple[Ints, Ints]:
    """Dots of the marks as runs: the row of each, ascending, and int64 [n, 2], its first dot and the one beyond."""
    runs = [_runs(polygon, grid) for mark in plate.marks if mark.layer.written for polygon in mark.polygons]
    table = np.concatenate(runs) if runs else np.empty((0, 3), dtype=np.int64)
    table = table[np.lexsort(table.T[::-1])]
    return table[:, 0], table[:, 1:]


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


def corner_touches(clear: Mask) -> int:
    """Number of grid vertices at which exactly two of the four cells are clear, and these lie on a diagonal.

    Writers round corners by about 1 µm, so whether such corners join or part is left to chance.

    Args:
        clear: bool [y, x]; vertices on the border of the array touch fewer than four cells and never count.
    """
    return int(np.count_nonzero(kissing(clear[:-1, :-1], clear[:-1, 1:], clear[1:, :-1], clear[1:, 1:])))


def kissing(lower_left: Mask, lower_right: Mask, upper_left: Mask, upper_right: Mask) -> Mask:
    """Whether exactly two of the four dots at a vertex are clear, and these lie on a diagonal."""
    rising = lower_left & upper_right & ~lower_right & ~upper_left
    return rising | (lower_right & upper_left & ~lower_left & ~upper_right)


@dataclass(frozen=True)
class SmallestRuns:
    """The narrowest features of a raster along the grid's axes, in the unit of its edges; inf where there are none."""

    clear_x: float
    clear_y: float
    opaque_x: float
    opaque_y: float

    @property
    def clear(self) -> float:
        """Smallest clear width along either axis."""
        return min(self.clear_x, self.clear_y)

    @property
    def opaque(self) -> float:
        """Smallest opaque space along either axis."""
        return min(self.opaque_x, self.opaque_y)


def smallest_runs(
    clear: Mask, x_edges: Floats | None = None, y_edges: Floats | None = None, *, periodic: bool = False
) -> SmallestRuns:
    """Smallest clear width and smallest opaque space of a raster.

    A run ends where its neighbour differs. If the raster is not periodic, it is taken to be surrounded by chrome, so
    clear runs end at the border and an opaque run that meets the border is no space. If it is periodic, runs continue
    on the opposite side, and a row or column of one tone has no run. Diagonal distances are not looked at; the
    closest of them are :func:`corner_touches`.

    Args:
        clear: bool [ny, nx].
        x_edges: float64 [nx + 1], ascending; whole dots if None.
        y_edges: float64 [ny + 1], ascending, in the same unit; whole dots if None.
    """
    ny, nx = clear.shape
    x = np.arange(nx + 1.0) if x_edges is None else np.asarray(x_edges, dtype=np.float64)
    y = np.arange(ny + 1.0) if y_edges is None else np.asarray(y_edges, dtype=np.float64)
    shortest = _shortest_periodic if periodic else _shortest
    clear_x, opaque_x = shortest(clear, x)
    clear_y, opaque_y = shortest(clear.T, y)
    return SmallestRuns(clear_x, clear_y, opaque_x, opaque_y)


def _shortest(clear: Mask, edges: Floats) -> tuple[float, float]:
    """Shortest clear and shortest opaque run along axis 1, the raster surrounded by chrome."""
    framed = np.pad(clear, ((0, 0), (1, 1)))  # dark on both sides, so that the rows behind each other are one
    rows, places = np.divmod(np.flatnonzero(framed.ravel()[1:] != framed.ravel()[:-1]), framed.shape[1])
    starts, stops = places[::2], places[1::2]
    spaces = (edges[starts[1:]] - edges[stops[:-1]])[rows[2::2] == rows[:-2:2]]
    return _minimum(edges[stops] - edges[starts]), _minimum(spaces)


def _shortest_periodic(clear: Mask, edges: Floats) -> tuple[float, float]:
    """Shortest clear and shortest opaque run along axis 1 of a raster that repeats."""
    rows, cells = np.nonzero(clear != np.roll(clear, 1, axis=1))
    if rows.size == 0:
        return np.inf, np.inf
    starts, tones = edges[cells], clear[rows, cells]
    opens_row = np.append(True, rows[1:] != rows[:-1])
    closes_row = np.append(opens_row[1:], True)
    stops = np.append(starts[1:], 0.0)
    stops[closes_row] = starts[opens_row] + edges[-1] - edges[0]
    lengths = stops - starts
    return _minimum(lengths[tones]), _minimum(lengths[~tones])


def _minimum(lengths: Floats) -> float:
    return float(lengths.min(initial=np.inf))
