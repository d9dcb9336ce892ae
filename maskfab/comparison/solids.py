"""Written solids against the die they were written from.

A file is read by a library that did not write it, and compared with the openings and orientations themselves: which
cells it places, where, what each is made of, and how much of it there is.
"""

from __future__ import annotations

import math
import os
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from klayout import db
from numpy.typing import NDArray

from maskfab.errors import SourceError
from maskfab.export.solid.tiles import Stack, centres_nm, glass
from maskfab.geometry.plate_layout import coverage
from maskfab.model import Die, Panel, Plate, Quantity
from maskfab.readers.mesh import Floats, Ints, ReadShape, ReadSolid, nearest_line, read_scene, read_stl, unit_lines_nm
from maskfab.readers.step import read_step

_NM = 1.0
"""Positions must be right to this much."""

OCP = "parsed and translated by OCP"
TRIMESH = "read by trimesh"

_TORN = 1e-6
"""A dot may be covered by this much less than wholly, for the rounding of sums."""

_VOLUME_LIMIT = {".step": 1e-9, ".glb": 1e-6, ".3mf": 1e-9, ".stl": 1e-4}
"""Relative; GLB rounds vertices to float32 within a cell, STL within the die."""


def check_solid(die: Die, path: Path, stack: Stack | None = None) -> tuple[Quantity, ...]:
    """Read a die's STEP, GLB, 3MF or STL file back and compare it with the design.

    Args:
        die: what was to be written.
        path: the file, by its suffix.
        stack: the thicknesses it was written with.

    Returns:
        Rows that pass or fail: ``solid_instances`` (cells placed), ``solid_wrong_cells`` (cells that are missing,
        placed twice, or whose film is not their opening's, dot by dot), ``solid_position_error`` and
        ``solid_vertex_error`` (nm), ``solid_volume_error`` (relative), ``solid_flaws`` (shapes that are not valid or
        not watertight), and ``solid_glass_error`` (nm, corners of the substrate; not for STL, which has none).

    Raises:
        SourceError: MF301 if there is no such file, MF302 if it is empty, MF303 if it cannot be read, MF308 for
            another suffix.
    """
    stack = stack or Stack()
    read, how = _read(die, path)
    return tuple(_quantities(die, path, stack, read, how))


def check_plate_solid(plate: Plate, path: Path) -> tuple[Quantity, ...]:
    """Read a plate's STEP file back: as many boxes as dies, under their names, where and as large as the dies are.

    Raises:
        SourceError: as :func:`check_solid`.
    """
    _check_file(path)
    read, placed = read_step(path)
    dies = {die.name: die for die in plate.dies}
    found = [(name, each) for each in placed if (name := each.name) != "BLANK"]
    error = 0.0
    for name, each in found:
        if name in dies:
            corners = read.shapes[each.part].vertices_nm @ each.matrix[:3, :3].T + each.matrix[:3, 3]
            box = np.concatenate([corners.min(axis=0)[:2], corners.max(axis=0)[:2]])
            error = max(error, float(np.abs(box - dies[name].box_nm).max()))
    named = len({name for name, _ in found} & dies.keys())
    method = f"{path.name}, {OCP}"
    flaws = sum(not shape.sound for shape in read.shapes)
    counts = (
        Quantity("solid_dies", named, f"boxes under a die's name in {method}", limit=len(dies)),
        Quantity("solid_strangers", len(found) - named, f"boxes under no die's name in {method}", limit=0),
        Quantity("solid_flaws", flaws, f"solids that BRepCheck refuses in {method}", limit=0),
    )
    exact = tuple(_judged(each, each.value == each.limit) for each in counts)
    place = Quantity("solid_position_error", error, f"corners of the dies in {method}", limit=_NM)
    return (*exact, _judged(place, error <= _NM))


def _read(die: Die, path: Path) -> tuple[ReadSolid, str]:
    _check_file(path)
    if path.suffix == ".step":
        return read_step(path)[0], OCP
    if path.suffix in {".glb", ".3mf"}:
        return read_scene(path), TRIMESH
    if path.suffix == ".stl":
        return read_stl(path, die), TRIMESH
    raise SourceError(
        "MF308",
        f"{path.name} is not a STEP, GLB, 3MF or STL file",
        where=str(path),
        cure="Give a file that ends in .step, .glb, .3mf or .stl",
    )


def _check_file(path: Path) -> None:
    if not os.path.isfile(path):
        raise SourceError(
            "MF301", f"there is no file {path}", where=str(path), cure="Run the job with that format in export.formats"
        )
    if path.stat().st_size == 0:
        raise SourceError("MF302", f"{path.name} is empty", where=str(path), cure="Run the job again to rewrite it")


@dataclass(frozen=True, eq=False)
class _Kind:
    """Placements of one shape in one orientation.

    Attributes:
        members: int64 [n], which placements.
        vertices_nm: float64 [m, 3], turned but not moved.
    """

    shape: ReadShape
    members: Ints
    vertices_nm: Floats


