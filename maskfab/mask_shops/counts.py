"""Counts in the figures of a plate to which the limits of mask software apply."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from klayout import db

from maskfab.export.cell_polygons import Figures, Shapes
from maskfab.geometry.plate_layout import simple_polygon
from maskfab.mask_shops.stencil import inner_edges
from maskfab.model import Box, Die, Point, Polygon
from maskfab.plate.marks.drawing import bounding_box


def references(figures: Figures) -> int:
    """References of the file, an array counting once, or its definitions, whichever are more."""
    if figures.options.hierarchy != "cells":
        return 0
    outer = len(figures.dies) + len(figures.marks)
    return max(figures.account.references, figures.account.definitions) + outer


def longest(figures: Figures) -> int:
    """Vertices of the figure that has most."""
    counts = [len(polygon) for shapes in _drawn(figures) for polygons in shapes.values() for polygon in polygons]
    counts += [int(polygon.num_points()) for region in figures.merged.values() for polygon in region.each()]
    return max(counts, default=0)


def flashes(figures: Figures) -> int:
    """Rectangles that a pattern generator exposes for the whole plate, every reference followed.

    Outlines are cut into horizontal bars; slanted strokes of letters count as the trapezoids they are cut into, so
    the true number is not smaller.
    """
    total = sum(_all_bars(mark.shapes) for mark in figures.marks)
    total += sum(int(region.decompose_trapezoids_to_region().count()) for region in figures.merged.values())
    for die in figures.dies:
        for grid in die.grids:
            held, times = np.unique(grid.index, return_counts=True)
            bars = (_all_bars(figures.cells[grid.cells[number]]) for number in held.tolist())
            total += sum(count * each for count, each in zip(times.tolist(), bars, strict=True))
    return total


def _all_bars(shapes: Shapes) -> int:
    drawn = (_region(polygons) for layer, polygons in shapes.items() if layer.written)
    return sum(int(region.decompose_trapezoids_to_region().count()) for region in drawn)


@dataclass(frozen=True)
class Shared:
    """Pieces of edge that figures of a die or a mark share.

    Attributes:
        owner: the die or mark, such as ``die HOLE``.
        cell: the cell in which they lie; empty where figures are merged across cells.
        length_nm: of all of them, each told once; in a cell, of one of its references.
        first_nm: an end of one, in coordinates of the cell, or of the plate where there is none.
    """

    owner: str
    cell: str
    length_nm: int
    first_nm: Point


def shared_edges(figures: Figures) -> tuple[Shared, ...]:
    """Where written figures share a piece of edge, as those do that were cut at a hole; dies first."""
    users = {name: f"die {die.name}" for die in reversed(figures.dies) for grid in die.grids for name in grid.cells}
    named = {name: (users[name], shapes) for name, shapes in figures.cells.items()}
    named |= {mark.name: (f"mark {mark.name}", mark.shapes) for mark in figures.marks}
    found: list[Shared] = []
    for name, (owner, shapes) in named.items():
        for layer, polygons in shapes.items():
            if layer.written:
                edges = _edges(_region(polygons))
                found += [_shared(owner, name, edges)] if edges is not None else []
    for region in figures.merged.values():
        edges = _edges(region.dup())
        found += _by_owner(figures, edges) if edges is not None else []
    return tuple(found)


def cut_cells(figures: Figures) -> tuple[str, ...]:
    """Cells and marks of which some written figures share a piece of edge; the top cell where they are merged."""
    return tuple(sorted({shared.cell or figures.top for shared in shared_edges(figures)}))


def _by_owner(figures: Figures, edges: db.Edges) -> Iterator[Shared]:
    """Edges of figures that are merged across cells, by the die or else the mark that they lie in."""
    boxes: dict[str, Box] = {f"die {die.name}": die.box_nm for die in figures.plate.dies}
    for mark in figures.plate.furniture:
        if mark.layer.written and mark.polygons:
            boxes[f"mark {mark.name}"] = bounding_box(mark.polygons)
    for owner, box in boxes.items():
        inside = edges.inside_part(db.Region(db.Box(*box).enlarged(1, 1)))
        inside.merged_semantics = False
        if not inside.is_empty():
            yield _shared(owner, "", inside)


def _shared(owner: str, cell: str, edges: db.Edges) -> Shared:
    first = min((min(edge.p1, edge.p2) for edge in edges.each()), key=lambda point: (point.y, point.x))
    return Shared(owner, cell, int(edges.length()) // 2, (first.x, first.y))


def _edges(drawn: db.Region) -> db.Edges | None:
    """The edges that figures share, from either side; None where there are none, which is quickly told."""
    if not _share_edges(drawn):
        return None
    return inner_edges(drawn)


def facing_dots(die: Die) -> int:
    """Pairs of dots, clear in two neighbouring cells of a die, that meet by a side for want of a gutter."""
    panel = die.panel
    if panel.gutter_nm:
        return 0
    held, codes = np.unique(panel.orientations, return_inverse=True)
    codes = codes.reshape(panel.orientations.shape)
    dots = np.stack([panel.pattern(cell) for cell in held.tolist()]).astype(np.int64)
    across = dots[:, :, -1] @ dots[:, :, 0].T
    along = dots[:, -1, :] @ dots[:, 0, :].T
    return int(across[codes[:, :-1], codes[:, 1:]].sum() + along[codes[:-1], codes[1:]].sum())


def _drawn(figures: Figures) -> Iterator[Shapes]:
    for shapes in (*figures.cells.values(), *(mark.shapes for mark in figures.marks)):
        yield {layer: polygons for layer, polygons in shapes.items() if layer.written}


def _region(polygons: tuple[Polygon, ...]) -> db.Region:
    return db.Region([db.Polygon(simple_polygon(polygon)) for polygon in polygons])


def _share_edges(drawn: db.Region) -> bool:
    merged = drawn.merged(True, 1).perimeter()
    drawn.merged_semantics = False
    return bool(drawn.perimeter() > merged)
