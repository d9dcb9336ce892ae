#!/usr/bin/env bash
# klayout takes some names of layers in a DXF for numbers, and whether it does depends on the other layers.
# 
# Versions: klayout 0.30.12, ezdxf 1.4.5 (writes the drawing).
# Guess: a DXF has names alone, and keeps them.
# Seen: L3, 007, 8D1 and 3.1 are layers 3/0, 7/0, 8/1 and 3/1 without a name, and L1 alone is 1/0; with a layer 001 beside
# it, that is 1/0, and L1 and 1 keep their names. L, M1, LAYER1 and 12A always do.
# Matters to: who asks for a layer of a numbered drawing by its name: it is there in one file and not in the next.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
python3 -m venv own
own/bin/pip install --quiet --disable-pip-version-check klayout==0.30.12 ezdxf==1.4.5
own/bin/python - <<'END'
import ezdxf
from klayout import db

def layers(*names):
    drawing = ezdxf.new("R2010", units=13)
    for place, name in enumerate(names):
        corners = [(20 * place, 0), (20 * place + 10, 0), (20 * place + 10, 10), (20 * place, 10)]
        drawing.modelspace().add_lwpolyline(corners, close=True, dxfattribs={"layer": name})
    drawing.saveas("names.dxf")
    layout, seen = db.Layout(), {}
    layout.read("names.dxf")
    for index in layout.layer_indexes():
        info = layout.get_info(index)
        for polygon in db.Region(layout.top_cell().begin_shapes_rec(index)).each():
            seen[names[polygon.bbox().left // 20_000]] = info.name or f"{info.layer}/{info.datatype}"
    return seen


for names, seen in (
    (("L3", "007", "8D1", "3.1", "L1"), ("3/0", "7/0", "8/1", "3/1", "1/0")),
    (("L1", "1", "001"), ("L1", "1", "1/0")),
    (("L", "M1", "LAYER1", "12A"), ("L", "M1", "LAYER1", "12A")),
):
    found = layers(*names)
    print(found)
    assert tuple(found[name] for name in names) == seen
END
