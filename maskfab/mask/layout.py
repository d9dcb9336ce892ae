"""Plates as hierarchical layouts, layouts as regions, and limits within which a layout can be worked with.

A layout keeps one cell per orientation of an opening and places it thousands of times; nothing is flattened until a
question needs it. Database unit: 1 nm. Outlines and references pass between arrays and klayout as records of GDSII in
memory: made one by one, a million polygons take half a minute, and ten thousand references longer than all else that a
plate is drawn by.

Nothing is repaired. A polygon that crosses itself means one thing to a writer that fills by winding and another to one
that fills by parity, so it is refused; vertices and polygons that have no meaning at all are counted."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TypeAlias

import numpy as np
from klayout import db

from maskfab.base.arrays import Floats, Ints, Mask, distinct
from maskfab.base.errors import OutputError, SourceError
from maskfab.base.model import CLEAR, LAYERS, NOTE, Box, Die, Layer, Panel, Plate, Point, Polygon
from maskfab.base.units import NM_PER_UM
from maskfab.mask.crossings import meets_itself
from maskfab.mask.outlines import UnitKey, unit_key, unit_name, unit_shapes
from maskfab.mask.raster import disjoint, placed_boxes

_MOST_CORNERS = 8190
_AT_LEAST = 1e-9
"""Share of the lengths multiplied in a cross product that it exceeds where it is other than 0, whatever is rounded."""

LIBRARY = (
    bytes.fromhex("00060002 0258 001c0102") + bytes(24) + bytes.fromhex("00060206 4100")
    + bytes.fromhex("00140305 3e4189374bc6a7f0 3944b82fa09b5a54")
)  # fmt: skip
"""HEADER, BGNLIB, LIBNAME, and UNITS of a nanometre and a thousandth of the user's."""
STRUCTURE_END, LIBRARY_END = bytes.fromhex("00040700"), bytes.fromhex("00040400")
_BOUNDARY, _LAYER, _OF_LAYER, _DATATYPE, _XY, _ENDEL = 0x00040800, 0x00060D02, 0x0006, 0x0E020000, 0x1003, 0x00041100
_WORDS_BEFORE, _WORDS_AROUND = 5, 6


def is_plain(corners: Ints, sizes: Ints) -> Mask:
    """Which outlines :func:`outlines_layout` draws as they are: every corner turns, and the whole has an area.

    Args:
        corners: int64 [sum of sizes, 2], those of each outline after those of the one before, in nanometres.
        sizes: int64 [n], how many corners each has.

    Returns:
        bool [n]; False too for outlines of so many corners that no record holds them, or of none.
    """
    fit = (sizes >= 3) & (sizes <= _MOST_CORNERS)
    fitting = np.repeat(fit, sizes)
    if not fitting.any():
        return fit
    many, own = sizes[fit], corners[fitting].astype(np.float64)
    ends = np.cumsum(many)
    starts = ends - many
    after = np.arange(1, len(own) + 1)
    after[ends - 1] = starts
    along = own[after] - own
    turn = _turns(along, along[after])
    away = own - np.repeat(own[starts], many, axis=0)
    area = along[:, 1] * away[:, 0], along[:, 0] * away[:, 1]
    twice = np.add.reduceat(area[0] - area[1], starts)
    rounded = _AT_LEAST * np.add.reduceat(np.abs(area[0]) + np.abs(area[1]), starts)
    fit[fit] = np.logical_and.reduceat(turn, starts) & (np.abs(twice) > rounded)
    return fit


def _turns(before: Floats, after: Floats) -> Mask:
    one, other = before[:, 0] * after[:, 1], before[:, 1] * after[:, 0]
    return np.abs(one - other) > _AT_LEAST * (np.abs(one) + np.abs(other))


