"""Many outlines at once between arrays and klayout, as records of GDSII in memory.

Made one by one, a million polygons of klayout take half a minute; records of them take a second or two.
"""

from __future__ import annotations

import numpy as np
from klayout import db
from numpy.typing import NDArray

from maskfab.base.arrays import Ints

_MOST_CORNERS = 8190
_AT_LEAST = 1e-9
"""Share of the lengths multiplied in a cross product that it exceeds where it is other than 0, whatever is rounded."""

LIBRARY = (
    bytes.fromhex("00060002 0258 001c0102") + bytes(24) + bytes.fromhex("00060206 4100")
    + bytes.fromhex("00140305 3e4189374bc6a7f0 3944b82fa09b5a54")
)  # fmt: skip
"""HEADER, BGNLIB, LIBNAME, and UNITS of a nanometre and a thousandth of the user's."""
STRUCTURE_END, LIBRARY_END = bytes.fromhex("00040700"), bytes.fromhex("00040400")
_BOUNDARY, _LAYER, _OF_LAYER, _DATATYPE, _XY, _ENDEL = 0x00040800, 0x00060D02, 0x0006, 0x0E020000, 0x1003, 0x00041100
_WORDS_BEFORE, _WORDS_AROUND = 5, 6


def is_plain(corners: Ints, sizes: Ints) -> NDArray[np.bool_]:
    """Which outlines :func:`outlines_layout` draws as they are: every corner turns, and the whole has an area.

    Args:
        corners: int64 [sum of sizes, 2], those of each outline after those of the one before, in nanometres.
        sizes: int64 [n], how many corners each has.

    Returns:
        bool [n]; False too for outlines of so many corners that no record holds them, or of none.
    """
    fit = (sizes >= 3) & (sizes <= _MOST_CORNERS)
    kept = np.repeat(fit, sizes)
    if not kept.any():
        return fit
    many, own = sizes[fit], corners[kept].astype(np.float64)
    ends = np.cumsum(many)
    starts = ends - many
    after = np.arange(1, len(own) + 1)
    after[ends - 1] = starts
    along = own[after] - own
    turn = _turns(along, along[after])
    away = own - np.repeat(own[starts], many, axis=0)
    area = along[:, 1] * away[:, 0], along[:, 0] * away[:, 1]
    twice = np.add.reduceat(area[0] - area[1], starts)
    rounded = _AT_LEAST * np.add.reduceat(np.abs(area[0]) + np.abs(area[1]), starts)
    fit[fit] = np.logical_and.reduceat(turn, starts) & (np.abs(twice) > rounded)
    return fit


def _turns(before: NDArray[np.float64], after: NDArray[np.float64]) -> NDArray[np.bool_]:
    one, other = before[:, 0] * after[:, 1], before[:, 1] * after[:, 0]
    return np.abs(one - other) > _AT_LEAST * (np.abs(one) + np.abs(other))


def outlines_layout(corners: Ints, sizes: Ints, layers: Ints) -> db.Layout:
    """Outlines that are :func:`is_plain`, upright rectangles as boxes, in the one cell of a layout.

    Args:
        corners: int64 [sum of sizes, 2] in nanometres, each within 31 bits.
        sizes: int64 [n].
        layers: int64 [n], each from 0 to 32767: the number of the layer that an outline lies on, of datatype 0.
    """
    ends = np.cumsum(2 * sizes + _WORDS_AROUND + 2)
    starts = ends - (2 * sizes + _WORDS_AROUND + 2)
    words = np.empty(int(ends[-1]) if len(ends) else 0, dtype=">u4")
    for place, word in enumerate(
        (_BOUNDARY, _LAYER, layers << 16 | _OF_LAYER, _DATATYPE, (8 * sizes + 12) << 16 | _XY)
    ):
        words[starts + place] = word
    words[ends - 1] = _ENDEL
    first = np.cumsum(sizes) - sizes
    # Each outline's first corner is said again behind its last.
    at = np.repeat(starts + _WORDS_BEFORE - 2 * first, sizes) + 2 * np.arange(len(corners))
    values = corners.astype(np.int32).view(np.uint32)
    for axis in (0, 1):
        words[at + axis] = values[:, axis]
        words[ends - 3 + axis] = values[first, axis]
    layout = db.Layout()
    read_records(layout, b"".join([LIBRARY, structure("A"), words.tobytes(), STRUCTURE_END, LIBRARY_END]))
    return layout


def structure(name: str) -> bytes:
    """BGNSTR and STRNAME."""
    text = name.encode("ascii")
    text += bytes(len(text) % 2)
    return bytes.fromhex("001c0502") + bytes(24) + (4 + len(text)).to_bytes(2, "big") + b"\x06\x06" + text


def read_records(layout: db.Layout, stream: bytes) -> None:
    """Add what a stream of GDSII holds to the cells of a layout that have the names of its structures."""
    options = db.LoadLayoutOptions()
    options.warn_level = 0
    layout.read_bytes(stream, options)
