"""A whole plate's bitmap, TIFF by PackBits or BMP, row by row: what is read takes as much memory as one strip.

OpenImageIO reads both, but gives every bit a byte, and would take a minute for a plate of 16 thousand million dots.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

from maskfab.errors import SourceError

PLATE_BITMAP_SUFFIXES = (".tif", ".bmp")

_MOST_SIDE = 10_000_000
_MOST_STRIP = 64_000_000
_METRES_PER_INCH = 0.0254
_TAGS = {"width": 256, "height": 257, "bits": 258, "compression": 259, "white": 262, "offsets": 273, "samples": 277,
         "rows": 278, "sizes": 279, "dpi": 282, "dpi_along_y": 283, "unit": 296}  # fmt: skip
_KINDS = {3: ("H", 2), 4: ("I", 4), 5: ("II", 8)}
_WANTED = {"bits": 1, "compression": 32773, "white": 1, "samples": 1, "unit": 2}


@dataclass(frozen=True, eq=False)
class PlateDots:
    """A bitmap as it is read.

    Attributes:
        width: dots along x.
        height: dots along y.
        dpi: dots per inch, as the file states them.
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

    Args:
        path: the file, as it is told.
        file: the same, open.

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
        raise _damaged(path, "its head is damaged") from error
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
        raise _damaged(path, f"{height} rows, {per_strip} to a strip, have {len(offsets)} strips")
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
        told, count = strip[place:end], 1
        place = end
        while count < rows and strip.startswith(told, place):
            count += 1
            place += len(told)
        yield row, count
        rows -= count
    if place != len(strip):
        raise _damaged(path, "a strip holds more than its rows")


def _unpacked(path: Path, strip: bytes, place: int, wide: int) -> tuple[bytes, int]:
    """One row of PackBits, and where it ends: n below 128 tells n + 1 bytes, above it one byte 257 - n times."""
    row = bytearray()
    while len(row) < wide:
        if place + 1 >= len(strip):
            raise _damaged(path, "a strip ends within a row")
        number = strip[place]
        if number < 128:
            row += strip[place + 1 : place + 2 + number]
            place += 2 + number
        else:
            row += strip[place + 1 : place + 2] * (257 - number if number > 128 else 0)
            place += 2 if number > 128 else 1
    if len(row) != wide or place > len(strip):
        raise _damaged(path, "a row has more dots than its picture")
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
                raise _damaged(path, "it ends within its rows")
            if read != row:
                if count:
                    yield row[: -(-width // 8)], count
                row, count = read, 0
            count += 1
        yield row[: -(-width // 8)], count

    return PlateDots(width, height, along_x * _METRES_PER_INCH, _METRES_PER_INCH / 2, True, rows())


def _check_sides(path: Path, width: int, height: int) -> None:
    if not (0 < width <= _MOST_SIDE and 0 < height <= _MOST_SIDE):
        raise _damaged(path, f"it has {width} x {height} dots")


def _taken(path: Path, file: BinaryIO, offset: int, size: int) -> bytes:
    if size > _MOST_STRIP:
        raise _damaged(path, f"a strip of it has {size} bytes")
    file.seek(offset)
    read = file.read(size)
    if len(read) != size:
        raise _damaged(path, "it ends within a strip")
    return read


def _damaged(path: Path, what: str) -> SourceError:
    return SourceError("MF303", f"{path.name}: {what}", where=str(path), cure="Write or copy it again")


def _other(path: Path, what: str) -> SourceError:
    cure = "Give the file that the run wrote"
    return SourceError(
        "MF308", f"{path.name} is no bitmap of a plate as maskfab writes it: {what}", where=str(path), cure=cure
    )
