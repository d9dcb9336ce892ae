"""GDSII and OASIS are read as klayout and gdstk both have them, and refused where they do not agree."""

from __future__ import annotations

import gzip
import math
import struct
import zlib

import gdstk
import pytest
from klayout import db

from maskfab.base.errors import SourceError
from maskfab.mask.comparison.readings import readings
from maskfab.mask.formats import table
from maskfab.mask.formats.content import array_drift, find_cell, rounding_nm
from maskfab.mask.formats.gdsii import write_oasis
from maskfab.mask.formats.table import read_layout
from maskfab.mask.layout import left_out


def area_um2(layout: db.Layout, cell: str | None = None) -> float:
    top = find_cell(layout, cell)
    return sum(db.Region(top.begin_shapes_rec(index)).merged().area() for index in layout.layer_indexes()) / 1e6


# --- OASIS by hand ----------------------------------------------------------------------------------------------------


def whole(number: int) -> bytes:
    number, low = number >> 7, number & 127
    return bytes([low | (128 if number else 0)]) + (whole(number) if number else b"")


def signed(number: int) -> bytes:
    return whole(abs(number) << 1 | (number < 0))


def shape(kind: int, stated: int, *values: bytes, x: int) -> bytes:
    """A record on layer 1/0 at (x, 0); ``stated`` are the bits of the values between the layer and the place."""
    return whole(kind) + bytes([stated | 0x1B]) + whole(1) + whole(0) + b"".join(values) + signed(x) + signed(0)


def oasis(path, *records: bytes, start: int = 1000):
    head = b"%SEMI-OASIS\r\n" + whole(1) + whole(3) + b"1.0" + whole(0) + whole(start) + whole(0) + whole(0) * 12
    end = whole(2) + whole(252) + bytes(252) + whole(0)
    path.write_bytes(head + whole(14) + whole(3) + b"TOP" + b"".join(records) + end)
    return path


RECTANGLE = shape(20, 0x60, whole(100_000), whole(40_000), x=0)
AS_HIGH_AS_BEFORE = shape(20, 0, x=400_000)
SQUARE_TRAPEZOID = shape(26, 0xC0, whole(25), whole(100_000), x=200_000)


def test_an_implied_height_on_which_readers_disagree_is_refused_with_place_and_areas(tmp_path):
    path = oasis(tmp_path / "x.oas", RECTANGLE, SQUARE_TRAPEZOID, AS_HIGH_AS_BEFORE)
    areas = r"layer CLEAR \(1/0\) of cell TOP covers 24000 um\^2 for klayout and 18000 um\^2 for gdstk"
    with pytest.raises(SourceError, match=rf"MF316 .*{areas}.* the box \(400, 40\) to \(500, 100\)"):
        read_layout(path)
    found = readings(path).readings[:-1]
    assert {each.reader: [(row.layer, row.area_um2) for row in each.layers] for each in found} == {
        "gdstk": [("1/0", 18000)],
        "klayout": [("1/0", 24000)],
    }


@pytest.mark.parametrize("kind", range(26))
def test_trapezoids_of_every_kind_are_read(tmp_path, kind):
    drawn = shape(26, 0xE0, whole(kind), whole(3000), whole(900), x=200_000)
    if kind in range(8, 14):  # which are at least as wide as they are high, to either side
        drawn = shape(26, 0xE0, whole(kind), whole(900), whole(3000), x=200_000)
    path = oasis(tmp_path / "x.oas", RECTANGLE, drawn)
    assert {len(each.layers) for each in readings(path).readings} == {1}
    assert area_um2(read_layout(path)) > 4000


def test_a_circle_is_within_a_nanometre_and_counted(tmp_path):
    path = oasis(tmp_path / "x.oas", shape(27, 0x20, whole(50_000), x=0))
    layout = read_layout(path)
    assert area_um2(layout) == pytest.approx(math.pi * 50**2, abs=2 * math.pi * 50 * 1e-3)
    assert left_out(layout).curves == 1


def test_a_shape_pasted_twice_is_read(tmp_path):
    layout = db.Layout()
    shapes = layout.create_cell("TOP").shapes(layout.layer(1, 0))
    for x in (0, 0, 300_000, 300_000):
        shapes.insert(db.Box(x, 0, x + 100_000, 100_000))
    options = db.SaveLayoutOptions()
    options.format, options.oasis_compression_level = "OASIS", 2
    layout.write(str(tmp_path / "x.oas"), options)
    assert area_um2(read_layout(tmp_path / "x.oas")) == 20_000


