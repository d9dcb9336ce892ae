"""Written solids against the die they were written from.

A file is read by a library that did not write it, and compared with the openings and orientations themselves: in STEP
which cells it places, where, and what each is made of; in a mesh whether the film is closed, which dots both of its
faces cover, and where its walls stand; in both how much of it there is.

Written files read back and compared with their plate: layouts by polygons, solids by volume, pictures by pixels.

plate -> :class:`maskfab.mask.houses.files.PlateFiles` -> written -> :func:`read_mask` -> :func:`compare_mask`
"""

from __future__ import annotations

import math
import os
import tempfile
from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, replace
from functools import partial
from itertools import chain
from pathlib import Path
from types import MappingProxyType
from typing import Any, TypeAlias, get_type_hints

import numpy as np
from klayout import db
from numpy.typing import NDArray
from scipy import ndimage, sparse
from scipy.sparse import csgraph

from maskfab.base.arrays import Floats, Ints
from maskfab.base.errors import InputError, SourceError
from maskfab.base.model import CLEAR, Die, Panel, Plate, Quantity
from maskfab.base.processes import release_memory
from maskfab.base.work import Progress
from maskfab.mask.comparison.roundtrip import RoundTrip, Sifted, compare_biased, compare_layout, named_chrome
from maskfab.mask.dots import die_edges_nm, die_raster
from maskfab.mask.formats.picture import check_bitmap
from maskfab.mask.formats.plate_bitmap import check_plate_dots
from maskfab.mask.formats.reader import find_cell, read_layout
from maskfab.mask.formats.solid import Stack, centres_nm, glass
from maskfab.mask.formats.solid_reader import ReadShape, ReadSolid, read_scene, read_step, read_stl
from maskfab.mask.formats.svg import read_svg
from maskfab.mask.formats.table import Product
from maskfab.mask.houses.files import PlateFiles
from maskfab.mask.judge.verdict import judged
from maskfab.mask.layout import count_vertices, layer_info
from maskfab.mask.raster import coverage, outline_coverage
from maskfab.mask.sandbox import begun, library_errors, seconds_of

_NM = 1.0
"""Positions must be right to this much."""

OCP = "parsed and translated by OCP"
TRIMESH = "read by trimesh"

_TORN = 1e-6
"""A dot may be covered by this much less than wholly, for the rounding of sums."""

_VOLUME_LIMIT = {".step": 1e-9, ".glb": 1e-6, ".3mf": 1e-9, ".stl": 1e-4}
"""Relative; GLB rounds vertices of large dies to float32, STL those of all."""


def check_solid(die: Die, path: Path, stack: Stack | None = None) -> tuple[Quantity, ...]:
    """Read a die's STEP, GLB, 3MF or STL file back and compare it with the design.

    Args:
        die: what was to be written.
        path: the file, by its suffix.
        stack: the thicknesses it was written with.

    Returns:
        Rows that pass or fail: ``solid_instances`` (films placed: of every cell in STEP, one in a mesh),
        ``solid_wrong_cells`` (cells that are missing, placed twice, or whose film is not their opening's, dot by dot),
        ``solid_vertex_error`` (nm), ``solid_volume_error`` (relative), ``solid_flaws`` (shapes that are not valid or
        not closed), ``solid_glass_error`` (nm, corners of the substrate; not for STL, which has none); of STEP
        ``solid_position_error`` (nm), of meshes ``solid_pieces`` (closed surfaces of the film).

    Raises:
        SourceError: MF301 if there is no such file, MF302 if it is empty, MF303 if it cannot be read, MF308 for
            another suffix.
    """
    stack = stack or Stack()
    _check_file(path)
    if path.suffix == ".step":
        return tuple(_step_rows(die, path, stack, read_step(path)[0]))
    if path.suffix not in {".glb", ".3mf", ".stl"}:
        raise SourceError(
            "MF308",
            f"{path.name} is not a STEP, GLB, 3MF or STL file",
            where=str(path),
            cure="Give a file that ends in .step, .glb, .3mf or .stl",
        )
    return tuple(_mesh_rows(die, path, stack, read_stl(path) if path.suffix == ".stl" else read_scene(path)))


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


