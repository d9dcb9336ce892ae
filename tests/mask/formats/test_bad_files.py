"""Files that no mask can be made of are refused with a code that stays, whatever program wrote them."""

from __future__ import annotations

import struct
import time

import ezdxf
import gdstk
import numpy as np
import pytest
from klayout import db
from PIL import Image

from maskfab.base.errors import SourceError
from maskfab.base.model import CLEAR
from maskfab.mask.formats import content
from maskfab.mask.formats.content import find_cell, find_layer, rounding_nm
from maskfab.mask.formats.picture import read_picture
from maskfab.mask.formats.table import read_layout
from maskfab.mask.layout import count_shapes, left_out, region
from maskfab.mask.process_limits import children_seconds

SQUARE = [(0, 0), (10, 0), (10, 10), (0, 10)]
BOW = [(0, 0), (10, 10), (10, 0), (0, 10)]
TWICE = [*SQUARE, *SQUARE]


def refusal(path, **how):
    with pytest.raises(SourceError) as caught:
        read_picture(path, **how) if path.suffix in {".png", ".tif"} else read_layout(path)
    assert path.name in str(caught.value)
    return caught.value.code


# --- DXF -------------------------------------------------------------------------------------------------------------

DRAWN = {
    "open line": (lambda m: m.add_lwpolyline(SQUARE), "MF310"),
    "line": (lambda m: m.add_line((0, 0), (5, 5)), "MF310"),
    "open line of vertices": (lambda m: m.add_polyline2d(SQUARE), "MF310"),
    "arc": (lambda m: m.add_arc((0, 0), 5, 0, 90), "MF310"),
    "spline": (lambda m: m.add_spline([(0, 0), (5, 5), (9, 0)]), "MF311"),
    "open bulge": (lambda m: m.add_lwpolyline([(0, 0, 0, 0, 1), (10, 0)]), "MF310"),
    "bow": (lambda m: m.add_lwpolyline(BOW, close=True), "MF312"),
    "a square twice round": (lambda m: m.add_lwpolyline(TWICE, close=True), "MF312"),
}


def drawing(path, draw, version="R2010"):
    document = ezdxf.new(version, units=13)
    draw(document.modelspace())
    document.saveas(path)
    return path


@pytest.mark.parametrize("what", DRAWN)
def test_dxf_that_draws_no_polygons_is_refused(tmp_path, what):
    draw, code = DRAWN[what]
    assert refusal(drawing(tmp_path / "x.dxf", draw)) == code


def test_lines_inside_a_block_are_found_and_named(tmp_path):
    def draw(modelspace):
        block = modelspace.doc.blocks.new("PART")
        block.add_line((0, 0), (1, 1), dxfattribs={"layer": "CLEAR"})
        modelspace.add_blockref("PART", (0, 0))

    with pytest.raises(SourceError, match=r"MF310 x\.dxf draws 1 x LINE on layer 'CLEAR'"):
        read_layout(drawing(tmp_path / "x.dxf", draw))


@pytest.mark.parametrize("version", ["R12", "R2010"])
def test_a_line_that_returns_to_its_start_is_closed(tmp_path, version):
    def draw(modelspace):
        add = modelspace.add_polyline2d if version == "R12" else modelspace.add_lwpolyline
        add([*SQUARE, SQUARE[0]])

    layout = read_layout(drawing(tmp_path / "x.dxf", draw, version))
    assert region(layout, find_layer(layout)).area() == 10_000**2


def test_names_that_are_no_text_are_refused(tmp_path):
    path = drawing(tmp_path / "x.dxf", lambda m: m.add_lwpolyline(SQUARE, close=True, dxfattribs={"layer": "CHROME"}))
    path.write_bytes(path.read_bytes().replace(b"CHROME", b"CHR\x80ME"))
    assert refusal(path) == "MF303"


# --- GDSII and OASIS -------------------------------------------------------------------------------------------------


def library(path, *polygons, **keys):
    made = gdstk.Library(unit=1e-6, precision=1e-9)
    cell = made.new_cell(keys.get("name", "TOP"))
    for points in polygons:
        cell.add(gdstk.Polygon(points, layer=1))
    (made.write_gds if path.suffix == ".gds" else made.write_oas)(path)
    return path


@pytest.mark.parametrize("suffix", ["gds", "oas"])
@pytest.mark.parametrize("points", [BOW, TWICE], ids=["bow", "twice"])
def test_a_polygon_that_crosses_itself_is_refused(tmp_path, suffix, points):
    assert refusal(library(tmp_path / f"x.{suffix}", SQUARE, points)) == "MF312"


