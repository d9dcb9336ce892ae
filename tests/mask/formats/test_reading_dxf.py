"""DXF as other programs write it: closed lines beside fills, units, nested blocks, and what lies off the grid."""

from __future__ import annotations

import cmath
import math
import random
import time

import ezdxf
import gdstk
import pytest
from klayout import db

from maskfab.base.errors import JobError, SourceError
from maskfab.base.model import CLEAR
from maskfab.mask.formats.content import find_layer, rounding_nm
from maskfab.mask.formats.drawing import drawn_unit_um
from maskfab.mask.formats.dxf_scan import entities
from maskfab.mask.formats.table import read_layout
from maskfab.mask.layout import count_shapes, count_texts, left_out, region

ON_CLEAR = {"layer": "CLEAR"}
MICROMETRES, MILLIMETRES, INCHES = 13, 4, 1
UM_PER_UNIT = {MICROMETRES: 1.0, MILLIMETRES: 1e3, INCHES: 25400.0}


def square(x, y, side=10.0):
    return [(x, y), (x + side, y), (x + side, y + side), (x, y + side)]


def boxes(*corners, side=10_000):
    return db.Region([db.Box(x, y, x + side, y + side) for x, y in corners]).merged()


def drawing(path, draw, version="R2010", unit=MICROMETRES):
    document = ezdxf.new(version)
    if version != "R12":
        document.header["$INSUNITS"] = unit
    draw(document.modelspace())
    document.saveas(path)
    return path


def closed(modelspace, points, **attributes):
    modelspace.add_lwpolyline(points, close=True, dxfattribs=ON_CLEAR | attributes)


def read_clear(path, **how):
    return region(read_layout(path, **how), CLEAR)


# --- what is drawn is read, whatever stands beside it ----------------------------------------------------------------

BESIDE = {
    "nothing": lambda m: None,
    "a solid": lambda m: m.add_solid([(90, 0), (100, 0), (90, 10), (100, 10)], dxfattribs=ON_CLEAR),
    "a hatch elsewhere": lambda m: m.add_hatch(dxfattribs={"layer": "FRAME"}).paths.add_polyline_path(square(90, 0)),
    "an open line elsewhere": lambda m: m.add_lwpolyline(square(90, 0), dxfattribs={"layer": "FRAME"}),
    "a line elsewhere": lambda m: m.add_line((90, 0), (95, 0), dxfattribs={"layer": "FRAME"}),
    "a circle elsewhere": lambda m: m.add_circle((90, 0), 5, dxfattribs={"layer": "FRAME"}),
    "a point elsewhere": lambda m: m.add_point((90, 0), dxfattribs={"layer": "FRAME"}),
    "a text": lambda m: m.add_text("A", dxfattribs=ON_CLEAR),
}


@pytest.mark.parametrize("beside", BESIDE)
def test_closed_lines_are_polygons_whatever_stands_beside_them(tmp_path, beside):
    def draw(modelspace):
        closed(modelspace, square(0, 0))  # said to be closed
        modelspace.add_lwpolyline([*square(20, 0), (20, 0)], dxfattribs=ON_CLEAR)  # back at its start
        modelspace.add_polyline2d(square(40, 0), close=True, dxfattribs=ON_CLEAR)
        BESIDE[beside](modelspace)

    expected = boxes((0, 0), (20_000, 0), (40_000, 0), *([(90_000, 0)] if beside == "a solid" else []))
    assert (read_clear(drawing(tmp_path / "x.dxf", draw)) ^ expected).is_empty()


@pytest.mark.parametrize("returning", [False, True])
def test_polygons_that_overlap_touch_or_lie_in_each_other_are_united(tmp_path, returning):
    corners = [(0, 0), (5, 5), (10, 0), (15, 10), (3, 30)]

    def draw(modelspace):
        for x, y in corners:
            points = square(x, y)
            modelspace.add_lwpolyline(
                [*points, points[0]] if returning else points, close=not returning, dxfattribs=ON_CLEAR
            )
        modelspace.add_lwpolyline(square(5, 32, 2), close=True, dxfattribs=ON_CLEAR)

    found = read_clear(drawing(tmp_path / "x.dxf", draw))
    assert (found ^ boxes(*((1000 * x, 1000 * y) for x, y in corners))).is_empty()