def outlines_layout(corners: Ints, sizes: Ints, layers: Ints) -> db.Layout:
    """Outlines that are :func:`is_plain`, upright rectangles as boxes, in the one cell of a layout.

    Args:
        corners: int64 [sum of sizes, 2] in nanometres, each within 31 bits.
        sizes: int64 [n].
        layers: int64 [n], each from 0 to 32767: the number of the layer that an outline lies on, of datatype 0.
    """
    ends = np.cumsum(2 * sizes + _WORDS_AROUND + 2)
    starts = ends - (2 * sizes + _WORDS_AROUND + 2)
    words = np.empty(int(ends[-1]) if len(ends) else 0, dtype=">u4")
    for place, word in enumerate(
        (_BOUNDARY, _LAYER, layers << 16 | _OF_LAYER, _DATATYPE, (8 * sizes + 12) << 16 | _XY)
    ):
        words[starts + place] = word
    words[ends - 1] = _ENDEL
    first = np.cumsum(sizes) - sizes
    # Each outline's first corner is said again behind its last.
    at = np.repeat(starts + _WORDS_BEFORE - 2 * first, sizes) + 2 * np.arange(len(corners))
    values = corners.astype(np.int32).view(np.uint32)
    for axis in (0, 1):
        words[at + axis] = values[:, axis]
        words[ends - 3 + axis] = values[first, axis]
    layout = db.Layout()
    read_records(layout, b"".join([LIBRARY, structure("A"), words.tobytes(), STRUCTURE_END, LIBRARY_END]))
    return layout


def structure(name: str) -> bytes:
    """BGNSTR and STRNAME."""
    text = name.encode("ascii")
    text += bytes(len(text) % 2)
    return bytes.fromhex("001c0502") + bytes(24) + (4 + len(text)).to_bytes(2, "big") + b"\x06\x06" + text


def read_records(layout: db.Layout, stream: bytes) -> None:
    """Add what a stream of GDSII holds to the cells of a layout that have the names of its structures."""
    options = db.LoadLayoutOptions()
    options.warn_level = 0
    layout.read_bytes(stream, options)


DBU_UM = 0.001

_SREF, _SNAME, _GRID_XY, _GRID_ENDEL = b"\x00\x04\x0a\x00", b"\x12\x06", b"\x00\x0c\x10\x03", b"\x00\x04\x11\x00"
_AT_ORIGIN = _GRID_XY + bytes(8) + _GRID_ENDEL


@dataclass(frozen=True, eq=False)
class CellArray:
    """Cells in rows and columns, none mirrored, turned or scaled.

    Attributes:
        index: int64 [rows, columns] into ``cells``, row 0 lowest.
        origin_nm: of the cell [0, 0], in coordinates of the die.
    """

    cells: tuple[str, ...]
    index: Ints
    origin_nm: Point
    step_nm: Point


def placed(names: Iterable[str], grids: Mapping[str, Sequence[CellArray]]) -> db.Layout:
    """A layout of empty cells and of the grids in some of them.

    A grid of one cell is one array; of others every place has a reference. Database unit: 1 nm. Cells are in the order
    of their names, except that one comes first which neither has grids nor is in any.

    Args:
        names: of all cells; one at least, such as the top cell, neither has grids nor is in any.
        grids: by the name of the cell that they fill; not all cells have some.
    """
    ordered = sorted(names)
    among = {*grids, *(cell for filled in grids.values() for grid in filled for cell in grid.cells)}
    first = next(name for name in ordered if name not in among)
    ordered.remove(first)
    # Cells are made where they are first named: so the first one places all others, for a moment.
    stream = [LIBRARY, structure(first), *(_head(name) + _AT_ORIGIN for name in ordered), STRUCTURE_END]
    for name in ordered:
        stream += [structure(name), *(_references(grid) for grid in grids.get(name, ())), STRUCTURE_END]
    layout = db.Layout()
    read_records(layout, b"".join([*stream, LIBRARY_END]))
    layout.cell(first).clear_insts()
    layout.clear_meta_info()  # of the stream, which would be written with the plate
    layout.dbu = DBU_UM
    for name, filled in grids.items():
        for grid in filled:
            if len(grid.cells) == 1:
                layout.cell(name).insert(_array(layout, grid))
    return layout


def _array(layout: db.Layout, grid: CellArray) -> db.CellInstArray:
    (dx, dy), (rows, columns) = grid.step_nm, grid.index.shape
    index = layout.cell(grid.cells[0]).cell_index()
    return db.CellInstArray(index, db.Trans(*grid.origin_nm), db.Vector(dx, 0), db.Vector(0, dy), columns, rows)


