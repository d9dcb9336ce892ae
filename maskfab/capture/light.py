"""Where the one light of a stack lies on the sensor, to crop the frames about it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy import ndimage

from maskfab.base.arrays import Singles
from maskfab.capture.frames import Frame
from maskfab.capture.stack import check_stack
from maskfab.errors import SourceError

_SPOT = 9
"""Pixels along the square whose mean is compared."""
_SEEN = 8.0
_MAD = 1.4826
_SECOND = 0.05
_PAIRED = 5
"""Pixels within which an order lies where its pair says: their place is that of the light to a pixel or two."""


def light_place(frames: Sequence[Frame], side: int) -> tuple[int, int]:
    """Row and column of the brightest spot, that of undiffracted light, within some pixels.

    Args:
        frames: a stack; long exposures tell faint light, short ones what is brightest in it.
        side: pixels of the crop that is to be taken about it.

    Raises:
        SourceError: as :func:`check_stack`; MF334 without a spot above noise, MF338 if another spot outside the crop
            has a twentieth of its light or more, and none lies as far on the other side.
    """
    check_stack(frames)
    ordered = sorted(frames, key=lambda frame: frame.exposure_s or 0.0)
    shortest = _spots(ordered[0])
    seen = shortest if len(frames) == 1 else np.sum([_spots(frame) for frame in ordered], axis=0)
    row, column = (int(each) for each in np.unravel_index(int(seen.argmax()), seen.shape))
    if not seen[row, column] > _level(seen):
        raise SourceError(
            "MF334",
            f"no spot of {_SPOT} x {_SPOT} pixels is {_SEEN:g} standard deviations above the others",
            where=frames[0].name,
            cure="Expose longer, or point the camera at the light",
        )
    outside = _unpaired(shortest, row, column)
    outside[max(0, row - side // 2) : row + side // 2, max(0, column - side // 2) : column + side // 2] = -np.inf
    other = np.unravel_index(int(outside.argmax()), seen.shape)
    share = float(outside[other] / shortest[row, column])
    if seen[other] > _level(seen) and shortest[other] > _level(shortest) and share > _SECOND:
        raise SourceError(
            "MF338",
            f"a second light at row {other[0]}, column {other[1]} has {share:.2g} of the light at row {row}, column "
            f"{column}; outside the crop of {side} pixels at most {_SECOND:g} is allowed",
            where=frames[0].name,
            cure="Cover the other light, or crop so many pixels that all of it is held",
        )
    return row, column


def _unpaired(spots: Singles, row: int, column: int) -> Singles:
    """Spots less what lies as far on the other side of a place: orders of diffraction come in pairs, lamps do not.

    Where the other side is beyond the frame nothing can be said, and nothing is left.
    """
    rows, columns = spots.shape
    there = np.ix_(2 * row - np.arange(rows), 2 * column - np.arange(columns))
    held = [(index >= 0) & (index < length) for index, length in zip(there, spots.shape, strict=True)]
    paired = ndimage.maximum_filter(spots, _PAIRED)[there[0].clip(0, rows - 1), there[1].clip(0, columns - 1)]
    return np.asarray(np.where(held[0] & held[1], spots - paired, -np.inf), dtype=np.float32)


def _spots(frame: Frame) -> Singles:
    """Mean light of the square about each pixel, in units of white, [rows, columns]."""
    light = np.zeros(frame.shape, dtype=np.float32)
    top = frame.white if np.isfinite(frame.white) else float(frame.counts.max())
    for place, lattice in enumerate(frame.lattices):
        black = frame.black[place]
        values = (lattice.of(frame.counts).astype(np.float32) - np.float32(black)) / np.float32(max(top - black, 1e-30))
        light[lattice.first[0] :: lattice.step, lattice.first[1] :: lattice.step] += _unspiked(values)
    return np.asarray(ndimage.uniform_filter(light, _SPOT, mode="constant"))


def _unspiked(values: Singles) -> Singles:
    """No pixel brighter than the brightest of its eight neighbours: a hot one alone makes no spot."""
    rows, columns = values.shape
    padded = np.pad(values, 1, constant_values=-np.inf)
    beside = np.full_like(values, -np.inf)
    for down in range(3):
        for right in range(3):
            if (down, right) != (1, 1):
                np.maximum(beside, padded[down : down + rows, right : right + columns], out=beside)
    return np.minimum(values, beside)


def _level(spots: Singles) -> float:
    """Above which a spot is no noise."""
    middle = float(np.median(spots))
    return middle + _SEEN * _MAD * float(np.median(np.abs(spots - middle)))
