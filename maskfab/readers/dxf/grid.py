"""Offsets of the coordinates of a DXF from the nanometre grid, to which klayout rounds silently.

Coordinates in a block are rounded before it is placed: where it is placed larger, its rounding is as much larger.
"""

from __future__ import annotations

from array import array
from collections import defaultdict
from collections.abc import Callable
from graphlib import CycleError, TopologicalSorter

import numpy as np
from klayout import db
from numpy.typing import NDArray

from maskfab.readers.dxf.text_entities import Entity, codes

_ON_GRID_NM = 1e-4
"""Decimals of inches and millimetres are written with so many digits that what is on the grid lies closer to it."""

_ELSEWHERE = 4 | 8
"""Flags of a block whose content is another file's, or is laid over from there."""

_SPREADING = codes(41, 42, 44, 45, 70, 71)
"""Attributes that make an array of a reference, or place its block at another scale."""

_DRAWING = "\n"
"""Stands for the drawing itself; no name of a block ends a line."""


class DrawingGrid:
    """The coordinates of a drawing, collected entity by entity, in nanometres.

    Args:
        nm_per_unit: length of one unit of the drawing.
    """

    def __init__(self, nm_per_unit: float) -> None:
        self._scale = nm_per_unit
        self._lines: dict[tuple[str, str], _Lines] = defaultdict(_Lines)
        self._bases: dict[str, tuple[float, float]] = {}
        self._placed: dict[str, dict[str, _Places]] = defaultdict(lambda: defaultdict(_Places))

    def add(self, entity: Entity) -> None:
        """Take the coordinates of an entity that draws, places or begins a block; others have none that count."""
        block = _DRAWING if entity.block is None else entity.block
        if entity.kind == "BLOCK" and not int(entity.number(70)) & _ELSEWHERE:
            self._bases[block] = entity.number(10), entity.number(20)
        elif entity.kind == "INSERT":
            self._placed[block][entity.text(2)].add(entity)
        elif entity.kind == "SOLID":
            xs, ys = ([entity.number(axis + corner) for corner in (0, 1, 3, 2)] for axis in (10, 20))
            self._lines[block, entity.layer].add(xs, ys)
        elif entity.kind in {"LWPOLYLINE", "POLYLINE"}:
            xs, ys = entity.points()
            if entity.width > 0:
                xs, ys = self._outline(xs, ys, entity.width)
            self._lines[block, entity.layer].add(xs, ys)

    def _outline(self, xs: list[float], ys: list[float], width: float) -> tuple[list[float], list[float]]:
        # In nanometres, for klayout takes points within a hundred-thousandth of its unit for the same.
        spine = [db.DPoint(x * self._scale, y * self._scale) for x, y in zip(xs, ys, strict=False)]
        hull = list(db.DPath(spine, width * self._scale).polygon().each_point_hull())
        return [point.x / self._scale for point in hull], [point.y / self._scale for point in hull]

    def cycle(self) -> list[str]:
        """Names of blocks each of which contains the next, the last the first; empty if there are none."""
        try:
            TopologicalSorter(self._graph()).prepare()
        except CycleError as error:
            names: list[str] = error.args[1][::-1]
            return names
        return []

    def lacking(self) -> list[str]:
        """Blocks that are placed and not there, by their exact names."""
        placed = set().union(*self._placed.values())
        return sorted(placed - self._bases.keys())

    def _graph(self) -> dict[str, set[str]]:
        return {
            _DRAWING: set(),
            **{block: set() for block in self._bases},
            **{block: set(placed) for block, placed in self._placed.items()},
        }

    def drawing(self, counts: Callable[[str], bool]) -> set[str]:
        """Names of the blocks that draw something that counts, or place a block that does.

        Args:
            counts: whether the geometry on a layer of that name does.
        """
        found = {block for block, layer in self._lines if counts(layer)}
        for block in TopologicalSorter(self._graph()).static_order():
            if not found.isdisjoint(self._placed.get(block, ())):
                found.add(block)
        return found - {_DRAWING}

    def rounding_nm(self, counts: Callable[[str], bool]) -> float:
        """The largest distance by which klayout moves a coordinate, seen in the drawing.

        Args:
            counts: whether the geometry on a layer of that name does.
        """
        own: dict[str, float] = {}
        for (block, layer), lines in self._lines.items():
            if counts(layer):
                values = np.concatenate(lines.points())
                own[block] = max(own.get(block, 0.0), self._rounding(values))
        # A block that draws nothing that counts has no rounding at all, and where it is placed does not count.
        found: dict[str, float] = {}
        for block in TopologicalSorter(self._graph()).static_order():
            roundings = [own[block]] if block in own else []
            for name, places in self._placed.get(block, {}).items():
                if name in found:
                    roundings += [self._rounding(np.array(places.coordinates)), places.largest * found[name]]
            if roundings:
                found[block] = max(*roundings, self._rounding(np.array(self._bases.get(block, (0.0, 0.0)))))
        return found.get(_DRAWING, 0.0)

    def repeated_vertices(self, counts: Callable[[str], bool]) -> int:
        """Vertices that lie on the one before once they are rounded; a line may end where it began."""
        return sum(lines.repeated(self._scale) for (_, layer), lines in self._lines.items() if counts(layer))

    def _rounding(self, values: NDArray[np.float64]) -> float:
        scaled = _scaled(values, self._scale)
        scaled = scaled[np.isfinite(scaled)]
        largest = float(np.abs(scaled - np.rint(scaled)).max(initial=0.0))
        return largest if largest > _ON_GRID_NM else 0.0


def _scaled(values: NDArray[np.float64], scale: float) -> NDArray[np.float64]:
    """Coordinates in database units; who reads the polygons refuses those that are too large for any."""
    with np.errstate(over="ignore"):
        return values * scale


class _Places:
    """References to one block in another.

    Attributes:
        coordinates: of all of them, and the steps of arrays.
        largest: how many times as large as it is drawn the block is placed at most.
    """

    def __init__(self) -> None:
        self.coordinates, self.largest = array("d"), 0.0

    def add(self, reference: Entity) -> None:
        self.coordinates.append(reference.number(10))
        self.coordinates.append(reference.number(20))
        larger = 1.0
        if reference.says(_SPREADING):
            larger = max(abs(reference.number(41, 1.0)), abs(reference.number(42, 1.0)))
            for step, count in ((44, 70), (45, 71)):
                if abs(reference.number(count, 1.0)) > 1:
                    self.coordinates.append(reference.number(step))
        self.largest = max(self.largest, larger)


class _Lines:
    """Vertices of many lines, one after the other."""

    def __init__(self) -> None:
        self._x, self._y, self._last = array("d"), array("d"), array("q")

    def add(self, xs: list[float], ys: list[float]) -> None:
        count = min(len(xs), len(ys))
        self._x.extend(xs[:count])
        self._y.extend(ys[:count])
        if count:
            self._last.append(len(self._x) - 1)

    def points(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        return np.array(self._x), np.array(self._y)

    def repeated(self, scale: float) -> int:
        x, y = (np.rint(_scaled(values, scale)) for values in self.points())
        same = (x[1:] == x[:-1]) & (y[1:] == y[:-1])
        # Between the last vertex of a line and the first of the next there is no edge.
        same[np.array(self._last[:-1], dtype=np.int64)] = False
        return int(same.sum())
