#!/usr/bin/env bash
# A GDSII path of one point is a dot for klayout and nothing for gdstk.
# 
# Versions: klayout 0.30.12, gdstk 1.0.2.
# Guess: both draw its ends: a square of the width (pathtype 2), or a round dot (pathtype 1).
# Seen: klayout draws 64 and 50.4 um2 for a width of 8 um and warns; gdstk keeps a path without polygons, and Python sees no
# warning. Of pathtype 0, which has no ends, nothing is drawn by both.
# Matters to: dots placed as paths, as some converters of Gerber flashes write them.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
python3 -m venv own
own/bin/pip install --quiet --disable-pip-version-check klayout==0.30.12 gdstk==1.0.2 numpy==2.4.6
own/bin/python - <<'END'
import struct

import gdstk
from klayout import db


def record(kind, data_type, *numbers, code="i", data=b""):
    body = struct.pack(f">{len(numbers)}{code}", *numbers) + data
    return struct.pack(">HBB", len(body) + 4, kind, data_type) + body


times = (2026, 1, 1, 0, 0, 0) * 2
units = bytes.fromhex("3e4189374bc6a7f0") + bytes.fromhex("3944b82fa09b5a54")  # 1e-3 and 1e-9
head = record(0, 2, 600, code="h") + record(1, 2, *times, code="h") + record(2, 6, data=b"LIBR")
head += record(3, 5, data=units) + record(5, 2, *times, code="h") + record(6, 6, data=b"TOPC")

for pathtype, dot in ((0, 0.0), (1, 50.43), (2, 64.0)):
    path = record(9, 0) + record(0x0D, 2, 1, code="h") + record(0x0E, 2, 0, code="h")
    path += record(0x21, 2, pathtype, code="h") + record(0x0F, 3, 8000) + record(0x10, 3, 0, 0) + record(0x11, 0)
    with open("dot.gds", "wb") as file:
        file.write(head + path + record(7, 0) + record(4, 0))
    options, layout = db.LoadLayoutOptions(), db.Layout()
    options.warn_level = 0
    layout.read("dot.gds", options)
    one = db.Region(layout.top_cell().begin_shapes_rec(layout.layer(1, 0))).merged().area() * layout.dbu**2
    cell = gdstk.read_gds("dot.gds").cells[0]
    print(f"pathtype {pathtype}: klayout {one:.2f} um2, gdstk {len(cell.get_polygons())} polygons, {len(cell.paths)} paths")
    assert abs(one - dot) < 0.01 and not cell.get_polygons()
END
