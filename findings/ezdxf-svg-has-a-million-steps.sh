#!/usr/bin/env bash
# An SVG that ezdxf's drawing add-on exports has a grid of a millionth of the drawing's longer side.
# 
# Version: ezdxf 1.4.5.
# Guess: coordinates are decimals of the page's millimetres, with six or more digits.
# Seen: they are whole numbers from 0 to 1 000 000 over the longer side, whatever the page: on a plate of 126.6 mm one
# step is 127 nm, and an opening of 8.06 um comes as 64 steps, 8.10 um.
# Matters to: whoever measures in a viewer's export, or cuts foils from it.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
python3 -m venv own
own/bin/pip install --quiet --disable-pip-version-check ezdxf==1.4.5 pillow==12.0.0
own/bin/python - <<'END'
import re

import ezdxf
from ezdxf.addons.drawing import Frontend, RenderContext, layout, svg

drawing = ezdxf.new("R2010", units=4)
space = drawing.modelspace()
for x, y, side in ((0, 0, 126.6), (10, 10, 0.00806)):
    space.add_lwpolyline([(x, y), (x + side, y), (x + side, y + side), (x, y + side)], close=True)
for page_mm in (0, 1000):
    backend = svg.SVGBackend()
    Frontend(RenderContext(drawing), backend).draw_layout(space)
    text = backend.get_string(layout.Page(page_mm, page_mm, layout.Units.mm, layout.Margins.all(0)))
    plate, opening = (int(steps) for steps in re.findall(r"l (\d+) 0", text))
    print(f"page {page_mm or 'of the drawing'}: plate {plate} steps, opening {opening} steps, {opening / plate * 126.6e3:.3f} um of 8.060")
    assert plate == 1_000_000 and opening == 64
END