@pytest.mark.parametrize("seed", range(8))
def test_any_mixture_reads_as_the_union_of_its_parts(tmp_path, seed):
    chance = random.Random(seed)
    expected = db.Region()

    def draw(modelspace):
        for _ in range(30):
            x, y, side = chance.randrange(60), chance.randrange(60), chance.randrange(1, 20)
            points = square(x, y, side)
            kind = chance.randrange(5)
            expected.insert(db.Box(1000 * x, 1000 * y, 1000 * (x + side), 1000 * (y + side)))
            if kind == 0:
                closed(modelspace, points)
            elif kind == 1:
                modelspace.add_lwpolyline([*points, points[0]], dxfattribs=ON_CLEAR)
            elif kind == 2:
                modelspace.add_polyline2d(points, close=True, dxfattribs=ON_CLEAR)
            elif kind == 3:
                modelspace.add_solid([points[0], points[1], points[3], points[2]], dxfattribs=ON_CLEAR)
            else:
                middle = y + side / 2
                modelspace.add_lwpolyline(
                    [(x, middle), (x + side, middle)], dxfattribs={**ON_CLEAR, "const_width": side}
                )

    path = drawing(tmp_path / "x.dxf", draw)
    layout = read_layout(path)
    assert (region(layout, CLEAR) ^ expected.merged()).is_empty()
    assert (rounding_nm(layout), left_out(layout).empty_polygons) == (0, 0)


def test_a_solid_of_three_corners_is_a_triangle(tmp_path):
    for corners in ([(0, 0), (10, 0), (0, 10)], [(0, 0), (10, 0), (0, 10), (0, 10)]):
        path = drawing(tmp_path / "x.dxf", lambda m, corners=corners: m.add_solid(corners, dxfattribs=ON_CLEAR))
        layout = read_layout(path)
        assert region(layout, CLEAR).area() == 50_000_000
        assert rounding_nm(layout) == 0


def test_polygons_without_area_and_repeated_vertices_are_counted(tmp_path):
    def draw(modelspace):
        closed(modelspace, square(0, 0))
        closed(modelspace, [(0, 0), (10, 0), (10, 0), (10, 10), (0, 10)])
        closed(modelspace, [(20, 0), (25, 0), (30, 0)])
        closed(modelspace, square(50, 50, 0.0002))

    layout = read_layout(drawing(tmp_path / "x.dxf", draw))
    assert left_out(layout).empty_polygons == 2
    assert left_out(layout).repeated_vertices == 1 + 3
    assert count_shapes(layout) == 2


# --- the nanometre grid ----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("unit", UM_PER_UNIT)
@pytest.mark.parametrize("version", ["R12", "R2010"])
def test_what_lies_off_the_grid_is_told_as_for_gdsii(tmp_path, unit, version):
    chance = random.Random(unit)
    scale = UM_PER_UNIT[unit]
    shapes = [square(chance.randrange(99) + chance.random() / 1e3, chance.randrange(99)) for _ in range(20)]

    def draw(modelspace):
        for points in shapes:
            add = modelspace.add_polyline2d if version == "R12" else modelspace.add_lwpolyline
            add([(x / scale, y / scale) for x, y in points], close=True, dxfattribs=ON_CLEAR)

    how = {} if version != "R12" else {"unit_um": scale}
    dxf = read_layout(drawing(tmp_path / "x.dxf", draw, version, unit), **how)
    library = gdstk.Library(unit=1e-6, precision=1e-12)
    cell = library.new_cell("TOP")
    for points in shapes:
        cell.add(gdstk.Polygon(points, layer=1))
    library.write_oas(tmp_path / "x.oas")
    oas = read_layout(tmp_path / "x.oas")
    assert 0 < rounding_nm(dxf) <= 0.5
    assert rounding_nm(dxf) == pytest.approx(rounding_nm(oas), abs=2e-3)
    assert (region(dxf, CLEAR) ^ region(oas, CLEAR)).is_empty()


@pytest.mark.parametrize("unit", UM_PER_UNIT)
def test_what_lies_on_the_grid_in_whatever_unit_is_not_rounded(tmp_path, unit):
    chance = random.Random(unit)
    scale = UM_PER_UNIT[unit]

    def draw(modelspace):
        for _ in range(50):
            x, y = (chance.randrange(-60_000_000, 60_000_000) / 1000 for _ in "xy")
            closed(modelspace, [(u / scale, v / scale) for u, v in square(x, y, 8)])

    layout = read_layout(drawing(tmp_path / "x.dxf", draw, unit=unit))
    assert rounding_nm(layout) == 0
    assert drawn_unit_um(layout) == scale


