"""A mask file as each of its readers has it, told and drawn; what they do not read alike fails."""

from __future__ import annotations

import json

import ezdxf
import gdstk
import numpy as np
import pytest
from klayout import db

import maskfab as mf
from maskfab.api.verifying import Readings
from maskfab.base.errors import JobError, SourceError
from maskfab.cli.program import run_command_line
from maskfab.mask.formats.table import readers_of


@pytest.fixture
def boxes(tmp_path):
    """Two boxes in a cell that is placed twice, 3000 um2 in all, and a text."""
    layout = db.Layout()
    cell, top = layout.create_cell("PIXEL"), layout.create_cell("TOP")
    cell.shapes(layout.layer(1, 0)).insert(db.Box(0, 0, 20_000, 50_000))
    cell.shapes(layout.layer(1, 0)).insert(db.Box(20_000, 0, 30_000, 50_000))
    for x in (0, 100_000):
        top.insert(db.CellInstArray(cell.cell_index(), db.Trans(x, 0)))
    top.shapes(layout.layer(2, 0)).insert(db.Text("a text draws nothing", db.Trans()))
    path = tmp_path / "boxes.gds"
    layout.write(str(path))
    return path


def test_every_reader_tells_shapes_area_and_box_of_a_layer(boxes):
    found = mf.verify(boxes, readers=True)
    assert found.passed
    assert [one.reader for one in found.readers] == ["klayout", "gdstk", "maskfab"]
    for one in found.readers:
        (told,) = one.layers
        assert (told.cell, told.layer, told.shapes) == ("TOP", "1/0", 4)
        assert (told.area_um2, told.box_um) == (3000.0, (0.0, 0.0, 130.0, 50.0))
    assert f"read alike by klayout {db.__version__}, gdstk {gdstk.__version__}" in str(found)
    assert found.to_dict()["unlike"] == []


def whole(number):
    """An unsigned integer of OASIS, seven bits to a byte, the lowest first."""
    parts = []
    while number >= 128:
        parts.append(number & 127 | 128)
        number >>= 7
    return bytes([*parts, number])


@pytest.fixture
def unlike(tmp_path):
    """An OASIS of which klayout and gdstk draw other shapes: a square trapezoid between two rectangles says its width
    alone, and the second rectangle takes its height from the figure before."""
    start = whole(1) + whole(3) + b"1.0" + whole(0) + whole(1000) + whole(0) + whole(0) * 12

    def rectangle(x, *, sides=()):
        bits = 0b00011011 | (0b01100000 if sides else 0)
        return whole(20) + bytes([bits]) + whole(1) + whole(0) + b"".join(map(whole, sides)) + whole(2 * x) + whole(0)

    square = whole(26) + bytes([0b11011011]) + whole(1) + whole(0) + whole(25) + whole(100_000)
    square += whole(2 * 200_000) + whole(0)
    body = whole(14) + whole(3) + b"TOP" + rectangle(0, sides=(100_000, 40_000)) + square + rectangle(400_000)
    path = tmp_path / "unlike.oas"
    end = whole(2) + whole(252) + b"\0" * 252 + whole(0)
    path.write_bytes(b"%SEMI-OASIS\r\n" + start + body + end)
    return path


def test_what_readers_draw_otherwise_fails_and_is_told_with_its_place(unlike, capsys):
    found = mf.verify(unlike, readers=True)
    assert not found.passed
    assert "MF316" in found.readers[-1].refused
    (view,) = found.views
    assert (view.unlike_um2, view.unlike_um) == (6000.0, (400.0, 40.0, 500.0, 100.0))
    # Areas of the picture are those of the shapes: a view has squares of 1042 nm.
    left, bottom, right, top = view.box_um
    square_um2 = (right - left) * (top - bottom) / view.drawn.size
    assert view.unlike.sum() * square_um2 == pytest.approx(6000, rel=1e-12)
    assert run_command_line(["verify", str(unlike), "--readers", "--json"]) == 1
    assert json.loads(capsys.readouterr().out)["verdict"] == "fail"


def test_the_picture_shows_where_and_never_replaces_another_unasked(unlike, tmp_path):
    found = mf.verify(unlike, readers=True)
    (path,) = found.save(tmp_path / "read.svg")
    drawn = path.read_text(encoding="utf-8")
    assert "6000 um² otherwise" in drawn
    assert "orange: otherwise by klayout" in drawn
    for code, name in (("MF402", "read.svg"), ("MF430", "read.jpg")):
        with pytest.raises(mf.MaskfabError, match=code):
            found.save(tmp_path / name)
    assert np.asarray(found.plot().figure.axes[0].images[0].get_array()).shape[2] == 3


@pytest.mark.parametrize(
    ("options", "code"), [({"die": "A"}, "MF105"), ({"tone": "dark"}, "MF105"), ({"again": True}, "MF105")]
)
def test_what_says_nothing_of_readers_is_refused(boxes, options, code):
    with pytest.raises(JobError, match=code):
        mf.verify(boxes, readers=True, **options)


def test_what_is_no_layout_is_refused(tmp_path):
    (tmp_path / "notes.txt").write_text("no layout")
    with pytest.raises(SourceError, match="MF308"):
        mf.verify(tmp_path / "notes.txt", readers=True)
    with pytest.raises(SourceError, match="MF301"):
        mf.verify(tmp_path / "absent.gds", readers=True)


def test_a_lone_reader_is_said_to_be_alone(boxes, tmp_path):
    layout = db.Layout()
    layout.read(str(boxes))
    layout.write(str(tmp_path / "boxes.cif"))
    found = mf.verify(tmp_path / "boxes.cif", readers=True)
    assert isinstance(found, Readings)
    assert "alone" in str(found).splitlines()[0]


def test_a_drawing_is_read_by_both_its_readers(tmp_path):
    document = ezdxf.new(units=13)
    document.modelspace().add_lwpolyline([(0, 0), (4, 0), (4, 3)], close=True, dxfattribs={"layer": "CLEAR"})
    document.saveas(tmp_path / "plain.dxf")
    found = mf.verify(tmp_path / "plain.dxf", readers=True)
    assert isinstance(found, Readings)
    assert found.passed
    assert [one.reader for one in found.readers] == ["klayout", "ezdxf", "maskfab"]
    assert [one.layers[0].area_um2 for one in found.readers] == [6, 6, 6]
    assert readers_of(tmp_path / "plain.dxf") == "by klayout"  # as nothing holds both against each other
