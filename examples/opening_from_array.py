"""An opening of your own from an array: a ring, laid out in four orientations."""

import numpy as np

import maskfab as mf

y, x = np.mgrid[-10:11, -10:11]
radius = np.hypot(x, y)
ring = mf.Opening.of((radius > 4) & (radius < 8) & (x < 6), pitch="168 um", name="ring")
panel = mf.Panel.tile(ring, "rot90", size="1.7 mm", gutter="8 um")
ring.save("ring.toml")
panel.plot(cells=4).save("ring_panel.png")
