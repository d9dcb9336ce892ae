"""Pixels to an image file that appears whole or not at all."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import OpenImageIO as oiio  # noqa: N813
from numpy.typing import NDArray

from maskfab.errors import OutputError


def write_image(pixels: NDArray[Any], header: Any, path: Path) -> None:
    """Write pixels [y, x, channels], the top row first, in the format of the path's suffix.

    Raises:
        OutputError: MF401 if the file cannot be written; nothing is left under its name.
    """
    aside = path.with_name(f".{path.name}.partial{path.suffix}")
    output = oiio.ImageOutput.create(str(aside))
    written = output is not None and output.open(str(aside), header) and output.write_image(pixels)
    if output is not None:
        written = output.close() and written
    if not written:
        aside.unlink(missing_ok=True)
        raise OutputError("MF401", f"{path} cannot be written", cure="Choose another --out")
    os.replace(aside, path)