def test_a_shape_that_one_reader_leaves_out_is_told(tmp_path, monkeypatch):
    path = library(tmp_path / "x.gds", SQUARE, [(20, 0), (30, 0), (30, 10)])
    whole = content.Conversion.layout

    def forgetful(self, content):
        content[0]["polygons"]["sizes"] = content[0]["polygons"]["sizes"][:-1]
        content[0]["polygons"]["layers"] = content[0]["polygons"]["layers"][:-1]
        return whole(self, content)

    monkeypatch.setattr(content.Conversion, "layout", forgetful)
    where = r"layer CLEAR \(1/0\) of cell TOP covers 150 um\^2 for klayout and 100 um\^2 for gdstk"
    with pytest.raises(SourceError, match=rf"MF316 x\.gds: .*{where}; they differ in the box \(20, 0\) to \(30, 10\)"):
        read_layout(path)


def test_a_keyhole_does_not_cross_itself(tmp_path):
    keyhole = [(0, 0), (0, 9), (9, 9), (9, 0), (0, 0), (3, 3), (6, 3), (6, 6), (3, 6), (3, 3)]
    layout = read_layout(library(tmp_path / "x.gds", keyhole))
    assert region(layout, CLEAR).area() == 72e6


def test_polygons_without_area_and_repeated_vertices_are_counted(tmp_path):
    flat = [(20, 0), (25, 0), (30, 0)]
    doubled = [(0, 0), (10, 0), (10, 0), (10, 10), (5, 10), (0, 10)]
    layout = read_layout(library(tmp_path / "x.gds", flat, doubled))
    noted = left_out(layout)
    assert (noted.empty_polygons, noted.repeated_vertices) == (1, 1)
    assert count_shapes(layout) == 1


@pytest.mark.parametrize("far", [1.5e6, 2.14e6, 4e6])
def test_absurd_coordinates_are_refused(tmp_path, far):
    made = gdstk.Library(unit=1e-6, precision=1e-8 if far > 2.1e6 else 1e-9)
    made.new_cell("TOP").add(gdstk.rectangle((0, 0), (1, far), layer=1))
    made.write_gds(tmp_path / "x.gds")
    assert refusal(tmp_path / "x.gds") in {"MF303", "MF313"}


def test_an_array_that_reaches_beyond_a_metre_is_refused(tmp_path):
    layout = db.Layout()
    dot, top = layout.create_cell("DOT"), layout.create_cell("TOP")
    dot.shapes(layout.layer(1, 0)).insert(db.Box(0, 0, 10, 10))
    top.insert(db.CellInstArray(dot.cell_index(), db.Trans(), db.Vector(100_000, 0), db.Vector(0, 1), 20_000, 1))
    layout.write(str(tmp_path / "x.oas"))
    assert refusal(tmp_path / "x.oas") == "MF313"


def record(kind, *values, code="h"):
    data = b"".join(struct.pack(f">{code}", value) for value in values)
    return struct.pack(">HH", 4 + len(data), kind) + data


def array_by_hand(columns, rows, *corners):
    """GDSII of an array whose corners (origin, behind the last column, behind the last row) are as given."""
    now = [2026, 1, 1, 0, 0, 0] * 2

    def name(kind, text):
        return struct.pack(">HH", 4 + len(text), kind) + text

    # 1 nm is 1e-3 of the user's unit, and 1e-9 m.
    unit = struct.pack(">HH", 20, 0x0305) + bytes.fromhex("3e4189374bc6a7f0 3944b82fa09b5a54")
    head = [record(0x0002, 600), record(0x0102, *now), name(0x0206, b"LIB1"), unit]
    box = record(0x1003, 0, 0, 1000, 0, 1000, 1000, 0, 1000, 0, 0, code="i")
    dot = [record(0x0502, *now), name(0x0606, b"DOT1"), record(0x0800), record(0x0D02, 1), record(0x0E02, 0), box]
    corner = record(0x1003, *(value for corner in corners for value in corner), code="i")
    placed = [record(0x0B00), name(0x1206, b"DOT1"), record(0x1302, columns, rows), corner]
    top = [record(0x0502, *now), name(0x0606, b"TOP1"), *placed]
    end = [record(0x1100), record(0x0700)]
    return b"".join([*head, *dot, *end, *top, *end, record(0x0400)])


