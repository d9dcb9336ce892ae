"""Written solids against the die they were written from, with the openings and orientations themselves.

In STEP: which cells a file places, where, and what each is made of. In a mesh: whether the film is closed, which dots
both of its faces cover, and where its walls stand. In both: how much of it there is, and refusals of damaged files.
"""

from __future__ import annotations

import math
import os
from collections.abc import Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np
from klayout import db

from maskfab.base.arrays import Floats, Ints, Mask
from maskfab.base.errors import SourceError
from maskfab.base.model import Die, Quantity
from maskfab.mask.dots import die_edges_nm, die_raster
from maskfab.mask.formats.format import Stack
from maskfab.mask.formats.solid import centres_nm, glass
from maskfab.mask.formats.step_process import ReadShape, ReadSolid
from maskfab.mask.raster import coverage, outline_coverage

NM = 1.0
"""Positions must be right to this much."""

_FARTHEST_NM = 1e10

OCP = "parsed and translated by OCP"
_READERS = {".3mf": "read by numpy and lxml"}
_TRIMESH = "read by trimesh"

_TORN = 1e-6
"""A dot may be covered by this much less than wholly, for the rounding of sums."""

_VOLUME_LIMIT = {".step": 1e-9, ".glb": 1e-6, ".3mf": 1e-9, ".stl": 1e-4}
"""Relative; GLB rounds vertices of large dies to float32, STL those of all."""


def check_file(path: Path) -> None:
    """Refuse a file that is missing (MF301) or empty (MF302)."""
    if not os.path.isfile(path):
        what = f"there is no file {path}"
        raise SourceError("MF301", what, where=str(path), cure="Run the job with that format in export.formats")
    if path.stat().st_size == 0:
        raise SourceError("MF302", f"{path.name} is empty", where=str(path), cure="Run the job again to rewrite it")


def damaged(path: Path, why: object) -> SourceError:
    """The error for a file that its reader refuses."""
    what = f"{path.name} cannot be read: {why}"
    return SourceError("MF303", what, where=str(path), cure="Run the job again to rewrite it")


def check_reach(path: Path, *lengths_nm: Floats) -> None:
    """Refuse coordinates that are not finite or farther than 10 m away (MF303), before arithmetic on them warns."""
    for values in lengths_nm:
        farthest = float(np.abs(values).max(initial=0.0))
        if not farthest <= _FARTHEST_NM:
            raise damaged(path, f"it has a coordinate of {farthest / 1e6:g} mm; the limit is {_FARTHEST_NM / 1e6:g} mm")


class _Kind(NamedTuple):
    """Placements of one shape in one orientation: which, int64 [n], and its vertices turned but not moved, [m, 3]."""

    shape: ReadShape
    members: Ints
    vertices_nm: Floats


def _kinds(read: ReadSolid) -> Iterator[_Kind]:
    keys = np.column_stack([read.index, read.turns.reshape(-1, 9).round(6)])
    _, first, inverse = np.unique(keys, axis=0, return_index=True, return_inverse=True)
    for n, one in enumerate(first):
        shape = read.shapes[read.index[one]]
        yield _Kind(shape, np.flatnonzero(inverse.ravel() == n), shape.vertices_nm @ read.turns[one].T)