def _references(grid: CellArray) -> bytes:
    if len(grid.cells) == 1:
        return b""
    width = max(map(len, grid.cells))
    heads = [_head(name, width) for name in grid.cells]
    # A record for each kind of cell, its place still to be written.
    kinds = np.frombuffer(b"".join(head + _AT_ORIGIN for head in heads), dtype=np.uint8).reshape(len(heads), -1)
    rows, columns = grid.index.shape
    places = np.empty((rows, columns, 2), dtype=">i4")
    places[..., 0] = grid.origin_nm[0] + grid.step_nm[0] * np.arange(columns)
    places[..., 1] = grid.origin_nm[1] + grid.step_nm[1] * np.arange(rows)[:, None]
    records, start = kinds[grid.index.ravel()], len(heads[0]) + len(_GRID_XY)
    records[:, start : start + places.itemsize * 2] = places.reshape(-1, 2).view(np.uint8)
    return records.tobytes()


def _head(name: str, width: int = 0) -> bytes:
    """SREF and SNAME, the name filled up to that width."""
    width = max(width, len(name))
    width += width % 2
    return _SREF + (4 + width).to_bytes(2, "big") + _SNAME + name.encode("ascii").ljust(width, b"\0")


MOST_SHAPES = 1_000_000_000
MOST_LEVELS = 500
MOST_LAYERS = 4096
"""klayout compares each name with all others."""

MOST_CELLS = 20_000
"""A mask has some for each of its dies; every one costs time on every layer."""

MOST_COVERED = 100
"""Times that one place is drawn; a plate draws it once, and sides cross as often as that squared."""

MOST_VERTICES = 2_000_000
"""Vertices of one polygon; mask writers take some thousands."""

# From so many vertices on klayout's check of a polygon is the slower, and from so many on it takes minutes.
_SWEPT, _SWEPT_ALONE = 5_000, 100_000

FARTHEST_NM = 1_000_000_000
ROUNDING_KEY = "maskfab_rounding_nm"
LEFT_OUT_KEY = "maskfab_left_out"


@dataclass(frozen=True)
class LeftOut:
    """Content of a file without any effect on its geometry.

    Attributes:
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
    """Notes by :mod:`maskfab.mask.formats.table` on the file that the layout came from."""
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


PlacedCells: TypeAlias = Mapping[int, Mapping[tuple[int, float], tuple[int, int]]]


def placed_cells(layout: db.Layout) -> PlacedCells:
    """References of each cell, children before parents, told once for all who ask: a panel has thousands of them.

    Returns:
        By the cell's index, by the index of what it places and how many times as large it does so, 0 for a plain
        reference: how often, and how far from its own origin at most, in nanometres.
    """
    every: dict[int, dict[tuple[int, float], tuple[int, int]]] = {}
    for index in layout.each_cell_bottom_up():
        placed = every[index] = {}
        for instance in layout.cell(index).each_inst():
            to, size = instance.trans.disp, instance.size()
            far = max(abs(to.x), abs(to.y))
            if size > 1:
                far += max(0, instance.na - 1) * max(abs(instance.a.x), abs(instance.a.y))
                far += max(0, instance.nb - 1) * max(abs(instance.b.x), abs(instance.b.y))
            key = instance.cell_index, instance.cplx_trans.mag if instance.is_complex() else 0.0
            times, farthest = placed.get(key, (0, 0))
            placed[key] = times + size, max(farthest, far)
    return every


def count_shapes(layout: db.Layout, layers: list[int] | None = None, placed: PlacedCells | None = None) -> int:
    """Polygons, boxes and paths below all top cells, every reference followed; on all layers if None."""
    indices = list(layout.layer_indexes()) if layers is None else layers
    return _count(layout, lambda cell: sum(cell.shapes(layer).size() for layer in indices), placed)


def count_texts(layout: db.Layout, layer: int) -> int:
    """Texts on a layer below all top cells, every reference followed."""
    return _count(layout, lambda cell: sum(1 for _ in cell.shapes(layer).each(db.Shapes.STexts)))


def count_vertices(layout: db.Layout) -> int:
    """Vertices of what :func:`count_shapes` counts."""

    def own(cell: db.Cell) -> int:
        raw = [db.Region(cell.shapes(layer)) for layer in layout.layer_indexes()]
        for shapes in raw:
            shapes.merged_semantics = False
        return sum(region.edges().count() for region in raw)

    return _count(layout, own)


def weight(shapes: db.RecursiveShapeIterator, most: int, largest: int = 2**31) -> int:
    """Rectangles that take as long to work with as some shapes: a quarter of their vertices, at least one for each.

    Counted until there are more than ``most``, for a few cells may place billions of shapes; a shape counts ``largest``
    at most.
    """
    count = 0
    for place in shapes.each():
        shape = place.shape()
        count += 1 if shape.is_box() or not shape.is_polygon() else min(largest, -(-shape.polygon.num_points() // 4))
        if count > most:
            break
    return count


def drawn_areas(layout: db.Layout, index: int, placed: PlacedCells | None = None) -> dict[int, float]:
    """Sum in nm² of the areas of each cell's shapes on a layer, by its index, every reference followed."""
    areas: dict[int, float] = {}
    for cell, within in (placed or placed_cells(layout)).items():
        own = db.Region(layout.cell(cell).shapes(index))
        own.merged_semantics = False
        areas[cell] = own.area() + sum(
            count * (larger**2 or 1) * areas[child] for (child, larger), (count, _) in within.items()
        )
    return areas


