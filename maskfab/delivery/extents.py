"""Extent of everything in a mask file: figures, texts, and the extents stated in a drawing's header."""

from __future__ import annotations

import re
from pathlib import Path

from klayout import db

from maskfab.export.dxf import DrawingStyle
from maskfab.model import Box

_HEADER_BYTES = 1_000_000
_HEADER = re.compile(rb"\$EXTMIN\s+10\s+(\S+)\s+20\s+(\S+)\s.*?\$EXTMAX\s+10\s+(\S+)\s+20\s+(\S+)\s", re.DOTALL)
_BELOW = 0.3
"""Descent of letters below their base line, in their heights."""

_FAR = 2**31 - 1


def file_box(path: Path, read: db.Layout, style: DrawingStyle) -> Box:
    """The bounding box of everything in a file, in nanometres; all 0 if there is nothing.

    A letter is taken to be as wide as it is high, which those of a plain font are not quite.

    Args:
        path: the file.
        read: its content, as :func:`maskfab.readers.layout_file.read_layout` gives it.
        style: in which a drawing was made; its unit is that of the header's extents.
    """
    box = read.top_cell().bbox()
    for index in read.layer_indexes():
        found = read.top_cell().begin_shapes_rec(index)
        found.shape_flags = db.Shapes.STexts
        for each in found.each():
            text = each.shape().text.transformed(each.trans())
            height, x, y = text.size, text.trans.disp.x, text.trans.disp.y
            box += db.Box(x, y - round(_BELOW * height), x + height * len(text.string), y + height)
    if path.suffix == ".dxf":
        box += _of_header(path, style)
    return (0, 0, 0, 0) if box.empty() else (box.left, box.bottom, box.right, box.top)


def _of_header(path: Path, style: DrawingStyle) -> db.Box:
    with path.open("rb") as file:
        said = _HEADER.search(file.read(_HEADER_BYTES))
    if said is None:
        return db.Box()
    try:
        x0, y0, x1, y1 = (round(float(value) / style.length(1)) for value in said.groups())
    except (ValueError, OverflowError):
        return db.Box()
    # Where a layout ends, what reaches further is too far all the same.
    return db.Box(*(max(-_FAR, min(_FAR, value)) for value in (x0, y0, x1, y1)))
