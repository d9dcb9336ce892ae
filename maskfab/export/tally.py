"""What the limits of mask software count in the figures of a plate."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from klayout import db

from maskfab.export.figures import Figures, Shapes
from maskfab.geometry.region import simple_polygon
from maskfab.geometry.unit import unit_shapes
from maskfab.model import CLEAR, Die, Plate, Polygon


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


def flashes(plate: Plate) -> int:
    """Rectangles that a pattern generator exposes for the whole plate, every reference followed.

    Outlines are cut into horizontal bars; slanted strokes of letters count as the trapezoids they are cut into, so
    the true number is not smaller.
    """
    total = sum(_bars(polygon) for mark in plate.furniture if mark.layer.written for polygon in mark.polygons)
    for die in plate.dies:
        held, times = np.unique(die.panel.orientations, return_counts=True)
        for cell, count in zip(held.tolist(), times.tolist(), strict=True):
            total += count * sum(_bars(polygon) for polygon in unit_shapes(die.panel, cell)[CLEAR])
    return total


def cut_cells(figures: Figures) -> tuple[str, ...]:
    """Cells and marks of which some written figures share a piece of edge, as those do that were cut at a hole."""
    named = {**figures.cells, **{mark.name: mark.shapes for mark in figures.marks}}
    found = [
        name
        for name, shapes in named.items()
        if any(_share_edges(_region(polygons)) for layer, polygons in shapes.items() if layer.written)
    ]
    found += [figures.top for region in figures.merged.values() if _share_edges(region.dup())]
    return tuple(sorted(found))


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


def _bars(polygon: Polygon) -> int:
    return int(db.Region(simple_polygon(polygon)).decompose_trapezoids_to_region().count())
