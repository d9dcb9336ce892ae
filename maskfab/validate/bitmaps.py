"""A written picture of a die against the die: every pixel read back, as boxes, over the openings themselves."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from klayout import db

from maskfab.geometry.reading_image import read_picture
from maskfab.geometry.region import clear_shapes, coverage, region
from maskfab.model import CLEAR, Die, Quantity
from maskfab.units import NM_PER_UM

_EDGE = 1e-9
"""A pixel covered to this much less or more than wholly is whole."""


def check_bitmap(die: Die, design: db.Layout, path: Path, dots_per_um: float) -> tuple[Quantity, ...]:
    """Read a die's PNG or TIFF back and compare it with the plate.

    Args:
        die: what the picture shows.
        design: the plate, as :func:`maskfab.geometry.region.plate_layout`.
        path: the picture.
        dots_per_um: pixels per micrometre that it should have; its own resolution tags are what it is read by.

    Returns:
        ``bitmap_xor_area`` in um²: what only one of picture and die covers. A pixel that is partly clear is off by half
        of its area at most; where pixels follow the dots the limit is 0.

    Raises:
        SourceError: as of :func:`maskfab.geometry.reading_image.read_picture`.
    """
    x0, y0, x1, y1 = die.box_nm
    read = region(read_picture(path), CLEAR)
    pixel = NM_PER_UM / dots_per_um
    width, height = (int(np.ceil(round(side / pixel, 6))) for side in (x1 - x0, y1 - y0))
    read.move(db.Vector(round(x0 + width * pixel / 2), round(y0 + height * pixel / 2)))
    drawn = region(design, CLEAR, die.box_nm)
    shapes = clear_shapes(design, die.box_nm)
    x, y = (start + pixel * np.arange(count + 1, dtype=np.float64) for start, count in ((x0, width), (y0, height)))
    clear = coverage(shapes, x, y)
    partly = int(np.count_nonzero((clear > _EDGE) & (clear < 1 - _EDGE)))
    limit = partly / 2 / dots_per_um**2
    found = (read ^ drawn).area() / NM_PER_UM**2
    return (
        Quantity(
            "bitmap_xor_area",
            "A_xor",
            found,
            "um^2",
            f"{path.name}, read by its resolution tags, XOR with the design; {partly} pixels are partly clear, half of "
            "whose area is the limit",
            limit=limit,
            passed=bool(found <= limit * (1 + 1e-9)),
            die=die.name,
        ),
    )
