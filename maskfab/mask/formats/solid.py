"""Parts of the solids of a die: the glass, the rigid placements of its cells, and its chrome as one closed surface.

Coordinates are nanometres from the centre of the die's slot; z points away from the glass. A film centred on z = 0 is
its own mirror image in z, so half a turn about an in-plane axis acts on it as a mirror does: all eight orientations of
an opening are rigid placements of one tile, and nothing needs a mirrored solid.

For a closed surface the openings of all cells are merged on whole nanometres, so neighbours share no wall, and what is
left of the film is cut into triangles band by band. Bands part in the middle of dots, where nothing but the sides of
openings crosses, so both sides of a cut have the same corners. Corners of dots mostly lie on common lines, and cutting
ears off a polygon joins some of them to triangles without area. Such a triangle and its neighbour across its longest
side have another diagonal, too: the same corners, as many triangles and the same outline, so what was closed stays
closed, exactly.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cache
from importlib.util import find_spec
from itertools import pairwise
from typing import Any, TypeAlias

import numpy as np
from klayout import db

from maskfab.base.arrays import Floats, Ints
from maskfab.base.cell_size import CellSize
from maskfab.base.errors import OutputError
from maskfab.base.model import CLEAR, ORIENTATIONS, Die, Panel, Point, Polygon
from maskfab.mask.formats.format import Stack
from maskfab.mask.layout import simple_polygon
from maskfab.mask.outlines import outline, unit_name, unit_shapes

CHROME_RGB = (0.55, 0.56, 0.60)
GLASS_RGB = (0.70, 0.85, 0.90)
GLASS_ALPHA = 0.3
MOST_CAD_VERTICES, MOST_CAD_CELLS = 4_000, 40_000
"""Of exact solids: the cut of an outline takes 0.5 s for 230 vertices, 8 s for 2200; a thousand cells take 0.6 s."""
MOST_MESH_VERTICES = 1_500_000
"""Of the outlines of all cells: a mesh has four times as many triangles."""


def rotation(orientation: int) -> Floats:
    """float64 [3, 3] of determinant 1 that places a tile as :func:`maskfab.base.model.orient` turns its opening."""
    flip = np.diag([-1.0, 1.0, -1.0]) if orientation >= 4 else np.eye(3)
    quarter = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    turn: Floats = np.linalg.matrix_power(quarter, orientation % 4) @ flip
    return turn


def units_in_use(panel: Panel) -> tuple[int, ...]:
    """Entries (8 u + k) of the cells in use, ascending."""
    return tuple(int(cell) for cell in np.unique(panel.orientations))


def openings_in_use(panel: Panel) -> tuple[int, ...]:
    """Indices into ``panel.openings`` of those that at least one cell holds, ascending."""
    return tuple(sorted({cell // ORIENTATIONS for cell in units_in_use(panel)}))


def unit_names(panel: Panel) -> dict[int, str]:
    """A name for every unit in use, no two alike, by :func:`maskfab.mask.outlines.unit_name` where it serves."""
    names: dict[int, str] = {}
    for cell in units_in_use(panel):
        name = "".join(unit_name(panel, cell))
        names[cell] = f"{name}_{cell // ORIENTATIONS}" if name in names.values() else name
    return names


def centres_nm(die: Die) -> Floats:
    """Centre of every cell, float64 [rows, columns, 2] of x, y from the slot's centre."""
    rows, columns = die.panel.orientations.shape
    x0, y0 = (origin - centre for origin, centre in zip(die.origin_nm, die.centre_nm, strict=True))
    x, y = ((np.arange(n) + 0.5) * die.panel.pitch_nm + low for n, low in ((columns, x0), (rows, y0)))
    return np.stack(np.meshgrid(x, y), axis=-1)


def cells(die: Die) -> Iterator[tuple[str, int, Floats]]:
    """Name, unit and centre (nm, z = 0) of every cell, row by row from below."""
    rows = zip(centres_nm(die), die.panel.orientations.tolist(), strict=True)
    for row, (centres, units) in enumerate(rows):
        for column, (centre, unit) in enumerate(zip(centres, units, strict=True)):
            yield f"R{row}C{column}", unit, np.append(centre, 0.0)


