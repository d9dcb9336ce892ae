"""Openings on a hexagonal lattice, each turned by a multiple of 60 degrees: one sheet of dots for a whole panel.

Turns by 60 degrees do not carry a square grid of dots into itself, so the sheet is sampled: a dot is clear where its
middle, carried back into the unit, falls on a clear dot. Edges that lie off the grid move by up to half a dot, and the
clear area of a cell changes by a few dots from turn to turn.
"""

from __future__ import annotations

import math

import numpy as np

from maskfab.model import Opening

TURNS = 6


def hexagonal_sheet(opening: Opening, dots: int, seed: int) -> Opening:
    """A square sheet of hexagonal cells as one opening.

    Cells are as wide from flat to flat as the opening; rows are sqrt(3)/2 of that apart, every other one shifted by
    half a cell. A dot belongs to the nearest cell's centre; what the unit has outside the hexagon is never seen.

    Args:
        opening: the unit.
        dots: along a side of the sheet.
        seed: of ``numpy.random.default_rng``, which draws every cell's turn.
    """
    width = opening.dots
    rise = width * math.sqrt(3) / 2
    rows, columns = math.ceil(dots / rise) + 3, math.ceil(dots / width) + 3
    turn = np.random.default_rng(seed).integers(TURNS, size=(rows, columns))
    middle = np.arange(dots) + 0.5 - dots / 2
    x, y = np.broadcast_to(middle, (dots, dots)), np.broadcast_to(middle[:, None], (dots, dots))
    best = np.full((dots, dots), np.inf)
    right, up, cell_turn = (np.zeros((dots, dots)) for _ in range(3))
    # The nearest centre is in the row below or above a dot.
    below = np.floor(y / rise)
    for row in (below, below + 1):
        shift = width / 2 * (row % 2)
        column = np.rint((x - shift) / width)
        away_x, away_y = x - shift - column * width, y - row * rise
        distance = away_x**2 + away_y**2
        nearer = distance < best
        best[nearer] = distance[nearer]
        chosen = turn[(row.astype(int) + rows // 2) % rows, (column.astype(int) + columns // 2) % columns]
        for kept, found in ((right, away_x), (up, away_y), (cell_turn, chosen)):
            kept[nearer] = found[nearer]
    angle = -np.pi / 3 * cell_turn
    unit_x = np.floor(right * np.cos(angle) - up * np.sin(angle) + width / 2).astype(int)
    unit_y = np.floor(right * np.sin(angle) + up * np.cos(angle) + width / 2).astype(int)
    inside = (unit_x >= 0) & (unit_x < width) & (unit_y >= 0) & (unit_y < width)
    mask = np.zeros((dots, dots), dtype=np.bool_)
    mask[inside] = opening.mask[unit_y[inside], unit_x[inside]]
    provenance = {**opening.provenance, "sheet": f"hexagonal lattice, seed {seed}"}
    return Opening(f"{opening.name[:18]}_HEX", mask, opening.dot_nm, provenance)
