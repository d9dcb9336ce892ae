"""The polygons of one layer of a plate as text, cell after cell, without ever holding them all.

A cell's text is made once, with gaps for its numbers. Numbers of a column are the same in every row and those of a row
the same in every column, so they are formatted once too; what is left for each of ten thousand cells is to fill gaps.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Literal, NamedTuple, Protocol

import numpy as np

from maskfab.export.cell_polygons import DieFigures, Figures
from maskfab.geometry.cell_grid import CellArray
from maskfab.geometry.polygonize import hull_points
from maskfab.model import Layer, Point, Polygon


class Placeholder(NamedTuple):
    """Where a number goes: a coordinate, or the next serial number."""

    axis: Literal["x", "y", "serial"]
    value_nm: int


class Pen(Protocol):
    """Writer of a polygon in one text format."""

    def outline(self, polygon: Polygon) -> tuple[str, Sequence[Placeholder]]:
        """Text of a polygon with ``%s`` for every number, and what goes there."""

    def number(self, nm: int) -> str:
        """A coordinate."""

    def serial(self) -> str:
        """The next serial number."""


def polygon_lines(figures: Figures, layer: Layer, pen: Pen, die: DieFigures | None = None) -> Iterator[str]:
    """The text of everything on a layer, in pieces of about one cell.

    Args:
        figures: the plate.
        layer: what is written of it.
        pen: the format.
        die: only this one, and no marks.
    """
    for each in figures.dies if die is None else (die,):
        for grid in each.grids:
            yield from _grid(figures, layer, pen, each.origin_nm, grid)
    if die is not None:
        return
    for mark in figures.marks:
        for polygon in mark.shapes.get(layer, ()):
            yield filled(pen, polygon)
    if layer in figures.merged:
        for piece in figures.merged[layer].each():
            yield filled(pen, hull_points(piece))


def filled(pen: Pen, polygon: Polygon) -> str:
    """The text of one polygon where it is drawn."""
    text, gaps = pen.outline(polygon)
    return text % tuple(pen.serial() if gap.axis == "serial" else pen.number(gap.value_nm) for gap in gaps)


@dataclass(frozen=True, eq=False)
class _Form:
    """A cell's text with gaps, their positions by axis, and the numbers for the cell at the origin."""

    text: str
    size: int
    at: dict[str, list[int]]
    values: dict[str, list[int]]


def _form(pen: Pen, polygons: Sequence[Polygon]) -> _Form:
    texts: list[str] = []
    gaps: list[Placeholder] = []
    for polygon in polygons:
        text, new = pen.outline(polygon)
        texts.append(text)
        gaps.extend(new)
    at: dict[str, list[int]] = {"x": [], "y": [], "serial": []}
    values: dict[str, list[int]] = {"x": [], "y": [], "serial": []}
    for place, gap in enumerate(gaps):
        at[gap.axis].append(place)
        values[gap.axis].append(gap.value_nm)
    return _Form("".join(texts), len(gaps), at, values)


def _grid(figures: Figures, layer: Layer, pen: Pen, origin_nm: Point, grid: CellArray) -> Iterator[str]:
    forms = [_form(pen, figures.cells[name].get(layer, ())) for name in grid.cells]
    x0, y0 = origin_nm[0] + grid.origin_nm[0], origin_nm[1] + grid.origin_nm[1]
    dx, dy = grid.step_nm
    columns: dict[tuple[int, int], list[str]] = {}
    for row, kinds in enumerate(grid.index.tolist()):
        rows: dict[int, list[str]] = {}
        for column, kind in enumerate(kinds):
            form = forms[kind]
            if not form.size:
                continue
            if kind not in rows:
                rows[kind] = [pen.number(value + y0 + row * dy) for value in form.values["y"]]
            if (column, kind) not in columns:
                columns[column, kind] = [pen.number(value + x0 + column * dx) for value in form.values["x"]]
            numbers = np.empty(form.size, dtype=object)
            numbers[form.at["x"]] = columns[column, kind]
            numbers[form.at["y"]] = rows[kind]
            if form.at["serial"]:
                numbers[form.at["serial"]] = [pen.serial() for _ in form.at["serial"]]
            yield form.text % tuple(numbers)
