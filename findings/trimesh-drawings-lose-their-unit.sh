#!/usr/bin/env bash
# trimesh reads the unit of a DXF and does not write it; of an SVG it reads neither the size nor the view box.
# 
# Versions: trimesh 5.2.0, ezdxf 1.4.5.
# Guess: `path.units` goes into $INSUNITS, from which it was read, and an SVG of 10 mm over 100 units is read as 10 mm.
# Seen: a drawing in micrometres, read and exported again, has no $INSUNITS, and trimesh itself then says
# nanometers (inches where $INSUNITS is 0); a square of 2 mm in an SVG is 20 units wide.
# Matters to: whoever passes outlines of a mask through trimesh to a meshing tool.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
python3 -m venv own
own/bin/pip install --quiet --disable-pip-version-check trimesh==5.2.0 ezdxf==1.4.5 numpy==2.4.6 networkx==3.6.1 scipy==1.17.1 shapely==2.2.0 lxml==6.1.3 svg.path==7.1 rtree==1.4.1
own/bin/python - <<'END'
import ezdxf
import trimesh

drawing = ezdxf.new("R2010", units=13)
drawing.modelspace().add_lwpolyline([(0, 0), (100, 0), (100, 50), (0, 50)], close=True)
drawing.saveas("in.dxf")
path = trimesh.load_path("in.dxf")
path.export("out.dxf")
written = ezdxf.readfile("out.dxf")
print("read:", path.units, "written $INSUNITS:", written.header.get("$INSUNITS"), "read again:", trimesh.load_path("out.dxf").units)
assert path.units == "microns" and written.header.get("$INSUNITS") is None and trimesh.load_path("out.dxf").units == "nanometers"
with open("in.svg", "w") as file:
    file.write('<svg xmlns="http://www.w3.org/2000/svg" width="10mm" height="10mm" viewBox="0 0 100 100">')
    file.write('<g transform="scale(2)"><path d="M 0 0 L 10 0 L 10 10 L 0 10 Z"/></g></svg>')
page = trimesh.load_path("in.svg")
print("SVG of 2 mm:", page.extents, page.units)
assert list(page.extents) == [20, 20] and page.units is None
END
