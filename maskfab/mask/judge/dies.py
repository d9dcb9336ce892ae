"""Dies that a job asks for, dot by dot, and the boundaries of shapes, whole numbers by which files are compared.

Rows count from below and columns from the left, from 0. The rules are those of ``docs/reference/layout.md``.

How often polygons cover a point changes where a vertical ray from below crosses their edges. Edges along one line that
run in opposite senses cancel, so that it does not matter how shapes are cut into polygons: two sets of them cover the
same points if and only if their boundaries are equal. What is left of each line is told by the places at which the
change itself changes."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from klayout import db
from numpy.typing import NDArray

from maskfab.base.arrays import Ints, Mask
from maskfab.base.model import Scalar
from maskfab.base.units import NM_PER_UM
from maskfab.job.die import DieSection
from maskfab.job.sections import JobSpec
from maskfab.mask.judge.sources import Sources, digits

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
        """Boundary of edges of polygons that are walked clockwise, int64 [n, 4] of x0, y0, x1, y1."""
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
        """Boundary of simple polygons that share no area, walked either way."""
        rings = [np.array(list(polygon), dtype=np.int64) for polygon in polygons]
        return cls.of_edges(np.concatenate([np.empty((0, 4), np.int64), *(_walked(ring) for ring in rings)]))

    @classmethod
    def of_raster(cls, x: Ints, y: Ints, clear: Mask) -> Boundary:
        """Boundary of clear parts, bool [ny, nx], between lines x, int64 [nx + 1], and y, int64 [ny + 1]."""
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
        return np.concatenate([unpacked(self.level), np.column_stack([x, y])])

    def times(self, factor: int) -> Boundary:
        """Boundary of these shapes, each counted so often."""
        return Boundary(self.level, factor * self.change, self.slanted * np.array([1, 1, 1, 1, factor]))

    def kept(self, which: Mask) -> Boundary:
        """The part of some of its :attr:`corners`."""
        flat, steep = which[: len(self.level)], which[len(self.level) :]
        return Boundary(self.level[flat], self.change[flat], self.slanted[steep])

    def at(self, places: Ints) -> Boundary:
        """Boundary of these shapes, repeated at each place, int64 [n, 2], and nowhere else."""
        level = (packed(*places.T)[:, None] + self.level).ravel()
        steps = np.zeros((len(places), 1, 5), np.int64)
        steps[:, 0, 3] = places[:, 0]
        slanted = self.slanted + steps
        slanted[:, :, 2] += places[:, :1] * self.slanted[:, 1] - places[:, 1:] * self.slanted[:, 0]
        return Boundary(level, np.tile(self.change, len(places)), slanted.reshape(-1, 5))

    def seen(self, x: NDArray[np.float64], y: NDArray[np.float64]) -> NDArray[np.int32]:
        """Times each place of a grid is covered, int32 [ny, nx], at ascending float64 x and y; none lies on an edge."""
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
        owner = np.repeat(np.arange(len(start)), columns)
        column = np.arange(len(owner)) - np.repeat(np.cumsum(columns) - columns - first, columns)
        row = np.searchsorted(y, (dy[owner] * x[column] - line[owner]) / dx[owner])
        np.add.at(gains, (row, column), gain[owner])
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


def unpacked(places: Ints) -> Ints:
    """Places as they were before they were :func:`packed`, int64 [n, 2]."""
    return np.column_stack([(places + _HALF) % _ROW - _HALF, (places + _HALF) // _ROW])


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
        """Hull of all polygons together, int64 [4]."""
        return np.concatenate([self.boxes[:, :2].min(axis=0), self.boxes[:, 2:].max(axis=0)])


def figures(layout: db.Layout, *layers: db.LayerInfo) -> Iterator[tuple[db.LayerInfo, Figures]]:
    """Polygons of each cell once and its places, on layers (number, datatype) of a layout of 1 nm and one top cell."""
    top = layout.top_cell()
    there = [(layer, index) for layer in layers if (index := layout.find_layer(layer)) is not None]
    there = [(layer, index) for layer, index in there if not top.bbox(index).empty()]
    drawn = [cell for cell in layout.each_cell() if not all(cell.shapes(index).is_empty() for _, index in there)]
    placed = _placements(layout, drawn) if there else []
    for layer, index in there:
        if placed is None:
            region = db.Region(top.begin_shapes_rec(index))
            found = _figures(region, np.eye(2, dtype=np.int64), np.zeros((1, 2), np.int64))
            yield from ((layer, figure) for figure in found)
            continue
        for number, matrix, places in placed:
            found = _figures(db.Region(drawn[number].shapes(index)), matrix, places)
            yield from ((layer, figure) for figure in found)


def _placements(layout: db.Layout, cells: Sequence[db.Cell]) -> list[tuple[int, Ints, Ints]] | None:
    """Number, turn, int64 [2, 2], and displacements in the top cell, int64 [n, 2], of cells; None if one is slanted.

    Edges put into the cells for a moment tell them: right by twice the cell's number from 1, up by the number.
    """
    if any(instance.is_complex() for cell in layout.each_cell() for instance in cell.each_inst()):
        return None
    layer = layout.insert_layer(db.LayerInfo("PLACES"))
    try:
        for number, cell in enumerate(cells, 1):
            cell.shapes(layer).insert(db.Edge(0, 0, 2 * number, number))
        edges = db.Edges(layout.top_cell().begin_shapes_rec(layer))
        edges.merged_semantics = False
        ends = _numbers(edges.to_s(edges.count())).reshape(-1, 2, 2)
    finally:
        layout.delete_layer(layer)
    legs = ends[:, 1] - ends[:, 0]
    lengths = np.abs(legs)
    mirrored = (lengths[:, 0] > lengths[:, 1]) != (legs[:, 0] * legs[:, 1] > 0)
    places, legs = ends[np.arange(len(ends)), mirrored.astype(np.intp)], np.where(mirrored[:, None], -legs, legs)
    number = lengths.min(axis=1)
    _, first, kind = np.unique(packed(*legs.T), return_index=True, return_inverse=True)
    order = np.argsort(kind, kind="stable")
    parts = np.split(places[order], np.flatnonzero(np.diff(kind[order])) + 1)
    turns = [np.diag(np.sign(leg))[:, :: 1 if abs(leg[0]) > abs(leg[1]) else -1] for leg in legs[first]]
    return list(zip((number[first] - 1).tolist(), turns, parts, strict=True))


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
    return _numbers(text).reshape(-1, 2), ring, signs[opening] == ord("(")


def _numbers(text: str) -> Ints:
    return np.fromstring(text.translate(dict.fromkeys(map(ord, "(),;/"), " ")), dtype=np.int64, sep=" ")


_TURNS = {
    "random": (0, 1, 2, 3, 4, 5, 6, 7),
    "map": (0, 1, 2, 3, 4, 5, 6, 7),
    "paper4": (0, 5, 4, 3),
    "flips": (0, 2, 4, 6),
    "periodic": (0,),
    "rot90": ((0, 1), (3, 2)),
    "rot90flip": ((0, 5), (7, 2)),
}
"""Turns that cells draw from or, for the last two, blocks of 2 x 2 cells from the lower row upwards."""
_REACH = 6


@dataclass(frozen=True, eq=False)
class AskedDie:
    """A die as the job asks for it.

    Attributes:
        centre: of its slot, nanometres.
        slot: side of it.
        turns: int64 [rows, columns], of every cell.
        x: lines along which dots and gutters end, int64 [nx + 1].
        y: int64 [ny + 1].
        clear: bool [ny, nx], between lines.
        narrowest: shortest clear run of its openings, or a dot where no run ends, nanometres.
    """

    name: str
    label: str
    centre: tuple[int, int]
    slot: int
    dot: int
    pitch: int
    gutter: int
    turns: Ints
    x: Ints
    y: Ints
    clear: Mask
    narrowest: int

    @property
    def box(self) -> tuple[int, int, int, int]:
        return int(self.x[0]), int(self.y[0]), int(self.x[-1]), int(self.y[-1])


def asked_dies(spec: JobSpec, held: Sources) -> tuple[AskedDie, ...]:
    """Every die of a job, in its order, before the plate is mirrored."""
    section = spec.plate
    assert section is not None
    slot, pitch = to_nm(section.die_size), to_nm(section.die_pitch)
    columns = min(section.columns, len(spec.die))
    rows = math.ceil(len(spec.die) / columns)
    left, top = math.floor(-(columns - 1) * pitch / 2), math.floor((rows - 1) * pitch / 2)
    return tuple(
        _die(
            die.model_copy(update={"seed": held.seeds[number]}),
            [opening > 0 for opening in held.openings[number]],
            held.maps[number],
            (left + number % columns * pitch, top - number // columns * pitch),
            slot,
        )
        for number, die in enumerate(spec.die)
    )


def _die(
    die: DieSection, shapes: list[Mask], given: Mapping[str, Any] | None, centre: tuple[int, int], slot: int
) -> AskedDie:
    side, dot, gutter = slot if die.size is None else to_nm(die.size), to_nm(die.dot), to_nm(die.gutter)
    dots = len(shapes[0])
    rows = columns = side // (dots * dot + gutter)
    if die.tiling == "hexagonal":
        shapes = [_hexagonal(shapes[0], side // dot, die.seed or 0)]
        dots, rows, columns = len(shapes[0]), 1, 1
        cells: NDArray[np.int64] = np.zeros((1, 1), np.int64)
    elif given is not None:
        turns = digits(given["map"])
        held = digits(given["openings"]) if "openings" in given else 0 * turns
        if given.get("shifts"):
            shapes = [np.roll(shapes[0], (up, right), axis=(0, 1)) for right, up in given["shifts"]]
        rows, columns = (room - (room - have) % 2 for room, have in zip((rows, columns), turns.shape, strict=True))
        if "beyond" in given:
            opening, turn = given["beyond"]
            cells = np.full((rows, columns), 8 * opening + turn, dtype=np.int64)
        else:
            cells = _tiled("map", rows, columns, die.seed, len(shapes))
        _put_in_the_middle(cells, 8 * held + turns)
    elif die.tiling == "blue_noise":
        cells = _blue_noise(8 * len(shapes), rows, columns, die.seed or 0)
    else:
        cells = _tiled(str(die.tiling), rows, columns, die.seed, len(shapes))
    pitch = dots * dot + gutter
    x, y = (_lines(count, dots, dot, gutter) for count in (columns, rows))
    clear, rim = np.zeros((len(y) - 1, len(x) - 1), dtype=np.bool_), 1 if gutter else 0
    every = np.stack([turned(shape, turn) for shape in shapes for turn in range(8)])[cells]
    for row in range(dots):
        for column in range(dots):
            clear[row + rim :: dots + rim, column + rim :: dots + rim] = every[:, :, row, column]
    corner = centre[0] - columns * pitch // 2, centre[1] - rows * pitch // 2
    narrowest = min((run for shape in shapes for run in _runs(shape)), default=1) * dot
    x, y = corner[0] + x, corner[1] + y
    return AskedDie(die.name, die.label, centre, slot, dot, pitch, gutter, cells % 8, x, y, clear, narrowest)


def to_nm(length_um: float) -> int:
    """Whole nanometres of a length in micrometres."""
    return round(length_um * NM_PER_UM)


def _lines(cells: int, dots: int, dot: int, gutter: int) -> Ints:
    """Where dots and gutters of so many cells end: half a gutter, the dots, a gutter, the dots, and so on."""
    if not gutter:
        return np.arange(cells * dots + 1, dtype=np.int64) * dot
    widths = [gutter // 2, *([*[dot] * dots, gutter] * cells)[:-1], gutter // 2]
    return np.concatenate([[0], np.cumsum(widths)]).astype(np.int64)


def turned(shape: NDArray[Scalar], turn: int) -> NDArray[Scalar]:
    """An opening mirrored left to right for turns 4 to 7, then turned counter-clockwise by quarters, turn modulo 4."""
    if turn >= 4:
        shape = shape[:, ::-1]
    for _ in range(turn % 4):
        shape = shape[::-1].T  # what lies to the right goes up, and what lies above to the left
    return shape


def _tiled(tiling: str, rows: int, columns: int, seed: int | None, openings: int) -> Ints:
    """Contents of each cell: 8 times the opening's number and the turn."""
    draw, turns = np.random.default_rng(seed), np.array(_TURNS[tiling])
    if turns.ndim == 2:
        cells = turns[np.arange(rows)[:, None] % 2, np.arange(columns) % 2]
    elif tiling == "periodic":
        cells = np.zeros((rows, columns), dtype=np.int64)
    else:
        cells = turns[draw.integers(len(turns), size=(rows, columns))]
    return cells + 8 * draw.integers(openings, size=(rows, columns)) if openings > 1 else cells