def test_oasis_says_when_it_was_changed_after_it_was_written(tmp_path):
    layout = db.Layout()
    layout.create_cell("TOP").shapes(layout.layer(1, 0)).insert(db.Box(0, 0, 100_000, 40_000))
    path = tmp_path / "x.oas"
    write_oasis(layout, path)
    data = path.read_bytes()
    assert data[-5] == 1
    assert zlib.crc32(data[:-4]) == int.from_bytes(data[-4:], "little")
    assert area_um2(read_layout(path)) == 4000
    write_oasis(layout, tmp_path / "again.oas")
    assert (tmp_path / "again.oas").read_bytes() == data
    for scheme in ("crc32", "checksum32"):
        library = gdstk.Library()
        library.new_cell("TOP").add(gdstk.rectangle((0, 0), (100, 40), layer=1))
        library.write_oas(path, compression_level=0, validation=scheme)
        assert area_um2(read_layout(path)) == 4000
        changed = bytearray(path.read_bytes())
        changed[changed.index(bytes.fromhex("a08d06"))] ^= 1
        path.write_bytes(changed)
        with pytest.raises(SourceError, match=r"MF303 x\.oas: its own checksum"):
            read_layout(path)


# --- GDSII by hand ----------------------------------------------------------------------------------------------------


def record(kind: int, *numbers: int, text: bytes = b"", code: str = "h") -> bytes:
    body = text + bytes(len(text) % 2) if text else struct.pack(f">{len(numbers)}{code}", *numbers)
    return struct.pack(">HH", 4 + len(body), kind) + body


def cell(name: bytes, *elements: bytes) -> bytes:
    return b"".join(
        [record(0x0502, *([2026, 1, 1, 0, 0, 0] * 2)), record(0x0606, text=name), *elements, record(0x0700)]
    )


def gdsii(path, *cells: bytes):
    units = bytes.fromhex("0014 0305 3e4189374bc6a7f0 3944b82fa09b5a54")
    head = record(0x0002, 600) + record(0x0102, *([2026, 1, 1, 0, 0, 0] * 2)) + record(0x0206, text=b"LIB") + units
    path.write_bytes(head + b"".join(cells) + record(0x0400))
    return path


def box(x: int, side: int = 100_000) -> bytes:
    corners = (x, 0, x + side, 0, x + side, side, x, side, x, 0)
    return b"".join([record(0x0800), record(0x0D02, 1), record(0x0E02, 0), record(0x1003, *corners, code="i"), END])


def wire(*points: int, width: int = 8000, ends: int = 0) -> bytes:
    head = [record(0x0900), record(0x0D02, 1), record(0x0E02, 0), record(0x2102, ends), record(0x0F03, width, code="i")]
    longer = [record(0x3003, 1000, code="i"), record(0x3103, -500, code="i")] if ends == 4 else []
    return b"".join([*head, *longer, record(0x1003, *points, code="i"), END])


def place(name: bytes, *more: bytes) -> bytes:
    return b"".join([record(0x0A00), record(0x1206, text=name), *more, record(0x1003, 0, 0, code="i"), END])


END = record(0x1100)
NODE = b"".join([record(0x1500), record(0x0D02, 1), record(0x2A02, 0), record(0x1003, 0, 0, code="i"), END])
TWICE = record(0x1A01, 0) + bytes.fromhex("000c 1b05 4120000000000000")


def test_records_that_draw_nothing_are_passed_over(tmp_path):
    flagged = record(0x0800) + record(0x2601, 0) + record(0x2F03, 1, code="i") + box(200_000)[4:]
    assert area_um2(read_layout(gdsii(tmp_path / "x.gds", cell(b"TOP", box(0), NODE, flagged)))) == 20_000


@pytest.mark.parametrize(
    ("ends", "area"), [(0, 0), (1, math.pi * 16), (2, 64), (4, 4)], ids=["flush", "round", "square", "stated"]
)
def test_a_path_of_one_point_draws_what_its_ends_are(tmp_path, ends, area):
    for points in ((200_000, 0), (200_000, 0, 200_000, 0)):
        layout = read_layout(gdsii(tmp_path / "x.gds", cell(b"TOP", box(0), wire(*points, ends=ends))))
        assert area_um2(layout) - 10_000 == pytest.approx(area, abs=0.03)


def test_round_ends_are_within_a_nanometre_and_counted(tmp_path):
    layout = read_layout(gdsii(tmp_path / "x.gds", cell(b"TOP", wire(0, 0, 40_000, 0, ends=1))))
    assert area_um2(layout) == pytest.approx(40 * 8 + math.pi * 16, abs=math.pi * 8 * 1e-3)
    assert left_out(layout).curves == 1


@pytest.mark.parametrize("ends", [0, 1, 2, 4])
def test_bent_paths_whose_corners_readers_round_otherwise_agree(tmp_path, ends):
    points = (0, 0, 100_003, 0, 80_001, 50_007, 20_000, 49_999)
    assert area_um2(read_layout(gdsii(tmp_path / "x.gds", cell(b"TOP", wire(*points, width=8001, ends=ends))))) > 1500


