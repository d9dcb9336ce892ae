"""Layers and cells counted in the bytes of a file, before a library reads it that takes long for very many of them.

klayout reads 60 000 layers in 40 s. The counts are those of the patterns that records begin with. What draws its
records in another order is not counted, and is read within the limits of :mod:`maskfab.geometry.bounded`.
"""

from __future__ import annotations

import re
from pathlib import Path

from maskfab.geometry.reading_limits import MOST_CELLS, MOST_LAYERS, too_many_cells, too_many_layers

# LAYER, and the DATATYPE, TEXTTYPE or BOXTYPE that has to follow it.
_LAYER = re.compile(rb"\x00\x06\x0d\x02(..)\x00\x06[\x0e\x16\x2e]\x02(..)", re.DOTALL)
# BGNSTR with its two times, and the STRNAME that has to follow it.
_STRUCTURE = re.compile(rb"\x00\x1c\x05\x02.{24}[\x00-\x7f].\x06\x06", re.DOTALL)
_BLOCK = re.compile(rb"\n[ \t]*0[ \t]*\r?\n[ \t]*BLOCK[ \t]*\r?\n")


def refuse_many_in_gdsii(path: Path) -> None:
    """Refuse a GDSII file of too many layers or structures.

    Raises:
        SourceError: MF313.
    """
    data = path.read_bytes()
    layers = set[tuple[bytes, ...]]()
    for found in _LAYER.finditer(data):
        layers.add(found.groups())
        if len(layers) > MOST_LAYERS:
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


def _more(pattern: re.Pattern[bytes], data: bytes) -> bool:
    """Whether cells begin at more places than there may be cells."""
    return any(count > MOST_CELLS for count, _ in enumerate(pattern.finditer(data), 1))
