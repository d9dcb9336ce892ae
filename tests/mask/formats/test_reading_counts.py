"""Very many layers, cells and blocks are counted before a library reads them that takes long for each."""

from __future__ import annotations

import struct
import time

import pytest

from maskfab.base.errors import SourceError
from maskfab.mask.formats import gdsii as record_counts
from maskfab.mask.formats.table import read_layout
from maskfab.mask.layout import MOST_CELLS, MOST_LAYERS


def record(kind, form, data=b""):
    return struct.pack(">HBB", 4 + len(data), kind, form) + data


def box(layer, datatype=0, corner=8):
    numbers = record(0x0D, 2, struct.pack(">H", layer)) + record(0x0E, 2, struct.pack(">H", datatype))
    points = struct.pack(">10i", 0, 0, 0, 8, corner, 8, corner, 0, 0, 0)
    return record(8, 0) + numbers + record(0x10, 3, points) + record(0x11, 0)


def cell(name, body):
    return record(5, 2, bytes(24)) + record(6, 6, name.encode()) + body + record(7, 0)


def gdsii(path, *cells):
    nanometres = bytes.fromhex("3e4189374bc6a7f0") + bytes.fromhex("3944b82fa09b5a54")
    head = record(0, 2, b"\x02\x58") + record(1, 2, bytes(24)) + record(2, 6, b"LI") + record(3, 5, nanometres)
    path.write_bytes(head + b"".join(cells) + record(4, 0))
    return path


def refused_at_once(path):
    start = time.process_time()
    with pytest.raises(SourceError, match="MF313") as caught:
        read_layout(path)
    assert time.process_time() - start < 1.5
    return caught.value.what


def test_a_gdsii_of_very_many_layers_is_refused_before_klayout_reads_it(tmp_path):
    path = gdsii(tmp_path / "many.gds", cell("TO", b"".join(box(k, k % 5) for k in range(20_000))))
    assert "layers" in refused_at_once(path)


def test_a_gdsii_of_very_many_cells_is_refused_before_klayout_reads_it(tmp_path):
    path = gdsii(tmp_path / "many.gds", *(cell(f"C{k:05d}", box(1)) for k in range(2 * MOST_CELLS)))
    assert "cells" in refused_at_once(path)


@pytest.mark.parametrize("end", ["\n", "\r\n"])
def test_a_dxf_of_very_many_blocks_is_refused_before_klayout_reads_it(tmp_path, end):
    blocks = [line for k in range(2 * MOST_CELLS) for line in ("  0", "BLOCK", "2", f"B{k}", "  0", "ENDBLK")]
    rows = ["0", "SECTION", "2", "BLOCKS", *blocks, "0", "ENDSEC", "0", "EOF", ""]
    path = tmp_path / "many.dxf"
    path.write_bytes(end.join(rows).encode())
    assert "cells" in refused_at_once(path)


def test_as_many_layers_as_there_may_be_are_no_fault(tmp_path):
    most = cell("TO", b"".join(box(k // 2, k % 2) for k in range(MOST_LAYERS)) * 2)
    record_counts.refuse_many_in_gdsii(gdsii(tmp_path / "most.gds", most))
    with pytest.raises(SourceError, match="layers"):
        record_counts.refuse_many_in_gdsii(gdsii(tmp_path / "more.gds", most, cell("MO", box(MOST_LAYERS))))


def test_coordinates_that_look_like_the_start_of_a_cell_are_no_cells(tmp_path):
    like = int.from_bytes(b"\x00\x1c\x05\x02", "big")
    path = gdsii(tmp_path / "like.gds", cell("TO", box(1, 0, like) * (MOST_CELLS + 1)))
    record_counts.refuse_many_in_gdsii(path)
