"""The optics of an opening as it is written to a file and read back, with every number in a table."""

from pathlib import Path

import maskfab as mf

stripe = mf.Opening.shape("stripe", dots=7, pitch="56 um", width_dots=3)
camera = mf.Camera("5 mm", stop="400 um", pixel="2 um", wavelengths="530 nm", window="64 um")
found = mf.analyse(stripe, camera)
print(found)
print(found["mtf50", 530])
Path("stripe.png").write_bytes(found.picture())
