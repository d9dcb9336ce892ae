"""Numbers as OpenEXR with what they mean in the header; equal content makes equal bytes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TypeAlias

import numpy as np
import OpenImageIO as oiio  # noqa: N813
from numpy.typing import NDArray

from maskfab.files.image import write_image

Fact: TypeAlias = str | float
Facts: TypeAlias = Mapping[str, Fact]

PREFIX = "maskfab:"
"""Prefix of the names of our entries in a header."""


def write_channels(
    pixels: NDArray[np.float16] | NDArray[np.float32],
    channels: Sequence[str],
    path: Path,
    facts: Facts,
    software: str = "maskfab",
) -> None:
    """Write linear values, half or float by their type, compressed by scanlines without loss.

    Args:
        pixels: [y, x, channels], the top row first.
        channels: their names.
        path: where to; nothing is left there if it fails.
        facts: go into the header, each under :data:`PREFIX` and its name; numbers as float32.
        software: who made it.

    Raises:
        OutputError: MF401 if the file cannot be written.
    """
    height, width, count = pixels.shape
    header = oiio.ImageSpec(width, height, count, "half" if pixels.dtype == np.float16 else "float")
    header.channelnames = tuple(channels)
    header.attribute("compression", "zip")
    header.attribute("oiio:ColorSpace", "lin_rec709_scene" if count > 1 else "data")
    header.attribute("Software", software)
    header.attribute("DateTime", "")  # or OpenImageIO writes the time, and equal values make unequal files
    for name, value in facts.items():
        header.attribute(PREFIX + name, value)
    write_image(np.ascontiguousarray(pixels), header, path)
