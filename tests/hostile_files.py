"""Layouts of a few bytes that keep a library of polygons busy without end."""

from __future__ import annotations

from pathlib import Path

from klayout import db


def arrayed(path: Path, shape: db.Polygon | db.Box, step: int, along: int, levels: int = 1, degrees: float = 0) -> Path:
    """A shape in arrays of arrays of itself, ``along`` squared at each level; eight arrays lie turned upon each other
    where an angle is given."""
    layout = db.Layout()
    layer, cell = layout.layer(1, 0), layout.create_cell("C0")
    cell.shapes(layer).insert(shape)
    for level in range(levels):
        above = layout.create_cell(f"C{level + 1}")
        for turn in range(8 if degrees else 1):
            at = db.ICplxTrans(1.0, degrees * turn, False, turn, turn)
            steps = db.Vector(step, 0), db.Vector(0, step)
            above.insert(db.CellInstArray(cell.cell_index(), at if turn else db.Trans(), *steps, along, along))
        cell, step = above, step * along
    layout.write(str(path))
    return path


def overlapping(path: Path, along: int = 400) -> Path:
    """A few bytes that say one square ``along`` squared times, each nearly upon the last."""
    layout = db.Layout()
    layer, top, cell = layout.layer(1, 0), layout.create_cell("TOP"), layout.create_cell("C")
    cell.shapes(layer).insert(db.Box(0, 0, 5000, 5000))
    top.insert(db.CellInstArray(cell.cell_index(), db.Trans(), db.Vector(7, 3), db.Vector(3, 7), along, along))
    layout.write(str(path))
    return path