def test_a_path_of_absolute_width_is_read_where_nothing_is_magnified(tmp_path):
    inner = cell(b"WIRE", wire(0, 0, 25_000, 0, width=-10_000))
    assert area_um2(read_layout(gdsii(tmp_path / "x.gds", inner, cell(b"TOP", place(b"WIRE"))))) == 250
    gdsii(tmp_path / "x.gds", inner, cell(b"MID", place(b"WIRE")), cell(b"TOP", place(b"MID", TWICE)))
    with pytest.raises(SourceError, match=r"MF316 .*absolute width below cell 'MID'.*'TOP' places 2 times"):
        read_layout(tmp_path / "x.gds")


@pytest.mark.parametrize("bit", [2, 4])
def test_absolute_angles_and_magnifications_are_refused(tmp_path, bit):
    gdsii(tmp_path / "x.gds", cell(b"DOT", box(0)), cell(b"TOP", place(b"DOT", record(0x1A01, bit))))
    with pytest.raises(SourceError, match=r"MF316 .*absolute magnification or angle"):
        read_layout(tmp_path / "x.gds")


def test_cells_that_are_lacking_are_named(tmp_path):
    with pytest.raises(SourceError, match=r"MF303 .*lacks: GONE, LOST"):
        read_layout(gdsii(tmp_path / "x.gds", cell(b"TOP", box(0), place(b"GONE"), place(b"LOST"))))


def test_what_klayout_keeps_beside_its_cells_is_no_cell(tmp_path):
    layout = db.Layout()
    for name, x in (("A", 0), ("B", 120)):
        layout.create_cell(name).shapes(layout.layer(1, 0)).insert(db.DBox(x, 0, x + 50, 20))
        layout.cell(name).shapes(layout.layer(1, 0)).insert(db.DText("label", db.DTrans(x, 0)))
        layout.cell(name).add_meta_info(db.LayoutMetaInfo("settings", "width=30", "", True))
    layout.write(str(tmp_path / "x.gds"))
    read = read_layout(tmp_path / "x.gds")
    assert area_um2(read, "A") == 1000
    with pytest.raises(SourceError, match=r"MF305 .*2 top cells: A, B"):
        find_cell(read)


def test_a_variant_of_a_parametric_cell_is_read_as_its_shapes(tmp_path):
    class Bar(db.PCellDeclaration):
        def get_parameters(self):
            return [db.PCellParameterDeclaration("w", db.PCellParameterDeclaration.TypeDouble, "width", 1.0)]

        def display_text(self, parameters):
            return f"BAR({parameters[0]})"

        def produce(self, layout, layers, parameters, own):
            own.shapes(layout.layer(1, 0)).insert(db.DBox(0, 0, parameters[0], 10))

    library = db.Library()
    library.layout().register_pcell("Bar", Bar())
    library.register("maskfab_test_bars")
    layout = db.Layout()
    top = layout.create_cell("TOP")
    variant = layout.create_cell("Bar", "maskfab_test_bars", {"w": 30.0})
    top.insert(db.CellInstArray(variant.cell_index(), db.Trans(1000, 0)))
    layout.write(str(tmp_path / "x.gds"))
    library.delete()
    assert area_um2(read_layout(tmp_path / "x.gds")) == 300


def test_steps_of_an_array_off_the_grid_do_not_add_up(tmp_path):
    library = gdstk.Library()
    dot = library.new_cell("DOT").add(gdstk.rectangle((0, 0), (1, 1), layer=1))
    library.new_cell("TOP").add(gdstk.Reference(dot, columns=49, rows=3, spacing=(169.3344, 5)))
    library.write_gds(tmp_path / "x.gds")
    layout = read_layout(tmp_path / "x.gds")
    assert layout.top_cell().bbox().right == round(48 * 8_297_386 / 49) + 1000
    assert 0.4 < rounding_nm(layout) <= 0.5
    drift_nm, which = array_drift(layout)
    assert which == "copy 49 of cell DOT in an array"
    assert drift_nm == pytest.approx(48 * abs(8_297_386 / 49 - 169_334))


# --- packed -----------------------------------------------------------------------------------------------------------


def test_packed_layouts_are_read_within_a_limit(tmp_path, monkeypatch):
    plain = gdsii(tmp_path / "x.gds", cell(b"TOP", box(0))).read_bytes()
    path = tmp_path / "x.gds.gz"
    path.write_bytes(gzip.compress(plain))
    assert area_um2(read_layout(path)) == 10_000
    path.write_bytes(gzip.compress(plain)[:-20])
    with pytest.raises(SourceError, match=r"MF303 x\.gds\.gz: it cannot be unpacked"):
        read_layout(path)
    path.write_bytes(gzip.compress(plain[:-40]))
    with pytest.raises(SourceError, match=rf"MF303 x\.gds\.gz: .*\({path}\)"):
        read_layout(path)
    monkeypatch.setattr(table, "LARGEST_UNPACKED", len(plain) - 1)
    path.write_bytes(gzip.compress(plain))
    with pytest.raises(SourceError, match=r"MF313 x\.gds\.gz unpacks to more than"):
        read_layout(path)