def most_covered(layout: db.Layout, index: int, placed: PlacedCells | None = None) -> float:
    """Number of times that the shapes of a layer cover the box about them, in the cell where they do so most."""
    areas, covered = drawn_areas(layout, index, placed), 0.0
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


def _count(layout: db.Layout, own: Callable[[db.Cell], int], placed: PlacedCells | None = None) -> int:
    counts: dict[int, int] = {}
    for cell, within in (placed or placed_cells(layout)).items():
        counts[cell] = own(layout.cell(cell)) + sum(times * counts[child] for (child, _), (times, _) in within.items())
    return sum(counts[cell.cell_index()] for cell in layout.top_cells())


def check_limits(layout: db.Layout, path: Path, placed: PlacedCells | None = None) -> None:
    """Refuse what cannot be worked with in reasonable time, and what could mean two things.

    Raises:
        SourceError: MF312 a polygon crosses or covers itself, MF313 too many shapes or too deep a hierarchy, MF326
            shapes that cover one place many times over.
    """
    placed = placed or placed_cells(layout)
    check_size(layout, path, placed)
    for layer in layout.layer_indexes():
        covered = most_covered(layout, layer, placed)
        if covered > MOST_COVERED:
            what = (
                f"{path.name}: its shapes cover the box about them {covered:.3g} times over; the limit is "
                f"{MOST_COVERED}"
            )
            cure = "Draw each place once: merge what overlaps, or mend the steps of its arrays"
            raise SourceError("MF326", what, where=str(path), cure=cure)
        for cell in layout.each_cell():
            if not cell.shapes(layer).is_empty():
                _refuse_crossing(cell, layer, path)


def refuse_long(longest: int, path: Path) -> None:
    """Refuse a polygon of too many vertices before it is drawn. Raises SourceError MF313."""
    if longest > MOST_VERTICES:
        what = f"{path.name} has a polygon of {longest} vertices; the limit is {MOST_VERTICES}"
        cure = "Split it into polygons of fewer vertices, as mask writers ask"
        raise SourceError("MF313", what, where=str(path), cure=cure)


def check_size(layout: db.Layout, path: Path, placed: PlacedCells | None = None) -> int:
    """Refuse what cannot be worked with in reasonable time; returns how many shapes there are.

    Raises:
        SourceError: MF313 too many shapes, too deep a hierarchy, or too far from the origin.
    """
    if layout.layers() > MOST_LAYERS:
        raise too_many_layers(path)
    if layout.cells() > MOST_CELLS:
        raise too_many_cells(path)
    depth = max((cell.hierarchy_levels() for cell in layout.top_cells()), default=0)
    if depth > MOST_LEVELS:
        what = f"{path.name} nests {depth} cells; the limit is {MOST_LEVELS}"
        raise SourceError("MF313", what, where=str(path), cure="Flatten some levels of the hierarchy before export")
    placed = placed or placed_cells(layout)
    shapes = count_shapes(layout, placed=placed)
    if shapes > MOST_SHAPES:
        what = f"{path.name} draws {shapes:.3g} shapes, references followed; the limit is {MOST_SHAPES:.0e}"
        raise SourceError("MF313", what, where=str(path), cure="Export the plate without arrays outside of it")
    _refuse_distant(layout, path, placed)
    return shapes


