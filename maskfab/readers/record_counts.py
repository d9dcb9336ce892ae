"""Layers and cells counted in the bytes of a file, before a library reads it that takes long for very many of them.

klayout reads 60 000 layers in 40 s. The counts are those of the patterns that records begin with. What draws its
records in another order is not counted, and is read within the limits of :mod:`maskfab.readers.sandbox.bounded`.
"""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from maskfab.geometry.shape_limits import MOST_CELLS, MOST_LAYERS, too_many_cells, too_many_layers

# LAYER, and the DATATYPE, TEXTTYPE or BOXTYPE that has to follow it, by their bytes; -1 where their numbers stand.
_LAYER = [0, 6, 0x0D, 2, -1, -1, 0, 6, -1, 2, -1, -1]
_NUMBERS = [4, 5, 10, 11]
_KIND, _KINDS = 8, [0x0E, 0x16, 0x2E]
# BGNSTR with its two times, and the STRNAME that has to follow it.
_STRUCTURE = re.compile(rb"\x00\x1c\x05\x02.{24}[\x00-\x7f].\x06\x06", re.DOTALL)
_BLOCK = re.compile(rb"\n[ \t]*0[ \t]*\r?\n[ \t]*BLOCK[ \t]*\r?\n")


def refuse_many_in_gdsii(path: Path) -> None:
    """Refuse a GDSII file of too many layers or structures.

    Raises:
        SourceError: MF313.
    """
    data = path.read_bytes()
    if _layers(np.frombuffer(data, dtype=np.uint8)) > MOST_LAYERS:
        raise too_many_layers(path)
    if _more(_STRUCTURE, data):
        raise too_many_cells(path)


def refuse_many_blocks(path: Path, data: bytes) -> None:
    """Refuse a text DXF of too many blocks.

    Raises:
        SourceError: MF313.
    """
    if _more(_BLOCK, data):
        raise too_many_cells(path)


def _layers(data: NDArray[np.uint8]) -> int:
    """Number of distinct pairs of layer and datatype in the records."""
    # The rarest byte first: of what is left to look at it leaves least.
    places = np.flatnonzero(data[2 : max(2, len(data) - len(_LAYER) + 3)] == _LAYER[2])
    for place, byte in enumerate(_LAYER):
        if byte >= 0:
            places = places[data[places + place] == byte]
    places = places[np.isin(data[places + _KIND], _KINDS)]
    pairs = data[places[:, None] + np.array(_NUMBERS)]
    return int(np.unique(np.ascontiguousarray(pairs).view(np.uint32)).size)


def _more(pattern: re.Pattern[bytes], data: bytes) -> bool:
    """Whether cells begin at more places than there may be cells."""
    return any(count > MOST_CELLS for count, _ in enumerate(pattern.finditer(data), 1))
