"""Bitmaps of whole plates: every dot against the rule, by readers of others, and what is refused."""

from __future__ import annotations

import shutil
import struct
from collections import namedtuple
from dataclasses import replace
from pathlib import Path

import numpy as np
import OpenImageIO as oiio  # noqa: N813
import pytest
import tifffile
from hypothesis import given
from hypothesis import strategies as st

from maskfab.base.errors import OutputError, SourceError
from maskfab.base.model import CLEAR, Mark, Plate
from maskfab.mask.dots import NM_PER_INCH
from maskfab.mask.formats.plate_bitmap import (
    _strip_rows,
    bmp_bytes,
    check_plate_bitmap,
    check_plate_dots,
    largest_tiff_bytes,
    write_plate_bmp,
    write_plate_tiff,
)
from maskfab.mask.formats.tiff import pack_bits
from maskfab.mask.layout import plate_layout

WRITERS = {"tif": write_plate_tiff, "bmp": write_plate_bmp}

STAR = ((-40_000, 3_000), (10_500, 90_000), (20_000, -7_000), (95_333, -60_001), (-3_000, -80_000))
EDGES = ((-90_500, 50_000), (-90_500, 60_500), (-50_000, 60_500), (-50_000, 50_000))
"""At 25 400 dpi its left and lower edges run through centres or between dots, and so do the others."""
DIAMOND = ((0, 20_000), (20_000, 0), (0, -20_000), (-20_000, 0))


@pytest.fixture
def odd_plate(small_plate) -> Plate:
    """A plate of .2 mm with one small die, slanted marks that overlap, and edges on the centres of dots."""
    die = small_plate.dies[0]
    panel = replace(die.panel, orientations=die.panel.orientations[:1, :2])
    marks = (
        Mark("STAR", "resolution", CLEAR, (STAR, EDGES)),
        Mark("DIAMOND", "resolution", CLEAR, (tuple((x + 60_250, y + 61_125) for x, y in DIAMOND), DIAMOND)),
    )
    kept = replace(die, panel=panel, centre_nm=(-30_300, -60_701))
    return replace(small_plate, blank_nm=200_000, writable_nm=190_000, dies=(kept,), marks=marks, gauges=(), notes=())


