"""Boundaries of shapes as whole numbers: two sets of polygons cover the same points if and only if theirs are equal.

How often polygons cover a point changes where a vertical ray from below crosses their edges. Edges along one line that
run in opposite senses cancel, so that it does not matter how shapes are cut into polygons. What is left of each line is
told by the places at which the change itself changes.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from klayout import db
from numpy.typing import NDArray

from maskfab.base.arrays import Ints, Mask

_HALF = 1 << 31
_ROW = 1 << 32


@dataclass(frozen=True, eq=False)
class Boundary:
    """Boundary of shapes, those of a file or those that are asked for.

    Attributes:
        level: int64 [n], places along horizontal lines in order of y, then x, as :func:`packed` has them.
        change: int64 [n]: beyond its place, a ray that crosses the line gains so much.
        slanted: int64 [m, 5] of dx, dy, dy x - dx y, x and change: the same along lines of another direction, dx > 0
            and dy without a common divisor.
    """

    level: Ints
    change: Ints
    slanted: Ints

    @classmethod
    def none(cls) -> Boundary:
        """The boundary of nothing."""
        return cls(np.empty(0, np.int64), np.empty(0, np.int64), np.empty((0, 5), np.int64))

    @classmethod
    def of_edges(cls, edges: Ints) -> Boundary:
        """Of the edges of polygons that are walked clockwise, int64 [n, 4] of x0, y0, x1, y1."""
        x0, y0, x1, y1 = edges.T
        gain = -np.sign(x1 - x0)
        low, high = np.minimum(x0, x1), np.maximum(x0, x1)
        flat, steep = (y0 == y1) & (gain != 0), (y0 != y1) & (gain != 0)
        level = packed(np.concatenate([low[flat], high[flat]]), np.tile(y0[flat], 2))
        dx, dy = np.abs(x1 - x0)[steep], ((y1 - y0) * np.sign(x1 - x0))[steep]
        common = np.gcd(dx, dy)
        dx, dy = dx // common, dy // common
        line = dy * x0[steep] - dx * y0[steep]
        slanted = [np.column_stack([dx, dy, line, x[steep], s[steep]]) for x, s in ((low, gain), (high, -gain))]
        return total([cls(level, np.concatenate([gain[flat], -gain[flat]]), np.concatenate(slanted))])

    @classmethod
    def of_polygons(cls, polygons: Iterable[Iterable[tuple[int, int]]]) -> Boundary:
        """Of simple polygons that share no area, walked either way."""
        rings = [np.array(list(polygon), dtype=np.int64) for polygon in polygons]
        return cls.of_edges(np.concatenate([np.empty((0, 4), np.int64), *(_walked(ring) for ring in rings)]))

    @classmethod
    def of_raster(cls, x: Ints, y: Ints, clear: Mask) -> Boundary:
        """Of the clear parts, bool [ny, nx], between lines x, int64 [nx + 1], and y, int64 [ny + 1]."""
        change = np.diff(np.diff(np.pad(clear.astype(np.int8), 1), axis=0), axis=1)
        row, column = np.nonzero(change)
        return cls(packed(x[column], y[row]), change[row, column].astype(np.int64), cls.none().slanted)

    @property
    def empty(self) -> bool:
        return not (self.level.size or self.slanted.size)

    @property
    def corners(self) -> Ints:
        """Places at which something changes, int64 [n, 2] of x and y; of slanted lines the nanometre below."""
        dx, dy, line, x, _ = self.slanted.T
        y = (dy * x - line) // np.maximum(dx, 1)
        flat = np.column_stack([(self.level + _HALF) % _ROW - _HALF, (self.level + _HALF) // _ROW])
        return np.concatenate([flat, np.column_stack([x, y])])

    def times(self, factor: int) -> Boundary:
        """Of the same shapes, each counted so often."""
        return Boundary(self.level, factor * self.change, self.slanted * np.array([1, 1, 1, 1, factor]))

    def kept(self, which: Mask) -> Boundary:
        """The part of some of its :attr:`corners`."""
        flat, steep = which[: len(self.level)], which[len(self.level) :]
        return Boundary(self.level[flat], self.change[flat], self.slanted[steep])

    def at(self, places: Ints) -> Boundary:
        """Of the shapes repeated at each place, int64 [n, 2], and nowhere else."""
        level = (packed(*places.T)[:, None] + self.level).ravel()
        steps = np.zeros((len(places), 1, 5), np.int64)
        steps[:, 0, 3] = places[:, 0]
        slanted = self.slanted + steps
        slanted[:, :, 2] += places[:, :1] * self.slanted[:, 1] - places[:, 1:] * self.slanted[:, 0]
        return Boundary(level, np.tile(self.change, len(places)), slanted.reshape(-1, 5))

    def seen(self, x: NDArray[np.float64], y: NDArray[np.float64]) -> NDArray[np.int32]:
        """Number of times that each place of a grid is covered, int32 [ny, nx]; no place lies on an edge.

        Args:
            x: columns, float64 [nx], ascending.
            y: rows, float64 [ny], ascending.
        """
        gains = np.zeros((len(y) + 1, len(x) + 1), dtype=np.int32)
        left, below = self.corners[: len(self.level)].T
        np.add.at(gains, (np.searchsorted(y, below), np.searchsorted(x, left)), self.change)
        gains = np.cumsum(gains, axis=1, dtype=np.int32)
        # Along a slanted line, rays of the columns between one change and the next cross it, each at a row of its own.
        ordered = self.slanted[np.lexsort(self.slanted[:, 3::-1].T)]
        dx, dy, line, start, change = ordered.T
        gain, first = np.cumsum(change), np.searchsorted(x, start)
        begins = np.flatnonzero(np.diff(ordered[:, :3], axis=0, prepend=np.zeros((1, 3), np.int64)).any(axis=1))
        # Each line begins with nothing; the last change of one has no column, also where some of it was left out.
        gain -= np.repeat((gain - change)[begins], np.diff(np.append(begins, len(gain))))
        columns = np.append(first[1:] - first[:-1], 0)
        columns[begins[1:] - 1] = 0
        each = np.repeat(np.arange(len(start)), columns)
        column = np.arange(len(each)) - np.repeat(np.cumsum(columns) - columns - first, columns)
        row = np.searchsorted(y, (dy[each] * x[column] - line[each]) / dx[each])
        np.add.at(gains, (row, column), gain[each])
        return np.asarray(np.cumsum(gains, axis=0, dtype=np.int32)[:-1, :-1])


def packed(x: Ints, y: Ints) -> Ints:
    """Places as whole numbers that add as places do and are in order of y, then x; less than 2^31 either way."""
    return y * _ROW + x


def total(parts: Iterable[Boundary]) -> Boundary:
    """The boundary of all shapes together, in which what cancels is gone."""
    every = [Boundary.none(), *parts]
    level, change = (np.concatenate([getattr(part, name) for part in every]) for name in ("level", "change"))
    gains, losses = (np.sort(level.repeat(np.maximum(sign * change, 0))) for sign in (1, -1))
    if np.array_equal(gains, losses):
        level = change = Boundary.none().level
    else:
        order = np.argsort(level)
        starts = np.flatnonzero(np.diff(level[order], prepend=np.iinfo(np.int64).min))
        sums = np.add.reduceat(change[order], starts)
        level, change = level[order][starts[sums != 0]], sums[sums != 0]
    slanted = np.concatenate([part.slanted for part in every])
    if slanted.size:
        places, index = np.unique(slanted[:, :4], axis=0, return_inverse=True)
        sums = np.bincount(index.ravel(), weights=slanted[:, 4]).astype(np.int64)
        slanted = np.column_stack([places, sums])[sums != 0]
    return Boundary(level, change, slanted)


def _walked(ring: Ints) -> Ints:
    """Edges of a polygon, clockwise."""
    following = np.roll(ring, -1, axis=0)
    edges = np.column_stack([ring, following])
    twice = int(np.sum(ring[:, 0] * following[:, 1] - following[:, 0] * ring[:, 1]))
    return edges if twice < 0 else edges[:, [2, 3, 0, 1]]


@dataclass(frozen=True, eq=False)
class Figures:
    """Polygons of one cell of a file, and where it is placed.

    Attributes:
        edges: int64 [n, 4], clockwise round what is covered.
        owner: int64 [n], the polygon of every edge.
        boxes: int64 [p, 4] of every polygon.
        places: int64 [k, 2], displacements.
    """

    edges: Ints
    owner: Ints
    boxes: Ints
    places: Ints

    @property
    def box(self) -> Ints:
        """Of all polygons together, int64 [4]."""
        return np.concatenate([self.boxes[:, :2].min(axis=0), self.boxes[:, 2:].max(axis=0)])


def figures(layout: db.Layout, layer: db.LayerInfo) -> Iterator[Figures]:
    """Everything that a file draws on a layer: the polygons of each cell once, and the places of the cell.

    Args:
        layout: as it was read, with one top cell and a database unit of 1 nm; a layer is added for a while.
        layer: its number and datatype.
    """
    index = layout.find_layer(layer)
    if index is None or layout.top_cell().bbox(index).empty():
        return
    drawn = [cell for cell in layout.each_cell() if not cell.shapes(index).is_empty()]
    placed = _placements(layout, drawn)
    if placed is None:
        drawn, placed = [layout.top_cell()], [(0, np.eye(2, dtype=np.int64), np.zeros((1, 2), np.int64))]
        shapes = [db.Region(layout.top_cell().begin_shapes_rec(index))]
    else:
        shapes = [db.Region(cell.shapes(index)) for cell in drawn]
    for number, matrix, places in placed:
        yield from _figures(shapes[number], matrix, places)


def _placements(layout: db.Layout, cells: Sequence[db.Cell]) -> list[tuple[int, Ints, Ints]] | None:
    """Number, turn, int64 [2, 2], and displacements in the top cell, int64 [n, 2], of cells; None if one is scaled.

    They are those of triangles that are put into the cells for a moment, their right angles at the origin, one leg, of
    the cell's number from 1, upwards, and one twice as long to the right.
    """
    layer = layout.insert_layer(db.LayerInfo("PLACES"))
    try:
        for number, cell in enumerate(cells, 1):
            corners = ((0, 0), (2 * number, 0), (0, number))
            cell.shapes(layer).insert(db.Polygon([db.Point(*each) for each in corners]))
        found = db.Region(layout.top_cell().begin_shapes_rec(layer))
        points = _rings(found.to_s(found.count()))[0].reshape(-1, 3, 2)
    finally:
        layout.delete_layer(layer)
    legs = np.stack([np.roll(points, step, axis=1) - points for step in (-1, 1)], axis=2)
    square = np.argmin(np.abs((legs[:, :, 0] * legs[:, :, 1]).sum(axis=2)), axis=1)
    places, legs = (each[np.arange(len(points)), square] for each in (points, legs))
    lengths = np.abs(legs).sum(axis=2)
    number = lengths.min(axis=1)
    turns = np.take_along_axis(legs, np.argsort(-lengths, axis=1)[:, :, None], axis=1).transpose(0, 2, 1)
    turns = turns / (number[:, None, None] * np.array([2, 1]))
    if not ((np.abs(turns).sum(axis=1) == 1) & (np.abs(turns).max(axis=1) == 1)).all() or number.max() > len(cells):
        return None
    kinds, kind = np.unique(np.column_stack([number, turns.reshape(-1, 4)]), axis=0, return_inverse=True)
    order = np.argsort(kind.ravel(), kind="stable")
    parts = np.split(places[order], np.flatnonzero(np.diff(kind.ravel()[order])) + 1)
    return [
        (int(each[0]) - 1, each[1:].reshape(2, 2).astype(np.int64), part)
        for each, part in zip(kinds, parts, strict=True)
    ]


def _figures(drawn: db.Region, matrix: Ints, places: Ints) -> Iterator[Figures]:
    """A region's polygons, turned by a matrix."""
    drawn.merged_semantics = False
    count = drawn.count()
    if not count:
        return
    points, ring, hull = _rings(drawn.to_s(count))
    points = points @ matrix.T
    starts = np.flatnonzero(np.diff(ring, prepend=-1))
    following = np.roll(points, -1, axis=0)
    following[np.append(starts[1:], len(points)) - 1] = points[starts]
    twice = np.add.reduceat(points[:, 0] * following[:, 1] - following[:, 0] * points[:, 1], starts)
    # A hull is walked clockwise, and a hole the other way.
    backwards = np.where(hull, twice > 0, twice < 0)[ring]
    edges = np.column_stack([points, following])
    edges[backwards] = edges[backwards][:, [2, 3, 0, 1]]
    owner = (np.cumsum(hull) - 1)[ring]
    first = np.flatnonzero(np.diff(owner, prepend=-1))
    boxes = np.column_stack([np.minimum.reduceat(points, first), np.maximum.reduceat(points, first)])
    yield Figures(edges, owner, boxes, places)


def _rings(text: str) -> tuple[Ints, Ints, Mask]:
    """Points of KLayout's ``(x,y;x,y/x,y;...);(...)``: int64 [n, 2], the ring of each, and which rings are hulls."""
    signs = np.frombuffer(text.encode(), dtype=np.uint8)
    opening = np.flatnonzero((signs == ord("(")) | (signs == ord("/")))
    ring = np.searchsorted(opening, np.flatnonzero(signs == ord(","))) - 1
    numbers = text.translate(dict.fromkeys(map(ord, "(),;/"), " "))
    points = np.fromstring(numbers, dtype=np.int64, sep=" ").reshape(-1, 2)
    return points, ring, signs[opening] == ord("(")
