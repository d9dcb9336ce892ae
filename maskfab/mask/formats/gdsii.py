"""GDSII and OASIS files, byte-identical between runs.

Layers and cells counted in the bytes of a file, before a library reads it that takes long for very many of them.

klayout reads 60 000 layers in 40 s. The counts are those of the patterns that records begin with. What draws its
records in another order is not counted, and is read within the limits of :mod:`maskfab.mask.sandbox`.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from klayout import db
from numpy.typing import NDArray

from maskfab.base.errors import OutputError
from maskfab.base.files import partial
from maskfab.mask.figures import MAX_VERTICES
from maskfab.mask.layout import MOST_CELLS, MOST_LAYERS, too_many_cells, too_many_layers

_BEGIN, _END, _END_OF_STREAM = b"\x00\x1c\x05\x02", b"\x00\x04\x07\x00", b"\x00\x04\x04\x00"
"""Records of GDSII: length, kind, type of its data. A structure begins with its times and its name."""
_NAME, _NAME_AT = b"\x06\x06", 28


def write_gdsii(layout: db.Layout, path: Path, max_vertices: int = MAX_VERTICES) -> None:
    """Write a layout as GDSII, without time stamps, its cells in the order of their names.

    Args:
        layout: from :func:`maskfab.mask.layout.plate_layout` or
            :meth:`maskfab.mask.figures.Figures.layout`.
        path: the file to write.
        max_vertices: longer polygons, which only a layout from elsewhere has, are split by klayout.

    Raises:
        OutputError: MF401 if the file cannot be written; nothing is left under its name.
    """
    options = db.SaveLayoutOptions()
    options.format = "GDS2"
    options.gds2_write_timestamps = False
    options.gds2_max_vertex_count = max_vertices
    options.gds2_multi_xy_records = False
    _write(_by_name(_content(layout, path, options), layout.cells()), path)


def write_oasis(layout: db.Layout, path: Path) -> None:
    """Write a layout as OASIS, with compressed blocks and the tightest repetitions; raises as :func:`write_gdsii`."""
    options = db.SaveLayoutOptions()
    options.format = "OASIS"
    options.oasis_compression_level = 10
    options.oasis_write_cblocks = True
    _write([_content(layout, path, options)], path)


def _content(layout: db.Layout, path: Path, options: db.SaveLayoutOptions) -> bytes:
    try:
        return bytes(layout.write_bytes(options))
    except RuntimeError as error:
        raise OutputError(
            "MF401", f"{path} cannot be written: {error}", cure="Give --out a writable folder with room to spare"
        ) from error


def _by_name(stream: bytes, cells: int) -> Sequence[bytes | memoryview]:
    """The pieces of a GDSII stream with its structures in the order of their names.

    klayout writes what is placed before what places it; the format asks for no order. A stream that does not fall into
    as many structures as there are cells, for its coordinates happen to look like a border, is left as it is.
    """
    whole, starts = memoryview(stream), [stream.index(_BEGIN)]
    while (border := stream.find(_END + _BEGIN, starts[-1])) >= 0:
        starts.append(border + len(_END))
    names = [_NAME_AT + start for start in starts]
    if len(starts) != cells or not all(stream.startswith(_NAME, at + 2) for at in names):
        return [stream]
    ends = [*starts[1:], len(stream) - len(_END_OF_STREAM)]
    named = sorted(
        (stream[at + 4 : at + int.from_bytes(stream[at : at + 2])], start, end)
        for at, start, end in zip(names, starts, ends, strict=True)
    )
    return [whole[: starts[0]], *(whole[start:end] for _, start, end in named), whole[ends[-1] :]]


def _write(content: Sequence[bytes | memoryview], path: Path) -> None:
    with partial(path) as aside, aside.open("wb") as file:
        file.writelines(content)  # klayout itself would not say that a disk is full


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
