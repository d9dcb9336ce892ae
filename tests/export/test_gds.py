from __future__ import annotations

import struct

import pytest
from klayout import db

from maskfab.export.gds import write_gdsii, write_oasis
from maskfab.geometry.region import plate_layout, region
from maskfab.model import CLEAR


def records(data):
    """Type and payload of every GDSII record."""
    place = 0
    while place < len(data):
        length, kind = struct.unpack_from(">HH", data, place)
        yield kind >> 8, data[place + 4 : place + length]
        place += length


@pytest.mark.parametrize(("write", "name"), [(write_gdsii, "x.gds"), (write_oasis, "x.oas")])
def test_two_writes_are_byte_identical(small_plate, tmp_path, write, name):
    write(plate_layout(small_plate), tmp_path / name)
    write(plate_layout(small_plate), tmp_path / f"again_{name}")
    assert (tmp_path / name).read_bytes() == (tmp_path / f"again_{name}").read_bytes()


def test_gdsii_has_no_time_stamps_and_ends_with_endlib(small_plate, tmp_path):
    path = tmp_path / "x.gds"
    write_gdsii(plate_layout(small_plate), path)
    found = list(records(path.read_bytes()))
    stamps = [payload for kind, payload in found if kind in (0x01, 0x05)]
    assert len(stamps) > 5
    assert all(not any(payload) for payload in stamps)
    assert found[-1] == (0x04, b"")


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