def _step_rows(die: Die, path: Path, stack: Stack, read: ReadSolid) -> Iterator[Quantity]:
    panel = die.panel
    rows, columns = panel.orientations.shape
    kinds = _kinds(read)
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
            right[row[same], column[same]] = np.array_equal(chrome, _expected(die, cell))
    wrong = int(np.count_nonzero((held != 1) | ~right))
    volume = sum(len(kind.members) * kind.shape.volume_nm3 for kind in films)
    row_of = partial(_row, die, f"in {path.name}, {OCP}")
    count, flaws = int(sum(len(kind.members) for kind in films)), sum(not shape.sound for shape in read.shapes)
    yield row_of("solid_instances", count, "films placed", rows * columns, count == rows * columns)
    yield row_of("solid_wrong_cells", wrong, "cells without exactly one film of their opening", 0)
    yield row_of("solid_position_error", place_error, "films off their cells' centres", _NM)
    yield row_of("solid_vertex_error", vertex_error, "vertices off the borders of dots and film", _NM)
    error = abs(volume / (_chrome_nm2(die) * stack.film_nm) - 1)
    yield row_of("solid_volume_error", error, "volume of chrome against the openings", _VOLUME_LIMIT[path.suffix])
    yield row_of("solid_flaws", flaws, "shapes that are not closed and valid by BRepCheck", 0)
    gap = _glass_error(die, stack, glasses)
    yield row_of("solid_glass_error", gap, "corners of the glass off the panel's", _NM)


def _mesh_rows(die: Die, path: Path, stack: Stack, read: ReadSolid) -> Iterator[Quantity]:
    placed = [
        (read.shapes[number], turn, read.shapes[number].vertices_nm @ turn.T + place)
        for number, turn, place in zip(read.index, read.turns, read.places_nm, strict=True)
    ]
    glasses = [vertices for _, _, vertices in placed if (vertices[:, 2] < 0).all()]
    films = [each for each in placed if not (each[2][:, 2] < 0).all()]
    grid = [line - middle for line, middle in zip(die_edges_nm(die), die.centre_nm, strict=True)]
    touches = int(np.count_nonzero(_touches(die)))
    leg = stack.corner_leg_nm(die) if touches else 0
    # Of float32, millimetres in STL and nanometres in GLB.
    rounded_nm = float(np.spacing(np.float32(max(die.panel.size_nm) / 2 * 1e-6))) * 1e6
    vertex_limit, dot_nm = max(_NM, rounded_nm), die.panel.dot_nm
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
        links = sparse.coo_array((np.ones(len(triangles)), (triangles[:, 0], triangles[:, 1])), (len(vertices),) * 2)
        links += sparse.coo_array((np.ones(len(triangles)), (triangles[:, 1], triangles[:, 2])), (len(vertices),) * 2)
        pieces = int(csgraph.connected_components(links, directed=False, return_labels=False))
    side = len(die.panel.cell_size.edges_nm) - 1
    rows, columns = die.panel.orientations.shape
    cells = int(np.count_nonzero(wrong.reshape(rows, side, columns, side).any(axis=(1, 3))))
    # Chrome that meets by a corner is one piece where a gap parts the openings there.
    design = int(ndimage.label(~die_raster(die), np.ones((3, 3)) if stack.corners == "gap" else None)[1])
    volume = sum(shape.volume_nm3 * float(np.linalg.det(turn)) for shape, turn, _ in films)
    chrome = _chrome_nm2(die) + touches * leg**2 * (1 if stack.corners == "gap" else -1)
    row_of = partial(_row, die, f"in {path.name}, {TRIMESH}")
    told = "".join(f" ({each})" for each in stack.touching_remark(die, touches))
    flaws = sum(not shape.sound for shape in read.shapes)
    yield row_of("solid_instances", len(films), "films placed", 1, len(films) == 1)
    yield row_of("solid_pieces", pieces, "closed surfaces of the film", design, pieces == design)
    yield row_of("solid_wrong_cells", cells, f"cells whose film is not their opening's{told}", 0)
    yield row_of(
        "solid_vertex_error", vertex_error, "walls off the borders of dots, faces off the film's", vertex_limit
    )
    error = abs(volume / (chrome * stack.film_nm) - 1)
    yield row_of(
        "solid_volume_error", error, f"volume of chrome against the openings{told}", _VOLUME_LIMIT[path.suffix]
    )
    yield row_of("solid_flaws", flaws, "shapes with a side that has not two faces, or a vertex of several fans", 0)
    if path.suffix != ".stl":
        gap = _glass_error(die, stack, glasses)
        yield row_of("solid_glass_error", gap, "corners of the glass off the panel's", _NM)


def _row(
    die: Die, read: str, name: str, value: float, method: str, limit: float, passed: bool | None = None
) -> Quantity:
    return Quantity(
        name, value, f"{method} {read}", limit=limit, passed=value <= limit if passed is None else passed, die=die.name
    )


