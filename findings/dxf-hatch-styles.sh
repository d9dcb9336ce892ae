#!/usr/bin/env bash
# Islands of a HATCH: one file, four readers, four answers.
# 
# Versions: klayout 0.30.12, ezdxf 1.4.5 (its drawing add-on and its geo add-on), trimesh 5.2.0.
# Guess: the hatch's style (normal, outermost, ignore) decides everywhere.
# Seen, for three squares within each other (100, 60 and 20 um wide): klayout reads every style as normal (6800 um2);
# ezdxf's drawing add-on follows the style (6800, 6400, 10000); its geo add-on loses the innermost island of the normal
# style (6400); trimesh raises an IndexError.
# Matters to: whoever sends filled openings with islands: a house that follows the style writes another mask.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
python3 -m venv own
own/bin/pip install --quiet --disable-pip-version-check klayout==0.30.12 ezdxf==1.4.5 trimesh==5.2.0 networkx==3.6.1 scipy==1.17.1 shapely==2.2.0 pillow==12.0.0
own/bin/python - <<'END'
import re

import ezdxf
import trimesh
from ezdxf.addons import geo
from ezdxf.addons.drawing import Frontend, RenderContext, layout, svg
from klayout import db


def square(side):
    low, high = 50 - side / 2, 50 + side / 2
    return [(low, low), (high, low), (high, high), (low, high)]


def rings_of(text):
    # Relative moves of squares: widths in millionths of the page, which is 100 um.
    return [float(width) / 1e4 for width in re.findall(r"M [\d.]+ [\d.]+ l ([\d.]+) 0", text)]


for style, klayout_um2, drawn_um2, geo_um2 in ((0, 6800, 6800, 6400), (1, 6800, 6400, 6400), (2, 6800, 10000, 10000)):
    drawing = ezdxf.new("R2010", units=13)
    hatch = drawing.modelspace().add_hatch(dxfattribs={"layer": "CLEAR"})
    hatch.dxf.hatch_style = style
    for side, flags in ((100, 1), (60, 16), (20, 0)):
        hatch.paths.add_polyline_path(square(side), is_closed=True, flags=flags)
    drawing.saveas("hatch.dxf")
    read = db.Layout()
    read.read("hatch.dxf")
    klayout = db.Region(read.top_cell().begin_shapes_rec(read.layer("CLEAR"))).merged().area() * read.dbu**2
    backend = svg.SVGBackend()
    Frontend(RenderContext(drawing), backend).draw_layout(drawing.modelspace())
    page = backend.get_string(layout.Page(0, 0, layout.Units.mm, layout.Margins.all(0)))
    drawn = sum((-1) ** k * side**2 for k, side in enumerate(rings_of(page)))
    rings = geo.proxy(hatch).__geo_interface__["coordinates"]
    sides = [max(point[0] for point in ring) - min(point[0] for point in ring) for ring in rings]
    geo_area = sum((-1) ** k * side**2 for k, side in enumerate(sides))
    try:
        said = f"{trimesh.load_path('hatch.dxf').area:.0f} um2"
    except IndexError as error:
        said = f"IndexError: {error}"
    print(f"style {style}: klayout {klayout:.0f}, drawing add-on {drawn:.0f}, geo add-on {geo_area:.0f} um2, trimesh {said}")
    assert (round(klayout), round(drawn), round(geo_area)) == (klayout_um2, drawn_um2, geo_um2)
    assert said.startswith("IndexError")
END
