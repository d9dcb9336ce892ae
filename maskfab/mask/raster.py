"""Regions as the exact share of each cell of a rectilinear grid that they cover, and the aperture of a file.

Along one axis, the share of cell i that an interval covers is, as a first difference over i, +(1-phi) at the cell k
that holds its start and +phi at k+1, and the negative of that for its end, where phi is the position within the cell.
A box is the outer product of two intervals, so its coverage is a handful of entries and a sum over both axes. An
interval that the stop cuts holds the share of what the stop leaves of it: what lies beyond changes nothing.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Literal, TypeAlias

import numpy as np
from klayout import db

from maskfab.base.arrays import Floats, Indices, Ints, expanded
from maskfab.base.model import Box, Die
from maskfab.base.units import NM_PER_UM
from maskfab.job.camera import Stop
from maskfab.optics.pupil import Aperture, Lattice, covered_aperture, zeros
from maskfab.optics.stop_edges import edges_in_stop, region_edges, stop_box, whole_or_away

Located = tuple[Indices, Floats]

_MOST_CELLS = 50_000_000
# Parts of edges between lines of the grid: so many stay in the processor's cache.
_PIECES_AT_A_TIME = 20_000
_CROWDED = 200
"""Cells that a cell may place for all its placements to be looked at, whatever the window."""


def coverage(shapes: db.Region | Ints, x_edges_nm: Floats, y_edges_nm: Floats, *, apart: bool = False) -> Floats:
    """Share of each grid cell that is covered; overlaps count once, what lies beyond the grid is left out.

    Exact up to the rounding of float64; exactly 0.0 or 1.0 where all edges of the shapes lie on grid lines.

    Args:
        shapes: a region with edges of any direction, or int64 [n, 4] boxes x0, y0, x1, y1 in nanometres.
            Boxes on grid lines may overlap at no cost; other boxes are merged first.
        x_edges_nm: float64 [nx + 1], ascending.
        y_edges_nm: float64 [ny + 1], ascending.
        apart: whether polygons of a region are known not to overlap, so that they need not be merged.

    Returns:
        float64 [ny, nx], row 0 lowest.
    """
    x_edges, y_edges = (np.asarray(edges, dtype=np.float64) for edges in (x_edges_nm, y_edges_nm))
    if isinstance(shapes, np.ndarray):
        placed = _placed(shapes, x_edges, y_edges)
        if not any(share.any() for _, share in placed):
            shares = _box_coverage(placed, x_edges.size, y_edges.size)
            return np.minimum(shares, 1.0, out=shares)
        shapes = db.Region([db.Box(*box) for box in shapes.tolist()])
    merged = shapes if apart or shapes.is_merged() else shapes.merged(True, 1)
    if _is_manhattan(merged):
        placed = _placed(to_boxes(merged), x_edges, y_edges)
        shares = _box_coverage(placed, x_edges.size, y_edges.size)
    else:
        return outline_coverage(region_edges(merged), x_edges, y_edges)
    return np.clip(shares, 0.0, 1.0, out=shares)


def outline_coverage(edges: Floats, x_edges: Floats, y_edges: Floats) -> Floats:
    """Share of each grid cell that lies within closed outlines, float64 [ny, nx], row 0 lowest; up to rounding.

    Args:
        edges: float64 [n, 4] of x0, y0, x1, y1, what is covered on the left of each.
        x_edges: float64 [nx + 1], ascending, in the same unit.
        y_edges: float64 [ny + 1], ascending.
    """
    rising = edges[edges[:, 1] != edges[:, 3]][:, [2, 3, 0, 1]]
    shares = _edge_coverage(rising, x_edges, y_edges)
    return np.clip(shares, 0.0, 1.0, out=shares)


def to_boxes(region: db.Region) -> Ints:
    """A Manhattan region as disjoint boxes: int64 [n, 4] of x0, y0, x1, y1 in nanometres."""
    boxes = (piece.bbox() for piece in region.decompose_trapezoids_to_region().each())
    flat = [value for box in boxes for value in (box.left, box.bottom, box.right, box.top)]
    return np.array(flat, dtype=np.int64).reshape(-1, 4)


def placed_boxes(cell: db.Cell, layer: int, window: db.Box | None = None) -> Ints | None:
    """The boxes of a Manhattan cell and of all that it places, without flattening it polygon by polygon.

    Ten thousand placements of a unit cell cost one broadcast sum instead of half a million polygons.

    Args:
        cell: where to start; boxes are in its coordinates.
        window: placements and shapes that do not touch this box may be left out.

    Returns:
        int64 [n, 4] x0, y0, x1, y1, some of which may overlap; None if a placement is not by quarter turns or a shape
        is not Manhattan, for which :func:`maskfab.mask.layout.region` must do.
    """
    shapes = cell.begin_shapes_rec(layer) if window is None else cell.begin_shapes_rec_touching(layer, window)
    shapes.max_depth = 0
    own = db.Region(shapes).merged(True, 1)
    # On a plate of many dies each asks for its own; cells that place few others are gone through in their own order.
    crowded = window is not None and cell.child_cells() > _CROWDED
    instances = list(cell.each_touching_inst(window) if crowded else cell.each_inst())
    if not _is_manhattan(own) or any(instance.is_complex() for instance in instances):
        return None
    parts = [to_boxes(own)]
    for (child_index, angle, mirrored), offsets in _placements(instances).items():
        child = cell.layout().cell(child_index)
        turn = db.Trans(angle, mirrored)
        reaching = offsets if window is None else _reaching(child.bbox(layer).transformed(turn), offsets, window)
        if len(reaching) == 0 or child.bbox(layer).empty():
            continue
        near = None
        if window is not None and len(reaching) == 1:
            near = window.transformed(db.Trans(turn, int(reaching[0, 0]), int(reaching[0, 1])).inverted())
        boxes = placed_boxes(child, layer, near)
        if boxes is None:
            return None
        turned = _turned(boxes, turn)
        parts.append((turned[None, :, :] + np.tile(reaching, 2)[:, None, :]).reshape(-1, 4))
    return np.concatenate(parts)


def disjoint(boxes: Ints) -> bool:
    """Whether no two boxes overlap; edges may coincide. False too where there are too many edges to tell cheaply."""
    x, y = np.unique(boxes[:, [0, 2]]), np.unique(boxes[:, [1, 3]])
    if x.size * y.size > _MOST_CELLS:
        return False
    counts = np.zeros((y.size, x.size), dtype=np.int32)
    left, right = (np.searchsorted(x, boxes[:, k]) for k in (0, 2))
    low, high = (np.searchsorted(y, boxes[:, k]) for k in (1, 3))
    for row, column, sign in ((low, left, 1), (low, right, -1), (high, left, -1), (high, right, 1)):
        np.add.at(counts, (row, column), sign)
    return bool(counts.cumsum(axis=0).cumsum(axis=1).max(initial=0) <= 1)


def _is_manhattan(region: db.Region) -> bool:
    return bool(region.non_rectilinear().is_empty())


def _placements(instances: Iterable[db.Instance]) -> dict[tuple[int, int, bool], Ints]:
    """Displacements, int64 [n, 2], of child cells by their index, quarter turns and mirroring."""
    places: dict[tuple[int, int, bool], list[tuple[int, int]]] = {}
    arrays: dict[tuple[int, int, bool], list[Ints]] = {}
    for instance in instances:
        placed = instance.cell_inst
        first = placed.trans
        key = placed.cell_index, first.angle, first.is_mirror()
        if placed.size() == 1:
            places.setdefault(key, []).append((first.disp.x, first.disp.y))
        else:
            steps = np.mgrid[0 : max(1, placed.na), 0 : max(1, placed.nb)].reshape(2, -1).T
            vectors = np.array([[placed.a.x, placed.a.y], [placed.b.x, placed.b.y]], dtype=np.int64)
            arrays.setdefault(key, []).append(steps @ vectors + np.array([first.disp.x, first.disp.y], dtype=np.int64))
    for key, singles in places.items():
        arrays.setdefault(key, []).append(np.array(singles, dtype=np.int64))
    return {key: np.concatenate(parts) for key, parts in arrays.items()}


def _reaching(box: db.Box, offsets: Ints, window: db.Box) -> Ints:
    if box.empty():
        return offsets[:0]
    low, high = np.array([box.left, box.bottom]), np.array([box.right, box.top])
    start, stop = np.array([window.left, window.bottom]), np.array([window.right, window.top])
    reaching: Ints = offsets[((offsets + low <= stop) & (offsets + high >= start)).all(axis=1)]
    return reaching


def _turned(boxes: Ints, turn: db.Trans) -> Ints:
    axes = [turn * db.Vector(1, 0), turn * db.Vector(0, 1)]
    matrix = np.array([[axis.x, axis.y] for axis in axes], dtype=np.int64)
    corners = np.stack([boxes[:, :2] @ matrix, boxes[:, 2:] @ matrix])
    return np.concatenate([corners.min(axis=0), corners.max(axis=0)], axis=1)


def _locate(values: Floats | Ints, edges: Floats) -> Located:
    """Index of the cell that holds each value, and the position within it; beyond the grid, the nearer border."""
    values = np.clip(values.astype(np.float64), edges[0], edges[-1])
    cells = np.searchsorted(edges, values, side="right") - 1
    widths = np.append(np.diff(edges), 1.0)
    return cells, (values - edges[cells]) / widths[cells]


def _placed(boxes: Ints, x_edges: Floats, y_edges: Floats) -> list[Located]:
    """Where x0, y0, x1 and y1 of all boxes lie on the grid."""
    return [_locate(boxes[:, k], edges) for k, edges in enumerate((x_edges, y_edges, x_edges, y_edges))]


def _box_coverage(placed: list[Located], x_lines: int, y_lines: int) -> Floats:
    x0, y0, x1, y1 = placed
    sums = np.zeros((y_lines + 1, x_lines + 1))
    _add_upright(sums, x0, y0, y1)
    _add_upright(sums, x1, y1, y0)
    np.cumsum(sums, axis=0, out=sums)
    np.cumsum(sums, axis=1, out=sums)
    return sums[:-2, :-2]


def _add_upright(differences: Floats, place: Located, begin: Located, end: Located) -> None:
    """Add what upright edges change of the coverage along both axes, which their ends tell, however long they are."""
    flat, width, (columns, u) = differences.ravel(), differences.shape[1], place
    for y_sign, (rows, v) in ((1.0, begin), (-1.0, end)):
        for row_step, row_share in ((0, 1 - v), (1, v)):
            for column_step, column_share in ((0, 1 - u), (1, u)):
                share = y_sign * row_share * column_share
                if share.any():
                    np.add.at(flat, (rows + row_step) * width + (columns + column_step), share)


def _edge_coverage(segments: Floats, x_edges: Floats, y_edges: Floats) -> Floats:
    """Coverage by polygons: an edge covers all that lies to its right, positive upwards and negative downwards."""
    differences = np.zeros((y_edges.size + 1, x_edges.size + 1))
    upright = segments[:, 0] == segments[:, 2]
    x, begin, _, end = segments[upright].T
    _add_upright(differences, _locate(x, x_edges), _locate(begin, y_edges), _locate(end, y_edges))
    differences = np.cumsum(differences, axis=0, out=differences)[:-2]
    segments = segments[~upright]
    # What edges cover is a sum over them. A long one may cross thousands of lines, and a short one none.
    pieces = np.ones(len(segments), dtype=np.intp)
    for k, lines in enumerate((x_edges, y_edges)):
        pieces += abs(np.searchsorted(lines, segments[:, k]) - np.searchsorted(lines, segments[:, k + 2]))
    part = np.cumsum(pieces) // _PIECES_AT_A_TIME
    for some in np.split(segments, np.flatnonzero(np.diff(part)) + 1):
        _add_differences(differences, some, x_edges, y_edges)
    return np.cumsum(differences, axis=1, out=differences)[:, :-2]


def _add_differences(differences: Floats, segments: Floats, x_edges: Floats, y_edges: Floats) -> None:
    """Add what edges change of the coverage from each cell to the next along x."""
    sign = np.sign(segments[:, 3] - segments[:, 1])
    pieces, source = _cut(segments, y_edges, "y")
    sign = sign[source]
    pieces, source = _cut(pieces, x_edges, "x")
    sign = sign[source]
    middle_y = (pieces[:, 1] + pieces[:, 3]) / 2
    inside = (middle_y > y_edges[0]) & (middle_y < y_edges[-1])
    pieces, sign, middle_y = pieces[inside], sign[inside], middle_y[inside]
    rows, _ = _locate(middle_y, y_edges)
    share = sign * np.abs(pieces[:, 3] - pieces[:, 1]) / np.diff(y_edges)[rows]
    columns, u = _locate((pieces[:, 0] + pieces[:, 2]) / 2, x_edges)
    np.add.at(differences, (rows, columns), share * (1 - u))
    np.add.at(differences, (rows, columns + 1), share * u)


def _cut(segments: Floats, edges: Floats, axis: Literal["x", "y"]) -> tuple[Floats, Indices]:
    """Segments cut at every grid line that crosses them, and for each piece the index of its segment."""
    along, across = (0, 1) if axis == "x" else (1, 0)
    start, stop = segments[:, along], segments[:, along + 2]
    low, high = np.minimum(start, stop), np.maximum(start, stop)
    first = np.searchsorted(edges, low, side="right")
    counts = np.maximum(np.searchsorted(edges, high, side="left") - first, 0) + 1
    source, nth = expanded(counts)
    line = first[source] + nth
    lower = np.where(nth == 0, low[source], edges[np.clip(line - 1, 0, edges.size - 1)])
    upper = np.where(nth == counts[source] - 1, high[source], edges[np.clip(line, 0, edges.size - 1)])
    span = np.where(start == stop, 1.0, stop - start)[source]
    slope = (segments[:, across + 2] - segments[:, across])[source] / span
    pieces = np.empty((len(source), 4))
    flat = (start == stop)[source]
    for end, value in ((0, lower), (2, upper)):
        pieces[:, along + end] = value
        pieces[:, across + end] = segments[source, across] + slope * (value - start[source])
    pieces[flat, across] = segments[source[flat], across]
    pieces[flat, across + 2] = segments[source[flat], across + 2]
    return pieces, source


Shapes: TypeAlias = db.Region | Ints

_WHOLE = 1e-8
"""Share of an interval within the stop to which the stop's polygon and its grid tell what is clear."""