def step_rows(die: Die, path: Path, stack: Stack, read: ReadSolid) -> Iterator[Quantity]:
    """Rows that hold a STEP file against its die.

    Yields:
        Rows that pass or fail: ``solid_instances`` (films placed), ``solid_wrong_cells`` (cells that are missing,
        placed twice, or whose film is not their opening's, dot by dot), ``solid_position_error`` and
        ``solid_vertex_error`` (nm), ``solid_volume_error`` (relative), ``solid_flaws`` (shapes that are not valid or
        not closed) and ``solid_glass_error`` (nm, corners of the substrate).
    """
    panel = die.panel
    rows, columns = panel.orientations.shape
    kinds = list(_kinds(read))
    # The film lies on both sides of z = 0, the glass below it altogether.
    below = [bool((kind.vertices_nm[:, 2].max() + read.places_nm[kind.members, 2] < 0).all()) for kind in kinds]
    films = [kind for kind, is_glass in zip(kinds, below, strict=True) if not is_glass]
    glasses = [
        kind.vertices_nm + place
        for kind, is_glass in zip(kinds, below, strict=True)
        for place in (read.places_nm[kind.members] if is_glass else ())
    ]

    centres = centres_nm(die)
    held = np.zeros((rows, columns), dtype=np.int64)
    right = np.zeros((rows, columns), dtype=np.bool_)
    place_error = vertex_error = 0.0
    for kind in films:
        places = read.places_nm[kind.members]
        cells = np.rint((places[:, :2] - centres[0, 0]) / panel.pitch_nm).astype(np.int64)
        column, row = np.clip(cells, 0, [columns - 1, rows - 1]).T
        ideal = np.column_stack([centres[row, column], np.zeros(len(row))])
        place_error = max(place_error, float(np.abs(places - ideal).max()))
        chrome, off = _chrome(die, stack, kind)
        vertex_error = max(vertex_error, off)
        np.add.at(held, (row, column), 1)
        for cell in np.unique(panel.orientations[row, column]).tolist():
            same = panel.orientations[row, column] == cell
            expected = np.pad(~panel.pattern(cell), 1 if panel.gutter_nm else 0, constant_values=True)
            right[row[same], column[same]] = np.array_equal(chrome, expected)
    wrong = int(np.count_nonzero((held != 1) | ~right))
    volume = sum(len(kind.members) * kind.shape.volume_nm3 for kind in films)
    row_of = partial(_row, die, f"in {path.name}, {OCP}")
    count, flaws = int(sum(len(kind.members) for kind in films)), sum(not shape.sound for shape in read.shapes)
    yield row_of("solid_instances", count, "films placed", rows * columns, count == rows * columns)
    yield row_of("solid_wrong_cells", wrong, "cells without exactly one film of their opening", 0)
    yield row_of("solid_position_error", place_error, "films off their cells' centres", NM)
    yield row_of("solid_vertex_error", vertex_error, "vertices off the borders of dots and film", NM)
    error = abs(volume / (_chrome_nm2(die) * stack.film_nm) - 1)
    yield row_of("solid_volume_error", error, "volume of chrome against the openings", _VOLUME_LIMIT[path.suffix])
    yield row_of("solid_flaws", flaws, "shapes that are not closed and valid by BRepCheck", 0)
    gap = _glass_error(die, stack, glasses)
    yield row_of("solid_glass_error", gap, "corners of the glass off the panel's", NM)


