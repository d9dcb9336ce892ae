#!/usr/bin/env bash
# gdstk writes a path with round ends as one with flat ends when the file is OASIS.
# 
# Versions: gdstk 1.0.2, klayout 0.30.12 (second reader).
# Guess: OASIS has no round ends, so the path comes as a polygon, or half a width longer, or is refused.
# Seen: it comes flat, without a word: 320 um2 in place of 370.3 for a path of 40 x 8 um. GDSII keeps the ends
# (370.2 by gdstk's chords, 370.4 by klayout's, which lie outside). `simple_path=False` writes a polygon and keeps them.
# Matters to: whoever writes both files from one library and takes them for the same mask.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
python3 -m venv own
own/bin/pip install --quiet --disable-pip-version-check klayout==0.30.12 gdstk==1.0.2 numpy==2.4.6
own/bin/python - <<'END'
import warnings

import gdstk
from klayout import db

warnings.simplefilter("error")
for simple, seen in ((True, (370.25, 320.0)), (False, (370.25, 370.25))):
    library = gdstk.Library(unit=1e-6, precision=1e-9)
    path = gdstk.FlexPath([(0, 0), (40, 0)], 8, ends="round", simple_path=simple, layer=1)
    library.new_cell("TOP").add(path)
    library.write_gds("path.gds")
    library.write_oas("path.oas")
    for name, reader, area in zip(("path.gds", "path.oas"), (gdstk.read_gds, gdstk.read_oas), seen):
        first = sum(polygon.area() for polygon in reader(name).cells[0].get_polygons())
        layout = db.Layout()
        layout.read(name)
        second = db.Region(layout.top_cell().begin_shapes_rec(layout.layer(1, 0))).merged().area() * layout.dbu**2
        print(f"simple_path {simple!s:5} {name}: gdstk {first:.2f}, klayout {second:.2f} um2")
        assert abs(first - area) < 0.2 and abs(second - area) < 0.2
END