_ROWS_AT_A_TIME = 64


def axis_nm(die: Die) -> tuple[float, float]:
    """Where the optical axis meets the plate: the middle of the panel."""
    x0, y0, x1, y1 = die.box_nm
    return (x0 + x1) / 2, (y0 + y1) / 2


def light_box(die: Die, stop: Stop) -> Box:
    """The part of a plate whose shapes the stop of a die sees, and the rest of every dot that it cuts."""
    return stop_box(stop, axis_nm(die), die.panel.dot_nm)


def sees_light(die: Die, stop: Stop, shapes: Shapes) -> bool:
    """Whether any of these shapes, in nanometres of the plate, is clear before the stop of a die."""
    axis = axis_nm(die)
    if not isinstance(shapes, db.Region):
        inside, outside = whole_or_away(stop.scaled(NM_PER_UM, NM_PER_UM), *(shapes - np.tile(axis, 2)).T)
        if inside.any():
            return True
        shapes = shapes[~outside]
    return edges_in_stop(shapes, stop, axis)[1] > 0


def read_aperture(x: Lattice, y: Lattice, covered: Floats) -> Aperture:
    """An aperture from the share of every interval that is clear, [ny, nx].

    Where every interval is clear or dark, none varies within, and zeros that take no memory spare a pass over them.
    """
    if ((covered == 0) | (covered == 1)).all():
        return Aperture(x, y, covered, zeros((covered.shape[0], covered.shape[1])))
    return covered_aperture(x, y, covered)


