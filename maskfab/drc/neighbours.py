"""The distinct neighbourhoods of a panel, each checked once: spaces between clear edges, and corners that kiss."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from klayout import db
from numpy.typing import NDArray

from maskfab.base.arrays import Ints
from maskfab.drc.canvas import Canvas
from maskfab.drc.cells import PanelCells
from maskfab.drc.results import Found, Repeated, joined
from maskfab.drc.rules import Check
from maskfab.model import Box

Bools = NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class Windows:
    """Neighbourhoods of one shape.

    Attributes:
        codes: int64 [n, cells], what the distinct ones hold, row by row from the lowest; -1 lies beyond the panel.
        offsets_nm: int64 [cells, 2], lower left corners of the cells from the neighbourhood's origin, which is the
            corner (or side's lower or left end) that its last cell begins at.
        items: int64 [m], which of them every occurrence is.
        origins_nm: int64 [m, 2], where, from the panel's lower left corner.
    """

    codes: Ints
    offsets_nm: Ints
    items: Ints
    origins_nm: Ints


def windows(cells: PanelCells, across: int, up: int) -> Windows:
    """All neighbourhoods of ``across`` x ``up`` cells, each 1 or 2, those that hang over the panel's rim included."""
    pitch, kinds = cells.panel.pitch_nm, len(cells.held) + 1
    padded = np.pad(cells.codes, ((up - 1, up - 1), (across - 1, across - 1)), constant_values=-1)
    rows, columns = padded.shape[0] - up + 1, padded.shape[1] - across + 1
    views = [padded[y : y + rows, x : x + columns].ravel() for y in range(up) for x in range(across)]
    key = np.zeros(rows * columns, dtype=np.int64)
    for view in views:
        key = key * kinds + view + 1
    distinct, items = np.unique(key, return_inverse=True)
    codes = np.stack([distinct // kinds**power % kinds - 1 for power in range(len(views) - 1, -1, -1)], axis=1)
    offsets = [((x - across + 1) * pitch, (y - up + 1) * pitch) for y in range(up) for x in range(across)]
    row, column = np.indices((rows, columns)).reshape(2, -1)
    return Windows(codes, np.array(offsets, dtype=np.int64), items, np.stack([column, row], axis=1) * pitch)


def fits_windows(cells: PanelCells, limit_nm: int) -> bool:
    """Whether the rule is short enough for its neighbourhoods to be at most two cells wide."""
    return limit_nm <= cells.panel.gutter_nm or 2 * (limit_nm + 1) <= cells.panel.pitch_nm


def narrow_spaces(cells: PanelCells, limit_nm: int, check: Check, most: int) -> Found:
    """Pairs of clear edges with less chrome between them than a limit, of one polygon or of two.

    Where edges face each other depends on what lies within the limit of that place. A pair belongs to the
    neighbourhood round its lowest endpoint: to a cell, if that lies deep enough in it; else to the cells on both sides
    of a border, or round a corner. Each neighbourhood is drawn so much larger that its own clipped sides do not
    matter. See :func:`fits_windows` for the limits that this can do.
    """
    pitch, margin = cells.panel.pitch_nm, limit_nm + 1
    if limit_nm <= cells.panel.gutter_nm:
        return _found(cells, windows(cells, 1, 1), (0, 0, pitch, pitch), limit_nm, check, 0, most)
    inner = (margin, pitch - margin)
    parts = []
    for across, up in ((1, 1), (2, 1), (1, 2), (2, 2)):
        x = inner if across == 1 else (-margin, margin)
        y = inner if up == 1 else (-margin, margin)
        core = (x[0], y[0], x[1], y[1])
        parts.append(_found(cells, windows(cells, across, up), core, limit_nm, check, margin, most))
    return joined(parts, most)


def _found(cells: PanelCells, seen: Windows, core: Box, limit_nm: int, check: Check, margin: int, most: int) -> Found:
    x0, y0, x1, y1 = core
    clip = db.Box(x0 - margin, y0 - margin, x1 + margin, y1 + margin)
    canvas = Canvas(cells.panel.pitch_nm, limit_nm)
    offsets = seen.offsets_nm.tolist()
    wholes = [cells.region(raster) for raster in cells.clear]
    pieces = [[canvas.piece(whole & db.Region(clip.moved(-x, -y))) for whole in wholes] for x, y in offsets]
    drawings = [list(_placed(codes, offsets, pieces)) for codes in seen.codes.tolist()]
    (facing,) = canvas.check(drawings, [check])
    x, y = facing.points.T
    facing = facing.chosen((x >= x0) & (x < x1) & (y >= y0) & (y < y1))
    repeated = Repeated(seen.items, seen.origins_nm, facing.items, facing.boxes_nm, facing.values)
    return repeated.found(most)


def _placed(codes: list[int], offsets: list[list[int]], pieces: list[list[int]]) -> Iterator[tuple[int, int, int]]:
    for code, (x, y), options in zip(codes, offsets, pieces, strict=True):
        if code >= 0:
            yield options[code], x, y


def kissing_corners(cells: PanelCells, most: int) -> Found:
    """Vertices at which exactly two of the four dots are clear, and these lie on a diagonal; neighbours included."""
    clear, edges = cells.clear, cells.edges_nm
    held = np.pad(clear, ((1, 0), (0, 0), (0, 0)))
    parts = []
    within = windows(cells, 1, 1)
    n, y, x = np.nonzero(_kissing(clear[:, :-1, :-1], clear[:, :-1, 1:], clear[:, 1:, :-1], clear[:, 1:, 1:]))
    order = np.argsort(within.codes[:, 0])
    parts.append(_repeated(within, order[n], edges[x + 1], edges[y + 1]))
    beside = windows(cells, 2, 1)
    left, right = held[beside.codes[:, 0] + 1, :, -1], held[beside.codes[:, 1] + 1, :, 0]
    n, y = np.nonzero(_kissing(left[:, :-1], right[:, :-1], left[:, 1:], right[:, 1:]))
    parts.append(_repeated(beside, n, np.zeros_like(y), edges[y + 1]))
    above = windows(cells, 1, 2)
    low, high = held[above.codes[:, 0] + 1, -1], held[above.codes[:, 1] + 1, 0]
    n, x = np.nonzero(_kissing(low[:, :-1], low[:, 1:], high[:, :-1], high[:, 1:]))
    parts.append(_repeated(above, n, edges[x + 1], np.zeros_like(x)))
    fours = windows(cells, 2, 2)
    codes = fours.codes.T + 1
    corner = _kissing(held[codes[0], -1, -1], held[codes[1], -1, 0], held[codes[2], 0, -1], held[codes[3], 0, 0])
    (n,) = np.nonzero(corner)
    parts.append(_repeated(fours, n, np.zeros_like(n), np.zeros_like(n)))
    return joined([part.found(most) for part in parts], most)


def _kissing(lower_left: Bools, lower_right: Bools, upper_left: Bools, upper_right: Bools) -> Bools:
    rising = lower_left & upper_right & ~lower_right & ~upper_left
    return rising | (lower_right & upper_left & ~lower_left & ~upper_right)


def _repeated(seen: Windows, owners: Ints, x: Ints, y: Ints) -> Repeated:
    return Repeated(seen.items, seen.origins_nm, owners, np.stack([x, y, x, y], axis=1), np.zeros(len(owners)))