def _kinds(read: ReadSolid) -> list[_Kind]:
    keys = np.column_stack([read.index, read.turns.reshape(-1, 9).round(6)])
    _, first, inverse = np.unique(keys, axis=0, return_index=True, return_inverse=True)
    kinds = []
    for n, one in enumerate(first):
        shape = read.shapes[read.index[one]]
        kinds.append(_Kind(shape, np.flatnonzero(inverse.ravel() == n), shape.vertices_nm @ read.turns[one].T))
    return kinds


def _quantities(die: Die, path: Path, stack: Stack, read: ReadSolid, how: str) -> Iterator[Quantity]:
    panel = die.panel
    rows, columns = panel.orientations.shape
    kinds = _kinds(read)
    # The film lies on both sides of z = 0, the glass below it altogether.
    below = [bool((kind.vertices_nm[:, 2].max() + read.places_nm[kind.members, 2] < 0).all()) for kind in kinds]
    films = [kind for kind, is_glass in zip(kinds, below, strict=True) if not is_glass]
    glasses = [kind for kind, is_glass in zip(kinds, below, strict=True) if is_glass]

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
            right[row[same], column[same]] = np.array_equal(chrome, _expected(die, cell))
    wrong = int(np.count_nonzero((held != 1) | ~right))
    shapes_nm3 = sum(len(kind.members) * kind.shape.volume_nm3 for kind in films)
    volume = shapes_nm3 if read.total_nm3 is None else read.total_nm3
    clear = sum(int(np.count_nonzero(panel.pattern(int(cell)))) * int(n) for cell, n in _census(panel))
    design = (panel.orientations.size * panel.pitch_nm**2 - clear * panel.dot_nm**2) * stack.film_nm
    flaws = sum(not shape.sound for shape in read.shapes)
    fine = "watertight and wound alike" if how == TRIMESH else "closed and valid by BRepCheck"
    limit = _VOLUME_LIMIT[path.suffix]
    # STL rounds to float32 millimetres over the whole die.
    reach = max(panel.size_nm) / 2 * 1e-6
    vertex_limit = max(_NM, float(np.spacing(np.float32(reach))) * 1e6) if path.suffix == ".stl" else _NM

    def row_of(name: str, value: float, method: str, limit: float, passed: bool) -> Quantity:
        text = f"{method} in {path.name}, {how}"
        return Quantity(name, value, text, limit=limit, passed=passed, die=die.name)

    count = int(sum(len(kind.members) for kind in films))
    cells_of = rows * columns
    yield row_of("solid_instances", count, "films placed", cells_of, count == cells_of)
    yield row_of("solid_wrong_cells", wrong, "cells without exactly one film of their opening", 0, wrong == 0)
    yield row_of("solid_position_error", place_error, "films off their cells' centres", _NM, place_error <= _NM)
    off = max(vertex_error, read.snapped_nm)
    yield row_of(
        "solid_vertex_error", off, "vertices off the borders of dots and film", vertex_limit, off <= vertex_limit
    )
    error = abs(volume / design - 1)
    yield row_of("solid_volume_error", error, "volume of chrome against the openings", limit, error <= limit)
    yield row_of("solid_flaws", flaws, f"shapes that are not {fine}", 0, flaws == 0)
    if path.suffix != ".stl":
        gap = _glass_error(die, stack, read, glasses)
        yield row_of("solid_glass_error", gap, "corners of the glass off the panel's", _NM, gap <= _NM)


def _chrome(die: Die, stack: Stack, kind: _Kind) -> tuple[NDArray[np.bool_], float]:
    """Which dots and gutters of a cell a film covers whole, bool [y, x], and how far its vertices are off (nm).

    Only triangles of the upper face count. A dot that is covered in part is neither: the film is then reported as
    covering the opposite of what the dot's middle shows, so that it matches no opening.
    """
    panel = die.panel
    lines, half = unit_lines_nm(die) - panel.pitch_nm / 2, stack.film_nm / 2
    flat, z = kind.vertices_nm[:, :2], kind.vertices_nm[:, 2]
    at = nearest_line(lines, flat)
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


def _expected(die: Die, cell: int) -> NDArray[np.bool_]:
    pad = 1 if die.panel.gutter_nm else 0
    return np.pad(~die.panel.pattern(cell), pad, constant_values=True)


def _census(panel: Panel) -> Iterator[tuple[int, int]]:
    held, counts = np.unique(panel.orientations, return_counts=True)
    yield from zip(held.tolist(), counts.tolist(), strict=True)


def _glass_error(die: Die, stack: Stack, read: ReadSolid, glasses: list[_Kind]) -> float:
    """Distance of the substrate's corners from the design's, the largest of all coordinates; inf for none or many."""
    if len(glasses) != 1 or len(glasses[0].members) != 1:
        return math.inf
    corners = glasses[0].vertices_nm + read.places_nm[glasses[0].members[0]]
    low, high = glass(die, stack)
    return float(max(np.abs(corners.min(axis=0) - low).max(), np.abs(corners.max(axis=0) - high).max()))


def _judged(quantity: Quantity, passed: bool) -> Quantity:
    return replace(quantity, passed=passed)