@pytest.mark.parametrize(
    ("columns", "rows", "corners"),
    [
        (2, 1, [(0, 0), (0, 0), (0, 0)]),
        (2, 1, [(0, 0), (0, 0), (0, 2000)]),
        (1, 3, [(0, 0), (2000, 0), (0, 0)]),
        (2, 2, [(5, 5), (4005, 5), (5, 5)]),
    ],
)
def test_copies_of_an_array_that_lie_on_each_other_are_all_read(tmp_path, columns, rows, corners):
    path = tmp_path / "x.gds"
    path.write_bytes(array_by_hand(columns, rows, *corners))
    layout = read_layout(path)
    assert count_shapes(layout) == columns * rows
    assert region(layout, CLEAR).area() == 1000**2 * (2 if (columns, rows) == (2, 2) else 1)


def test_an_array_of_very_many_copies_on_each_other_is_refused(tmp_path):
    path = tmp_path / "x.gds"
    path.write_bytes(array_by_hand(80, 80, (0, 0), (0, 0), (0, 0)))
    assert refusal(path) == "MF326"


def test_an_array_with_one_column_needs_no_step_along_it(tmp_path):
    path = tmp_path / "x.gds"
    path.write_bytes(array_by_hand(1, 3, (0, 0), (0, 0), (0, 6000)))
    layout = read_layout(path)
    assert count_shapes(layout) == 3
    assert region(layout, CLEAR).area() == 3_000_000


@pytest.mark.parametrize("suffix", ["gds", "oas"])
@pytest.mark.parametrize("columns", [2, 100])
@pytest.mark.parametrize("what", ["polygon", "reference"])
def test_no_copy_that_lies_on_another_gets_lost(tmp_path, suffix, columns, what):
    made = gdstk.Library(unit=1e-6, precision=1e-9)
    dot, top = made.new_cell("DOT"), made.new_cell("TOP")
    dot.add(gdstk.rectangle((0, 0), (1, 1), layer=1))
    drawn = gdstk.rectangle((2, 2), (3, 3), layer=1) if what == "polygon" else gdstk.Reference(dot)
    drawn.repetition = gdstk.Repetition(columns=columns, rows=1, spacing=(0, 0))
    top.add(drawn, gdstk.Reference(dot, (9, 9)))
    path = tmp_path / f"x.{suffix}"
    (made.write_gds if suffix == "gds" else made.write_oas)(path)
    layout = read_layout(path)
    assert count_shapes(layout) == columns + 1
    assert region(layout, CLEAR).area() == 2_000_000


def test_zeros_may_stand_behind_the_end_of_gdsii_and_nothing_else(tmp_path):
    path = library(tmp_path / "x.gds", SQUARE)
    whole = path.read_bytes()
    path.write_bytes(whole + bytes(-len(whole) % 2048))
    assert region(read_layout(path), CLEAR).area() == 10_000**2
    for behind in (b"garbage", b"garbage\0\0\0\0", whole, bytes(2048) + whole[-4:]):
        path.write_bytes(whole + behind)
        with pytest.raises(SourceError, match=r"MF303 x\.gds: \d+ bytes stand behind its end"):
            read_layout(path)


def tower(path, levels, copies):
    layout = db.Layout()
    below = layout.create_cell("LEVEL0")
    below.shapes(layout.layer(1, 0)).insert(db.Box(0, 0, 1000, 1000))
    for level in range(1, levels):
        above = layout.create_cell(f"LEVEL{level}")
        for copy in range(copies):
            above.insert(db.CellInstArray(below.cell_index(), db.Trans(2000 * copy, 0)))
        below = above
    layout.write(str(path))
    return path


def test_a_hundred_levels_are_read(tmp_path):
    layout = read_layout(tower(tmp_path / "x.gds", 100, 1))
    assert find_cell(layout).hierarchy_levels() == 99
    assert region(layout, CLEAR).area() == 1_000_000


def test_levels_that_multiply_beyond_all_bounds_are_refused_at_once(tmp_path):
    path = tower(tmp_path / "x.gds", 100, 2)
    start = time.perf_counter()
    assert refusal(path) == "MF313"
    assert time.perf_counter() - start < 5


def test_a_million_polygons_in_arrays_are_counted_not_copied(tmp_path):
    layout = db.Layout()
    dot, top = layout.create_cell("DOT"), layout.create_cell("TOP")
    dot.shapes(layout.layer(1, 0)).insert(db.Box(0, 0, 10, 10))
    top.insert(db.CellInstArray(dot.cell_index(), db.Trans(), db.Vector(20, 0), db.Vector(0, 20), 1000, 1000))
    layout.write(str(tmp_path / "x.oas"))
    start = children_seconds() + time.process_time()
    assert count_shapes(read_layout(tmp_path / "x.oas")) == 1_000_000
    assert children_seconds() + time.process_time() - start < 5