def holes_nm(panel: Panel, opening: int) -> list[Floats]:
    """Outlines of an opening, float64 [n, 2] each, from the cell's centre, not turned."""
    shift = (panel.gutter_nm - panel.pitch_nm) / 2
    return [np.array(polygon) + shift for polygon in outline(panel.openings[opening].mask, panel.dot_nm)]


def glass(die: Die, stack: Stack) -> tuple[Floats, Floats]:
    """Lower and upper corner of the substrate under a panel, float64 [3] each."""
    x0, y0, x1, y1 = die.box_nm
    x, y = die.centre_nm
    top = -stack.film_nm / 2
    return np.array([x0 - x, y0 - y, top - stack.glass_nm]), np.array([x1 - x, y1 - y, top])


def check_solid_size(die: Die, kind: str, most_vertices: int, most_cells: int) -> None:
    """Refuse what a solid modeller cannot make, or not in reasonable time, before any work starts.

    Raises:
        OutputError: MF410 if a cell has no chrome at all; MF412 if the outlines of the openings in use have more than
            ``most_vertices`` vertices together, or the panel more than ``most_cells`` cells.
    """
    _check_chrome(die, kind)
    size = die.panel.orientations.size
    if size > most_cells:
        raise _too_large(die, kind, f"{size} cells are more than the {most_cells}")
    vertices = sum(_vertices(die.panel, opening) for opening in openings_in_use(die.panel))
    if vertices > most_vertices:
        raise _too_large(die, kind, f"outlines of {vertices} vertices are more than the {most_vertices}")


def check_mesh_size(die: Die, kind: str) -> None:
    """As :func:`check_solid_size`, of up to :data:`MOST_MESH_VERTICES`: a mesh repeats the outlines of every cell."""
    _check_chrome(die, kind)
    vertices = mesh_vertices(die.panel)
    if vertices > MOST_MESH_VERTICES:
        what = f"outlines of {vertices} vertices in all cells are more than the {MOST_MESH_VERTICES}"
        raise _too_large(die, kind, what, ", use step, which places every cell")


