#!/usr/bin/env bash
# To gdstk, the only top cell of a GDSII file that klayout saved with settings of cells is one that holds no mask.
# 
# Versions: klayout 0.30.12, gdstk 1.0.2.
# Guess: settings are kept where readers that do not know them pass over them.
# Seen: klayout writes them into a cell `$$$CONTEXT_INFO$$$` of the GDSII, as properties of references to every cell that
# has some, and hides that cell when it reads. gdstk's `top_level()` is that cell alone, at which all real top cells
# are placed on each other; `flatten` overlays them. An OASIS of the same layout has no such cell.
# Matters to: files of gdsfactory and of klayout's own PCells, which all have settings.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
python3 -m venv own
own/bin/pip install --quiet --disable-pip-version-check klayout==0.30.12 gdstk==1.0.2 numpy==2.4.6
own/bin/python - <<'END'
import gdstk
from klayout import db

layout = db.Layout()
for name, side in (("A", 50_000), ("B", 30_000)):
    cell = layout.create_cell(name)
    cell.shapes(layout.layer(1, 0)).insert(db.Box(0, 0, side, side))
    cell.add_meta_info(db.LayoutMetaInfo("settings", "width=1", "", True))
for name, reader, tops in (("set.gds", gdstk.read_gds, ["$$$CONTEXT_INFO$$$"]), ("set.oas", gdstk.read_oas, ["A", "B"])):
    layout.write(name)
    seen = sorted(cell.name for cell in reader(name).top_level())
    back = db.Layout()
    back.read(name)
    print(name, "gdstk:", seen, "klayout:", sorted(cell.name for cell in back.top_cells()))
    assert seen == tops and sorted(cell.name for cell in back.top_cells()) == ["A", "B"]
overlaid = gdstk.read_gds("set.gds").top_level()[0].get_polygons()
print("polygons below gdstk's top cell:", [polygon.area() for polygon in overlaid])
assert sorted(round(polygon.area()) for polygon in overlaid) == [900, 2500]
END