def too_many_layers(path: Path) -> SourceError:
    """MF313 for more than :data:`MOST_LAYERS`."""
    return _too_many(path, f"{MOST_LAYERS} layers", "Write the layers of the mask alone")


def too_many_cells(path: Path) -> SourceError:
    """MF313 for more than :data:`MOST_CELLS`."""
    return _too_many(path, f"{MOST_CELLS} cells", "Flatten it in part, and write the cells of the mask alone")


def _too_many(path: Path, most: str, cure: str) -> SourceError:
    return SourceError("MF313", f"{path.name} has over {most}", where=str(path), cure=cure)


def _refuse_distant(layout: db.Layout, path: Path, placed: PlacedCells) -> None:
    """Refuse what lies beyond a metre: near two metres klayout's own boxes and booleans overflow without a word."""
    reaches: dict[int, int] = {}
    for index, within in placed.items():
        cell = layout.cell(index)
        boxes = [db.Region(cell.shapes(layer)).bbox() for layer in layout.layer_indexes()]
        reach = max(
            (max(abs(box.left), abs(box.bottom), abs(box.right), abs(box.top)) for box in boxes if not box.empty()),
            default=0,
        )
        for (child, larger), (_, far) in within.items():
            reach = max(reach, far + round((1.5 * larger or 1.0) * reaches[child]))
        reaches[index] = reach
        if reach > FARTHEST_NM:
            what = f"{path.name}: cell {cell.name!r} reaches {reach / 1e9:.3g} m from its origin; the limit is 1 m"
            cure = "Check the unit, and delete shapes far from the origin"
            raise SourceError("MF313", what, where=str(path), cure=cure)


def _refuse_crossing(cell: db.Cell, layer: int, path: Path) -> None:
    raw = own_polygons(cell, layer)
    # Files of very many polygons seldom have one of so many vertices, and are not to be laid anew for the asking.
    if any(polygon.num_points() >= _SWEPT for polygon in raw.each()):
        raw = _without_simple(raw, cell, path)
    try:
        crossing = raw.strange_polygon_check()
    except RuntimeError:  # klayout gave up on them
        crossing = raw
    if not crossing.is_empty():
        first = next(crossing.each()).bbox().p1
        raise _crosses(cell, path, first.x, first.y, f"; {crossing.count()} such places")


def _without_simple(raw: db.Region, cell: db.Cell, path: Path) -> db.Region:
    """Polygons of a cell, without those of many vertices that surely do not cross themselves."""
    rest = db.Region()
    rest.merged_semantics = False
    for polygon in raw.each():
        meeting = None
        if polygon.num_points() >= _SWEPT and not polygon.holes():
            along = (place for corner in polygon.each_point_hull() for place in (corner.x, corner.y))
            meeting = meets_itself(np.fromiter(along, dtype=np.int64).reshape(-1, 2))
            if meeting is None:
                continue
        if meeting is not None and polygon.num_points() > _SWEPT_ALONE:
            raise _crosses(cell, path, int(meeting[0]), int(meeting[1]), ", or touches itself")
        rest.insert(polygon)
    return rest


def _crosses(cell: db.Cell, path: Path, x: int, y: int, more: str) -> SourceError:
    return SourceError(
        "MF312",
        f"{path.name}: a polygon of cell {cell.name!r} crosses or covers itself at ({x / NM_PER_UM:g}, "
        f"{y / NM_PER_UM:g}) um of the cell{more}",
        where=str(path),
        cure="Draw it as polygons that do not cross themselves",
    )


_MOST_TURNED = 5_000_000
NAME_LENGTH = 32


