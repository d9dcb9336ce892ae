#!/usr/bin/env bash
# gmsh keeps the unit in which it imports STEP from one session to the next, through `finalize` and `initialize`.
# 
# Versions: gmsh 4.15.2, build123d 0.13.0 (writes a box of 100 mm).
# Guess: `finalize` forgets; an empty `Geometry.OCCTargetUnit`, which is the default, leaves numbers as the file has them.
# Seen: the first import converts to millimetres. Once "UM" was asked for, later sessions of the process import in
# micrometres although the option is empty again; so the same call gives 100 or 100000.
# Matters to: batches that mesh a mask's solids beside optics' own.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
python3 -m venv own
own/bin/pip install --quiet --disable-pip-version-check gmsh==4.15.2 build123d==0.13.0
own/bin/python - <<'END'
import build123d
import gmsh

build123d.export_step(build123d.Box(100, 50, 10), "box.step")


def width(unit):
    gmsh.initialize()
    gmsh.option.setNumber("General.Terminal", 0)
    if unit is not None:
        gmsh.option.setString("Geometry.OCCTargetUnit", unit)
    gmsh.model.occ.importShapes("box.step")
    gmsh.model.occ.synchronize()
    box = gmsh.model.getBoundingBox(-1, -1)
    gmsh.finalize()
    return round(box[3] - box[0], 6)


seen = [width(unit) for unit in (None, "UM", None, "MM", None)]
print("default, UM, default, MM, default:", seen)
assert seen == [100, 100_000, 100_000, 100, 100]
END
