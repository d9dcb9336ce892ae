"""Whole numbers as text: zigzag, then seven bits a byte, lowest first, then base64."""

from __future__ import annotations

import base64

import numpy as np
from numpy.typing import ArrayLike

_MOST_BYTES = 10


def packed(values: ArrayLike) -> str:
    """Text of int64 numbers of either sign; small ones take little.

    Zigzag puts signs into the lowest bit: 0, -1, 1, -2 become 0, 1, 2, 3. The highest bit of a byte says that the
    number goes on. As Protocol Buffers' ``sint64``.
    """
    signed = np.asarray(values, dtype=np.int64).reshape(-1)
    rest = ((signed << 1) ^ (signed >> 63)).view(np.uint64)
    columns = np.zeros((signed.size, _MOST_BYTES), dtype=np.uint8)
    used = np.zeros((signed.size, _MOST_BYTES), dtype=bool)
    goes_on = np.ones(signed.size, dtype=bool)
    for place in range(_MOST_BYTES):
        used[:, place] = goes_on
        columns[:, place] = (rest & np.uint64(127)).astype(np.uint8)
        rest = rest >> np.uint64(7)
        goes_on = goes_on & (rest > 0)
        columns[:, place] |= goes_on.astype(np.uint8) << 7
    return base64.b64encode(columns[used].tobytes()).decode("ascii")
