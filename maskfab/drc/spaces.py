"""Spaces between clear edges, found once in each distinct neighbourhood of a panel."""

from __future__ import annotations

from collections.abc import Iterator

from klayout import db

from maskfab.drc.canvas import Canvas
from maskfab.drc.cells import PanelCells
from maskfab.drc.klayout_checks import Check
from maskfab.drc.results import Found, Repeated, joined
from maskfab.drc.windows import Windows, windows
from maskfab.model import Box


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
