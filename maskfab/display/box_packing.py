"""Rectangles packed into free cells of a square grid, each a gap from the next, or a proof that they cannot be.

A box and the gap on its upper and its right side are one larger rectangle. Boxes are a gap apart exactly if these share
no cell, and only the box itself must lie on free cells. Pushed down and left as far as they go, boxes stand on whole
cells wherever sizes, gaps and the free area are whole cells, so nothing is lost by the grid.

Places of all boxes are sought by rules of thumb, by a search that takes a box and tries all its places, and by taking
some boxes out and laying them anew. Proofs are of three kinds:

* A box has no place at all, which is exact.
* Points do not suffice. Lines lie across the area where boxes may lie, never further apart than a box and its gap are
  high, and on each of them points, never further apart than these are wide. Then every box covers one point at least,
  and no two cover the same, so that there are no more boxes than points. Lines and points are laid so that few lie in
  the area. Points in every cell are the bound of area; those as far apart as boxes show corridors too narrow for two
  abreast, and separate areas each with a rest that no box fills.
* The search ends without places for all, having left nothing out.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations, product

import numpy as np
import scipy

from maskfab.base.arrays import Indices, Ints, Mask

Place = tuple[int, int, int]
"""Shape, row and column of the lowest left cell."""

_VIEWS = 8
"""Ways to fill a grid: from each corner, by rows or by columns."""
_SHUFFLES = 40
"""Orders drawn at random that the first rule of thumb tries after those by size."""
_PARTS = 3
"""Into as many parts, at most, is a box divided for the spacing of points."""
_SPACINGS = 6
"""Distances of points along each axis that are tried."""
_REPAIRS = 200
"""Times that some boxes are taken out and laid anew."""
_USUAL_WORK = 300
"""Boxes times shapes up to which everything is tried in full; 24 boxes of five shapes are 120."""
_MOST_HELD = 400_000_000
"""Bytes that a search may hold, a copy of all places for every box."""
_TAKEN_OUT = (2, 9)
"""Boxes that are taken out at a time: so many, and fewer than so many."""
_MOST_SUBSETS = 4
"""Kinds of box of which all subsets are held against points; of more only the largest so many."""


@dataclass(frozen=True)
class Kind:
    """Boxes of one size.

    Attributes:
        size: (rows, columns) of cells that must be free.
        step: (rows, columns) from the lowest left cell of a box to that of the next above it and right of it.
        turnable: whether a box may lie on its side, and differs then.
    """

    count: int
    size: tuple[int, int]
    step: tuple[int, int]
    turnable: bool = True


@dataclass(frozen=True)
class Shape:
    """A kind upright, or on its side."""

    kind: int
    size: tuple[int, int]
    step: tuple[int, int]
    turned: bool = False


@dataclass(frozen=True, eq=False)
class Shortage:
    """A proof that boxes cannot all be placed.

    Attributes:
        spacing: (along y, along x) between points at most, in cells.
        covered: points that the boxes cover at least.
        points: those that lie where the boxes may.
        areas: connected areas where the boxes may lie.
        marks: bool [n, n] the points, gaps beyond the grid left out; these areas where every cell is one.
    """

    kinds: tuple[int, ...]
    spacing: tuple[int, int]
    covered: int
    points: int
    areas: int
    marks: Mask


@dataclass(frozen=True, eq=False)
class Packed:
    """Places of boxes, as many as were found; ``exhausted`` if the search proved that there are none for all."""

    places: tuple[Place, ...]
    complete: bool
    exhausted: bool = False


@dataclass(frozen=True, eq=False)
class Packing:
    """Boxes to be placed.

    Attributes:
        free: bool [n, n] cells on which boxes may lie.
        groups: of equal boxes, whose boxes should lie together where that costs nothing; divides every count.
    """

    free: Mask
    kinds: tuple[Kind, ...]
    groups: int = 1

    @cached_property
    def shapes(self) -> tuple[Shape, ...]:
        """Every kind upright, and on its side where it may be."""
        found = []
        for number, kind in enumerate(self.kinds):
            found.append(Shape(number, kind.size, kind.step))
            if kind.turnable:
                found.append(Shape(number, kind.size[::-1], kind.step[::-1], turned=True))
        return tuple(found)

    @cached_property
    def anchors(self) -> tuple[Mask, ...]:
        """By shape, bool [n, n]: lowest left cells of its places, each by itself."""
        table = _table(~self.free)
        return tuple(_anchors(table, shape.size) for shape in self.shapes)

    @property
    def boxes(self) -> int:
        return sum(kind.count for kind in self.kinds)

    def homeless(self) -> int | None:
        """The first kind that has no place at all; None if each has."""
        for number in range(len(self.kinds)):
            if not any(self.anchors[index].any() for index in self._of((number,))):
                return number
        return None

    def _of(self, kinds: Sequence[int]) -> list[int]:
        return [index for index, shape in enumerate(self.shapes) if shape.kind in kinds]

    # --- proofs ----------------------------------------------------------------------------------------------------

    def short_of_area(self) -> Shortage | None:
        """A proof by points in every cell, which costs least, and which a reader sees at once."""
        return next(filter(None, (self._short(subset, (1, 1)) for subset in self._subsets)), None)

    def shortage(self) -> Shortage | None:
        """A proof by points; None where points do not tell."""
        by_points = (self._short(subset, spacing) for subset in self._subsets for spacing in self._spacings(subset))
        return self.short_of_area() or next(filter(None, by_points), None)

    @cached_property
    def _subsets(self) -> tuple[tuple[int, ...], ...]:
        """Kinds that are held against points together: all of them, and all choices among those of most area."""
        weights = [kind.count * kind.step[0] * kind.step[1] for kind in self.kinds]
        every = tuple(range(len(self.kinds)))
        largest = sorted(every, key=lambda number: -weights[number])[:_MOST_SUBSETS]
        some = [each for size in range(len(largest), 0, -1) for each in combinations(sorted(largest), size)]
        return tuple(dict.fromkeys((every, *some)))

    @cached_property
    def _swept(self) -> Mapping[tuple[int, ...], Mask]:
        """By subset, the cells that its boxes with their gaps may cover; larger than the grid by a gap."""
        rows, columns = (max(shape.step[axis] for shape in self.shapes) for axis in (0, 1))
        whole = self.free.shape[0] + rows, self.free.shape[1] + columns
        each = [_sweep(anchors, shape.step, whole) for anchors, shape in zip(self.anchors, self.shapes, strict=True)]
        return {subset: np.any([each[index] for index in self._of(subset)], axis=0) for subset in self._subsets}

    def _spacings(self, subset: Sequence[int]) -> Iterator[tuple[int, int]]:
        """Distances of points of which every box covers some, the widest first."""
        steps = np.array([self.shapes[index].step for index in self._of(subset)])
        parts = steps[:, :, None] // np.arange(1, _PARTS + 1)
        rows, columns = (
            sorted({int(side) for side in np.unique(parts[:, axis]) if 0 < side <= least}, reverse=True)[:_SPACINGS]
            for axis, least in enumerate(steps.min(axis=0))
        )
        yield from (spacing for spacing in product(rows, columns) if spacing != (1, 1))

    def _short(self, subset: tuple[int, ...], spacing: tuple[int, int]) -> Shortage | None:
        covers = {
            number: min(
                (self.shapes[index].step[0] // spacing[0]) * (self.shapes[index].step[1] // spacing[1])
                for index in self._of((number,))
            )
            for number in subset
        }
        needed = sum(self.kinds[number].count * covers[number] for number in subset)
        swept = self._swept[subset]
        labels, areas = scipy.ndimage.label(swept)
        parts = [
            (where, labels[where] == number) for number, where in enumerate(scipy.ndimage.find_objects(labels), start=1)
        ]
        points = 0
        for _, area in parts:
            fewest = _Lines.fewest(area, spacing).points
            # A rest of points that is less than a box covers is lost in every area by itself.
            points += fewest if len(subset) > 1 else fewest - fewest % covers[subset[0]]
        if points >= needed:
            return None
        marks = np.zeros_like(swept)
        for where, area in parts:
            marks[where] |= _Lines.fewest(area, spacing).marks
        return Shortage(subset, spacing, needed, points, areas, marks[: self.free.shape[0], : self.free.shape[1]])

    # --- search ----------------------------------------------------------------------------------------------------

    def placed(self, *, nodes: int, seed: int = 0) -> Packed:
        """Places for all boxes if any are found; else for as many as were."""
        first = self._fitted(self._orders(seed))
        if first.complete:
            return first
        best = first.places
        for heaviest_first in (True, False)[: self._tries(2)]:
            places = self._least_harm(heaviest_first=heaviest_first)
            if len(places) == self.boxes:
                return Packed(places, True)
            best = max(best, places, key=len)
        found = self._searched(nodes, best)
        if found.complete or found.exhausted:
            return found
        places = self._repaired(found.places, seed)
        return Packed(max(found.places, places, key=len), len(places) == self.boxes)

    def _tries(self, many: int) -> int:
        """Times that something is tried: fewer times where there are more boxes and shapes than circuits have."""
        return round(many * min(1.0, _USUAL_WORK / (self.boxes * len(self.shapes))))

    def quickly(self) -> Packed:
        """Places by the first rule of thumb alone."""
        return self._fitted(self._orders(None))

    def by_groups(self) -> Packed:
        """Places by the first rule of thumb for boxes in groups alone: what costs least."""
        return self._fitted(product([self._by_group()], range(_VIEWS)))

    def _fitted(self, orders: Iterable[tuple[Sequence[int], int]]) -> Packed:
        """Places in the first of the orders that leaves no box out, else in the best of them."""
        best: tuple[Place, ...] = ()
        for order, view in orders:
            places = self._first_fit(order, view)
            if len(places) == self.boxes:
                return Packed(places, True)
            best = max(best, places, key=len)
        return Packed(best, False)

    def _by_group(self) -> tuple[int, ...]:
        group = [number for number, kind in enumerate(self.kinds) for _ in range(kind.count // self.groups)]
        steps = [kind.step for kind in self.kinds]
        return tuple(sorted(group, key=lambda number: -steps[number][0] * steps[number][1])) * self.groups

    def _orders(self, seed: int | None) -> Iterator[tuple[Sequence[int], int]]:
        """Orders of the boxes, by kind, and the corner from which the grid is filled: 0 to 3, 4 more by columns."""
        boxes = [number for number, kind in enumerate(self.kinds) for _ in range(kind.count)]
        steps = [kind.step for kind in self.kinds]
        by_size = (
            sorted(boxes, key=lambda number: -steps[number][0] * steps[number][1]),
            sorted(boxes, key=lambda number: -max(steps[number])),
            sorted(boxes, key=lambda number: -min(steps[number])),
        )
        yield from product(dict.fromkeys(map(tuple, (self._by_group(), *by_size))), range(_VIEWS))
        if seed is not None:
            rng = np.random.default_rng(seed)
            for _ in range(self._tries(_SHUFFLES)):
                yield rng.permutation(boxes).tolist(), int(rng.integers(_VIEWS))

    def _first_fit(self, order: Sequence[int], view: int, kept: tuple[Place, ...] = ()) -> tuple[Place, ...]:
        """Each box in turn in its first free place, seen from a corner, beside those that are laid already."""
        left = [anchors.copy() for anchors in self.anchors]
        for place in kept:
            self._lay(left, place)
        of_kind = [self._of((number,)) for number in range(len(self.kinds))]
        places = list(kept)
        for number in order:
            firsts = []
            for index in of_kind[number]:
                seen = _seen(left[index], view)
                first = int(seen.argmax())
                row, column = divmod(first, seen.shape[1])
                if seen[row, column]:
                    # What reaches least far from the side that is filled first leaves most room beyond.
                    reach = row + self.shapes[index].step[view >> 2]
                    firsts.append((reach, column, index, row))
            if firsts:
                _, column, index, row = min(firsts)
                places.append((index, *_cell((row, column), self.free.shape[0], view)))
                self._lay(left, places[-1])
        return tuple(places)

    def _repaired(self, places: tuple[Place, ...], seed: int) -> tuple[Place, ...]:
        """Places after boxes near some spot were taken out and laid anew, many times; never of less area."""
        rng = np.random.default_rng(seed)
        shapes, side = self.shapes, len(self.free)

        def area(laid: Sequence[Place]) -> int:
            return sum(shapes[index].step[0] * shapes[index].step[1] for index, _, _ in laid)

        for _ in range(self._tries(_REPAIRS) if places else 0):
            spot, many = rng.integers(side, size=2), int(rng.integers(*_TAKEN_OUT))
            middles = np.array([(row, column) + np.array(shapes[index].step) / 2 for index, row, column in places])
            near = np.argsort(np.abs(middles - spot).sum(axis=1))
            kept = tuple(places[number] for number in near[many:])
            missing = [kind.count for kind in self.kinds]
            for index, _, _ in kept:
                missing[shapes[index].kind] -= 1
            order = rng.permutation([number for number, count in enumerate(missing) for _ in range(count)]).tolist()
            if rng.random() < 0.5:
                order.sort(key=lambda number: -self.kinds[number].step[0] * self.kinds[number].step[1])
            laid = self._first_fit(order, int(rng.integers(_VIEWS)), kept)
            if area(laid) >= area(places):
                places = laid
            if len(places) == self.boxes:
                break
        return places

    def _least_harm(self, *, heaviest_first: bool) -> tuple[Place, ...]:
        """Each box where it takes fewest places from the others, the largest first or the one with fewest places."""
        left = [anchors.copy() for anchors in self.anchors]
        need = [kind.count for kind in self.kinds]
        size = [kind.step[0] * kind.step[1] for kind in self.kinds]
        places: list[Place] = []
        while any(need):
            counts = self._counts(left)
            open_kinds = [number for number, many in enumerate(need) if many and counts[number]]
            if not open_kinds:
                break
            number = min(
                open_kinds, key=lambda number: -size[number] if heaviest_first else counts[number] / need[number]
            )
            tables = [_table(anchors) for anchors in left]
            weights = [need[shape.kind] / max(1, counts[shape.kind]) for shape in self.shapes]
            best: tuple[float, Place] | None = None
            for index in self._of((number,)):
                rows, columns = np.nonzero(left[index])
                if rows.size:
                    harm = sum(
                        weight * self._lost(table, index, other, rows, columns)
                        for other, (table, weight) in enumerate(zip(tables, weights, strict=True))
                        if weight
                    )
                    at = int(np.argmin(harm))
                    found = float(np.min(harm)), (index, int(rows[at]), int(columns[at]))
                    best = found if best is None else min(best, found)
            if best is None:
                break
            places.append(best[1])
            self._lay(left, best[1])
            need[number] -= 1
        return tuple(places)

    def _lost(self, table: Ints, index: int, other: int, rows: Ints, columns: Ints) -> Ints:
        """Places of one shape that a box of another, laid at each of some places, takes."""
        (high, wide), (other_high, other_wide) = self.shapes[index].step, self.shapes[other].step
        n = self.free.shape[0]
        low, left = np.maximum(rows - other_high + 1, 0), np.maximum(columns - other_wide + 1, 0)
        top, right = np.minimum(rows + high, n), np.minimum(columns + wide, n)
        return np.asarray(table[top, right] - table[low, right] - table[top, left] + table[low, left])

    def _searched(self, nodes: int, best: tuple[Place, ...]) -> Packed:
        """All places of a box, one after the other, and for each the rest of the boxes."""
        if self.boxes * sum(anchors.size for anchors in self.anchors) > _MOST_HELD:
            return Packed(best, False)
        left_over = nodes

        def search(left: list[Mask], need: list[int], laid: tuple[Place, ...]) -> bool:
            """Whether all were laid; ends early when the nodes are spent."""
            nonlocal left_over, best
            best = max(best, laid, key=len)
            if not any(need):
                return True
            while left_over > 0:
                counts = self._counts(left)
                if any(many > counts[number] for number, many in enumerate(need)):
                    return False
                number = min((each for each, many in enumerate(need) if many), key=lambda each: counts[each])
                index = next(each for each in self._of((number,)) if left[each].any())
                row, column = divmod(int(left[index].argmax()), left[index].shape[1])
                left_over -= 1
                rest = [anchors.copy() for anchors in left]
                self._lay(rest, (index, row, column))
                # Boxes of one kind are alike: a place that was tried is none for those that follow.
                left[index][row, column] = False
                if search(
                    rest, [many - (each == number) for each, many in enumerate(need)], (*laid, (index, row, column))
                ):
                    return True
            return False

        finished = search([anchors.copy() for anchors in self.anchors], [kind.count for kind in self.kinds], ())
        return Packed(best, finished, exhausted=not finished and left_over > 0)

    def _counts(self, left: Sequence[Mask]) -> list[int]:
        counts = [0] * len(self.kinds)
        for anchors, shape in zip(left, self.shapes, strict=True):
            counts[shape.kind] += int(np.count_nonzero(anchors))
        return counts

    def _lay(self, left: Sequence[Mask], place: Place) -> None:
        index, row, column = place
        high, wide = self.shapes[index].step
        for anchors, shape in zip(left, self.shapes, strict=True):
            low, first = max(0, row - shape.step[0] + 1), max(0, column - shape.step[1] + 1)
            anchors[low : row + high, first : column + wide] = False


def _table(cells: Mask) -> Ints:
    """Summed-area table [n + 1, n + 1]."""
    table = np.zeros((cells.shape[0] + 1, cells.shape[1] + 1), dtype=np.int64)
    np.cumsum(cells, axis=0, out=table[1:, 1:])
    np.cumsum(table[1:, 1:], axis=1, out=table[1:, 1:])
    return table


def _anchors(taken: Ints, size: tuple[int, int]) -> Mask:
    """Lowest left cells of rectangles that hold nothing, from the table of what is taken."""
    high, wide = size
    rows, columns = taken.shape[0] - 1, taken.shape[1] - 1
    found = np.zeros((rows, columns), dtype=np.bool_)
    if high <= rows and wide <= columns:
        held = taken[high:, wide:] - taken[: -high or None, wide:] - taken[high:, : -wide or None]
        held = held + taken[: rows + 1 - high, : columns + 1 - wide]
        found[: rows + 1 - high, : columns + 1 - wide] = held == 0
    return found


def _sweep(anchors: Mask, step: tuple[int, int], shape: tuple[int, ...]) -> Mask:
    """Cells that rectangles at any of the anchors cover, bool of a shape that holds them all."""
    (rows, columns), (high, wide) = anchors.shape, step
    # Corners of every rectangle with signs, summed twice.
    marks = anchors.astype(np.int32)
    padded = np.zeros((shape[0] + 1, shape[1] + 1), dtype=np.int32)
    padded[:rows, :columns] += marks
    padded[high : rows + high, :columns] -= marks
    padded[:rows, wide : columns + wide] -= marks
    padded[high : rows + high, wide : columns + wide] += marks
    swept = padded.cumsum(axis=0).cumsum(axis=1)[:-1, :-1]
    return np.asarray(swept > 0)


@dataclass(frozen=True, eq=False)
class _Lines:
    """Fewest points of an area on rows ``down`` apart at most, on each of them ``across`` apart at most.

    Points outside the area cost nothing, so that in a run of cells of a row there need be no more than its length over
    ``across``, rounded down. Rows are chosen by the cost of all that precede them.

    Attributes:
        turned: whether the area was transposed, so that rows are its columns.
    """

    area: Mask
    down: int
    across: int
    points: int
    rows: tuple[int, ...]
    turned: bool

    @classmethod
    def fewest(cls, area: Mask, spacing: tuple[int, int]) -> _Lines:
        """On lines along x or along y, whichever takes fewer."""
        down, across = spacing
        if spacing == (1, 1):
            return cls(area, 1, 1, int(np.count_nonzero(area)), tuple(range(len(area))), False)
        lying = cls._of(area, down, across, turned=False)
        upright = cls._of(area.T, across, down, turned=True)
        return upright if upright.points < lying.points else lying

    @classmethod
    def _of(cls, area: Mask, down: int, across: int, *, turned: bool) -> _Lines:
        rows, starts, ends = _runs(area)
        cost = np.bincount(rows, weights=(ends - starts) // across, minlength=len(area)).tolist()
        # Total cost up to each row, itself chosen; the best of the last few is at the front of the queue. Rows before
        # the area cost nothing.
        total: list[float] = []
        before: list[int] = []
        best = deque([(0.0, -1)])
        for row, own in enumerate(cost):
            while best[0][1] < row - down:
                best.popleft()
            least, which = best[0]
            total.append(own + least)
            before.append(which)
            while best and best[-1][0] >= total[-1]:
                best.pop()
            best.append((total[-1], row))
        while best[0][1] < len(cost) - down:
            best.popleft()
        points, row = best[0]
        chosen = []
        while row >= 0:
            chosen.append(row)
            row = before[row]
        return cls(area, down, across, int(points), tuple(chosen), turned)

    @property
    def marks(self) -> Mask:
        marks = np.zeros_like(self.area)
        for row, start, end in zip(*_runs(self.area), strict=True):
            if row in self.rows:
                marks[row, start + self.across - 1 : end : self.across] = True
        return marks.T if self.turned else marks


def _runs(area: Mask) -> tuple[Indices, Indices, Indices]:
    """Row, first cell and end of every run of cells of an area."""
    beside = np.zeros((area.shape[0], area.shape[1] + 2), dtype=np.int8)
    beside[:, 1:-1] = area
    edges = np.diff(beside, axis=1)
    (rows, starts), (_, ends) = np.nonzero(edges == 1), np.nonzero(edges == -1)
    return rows, starts, ends


def _seen(cells: Mask, view: int) -> Mask:
    """Cells from one of four corners, by rows or, from 4 on, by columns."""
    turned = cells.T if view >= 4 else cells
    return turned[:: -1 if view & 1 else 1, :: -1 if view & 2 else 1]


def _cell(seen: tuple[int, int], n: int, view: int) -> tuple[int, int]:
    """The cell that is seen there, by :func:`_seen` on a square grid."""
    row, column = (n - 1 - seen[0] if view & 1 else seen[0]), (n - 1 - seen[1] if view & 2 else seen[1])
    return (column, row) if view >= 4 else (row, column)
