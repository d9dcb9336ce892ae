"""The grid of a plate's data: dies that lie on it, and marks whose vertices are moved to it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from maskfab.errors import JobError
from maskfab.model import Die, Furniture, Plate, Polygon, Snapping

LARGEST_GRID_NM = 1000


def check_dies(dies: Sequence[Die], grid_nm: int, *, where: str) -> None:
    """Refuse dies of which a dot would have to be moved: dots keep their size and pitch.

    Raises:
        JobError: MF104 for a grid coarser than 1 um, MF107 for the first length that is no multiple of it.
    """
    if grid_nm > LARGEST_GRID_NM:
        raise JobError(
            "MF104", f"a data grid of {grid_nm} nm is coarser than 1 um", where=where, cure="Use at most 1 um"
        )
    for die in dies:
        for name, value_nm in _lengths(die):
            if value_nm % grid_nm:
                raise JobError(
                    "MF107",
                    f"the {name} of die {die.name} is {value_nm} nm, no multiple of the data grid of {grid_nm} nm",
                    where=where,
                    cure="Use a finer grid, or a dot, a gutter and a die_pitch that are multiples of twice the grid",
                )


def lies_on(die: Die, grid_nm: int) -> bool:
    """Whether every dot of a die lies on a grid."""
    return all(value_nm % grid_nm == 0 for _, value_nm in _lengths(die))


def _lengths(die: Die) -> tuple[tuple[str, int], ...]:
    panel, (x, y) = die.panel, die.origin_nm
    half = panel.gutter_nm // 2
    return ("dot", panel.dot_nm), ("pitch", panel.pitch_nm), ("half gutter", half), ("left edge", x), ("lower edge", y)


def snapped(plate: Plate, grid_nm: int) -> Plate:
    """The plate with every vertex of its written marks on the nearest line of a grid, and with the count of those that
    were moved; widths that are multiples of the grid stay.
    """
    drawn = [mark.polygons for mark in plate.furniture if mark.layer.written]
    corners = np.array([point for polygons in drawn for polygon in polygons for point in polygon]).reshape(-1, 2)
    off = (corners + grid_nm // 2) % grid_nm - grid_nm // 2
    moves = np.hypot(off[:, 0], off[:, 1])
    before = plate.snapped or Snapping(grid_nm, 0, 0.0)
    moved = Snapping(
        grid_nm,
        before.vertices + int(np.count_nonzero(moves)),
        before.farthest_nm + float(moves.max(initial=0.0)),
    )
    marks = tuple(_snapped(mark, grid_nm) if mark.layer.written else mark for mark in plate.furniture)
    return replace(plate, furniture=marks, snapped=moved)


def _snapped(mark: Furniture, grid_nm: int) -> Furniture:
    def nearest(value: int) -> int:
        return (value + grid_nm // 2) // grid_nm * grid_nm

    drawn = (tuple((nearest(x), nearest(y)) for x, y in polygon) for polygon in mark.polygons)
    return replace(mark, polygons=tuple(map(_without_doubles, drawn)))


def _without_doubles(polygon: Polygon) -> Polygon:
    """The outline without vertices that follow themselves."""
    return tuple(point for point, before in zip(polygon, (polygon[-1], *polygon), strict=False) if point != before)
