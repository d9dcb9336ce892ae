"""How a gutter round every pixel costs light and sharpness: a curve over its width."""

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt

import maskfab as mf

camera = mf.Camera("5 mm", stop="400 um", pixel="2 um", wavelengths="530 nm", window="64 um")
bar = mf.Opening.bar(dots=7, size=(5, 3), pitch="56 um")
gutters = (0, 4, 8, 16)
panels = [mf.Panel.tile(bar, "random", seed=1, size="600 um", gutter=gutter) for gutter in gutters]
mtfs = [camera.mtf(panel) for panel in panels]
figure, axes = plt.subplots()
axes.errorbar(gutters, [float(mtf.auc) for mtf in mtfs], label="AUC of the radial minimum")
axes.plot(gutters, [panel.open_ratio for panel in panels], label="open ratio")
axes.set(xlabel="gutter (µm)", ylim=(0, None))
axes.legend()
figure.savefig("gutters.png")
plt.close(figure)