def mesh_vertices(panel: Panel) -> int:
    """Of the outlines in all cells."""
    used, times = np.unique(panel.orientations // ORIENTATIONS, return_counts=True)
    return sum(_vertices(panel, opening) * n for opening, n in zip(used.tolist(), times.tolist(), strict=True))


def _vertices(panel: Panel, opening: int) -> int:
    return sum(map(len, outline(panel.openings[opening].mask, panel.dot_nm)))


def _check_chrome(die: Die, kind: str) -> None:
    panel = die.panel
    for opening in openings_in_use(panel):
        if panel.gutter_nm == 0 and panel.openings[opening].mask.all():
            what = (
                f"opening {panel.openings[opening].name} is clear all over its cell, so no chrome is left for a {kind}"
            )
            cure = f"Leave {kind} out of export.formats, or give the panel a gutter"
            raise OutputError("MF410", what, where=f"die {die.name}", cure=cure)


def _too_large(die: Die, kind: str, what: str, instead: str = "") -> OutputError:
    cure = f"Leave {kind} out of export.formats for this die{instead}, or lay out a smaller panel"
    return OutputError("MF412", f"{what} of a {kind}", where=f"die {die.name}", cure=cure)


_FLAT_NM = 5.0
"""Triangles of less height are flat: float32 millimetres within a die could take their area."""
_CORNERS_OF_A_CELL = 64
_BAND_CORNERS = 4_000
"""About as many as a band has: the time that ears take grows faster than their number beyond some thousands."""


@dataclass(frozen=True, eq=False)
class Mesh:
    """A closed surface: vertices float64 [n, 3], no two alike; triangles int64 [m, 3], outside counter-clockwise."""

    vertices_nm: Floats
    triangles: Ints


def film(die: Die, stack: Stack) -> tuple[Mesh, int]:
    """The chrome of a die from its slot's centre, round z = 0, and the number of corners that touched.

    Every side of a triangle belongs to two, and the triangles round every vertex are one fan. Chrome that openings part
    altogether is several such surfaces. Where openings touch by a corner they get the gap or neck of the stack.
    """
    clear = _clear(die)
    touches = _touches(clear)
    if touches:
        leg = stack.corner_leg_nm(die)
        squares = db.Region([db.Polygon(_square(x, y, leg)) for x, y in touches])
        clear = clear - squares if stack.corners == "gap" else clear | squares
    corners, triangles, sides = _face(die, clear.merged(True, 1))
    # The upper face, then the lower one, whose corners stand in the same order.
    count = len(corners)
    vertices = np.column_stack([np.tile(corners, (2, 1)), np.repeat([0.5, -0.5], count) * stack.film_nm])
    here, there = sides.T
    walls = ([here + count, there + count, there], [here + count, there, here])
    faces = [triangles, triangles[:, ::-1] + count, *(np.column_stack(wall) for wall in walls)]
    return Mesh(vertices, np.concatenate(faces)), len(touches)


class SharedFilm:
    """Films for formats that are written of a die one after the other: made once, and let go when each has had it."""

    def __init__(self, formats: int) -> None:
        self._formats, self._left = formats, 0
        self._made: tuple[Die, Stack, tuple[Mesh, int]] | None = None

    def __call__(self, die: Die, stack: Stack) -> tuple[Mesh, int]:
        if self._made is None or self._made[0] is not die or self._made[1] != stack:
            self._made, self._left = (die, stack, film(die, stack)), self._formats
        found, self._left = self._made[2], self._left - 1
        if self._left <= 0:
            self._made = None
        return found


def box_mesh(low_nm: Floats, high_nm: Floats) -> Mesh:
    """A box between two corners."""
    corners = np.array([[x, y, z] for z in (0, 1) for y in (0, 1) for x in (0, 1)])
    quads = ((0, 2, 3, 1), (4, 5, 7, 6), (0, 1, 5, 4), (2, 6, 7, 3), (0, 4, 6, 2), (1, 3, 7, 5))
    triangles = [half for a, b, c, d in quads for half in ((a, b, c), (a, c, d))]
    return Mesh(low_nm + corners * (high_nm - low_nm), np.array(triangles, dtype=np.int64))


def _clear(die: Die) -> db.Region:
    """Openings of all cells, merged, from the slot's centre."""
    layout = db.Layout()
    layer, top = layout.layer(1, 0), layout.create_cell("DIE")
    units = {}
    for unit in units_in_use(die.panel):
        cell = units[unit] = layout.create_cell(f"R{unit}")
        for polygon in unit_shapes(die.panel, unit).get(CLEAR, ()):
            cell.shapes(layer).insert(simple_polygon(polygon))
    half = die.panel.pitch_nm / 2
    for _, unit, (x, y, _) in cells(die):
        top.insert(db.CellInstArray(units[unit].cell_index(), db.Trans(round(x - half), round(y - half))))
    return db.Region(top.begin_shapes_rec(layer)).merged(True, 1)


def _touches(merged: db.Region) -> list[Point]:
    """Places at which shapes touch by a corner alone: those that outlines visit twice."""
    ends = (value for edge in merged.edges().each() for value in (edge.x1, edge.y1))
    visited, times = np.unique(np.fromiter(ends, np.int64).reshape(-1, 2), axis=0, return_counts=True)
    return [(x, y) for x, y in visited[times > 1].tolist()]


def _square(x: int, y: int, leg: int) -> list[db.Point]:
    """A square that stands on its corner."""
    return [db.Point(x - leg, y), db.Point(x, y + leg), db.Point(x + leg, y), db.Point(x, y - leg)]


def _face(die: Die, clear: db.Region) -> tuple[Ints, Ints, Ints]:
    """Upper face of a panel's chrome: corners int64 [n, 2], triangles [m, 3], and the sides on its outline [k, 2]."""
    (x0, y0), (width, height) = _low(die), die.panel.size_nm
    count = sum(shape.num_points() for shape in clear.each())
    cuts, turn = [y0, *_cuts(die, y0, count), y0 + height], _turner(count, max(width, height))
    shapes = db.Shapes()
    shapes.insert(clear)
    points: list[Point] = []
    following: list[int] = []
    triangles: list[Ints] = []
    for low, high in pairwise(cuts):
        band = db.Box(x0, low, x0 + width, high)
        near = db.Region([shape.polygon for shape in shapes.each_overlapping(band)])
        for piece in _contours(db.Region(band) - near):
            contours = [_divided(contour, (x0, y0), die.panel.cell_size) for contour in piece]
            triangles.append(triangulated(contours, turn) + len(points))
            for contour in contours:
                first = len(points)
                points += contour
                following += (*range(first + 1, len(points)), first)
    x, y = np.array(points, dtype=np.int64).reshape(-1, 2).T
    key, number = np.unique((x - x0) << 32 | (y - y0), return_inverse=True)
    outer = (y != y[following]) | ~np.isin(y, cuts[1:-1])
    sides = np.column_stack([number, number[following]])[outer]
    return np.column_stack([(key >> 32) + x0, (key & 0xFFFFFFFF) + y0]), number[np.concatenate(triangles)], sides


def _low(die: Die) -> Point:
    (x, y), (x0, y0) = die.origin_nm, die.centre_nm
    return x - x0, y - y0


def _cuts(die: Die, low_nm: int, corners: int) -> list[int]:
    """Heights between bands: middles of dots, where no outline has a corner."""
    size, rows = die.panel.cell_size, die.panel.orientations.shape[0]
    middles = size.dot_edges_nm[:-1] + size.dot_nm // 2
    every = (low_nm + np.arange(rows)[:, None] * size.pitch_nm + middles).ravel()
    bands = min(corners // _BAND_CORNERS + 1, len(every))
    return [int(cut) for cut in every[np.arange(1, bands) * len(every) // bands]]


def _contours(chrome: db.Region) -> Iterator[list[Polygon]]:
    """Contours of every piece of a region: hull first, chrome on their left."""
    for piece in chrome.merged(True, 1).each():
        holes = (piece.each_point_hole(n) for n in range(piece.holes()))
        yield [tuple((point.x, point.y) for point in contour)[::-1] for contour in (piece.each_point_hull(), *holes)]


def _divided(contour: Polygon, low_nm: Point, cell: CellSize) -> Polygon:
    """The contour with a corner about every dot of sides that are longer than a cell, such as those of the frame; in
    cells of many dots or wide gutters, 64 a cell.

    Between a long side and short ones beside it triangles would be needles from its far ends. Corners are where both
    bands that a side parts have them, and not within half a step of its ends.
    """
    step = cell.dot_nm * max(1, cell.pitch_nm // (_CORNERS_OF_A_CELL * cell.dot_nm))
    corners: list[Point] = []
    for (x, y), (to_x, to_y) in zip(contour, (*contour[1:], contour[0]), strict=True):
        corners.append((x, y))
        start, end, low = (x, to_x, low_nm[0]) if y == to_y else (y, to_y, low_nm[1])
        if abs(end - start) > cell.pitch_nm and (x == to_x or y == to_y):
            near, far = sorted((start, end))
            first = near + step // 2 + 1
            first += -(first - low) % step
            places = range(first, far - step // 2, step)
            for place in places if end > start else reversed(places):
                corners.append((place, y) if y == to_y else (x, place))
    return tuple(corners)


def triangulated(contours: Sequence[Polygon], turn: _Turn) -> Ints:
    """Triangles between the corners of a polygon: int64 [m, 3], counter-clockwise, counting through all contours.

    All have an area, and are Delaunay's where some were lower than 5 nm.

    Args:
        contours: hull counter-clockwise, holes clockwise, in nanometres. They may touch themselves in a corner, where
            the polygon is parted; no corner lies on a side.
    """
    from manifold3d import triangulate

    triangles = np.array(triangulate([np.array(contour, dtype=np.float64) for contour in contours]), dtype=np.int64)
    points = np.array([point for contour in contours for point in contour], dtype=np.int64)
    sides = np.roll(points[triangles], -1, axis=1) - points[triangles]
    doubled = sides[:, 0, 0] * sides[:, 1, 1] - sides[:, 0, 1] * sides[:, 1, 0]
    if (doubled >= _FLAT_NM * np.hypot(sides[..., 0], sides[..., 1]).max(axis=1)).all():
        return triangles
    return _delaunay(points, triangles, turn)


def _delaunay(points: Ints, triangles: Ints, turn: _Turn) -> Ints:
    """The triangles, diagonals turned until no corner lies in a neighbour's circle (C. L. Lawson, 1977)."""
    start, end, number = triangles.ravel(), np.roll(triangles, -1, axis=1).ravel(), np.arange(triangles.size)
    sides, turned = start * len(points) + end, end * len(points) + start
    order = np.argsort(sides)
    twins = order[np.minimum(np.searchsorted(sides[order], turned), len(order) - 1)]
    twins[sides[twins] != turned] = -1
    following, first = number - number % 3 + (number + 1) % 3, number[::3].copy()
    if turn is _turn:
        # Elements of lists are whole numbers without a limit, and quicker to reach than those of arrays.
        lists = [values.tolist() for values in (*points.T, start, following, twins, number // 3, first)]
        turn(*lists)
        start, following, first = (np.array(lists[n], dtype=np.int64) for n in (2, 3, 6))
    else:
        x, y = points.T.copy()
        start = start.copy()
        turn(x, y, start, following, twins, number // 3, first)
    second = following[first]
    return np.column_stack([start[first], start[second], start[following[second]]])


_Turn: TypeAlias = Callable[..., None]
_WORTH_COMPILING = 50_000
"""Corners of a face beyond which compiled code saves more than its making takes."""
_BITS = 26
_LOW = (1 << _BITS) - 1
_WIDEST_NM = 1 << 25
"""Of a face whose sums, in words of 26 bits, compiled code can hold."""


def _turner(corners: int, widest_nm: int) -> _Turn:
    """Function that turns diagonals of a face with so many corners: compiled where that pays and numba is there."""
    fit = corners > _WORTH_COMPILING and widest_nm < _WIDEST_NM and find_spec("numba")
    return _compiled() if fit else _turn


@cache
def _compiled() -> _Turn:
    import numba

    turner: _Turn = numba.njit(_turn)
    return turner


def _turn(x: Any, y: Any, start: Any, following: Any, twin: Any, triangle: Any, first: Any) -> None:
    """Turn diagonals, the last side first, and after each turn the four sides about it."""
    turns = [0] * len(start)
    waiting = [(0, 0)]
    waiting.pop()
    for begun in range(len(start) - 1, -1, -1):
        waiting.append((begun, 0))
        while waiting:
            side, seen = waiting.pop()
            back = twin[side]
            if turns[side] != seen or back < 0:
                continue
            cb, ad = following[side], following[back]
            ba, dc = following[cb], following[ad]
            a, c, b, d = start[side], start[back], start[ba], start[dc]
            ax, ay, cx, cy = x[a] - x[d], y[a] - y[d], x[c] - x[d], y[c] - y[d]
            bx, by = x[b] - x[d], y[b] - y[d]
            of_a, of_c, of_b = cx * by - cy * bx, bx * ay - by * ax, ax * cy - ay * cx
            aa, cc, bb = ax * ax + ay * ay, cx * cx + cy * cy, bx * bx + by * by
            if of_a == 0 and of_c == 0 and of_b == 0:
                # Of four corners on one line the shorter diagonal, until one of the triangles has a neighbour off it.
                inside = bb < (ax - cx) ** 2 + (ay - cy) ** 2
            else:
                # Whether d is inside the circle through a, c and b, whose sum is longer than 64 bits.
                low = middle = high = 0
                for area, square in ((of_a, aa), (of_c, cc), (of_b, bb)):
                    low += (area & _LOW) * (square & _LOW)
                    middle += (area >> _BITS) * (square & _LOW) + (area & _LOW) * (square >> _BITS)
                    high += (area >> _BITS) * (square >> _BITS)
                middle += low >> _BITS
                high += middle >> _BITS
                inside = high > 0 or (high == 0 and (middle & _LOW > 0 or low & _LOW > 0))
            if not inside:
                continue
            one, other = triangle[side], triangle[back]
            turns[side] += 1
            turns[back] += 1
            start[side], start[back] = d, b
            following[ba], following[ad], following[side] = ad, side, ba
            following[dc], following[cb], following[back] = cb, back, dc
            triangle[ad], triangle[cb] = one, other
            first[one], first[other] = ba, dc
            waiting.append((ba, turns[ba]))
            waiting.append((ad, turns[ad]))
            waiting.append((dc, turns[dc]))
            waiting.append((cb, turns[cb]))
