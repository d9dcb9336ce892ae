from __future__ import annotations

import logging
from dataclasses import replace

import ezdxf
import pytest
from ezdxf import bbox, recover
from ezdxf.entitydb import EntityDB
from klayout import db

from maskfab.base.model import CLEAR, LAYERS, OUTLINE, Note
from maskfab.mask.figures import PolygonOptions, draw
from maskfab.mask.formats.dxf_writer import write_dxf
from maskfab.mask.formats.format import DrawingStyle
from maskfab.mask.formats.table import read_layout
from maskfab.mask.layout import plate_layout, plate_names, region

pytestmark = pytest.mark.parametrize("version", ["R12", "R2010"])


@pytest.fixture
def path(small_plate, tmp_path, version):
    path = tmp_path / "x.dxf"
    write_dxf(small_plate, path, version, ["made by a test", "two\nlines, 168 µm"])
    return path


def test_audit_finds_nothing(path, version, caplog):
    drawing = ezdxf.readfile(path)
    _, recovered = recover.readfile(path)
    for audit in (drawing.audit(), recovered):
        assert not audit.errors
        assert not audit.fixes
    assert [record for record in caplog.records if record.levelno >= logging.WARNING] == []
    assert drawing.dxfversion == {"R12": "AC1009", "R2010": "AC1024"}[version]


def test_options_of_ezdxf_are_left_as_they_were(path, version):
    assert ezdxf.options.write_fixed_meta_data_for_testing is False


def test_geometry_is_the_layout(path, small_plate, version):
    read, design = read_layout(path), plate_layout(small_plate)
    for layer in (CLEAR, OUTLINE):
        assert (region(read, layer) ^ region(design, layer)).is_empty()


def test_units_are_named(path, version):
    drawing = ezdxf.readfile(path)
    assert "micrometre" in path.read_text(encoding="cp1252" if version == "R12" else "utf-8").split("SECTION")[0]
    notes = [text.dxf.text for text in drawing.modelspace().query("TEXT")]
    assert any("MICROMETRE" in note for note in notes)
    assert "job 0123abcd" in notes
    assert drawing.units == (13 if version == "R2010" else 0)


def test_a_viewer_zooms_to_the_blank(path, version):
    drawing = ezdxf.readfile(path)
    assert tuple(drawing.header["$EXTMIN"])[:2] == (-5000.0, -5000.0)
    assert tuple(drawing.header["$EXTMAX"])[:2] == (5000.0, 5000.0)


def test_a_note_of_two_lines_stays_one_group(small_plate, tmp_path, version):
    plate = replace(small_plate, notes=(Note("one\n  0\nEOF\ntwo", (0, 0)),))
    path = tmp_path / "note.dxf"
    write_dxf(plate, path, version)
    assert "one 0 EOF two" in [text.dxf.text for text in ezdxf.readfile(path).modelspace().query("TEXT")]


def test_comments_come_first_one_line_each(path, version):
    lines = path.read_bytes().decode("cp1252" if version == "R12" else "utf-8").split("\n")
    assert lines[:6:2] == ["999"] * 3
    assert lines[3] == "made by a test"
    assert lines[5] == "two lines, 168 µm"
    assert lines[6:8] == ["  0", "SECTION"]


def test_no_reference_is_mirrored_turned_or_scaled(path, version):
    drawing = ezdxf.readfile(path)
    inserts = [insert for block in drawing.blocks for insert in block.query("INSERT")]
    assert len(inserts) == 3 + 1 + 2 * 20
    for insert in inserts:
        assert insert.dxf.get("rotation", 0) == 0
        assert (insert.dxf.get("xscale", 1), insert.dxf.get("yscale", 1)) == (1, 1)
        assert tuple(insert.dxf.get("extrusion", (0, 0, 1))) == (0, 0, 1)


def test_blocks_have_the_names_of_the_cells(path, small_plate, version):
    names = plate_names(small_plate)
    blocks = {block.name for block in ezdxf.readfile(path).blocks if not block.name.startswith("*")}
    assert blocks == {*names.dies, *names.units.values()}


@pytest.mark.parametrize("hierarchy", ["cells", "flat"])
def test_handles_are_unique_and_below_the_seed(small_plate, tmp_path, version, hierarchy):
    write_dxf(draw(small_plate, PolygonOptions(hierarchy=hierarchy)), tmp_path / "x.dxf", version)
    lines = (tmp_path / "x.dxf").read_bytes().split(b"\n")
    pairs = list(zip(lines[0::2], lines[1::2], strict=False))
    values = [value for _, value in pairs]
    seed_at = values.index(b"$HANDSEED") + 1
    handles = [int(value, 16) for code, value in pairs[seed_at + 1 :] if code == b"  5" and value]
    assert len(set(handles)) == len(handles)
    assert max(handles) < int(values[seed_at], 16)
    assert values.count(b"INSERT") == (3 + 1 + 2 * 20 if hierarchy == "cells" else 0)