def test_one_polygon_a_million_times_becomes_one_placement(tmp_path):
    made = gdstk.Library(unit=1e-6, precision=1e-9)
    dot = gdstk.rectangle((0, 0), (1, 1), layer=1)
    dot.repetition = gdstk.Repetition(columns=1000, rows=1000, spacing=(2, 3))
    made.new_cell("TOP").add(dot)
    made.write_oas(tmp_path / "x.oas")
    layout = read_layout(tmp_path / "x.oas")
    assert count_shapes(layout) == 1_000_000
    assert find_cell(layout).name == "TOP"
    assert region(layout, CLEAR, (1_998_000, 2_997_000, 2_000_000, 3_000_000)).area() == 1_000_000


@pytest.mark.parametrize("name", ["../../etc/passwd", "A/B", "<b>bold</b>", "C:\\\\x"])
def test_names_are_names_and_never_paths(tmp_path, name):
    layout = read_layout(library(tmp_path / "x.oas", SQUARE, name=name))
    assert find_cell(layout).name == name
    assert [path.name for path in tmp_path.iterdir()] == ["x.oas"]


# --- Gerber ----------------------------------------------------------------------------------------------------------

HEAD = "%FSLAX46Y46*%\n%MOMM*%\nG01*\n%ADD10C,0.1*%\n%ADD11R,0.2X0.1*%\n%LPD*%\n"
REGION = "G36*\nX0Y0D02*\nX1000000Y0D01*\nX1000000Y1000000D01*\nX0Y1000000D01*\nX0Y0D01*\nG37*\n"


def gerber(path, body, end="M02*\n"):
    path.write_text(HEAD + body + end, encoding="ascii")
    return path


def test_gerber_regions_are_read_to_the_nanometre(tmp_path):
    layout = read_layout(gerber(tmp_path / "x.gbr", REGION.replace("1000000", "1000001")))
    assert region(layout, CLEAR).bbox() == db.Box(0, 0, 1_000_001, 1_000_001)
    assert rounding_nm(layout) == 0


def test_clear_polarity_takes_away_what_is_below_it_and_nothing_above(tmp_path):
    hole = "%LPC*%\nD11*\nX500000Y500000D03*\n%LPD*%\nX500000Y500000D03*\nX900000Y900000D02*\n"
    first = region(read_layout(gerber(tmp_path / "a.gbr", REGION + hole.split("%LPD*%", maxsplit=1)[0])), CLEAR)
    assert first.area() == 1_000_000**2 - 200_000 * 100_000
    assert region(read_layout(gerber(tmp_path / "b.gbr", REGION + hole)), CLEAR).area() == 1_000_000**2


def test_circles_are_polygons_close_to_them_and_said_to_be(tmp_path):
    layout = read_layout(gerber(tmp_path / "x.gbr", "D10*\nX0Y0D03*\n"))
    assert left_out(layout).curves == 1
    assert region(layout, CLEAR).area() == pytest.approx(np.pi * 50_000**2, rel=1e-4)


def test_gerber_in_inches_has_its_size(tmp_path):
    path = gerber(tmp_path / "x.gbr", REGION)
    path.write_text(path.read_text().replace("MOMM", "MOIN"))
    assert region(read_layout(path), CLEAR).bbox() == db.Box(0, 0, 25_400_000, 25_400_000)


@pytest.mark.parametrize(
    ("body", "code"),
    [
        ("%SRX2Y2I3.0J4.0*%\n" + REGION + "%SR*%\n", "MF315"),
        ("%ABD12*%\n" + REGION + "%AB*%\nD12*\nX0Y0D03*\n", "MF315"),
        ("%AMX*1,1,0.1,0,0*%\n%ADD13X*%\nD13*\nX0Y0D03*\n", "MF315"),
        ("%LMX*%\n" + REGION, "MF315"),
        ("%IFother.gbr*%\n" + REGION, "MF315"),
        ("G75*\n" + REGION.replace("G36*", "G36*\nG02*"), "MF311"),
        ("G75*\nD10*\nX0Y0D02*\nG03X10Y0I5J0D01*\n", "MF311"),
        (REGION.replace("X0Y0D01*\n", ""), "MF310"),
        (REGION.replace("G37*", ""), "MF303"),
        ("D77*\nX0Y0D03*\n", "MF303"),
        ("G36*\nX0Y0D02*\nX10Y10D01*\nX10Y0D01*\nX0Y10D01*\nX0Y0D01*\nG37*\n", "MF312"),
    ],
)
def test_gerber_that_would_be_read_wrong_is_refused(tmp_path, body, code):
    assert refusal(gerber(tmp_path / "x.gbr", body)) == code