def aperture_in_stop(
    x: Lattice,
    y: Lattice,
    shapes: Shapes,
    edges_um: Floats,
    stop: Stop,
    axis: tuple[float, float],
    *,
    apart: bool = False,
) -> Aperture:
    """Aperture before a stop, on lattices about its axis.

    Args:
        shapes: what is clear, in nanometres of the plate, as far as the stop at least.
        edges_um: the same cut by the stop, see :func:`maskfab.optics.stop_edges.edges_in_stop`.
        axis: of the lattices, in nanometres of the plate.
        apart: see :func:`coverage`.
    """
    lines = x.edges_um(), y.edges_um()
    covered = coverage(shapes, *lines_nm(x, y, axis), apart=apart)
    row, column = _grey_beyond(covered, stop, *lines)
    if row.size:
        of_stop, _ = edges_in_stop(db.Region(db.Box(*stop_box(stop, (0.0, 0.0)))), stop, (0.0, 0.0))
        clear, whole = (outline_coverage(edges, *lines)[row, column] for edges in (edges_um, of_stop))
        share = np.clip(clear / np.where(whole > 0, whole, 1.0), 0.0, 1.0)
        share[clear < _WHOLE] = 0.0
        share[whole - clear < _WHOLE] = 1.0
        covered[row, column] = share
    covered.flags.writeable = False
    return read_aperture(x, y, covered)


