"""Plates as hierarchical layouts, and layouts as regions.

A layout keeps one cell per orientation of an opening and places it thousands of times; nothing is flattened until
a question needs it. Database unit: 1 nm.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from klayout import db
from numpy.typing import NDArray

from maskfab.geometry.cell_grid import DBU_UM, CellArray, placed
from maskfab.geometry.raster import coverage, disjoint, placed_boxes, to_boxes
from maskfab.geometry.shape_limits import count_shapes
from maskfab.geometry.unit_cell import UnitKey, unit_key, unit_name, unit_shapes
from maskfab.model import CLEAR, LAYERS, NOTE, Box, Layer, Panel, Plate, Polygon

__all__ = [
    "DBU_UM",
    "PlateNames",
    "coverage",
    "layer_info",
    "orientations_in_use",
    "placed_boxes",
    "plate_layout",
    "plate_names",
    "region",
    "simple_polygon",
    "to_boxes",
]

_MOST_TURNED = 5_000_000
NAME_LENGTH = 32


def plate_layout(plate: Plate) -> db.Layout:
    """The plate as a hierarchy of cells: top, dies, and one cell per opening, dot, gutter and orientation in use.

    A periodic die is one array reference, any other one reference per cell; nothing is mirrored, turned or scaled.
    Marks have a cell each. For the order of the cells see :func:`maskfab.geometry.cell_grid.placed`; every format
    accepts their names.
    """
    names = plate_names(plate)
    grids = {name: [_grid(die.panel, names)] for die, name in zip(plate.dies, names.dies, strict=True)}
    layout = placed([names.top, *names.dies, *names.marks, *names.units.values()], grids)
    layers = {layer: layout.layer(layer_info(layer)) for layer in LAYERS}
    cells = {cell.name: cell for cell in layout.each_cell()}
    top = cells[names.top]
    drawn: set[UnitKey] = set()
    for die in plate.dies:
        for orientation in orientations_in_use(die.panel):
            key = unit_key(die.panel, orientation)
            if key not in drawn:
                drawn.add(key)
                for layer, polygons in unit_shapes(die.panel, orientation).items():
                    _draw(cells[names.units[key]].shapes(layers[layer]), polygons)
    for die, die_name in zip(plate.dies, names.dies, strict=True):
        top.insert(db.CellInstArray(cells[die_name].cell_index(), db.Trans(*die.origin_nm)))
    for mark, mark_name in zip(plate.furniture, names.marks, strict=True):
        _draw(cells[mark_name].shapes(layers[mark.layer]), mark.polygons)
        top.insert(db.CellInstArray(cells[mark_name].cell_index(), db.Trans()))
    for note in plate.notes:
        top.shapes(layers[NOTE]).insert(db.Text(note.text, db.Trans(*note.position_nm)))
    return layout


def region(
    layout: db.Layout, layer: Layer | db.LayerInfo, box_nm: Box | None = None, cell: str | None = None
) -> db.Region:
    """Everything on a layer, flattened and merged; corners that kiss stay apart.

    Args:
        layout: its database unit is 1 nm.
        layer: a layer of the plate, or one found by :func:`maskfab.readers.layout_file.find_layer`; the region of a
            layer that the layout lacks is empty.
        box_nm: x0, y0, x1, y1 to which the region is clipped.
        cell: the cell to flatten, in its own coordinates; the only top cell if None.
    """
    info = layer_info(layer) if isinstance(layer, Layer) else layer
    index = layout.find_layer(info)
    if index is None:
        return db.Region()
    root = layout.top_cell() if cell is None else layout.cell(cell)
    if box_nm is None:
        return db.Region(root.begin_shapes_rec(index)).merged(True, 1)
    box = db.Box(*box_nm)
    return (db.Region(root.begin_shapes_rec_overlapping(index, box)) & db.Region(box)).merged(True, 1)


def clear_shapes(layout: db.Layout, box_nm: Box) -> db.Region | NDArray[np.int64]:
    """Clear shapes in and around a box: int64 [n, 4] disjoint boxes where possible, else a merged region."""
    index = layout.find_layer(layer_info(CLEAR))
    boxes = None if index is None else placed_boxes(layout.top_cell(), index, db.Box(*box_nm))
    return boxes if boxes is not None and disjoint(boxes) else region(layout, CLEAR, box_nm)


def clear_box(layout: db.Layout) -> db.Box:
    """The smallest box that holds all that is clear; empty if nothing is.

    A cell's own box, turned by other than quarters, is larger than what it holds, and again at every level. So where
    cells are turned so, their polygons are asked, if they are few enough.
    """
    index = layout.find_layer(layer_info(CLEAR))
    if index is None:
        return db.Box()
    if not any(_slants(each) for cell in layout.each_cell() for each in cell.each_inst()):
        return layout.top_cell().bbox(index)
    if count_shapes(layout, [index]) > _MOST_TURNED:
        return layout.top_cell().bbox(index)
    drawn = db.Region(layout.top_cell().begin_shapes_rec(index))
    drawn.merged_semantics = False
    return drawn.extents().bbox()


def _slants(reference: db.Instance) -> bool:
    """Whether a reference turns by other than quarters, scaled or not."""
    return bool(reference.is_complex() and not reference.cplx_trans.is_ortho())


def layer_info(layer: Layer) -> db.LayerInfo:
    """The layer as klayout knows it, by number, datatype and name."""
    return db.LayerInfo(layer.number, layer.datatype, layer.name)


def simple_polygon(polygon: Polygon) -> db.SimplePolygon:
    """A klayout polygon with exactly these vertices."""
    return db.SimplePolygon([db.Point(x, y) for x, y in polygon], True)


def orientations_in_use(panel: Panel) -> tuple[int, ...]:
    """The elements of D4 that at least one cell of the panel takes, ascending."""
    return tuple(int(orientation) for orientation in np.unique(panel.orientations))


@dataclass(frozen=True)
class PlateNames:
    """Cell names of a plate, the same in every format.

    Attributes:
        top: the top cell.
        dies: one for each die, in plate order.
        marks: one for each piece of furniture, in plate order.
        units: one for each unit cell, ``OPENING_D<dot>_G<gutter>_R<orientation>``.
    """

    top: str
    dies: tuple[str, ...]
    marks: tuple[str, ...]
    units: Mapping[UnitKey, str]


def plate_names(plate: Plate) -> PlateNames:
    """The cell names of a plate."""
    names = CellNames()
    top = names.unique(plate.name)
    dies = tuple(names.unique(die.name) for die in plate.dies)
    marks = tuple(names.unique(mark.name) for mark in plate.furniture)
    units: dict[UnitKey, str] = {}
    for die in plate.dies:
        for orientation in orientations_in_use(die.panel):
            key = unit_key(die.panel, orientation)
            if key not in units:
                units[key] = names.unique(*unit_name(die.panel, orientation))
    return PlateNames(top, dies, marks, units)


class CellNames:
    """Gives out cell names that every format accepts: A-Z, 0-9 and _, at most 32 of them, no two alike.

    ``MAIN`` is parted, for some mask software takes it for a top cell.
    """

    def __init__(self) -> None:
        self._taken: set[str] = set()

    def unique(self, wish: str, suffix: str = "") -> str:
        """The name closest to ``wish + suffix`` that is free; a suffix is never cut off."""
        stem = re.sub(r"[^A-Z0-9]+", "_", wish.upper()).replace("MAIN", "MA_IN") or "CELL"
        count = 1
        while True:
            tail = suffix if count == 1 else f"{suffix}_{count}"
            name = stem[: NAME_LENGTH - len(tail)] + tail
            if name not in self._taken:
                self._taken.add(name)
                return name
            count += 1


def _grid(panel: Panel, names: PlateNames) -> CellArray:
    kinds = orientations_in_use(panel)
    index = np.searchsorted(np.array(kinds), panel.orientations).astype(np.int64)
    units = tuple(names.units[unit_key(panel, kind)] for kind in kinds)
    return CellArray(units, index, (0, 0), (panel.pitch_nm, panel.pitch_nm))


def _draw(shapes: db.Shapes, polygons: tuple[Polygon, ...]) -> None:
    for polygon in polygons:
        shapes.insert(simple_polygon(polygon))