def test_gerber_that_is_cut_off_is_refused(tmp_path):
    assert refusal(gerber(tmp_path / "x.gbr", REGION, end="")) == "MF303"
    (tmp_path / "y.gbr").write_bytes(b"\x89PNG")
    assert refusal(tmp_path / "y.gbr") == "MF304"
    (tmp_path / "z.gbr").write_bytes(b"")
    assert refusal(tmp_path / "z.gbr") == "MF302"


# --- pictures --------------------------------------------------------------------------------------------------------


def picture(path, values, **tags):
    """Of grey values [rows, columns], or of brightness and opacity in a third axis; a TIFF may have tags by number."""
    Image.fromarray(np.asarray(values, dtype=np.uint8)).save(path, **tags)
    return path


@pytest.mark.parametrize("suffix", ["png", "tif"])
def test_white_pixels_are_clear_and_the_top_row_is_above(tmp_path, suffix):
    path = picture(tmp_path / f"x.{suffix}", [[255, 0, 0], [255, 255, 0]])
    clear = region(read_picture(path, 0.5), CLEAR)
    assert (clear ^ db.Region([db.Box(-3000, -2000, 1000, 0), db.Box(-3000, 0, -1000, 2000)])).is_empty()


def test_the_size_of_pixels_is_what_the_tags_say_or_what_is_stated(tmp_path):
    tagged = picture(tmp_path / "x.tif", [[255] * 4] * 4, resolution=2000.0, resolution_unit="cm")
    assert region(read_picture(tagged), CLEAR).bbox().width() == 20_000
    assert region(read_picture(tagged, 1.0), CLEAR).bbox().width() == 4_000
    assert refusal(picture(tmp_path / "y.png", [[255]])) == "MF314"


def test_grey_pixels_are_counted(tmp_path):
    layout = read_picture(picture(tmp_path / "x.png", [[0, 100, 200, 255]]), 1.0)
    assert left_out(layout).grey_pixels == 2
    assert region(layout, CLEAR).area() == 2_000_000


def test_a_picture_that_is_turned_by_its_tags_is_refused(tmp_path):
    assert refusal(picture(tmp_path / "x.tif", [[255, 0]], tiffinfo={274: 6}), dots_per_um=1.0) == "MF308"


@pytest.mark.parametrize("suffix", ["png", "tif"])
def test_a_picture_that_can_be_seen_through_is_refused(tmp_path, suffix):
    shape_in_alpha = picture(tmp_path / f"x.{suffix}", [[[255, 255], [255, 0]]])
    assert refusal(shape_in_alpha, dots_per_um=1.0) == "MF308"
    barely = picture(tmp_path / f"y.{suffix}", [[[255, 255], [0, 254]]])
    assert refusal(barely, dots_per_um=1.0) == "MF308"
    opaque = picture(tmp_path / f"z.{suffix}", [[[255, 255], [0, 255]]])
    assert region(read_picture(opaque, 1.0), CLEAR).area() == 1_000_000


@pytest.mark.parametrize("cut", [1, 12, 13])
def test_a_png_that_ends_within_or_before_its_last_chunk_is_refused(tmp_path, cut):
    path = picture(tmp_path / "x.png", [[255, 0], [0, 255]])
    path.write_bytes(path.read_bytes()[:-cut])
    assert refusal(path, dots_per_um=1.0) == "MF303"


@pytest.mark.parametrize("suffix", ["png", "tif"])
def test_pictures_that_are_none_are_refused(tmp_path, suffix):
    path = tmp_path / f"x.{suffix}"
    assert refusal(path) == "MF301"
    path.write_bytes(b"")
    assert refusal(path) == "MF302"
    path.write_bytes(b"GIF89a")
    assert refusal(path) == "MF304"
    whole = picture(tmp_path / f"y.{suffix}", np.random.default_rng(0).integers(0, 2, (60, 60)) * 255).read_bytes()
    path.write_bytes(whole[: len(whole) // 2])
    assert refusal(path, dots_per_um=1.0) == "MF303"