def lines_nm(x: Lattice, y: Lattice, axis: tuple[float, float]) -> tuple[Floats, Floats]:
    """The lines of lattices in nanometres of the plate; whole numbers but for rounding are made so."""
    along_x, along_y = (centre + NM_PER_UM * lattice.edges_um() for centre, lattice in zip(axis, (x, y), strict=True))
    return _on_grid(along_x), _on_grid(along_y)


def edge_distances(shapes: db.Region, stop: Stop, axis: tuple[float, float]) -> tuple[set[int], bool]:
    """Twice the distances from the axis, in nm, of edges before the stop along x or y; and whether there are others."""
    edges = 2 * region_edges(shapes).astype(np.int64)
    edges -= np.tile([round(2 * centre) for centre in axis], 2)
    start, span = edges[:, :2].astype(np.float64), (edges[:, 2:] - edges[:, :2]).astype(np.float64)
    along = np.clip(-(start * span).sum(axis=1) / np.maximum((span**2).sum(axis=1), 1.0), 0.0, 1.0)
    nearest = start + along[:, None] * span
    if stop.round:
        seen = edges[np.hypot(*nearest.T) < NM_PER_UM * stop.diameter_um - 1]
    else:
        low, high = np.minimum(edges[:, :2], edges[:, 2:]), np.maximum(edges[:, :2], edges[:, 2:])
        seen = edges[((low < NM_PER_UM * stop.diameter_um - 1) & (high > 1 - NM_PER_UM * stop.diameter_um)).all(axis=1)]
    upright, level = seen[:, 0] == seen[:, 2], seen[:, 1] == seen[:, 3]
    distances = {*map(abs, seen[upright, 0].tolist()), *map(abs, seen[level, 1].tolist())}
    return distances, not bool((upright | level).all())


def _grey_beyond(covered: Floats, stop: Stop, x_um: Floats, y_um: Floats) -> tuple[Indices, Indices]:
    """Rows and columns of intervals that are clear in part and reach beyond a centred stop.

    Of foreign polygons most intervals may be clear in part, so they are looked at a few rows at a time.
    """
    grey = []
    for start in range(0, len(covered), _ROWS_AT_A_TIME):
        some = covered[start : start + _ROWS_AT_A_TIME]
        row, column = np.nonzero((some > 0) & (some < 1))
        row += start
        sides = (x_um[column], y_um[row], x_um[column + 1], y_um[row + 1])
        inside, _ = whole_or_away(stop.scaled(NM_PER_UM, NM_PER_UM), *(NM_PER_UM * side for side in sides))
        grey.append((row[~inside], column[~inside]))
    row, column = (np.concatenate(indices) for indices in zip(*grey, strict=True))
    return row, column


def _on_grid(edges_nm: Floats) -> Floats:
    whole = np.rint(edges_nm)
    return np.where(abs(edges_nm - whole) < 1e-4, whole, edges_nm)
