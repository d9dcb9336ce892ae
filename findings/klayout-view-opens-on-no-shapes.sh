#!/usr/bin/env bash
# A picture that klayout's LayoutView makes of a plate shows frames of cells and no shapes, until levels are asked for.
# 
# Version: klayout 0.30.12.
# Guess: all levels are shown, as in the program, or at least the shapes of the top cell.
# Seen: the view opens with levels 0 to 0: the frame and name of the top cell, without its own shapes. After `max_hier()`
# everything is there. A line narrower than a pixel is then drawn a pixel wide: 1 % of clear area shows as half of it.
# Matters to: whoever checks a mask by an exported picture: an empty one says nothing of the file.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
python3 -m venv own
own/bin/pip install --quiet --disable-pip-version-check klayout==0.30.12
own/bin/python - <<'END'
from klayout import db, lay


def colours(view):
    pixels = view.get_pixels(200, 100)
    return [pixels.pixel(x, y) & 0xFFFFFF for x in range(200) for y in range(100)]


def coloured(colour):
    return len({colour >> 16, colour >> 8 & 255, colour & 255}) > 1


layout = db.Layout()
top = layout.create_cell("TOP")
for number in range(100):
    top.shapes(layout.layer(1, 0)).insert(db.Box(1000 * number, 0, 1000 * number + 10, 50_000))
layout.write("lines.gds")
view = lay.LayoutView()
view.load_layout("lines.gds")
view.zoom_fit()
before, levels = sum(map(coloured, colours(view))), (view.min_hier_levels, view.max_hier_levels)
view.max_hier()
view.zoom_fit()
after = sum(map(coloured, colours(view)))
print(f"levels {levels}: {before} coloured pixels; all levels: {after} of 20000, the lines cover 1 % of their box")
assert levels == (0, 0) and before == 0 and after > 1000
END