def mesh_rows(die: Die, path: Path, stack: Stack, read: ReadSolid) -> Iterator[Quantity]:
    """Rows that hold a mesh against its die: as :func:`step_rows`, but for positions, with one film of all cells.

    Besides them ``solid_pieces`` (closed surfaces of the film); STL has no glass.
    """
    from scipy import ndimage, sparse
    from scipy.sparse import csgraph

    placed = [
        (read.shapes[number], turn, read.shapes[number].vertices_nm @ turn.T + place)
        for number, turn, place in zip(read.index, read.turns, read.places_nm, strict=True)
    ]
    glasses = [vertices for _, _, vertices in placed if (vertices[:, 2] < 0).all()]
    films = [remark for remark in placed if not (remark[2][:, 2] < 0).all()]
    grid = [line - middle for line, middle in zip(die_edges_nm(die), die.centre_nm, strict=True)]
    touches = int(np.count_nonzero(_touches(die)))
    leg = stack.corner_leg_nm(die) if touches else 0
    # Of float32, millimetres in STL and nanometres in GLB.
    rounded_nm = float(np.spacing(np.float32(max(die.panel.size_nm) / 2 * 1e-6))) * 1e6
    vertex_limit, dot_nm = max(NM, rounded_nm), die.panel.dot_nm
    expected = _shares(die, stack, leg)
    wrong, vertex_error, pieces = np.ones(expected.shape, dtype=np.bool_), math.inf, 0
    if len(films) == 1:
        ((shape, _, vertices),) = films
        triangles = shape.triangles
        z = vertices[:, 2]
        vertex_error = float(np.abs(np.abs(z) - stack.film_nm / 2).max())
        faces = (triangles[(z[triangles] > 0).all(axis=1)], triangles[(z[triangles] < 0).all(axis=1), ::-1])
        wrong[:] = False
        for face in faces:
            edges = _rim(vertices, face)
            vertex_error = max(vertex_error, _off_lines(edges, grid, leg))
            shares = outline_coverage(edges, *grid) if len(edges) else np.zeros(expected.shape)
            wrong |= np.abs(shares - expected) > max(_TORN, 4 * vertex_limit / dot_nm)
        del faces, face
        start, end = (triangles[:, n : n + 2].astype(np.int32).ravel() for n in (0, 1))
        links = sparse.coo_array((np.ones(len(start)), (start, end)), (len(vertices),) * 2)
        del start, end
        pieces = int(csgraph.connected_components(links, directed=False, return_labels=False))
    side = len(die.panel.cell_size.edges_nm) - 1
    rows, columns = die.panel.orientations.shape
    cells = int(np.count_nonzero(wrong.reshape(rows, side, columns, side).any(axis=(1, 3))))
    # Chrome that meets by a corner is one piece where a gap parts the openings there.
    design = int(ndimage.label(~die_raster(die), np.ones((3, 3)) if stack.corners == "gap" else None)[1])
    volume = sum(shape.volume_nm3 * float(np.linalg.det(turn)) for shape, turn, _ in films)
    chrome = _chrome_nm2(die) + touches * leg**2 * (1 if stack.corners == "gap" else -1)
    row_of = partial(_row, die, f"in {path.name}, {_READERS.get(path.suffix, _TRIMESH)}")
    remarks = "".join(f" ({remark})" for remark in stack.touching_remark(die, touches))
    flaws = sum(not shape.sound for shape in read.shapes)
    yield row_of("solid_instances", len(films), "films placed", 1, len(films) == 1)
    yield row_of("solid_pieces", pieces, "closed surfaces of the film", design, pieces == design)
    yield row_of("solid_wrong_cells", cells, f"cells whose film is not their opening's{remarks}", 0)
    yield row_of(
        "solid_vertex_error", vertex_error, "walls off the borders of dots, faces off the film's", vertex_limit
    )
    error = abs(volume / (chrome * stack.film_nm) - 1)
    yield row_of(
        "solid_volume_error", error, f"volume of chrome against the openings{remarks}", _VOLUME_LIMIT[path.suffix]
    )
    yield row_of("solid_flaws", flaws, "shapes with a side that has not two faces, or a vertex of several fans", 0)
    if path.suffix != ".stl":
        gap = _glass_error(die, stack, glasses)
        yield row_of("solid_glass_error", gap, "corners of the glass off the panel's", NM)


def _row(
    die: Die, read: str, name: str, value: float, method: str, limit: float, passed: bool | None = None
) -> Quantity:
    return Quantity(
        name, value, f"{method} {read}", limit=limit, passed=value <= limit if passed is None else passed, die=die.name
    )


def _chrome_nm2(die: Die) -> int:
    panel = die.panel
    cells, counts = np.unique(panel.orientations, return_counts=True)
    clear = sum(
        int(np.count_nonzero(panel.pattern(cell))) * n for cell, n in zip(cells.tolist(), counts.tolist(), strict=True)
    )
    return int(panel.orientations.size * panel.pitch_nm**2 - clear * panel.dot_nm**2)


def _touches(die: Die) -> Mask:
    """Corners of the grid, its rim left out, at which two openings touch."""
    clear = die_raster(die)
    low, left = clear[:-1, :-1], clear[1:, :-1]
    touching: Mask = (low == clear[1:, 1:]) & (left == clear[:-1, 1:]) & (low != left)
    return touching


