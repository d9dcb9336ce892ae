"""Many small drawings side by side on one sheet, so that one run of KLayout checks them all."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from klayout import db
from numpy.typing import NDArray

from maskfab.base.arrays import Floats, Ints
from maskfab.drc.rules import Check

_LARGEST_SHEET_NM = 1_000_000_000
_DIGITS = str.maketrans(dict.fromkeys("(),;/|", " "))


@dataclass(frozen=True, eq=False)
class Facing:
    """Pairs of edges that face each other too closely.

    Attributes:
        items: int64 [n], the drawing that each was found in.
        points: int64 [n, 2], lowest endpoint of the pair, leftmost among these, from the drawing's origin.
        boxes_nm: int64 [n, 4], hull of the pair, from the drawing's origin.
        values: float64 [n], distance of the two edges.
    """

    items: Ints
    points: Ints
    boxes_nm: Ints
    values: Floats

    def chosen(self, keep: NDArray[np.bool_]) -> Facing:
        """Those for which ``keep`` holds."""
        return Facing(self.items[keep], self.points[keep], self.boxes_nm[keep], self.values[keep])


class Canvas:
    """Drawings composed of pieces, each drawn once however many drawings use it.

    Args:
        size_nm: side of the square, from -size to size about a drawing's origin, that holds every drawing.
        reach_nm: drawings stay further apart than this.
    """

    def __init__(self, size_nm: int, reach_nm: int) -> None:
        self._step = 2 * size_nm + 2 * reach_nm + 2
        self._layout = db.Layout()
        self._layer = self._layout.layer(1, 0)
        self._pieces: list[int] = []

    def piece(self, region: db.Region) -> int:
        """A shape that drawings can use, by its number."""
        cell = self._layout.create_cell(f"P{len(self._pieces)}")
        cell.shapes(self._layer).insert(region)
        self._pieces.append(cell.cell_index())
        return len(self._pieces) - 1

    def check(self, drawings: Sequence[Sequence[tuple[int, int, int]]], checks: Sequence[Check]) -> tuple[Facing, ...]:
        """Run checks over drawings, each a sequence of (piece, x, y); polygons that kiss stay apart."""
        most = max(1, _LARGEST_SHEET_NM // self._step) ** 2
        parts = [self._sheet(drawings[k : k + most], checks, k) for k in range(0, max(1, len(drawings)), most)]
        return tuple(together([part[n] for part in parts]) for n in range(len(checks)))

    def _sheet(
        self, drawings: Sequence[Sequence[tuple[int, int, int]]], checks: Sequence[Check], before: int
    ) -> list[Facing]:
        across, step = max(1, math.isqrt(max(0, len(drawings) - 1)) + 1), self._step
        sheet, pieces = self._layout.create_cell(f"SHEET{before}"), self._pieces
        for n, drawing in enumerate(drawings):
            x0, y0 = (n % across) * step, (n // across) * step
            for piece, x, y in drawing:
                sheet.insert(db.CellInstArray(pieces[piece], db.Trans(x0 + x, y0 + y)))
        region = db.Region(sheet.begin_shapes_rec(self._layer)).merged(True, 1)
        region.merged_semantics = False
        found = []
        for check in checks:
            facing = facing_edges(check(region))
            column, row = np.rint(facing.points / step).astype(np.int64).T
            origins = np.stack([column, row], axis=1) * step
            found.append(
                Facing(
                    before + row * across + column,
                    facing.points - origins,
                    facing.boxes_nm - np.tile(origins, 2),
                    facing.values,
                )
            )
        return found


def facing_edges(pairs: db.EdgePairs) -> Facing:
    """Edge pairs as arrays, all of item 0."""
    count = pairs.count()
    # One text is read a hundred times faster than attributes of so many objects.
    numbers = np.array(pairs.to_s(count).translate(_DIGITS).split(), dtype=np.int64)
    ends = numbers.reshape(count, 4, 2)
    boxes = np.concatenate([ends.min(axis=1), ends.max(axis=1)], axis=1)
    lowest = np.where(ends[..., 1] == boxes[:, 1, None], ends[..., 0], np.iinfo(np.int64).max).min(axis=1)
    points = np.stack([lowest, boxes[:, 1]], axis=1)
    straight = ((ends[:, 0] == ends[:, 1]) | (ends[:, 2] == ends[:, 3])).any(axis=1)
    straight &= (ends[:, 0] == ends[:, 1]).any(axis=1) & (ends[:, 2] == ends[:, 3]).any(axis=1)
    one, two = ends[:, :2], ends[:, 2:]
    gaps = np.maximum(0, np.maximum(one.min(axis=1) - two.max(axis=1), two.min(axis=1) - one.max(axis=1)))
    values = np.hypot(gaps[:, 0], gaps[:, 1])
    if not straight.all():
        values[~straight] = _distances(ends[~straight].astype(np.float64))
    return Facing(np.zeros(count, dtype=np.int64), points, boxes, values)


def _distances(ends: Floats) -> Floats:
    """Distances of the two edges of pairs [n, 4, 2] that do not cross: from an end of one to the other."""
    found = []
    for point, start, stop in ((0, 2, 3), (1, 2, 3), (2, 0, 1), (3, 0, 1)):
        along, away = ends[:, stop] - ends[:, start], ends[:, point] - ends[:, start]
        length = (along**2).sum(axis=1)
        part = np.clip((away * along).sum(axis=1) / np.where(length > 0, length, 1), 0, 1)
        found.append(np.hypot(*(away - part[:, None] * along).T))
    least: Floats = np.min(found, axis=0)
    return least


def together(parts: Sequence[Facing]) -> Facing:
    """Several findings as one."""
    nothing = np.zeros((0, 2), dtype=np.int64)
    return Facing(
        np.concatenate([nothing[:, 0], *(part.items for part in parts)]),
        np.concatenate([nothing, *(part.points for part in parts)]),
        np.concatenate([np.zeros((0, 4), dtype=np.int64), *(part.boxes_nm for part in parts)]),
        np.concatenate([np.zeros(0), *(part.values for part in parts)]),
    )
