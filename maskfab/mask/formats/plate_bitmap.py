"""A whole plate as one bit for each dot of a plotter: TIFF by PackBits, or BMP; for houses that plot film.

Rows are written as they are made, and read back strip by strip, so that a plate of any size takes as much memory as one
row or strip: OpenImageIO gives every bit a byte, and would take a minute for a plate of 16 thousand million dots. Both
formats tell places in a file by 32 bits. BigTIFF has 64, and houses do not take it.

What should be there is told otherwise than it was written: polygons of the layout, as boxes and triangles, whose dots
are those of all half-planes that they lie in. Every dot is compared, by its centre.
"""

from __future__ import annotations

import math
import shutil
import struct
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

import numpy as np
from klayout import db

from maskfab.base.arrays import Ints
from maskfab.base.errors import JobError, OutputError, SourceError
from maskfab.base.files import partial
from maskfab.base.model import CLEAR, Die, Plate, Quantity
from maskfab.base.units import NM_PER_UM
from maskfab.job.order import Tone
from maskfab.job.values import PlateBitmap
from maskfab.mask.dots import NM_PER_INCH, DotGrid, dot_rows
from maskfab.mask.formats.format import Drawn, Format
from maskfab.mask.formats.picture import smallest_nm
from maskfab.mask.formats.tiff import pack_bits
from maskfab.mask.layout import check_file_size, clear_shapes, layer_info
from maskfab.mask.outlines import hull_points, triangles
from maskfab.mask.raster import to_boxes
from maskfab.mask.sandbox import damaged

MOST_BYTES = 2**32 - 1
"""Of a file whose places are told by 32 bits."""

_STRIP_BYTES = 65_536
_ASCII, _SHORT, _LONG, _RATIONAL = 2, 3, 4, 5
_CODES = {_SHORT: "H", _LONG: "I", _RATIONAL: "I"}
_DATE = b"1980:01:01 00:00:00\0"
"""As members of our packages have it, which is no date of anything."""
_MOST_HEAD_BYTES = 100_000
_PACK_BITS, _BLACK_IS_ZERO, _INCH = 32773, 1, 2
_BMP_HEADS, _BMP_COLOURS = 14 + 40, 8
_METRES_PER_INCH = 0.0254


