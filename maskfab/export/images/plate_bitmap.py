"""A whole plate as one bit for each dot of a plotter: TIFF, BMP; for houses that plot film.

Rows are written as they are made, so that a plate of any size takes as much memory as one row. Both formats tell places
in a file by 32 bits. BigTIFF has 64, and houses do not take it.
"""

from __future__ import annotations

import shutil
import struct
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import BinaryIO

from maskfab.errors import OutputError
from maskfab.export.images.dot_rows import dot_rows
from maskfab.export.images.pack_bits import pack_bits
from maskfab.export.size import check_file_size
from maskfab.files.atomic import partial
from maskfab.geometry.dot_grid import NM_PER_INCH, DotGrid
from maskfab.jobfile import PlateBitmap
from maskfab.jobfile.order import Tone
from maskfab.model import Plate

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
    for mark in plate.furniture:
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
    """Refuse a bitmap of a plate that would be larger than its format can tell; the bytes that it may have at most.

    Raises:
        OutputError: MF415.
    """
    most = largest_tiff_bytes(plate, dpi) if kind == "plate_tiff" else bmp_bytes(plate, dpi)
    cure = "Plot at fewer dots per inch, or send polygons; houses take no BigTIFF, and BMP has no larger form"
    check_file_size(most, MOST_BYTES, Path(name), cure)
    return most


def write_plate_tiff(plate: Plate, path: Path, dpi: int, tone: Tone = "clear", comments: Sequence[str] = ()) -> DotGrid:
    """Write a plate as TIFF of one bit for each dot, by PackBits, which every reader of TIFF knows; the top row first.

    1 (white) is what the digitized data show: openings, or where they are dark the chrome of the writable area.

    Args:
        plate: what to write.
        path: the file, ``.tif``.
        dpi: dots per inch, also in the file's resolution.
        tone: of the data.
        comments: provenance, put into the file's description.

    Returns:
        The dots.

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
        raise OutputError(
            "MF401",
            f"{path} cannot be written: it may take {size / 1e6:,.0f} MB, and the disk has {free / 1e6:,.0f} MB left",
            cure="Give --out a folder with more room, or plot at fewer dots per inch",
        )


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
