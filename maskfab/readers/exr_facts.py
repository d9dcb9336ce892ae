"""OpenEXR files of numbers: their channels, and the entries of the header that a program of ours wrote."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import OpenImageIO as oiio  # noqa: N813
from numpy.typing import NDArray

from maskfab.errors import SourceError
from maskfab.readers.image_errors import said_by


@dataclass(frozen=True, eq=False)
class Channels:
    """An EXR.

    Attributes:
        values: float64 [channels, rows, columns], row 0 the uppermost.
        names: of the channels.
        stored: type of the values in the file, ``half`` or ``float``.
        facts: entries of the header whose name begins with a prefix, without it.
    """

    values: NDArray[np.float64]
    names: tuple[str, ...]
    stored: str
    facts: dict[str, Any]


def read_channels(path: Path, prefix: str, cure: str) -> Channels:
    """Read a file.

    Args:
        path: of it.
        prefix: of the entries of the header that are kept.
        cure: told where it cannot be read.

    Raises:
        SourceError: MF301 if there is no such file, MF303 if it cannot be read.
    """
    if not os.path.isfile(path):
        raise SourceError("MF301", f"there is no file {path.name}", where=str(path), cure=cure)
    image = oiio.ImageInput.open(str(path))
    if image is None:
        raise damaged(path, said_by(oiio), cure)
    spec = image.spec()
    pixels = image.read_image("float")
    problem = said_by(image) or said_by(oiio)
    image.close()
    if pixels is None or problem:
        raise damaged(path, problem, cure)
    try:
        entries = {entry.name: entry.value for entry in spec.extra_attribs}
        names = tuple(str(name) for name in spec.channelnames)
    except UnicodeDecodeError as error:
        raise damaged(path, "an entry of its header is no text", cure) from error
    facts = {name.removeprefix(prefix): value for name, value in entries.items() if name.startswith(prefix)}
    planes = np.asarray(pixels, dtype=np.float64).reshape(spec.height, spec.width, spec.nchannels).transpose(2, 0, 1)
    return Channels(planes, names, str(spec.format), facts)


def damaged(path: Path, why: str, cure: str) -> SourceError:
    """MF303 with the first line of a reason."""
    said = why.strip().splitlines()
    return SourceError(
        "MF303", f"{path.name} cannot be read: {said[0] if said else 'damaged'}", where=str(path), cure=cure
    )
