"""Pixels to an image file that appears whole or not at all."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

from numpy.typing import NDArray

from maskfab.base.errors import OutputError
from maskfab.base.files import partial

_PNG_END = b"\x00\x00\x00\x00IEND\xaeB`\x82"


def write_image(pixels: NDArray[Any], header: Any, path: Path) -> None:
    """Write pixels [y, x, channels], the top row first, in the format of the path's suffix.

    Raises:
        OutputError: MF401 if the file cannot be written; nothing is left under its name.
    """
    import OpenImageIO as oiio  # noqa: N813 - its customary name

    with partial(path) as aside:
        output = oiio.ImageOutput.create(str(aside))
        written = output is not None and output.open(str(aside), header) and output.write_image(pixels)
        if output is not None:
            written = output.close() and written
        if not (written and is_whole(aside)):
            raise OutputError("MF401", f"{path} cannot be written", cure="Choose another --out, with more room")


def is_whole(path: Path) -> bool:
    """Whether an image file has its end, as OpenImageIO does not say of one that it wrote to a disk that is full."""
    if path.suffix == ".png":
        with path.open("rb") as file:
            file.seek(-min(len(_PNG_END), path.stat().st_size), os.SEEK_END)
            return file.read() == _PNG_END
    import OpenImageIO as oiio  # noqa: N813 - its customary name

    source = oiio.ImageInput.open(str(path))
    if source is None:
        oiio.geterror()  # or it is told at the end of the process
        return False
    row = source.read_scanline(source.spec().height - 1, 0, "float")
    source.close()
    return row is not None
