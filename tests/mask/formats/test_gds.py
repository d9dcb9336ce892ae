from __future__ import annotations

import struct

import gdstk
import pytest
from klayout import db

from maskfab.base.model import CLEAR
from maskfab.mask.formats.gdsii import write_gdsii
from maskfab.mask.layout import plate_layout, region


def records(data):
    """Type and payload of every GDSII record."""
    place = 0
    while place < len(data):
        length, kind = struct.unpack_from(">HH", data, place)
        yield kind >> 8, data[place + 4 : place + length]
        place += length


def test_gdsii_has_no_time_stamps_and_ends_with_endlib(small_plate, tmp_path):
    path = tmp_path / "x.gds"
    write_gdsii(plate_layout(small_plate), path)
    found = list(records(path.read_bytes()))
    stamps = [payload for kind, payload in found if kind in (0x01, 0x05)]
    assert len(stamps) > 5
    assert all(not any(payload) for payload in stamps)
    assert found[-1] == (0x04, b"")


def named(path):
    return [payload.rstrip(b"\0").decode() for kind, payload in records(path.read_bytes()) if kind == 0x06]


def test_cells_of_gdsii_are_sorted_and_both_readers_find_the_same(small_plate, tmp_path):
    path, layout = tmp_path / "x.gds", plate_layout(small_plate)
    write_gdsii(layout, path)
    names = named(path)
    assert names == sorted(names)
    assert len(names) == layout.cells() > 10
    places = {kind: [] for kind in (0x12, 0x06)}
    for kind, payload in records(path.read_bytes()):
        if kind in places:
            places[kind].append(payload)
    first = {name: number for number, name in enumerate(places[0x06])}
    assert len(first) == len(names)
    assert set(places[0x12]) < set(first)  # every reference is of a cell that there is
    again = db.Layout()
    again.read(str(path))
    library = gdstk.read_gds(str(path))
    assert [cell.name for cell in library.top_level()] == [again.top_cell().name] == [layout.top_cell().name]
    assert sorted(cell.name for cell in library.cells) == sorted(cell.name for cell in again.each_cell()) == names
    assert (region(again, CLEAR) ^ region(layout, CLEAR)).is_empty()
    clear = [polygon.area() for polygon in library.top_level()[0].get_polygons(layer=1, datatype=0)]
    assert sum(clear) == pytest.approx(region(layout, CLEAR).area() / 1e6)


def test_coordinates_that_look_like_a_border_of_cells_leave_the_stream_whole(tmp_path):
    """0x00040700, 0x001c0502 as x and y of a vertex are the bytes between two structures."""
    layout = db.Layout()
    layout.dbu = 0.001
    child, top = layout.create_cell("A"), layout.create_cell("TOP")
    x, y = 0x00040700, 0x001C0502
    child.shapes(layout.layer(1, 0)).insert(db.Polygon([db.Point(0, 0), db.Point(x, y), db.Point(2 * x, 0)]))
    top.insert(db.CellInstArray(child.cell_index(), db.Trans()))
    path = tmp_path / "x.gds"
    write_gdsii(layout, path)
    assert path.read_bytes().count(bytes.fromhex("00040700001c0502")) == 2
    again = db.Layout()
    again.read(str(path))
    assert (region(again, CLEAR) ^ region(layout, CLEAR)).is_empty()
    assert sorted(named(path)) == ["A", "TOP"]


def test_gdsii_keeps_references_and_arrays(small_plate, tmp_path):
    path = tmp_path / "x.gds"
    write_gdsii(plate_layout(small_plate), path)
    kinds = [kind for kind, _ in records(path.read_bytes())]
    assert kinds.count(0x0B) == 1  # AREF: the periodic die
    assert kinds.count(0x0A) == 2 * 20 + 3 + 3  # SREF: cells of two random dies, dies, marks


def test_long_outlines_are_split_to_fit_a_record(tmp_path):
    layout = db.Layout()
    layout.dbu = 0.001
    top = layout.create_cell("TOP")
    teeth = [(4 * k + dx, y) for k in range(3000) for dx, y in ((0, 9), (2, 9), (2, 5), (4, 5))]
    comb = [db.Point(x, y) for x, y in [(0, 0), *teeth, (12_000, 0)]]
    top.shapes(layout.layer(1, 0)).insert(db.Polygon(comb))
    path = tmp_path / "x.gds"
    write_gdsii(layout, path)
    longest = max(len(payload) for kind, payload in records(path.read_bytes()) if kind == 0x10)
    assert longest <= 4095 * 8
    again = db.Layout()
    again.read(str(path))
    assert (region(again, CLEAR) ^ region(layout, CLEAR)).is_empty()
