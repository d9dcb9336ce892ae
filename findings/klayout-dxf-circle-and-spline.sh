#!/usr/bin/env bash
# klayout draws arcs of a DXF outside the curve and splines inside it: the same circle, written both ways, differs.
# 
# Versions: klayout 0.30.12, ezdxf 1.4.5 (writes the drawings).
# Guess: both become chords between points of the curve.
# Seen: bulges and arcs are chords that touch the curve (+.032 % of area at 100 points), a rational spline of the exact
# circle is chords between its points (-.041 %); `dxf_circle_accuracy` of .1 um moves them further apart, to .29 %.
# Matters to: whoever compares two exports of one drawing, one with splines; the XOR is a ring all round.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
python3 -m venv own
own/bin/pip install --quiet --disable-pip-version-check klayout==0.30.12 ezdxf==1.4.5
own/bin/python - <<'END'
import math

import ezdxf
from klayout import db

HALF = math.sqrt(0.5)
ROUND = [(50, 0), (50, 50), (0, 50), (-50, 50), (-50, 0), (-50, -50), (0, -50), (50, -50), (50, 0)]


def area_um2(kind, accuracy):
    drawing = ezdxf.new("R2010", units=13)
    if kind == "bulges":
        drawing.modelspace().add_lwpolyline([(0, 0, 1), (100, 0, 1)], format="xyb", close=True, dxfattribs={"layer": "CLEAR"})
    else:
        knots = [0, 0, 0, 1, 1, 2, 2, 3, 3, 4, 4, 4]
        drawing.modelspace().add_rational_spline(ROUND, [1, HALF] * 4 + [1], 2, knots, {"layer": "CLEAR"})
    drawing.saveas("round.dxf")
    options, layout = db.LoadLayoutOptions(), db.Layout()
    options.dxf_polyline_mode, options.dxf_circle_accuracy = 3, accuracy
    layout.read("round.dxf", options)
    return db.Region(layout.top_cell().begin_shapes_rec(layout.layer("CLEAR"))).merged().area() * layout.dbu**2


exact = math.pi * 50**2
for accuracy, seen in ((0.0, (0.00032, -0.00041)), (0.1, (0.00132, -0.00162))):
    for kind, share in zip(("bulges", "spline"), seen):
        area = area_um2(kind, accuracy)
        print(f"accuracy {accuracy} um, {kind}: {area:.2f} um2, {area / exact - 1:+.3%}")
        assert abs(area / exact - 1 - share) < 2e-5
END
