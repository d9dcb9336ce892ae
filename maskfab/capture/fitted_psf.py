"""The PSF of a fitted die: what a capture tells of die and lens, without the capture's noise and beyond its window."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from maskfab.base import __version__
from maskfab.base.arrays import Floats
from maskfab.capture.die_image import Pixels
from maskfab.capture.restoring.measured_psf import HOLDS
from maskfab.export.images.exr import Fact, write_channels

if TYPE_CHECKING:
    from maskfab.capture.measured import Measured


SIDE = 601
"""Pixels along a side of the PSF that is written, the light in the middle one."""


def fitted_psf(found: Measured, side: int = SIDE) -> dict[str, Floats]:
    """Share of a light in every pixel, of each colour as if all pixels were its, [side, side], row 0 the top."""
    axis = found.image.camera.pixel_um * (np.arange(side, dtype=np.float64) - side // 2)
    wide = found.image.on([Pixels(colour, axis, -axis) for colour in found.image.light])
    pictures = wide.pictures(replace(found.fit.setting, x_um=0.0, y_um=0.0))
    return {each.colour: picture for each, picture in zip(wide.pixels, pictures, strict=True)}


def write_fitted_psf(found: Measured, path: Path) -> None:
    """Write the PSF as EXR, channels R, G and B, or Y of a sensor without colours; shares of the light as float32.

    Raises:
        OutputError: MF401 if the file cannot be written; nothing is left under its name.
    """
    psf = fitted_psf(found)
    names = tuple("RGB" if len(psf) > 1 else "Y")
    pixels = np.stack([psf[name if len(psf) > 1 else next(iter(psf))] for name in names], axis=2).astype(np.float32)
    facts: dict[str, Fact] = {
        "maskfab_version": __version__,
        "holds": HOLDS,
        "unit": "share of the light in a pixel",
        "axes": "the first row of pixels is the uppermost of the sensor, the light in the middle pixel",
        "sensor_pixel_um": found.image.camera.pixel_um,
        "die": found.identified.best.die,
    }
    write_channels(pixels, names, path, facts, f"maskfab {__version__}")
