"""Drawing faults of a foreign file: duplicates, long outlines, odd angles, odd names, figures beyond the blank."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

from klayout import db

from maskfab.comparison.slivers import sift
from maskfab.drc.layout_rules import checked_extent, checked_names
from maskfab.drc.rules import DesignRules
from maskfab.geometry.plate_layout import NAME_LENGTH, layer_info
from maskfab.geometry.shape_limits import count_shapes, drawn_areas, own_polygons, weight
from maskfab.model import CLEAR, Plate, Quantity
from maskfab.units import NM_PER_MM, NM_PER_UM

GDSII_VERTICES = 8190
"""Most vertices of a GDSII polygon that every reader takes: a record has room for 8191, the first said twice."""

_GDSII_SUFFIXES = frozenset({".gds", ".gdsii", ".gds2"})
_NAMES = DesignRules(name_pattern="[A-Za-z0-9_?$]+", max_name_length=NAME_LENGTH)
_NM2_PER_UM2 = NM_PER_UM**2
_TOLD = 4

MOST_FLAT = 2_000_000
"""Shapes that are flattened to find where they overlap."""

MOST_FLAT_ALONE = 20_000
"""Of a file that is not the design: it fails, whatever its faults."""


def named_cells(read: db.Layout) -> Iterator[Quantity]:
    """The names of the file's cells: as the GDSII manual allows them, whatever the format."""
    pattern, length = checked_names([cell.name for cell in read.each_cell()], _NAMES)
    for result, what in (
        (pattern, "cells with names of other characters than A-Z a-z 0-9 _ ? $, which some software refuses"),
        (length, f"cells with names of more than {NAME_LENGTH} characters, which some software cuts short"),
    ):
        listed = ", ".join(map(repr, result.names[:_TOLD])) + (" and more" if result.count > _TOLD else "")
        yield Quantity(
            f"rule_{result.rule}", result.count, what + (f": {listed}" if listed else ""), limit=0, passed=result.passed
        )


@dataclass(frozen=True, eq=False)
class Known:
    """Facts known of a file that is aligned with a design.

    Attributes:
        design: its layout, in which nothing overlaps.
        differing: what only one of them makes clear, merged.
        tolerance_nm: what overlaps by no more than this is no fault.
    """

    design: db.Layout
    differing: db.Region
    tolerance_nm: float = 0.0

    @property
    def clear_nm2(self) -> int | None:
        """Area of all that the file makes clear; None where references of the design are scaled."""
        index = self.design.find_layer(layer_info(CLEAR))
        area = _drawn_area(self.design, index)
        if area is None or self.differing.is_empty():
            return area
        places = self.differing.extents().merged()
        near = db.RecursiveShapeIterator(self.design, self.design.top_cell(), index, places, True)
        lost = (self.differing & db.Region(near)).area()
        return area + int(self.differing.area()) - 2 * int(lost)


def drawn_figures(
    layout: db.Layout,
    path: Path,
    max_vertices: int | None,
    known: Known | None = None,
) -> Iterator[Quantity]:
    """Duplicate shapes, and outlines of too many vertices, in the layout's own coordinates.

    Args:
        layout: one top cell.
        path: its file.
        max_vertices: what the job draws at most; None where it does not say.
        known: the design that it lies upon, and how little it differs; None where there is none.
    """
    yield _overlaps(layout, path, known)
    most = max_vertices if max_vertices is not None else GDSII_VERTICES
    judged = max_vertices is not None or path.suffix.lower() in _GDSII_SUFFIXES
    long = list(_long_outlines(layout, most))
    by = "the job's max_vertices" if max_vertices is not None else "what GDSII takes"
    told = "".join(f": {count} in cell {cell!r}" for cell, count in long[:1])
    yield Quantity(
        "rule_vertices",
        len(long),
        f"polygons of {path.name} with more than {most} vertices, {by}{told}",
        detail=str(most),
        limit=0 if judged else None,
        passed=not long if judged else None,
    )


def slanted(laid: db.Layout, design: db.Layout | None) -> Quantity:
    """Edges as drawn that run along neither axis, but for those of shapes of the design that have such edges, too."""
    method = "edges as drawn that run along neither x nor y"
    edges = db.Edges()
    around = db.Region()
    if _any_slanted(laid):
        if design is None and _too_many(laid, laid.find_layer(layer_info(CLEAR))):
            method += f"; not counted among more than {MOST_FLAT_ALONE} shapes, of which some have any"
            return Quantity("rule_manhattan", None, method, limit=0, passed=False)
        edges = _slanted_edges(laid)
        around = db.Region() if design is None else _slanted_polygons(design).extents(1)
    left = edges if around.is_empty() else edges.not_interacting(around)
    boxes = sorted((edge.bbox() for edge in left.each()), key=lambda box: (box.bottom, box.left))
    told = f", at {_listed(boxes)} um" if boxes else ""
    method += "" if design is None else ", where no shape of the design has any"
    return Quantity("rule_manhattan", len(boxes), method + told, limit=0, passed=not boxes)