def largest_tiff_bytes(plate: Plate, dpi: int) -> int:
    """Bytes that the TIFF of a plate cannot exceed: blank dots by their runs, those of dies and marks one by one."""
    side = DotGrid.of(plate, dpi).side
    boxes = [die.box_nm for die in plate.dies]
    for mark in plate.marks:
        for polygon in mark.polygons if mark.layer.written else ():
            x, y = zip(*polygon, strict=True)
            boxes.append((min(x), min(y), max(x), max(y)))
    sides = [((x1 - x0) * dpi / NM_PER_INCH + 16, (y1 - y0) * dpi / NM_PER_INCH + 1) for x0, y0, x1, y1 in boxes]
    drawn = sum((wide / 8 * 129 / 128 + 4) * high for wide, high in sides)
    raw = side * (side / 8 + 1) * 129 / 128
    blank = side * (2 * side / 8 / 128 + 8)
    return int(min(raw, drawn + blank)) + 8 * -(-side // _rows_per_strip(side)) + _MOST_HEAD_BYTES


def bmp_bytes(plate: Plate, dpi: int) -> int:
    """Bytes of the BMP of a plate."""
    side = DotGrid.of(plate, dpi).side
    return _BMP_HEADS + _BMP_COLOURS + side * _bmp_row_bytes(side)


def check_plate_bitmap(plate: Plate, kind: PlateBitmap, dpi: int, name: str) -> int:
    """Refuse a plate's bitmap larger than its format can tell (MF415); the bytes that it may have at most."""
    most = largest_tiff_bytes(plate, dpi) if kind == "plate_tiff" else bmp_bytes(plate, dpi)
    cure = "Plot at fewer dots per inch, or send polygons; houses take no BigTIFF, and BMP has no larger form"
    check_file_size(most, MOST_BYTES, Path(name), cure)
    return most


def write_plate_tiff(plate: Plate, path: Path, dpi: int, tone: Tone = "clear", comments: Sequence[str] = ()) -> DotGrid:
    """Write a plate as TIFF of one bit for each dot, by PackBits, which every reader of TIFF knows; the top row first.

    1 (white) is what the digitized data show: openings, or where they are dark the chrome of the writable area.

    Raises:
        OutputError: MF401 if the file cannot be written or has no room, MF415 if it would exceed what the format holds.
    """
    grid = DotGrid.of(plate, dpi)
    most = check_plate_bitmap(plate, "plate_tiff", dpi, path.name)
    with partial(path) as aside, aside.open("wb") as file:
        _check_room(aside, most, path)
        _write_tiff(file, grid, dot_rows(plate, grid, tone, upwards=False), _described(tone, grid, comments))
    return grid


def write_plate_bmp(plate: Plate, path: Path, dpi: int, tone: Tone = "clear", comments: Sequence[str] = ()) -> DotGrid:
    """Write a plate as BMP of one bit for each dot, the lowest row first; it has no room for comments.

    Its resolution is in dots per metre, to the nearest whole one. All else as :func:`write_plate_tiff`.
    """
    grid, size = DotGrid.of(plate, dpi), check_plate_bitmap(plate, "plate_bmp", dpi, path.name)
    per_metre = round(dpi / _METRES_PER_INCH)
    head = struct.pack("<2sIHHI", b"BM", size, 0, 0, _BMP_HEADS + _BMP_COLOURS)
    pixels = size - _BMP_HEADS - _BMP_COLOURS
    head += struct.pack("<IiiHHIIiiII", 40, grid.side, grid.side, 1, 1, 0, pixels, per_metre, per_metre, 2, 2)
    head += bytes((0, 0, 0, 0, 255, 255, 255, 0))
    wide = _bmp_row_bytes(grid.side)
    with partial(path) as aside, aside.open("wb") as file:
        _check_room(aside, size, path)
        file.write(head)
        for row, count in dot_rows(plate, grid, tone, upwards=True):
            padded = row.ljust(wide, b"\0")
            for _ in range(count):
                file.write(padded)
    return grid


def _bmp_row_bytes(side: int) -> int:
    return -(-side // 32) * 4


def _check_room(aside: Path, size: int, path: Path) -> None:
    """Refuse a file that its disk has no room for, before it is begun."""
    free = shutil.disk_usage(aside.parent).free
    if size > free:
        what = f"{path} cannot be written: it may take {size / 1e6:,.0f} MB, and the disk has {free / 1e6:,.0f} MB left"
        raise OutputError("MF401", what, cure="Give --out a folder with more room, or plot at fewer dots per inch")


def _rows_per_strip(side: int) -> int:
    return max(1, _STRIP_BYTES // -(-side // 8))


def _described(tone: Tone, grid: DotGrid, comments: Sequence[str]) -> bytes:
    shown = "openings" if tone == "clear" else "the chrome of the writable area"
    said = (*comments, f"{grid.dpi} dpi; 1 (white) is digitized data: {shown}; as seen on the chrome side")
    return "; ".join(" ".join(line.split()) for line in said).encode("ascii", "replace") + b"\0"


def _write_tiff(file: BinaryIO, grid: DotGrid, rows: Iterator[tuple[bytes, int]], described: bytes) -> None:
    """The head of a TIFF, which printers read first, and its strips; where these lie is told when they are written."""
    per_strip = _rows_per_strip(grid.side)
    strips = -(-grid.side // per_strip)
    file.write(_tiff_head(grid, [0] * strips, [0] * strips, described))
    offsets, sizes, held = [file.tell()], [0], 0
    for row, count in rows:
        packed = pack_bits(row)
        for _ in range(count):
            if held == per_strip:
                offsets.append(offsets[-1] + sizes[-1])
                sizes.append(0)
                held = 0
            file.write(packed)
            sizes[-1] += len(packed)
            held += 1
    file.seek(0)
    file.write(_tiff_head(grid, offsets, sizes, described))


def _tiff_head(grid: DotGrid, offsets: Sequence[int], sizes: Sequence[int], described: bytes) -> bytes:
    """Header and the only directory of a TIFF 6.0, with the values that have no room in its rows."""
    side = [grid.side]
    fields: tuple[tuple[int, int, Sequence[int] | bytes], ...] = (
        (254, _LONG, [0]),
        (256, _LONG, side),
        (257, _LONG, side),
        (258, _SHORT, [1]),
        (259, _SHORT, [_PACK_BITS]),
        (262, _SHORT, [_BLACK_IS_ZERO]),
        (270, _ASCII, described),
        (273, _LONG, offsets),
        (274, _SHORT, [1]),
        (277, _SHORT, [1]),
        (278, _LONG, [_rows_per_strip(grid.side)]),
        (279, _LONG, sizes),
        (282, _RATIONAL, [grid.dpi, 1]),
        (283, _RATIONAL, [grid.dpi, 1]),
        (284, _SHORT, [1]),
        (296, _SHORT, [_INCH]),
        (305, _ASCII, b"maskfab\0"),
        (306, _ASCII, _DATE),
    )
    rows, beyond = [struct.pack("<H", len(fields))], b""
    start = 8 + 2 + 12 * len(fields) + 4
    for tag, kind, values in fields:
        held = values if isinstance(values, bytes) else struct.pack(f"<{len(values)}{_CODES[kind]}", *values)
        count = len(values) // 2 if kind == _RATIONAL else len(values)
        if len(held) > 4:
            place = struct.pack("<I", start + len(beyond))
            beyond += held + b"\0" * (len(held) % 2)
        else:
            place = held.ljust(4, b"\0")
        rows.append(struct.pack("<HHI", tag, kind, count) + place)
    return b"II*\0" + struct.pack("<I", 8) + b"".join(rows) + struct.pack("<I", 0) + beyond


_MOST_SIDE = 10_000_000
_MOST_STRIP = 64_000_000
_TAGS = {"width": 256, "height": 257, "bits": 258, "compression": 259, "white": 262, "offsets": 273, "samples": 277,
         "rows": 278, "sizes": 279, "dpi": 282, "dpi_along_y": 283, "unit": 296}  # fmt: skip
_KINDS = {3: ("H", 2), 4: ("I", 4), 5: ("II", 8)}
_WANTED = {"bits": 1, "compression": 32773, "white": 1, "samples": 1, "unit": 2}


@dataclass(frozen=True, eq=False)
class PlateDots:
    """A bitmap as it is read.

    Attributes:
        dpi_rounding: by how much the format may have rounded that.
        upwards: whether the lowest row comes first.
        rows: eight dots to a byte, the leftmost in the highest bit, 1 for white, and 0 beyond the last; how often each
            row comes.
    """

    width: int
    height: int
    dpi: float
    dpi_rounding: float
    upwards: bool
    rows: Iterator[tuple[bytes, int]]


def read_plate_dots(path: Path, file: BinaryIO) -> PlateDots:
    """Begin to read a bitmap; its rows are read from the file as they are asked for.

    Raises:
        SourceError: MF303 damaged, MF308 not of a kind that maskfab writes plates in; from the rows too.
    """
    try:
        start = file.read(4)
        if start == b"II*\0":
            return _tiff(path, file)
        if start[:2] == b"BM":
            return _bmp(path, file)
    except (struct.error, ValueError, KeyError, IndexError, OverflowError, ZeroDivisionError, MemoryError) as error:
        raise damaged(path, "its head is damaged") from error
    raise _other(path, "it is neither a TIFF nor a BMP")


def _tiff(path: Path, file: BinaryIO) -> PlateDots:
    values = _directory(file)
    for name, wanted in _WANTED.items():
        if values[name] != (wanted,):
            raise _other(path, f"its {name} is {values[name]}, not {wanted}")
    (width,), (height,), (per_strip,) = values["width"], values["height"], values["rows"]
    offsets, sizes = values["offsets"], values["sizes"]
    _check_sides(path, width, height)
    if per_strip < 1 or not len(offsets) == len(sizes) == -(-height // per_strip):
        raise damaged(path, f"{height} rows, {per_strip} to a strip, have {len(offsets)} strips")
    along_x, along_y = (ratio[0] / ratio[1] for ratio in (values["dpi"], values["dpi_along_y"]))
    if along_x != along_y:
        raise _other(path, f"it has {along_x:g} dots per inch along x and {along_y:g} along y")

    def rows() -> Iterator[tuple[bytes, int]]:
        left = height
        for offset, size in zip(offsets, sizes, strict=True):
            yield from _strip_rows(path, _taken(path, file, offset, size), -(-width // 8), min(per_strip, left))
            left -= per_strip

    return PlateDots(width, height, along_x, 0.0, False, rows())


def _directory(file: BinaryIO) -> Mapping[str, tuple[int, ...]]:
    (start,) = struct.unpack("<I", file.read(4))
    file.seek(start)
    (count,) = struct.unpack("<H", file.read(2))
    rows = [struct.unpack("<HHI4s", file.read(12)) for _ in range(count)]
    if struct.unpack("<I", file.read(4)) != (0,):
        raise ValueError("more than one picture")
    values: dict[str, tuple[int, ...]] = {}
    for name, tag in _TAGS.items():
        ((_, kind, many, place),) = (row for row in rows if row[0] == tag)
        code, size = _KINDS[kind]
        if many > _MOST_SIDE:
            raise ValueError("too many values")
        if size * many > len(place):
            file.seek(struct.unpack("<I", place)[0])
            place = file.read(size * many)
        values[name] = struct.unpack("<" + code * many if many == 1 else f"<{many}{code}", place[: size * many])
    return values


def _strip_rows(path: Path, strip: bytes, wide: int, rows: int) -> Iterator[tuple[bytes, int]]:
    """Rows of a strip; those whose bytes repeat are unpacked once."""
    place = 0
    while rows:
        row, end = _unpacked(path, strip, place, wide)
        packed, count = strip[place:end], 1
        place = end
        while count < rows and strip.startswith(packed, place):
            count += 1
            place += len(packed)
        yield row, count
        rows -= count
    if place != len(strip):
        raise damaged(path, "a strip holds more than its rows")


def _unpacked(path: Path, strip: bytes, place: int, wide: int) -> tuple[bytes, int]:
    """One row of PackBits, and where it ends: n below 128 tells n + 1 bytes, above it one byte 257 - n times."""
    row = bytearray()
    while len(row) < wide:
        if place + 1 >= len(strip):
            raise damaged(path, "a strip ends within a row")
        number = strip[place]
        if number < 128:
            row += strip[place + 1 : place + 2 + number]
            place += 2 + number
        else:
            row += strip[place + 1 : place + 2] * (257 - number if number > 128 else 0)
            place += 2 if number > 128 else 1
    if len(row) != wide or place > len(strip):
        raise damaged(path, "a row has more dots than its picture")
    return bytes(row), place


def _bmp(path: Path, file: BinaryIO) -> PlateDots:
    file.seek(10)
    (start,) = struct.unpack("<I", file.read(4))
    size, width, height, planes, bits, compression, _, along_x, along_y, _, _ = struct.unpack(
        "<IiiHHIIiiII", file.read(40)
    )
    colours = file.read(8)
    if (size, planes, bits, compression) != (40, 1, 1, 0) or colours != b"\0\0\0\0\xff\xff\xff\0" or height < 0:
        raise _other(path, "it is no BMP of one bit, black and white, from the lowest row up")
    _check_sides(path, width, height)
    if along_x != along_y or along_x <= 0:
        raise _other(path, f"it has {along_x} dots per metre along x and {along_y} along y")
    wide = -(-width // 32) * 4

    def rows() -> Iterator[tuple[bytes, int]]:
        file.seek(start)
        row, count = b"", 0
        for _ in range(height):
            read = file.read(wide)
            if len(read) != wide:
                raise damaged(path, "it ends within its rows")
            if read != row:
                if count:
                    yield row[: -(-width // 8)], count
                row, count = read, 0
            count += 1
        yield row[: -(-width // 8)], count

    return PlateDots(width, height, along_x * _METRES_PER_INCH, _METRES_PER_INCH / 2, True, rows())


def _check_sides(path: Path, width: int, height: int) -> None:
    if not (0 < width <= _MOST_SIDE and 0 < height <= _MOST_SIDE):
        raise damaged(path, f"it has {width} x {height} dots")


def _taken(path: Path, file: BinaryIO, offset: int, size: int) -> bytes:
    if size > _MOST_STRIP:
        raise damaged(path, f"a strip of it has {size} bytes")
    file.seek(offset)
    read = file.read(size)
    if len(read) != size:
        raise damaged(path, "it ends within a strip")
    return read


def _other(path: Path, what: str) -> SourceError:
    cure = "Give the file that the run wrote"
    return SourceError(
        "MF308", f"{path.name} is no bitmap of a plate as maskfab writes it: {what}", where=str(path), cure=cure
    )


_BAND_ROWS = 4096
_ROUNDING = 1e-9
_MOST_PRODUCT = 2.0**62
"""Beyond it, products are worked out in whole numbers of any length."""


def check_dots(dies: Sequence[Die], dpi: int, where: str) -> None:
    """Refuse dots that are larger than the smallest feature of a die, for they would lose openings (MF104)."""
    dot = NM_PER_INCH / dpi
    smallest, name = min(((smallest_nm(die, dot), die.name) for die in dies), default=(dot, ""))
    if dot > smallest * (1 + _ROUNDING):
        what = (
            f"{dpi} dpi are dots of {dot / NM_PER_UM:g} um, larger than the smallest feature of the die {name}, "
            f"{smallest / NM_PER_UM:g} um: such a bitmap loses openings"
        )
        cure = f"Plot at {math.ceil(NM_PER_INCH / smallest)} dpi or more, or send polygons"
        raise JobError("MF104", what, where=f"{where}: export.dpi", cure=cure)


def check_plate_dots(plate: Plate, design: db.Layout, path: Path, dpi: int, tone: Tone) -> Quantity:
    """Read a plate's TIFF or BMP back and compare every dot with the design.

    Returns:
        ``plate_bitmap_wrong_dots``, whose limit is 0; all dots if there are too many or too few, or of another size.
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
        cure = "Run the job with that format in export.formats"
        raise SourceError("MF301", f"there is no file {path}", where=str(path), cure=cure) from error
    return Quantity("plate_bitmap_wrong_dots", wrong, method, limit=0, passed=wrong == 0)


def _compared(read: PlateDots, drawn: Iterator[tuple[bytes, int]]) -> tuple[int, tuple[int, int] | None]:
    wrong, first, done = 0, None, 0
    row, left = b"", 0
    for dots, repeats in read.rows:
        count = repeats
        while count:
            if not left:
                row, left = next(drawn)
            alike = min(count, left)
            if dots != row:
                apart = np.frombuffer(dots, dtype=np.uint8) ^ np.frombuffer(row, dtype=np.uint8)
                wrong += alike * int(np.bitwise_count(apart).sum())
                if first is None:
                    column = int(np.flatnonzero(np.unpackbits(apart))[0])
                    first = column, done if read.upwards else read.height - 1 - done
            count, left, done = count - alike, left - alike, done + alike
    return wrong, first


@dataclass(frozen=True, eq=False)
class _Dots:
    """Dots of polygons: int64 [n, 4], rows and dots from first to beyond the last, and half the writable side, nm."""

    blocks: Ints
    grid: DotGrid
    half: int

    @classmethod
    def of(cls, plate: Plate, design: db.Layout, grid: DotGrid) -> _Dots:
        centres = _centres(grid)
        shapes = {die.box_nm: clear_shapes(design, die.box_nm) for die in plate.dies}
        boxed = {box: boxes for box, boxes in shapes.items() if isinstance(boxes, np.ndarray)}
        blocks = [_box_dots(boxes, centres, grid) for boxes in boxed.values()]
        for polygon in _polygons_beside([db.Box(*box) for box in boxed], design):
            region = db.Region(polygon)
            if polygon.is_rectilinear():
                blocks.append(_box_dots(to_boxes(region), centres, grid))
            else:
                blocks += [_triangle_dots(triangle, centres, grid) for triangle in triangles(region).each()]
        return cls(np.concatenate([np.empty((0, 4), dtype=np.int64), *blocks]), grid, plate.writable_nm // 2)

    def rows(self, tone: Tone, *, upwards: bool) -> Iterator[tuple[bytes, int]]:
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
            for band in range(edges.size - 1) if upwards else reversed(range(edges.size - 1)):
                mine = here[owner[begins[band] : begins[band + 1]]]
                counts = np.bincount(mine[:, 2], minlength=side + 1) - np.bincount(mine[:, 3], minlength=side + 1)
                dots = np.cumsum(counts[:side]) > 0
                if tone == "dark":
                    dots = ~dots & (np.arange(side) >= low) & (np.arange(side) < high) & (low <= edges[band] < high)
                yield np.packbits(dots).tobytes(), int(edges[band + 1] - edges[band])


def _centres(grid: DotGrid) -> Ints:
    """Centres of dots along an axis, in parts of a nanometre of which it has twice the dots per inch."""
    return (2 * np.arange(grid.side, dtype=np.int64) + 1 - grid.side) * NM_PER_INCH


def _polygons_beside(boxes: Sequence[db.Box], design: db.Layout) -> Iterator[db.Polygon]:
    """Polygons that do not lie in what is told already, one by one: those that cross would be rounded to be one."""
    index = design.find_layer(layer_info(CLEAR))
    if index is None:
        return
    places = db.Region(design.top_cell().bbox(index)) - db.Region(boxes)
    iterator = db.RecursiveShapeIterator(design, design.top_cell(), index, places, True)
    while not iterator.at_end():
        polygon = iterator.shape().polygon
        if polygon is not None:
            polygon = polygon.transformed(iterator.trans())
            if not any(polygon.bbox().inside(box) for box in boxes):
                yield polygon
        iterator.next()


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
    inside = first < last
    return np.column_stack([rows, rows + 1, first, last])[inside].astype(np.int64)


def check_drawn_dots(made: Drawn, path: Path) -> tuple[Quantity, ...]:
    """A bitmap of a drawn plate, every dot read back against the design.

    Raises:
        SourceError: MF308 if nobody says how many dots it should have, else as of :func:`check_plate_dots`.
    """
    if made.settings.dpi is None:
        cure = "State dpi in [export], or leave the file out"
        raise SourceError("MF308", f"nobody says how many dots to the inch {path.name} has", where=str(path), cure=cure)
    return (check_plate_dots(made.plate, made.design, path, made.settings.dpi, made.figures.options.tone),)


FORMATS = (
    Format(
        "plate_tiff",
        "TIFF of a plotter's dots",
        ".tif",
        write_plate=lambda of, to: write_plate_tiff(of.plate, to, of.dpi, of.figures.options.tone, of.comments),
        compare_plate=check_drawn_dots,
    ),
    Format(
        "plate_bmp",
        "BMP of a plotter's dots",
        ".bmp",
        write_plate=lambda of, to: write_plate_bmp(of.plate, to, of.dpi, of.figures.options.tone, of.comments),
        compare_plate=check_drawn_dots,
    ),
)
