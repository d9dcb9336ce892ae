"""The unit that a DXF was drawn in where it does not say so, or says another.

What is drawn in inches and read in micrometres is rounded to a grid that is 25 400 times too coarse. So it does not do
to scale what was read: the file is read once more, in the unit that makes it as large as the design.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from klayout import db

from maskfab.comparison.foreign.alignment import Alignment, align, likely_unit_scale
from maskfab.model import Plate
from maskfab.readers.layout_file import drawn_unit_um
from maskfab.units import UM_PER_UNIT

_NAMES = {um: unit for unit, um in UM_PER_UNIT.items() if unit.isascii()}


def in_drawn_unit(
    plate: Plate, design: db.Layout, read: db.Layout, alignment: Alignment, again: Callable[[float], db.Layout]
) -> tuple[db.Layout, Alignment]:
    """The file in the unit that it was drawn in, and how it then lies; as they are if that is the one it was read in.

    Args:
        plate: the design, or one die of it.
        design: its layout.
        read: the file, one top cell with the layer CLEAR.
        alignment: how that lies.
        again: reads the file with a stated unit in um.
    """
    unit_um = drawn_unit_um(read)
    if unit_um is None:
        return read, alignment
    scale = likely_unit_scale(alignment, design, read)
    meant = next((name for length, name in _NAMES.items() if abs(unit_um * scale / length - 1) < 1e-9), None)
    if scale == 1 or meant is None:
        return read, alignment
    reread = again(unit_um * scale)
    found = align(plate, design, reread)
    if not found.alike or found.scale != 1:
        return read, alignment
    return reread, replace(found, unit_scale=scale, unit=meant)
