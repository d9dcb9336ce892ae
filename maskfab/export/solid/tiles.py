"""The chrome film of one cell as a solid, and the rigid placements that make a die of it.

A film centred on z = 0 is its own mirror image in z, so half a turn about an in-plane axis acts on it as a mirror does:
all eight orientations of an opening are rigid placements of one tile, and nothing needs a mirrored solid.

Coordinates are nanometres from the centre of the die's slot; z points away from the glass.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from klayout import db
from numpy.typing import NDArray

from maskfab.errors import OutputError
from maskfab.export.solid.triangulation import triangulated
from maskfab.geometry.polygonize import outline
from maskfab.geometry.unit_cell import unit_name
from maskfab.model import ORIENTATIONS, Die, Panel, Point, Polygon

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

CHROME_RGB = (0.55, 0.56, 0.60)
GLASS_RGB = (0.70, 0.85, 0.90)
GLASS_ALPHA = 0.3
MOST_CAD_VERTICES, MOST_CAD_CELLS = 4_000, 40_000
"""Of exact solids: the cut of an outline takes 0.5 s for 230 vertices, 8 s for 2200; a thousand cells take 0.6 s."""
MOST_MESH_VERTICES, MOST_MESH_CELLS = 1_000_000, 1_000_000


@dataclass(frozen=True)
class Stack:
    """Thicknesses of a mask.

    Attributes:
        chrome_nm: of the film.
        glass_nm: of the substrate.
        exaggeration: factor on the film's thickness, for viewers that cannot show 100 nm; files say so.
    """

    chrome_nm: float = 100.0
    glass_nm: float = 2_300_000.0
    exaggeration: float = 1.0

    @property
    def film_nm(self) -> float:
        """Thickness of the film as drawn, from -film/2 to film/2; the glass lies below it."""
        return self.chrome_nm * self.exaggeration

    def remarks(self) -> tuple[str, ...]:
        """Remarks of a file about its thicknesses."""
        said = f"chrome {self.chrome_nm:g} nm on {self.glass_nm / 1e6:g} mm of glass"
        return (said,) if self.exaggeration == 1 else (said, f"film drawn {self.exaggeration:g} times too thick")


@dataclass(frozen=True, eq=False)
class Mesh:
    """A closed surface, counter-clockwise triangles seen from outside.

    Attributes:
        vertices_nm: float64 [n, 3].
        triangles: int64 [m, 3].
    """

    vertices_nm: Floats
    triangles: Ints

    def turned(self, orientation: int) -> Mesh:
        """The mesh under the rigid placement of an orientation."""
        return Mesh(self.vertices_nm @ rotation(orientation).T, self.triangles)


def rotation(orientation: int) -> Floats:
    """float64 [3, 3] of determinant 1 that places a tile as :func:`maskfab.model.orient` turns its opening."""
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
    """A name for every unit in use, no two alike, those of :func:`maskfab.geometry.unit_cell.unit_name` where they
    serve."""
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


def film(panel: Panel, opening: int, stack: Stack) -> Mesh:
    """The chrome of one cell, not turned, its openings cut out; from the cell's centre. Every triangle has an area.

    Where two clear dots meet by a corner the surface has that edge twice, so every edge has two faces.
    """
    points: list[Point] = []
    following: list[int] = []
    triangles: list[Ints] = []
    for contours in _chrome(panel, opening):
        triangles.append(triangulated(contours) + len(points))
        for contour in contours:
            first = len(points)
            points += contour
            following += (*range(first + 1, len(points)), first)
    flat, upper = np.array(points) - panel.pitch_nm / 2, np.concatenate(triangles)
    count = len(flat)
    # The upper face, then the lower one, whose corners stand in the same order.
    vertices = np.column_stack([np.tile(flat, (2, 1)), np.repeat([0.5, -0.5], count) * stack.film_nm])
    here, there = np.arange(count), np.array(following)
    walls = ([here + count, there + count, there], [here + count, there, here])
    return Mesh(vertices, np.concatenate([upper, upper[:, ::-1] + count, *(np.column_stack(wall) for wall in walls)]))


def _chrome(panel: Panel, opening: int) -> Iterator[list[Polygon]]:
    """Contours of every piece of a cell's chrome, from the cell's lower left corner: hull first, chrome on their left.

    Pieces are parted, and contours touch themselves, where two clear dots meet by a corner.
    """
    gutter = panel.gutter_nm // 2
    clear = db.Region()
    for hole in outline(panel.openings[opening].mask, panel.dot_nm, (gutter, gutter)):
        clear.insert(db.Polygon([db.Point(x, y) for x, y in hole]))
    cell = db.Region(db.Box(0, 0, panel.pitch_nm, panel.pitch_nm))
    for piece in (cell - clear).merged(True, 1).each():
        holes = (piece.each_point_hole(n) for n in range(piece.holes()))
        yield [tuple((point.x, point.y) for point in each)[::-1] for each in (piece.each_point_hull(), *holes)]


def films(panel: Panel, stack: Stack) -> dict[int, Mesh]:
    """The chrome of every unit in use, turned."""
    tiles = {opening: film(panel, opening, stack) for opening in openings_in_use(panel)}
    return {cell: tiles[cell // ORIENTATIONS].turned(cell % ORIENTATIONS) for cell in units_in_use(panel)}


def glass(die: Die, stack: Stack) -> tuple[Floats, Floats]:
    """Lower and upper corner of the substrate under a panel, float64 [3] each."""
    x0, y0, x1, y1 = die.box_nm
    x, y = die.centre_nm
    top = -stack.film_nm / 2
    return np.array([x0 - x, y0 - y, top - stack.glass_nm]), np.array([x1 - x, y1 - y, top])


def box_mesh(low_nm: Floats, high_nm: Floats) -> Mesh:
    """A box between two corners."""
    corners = np.array([[x, y, z] for z in (0, 1) for y in (0, 1) for x in (0, 1)])
    quads = ((0, 2, 3, 1), (4, 5, 7, 6), (0, 1, 5, 4), (2, 6, 7, 3), (0, 4, 6, 2), (1, 3, 7, 5))
    triangles = [half for a, b, c, d in quads for half in ((a, b, c), (a, c, d))]
    return Mesh(low_nm + corners * (high_nm - low_nm), np.array(triangles, dtype=np.int64))


def check_solid_size(die: Die, kind: str, most_vertices: int, most_cells: int) -> None:
    """Refuse what cannot be made, or not in reasonable time, before any work starts.

    Raises:
        OutputError: MF410 if a cell has no chrome at all; MF412 if the outlines of the openings in use have more than
            ``most_vertices`` vertices together, or the panel more than ``most_cells`` cells.
    """
    panel, where = die.panel, f"die {die.name}"
    for opening in openings_in_use(panel):
        if panel.gutter_nm == 0 and panel.openings[opening].mask.all():
            raise OutputError(
                "MF410",
                f"opening {panel.openings[opening].name} is clear all over its cell, so no chrome is left for a {kind}",
                where=where,
                cure=f"Leave {kind} out of export.formats, or give the panel a gutter",
            )
    cure = f"Leave {kind} out of export.formats for this die, or lay out a smaller panel"
    cells = panel.orientations.size
    if cells > most_cells:
        raise OutputError("MF412", f"{cells} cells are more than the {most_cells} of a {kind}", where=where, cure=cure)
    vertices = sum(len(hole) for opening in openings_in_use(panel) for hole in holes_nm(panel, opening))
    if vertices > most_vertices:
        what = f"outlines of {vertices} vertices are more than the {most_vertices} of a {kind}"
        raise OutputError("MF412", what, where=where, cure=cure)