def _shares(die: Die, stack: Stack, leg: int) -> Floats:
    """Share of every dot and gutter of a die that is chrome, [y, x], the gaps or necks of touching corners included."""
    clear, touches = die_raster(die), _touches(die)
    shares = (~clear).astype(np.float64)
    changed = (leg / die.panel.dot_nm) ** 2 / 2 * (1 if stack.corners == "gap" else -1)
    for y in (slice(None, -1), slice(1, None)):
        for x in (slice(None, -1), slice(1, None)):
            shares[y, x] += changed * (touches & (clear[y, x] == (stack.corners == "gap")))
    return shares


def _rim(vertices: Floats, triangles: Ints) -> Floats:
    """Sides of one triangle alone, what is covered on the left of each: float64 [n, 4] of x0, y0, x1, y1."""
    start, end = triangles.ravel(), np.roll(triangles, -1, axis=1).ravel()
    sides, turned = start * len(vertices) + end, np.sort(end * len(vertices) + start)
    order = np.argsort(sides)
    sides = sides[order]
    alone = np.empty(len(sides), dtype=np.bool_)
    alone[order] = np.append(turned, -1)[np.searchsorted(turned, sides)] != sides
    return np.column_stack([vertices[start[alone], :2], vertices[end[alone], :2]])


def _off_lines(edges: Floats, grid: Sequence[Floats], leg: int) -> float:
    """Largest distance of edges from the lines of a grid, or from the ends of its gaps and necks, in nanometres."""
    start, end = edges[:, :2], edges[:, 2:]
    near = np.stack([line[_nearest_line(line, edges[:, n::2])] for n, line in enumerate(grid)], axis=-1)
    away = np.abs(edges.reshape(-1, 2, 2) - near).max(axis=1)
    run = np.abs(end - start)
    slanted = run.min(axis=1) > run.max(axis=1) / 2
    # An edge along x may end anywhere on its line, a slanted one only where the design has it end.
    along = np.where(run[:, 0] > run[:, 1], away[:, 1], away[:, 0])
    ends = np.sort(np.abs(edges.reshape(-1, 2, 2) - near), axis=2)
    across = np.maximum(ends[..., 0], np.abs(ends[..., 1] - leg)).max(axis=1)
    return float(np.where(slanted, across, along).max(initial=0.0))


def _chrome(die: Die, stack: Stack, kind: _Kind) -> tuple[Mask, float]:
    """Which dots and gutters of a cell a film covers whole, bool [y, x], and how far its vertices are off (nm).

    A dot covered in part is reported as the opposite of what its middle shows, so that it matches no opening.
    """
    panel = die.panel
    lines, half = panel.cell_size.edges_nm.astype(np.float64) - panel.pitch_nm / 2, stack.film_nm / 2
    flat, z = kind.vertices_nm[:, :2], kind.vertices_nm[:, 2]
    at = _nearest_line(lines, flat)
    off = max(float(np.abs(lines[at] - flat).max()), float(np.abs(np.abs(z) - half).max()))
    upper = (z[kind.shape.triangles] > 0).all(axis=1)
    region = db.Region()
    for corners in at[kind.shape.triangles[upper]].tolist():
        region.insert(db.Polygon([db.Point(x, y) for x, y in corners], True))
    grid = np.arange(len(lines), dtype=np.float64)
    share = coverage(region.merged(True, 0), grid, grid)
    whole = share > 0.5
    torn = np.abs(share - whole) > _TORN
    return whole ^ torn, off


def _nearest_line(lines: Floats, values: Floats) -> Ints:
    """Index of the line nearest to each value."""
    return np.searchsorted((lines[1:] + lines[:-1]) / 2, values).astype(np.int64)


def _glass_error(die: Die, stack: Stack, glasses: Sequence[Floats]) -> float:
    """Distance of the substrate's corners from the design's, the largest of all coordinates; inf for none or many."""
    if len(glasses) != 1:
        return math.inf
    low, high = glass(die, stack)
    return float(max(np.abs(glasses[0].min(axis=0) - low).max(), np.abs(glasses[0].max(axis=0) - high).max()))
