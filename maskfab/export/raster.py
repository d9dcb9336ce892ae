"""PSFs as OpenEXR, with what a reader needs to use them in the header."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import OpenImageIO as oiio  # noqa: N813

from maskfab.export.image import write_image
from maskfab.model import Psf


def write_psf(psf: Psf, path: Path, signature: str) -> None:
    """Write a PSF as one float32 channel; row 0 of the file is the top.

    The values are intensity per square micrometre of sensor; the header has the step, the wavelength, the kind of
    sampling, and who made it.

    Raises:
        OutputError: MF401 if the file cannot be written; nothing is left under its name.
    """
    height, width = psf.values.shape
    header = oiio.ImageSpec(width, height, 1, "float")
    header.channelnames = ("Y",)
    header.attribute("compression", "zip")
    header.attribute("Software", signature)
    header.attribute("maskfab:step_um", psf.step_um)
    header.attribute("maskfab:wavelength_nm", psf.wavelength_nm)
    header.attribute("maskfab:kind", psf.kind)
    header.attribute("maskfab:unit", "1/um^2")
    # Of an array without the axis of channels OpenImageIO takes the first axis for x.
    pixels = np.ascontiguousarray(psf.values[::-1, :, None], dtype=np.float32)
    write_image(pixels, header, path)
