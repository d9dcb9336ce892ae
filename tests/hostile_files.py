"""Layouts of a few bytes that keep a library of polygons busy without end."""

from __future__ import annotations

from pathlib import Path

from klayout import db


def overlapping(path: Path, along: int = 400) -> Path:
    """A few bytes that say one square ``along`` squared times, each nearly upon the last."""
    layout = db.Layout()
    layer, top, cell = layout.layer(1, 0), layout.create_cell("TOP"), layout.create_cell("C")
    cell.shapes(layer).insert(db.Box(0, 0, 5000, 5000))
    top.insert(db.CellInstArray(cell.cell_index(), db.Trans(), db.Vector(7, 3), db.Vector(3, 7), along, along))
    layout.write(str(path))
    return path