def _chrome_nm2(die: Die) -> int:
    panel = die.panel
    clear = sum(int(np.count_nonzero(panel.pattern(int(cell)))) * int(n) for cell, n in _census(panel))
    return int(panel.orientations.size * panel.pitch_nm**2 - clear * panel.dot_nm**2)


def _touches(die: Die) -> NDArray[np.bool_]:
    """Corners of the grid, its rim left out, at which two openings touch."""
    clear = die_raster(die)
    low, left = clear[:-1, :-1], clear[1:, :-1]
    touching: NDArray[np.bool_] = (low == clear[1:, 1:]) & (left == clear[:-1, 1:]) & (low != left)
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
    alone = ~np.isin(start * len(vertices) + end, end * len(vertices) + start)
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


def _chrome(die: Die, stack: Stack, kind: _Kind) -> tuple[NDArray[np.bool_], float]:
    """Which dots and gutters of a cell a film covers whole, bool [y, x], and how far its vertices are off (nm).

    Only triangles of the upper face count. A dot that is covered in part is neither: the film is then reported as
    covering the opposite of what the dot's middle shows, so that it matches no opening.
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


def _expected(die: Die, cell: int) -> NDArray[np.bool_]:
    pad = 1 if die.panel.gutter_nm else 0
    return np.pad(~die.panel.pattern(cell), pad, constant_values=True)


def _nearest_line(lines: Floats, values: Floats) -> Ints:
    """Index of the line nearest to each value."""
    return np.searchsorted((lines[1:] + lines[:-1]) / 2, values).astype(np.int64)


def _census(panel: Panel) -> Iterator[tuple[int, int]]:
    held, counts = np.unique(panel.orientations, return_counts=True)
    yield from zip(held.tolist(), counts.tolist(), strict=True)


def _glass_error(die: Die, stack: Stack, glasses: Sequence[Floats]) -> float:
    """Distance of the substrate's corners from the design's, the largest of all coordinates; inf for none or many."""
    if len(glasses) != 1:
        return math.inf
    low, high = glass(die, stack)
    return float(max(np.abs(glasses[0].min(axis=0) - low).max(), np.abs(glasses[0].max(axis=0) - high).max()))


def _judged(quantity: Quantity, passed: bool) -> Quantity:
    return replace(quantity, passed=passed)


_WRITTEN_ALONE = (".gbr", ".svg")
"""Formats that hold what the writer exposes and nothing else."""

_READ_AHEAD = (".gbr", ".step")
"""Formats that take long in processes of their own: those run while other files are compared here."""

_MOST_AHEAD = 3
"""A process takes up to half a gigabyte."""

_ASIDE = (".dxf",)
"""Formats that take long in this process, but need not take place in it: copies of it read and compare them."""

_LARGE_BYTES = 1_000_000
"""Of a file that takes longer than to copy a process."""

_LIKE = 2
"""A file of more vertices than so many times the design's is not looked through."""

_FEW_VERTICES = 10_000

_HANDED_OVER: Mapping[str, Any] = MappingProxyType(
    {
        name: kind
        for name, kind in get_type_hints(RoundTrip).items()
        if name not in {"path", "layout", "differing", "slivers"}
    }
)
"""Findings of a comparison within limits, and their kinds."""

_Taken: TypeAlias = db.Layout | RoundTrip | tuple[Quantity, ...]
"""A mask file as a layout, to be compared, or compared already; of other files what the comparison has shown."""


@dataclass(frozen=True, eq=False)
class ReadBack:
    """Result of reading files back: of layouts, the first measured further, and every row of the report.

    Only the first layout is kept; those of the others are empty, for a flat one takes a hundred megabytes.
    """

    trips: tuple[RoundTrip, ...]
    quantities: tuple[Quantity, ...]


