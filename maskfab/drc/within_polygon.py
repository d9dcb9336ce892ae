"""Widths and notches: rules within one polygon, checked once on every distinct polygon of a panel."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from maskfab.base.arrays import Ints
from maskfab.drc.canvas import Canvas, Facing, together
from maskfab.drc.cells import PanelCells
from maskfab.drc.islands import Islands, Parts
from maskfab.drc.results import Found, Repeated, joined
from maskfab.drc.rules import Check

Drawing = list[tuple[int, int, int]]


def within_polygons(
    cells: PanelCells, islands: Islands, checks: Sequence[Check], reach_nm: int, most: int
) -> tuple[Found, ...]:
    """Violations of rules that look at one clear polygon at a time, one result for each check.

    Polygons that reach over several cells are told apart by the parts they are composed of; those of one composition
    are checked once. The work grows with the number of compositions, so with the panel only where clear shapes
    percolate through it.

    Args:
        cells: the panel's cells.
        islands: its clear islands.
        checks: what to run on merged polygons.
        reach_nm: no check looks further.
        most: how many violations are placed.
    """
    parts = islands.parts
    singles = _checked(cells, parts, [[(part, 0, 0)] for part in range(len(parts.owners))], checks, reach_nm)
    compositions, items, homes = _compositions(cells, islands)
    several = _checked(cells, parts, compositions, checks, reach_nm)
    alone = islands.nodes[islands.alone], cells.origins_nm[islands.cells[islands.alone]]
    results = []
    for single, composed in zip(singles, several, strict=True):
        inside = parts.inner[single.items]
        own, rim = single.chosen(inside), single.chosen(~inside)
        found = [
            Repeated(cells.codes.ravel(), cells.origins_nm, parts.owners[own.items], own.boxes_nm, own.values),
            Repeated(*alone, rim.items, rim.boxes_nm, rim.values),
            Repeated(items, cells.origins_nm[homes], composed.items, composed.boxes_nm, composed.values),
        ]
        results.append(joined([each.found(most) for each in found], most))
    return tuple(results)


def _compositions(cells: PanelCells, islands: Islands) -> tuple[list[Drawing], Ints, Ints]:
    """Distinct polygons of several parts, placed from their first cell; which of them occur, and in which cell."""
    drawings: list[Drawing] = []
    items, homes = [np.zeros(0, dtype=np.int64)], [np.zeros(0, dtype=np.int64)]
    order, starts = islands.joined
    nodes, cell = islands.nodes[order], islands.cells[order]
    columns = cells.codes.shape[1]
    sizes = np.diff(np.append(starts, order.size))
    # A part beside the first is known by its number and its step to there, in one integer.
    reach, pitch = 2 * columns, cells.panel.pitch_nm
    kinds = len(islands.parts.owners)
    for size in np.unique(sizes).tolist():
        members = starts[sizes == size][:, None] + np.arange(size)
        first = cell[members[:, 0]]
        up = cell[members] // columns - (first // columns)[:, None]
        across = cell[members] % columns - (first % columns)[:, None] + columns
        distinct, which = _distinct((up * reach + across) * kinds + nodes[members])
        items.append(which + len(drawings))
        homes.append(first)
        for row in distinct.tolist():
            places = [divmod(key, kinds) for key in row]
            drawings.append([(p, (at % reach - columns) * pitch, at // reach * pitch) for at, p in places])
    return drawings, np.concatenate(items), np.concatenate(homes)


def _distinct(rows: Ints) -> tuple[Ints, Ints]:
    """Distinct rows of an array, and which of them each row is."""
    span = int(rows.max()) + 1
    packed = rows
    if rows.shape[1] * np.log2(span) < 62:
        packed = rows @ (span ** np.arange(rows.shape[1], dtype=np.int64))[:, None]
    # Rows that are compared as bytes sort several times faster than rows of numbers.
    whole = np.ascontiguousarray(packed).view(np.dtype((np.void, packed[0].nbytes))).ravel()
    _, chosen, which = np.unique(
        packed[:, 0] if packed.shape[1] == 1 else whole, return_index=True, return_inverse=True
    )
    return rows[chosen], which


def _checked(
    cells: PanelCells, parts: Parts, drawings: list[Drawing], checks: Sequence[Check], reach_nm: int
) -> list[Facing]:
    sizes = np.array([max(max(abs(x), abs(y)) for _, x, y in drawing) for drawing in drawings], dtype=np.int64)
    # Drawings of one size share a sheet: the largest decides how far apart they lie.
    classes = np.ceil(np.log2(sizes + cells.panel.pitch_nm)).astype(np.int64)
    found: list[list[Facing]] = [[] for _ in checks]
    regions = {part: region for labels in parts.labels for part, region in cells.regions(labels).items()}
    for size in np.unique(classes).tolist():
        members = np.flatnonzero(classes == size)
        canvas = Canvas(2**size, reach_nm)
        used = {part for member in members.tolist() for part, _, _ in drawings[member]}
        pieces = {part: canvas.piece(regions[part]) for part in sorted(used)}
        sheet = [[(pieces[part], x, y) for part, x, y in drawings[member]] for member in members.tolist()]
        for each, facing in zip(found, canvas.check(sheet, checks), strict=True):
            each.append(Facing(members[facing.items], facing.points, facing.boxes_nm, facing.values))
    return [together(each) for each in found]