def test_outlines_are_closed_and_without_width(path, version):
    drawing = ezdxf.readfile(path)
    kind = {"R12": "POLYLINE", "R2010": "LWPOLYLINE"}[version]
    outlines = [line for block in drawing.blocks for line in block.query(kind)]
    assert len(outlines) > 20
    for outline in outlines:
        assert outline.is_closed
        assert not outline.has_width
        assert not outline.has_arc


def test_layers_are_those_with_something_on_them(path, version):
    drawing = ezdxf.readfile(path)
    used = {entity.dxf.layer for block in drawing.blocks for entity in block if block.name[0] not in "*$_"}
    used |= {entity.dxf.layer for entity in drawing.modelspace()}
    # ezdxf adds a layer to whatever it reads.
    assert b"defpoints" not in path.read_bytes().lower()
    assert {layer.dxf.name for layer in drawing.layers} == {"0", "Defpoints", *used}
    assert used <= {layer.name for layer in LAYERS}


def test_a_drawing_in_millimetres_is_the_same_plate(small_plate, tmp_path, version):
    """Every length a thousandth, the unit said wherever the version can, and read back to the nanometre."""
    drawings, layouts = [], []
    for unit in ("um", "mm"):
        path = tmp_path / f"{unit}.dxf"
        write_dxf(small_plate, path, version, style=DrawingStyle(unit=unit))
        drawings.append(ezdxf.readfile(path))
        layouts.append(read_layout(path))
    first, second = (region(layout, CLEAR) for layout in layouts)
    assert (first ^ second).is_empty()
    assert not first.is_empty()
    for one, other in zip(*(drawing.modelspace().query("INSERT TEXT") for drawing in drawings), strict=True):
        assert one.dxf.insert.isclose(other.dxf.insert * 1000)
    assert drawings[1].modelspace().query("TEXT")[0].dxf.text == "UNITS: 1 DRAWING UNIT = 1 MILLIMETRE"
    if version == "R2010":
        assert [drawing.header["$INSUNITS"] for drawing in drawings] == [13, 4]


def test_a_frame_holds_everything_and_the_header_says_so(small_plate, tmp_path, version):
    half = small_plate.writable_nm // 2
    path = tmp_path / "x.dxf"
    write_dxf(small_plate, path, version, style=DrawingStyle(frame_nm=(-half, -half, half, half)))
    drawing = ezdxf.readfile(path)
    low, far = drawing.header["$EXTMIN"], drawing.header["$EXTMAX"]
    assert (low[:2], far[:2]) == ((-half / 1000,) * 2, (half / 1000,) * 2)
    box = bbox.extents(drawing.modelspace().query("TEXT[layer=='NOTE']")[:1])
    assert low[0] <= box.extmin.x < box.extmax.x <= far[0]
    assert low[1] <= box.extmin.y < box.extmax.y <= far[1]


def test_a_periodic_die_is_one_reference_with_rows_and_columns(path, version):
    (insert,) = ezdxf.readfile(path).blocks["PERIODIC"]
    assert (insert.dxf.column_count, insert.dxf.row_count) == (5, 4)
    assert insert.dxf.column_spacing == insert.dxf.row_spacing == 64.0


def test_nothing_is_lost_on_the_way_through_ezdxf(path, tmp_path, version):
    """A shop that opens and saves the file gets the same geometry."""
    saved = tmp_path / "saved.dxf"
    ezdxf.readfile(path).saveas(saved)
    before, after = read_layout(path), read_layout(saved)
    assert isinstance(after, db.Layout)
    assert (region(before, CLEAR) ^ region(after, CLEAR)).is_empty()


@pytest.mark.parametrize("backwards", [False, True])
def test_the_order_of_a_set_leaves_no_trace(path, small_plate, tmp_path, version, monkeypatch, backwards):
    """Another process may hash names otherwise, so that ezdxf meets the kinds of entities in another order."""
    kinds = EntityDB.dxf_types_in_use
    monkeypatch.setattr(EntityDB, "dxf_types_in_use", lambda self: sorted(kinds(self), reverse=backwards))
    again = tmp_path / "again.dxf"
    write_dxf(small_plate, again, version, ["made by a test", "two\nlines, 168 µm"])
    assert path.read_bytes() == again.read_bytes()
