"""Room for emitters round an opening, and how the display looks from 300 mm."""

from pathlib import Path

import maskfab as mf

bar = mf.Opening.bar(dots=7, size=(3, 5), pitch="112 um")
rules = {"colour_gap": "8 um", "min_width": "8 um"}
camera = mf.Camera("5 mm", stop="400 um", pixel="2 um", wavelengths="530 nm", window="64 um")
panel = mf.Panel.tile(bar, "random", seed=1, size="1.2 mm")
plate = mf.Plate.of(BAR=panel, camera=camera, sections={"emitters": rules})
print(mf.check(plate))
seen = mf.check(plate, look=True, pixels=10, samples=7)
print(seen)
Path("display.png").write_bytes(seen.picture())
