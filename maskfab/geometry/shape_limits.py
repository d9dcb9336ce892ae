"""Limits of a layout to be processed: few enough shapes once its references are followed, none self-crossing.

Nothing is repaired. A polygon that crosses itself means one thing to a writer that fills by winding and another to
one that fills by parity, so it is refused; vertices and polygons that have no meaning at all are counted.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from klayout import db

from maskfab.errors import SourceError
from maskfab.units import NM_PER_UM

MOST_SHAPES = 1_000_000_000
MOST_LEVELS = 500
MOST_LAYERS = 4096
"""klayout compares each name with all others."""

MOST_CELLS = 20_000
"""A mask has some for each of its dies; every one costs time on every layer."""

MOST_COVERED = 100
"""Times that one place is drawn; a plate draws it once, and sides cross as often as that squared."""

MOST_VERTICES = 100_000
"""Of one polygon: what is done with it grows faster than they do, and mask writers take some thousands."""

FARTHEST_NM = 1_000_000_000
ROUNDING_KEY = "maskfab_rounding_nm"
LEFT_OUT_KEY = "maskfab_left_out"


@dataclass(frozen=True)
class LeftOut:
    """Content of a file without any effect on its geometry.

    Attributes:
        repeated_vertices: vertices that repeat the one before.
        empty_polygons: polygons without area.
        curves: arcs and circles that were made polygons, none further than 1 nm from the curve.
        grey_pixels: pixels of an image between black and white, taken for the nearer.
        texts: on the layer that is clear, which are no polygons.
    """

    repeated_vertices: int = 0
    empty_polygons: int = 0
    curves: int = 0
    grey_pixels: int = 0
    texts: int = 0


def left_out(layout: db.Layout) -> LeftOut:
    """Notes by :mod:`maskfab.readers.layout_file` on the file that the layout came from."""
    stated = layout.meta_info_value(LEFT_OUT_KEY)
    return LeftOut(*stated) if stated else LeftOut()


def note_left_out(layout: db.Layout, noted: LeftOut) -> None:
    """Keep what was left out with the layout, for :func:`left_out`."""
    counts = [noted.repeated_vertices, noted.empty_polygons, noted.curves, noted.grey_pixels, noted.texts]
    layout.add_meta_info(db.LayoutMetaInfo(LEFT_OUT_KEY, counts, "what has no effect on the geometry"))


def is_empty(polygon: db.Polygon) -> bool:
    """Whether a polygon covers nothing; one whose parts turn opposite ways has no net area, and covers something."""
    if polygon.num_points() < 3:
        return True
    return bool(polygon.area() == 0 and db.Region(polygon).merged().is_empty())


def count_shapes(layout: db.Layout, layers: list[int] | None = None) -> int:
    """Polygons, boxes and paths below all top cells, every reference followed; on all layers if None."""
    indices = list(layout.layer_indexes()) if layers is None else layers
    return _count(layout, lambda cell: sum(cell.shapes(layer).size() for layer in indices))


def count_texts(layout: db.Layout, layer: int) -> int:
    """Texts on a layer below all top cells, every reference followed."""
    return _count(layout, lambda cell: sum(1 for _ in cell.shapes(layer).each(db.Shapes.STexts)))


def count_vertices(layout: db.Layout) -> int:
    """Vertices of what :func:`count_shapes` counts."""

    def own(cell: db.Cell) -> int:
        raw = [db.Region(cell.shapes(layer)) for layer in layout.layer_indexes()]
        for each in raw:
            each.merged_semantics = False
        return sum(each.edges().count() for each in raw)

    return _count(layout, own)


def weight(shapes: db.RecursiveShapeIterator, most: int, largest: int = 2**31) -> int:
    """Rectangles that take as long to work with as some shapes: a quarter of their vertices, at least one for each.

    Counted until there are more than ``most``, for a few cells may place billions of shapes; a shape counts ``largest``
    at most.
    """
    found = 0
    for each in shapes.each():
        shape = each.shape()
        found += 1 if shape.is_box() or not shape.is_polygon() else min(largest, -(-shape.polygon.num_points() // 4))
        if found > most:
            break
    return found


def drawn_areas(layout: db.Layout, index: int) -> dict[int, float]:
    """By the index of each cell, the sum in nm² of the areas of its shapes on a layer, every reference followed."""
    areas: dict[int, float] = {}
    for cell_index in layout.each_cell_bottom_up():
        cell = layout.cell(cell_index)
        own = db.Region(cell.shapes(index))
        own.merged_semantics = False
        areas[cell_index] = own.area()
        for each in cell.each_inst():
            larger = each.cplx_trans.mag**2 if each.is_complex() else 1
            areas[cell_index] += each.cell_inst.size() * larger * areas[each.cell_index]
    return areas


def most_covered(layout: db.Layout, index: int) -> float:
    """Number of times that the shapes of a layer cover the box about them, in the cell where they do so most."""
    areas, covered = drawn_areas(layout, index), 0.0
    for cell in layout.each_cell():
        box = cell.bbox(index)
        if not box.empty() and box.area() > 0:
            covered = max(covered, areas[cell.cell_index()] / box.area())
    return covered


def own_polygons(cell: db.Cell, layer: int) -> db.Region:
    """Polygons and paths of a cell itself on a layer, each as it is drawn, without boxes, of which there are most."""
    shapes = cell.begin_shapes_rec(layer)
    shapes.max_depth = 0
    shapes.shape_flags = db.Shapes.SRegions & ~db.Shapes.SBoxes
    polygons = db.Region(shapes)
    polygons.merged_semantics = False
    return polygons


def _count(layout: db.Layout, own: Callable[[db.Cell], int]) -> int:
    counts: dict[int, int] = {}
    for index in layout.each_cell_bottom_up():
        cell = layout.cell(index)
        below = sum(each.cell_inst.size() * counts[each.cell_index] for each in cell.each_inst())
        counts[index] = own(cell) + below
    return sum(counts[cell.cell_index()] for cell in layout.top_cells())


def check_limits(layout: db.Layout, path: Path) -> None:
    """Refuse what cannot be worked with in reasonable time, and what could mean two things.

    Raises:
        SourceError: MF312 a polygon crosses or covers itself, MF313 too many shapes or too deep a hierarchy, MF326
            shapes that cover one place many times over.
    """
    check_size(layout, path)
    for layer in layout.layer_indexes():
        _refuse_overlaps(layout, layer, path)
        for cell in layout.each_cell():
            if not cell.shapes(layer).is_empty():
                _refuse_crossing(cell, layer, path)


def refuse_long(longest: int, path: Path) -> None:
    """Refuse a polygon of too many vertices before it is drawn.

    Raises:
        SourceError: MF313.
    """
    if longest > MOST_VERTICES:
        raise SourceError(
            "MF313",
            f"{path.name} has a polygon of {longest} vertices; the limit is {MOST_VERTICES}",
            where=str(path),
            cure="Split it into polygons of fewer vertices, as mask writers ask",
        )


def check_size(layout: db.Layout, path: Path) -> None:
    """Refuse what cannot be worked with in reasonable time.

    Raises:
        SourceError: MF313 too many shapes, too deep a hierarchy, or too far from the origin.
    """
    if layout.layers() > MOST_LAYERS:
        raise too_many_layers(path)
    if layout.cells() > MOST_CELLS:
        raise too_many_cells(path)
    depth = max((cell.hierarchy_levels() for cell in layout.top_cells()), default=0)
    if depth > MOST_LEVELS:
        raise SourceError(
            "MF313",
            f"{path.name} nests {depth} cells; the limit is {MOST_LEVELS}",
            where=str(path),
            cure="Flatten some levels of the hierarchy before export",
        )
    shapes = count_shapes(layout)
    if shapes > MOST_SHAPES:
        raise SourceError(
            "MF313",
            f"{path.name} draws {shapes:.3g} shapes, references followed; the limit is {MOST_SHAPES:.0e}",
            where=str(path),
            cure="Export the plate without arrays outside of it",
        )
    _refuse_distant(layout, path)


def too_many_layers(path: Path) -> SourceError:
    """MF313 for more than :data:`MOST_LAYERS`."""
    return _too_many(path, f"{MOST_LAYERS} layers", "Write the layers of the mask alone")


def too_many_cells(path: Path) -> SourceError:
    """MF313 for more than :data:`MOST_CELLS`."""
    return _too_many(path, f"{MOST_CELLS} cells", "Flatten it in part, and write the cells of the mask alone")


def _too_many(path: Path, most: str, cure: str) -> SourceError:
    return SourceError("MF313", f"{path.name} has over {most}", where=str(path), cure=cure)


def _refuse_distant(layout: db.Layout, path: Path) -> None:
    """Refuse what lies beyond a metre: near two metres klayout's own boxes and booleans overflow without a word."""
    reaches: dict[int, int] = {}
    for index in layout.each_cell_bottom_up():
        cell = layout.cell(index)
        boxes = [db.Region(cell.shapes(layer)).bbox() for layer in layout.layer_indexes()]
        reach = max(
            (max(abs(box.left), abs(box.bottom), abs(box.right), abs(box.top)) for box in boxes if not box.empty()),
            default=0,
        )
        for each in cell.each_inst():
            to = each.trans.disp
            far = max(abs(to.x), abs(to.y))
            if each.size() > 1:
                far += max(0, each.na - 1) * max(abs(each.a.x), abs(each.a.y))
                far += max(0, each.nb - 1) * max(abs(each.b.x), abs(each.b.y))
            grown = 1.5 * each.cplx_trans.mag if each.is_complex() else 1.0
            reach = max(reach, far + round(grown * reaches[each.cell_index]))
        reaches[index] = reach
        if reach > FARTHEST_NM:
            raise SourceError(
                "MF313",
                f"{path.name}: cell {cell.name!r} reaches {reach / 1e9:.3g} m from its origin; the limit is 1 m",
                where=str(path),
                cure="Check the unit, and delete shapes far from the origin",
            )


def _refuse_overlaps(layout: db.Layout, layer: int, path: Path) -> None:
    covered = most_covered(layout, layer)
    if covered > MOST_COVERED:
        raise SourceError(
            "MF326",
            f"{path.name}: its shapes cover the box about them {covered:.3g} times over; the limit is {MOST_COVERED}",
            where=str(path),
            cure="Draw each place once: merge what overlaps, or mend the steps of its arrays",
        )


def _refuse_crossing(cell: db.Cell, layer: int, path: Path) -> None:
    raw = own_polygons(cell, layer)
    try:
        crossing = raw.strange_polygon_check()
    except RuntimeError:  # klayout gave up on them
        crossing = raw
    if crossing.is_empty():
        return
    box = next(crossing.each()).bbox()
    raise SourceError(
        "MF312",
        f"{path.name}: a polygon of cell {cell.name!r} crosses or covers itself at ({box.left / NM_PER_UM:g}, "
        f"{box.bottom / NM_PER_UM:g}) um of the cell; {crossing.count()} such places",
        where=str(path),
        cure="Draw it as polygons that do not cross themselves",
    )