def by_the_rule(plate: Plate, dpi: int) -> np.ndarray:
    """Dots by asking every polygon about every centre: crossings to the left, all in whole numbers; top row first."""
    side = -(-plate.blank_nm * dpi // NM_PER_INCH)
    centres = (2 * np.arange(side) + 1 - side) * NM_PER_INCH
    x, y = np.meshgrid(centres, centres[::-1])
    dots = np.zeros((side, side), dtype=bool)
    polygons = [polygon for mark in plate.marks for polygon in mark.polygons]
    for die in plate.dies:
        panel, (left, low) = die.panel, die.origin_nm
        for (row, column), kind in np.ndenumerate(panel.orientations):
            for j, i in np.argwhere(panel.patterns[kind]):
                x0 = left + column * panel.pitch_nm + panel.gutter_nm // 2 + int(i) * panel.dot_nm
                y0 = low + row * panel.pitch_nm + panel.gutter_nm // 2 + int(j) * panel.dot_nm
                x1, y1 = x0 + panel.dot_nm, y0 + panel.dot_nm
                polygons.append(((x0, y0), (x1, y0), (x1, y1), (x0, y1)))
    for polygon in polygons:
        inside = np.zeros_like(dots)
        for one, other in zip(polygon, (*polygon[1:], polygon[0]), strict=True):
            (xa, ya), (xb, yb) = ((2 * dpi * a, 2 * dpi * b) for a, b in sorted((one, other), key=lambda p: p[1]))
            rows = (ya <= y) & (y < yb)
            across, up = (xb - xa) // (2 * dpi), (yb - ya) // (2 * dpi)
            inside ^= rows & ((x - xa) * up >= (y - ya) * across)
        dots |= inside
    return dots


@pytest.mark.parametrize("dpi", [25_400, 50_800, 20_321, 10_160])
def test_every_dot_is_what_the_rule_says_and_all_readers_agree(odd_plate, tmp_path, dpi):
    wanted = by_the_rule(odd_plate, dpi)
    tiff, bmp = tmp_path / "plate.tif", tmp_path / "plate.bmp"
    write_plate_tiff(odd_plate, tiff, dpi, comments=("job 0123", "Größe"))
    write_plate_bmp(odd_plate, bmp, dpi)
    with tifffile.TiffFile(tiff) as file:
        (page,) = file.pages
        tags = {tag.name: tag.value for tag in page.tags}
    assert tags["XResolution"] == tags["YResolution"] == (dpi, 1)
    assert (tags["ResolutionUnit"], tags["PhotometricInterpretation"], tags["Compression"]) == (2, 1, 32773)
    assert "job 0123" in tags["ImageDescription"]
    assert f"{dpi} dpi" in tags["ImageDescription"]
    for path in (tiff, bmp):
        image = oiio.ImageInput.open(str(path))
        pixels = image.read_image(0, 0, 0, 1, oiio.UINT8)
        image.close()
        assert ((pixels.reshape(wanted.shape) == 255) == wanted).all()
        row = check_plate_dots(odd_plate, plate_layout(odd_plate), path, dpi, "clear")
        assert (row.value, row.passed) == (0, True)
    assert tiff.stat().st_size <= largest_tiff_bytes(odd_plate, dpi)
    assert bmp.stat().st_size == bmp_bytes(odd_plate, dpi)


@pytest.mark.parametrize("kind", ["tif", "bmp"])
def test_dark_data_are_the_complement_within_the_writable_area(odd_plate, tmp_path, kind):
    shown = {}
    for tone in ("clear", "dark"):
        path = tmp_path / f"{tone}.{kind}"
        WRITERS[kind](odd_plate, path, 25_400, tone)
        image = oiio.ImageInput.open(str(path))
        shown[tone] = image.read_image(0, 0, 0, 1, oiio.UINT8)[:, :, 0] == 255
        image.close()
        assert check_plate_dots(odd_plate, plate_layout(odd_plate), path, 25_400, tone).value == 0
    writable = np.zeros((200, 200), dtype=bool)
    writable[5:195, 5:195] = True
    assert (shown["dark"] == (writable & ~shown["clear"])).all()


@pytest.mark.parametrize("kind", ["tif", "bmp"])
def test_a_wrong_dot_is_found_where_it_is(odd_plate, tmp_path, kind):
    path, design = tmp_path / f"plate.{kind}", plate_layout(odd_plate)
    WRITERS[kind](odd_plate, path, 25_400)
    content = bytearray(path.read_bytes())
    if kind == "bmp":
        # Row 3 from below, dots 16 to 23.
        content[62 + 28 * 3 + 2] ^= 0b00010000
        place = "19, 3 from"
    else:
        # The highest row is one run of bytes: it becomes white.
        (start,) = struct.unpack_from("<I", content, content.index(struct.pack("<HHI", 273, 4, 1)) + 8)
        assert content[start : start + 2] == bytes((257 - 25, 0))
        content[start + 1] = 255
        place = "0, 199 from"
    path.write_bytes(content)
    row = check_plate_dots(odd_plate, design, path, 25_400, "clear")
    assert row.passed is False
    assert row.value == (1 if kind == "bmp" else 200)
    assert place in row.method
    other = check_plate_dots(odd_plate, design, path, 12_700, "clear")
    assert (other.value, other.passed) == (40_000, False)


@pytest.mark.parametrize("kind", ["tif", "bmp"])
def test_a_damaged_bitmap_is_refused(odd_plate, tmp_path, kind):
    path, design = tmp_path / f"plate.{kind}", plate_layout(odd_plate)
    WRITERS[kind](odd_plate, path, 25_400)
    content = path.read_bytes()
    for size in (0, 3, 9, 40, 60, len(content) // 2, len(content) - 1):
        path.write_bytes(content[:size])
        with pytest.raises(SourceError, match=r"MF30[38]"):
            check_plate_dots(odd_plate, design, path, 25_400, "clear")
    path.unlink()
    with pytest.raises(SourceError, match="MF301"):
        check_plate_dots(odd_plate, design, path, 25_400, "clear")


@given(st.lists(st.tuples(st.integers(0, 255), st.integers(1, 300)), min_size=1, max_size=12))
def test_pack_bits_is_what_its_definition_unpacks(parts):
    row = b"".join(bytes([value]) * count for value, count in parts)
    packed, unpacked, place = pack_bits(row), b"", 0
    while place < len(packed):
        number = packed[place]
        assert number != 128
        if number < 128:
            unpacked += packed[place + 1 : place + 2 + number]
            place += 2 + number
        else:
            unpacked += packed[place + 1 : place + 2] * (257 - number)
            place += 2
    assert unpacked == row
    assert len(packed) <= len(row) + -(-len(row) // 128)


def test_the_bound_on_a_tiff_is_close_to_a_blank_plate(small_plate):
    """128 bytes that repeat are two, and its own count of a row and its strip are a few bytes more."""
    blank = replace(small_plate, dies=(), marks=(), blank_nm=1_000_000 * 128)
    side = 128_000
    assert 0 <= largest_tiff_bytes(blank, 25_400) / side - 2 * side / 8 / 128 < 11


LITERALS = st.binary(min_size=1, max_size=128).map(lambda data: (bytes([len(data) - 1]) + data, data))
REPEATS = st.tuples(st.integers(2, 128), st.binary(min_size=1, max_size=1)).map(
    lambda run: (bytes([257 - run[0]]) + run[1], run[0] * run[1])
)


@given(parts=st.lists(LITERALS | REPEATS | st.just((b"\x80", b"")), max_size=8), last=LITERALS | REPEATS)
def test_rows_of_pack_bits_are_read_whatever_wrote_them(parts, last):
    """Bytes as they are, bytes that repeat, and the 128 that means nothing, as TIFF 6.0 has them."""
    packed, row = (b"".join(of) for of in zip(*parts, last, strict=True))
    other = row[::-1]
    literal = b"".join(
        bytes([len(piece) - 1]) + piece for k in range(0, len(row), 128) if (piece := other[k : k + 128])
    )
    found = list(_strip_rows(Path("x.tif"), literal + 2 * packed, len(row), 3))
    assert [each for each, count in found for _ in range(count)] == [other, row, row]
    assert list(_strip_rows(Path("x.tif"), packed, len(row), 1)) == [(row, 1)]
    with pytest.raises(SourceError, match="MF303"):
        list(_strip_rows(Path("x.tif"), packed[:-1], len(row), 1))
    with pytest.raises(SourceError, match="MF303"):
        list(_strip_rows(Path("x.tif"), packed + b"\x80", len(row), 1))


def test_what_no_file_or_disk_holds_is_refused_before_it_is_begun(small_plate, tmp_path, monkeypatch):
    wide = replace(small_plate, blank_nm=127_000_000)
    with pytest.raises(OutputError, match=r"MF415.*BigTIFF"):
        check_plate_bitmap(wide, "plate_bmp", 40_640, "plate.bmp")
    assert check_plate_bitmap(wide, "plate_tiff", 40_640, "plate.tif") < 2**32
    with pytest.raises(OutputError, match="MF415"):
        check_plate_bitmap(replace(small_plate, blank_nm=700_000_000), "plate_tiff", 254_000, "plate.tif")
    usage = namedtuple("usage", "total used free")
    monkeypatch.setattr(shutil, "disk_usage", lambda _: usage(1000, 999, 1))
    for kind, write in WRITERS.items():
        with pytest.raises(OutputError, match=r"MF401.*room"):
            write(small_plate, tmp_path / f"plate.{kind}", 6350)
    assert not list(tmp_path.iterdir())
