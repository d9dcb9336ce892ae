"""A plate of two dies: written, read back and compared, and drawn."""

import maskfab as mf

camera = mf.Camera("5 mm", stop="400 um", pixel="2 um", wavelengths="530 nm", window="64 um")
bar = mf.Opening.bar(dots=7, size=(5, 3), pitch="56 um")
plate = mf.Plate.of(
    BAR=mf.Panel.tile(bar, size="1.2 mm"),
    TURNED=mf.Panel.tile(bar, "blue_noise", seed=1, size="1.2 mm"),
    template="5in",
    name="TWO",
    camera=camera,
)
plate.write("two.oas")
print(mf.verify("two.oas", against=plate))
plate.plot().save("two.png")
