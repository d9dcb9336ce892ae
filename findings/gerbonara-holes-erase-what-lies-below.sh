#!/usr/bin/env bash
# The hole of a Gerber aperture erases what was drawn before, as gerbonara draws it.
# 
# Versions: gerbonara 1.5.0, klayout 0.30.12 (sums the areas).
# Guess: as in the format's specification (Ucamco, "Holes", and of macros "exposure"), a hole lets show what lies below.
# Seen: a ring flashed on a square of 1 mm2 leaves .998 mm2 of it, a macro with a clear primitive on 4 mm2 leaves 3.804;
# alone, each ring has its right area.
# Matters to: pads and fiducials on filled areas; alignment rings on a chrome field are openings to one and none to another.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
python3 -m venv own
own/bin/pip install --quiet --disable-pip-version-check gerbonara==1.5.0 klayout==0.30.12
own/bin/python - <<'END'
import math

from gerbonara import GerberFile
from gerbonara.utils import MM
from klayout import db

HEAD = "%FSLAX46Y46*%\n%MOMM*%\n%ADD11R,{0}X{0}*%\n"
HOLE = "%ADD12C,0.1X0.05*%\n"
MACRO = "%AMRING*1,1,1,0,0*1,0,0.5,0,0*%\n%ADD12RING*%\n"


def area_mm2(text):
    with open("ring.gbr", "w") as file:
        file.write(text + "M02*\n")
    drawn = db.Region()
    for item in GerberFile.open("ring.gbr").objects:
        for part in item.to_primitives(unit=MM):
            if hasattr(part, "r"):
                corners = [(part.x + part.r * math.cos(k * math.pi / 720), part.y + part.r * math.sin(k * math.pi / 720)) for k in range(1440)]
            else:
                corners = part.to_arc_poly().outline
            shape = db.Region(db.DPolygon([db.DPoint(*corner) for corner in corners]).to_itype(1e-6))
            drawn = (drawn + shape if part.polarity_dark else drawn - shape).merged()
    return drawn.area() * 1e-12


for name, ring, side, alone, right, seen in (
    ("hole", HOLE, 1, math.pi * (0.05**2 - 0.025**2), 1.0, 0.99804),
    ("macro", MACRO, 2, math.pi * (0.5**2 - 0.25**2), 4.0, 3.80365),
):
    own = area_mm2(HEAD.format(side) + ring + "D12*\nX0Y0D03*\n")
    both = area_mm2(HEAD.format(side) + ring + "D11*\nX0Y0D03*\nD12*\nX0Y0D03*\n")
    print(f"{name}: alone {own:.5f} of {alone:.5f} mm2, on a square {both:.5f} of {right} mm2")
    assert abs(own / alone - 1) < 1e-4 and abs(both - seen) < 1e-5
END