def test_a_coordinate_beyond_all_reason_is_refused(tmp_path):
    path = drawing(tmp_path / "a.dxf", lambda space: closed(space, square(0, 0)))
    path.write_text(path.read_text().replace("\n10.0\n", "\n1e308\n"))
    with pytest.raises(SourceError, match="MF3"):
        read_layout(path)


@pytest.mark.parametrize(("larger", "angle"), [(1, 0), (10, 0), (-10, 90), (0.5, 30)])
def test_corners_of_a_block_are_rounded_once_where_they_are_placed(tmp_path, larger, angle):
    def draw(modelspace):
        inner, outer = (modelspace.doc.blocks.new(name) for name in ("INNER", "OUTER"))
        closed(inner, square(0.0004, 0))
        outer.add_blockref("INNER", (3, 0), dxfattribs={**ON_CLEAR, "xscale": 2, "yscale": 2})
        placed = {**ON_CLEAR, "xscale": larger, "yscale": larger, "rotation": angle}
        modelspace.add_blockref("OUTER", (5, 0), dxfattribs=placed)

    layout = read_layout(drawing(tmp_path / "x.dxf", draw))
    turn, corners = cmath.rect(1, math.radians(angle)), [complex(x, y) for x, y in square(0.0004, 0)]
    placed = [1000 * (5 + larger * turn * (3 + 2 * corner)) for corner in corners]
    off = max(abs(value - round(value)) for corner in placed for value in (corner.real, corner.imag))
    assert rounding_nm(layout) == pytest.approx(off if off > 1e-4 else 0, abs=1e-6)
    assert region(layout, CLEAR).area() == pytest.approx((20_000 * larger) ** 2, rel=1e-3)


def test_where_a_block_is_placed_off_the_grid_counts_if_it_draws_what_counts(tmp_path):
    def draw(name):
        def drawn(modelspace):
            for block, layer in (("MASK", "CLEAR"), ("TITLE", "FRAME"), ("UNUSED", "CLEAR")):
                points = square(0.0003 if block == "UNUSED" else 0, 0)
                modelspace.doc.blocks.new(block).add_lwpolyline(points, close=True, dxfattribs={"layer": layer})
            modelspace.add_blockref("MASK", (0, 0))
            modelspace.add_blockref(name, (7.0002, 0))
            modelspace.add_lwpolyline(square(0.0004, 0), close=True, dxfattribs={"layer": "FRAME"})

        return drawn

    assert rounding_nm(read_layout(drawing(tmp_path / "a.dxf", draw("MASK")))) == pytest.approx(0.2)
    assert rounding_nm(read_layout(drawing(tmp_path / "b.dxf", draw("TITLE")))) == 0


def test_a_line_with_a_width_is_as_far_off_the_grid_as_its_outline(tmp_path):
    def draw(modelspace):
        modelspace.add_lwpolyline([(0, 0), (10, 0)], dxfattribs={**ON_CLEAR, "const_width": 1.0006})

    assert rounding_nm(read_layout(drawing(tmp_path / "x.dxf", draw))) == pytest.approx(0.3)


# --- units -----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("header", [MICROMETRES, MILLIMETRES, 3])
def test_a_stated_unit_overrides_the_header_before_anything_is_rounded(tmp_path, header):
    points = [(x / 25400, y / 25400) for x, y in square(0.123, 7.001)]
    path = drawing(tmp_path / "x.dxf", lambda m: closed(m, points), unit=header)
    layout = read_layout(path, unit_um=25400.0)
    assert region(layout, CLEAR).bbox() == db.Box(123, 7001, 10_123, 17_001)
    assert rounding_nm(layout) == 0


