#!/usr/bin/env bash
# One circle of an OASIS file has three areas, two of them of one reader.
# 
# Versions: gdstk 1.0.2 (writes and reads), klayout 0.30.12 (reads).
# Guess: klayout makes a polygon of it, within a nanometre or so of gdstk's.
# Seen: klayout makes a path of one point with round ends. Its merged polygon has 32 corners and .32 % too much area; the
# shape itself says an area of 8584 um2, 9.3 % too much. gdstk gives 498 corners, .003 % too little.
# gdstk writes polygons as CIRCLE only when asked (`circle_tolerance`).
# Matters to: round openings and round pads in OASIS, and any sum of `Shape.area` over shapes.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
python3 -m venv own
own/bin/pip install --quiet --disable-pip-version-check klayout==0.30.12 gdstk==1.0.2 numpy==2.4.6
own/bin/python - <<'END'
import math

import gdstk
from klayout import db

library = gdstk.Library(unit=1e-6, precision=1e-9)
library.new_cell("TOP").add(gdstk.ellipse((0, 0), 50, tolerance=0.001, layer=1))
library.write_oas("circle.oas", circle_tolerance=0.01)
layout = db.Layout()
layout.read("circle.oas")
layer = layout.layer(1, 0)
(shape,) = layout.top_cell().shapes(layer).each()
merged = db.Region(layout.top_cell().begin_shapes_rec(layer)).merged().area() * layout.dbu**2
(polygon,) = gdstk.read_oas("circle.oas").cells[0].get_polygons()
exact = math.pi * 50**2
print(f"exact {exact:.1f}, klayout merged {merged:.1f}, klayout shape {shape.area() * layout.dbu**2:.1f},", end=" ")
print(f"gdstk {polygon.area():.1f} um2; klayout's shape: {shape}")
assert shape.is_path() and shape.round_path and len(list(shape.each_point())) == 1
assert round(merged, 1) == 7879.3 and round(shape.area() * layout.dbu**2, 1) == 8584.0 and round(polygon.area(), 1) == 7853.8
END