def _put_in_the_middle(cells: Ints, given: Ints) -> None:
    """Overwrite the middle of a panel by a map, or all of it by the map's middle."""
    room, have = np.array(cells.shape), np.array(given.shape)
    to, start, size = np.maximum(room - have, 0) // 2, np.maximum(have - room, 0) // 2, np.minimum(room, have)
    cells[to[0] : to[0] + size[0], to[1] : to[1] + size[1]] = given[
        start[0] : start[0] + size[0], start[1] : start[1] + size[1]
    ]


def _blue_noise(kinds: int, rows: int, columns: int, seed: int) -> Ints:
    """Equal cells kept apart by swaps; whole numbers alone decide, so that any machine comes to the same map."""
    draw = np.random.default_rng(seed)
    size = rows * columns
    cells = draw.permutation(np.arange(size) % kinds).reshape(rows, columns)
    repels = np.zeros((rows, columns), dtype=np.int64)
    for up in range(-_REACH, _REACH + 1):
        for right in range(-_REACH, _REACH + 1):
            repels[up % rows, right % columns] += round(2**20 * math.exp(-(up * up + right * right) / 4.5))
    up_to, right_to = np.nonzero(repels)
    # felt[k, cell]: how much all cells of kind k together repel one that stands there.
    felt = np.zeros((kinds, rows, columns), dtype=np.int64)
    for row in range(rows):
        for column in range(columns):
            np.add.at(
                felt[cells[row, column]], ((row + up_to) % rows, (column + right_to) % columns), repels[up_to, right_to]
            )
    for _ in range(6):
        swaps = 0
        for one in draw.permutation(size):
            here, mine = divmod(int(one), columns), int(cells.flat[one])
            others = draw.integers(size, size=24)
            there_up, there_right = np.divmod(others, columns)
            theirs = cells[there_up, there_right]
            between = repels[(there_up - here[0]) % rows, (there_right - here[1]) % columns]
            gain = felt[mine][here] - felt[theirs, here[0], here[1]]
            gain = gain + felt[theirs, there_up, there_right] - felt[mine, there_up, there_right]
            gain = np.where(theirs == mine, 0, gain + 2 * (between - repels[0, 0]))
            best = int(np.argmax(gain))
            if gain[best] > 0:
                there, its = (int(there_up[best]), int(there_right[best])), int(theirs[best])
                for place, comes, goes in ((here, its, mine), (there, mine, its)):
                    around = (place[0] + up_to) % rows, (place[1] + right_to) % columns
                    np.add.at(felt[comes], around, repels[up_to, right_to])
                    np.subtract.at(felt[goes], around, repels[up_to, right_to])
                cells[here], cells[there] = its, mine
                swaps += 1
        if not swaps:
            break
    return np.asarray(cells, dtype=np.int64)