def read_back(
    made: PlateFiles, folder: Path, progress: Progress, refused: list[tuple[str, InputError]] | None = None
) -> ReadBack:
    """Read the files of a folder through libraries that did not write them, and compare each with the plate.

    The first layout is compared dot by dot too.

    Args:
        made: what was drawn.
        folder: where the files lie.
        progress: told where the work stands.
        refused: takes the files that cannot be read, and why; they are then left out. Then they may be anybody's, and
            layouts are read and compared within the limits of :mod:`maskfab.mask.sandbox`.

    Raises:
        SourceError: for a file that cannot be read, unless ``refused`` takes it.
    """
    trips: dict[int, RoundTrip] = {}
    quantities: dict[int, tuple[Quantity, ...]] = {}
    errors: dict[int, tuple[str, InputError]] = {}
    waiting = deque(enumerate(made.products))
    first = next((number for number, product in waiting if product.kind == "mask"), None)

    def take(number: int, *, dots: bool) -> _Taken:
        product = made.products[number]
        if refused is not None and product.kind == "mask":
            with _within_limits(made, product, folder, dots=dots) as answer:
                return answer()
        return _take(made, product, folder)

    slow = [number for number, each in waiting if Path(each.name).suffix in _READ_AHEAD]
    aside = [number for number, each in waiting if number != first and _aside(folder / each.name)]
    if refused is not None or (os.cpu_count() or 1) < 2:
        aside = []  # a foreign file is read in a copy anyhow, one after the other
    with _ahead(made, slow, aside, lambda number: take(number, dots=number == first), folder) as coming:
        while waiting:
            number, product = waiting.popleft()
            taken = coming.get(product.name)
            # Background reads are collected last; the first layout comes before anything else.
            others = any(each.name not in coming for _, each in waiting)
            if taken and not taken.done() and others and (trips or product.kind != "mask"):
                waiting.append((number, product))
                continue
            coming.pop(product.name, None)
            progress("read back", len(quantities) + len(errors), len(made.products))
            try:
                found = taken.result() if taken else take(number, dots=not trips)
                if isinstance(found, RoundTrip) and not trips and found.dies[0].wrong_dots is None:
                    found = take(number, dots=True)  # what should have been the first was refused
                if isinstance(found, db.Layout):
                    found = compare_mask(made, found, folder / product.name, dots=not trips)
                if isinstance(found, RoundTrip):
                    trip, quantities[number] = found, found.quantities()
                    trips[number] = trip if not trips else replace(trip, layout=db.Layout())
                else:
                    quantities[number] = found
            except InputError as error:
                if refused is None:
                    raise
                errors[number] = product.name, error
            release_memory()
    progress("read back", len(made.products), len(made.products))
    if refused is not None:
        refused += [errors[number] for number in sorted(errors)]
    rows = chain.from_iterable(quantities[number] for number in sorted(quantities))
    return ReadBack(tuple(trips[number] for number in sorted(trips)), tuple(rows))


@contextmanager
def _ahead(
    made: PlateFiles, slow: Sequence[int], aside: Sequence[int], take: Callable[[int], _Taken], folder: Path
) -> Iterator[dict[str, Future[_Taken]]]:
    """Start slow reads in background threads and in copies of this process; yields futures by file name.

    Unstarted reads are cancelled on exit, and copies ended.
    """
    workers = min(_MOST_AHEAD, max(1, (os.cpu_count() or 1) - 1))
    with ExitStack() as stack:
        # Copied before there are threads that read: what those hold would be held in the copy for ever.
        copies = {
            number: stack.enter_context(_within_limits(made, made.products[number], folder, dots=False))
            for number in aside[: os.cpu_count()]
        }
        pool = stack.enter_context(ThreadPoolExecutor(workers + len(copies)))
        stack.callback(pool.shutdown, wait=False, cancel_futures=True)
        reads = {made.products[number].name: pool.submit(take, number) for number in slow}
        yield reads | {
            made.products[number].name: pool.submit(_answer, made, made.products[number], folder, answer)
            for number, answer in copies.items()
        }


def _aside(path: Path) -> bool:
    """Whether a file is better read and compared in a copy of this process."""
    return path.suffix in _ASIDE and path.is_file() and path.stat().st_size > _LARGE_BYTES


def _answer(made: PlateFiles, product: Product, folder: Path, answer: Callable[[], RoundTrip]) -> _Taken:
    """The finding of a copy of this process; the file itself if that was ended for its limits, for it is ours."""
    try:
        return answer()
    except SourceError as error:
        if error.code != "MF322":
            raise
        return _take(made, product, folder)


def _take(made: PlateFiles, product: Product, folder: Path) -> _Taken:
    path = folder / product.name
    if product.kind != "mask":
        return _others(made, product, path)
    return read_mask(path)


def read_mask(path: Path) -> db.Layout:
    """A mask file, by a library that did not write it; it has one top cell.

    Raises:
        SourceError: as :func:`maskfab.mask.formats.reader.read_layout` and :func:`maskfab.mask.formats.svg.read_svg`.
    """
    if path.suffix == ".svg":
        return read_svg(path)
    read = read_layout(path)
    find_cell(read)
    return read


