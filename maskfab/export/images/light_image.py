"""Pictures for people: emitted light as OpenEXR with its scale in the header, and the same as PNG."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import OpenImageIO as oiio  # noqa: N813

from maskfab.base.arrays import Floats
from maskfab.export.images.exr import Facts, write_channels
from maskfab.files.image import write_image
from maskfab.optics.numbers.colour import code_of_light

_STEPS = 65535


def write_exr(light: Floats, path: Path, facts: Facts) -> None:
    """Write linear light as half floats; row 0 of the file is the top.

    Args:
        light: [3, y, x] or [y, x, 3], row 0 the lowest; linear, primaries of sRGB.
        path: where to; nothing is left there if it fails.
        facts: go into the header, each under ``maskfab:`` and its name.

    Raises:
        OutputError: MF401 if the file cannot be written.
    """
    write_channels(_upright(light).astype(np.float16), ("R", "G", "B"), path, facts)


def write_png(light: Floats, path: Path, white: float = 1.0) -> None:
    """Write linear light as 8-bit sRGB (IEC 61966-2-1); ``white`` is what becomes 255, more is cut off.

    Args:
        light: [3, y, x] or [y, x, 3], row 0 the lowest.
        path: where to; nothing is left there if it fails.
        white: positive.

    Raises:
        OutputError: MF401 if the file cannot be written.
    """
    # A table of 16 bits is off by at most a twentieth of a code, and saves a power for every value.
    steps = np.clip(_upright(light) * (_STEPS / white), 0.0, _STEPS).round().astype(np.uint16)
    table = (code_of_light(np.linspace(0.0, 1.0, _STEPS + 1)) * 255).round().astype(np.uint8)
    pixels = np.ascontiguousarray(table[steps])
    height, width, channels = pixels.shape
    header = oiio.ImageSpec(width, height, channels, "uint8")
    header.attribute("oiio:ColorSpace", "srgb_rec709_scene")
    write_image(pixels, header, path)


def _upright(light: Floats) -> Floats:
    """[y, x, 3] with the top row first."""
    last = light if light.shape[-1] == 3 else np.moveaxis(light, 0, -1)
    return last[::-1]