def test_what_has_no_area_or_crosses_itself_in_a_wrong_unit_names_the_cure(tmp_path):
    tiny = drawing(tmp_path / "x.dxf", lambda m: closed(m, square(0, 0, 0.0003)), unit=MICROMETRES)
    with pytest.raises(SourceError, match=r"MF309 .* none of its 1 polygons has an area .* State its --unit"):
        read_layout(tiny)
    for side in (60.0, 60_000.0):
        far = drawing(tmp_path / "y.dxf", lambda m, side=side: closed(m, square(0, 0, side)), unit=INCHES)
        with pytest.raises(SourceError, match=r"MF313 .*tate its --unit: it is read in units of 25400 um"):
            read_layout(far)
        assert read_clear(far, unit_um=1.0).area() == (1000 * side) ** 2


def test_a_line_on_no_layer_is_refused(tmp_path):
    path = drawing(tmp_path / "x.dxf", lambda m: closed(m, square(0, 0)))
    body = path.read_text(encoding="utf-8")
    assert body.count("  8\nCLEAR\n") == 1
    path.write_text(body.replace("  8\nCLEAR\n", ""), encoding="utf-8")
    with pytest.raises(SourceError, match=r"MF303 x\.dxf: something in it is drawn on no layer"):
        read_layout(path)


@pytest.mark.parametrize("suffix", ["gds", "oas", "gbr"])
def test_files_that_state_their_unit_take_no_other(tmp_path, suffix):
    path = tmp_path / f"x.{suffix}"
    path.write_bytes(b"1234")
    with pytest.raises(JobError, match=r"MF105 x\..* is not a DXF.*--unit"):
        read_layout(path, unit_um=1.0)


# --- blocks and cells ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("chain", "said"),
    [
        ("A", "block 'A' contains itself"),
        ("AB", "contains itself, through '[AB]'"),
        ("ABC", "contains itself, through"),
    ],
)
def test_a_block_that_contains_itself_is_named(tmp_path, capfd, chain, said):
    def draw(modelspace):
        closed(modelspace, square(0, 0))
        for name in chain:
            modelspace.doc.blocks.new(name)
        for name, below in zip(chain, chain[1:] + chain[0], strict=True):
            modelspace.doc.blocks[name].add_blockref(below, (0, 0))
        modelspace.add_blockref("A", (0, 0))

    with pytest.raises(SourceError, match=rf"MF303 x\.dxf: .*{said}"):
        read_layout(drawing(tmp_path / "x.dxf", draw))
    assert "topological" not in capfd.readouterr().err


def test_a_block_is_placed_by_its_name_in_whatever_letters(tmp_path):
    def draw(modelspace):
        closed(modelspace, square(0, 0))
        closed(modelspace.doc.blocks.new("Part"), square(50, 0))
        modelspace.add_blockref("PART", (0, 0)).dxf.name = "PART"

    assert (read_clear(drawing(tmp_path / "x.dxf", draw)) ^ boxes((0, 0), (50_000, 0))).is_empty()


def test_a_block_that_is_not_there_is_refused(tmp_path):
    def draw(modelspace):
        closed(modelspace, square(0, 0))
        modelspace.doc.blocks.new("Part")
        modelspace.add_blockref("Part", (0, 0)).dxf.name = "OTHER"

    with pytest.raises(SourceError, match=r"MF303 .* places blocks that it lacks: OTHER"):
        read_layout(drawing(tmp_path / "x.dxf", draw))


@pytest.mark.parametrize("flags", [4, 8])
def test_a_block_that_is_in_another_file_is_refused(tmp_path, flags):
    def draw(modelspace):
        closed(modelspace, square(0, 0))
        modelspace.doc.add_xref_def("elsewhere.dxf", "PART", flags)
        modelspace.add_blockref("PART", (0, 0))

    with pytest.raises(SourceError, match=r"MF303 .* places blocks that it lacks: PART"):
        read_layout(drawing(tmp_path / "x.dxf", draw))


@pytest.mark.parametrize("suffix", ["gds", "oas"])
@pytest.mark.parametrize("chain", ["A", "AB"])
def test_a_cell_that_contains_itself_is_named(tmp_path, suffix, chain):
    library = gdstk.Library(unit=1e-6, precision=1e-9)
    for name, below in zip(chain, chain[1:] + chain[0], strict=True):
        cell = library.new_cell(name)
        cell.add(gdstk.rectangle((0, 0), (8, 8), layer=1), gdstk.Reference(gdstk.Cell(below)))
    path = tmp_path / f"x.{suffix}"
    (library.write_gds if suffix == "gds" else library.write_oas)(path)
    with pytest.raises(SourceError, match=rf"MF303 x\.{suffix}: cell '[{chain}]' contains itself") as caught:
        read_layout(path)
    assert "Internal error" not in str(caught.value)


