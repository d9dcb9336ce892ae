"""PSF and MTF of a bar behind a camera: periodic cells against cells turned at random."""

import maskfab as mf

bar = mf.Opening.bar(dots=7, size=(5, 3), pitch="56 um")
camera = mf.Camera("5 mm", stop="400 um", pixel="2 um", wavelengths="530 nm", window="64 um")
for tiling, seed in (("periodic", None), ("random", 1)):
    panel = mf.Panel.tile(bar, tiling, seed=seed, size="560 um")
    mtf = camera.mtf(panel)
    print(f"{tiling}: MTF 50 % at {mtf.frequency_at(0.5)}, AUC {mtf.auc}")
    camera.psf(panel).plot().save(f"psf_{tiling}.png")
    mtf.plot().save(f"mtf_{tiling}.svg")