def plate_layout(plate: Plate) -> db.Layout:
    """The plate as a hierarchy of cells: top, dies, and one cell per opening, dot, gutter and orientation in use.

    A periodic die is one array reference, any other one reference per cell; nothing is mirrored, turned or scaled.
    Marks have a cell each. For the order of the cells see :func:`maskfab.mask.layout.placed`; every format
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
                    insert_polygons(cells[names.units[key]].shapes(layers[layer]), polygons)
    for die, die_name in zip(plate.dies, names.dies, strict=True):
        top.insert(db.CellInstArray(cells[die_name].cell_index(), db.Trans(*die.origin_nm)))
    for mark, mark_name in zip(plate.marks, names.marks, strict=True):
        insert_polygons(cells[mark_name].shapes(layers[mark.layer]), mark.polygons)
        top.insert(db.CellInstArray(cells[mark_name].cell_index(), db.Trans()))
    for note in plate.notes:
        top.shapes(layers[NOTE]).insert(db.Text(note.text, db.Trans(*note.position_nm)))
    return layout


def region(
    layout: db.Layout, layer: Layer | db.LayerInfo, box_nm: Box | None = None, cell: str | None = None
) -> db.Region:
    """Everything on a layer, flattened and merged; corners that kiss stay apart.

    Args:
        layer: a layer of the plate, or one found by :func:`maskfab.mask.formats.content.find_layer`; the region of a
            layer that the layout lacks is empty.
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


def clear_shapes(layout: db.Layout, box_nm: Box) -> db.Region | Ints:
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
    placed = (reference for cell in layout.each_cell() for reference in cell.each_inst())
    slanted = any(instance.is_complex() and not instance.cplx_trans.is_ortho() for instance in placed)
    if not slanted or count_shapes(layout, [index]) > _MOST_TURNED:
        return layout.top_cell().bbox(index)
    drawn = db.Region(layout.top_cell().begin_shapes_rec(index))
    drawn.merged_semantics = False
    return drawn.extents().bbox()


def layer_info(layer: Layer) -> db.LayerInfo:
    """The layer as klayout knows it, by number, datatype and name."""
    return db.LayerInfo(layer.number, layer.datatype, layer.name)


def simple_polygon(polygon: Polygon) -> db.SimplePolygon:
    """A klayout polygon with exactly these vertices."""
    return db.SimplePolygon([db.Point(x, y) for x, y in polygon], True)


def drawn_region(polygons: Iterable[Polygon]) -> db.Region:
    """Polygons as a region, each as it is drawn."""
    return db.Region([db.Polygon(simple_polygon(polygon)) for polygon in polygons])


def references(die: Die, *, paired: bool = False) -> int:
    """References inside a die, an array counting once; ``paired`` if two pixels share a cell."""
    rows, columns = die.panel.orientations.shape
    if len(orientations_in_use(die.panel)) == 1:
        return 1
    return int(rows * (columns // 2 + columns % 2) if paired else rows * columns)


def file_references(plate: Plate, *, paired: bool = False) -> int:
    """References of a plate's file: those in its dies, and one for each die and mark."""
    return sum(references(die, paired=paired) + 1 for die in plate.dies) + len(plate.marks)


def orientations_in_use(panel: Panel) -> tuple[int, ...]:
    """The elements of D4 that at least one cell of the panel takes, ascending."""
    return tuple(int(orientation) for orientation in distinct(panel.orientations))


@dataclass(frozen=True)
class PlateNames:
    """Cell names of a plate, the same in every format; ``units`` as ``OPENING_D<dot>_G<gutter>_R<orientation>``."""

    top: str
    dies: tuple[str, ...]
    marks: tuple[str, ...]
    units: Mapping[UnitKey, str]


def plate_names(plate: Plate) -> PlateNames:
    """The cell names of a plate."""
    names = CellNames()
    top = names.unique(plate.name)
    dies = tuple(names.unique(die.name) for die in plate.dies)
    marks = tuple(names.unique(mark.name) for mark in plate.marks)
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


def insert_polygons(shapes: db.Shapes, polygons: Iterable[Polygon]) -> None:
    """Draw polygons with exactly their vertices."""
    for polygon in polygons:
        shapes.insert(simple_polygon(polygon))


def check_file_size(expected: int, limit: int, path: Path, cure: str) -> None:
    """Refuse (MF415) a file that would have more bytes than allowed, before a byte of it is written."""
    if expected > limit:
        what = f"{path.name} would have about {expected / 1e6:,.0f} MB; at most {limit / 1e6:,.0f} MB"
        raise OutputError("MF415", what, cure=cure)