# --- what is not seen, or not where it is drawn ----------------------------------------------------------------------

UPRIGHT, FROM_BELOW = {"extrusion": (1, 0, 0)}, {"extrusion": (0, 0, -1)}


def in_layout(name):
    def draw(modelspace):
        document = modelspace.doc
        layout = document.layout(name) if name in document.layout_names() else document.new_layout(name)
        closed(layout, square(50, 0))

    return draw


def in_block(where, layer="0", **placed):
    def draw(modelspace):
        modelspace.doc.blocks.new("PART").add_lwpolyline(square(0, 0), close=True, dxfattribs={"layer": layer})
        space = modelspace.doc.layout("Layout1") if where == "paper" else modelspace
        space.add_blockref("PART", (50, 0), dxfattribs=placed)

    return draw


def on_layer(change, layer="CLEAR"):
    def draw(modelspace):
        getattr(modelspace.doc.layers.add(layer), change)()
        modelspace.add_lwpolyline(square(50, 0), close=True, dxfattribs={"layer": layer})

    return draw


UNSEEN = {
    "paper space": (in_layout("Layout1"), "1 x LWPOLYLINE in paper space on layer 'CLEAR'"),
    "another paper space": (in_layout("Layout2"), "1 x LWPOLYLINE in paper space on layer 'CLEAR'"),
    "a block in paper space": (in_block("paper"), "1 x INSERT in paper space on layer '0'"),
    "invisible": (lambda m: closed(m, square(50, 0), invisible=1), "1 x LWPOLYLINE made invisible"),
    "an invisible block": (in_block("model", invisible=1), "1 x INSERT made invisible"),
    "upright": (lambda m: closed(m, square(50, 0), **UPRIGHT), "1 x LWPOLYLINE out of the plane"),
    "an upright block": (in_block("model", **UPRIGHT), "1 x INSERT out of the plane"),
    "inclined": (lambda m: closed(m, square(50, 0), extrusion=(0, 0.01, 1)), "1 x LWPOLYLINE out of the plane"),
    "frozen": (on_layer("freeze"), "2 x LWPOLYLINE on the frozen layer 'CLEAR'"),
    "frozen holes": (on_layer("freeze", "CUT"), "1 x LWPOLYLINE on the frozen layer 'CUT'"),
    "off": (on_layer("off"), "2 x LWPOLYLINE on the switched-off layer 'CLEAR'"),
    "a line in paper space": (
        lambda m: m.doc.layout("Layout1").add_line((0, 0), (1, 0), dxfattribs=ON_CLEAR),
        "1 x LINE in paper space",
    ),
}


@pytest.mark.parametrize("what", UNSEEN)
def test_what_is_drawn_out_of_sight_is_refused(tmp_path, what):
    beside, said = UNSEEN[what]

    def draw(modelspace):
        closed(modelspace, square(0, 0))
        beside(modelspace)

    with pytest.raises(SourceError, match=rf"MF317 x\.dxf draws {said}.* model space"):
        read_layout(drawing(tmp_path / "x.dxf", draw))


def test_paper_space_of_r12_is_none_of_the_mask(tmp_path):
    def draw(modelspace):
        modelspace.add_polyline2d(square(0, 0), close=True, dxfattribs=ON_CLEAR)
        modelspace.doc.layout("Layout1").add_polyline2d(square(50, 0), close=True, dxfattribs=ON_CLEAR)

    with pytest.raises(SourceError, match=r"MF317 .* draws 1 x POLYLINE in paper space"):
        read_layout(drawing(tmp_path / "x.dxf", draw, "R12"))


def test_what_is_out_of_sight_on_other_layers_does_not_matter(tmp_path):
    def draw(modelspace):
        closed(modelspace, square(0, 0))
        on_layer("freeze", "FRAME")(modelspace)
        in_block("paper", layer="TITLE")(modelspace)
        modelspace.doc.layers.add("SPARE").off()
        modelspace.doc.layout("Layout1").add_viewport((0, 0), (10, 10), (0, 0), 10)

    assert (read_clear(drawing(tmp_path / "x.dxf", draw)) ^ boxes((0, 0))).is_empty()


