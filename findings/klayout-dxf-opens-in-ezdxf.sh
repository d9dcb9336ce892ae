#!/usr/bin/env bash
# Two of five ways in which klayout writes polygons to DXF cannot be opened by ezdxf, and none states a unit.
# 
# Versions: klayout 0.30.12, ezdxf 1.4.5.
# Guess: every `dxf_polygon_mode` gives a drawing that a second reader takes, with $INSUNITS for micrometres.
# Seen: the header is R12 (AC1009) in all; modes 1 (LWPOLYLINE) and 3 (HATCH) hold entities that R12 has not, without
# their subclass marks, and ezdxf raises; mode 4 writes single LINEs, which klayout's own polyline mode 2 reads as nothing.
# $INSUNITS is absent.
# Matters to: whoever checks a drawing from klayout with another reader, or opens it where 1 is taken for 1 mm.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
python3 -m venv own
own/bin/pip install --quiet --disable-pip-version-check klayout==0.30.12 ezdxf==1.4.5
own/bin/python - <<'END'
import ezdxf
from ezdxf.lldxf.const import DXFStructureError
from klayout import db

layout = db.Layout()
layer = layout.layer(db.LayerInfo("CLEAR"))
layout.create_cell("TOP").shapes(layer).insert(db.Box(0, 0, 100_000, 50_000))
for mode, expected in enumerate(("POLYLINE", DXFStructureError, "SOLID", IndexError, "LINE")):
    options = db.SaveLayoutOptions()
    options.format, options.dxf_polygon_mode = "DXF", mode
    layout.write("box.dxf", options)
    try:
        drawing = ezdxf.readfile("box.dxf")
        seen = next(iter(drawing.modelspace())).dxftype()
        assert drawing.units == 0 and drawing.dxfversion == "AC1009"
    except (DXFStructureError, IndexError) as error:
        seen = type(error)
    loading, back = db.LoadLayoutOptions(), db.Layout()
    loading.dxf_polyline_mode = 2
    back.read("box.dxf", loading)
    area = sum(db.Region(back.top_cell().begin_shapes_rec(k)).merged().area() for k in back.layer_indexes()) * back.dbu**2
    print(f"polygon mode {mode}: ezdxf finds {seen}; klayout's polyline mode 2 reads {area:g} um2 of 5000")
    assert seen == expected and area == (0 if mode == 4 else 5000)
END
