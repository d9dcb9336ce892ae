"""PackBits (TIFF 6.0, section 9): runs of equal bytes by their length; each row of a picture by itself."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

_LONGEST = 128
_FEWEST = 3
"""Equal bytes in a row that are shorter told as a run, wherever they stand."""


def pack_bits(row: bytes) -> bytes:
    """One row, which is not empty, in PackBits."""
    values = np.frombuffer(row, dtype=np.uint8)
    starts = np.concatenate([[0], np.flatnonzero(values[1:] != values[:-1]) + 1])
    equal = np.diff(starts, append=values.size) >= _FEWEST
    # Neighbours that are no runs are told byte by byte, together.
    begins = np.concatenate([[True], equal[1:] | equal[:-1]])
    starts, equal = starts[begins], equal[begins]
    lengths = np.diff(starts, append=values.size)
    pieces = -(-lengths // _LONGEST)
    owner = np.repeat(np.arange(starts.size), pieces)
    number = np.arange(owner.size) - np.repeat(np.cumsum(pieces) - pieces, pieces)
    begin = starts[owner] + number * _LONGEST
    length = np.minimum(lengths[owner] - number * _LONGEST, _LONGEST)
    run = equal[owner]
    taken = np.where(run, 2, length + 1)
    place = np.cumsum(taken) - taken
    out = np.empty(int(taken.sum()), dtype=np.uint8)
    # A run of one byte, the rest of a longer one, is the same as one byte told by itself.
    out[place] = np.where(run, (257 - length) & 255, length - 1)
    out[place[run] + 1] = values[begin[run]]
    told: NDArray[np.int64] = length[~run]
    shift = np.repeat(place[~run] + 1 - begin[~run], told)
    source = np.repeat(begin[~run] - (np.cumsum(told) - told), told) + np.arange(int(told.sum()))
    out[source + shift] = values[source]
    return out.tobytes()