def reach(plate: Plate, box: db.Box, size: float) -> Quantity:
    """Distance by which the drawing extends beyond the blank.

    Args:
        plate: the design.
        box: of all that the file draws, lying as the design does.
        size: nanometres of the plate that one of the file becomes.
    """
    side = round(plate.blank_nm * size)
    boxes = [] if box.empty() else [(box.left, box.bottom, box.right, box.top)]
    found = checked_extent(boxes, (side, side))
    beyond = found.value / size / NM_PER_UM if isinstance(found.value, int | float) else 0
    return Quantity(
        "rule_extent",
        beyond,
        f"how far what is drawn reaches beyond the blank of {plate.blank_nm / NM_PER_MM:g} mm",
        limit=0,
        passed=found.passed,
    )


def _overlaps(layout: db.Layout, path: Path, known: Known | None) -> Quantity:
    """Where the areas of all shapes sum up to what is clear, none overlap."""
    index = layout.find_layer(layer_info(CLEAR))
    tolerance_nm = 0.0 if known is None else known.tolerance_nm
    what = f"areas of {path.name} that are drawn more than once"
    what += f" and wider than {tolerance_nm:g} nm" if tolerance_nm else ""
    clear_nm2 = None if known is None else known.clear_nm2
    if clear_nm2 is not None and _drawn_area(layout, index) == clear_nm2:
        return Quantity("rule_overlap", 0, what, limit=0, passed=True)
    most = MOST_FLAT if known is not None else MOST_FLAT_ALONE
    if _too_many(layout, index) if known is None else count_shapes(layout, [index]) > most:
        what += f"; not looked for among more than {most} shapes"
        return Quantity("rule_overlap", None, what)
    # In hierarchy klayout takes two references to one cell at one place for one.
    twice = list(sift(db.Region(layout.top_cell().begin_shapes_rec(index)).merged(True, 2), tolerance_nm).faults.each())
    area = sum(polygon.area() for polygon in twice) / _NM2_PER_UM2
    boxes = sorted((polygon.bbox() for polygon in twice), key=lambda box: (box.bottom, box.left))
    told = f": {area:g} um^2, at {_listed(boxes)} um" if boxes else ""
    return Quantity("rule_overlap", len(boxes), what + told, limit=0, passed=not boxes)


def _too_many(layout: db.Layout, index: int) -> bool:
    return weight(layout.top_cell().begin_shapes_rec(index), MOST_FLAT_ALONE) > MOST_FLAT_ALONE


def _drawn_area(layout: db.Layout, index: int) -> int | None:
    """Sum of the areas of all shapes in nm², every reference followed; None where some are scaled."""
    if any(each.is_complex() for cell in layout.each_cell() for each in cell.each_inst()):
        return None
    return int(drawn_areas(layout, index)[layout.top_cell().cell_index()])


def _long_outlines(layout: db.Layout, most: int) -> Iterator[tuple[str, int]]:
    index = layout.find_layer(layer_info(CLEAR))
    for cell in layout.each_cell():
        for polygon in own_polygons(cell, index).each():
            if polygon.num_points() > most:
                yield cell.name, polygon.num_points()


def _any_slanted(layout: db.Layout) -> bool:
    index = layout.find_layer(layer_info(CLEAR))
    for cell in layout.each_cell():
        if not own_polygons(cell, index).non_rectilinear().is_empty() or any(
            each.is_complex() for each in cell.each_inst()
        ):
            return True
    return False


def _slanted_polygons(layout: db.Layout) -> db.Region:
    store = db.DeepShapeStore()
    drawn = db.Region(layout.top_cell().begin_shapes_rec(layout.find_layer(layer_info(CLEAR))), store)
    drawn.merged_semantics = False
    found = db.Region(list(drawn.non_rectilinear().each()))
    found.merged_semantics = False
    return found


def _slanted_edges(layout: db.Layout) -> db.Edges:
    edges = _slanted_polygons(layout).edges()
    edges.merged_semantics = False
    found = edges.with_angle(db.Edges.OrthoEdges, True)
    found.merged_semantics = False
    return found


def _listed(boxes: Iterable[db.Box]) -> str:
    first = list(boxes)[:_TOLD]
    return ", ".join(f"({box.left / NM_PER_UM:g}, {box.bottom / NM_PER_UM:g})" for box in first)