def test_what_is_drawn_from_below_is_mirrored(tmp_path):
    def draw(modelspace):
        closed(modelspace, square(0, 0), **FROM_BELOW)
        in_block("model", layer="CLEAR", **FROM_BELOW)(modelspace)

    assert (read_clear(drawing(tmp_path / "x.dxf", draw)) ^ boxes((-10_000, 0), (-60_000, 0))).is_empty()


def test_a_point_is_refused_as_a_line_is(tmp_path):
    def draw(modelspace):
        closed(modelspace, square(0, 0))
        modelspace.add_point((50, 0), dxfattribs=ON_CLEAR)

    with pytest.raises(SourceError, match=r"MF310 x\.dxf draws 1 x POINT on layer 'CLEAR'"):
        read_layout(drawing(tmp_path / "x.dxf", draw))


# --- texts -----------------------------------------------------------------------------------------------------------


def test_texts_are_counted_as_often_as_they_are_placed(tmp_path):
    def draw(modelspace):
        closed(modelspace, square(0, 0))
        block = modelspace.doc.blocks.new("NOTE")
        block.add_text("A")  # layer 0: that of the reference
        block.add_mtext("B", dxfattribs=ON_CLEAR)
        modelspace.add_blockref("NOTE", (0, 0), dxfattribs=ON_CLEAR)
        modelspace.add_blockref("NOTE", (90, 0), dxfattribs=ON_CLEAR | {"column_count": 3, "column_spacing": 50})
        modelspace.add_text("C", dxfattribs={"layer": "FRAME"})

    layout = read_layout(drawing(tmp_path / "x.dxf", draw))
    assert count_texts(layout, layout.find_layer(find_layer(layout))) == 8


def test_pictures_are_among_the_kinds_that_are_listed(tmp_path):
    with pytest.raises(SourceError, match=r"MF308 .*\.dxf .*\.gbr .*\.png .*\.tif"):
        read_layout(tmp_path / "x.txt")


def entities_text(*entities):
    header = "  0\nSECTION\n  2\nHEADER\n  9\n$ACADVER\n  1\nAC1009\n  0\nENDSEC"
    return "\n".join((header, "  0\nSECTION\n  2\nENTITIES", *entities, "  0\nENDSEC\n  0\nEOF\n"))


def test_layers_by_the_ten_thousand_are_refused_before_klayout_compares_them(tmp_path):
    corners = " 10\n0\n 20\n0\n 10\n1\n 20\n0\n 10\n0\n 20\n1"
    path = tmp_path / "names.dxf"
    path.write_text(entities_text(*(f"  0\nLWPOLYLINE\n  8\nL{k}\n 90\n3\n 70\n1\n{corners}" for k in range(20_000))))
    start = time.process_time()
    with pytest.raises(SourceError, match=r"MF313.* layers"):
        read_layout(path)
    assert time.process_time() - start < 2


def test_a_long_run_of_blanks_is_read_once(tmp_path):
    path = tmp_path / "blanks.dxf"
    path.write_text(entities_text(*["  0\nX" + " " * 30_000 + "Y"] * 10))
    start = time.process_time()
    with pytest.raises(SourceError, match="MF3"):
        read_layout(path)
    assert time.process_time() - start < 1


@pytest.mark.parametrize("end", ["0\nENDSEC\n0\nEOF\n", "0\nEOF\n"])
@pytest.mark.parametrize("line", ["\n", "\r\n"])
def test_plain_references_to_one_block_are_one_entity(end, line):
    plain = "0\nINSERT\n5\n{0}\n8\nCLEAR\n2\nPART\n10\n{0}.5\n20\n-{0}\n30\n0.0\n"
    scaled = "0\nINSERT\n8\nCLEAR\n2\nPART\n10\n9\n20\n9\n41\n2\n"
    text = "0\nSECTION\n2\nENTITIES\n" + "".join(map(plain.format, (1, 2, 3))) + scaled + plain.format(4) + end
    found = [entity for entity in entities(text.replace("\n", line).encode()) if entity.kind == "INSERT"]
    told = [(entity.number(10), entity.number(20), list(entity.copies), entity.number(41, 1.0)) for entity in found]
    assert told == [(1.5, -1.0, [2.5, -2.0, 3.5, -3.0], 1.0), (9.0, 9.0, [], 2.0), (4.5, -4.0, [], 1.0)]