def _hexagonal(shape: Mask, dots: int, seed: int) -> Mask:
    """A sheet of hexagonal cells, as wide from flat to flat as the opening, each turned by a multiple of 60 degrees."""
    width = len(shape)
    rise = width * math.sqrt(3) / 2
    rows, columns = math.ceil(dots / rise) + 3, math.ceil(dots / width) + 3
    turns = np.random.default_rng(seed).integers(6, size=(rows, columns))
    middle = np.arange(dots) + 0.5 - dots / 2
    y, x = np.meshgrid(middle, middle, indexing="ij")
    cells = []
    for row in (np.floor(y / rise), np.floor(y / rise) + 1):
        column = np.rint((x - width / 2 * (row % 2)) / width)
        away_x, away_y = x - width / 2 * (row % 2) - column * width, y - row * rise
        turn = turns[(row.astype(int) + rows // 2) % rows, (column.astype(int) + columns // 2) % columns]
        cells.append((away_x**2 + away_y**2, away_x, away_y, turn))
    upper = cells[1][0] < cells[0][0]
    right, up, turn = (np.where(upper, cells[1][k], cells[0][k]) for k in (1, 2, 3))
    angle = -np.pi / 3 * turn
    column = np.floor(right * np.cos(angle) - up * np.sin(angle) + width / 2).astype(int)
    row = np.floor(right * np.sin(angle) + up * np.cos(angle) + width / 2).astype(int)
    inside = (column >= 0) & (column < width) & (row >= 0) & (row < width)
    return np.asarray(inside & shape[np.clip(row, 0, width - 1), np.clip(column, 0, width - 1)])


def _runs(shape: Mask) -> Iterator[int]:
    """Dots of the shortest clear run in every row and column of an opening that repeats, where one ends."""
    for line in (*shape, *shape.T):
        if line.any() and not line.all():
            ends = np.flatnonzero(~np.roll(line, -int(np.argmin(line))))
            runs = np.diff(np.append(ends, len(line))) - 1
            yield int(runs[runs > 0].min())


def narrowed(x: Ints, y: Ints, clear: Mask, bias: int) -> tuple[Ints, Ints, Mask]:
    """Lines and what is clear between them when every edge has moved inwards by half a bias; outwards if negative.

    Every line becomes two, half the bias to either side. What lies between them is clear where the parts on both sides
    are, or with a negative bias where one is: along x, then along y.
    """
    for _ in range(2):
        padded = np.pad(clear, ((0, 0), (1, 1)))
        joined = padded[:, 1:] & padded[:, :-1] if bias > 0 else padded[:, 1:] | padded[:, :-1]
        parts = np.empty((clear.shape[0], 2 * clear.shape[1] + 1), dtype=np.bool_)
        parts[:, ::2], parts[:, 1::2] = joined, clear
        lines = np.sort(np.concatenate([x - abs(bias) // 2, x + abs(bias) // 2]))
        x, y, clear = y, lines, parts.T
    return x, y, clear


def boundary(die: AskedDie, bias: int) -> Boundary:
    """Clear parts of a die in data of which edges have moved by half a bias."""
    x, y, clear = die.x, die.y, die.clear
    if bias:
        # Without a dark rim, whose outer line could pass the edges of dots when both are moved.
        inner = slice(1, -1) if not (clear[[0, -1]].any() or clear[:, [0, -1]].any()) else slice(None)
        x, y, clear = narrowed(x[inner], y[inner], clear[inner, inner], bias)
    return Boundary.of_raster(x, y, clear)


def mirrored(die: AskedDie) -> AskedDie:
    """The die with left and right exchanged about the plate's middle."""
    # A mirror after a turn counter-clockwise is one clockwise after a mirror.
    mirror, quarters = np.divmod(die.turns[:, ::-1], 4)
    turns, centre = 4 * (1 - mirror) + -quarters % 4, (-die.centre[0], die.centre[1])
    return replace(die, centre=centre, turns=turns, x=-die.x[::-1], clear=die.clear[:, ::-1])


def by_die(figure: Figures, dies: Sequence[AskedDie]) -> Iterator[tuple[int, Boundary]]:
    """The polygons that lie within a die, by its number, and all others under the number of dies."""
    if len(figure.places) > 1:
        whole = Boundary.of_edges(figure.edges)
        for number, placed in groups(die_of(figure.box + np.tile(figure.places, 2), dies)):
            yield number, whole.at(figure.places[placed])
        return
    owner = die_of(figure.boxes + np.tile(figure.places, 2), dies)[figure.owner]
    for number, edges in groups(owner):
        yield number, Boundary.of_edges(figure.edges[edges]).at(figure.places)


def groups(owner: Ints) -> Iterator[tuple[int, Ints]]:
    """Indices of all that have the same owner, by owner."""
    order = np.argsort(owner, kind="stable")
    for part in np.split(order, np.flatnonzero(np.diff(owner[order])) + 1):
        yield int(owner[part[0]]), part


def die_of(boxes: Ints, dies: Sequence[AskedDie]) -> Ints:
    """The number of the die that holds each box, or how many dies there are."""
    guess = nearest_die(boxes, dies)
    limits = np.array([*(die.box for die in dies), (0, 0, -1, -1)], dtype=np.int64)[guess]
    held = (boxes[:, :2] >= limits[:, :2]).all(axis=1) & (boxes[:, 2:] <= limits[:, 2:]).all(axis=1)
    return np.where(held, guess, len(dies))


def nearest_die(boxes: Ints, dies: Sequence[AskedDie]) -> Ints:
    """The number of the die in whose slot's room each box has its middle, or how many dies there are."""
    lines, nearest = [], []
    for axis, middle in ((k, (boxes[:, k] + boxes[:, k + 2]) / 2) for k in (0, 1)):
        lines.append(np.unique([die.centre[axis] for die in dies]))
        nearest.append(np.searchsorted((lines[axis][1:] + lines[axis][:-1]) / 2, middle))
    number = np.full([len(line) for line in lines], len(dies))
    for count, die in enumerate(dies):
        number[tuple(np.searchsorted(lines[axis], die.centre[axis]) for axis in (0, 1))] = count
    return np.asarray(number[nearest[0], nearest[1]])