def compare_mask(made: PlateFiles, read: db.Layout, path: Path, *, dots: bool = True) -> RoundTrip:
    """A mask file that was read, against the design, against what its job asks for, and, if ``dots``, each dot against
    its opening.

    Raises:
        SourceError: MF323 if the polygon library fails on the file.
    """
    names: Mapping[str, str] | None = None
    if path.suffix in _WRITTEN_ALONE:
        names = {CLEAR.name: CLEAR.name}
        if made.figures.options.tone == "dark":
            named_chrome(read)
    elif path.suffix == ".dxf":
        names = made.settings.drawing.layer_names
    polygons, bias = made.figures.account.polygons, made.figures.options.bias_nm
    compare = partial(compare_biased, bias_nm=bias) if bias else compare_layout
    with library_errors(path):
        trip = compare(made.plate, made.design, read, path, dots=dots, drawn_polygons=polygons, layer_names=names)
        return trip if made.asked is None else replace(trip, judged=judged(read, path.name, made.asked))


@contextmanager
def _within_limits(
    made: PlateFiles, product: Product, folder: Path, *, dots: bool
) -> Iterator[Callable[[], RoundTrip]]:
    """A layout that anybody may have written, read and compared in a copy of this process; yields who waits for that.

    What comes back holds no differing shapes, and a layout only if ``dots``: the design where they are equal.

    Raises:
        SourceError: as :func:`read_layout` and :func:`maskfab.mask.sandbox.bounded`; MF313 if the file
            differs and has so many vertices that its optics would take far longer than the design's.
    """
    path = folder / product.name

    def work(_tell: Progress) -> tuple[Any, ...]:
        read = _take(made, product, folder)
        assert isinstance(read, db.Layout)
        trip = compare_mask(made, read, path, dots=dots)
        if dots and trip.differences:
            _refuse_many_vertices(made, read, path)
            trip.layout.write(str(differing), _clear_alone(trip.layout))
        return tuple(getattr(trip, name) for name in _HANDED_OVER)

    with tempfile.TemporaryDirectory(prefix="maskfab-verify-") as aside:
        differing = Path(aside) / "differing.oas"
        seconds = seconds_of(made.figures.account.polygons)
        with begun(path, work, kind=tuple[*_HANDED_OVER.values()], seconds=seconds) as answer:  # type: ignore[misc]

            def found() -> RoundTrip:
                told = dict(zip(_HANDED_OVER, answer(), strict=True))
                layout = made.design if dots else db.Layout()
                if differing.is_file():
                    layout = db.Layout()
                    layout.read(str(differing))
                slivers = Sifted(db.Region(), db.Region())
                return RoundTrip(path=path, layout=layout, differing=db.Region(), slivers=slivers, **told)

            yield found


def _clear_alone(read: db.Layout) -> db.SaveLayoutOptions:
    options = db.SaveLayoutOptions()
    options.format = "OASIS"
    options.deselect_all_layers()
    index = read.find_layer(layer_info(CLEAR))
    if index is not None:
        options.add_layer(index, layer_info(CLEAR))
    return options


def _refuse_many_vertices(made: PlateFiles, read: db.Layout, path: Path) -> None:
    found, drawn = count_vertices(read), max(count_vertices(made.design), made.figures.account.vertices)
    if found > _LIKE * drawn + _FEW_VERTICES:
        raise SourceError(
            "MF313",
            f"{path.name} draws {found:.3g} vertices, references followed, where the plate has {drawn:.3g}",
            where=str(path),
            cure="Put the file back that the run wrote, or hold this one against the job with --against",
        )


def plate_dots_row(made: PlateFiles, path: Path) -> Quantity:
    """A bitmap of the plate, every dot read back against the design.

    Raises:
        SourceError: MF308 if nobody says how many dots it should have, else as
            :func:`maskfab.mask.formats.plate_bitmap.check_plate_dots`.
    """
    if made.settings.dpi is None:
        cure = "State dpi in [export], or leave the file out"
        raise SourceError("MF308", f"nobody says how many dots to the inch {path.name} has", where=str(path), cure=cure)
    return check_plate_dots(made.plate, made.design, path, made.settings.dpi, made.figures.options.tone)


def _others(made: PlateFiles, product: Product, path: Path) -> tuple[Quantity, ...]:
    if product.kind == "plate_bitmap":
        return (plate_dots_row(made, path),)
    if product.die is None:
        return check_plate_solid(made.plate, path)
    (die,) = (each for each in made.plate.dies if each.name == product.die.name)
    if product.kind == "bitmap":
        return check_bitmap(die, made.design, path, made.settings.dots_per_um)
    return check_solid(die, path, made.settings.stack)
