"""Photographs as protocol F1 takes them: code values over the largest one, the middle of the picture.

A scene is the middle of a picture, at most 1024 x 1536 (1536 x 1024 of an upright one), its sides cut to multiples of
64 so that transforms are fast; pictures are never scaled. A grey one has three equal channels. Alpha is left out.
"""

from __future__ import annotations

import os
import zlib
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
import scipy.fft
from numpy.typing import NDArray

from maskfab.errors import JobError, SourceError
from maskfab.eye.picture import read_picture

SHORT, LONG = 1024, 1536
SMALLEST = 832
_STEP = 64
_SUFFIXES = (".png", ".jpg", ".jpeg", ".tif", ".tiff", ".bmp")


@dataclass(frozen=True, eq=False)
class Photograph:
    """A scene for the protocol.

    Attributes:
        name: in tables.
        number: seeds its noise.
        values: float32 [3, rows, columns] within 0 to 1.
    """

    name: str
    number: int
    values: NDArray[np.float32]

    @cached_property
    def spectrum(self) -> NDArray[np.complex64]:
        """``rfft2`` of the values, [3, rows, columns / 2 + 1]; kept, for every design is seen through it."""
        return np.asarray(scipy.fft.rfft2(self.values, axes=(1, 2), workers=1))


def scene(name: str, values: NDArray[np.float32], number: int | None = None) -> Photograph:
    """Cut a picture [rows, columns] or [rows, columns, 1, 2, 3 or 4] to a scene.

    Args:
        name: in tables; its digits, if it has no other characters, are the number.
        values: within 0 to 1.
        number: seeds the noise; None takes it from the name.

    Raises:
        JobError: MF121 if it is too small, or not within 0 to 1.
    """
    picture = np.asarray(values, dtype=np.float32)
    picture = picture[:, :, None] if picture.ndim == 2 else picture
    rows, columns = picture.shape[:2]
    if min(rows, columns) < SMALLEST:
        raise JobError(
            "MF121",
            f"the picture has {columns} x {rows} pixels, fewer than {SMALLEST} along a side",
            where=name,
            cure=f"Give a photograph of {LONG} x {SHORT} or more",
        )
    if not (np.isfinite(picture).all() and picture.min() >= 0 and picture.max() <= 1):
        raise JobError(
            "MF121", "the picture's values are not within 0 to 1", where=name, cure="Scale the picture to 0 to 1"
        )
    most = (SHORT, LONG) if columns >= rows else (LONG, SHORT)
    sides = [min(have, limit) // _STEP * _STEP for have, limit in zip((rows, columns), most, strict=True)]
    top, left = (rows - sides[0]) // 2, (columns - sides[1]) // 2
    middle = picture[top : top + sides[0], left : left + sides[1]]
    colours = middle[:, :, :3] if picture.shape[2] >= 3 else np.repeat(middle[:, :, :1], 3, axis=2)
    if number is None:
        number = int(name) if name.isdecimal() else zlib.crc32(name.encode()) % 1_000_000
    return Photograph(name, number, np.ascontiguousarray(colours.transpose(2, 0, 1)))


def folder(path: str | Path) -> tuple[Photograph, ...]:
    """Every photograph of a folder, by name.

    Raises:
        SourceError: MF301 without a folder or a photograph in it, and as :func:`maskfab.eye.picture.read_picture`.
        JobError: MF121 for one that is too small or holds linear light.
    """
    where = Path(path)
    files = sorted(p for p in where.iterdir() if p.suffix.lower() in _SUFFIXES) if os.path.isdir(where) else []
    if not files:
        raise SourceError("MF301", f"there are no photographs in {where}", cure="Give a folder of PNG or JPEG files")
    return tuple(scene(file.stem, read_picture(file).values) for file in files)
