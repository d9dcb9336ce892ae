#!/usr/bin/env bash
# After a square trapezoid of OASIS, a rectangle that leaves its height out has one height for klayout and another for gdstk.
# 
# Versions: klayout 0.30.12, gdstk 1.0.2.
# Guess: a CTRAPEZOID whose height is implied by its width (types 16 to 23 and 25) leaves the same modal height in both.
# Seen: a rectangle of 100 x 40 um, a square of type 25 that states a width of 100 um alone, a rectangle that states
# nothing: klayout gives the last 100 um of height, gdstk 40, and 24000 against 18000 um2 in all, without a word.
# Matters to: files of writers that save every byte; a plate read by one and written by the other is another plate.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
python3 -m venv own
own/bin/pip install --quiet --disable-pip-version-check klayout==0.30.12 gdstk==1.0.2 numpy==2.4.6
own/bin/python - <<'END'
import gdstk
from klayout import db


def whole(number):
    parts = []
    while number >= 128:
        parts.append(number & 127 | 128)
        number >>= 7
    return bytes([*parts, number])


def rectangle(x_nm, *sides_nm):
    bits = 0b00011011 | (0b01100000 if sides_nm else 0)
    return whole(20) + bytes([bits]) + whole(1) + whole(0) + b"".join(map(whole, sides_nm)) + whole(2 * x_nm) + whole(0)


square = whole(26) + bytes([0b11011011]) + whole(1) + whole(0) + whole(25) + whole(100_000) + whole(400_000) + whole(0)
start = whole(1) + whole(3) + b"1.0" + whole(0) + whole(1000) + whole(0) + whole(0) * 12
shapes = rectangle(0, 100_000, 40_000) + square + rectangle(400_000)
with open("square.oas", "wb") as file:
    file.write(b"%SEMI-OASIS\r\n" + start + whole(14) + whole(3) + b"TOP" + shapes + whole(2) + whole(252) + bytes(253))
layout = db.Layout()
layout.read("square.oas")
one = [shape.bbox().height() / 1000 for shape in layout.top_cell().shapes(layout.layer(1, 0)).each()]
two = [float(polygon.bounding_box()[1][1]) for polygon in gdstk.read_oas("square.oas").cells[0].get_polygons()]
print("heights by klayout", one, "by gdstk", two)
assert sorted(one) == [40, 100, 100] and sorted(round(height, 6) for height in two) == [40, 40, 100]
END
