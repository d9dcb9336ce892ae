"""PSFs as OpenEXR, with what a reader needs to use them in the header."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import OpenImageIO as oiio  # noqa: N813

from maskfab.errors import OutputError
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
    aside = path.with_name(f".{path.name}.partial.exr")
    output = oiio.ImageOutput.create(str(aside))
    # Of an array without the axis of channels OpenImageIO takes the first axis for x.
    pixels = np.ascontiguousarray(psf.values[::-1, :, None], dtype=np.float32)
    written = output is not None and output.open(str(aside), header) and output.write_image(pixels)
    if output is not None:
        written = output.close() and written
    if not written:
        aside.unlink(missing_ok=True)
        raise OutputError("MF401", f"{path} cannot be written", cure="Choose another --out")
    os.replace(aside, path)
