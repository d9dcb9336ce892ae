"""DNG files of our own writing, as cameras write them: a mosaic of 16 bits with its levels, colours and time."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import tifffile

RATIONAL, SIGNED_RATIONAL = "2I", "2i"
_PLACES = {"r": 0, "g": 1, "b": 2}
_NEUTRAL = (1, 2, 1, 1, 2, 3)
_TO_CAMERA = (0.9, -0.2, -0.1, -0.3, 1.2, 0.1, 0.0, 0.2, 0.6)


def write_dng(
    path,
    counts,
    *,
    time=Fraction(1, 250),
    black=64,
    white=4095,
    mosaic="rggb",
    iso=100,
    model="Cam",
    extra=(),
    kind=np.uint16,
):
    """Write counts [rows, columns]; black is one number, or four for the mosaic's places row by row.

    Args:
        extra: further tags of tifffile, in place of those of the same number.
    """
    levels = (black,) if isinstance(black, int) else tuple(black)
    time = Fraction(time)
    tags = [
        (271, "s", 0, "Lab", True),
        (272, "s", 0, model, True),
        (33421, "H", 2, (2, 2), True),
        (33422, "B", 4, bytes(_PLACES[each] for each in mosaic), True),
        (33434, RATIONAL, 1, (time.numerator, time.denominator), True),
        (34855, "H", 1, iso, True),
        (50706, "B", 4, bytes((1, 4, 0, 0)), True),
        (50713, "H", 2, (2, 2) if len(levels) == 4 else (1, 1), True),
        (50714, "H", len(levels), levels if len(levels) > 1 else levels[0], True),
        (50717, "H", 1, white, True),
        (50721, SIGNED_RATIONAL, 9, tuple(n for each in _TO_CAMERA for n in (round(each * 10), 10)), True),
        (50728, RATIONAL, 3, _NEUTRAL, True),
    ]
    given = {tag[0]: tag for tag in (*tags, *extra)}
    tags = [given[number] for number in sorted(given)]
    tifffile.imwrite(
        path, np.asarray(counts, dtype=kind), photometric=32803, extratags=tags, metadata=None, software=False
    )
