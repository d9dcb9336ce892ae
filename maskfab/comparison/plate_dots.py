"""A plate's bitmap, read back row by row, against the polygons of the design: every dot, by its centre.

What should be there is told otherwise than it was written: polygons of the layout, as boxes and triangles, whose dots
are those of all half-planes that they lie in.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from klayout import db

from maskfab.base.arrays import Ints
from maskfab.comparison.bitmaps import smallest_nm
from maskfab.errors import JobError, SourceError
from maskfab.geometry.dot_grid import NM_PER_INCH, DotGrid
from maskfab.geometry.plate_layout import clear_shapes, layer_info
from maskfab.geometry.polygonize import hull_points, triangles
from maskfab.geometry.raster import to_boxes
from maskfab.jobfile.order import Tone
from maskfab.model import CLEAR, Die, Plate, Quantity
from maskfab.readers.plate_bitmap import PlateDots, read_plate_dots
from maskfab.units import NM_PER_UM

_BAND_ROWS = 4096
_ROUNDING = 1e-9
_MOST_PRODUCT = 2.0**62
"""Beyond it, products are worked out in whole numbers of any length."""


def check_dots(dies: Sequence[Die], dpi: int, where: str) -> None:
    """Refuse dots that are larger than the smallest feature of a die, for they would lose openings.

    Args:
        dies: what is plotted.
        dpi: dots per inch.
        where: the job file, for the error.

    Raises:
        JobError: MF104.
    """
    dot = NM_PER_INCH / dpi
    smallest, name = min(((smallest_nm(die, dot), die.name) for die in dies), default=(dot, ""))
    if dot > smallest * (1 + _ROUNDING):
        raise JobError(
            "MF104",
            f"{dpi} dpi are dots of {dot / NM_PER_UM:g} um, larger than the smallest feature of the die {name}, "
            f"{smallest / NM_PER_UM:g} um: such a bitmap loses openings",
            where=f"{where}: export.dpi",
            cure=f"Plot at {math.ceil(NM_PER_INCH / smallest)} dpi or more, or send polygons",
        )


def check_plate_dots(plate: Plate, design: db.Layout, path: Path, dpi: int, tone: Tone) -> Quantity:
    """Read a plate's TIFF or BMP back and compare every dot with the design.

    Args:
        plate: what was written.
        design: the plate, as :func:`maskfab.geometry.plate_layout.plate_layout`.
        path: the bitmap.
        dpi: dots per inch that it should have.
        tone: of the data.

    Returns:
        ``plate_bitmap_wrong_dots``, whose limit is 0; all dots if there are too many or too few, or of another size.

    Raises:
        SourceError: MF301 if there is no such file, else as of :func:`maskfab.readers.plate_bitmap.read_plate_dots`.
    """
    grid = DotGrid.of(plate, dpi)
    try:
        with path.open("rb") as file:
            read = read_plate_dots(path, file)
            if (read.width, read.height) != (grid.side, grid.side) or abs(read.dpi - dpi) > read.dpi_rounding:
                wrong = max(read.width * read.height, grid.side**2)
                method = (
                    f"{path.name} has {read.width} x {read.height} dots, {read.dpi:g} to the inch; "
                    f"the plate has {grid.side} x {grid.side}, {dpi} to the inch"
                )
            else:
                wrong, first = _compared(read, _Dots.of(plate, design, grid).rows(tone, upwards=read.upwards))
                method = (
                    f"{path.name}, {grid.side} x {grid.side} dots of {grid.dot_nm:g} nm read back; each is 1 where its "
                    "centre lies in a polygon of the design"
                ) + ("" if first is None else f"; the first that is wrong: {first[0]}, {first[1]} from the lower left")
    except OSError as error:
        raise SourceError(
            "MF301", f"there is no file {path}", where=str(path), cure="Run the job with that format in export.formats"
        ) from error
    return Quantity("plate_bitmap_wrong_dots", wrong, method, limit=0, passed=wrong == 0)


def _compared(read: PlateDots, drawn: Iterator[tuple[bytes, int]]) -> tuple[int, tuple[int, int] | None]:
    """Dots that differ, and the first of them in the order of the file."""
    wrong, first, done = 0, None, 0
    row, left = b"", 0
    for found, repeats in read.rows:
        count = repeats
        while count:
            if not left:
                row, left = next(drawn)
            alike = min(count, left)
            if found != row:
                apart = np.frombuffer(found, dtype=np.uint8) ^ np.frombuffer(row, dtype=np.uint8)
                wrong += alike * int(np.bitwise_count(apart).sum())
                if first is None:
                    column = int(np.flatnonzero(np.unpackbits(apart))[0])
                    first = column, done if read.upwards else read.height - 1 - done
            count, left, done = count - alike, left - alike, done + alike
    return wrong, first


@dataclass(frozen=True, eq=False)
class _Dots:
    """Dots of polygons.

    Attributes:
        blocks: int64 [n, 4] of the lowest row, the one above the highest, the first dot and the one beyond the last.
        grid: of all dots.
        half: of the side of the writable area, in nanometres.
    """

    blocks: Ints
    grid: DotGrid
    half: int

    @classmethod
    def of(cls, plate: Plate, design: db.Layout, grid: DotGrid) -> _Dots:
        centres = _centres(grid)
        found = {die.box_nm: clear_shapes(design, die.box_nm) for die in plate.dies}
        boxed = {box: boxes for box, boxes in found.items() if isinstance(boxes, np.ndarray)}
        blocks = [_box_dots(boxes, centres, grid) for boxes in boxed.values()]
        for polygon in _polygons_beside([db.Box(*box) for box in boxed], design):
            region = db.Region(polygon)
            if polygon.is_rectilinear():
                blocks.append(_box_dots(to_boxes(region), centres, grid))
            else:
                blocks += [_triangle_dots(each, centres, grid) for each in triangles(region).each()]
        return cls(np.concatenate([np.empty((0, 4), dtype=np.int64), *blocks]), grid, plate.writable_nm // 2)

    def rows(self, tone: Tone, *, upwards: bool) -> Iterator[tuple[bytes, int]]:
        """Rows as they should be, and how often each comes."""
        side = self.grid.side
        low, high = np.searchsorted(
            _centres(self.grid), [-self.half * 2 * self.grid.dpi, self.half * 2 * self.grid.dpi]
        )
        bands = range(0, side, _BAND_ROWS)
        for start in bands if upwards else reversed(bands):
            stop = min(start + _BAND_ROWS, side)
            here = self.blocks[(self.blocks[:, 0] < stop) & (self.blocks[:, 1] > start)]
            edges = np.unique(np.clip([start, stop, low, high, *here[:, :2].ravel()], start, stop))
            first, last = (np.searchsorted(edges, np.clip(here[:, k], start, stop)) for k in (0, 1))
            owner = np.repeat(np.arange(len(here)), last - first)
            part = np.arange(owner.size) - np.repeat(np.cumsum(last - first) - last, last - first)
            order = np.argsort(part, kind="stable")
            owner, begins = owner[order], np.searchsorted(part[order], np.arange(edges.size))
            for each in range(edges.size - 1) if upwards else reversed(range(edges.size - 1)):
                mine = here[owner[begins[each] : begins[each + 1]]]
                counts = np.bincount(mine[:, 2], minlength=side + 1) - np.bincount(mine[:, 3], minlength=side + 1)
                dots = np.cumsum(counts[:side]) > 0
                if tone == "dark":
                    dots = ~dots & (np.arange(side) >= low) & (np.arange(side) < high) & (low <= edges[each] < high)
                yield np.packbits(dots).tobytes(), int(edges[each + 1] - edges[each])


def _centres(grid: DotGrid) -> Ints:
    """Centres of dots along an axis, in parts of a nanometre of which it has twice the dots per inch."""
    return (2 * np.arange(grid.side, dtype=np.int64) + 1 - grid.side) * NM_PER_INCH


def _polygons_beside(told: Sequence[db.Box], design: db.Layout) -> Iterator[db.Polygon]:
    """Polygons that do not lie in what is told already, one by one: those that cross would be rounded to be one."""
    index = design.find_layer(layer_info(CLEAR))
    if index is None:
        return
    places = db.Region(design.top_cell().bbox(index)) - db.Region(told)
    found = db.RecursiveShapeIterator(design, design.top_cell(), index, places, True)
    while not found.at_end():
        polygon = found.shape().polygon
        if polygon is not None:
            polygon = polygon.transformed(found.trans())
            if not any(polygon.bbox().inside(box) for box in told):
                yield polygon
        found.next()


def _box_dots(boxes: Ints, centres: Ints, grid: DotGrid) -> Ints:
    x0, y0, x1, y1 = (np.searchsorted(centres, 2 * grid.dpi * boxes[:, k]) for k in range(4))
    return np.column_stack([y0, y1, x0, x1]).astype(np.int64)


def _triangle_dots(triangle: db.Polygon, centres: Ints, grid: DotGrid) -> Ints:
    """Runs of the dots whose centres lie within a triangle, or on an edge that has the inside to its right or above."""
    points = np.array(hull_points(triangle)[::-1], dtype=np.int64)  # the inside on the left
    scaled = 2 * grid.dpi * points
    low, high = np.searchsorted(centres, [scaled[:, 1].min(), scaled[:, 1].max()], side="left")
    rows = np.arange(low, min(high + 1, grid.side), dtype=np.int64)
    left = np.full(rows.size, centres[0])
    right = np.full(rows.size, centres[-1])
    for (x0, y0), (across, up) in zip(scaled, np.roll(points, -1, axis=0) - points, strict=True):
        above = centres[rows] - y0
        if up == 0:
            out = above < 0 if across > 0 else above >= 0
            left[out] = centres[-1] + 1
            continue
        wide = float(np.abs(above).max(initial=0)) * float(abs(across)) > _MOST_PRODUCT
        product = above.astype(object if wide else np.int64) * (int(across) if wide else across)
        if up > 0:
            # Inside is to the left of it, and the edge itself is not.
            right = np.minimum(right, x0 + ((product - 1) // int(up)).astype(np.int64))
        else:
            left = np.maximum(left, x0 - (product // -int(up)).astype(np.int64))
    first, last = np.searchsorted(centres, left), np.searchsorted(centres, right, side="right")
    kept = first < last
    return np.column_stack([rows, rows + 1, first, last])[kept].astype(np.int64)
