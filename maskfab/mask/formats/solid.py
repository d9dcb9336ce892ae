"""Parts of the solids of a die: thicknesses, the glass, and the rigid placements of its cells.

A film centred on z = 0 is its own mirror image in z, so half a turn about an in-plane axis acts on it as a mirror does:
all eight orientations of an opening are rigid placements of one tile, and nothing needs a mirrored solid.

Coordinates are nanometres from the centre of the die's slot; z points away from the glass.

The chrome of a die as one closed surface.

The openings of all cells are merged on whole nanometres, so neighbours share no wall, and what is left of the film is
cut into triangles band by band. Bands part in the middle of dots, where nothing but the sides of openings crosses, so
both sides of a cut have the same corners.

Corners of dots mostly lie on common lines, and cutting ears off a polygon joins some of them to triangles without area.
Such a triangle and its neighbour across its longest side have another diagonal, too: the same corners, as many
triangles and the same outline, so what was closed stays closed, exactly.

Triangle meshes of dies: GLB, 3MF and STL, byte-identical between runs.

All hold the film as :func:`maskfab.mask.formats.solid.film` makes it, one closed surface. They are plain enough to be
written here, and are read back by a library that did not write them.
"""

from __future__ import annotations

import json
import math
import struct
import zipfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any, Literal
from xml.sax.saxutils import escape, quoteattr

import numpy as np
from klayout import db
from numpy.typing import NDArray

from maskfab.base import __version__
from maskfab.base.arrays import Floats, Ints
from maskfab.base.errors import OutputError
from maskfab.base.files import partial
from maskfab.base.model import CLEAR, ORIENTATIONS, Die, Panel, Point, Polygon
from maskfab.base.units import MM_PER_NM, UM_PER_NM
from maskfab.mask.layout import simple_polygon
from maskfab.mask.outlines import outline, unit_name, unit_shapes

CHROME_RGB = (0.55, 0.56, 0.60)
GLASS_RGB = (0.70, 0.85, 0.90)
GLASS_ALPHA = 0.3
MOST_CAD_VERTICES, MOST_CAD_CELLS = 4_000, 40_000
"""Of exact solids: the cut of an outline takes 0.5 s for 230 vertices, 8 s for 2200; a thousand cells take 0.6 s."""
MOST_MESH_VERTICES = 1_500_000
"""Of the outlines of all cells: a mesh has four times as many triangles."""
_NARROWEST_CORNER_NM, _CORNER_SHARE, _WIDEST_CORNER_SHARE = 10.0, 0.1, 2 / 3
"""Of a gap or neck at a corner: what float32 millimetres keep apart, and shares of a dot, by default and at most."""


@dataclass(frozen=True)
class Stack:
    """Thicknesses of a mask.

    Attributes:
        chrome_nm: of the film.
        glass_nm: of the substrate.
        exaggeration: factor on the film's thickness, for viewers that cannot show 100 nm; files say so.
        corners: what openings that touch by a corner get in a mesh: a gap of chrome between them, or a neck that joins
            them. No closed surface has a corner of no width.
        corner_nm: width of that; a tenth of a dot if None.
    """

    chrome_nm: float = 100.0
    glass_nm: float = 2_300_000.0
    exaggeration: float = 1.0
    corners: Literal["gap", "neck"] = "gap"
    corner_nm: float | None = None

    @property
    def film_nm(self) -> float:
        """Thickness of the film as drawn, from -film/2 to film/2; the glass lies below it."""
        return self.chrome_nm * self.exaggeration

    def corner_leg_nm(self, die: Die) -> int:
        """Distance from a corner that touches to where its gap or neck ends on the sides of the openings.

        Raises:
            OutputError: MF436 for a gap or neck below 10 nm, or above two thirds of a dot, which would meet the next.
        """
        dot_nm = die.panel.dot_nm
        width = _CORNER_SHARE * dot_nm if self.corner_nm is None else self.corner_nm
        widest = math.floor(_WIDEST_CORNER_SHARE * dot_nm)
        if not _NARROWEST_CORNER_NM <= width <= widest:
            raise OutputError(
                "MF436",
                f"openings touch by a corner, and a {self.corners} of {width:g} nm there is not within "
                f"{_NARROWEST_CORNER_NM:g} nm and {widest} nm, two thirds of a dot",
                where=f"die {die.name}",
                cure="State one that is, or leave glb, 3mf and stl out of export.formats",
            )
        return round(width / math.sqrt(2))

    def touching_remark(self, die: Die, touches: int) -> tuple[str, ...]:
        """Remark of a mesh about so many corners that touched."""
        if not touches:
            return ()
        width_um = self.corner_leg_nm(die) * math.sqrt(2) * UM_PER_NM
        return (f"{touches} touching corners have a {self.corners} of {width_um:.3g} um",)

    def remarks(self) -> tuple[str, ...]:
        """Remarks of a file about its thicknesses."""
        said = f"chrome {self.chrome_nm:g} nm on {self.glass_nm / 1e6:g} mm of glass"
        return (said,) if self.exaggeration == 1 else (said, f"film drawn {self.exaggeration:g} times too thick")


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
    """A name for every unit in use, no two alike, those of :func:`maskfab.mask.outlines.unit_name` where they
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
    """As :func:`check_solid_size`, of a mesh, which repeats the outlines of every cell.

    Raises:
        OutputError: MF410 if a cell has no chrome at all; MF412 for more than :data:`MOST_MESH_VERTICES`.
    """
    _check_chrome(die, kind)
    used, times = np.unique(die.panel.orientations // ORIENTATIONS, return_counts=True)
    vertices = sum(_vertices(die.panel, opening) * n for opening, n in zip(used.tolist(), times.tolist(), strict=True))
    if vertices > MOST_MESH_VERTICES:
        what = f"outlines of {vertices} vertices in all cells are more than the {MOST_MESH_VERTICES}"
        raise _too_large(die, kind, what, ", use step, which places every cell")


def _vertices(panel: Panel, opening: int) -> int:
    return sum(map(len, outline(panel.openings[opening].mask, panel.dot_nm)))


def _check_chrome(die: Die, kind: str) -> None:
    panel = die.panel
    for opening in openings_in_use(panel):
        if panel.gutter_nm == 0 and panel.openings[opening].mask.all():
            raise OutputError(
                "MF410",
                f"opening {panel.openings[opening].name} is clear all over its cell, so no chrome is left for a {kind}",
                where=f"die {die.name}",
                cure=f"Leave {kind} out of export.formats, or give the panel a gutter",
            )


def _too_large(die: Die, kind: str, what: str, instead: str = "") -> OutputError:
    cure = f"Leave {kind} out of export.formats for this die{instead}, or lay out a smaller panel"
    return OutputError("MF412", f"{what} of a {kind}", where=f"die {die.name}", cure=cure)


Triangle = tuple[int, int, int]

_FLAT_NM = 5.0
"""Triangles of less height are flat: float32 millimetres within a die could take their area."""
_BAND_CORNERS = 4_000
"""About as many as a band has: the time that ears take grows faster than their number beyond some thousands."""


@dataclass(frozen=True, eq=False)
class Mesh:
    """A closed surface, counter-clockwise triangles seen from outside.

    Attributes:
        vertices_nm: float64 [n, 3], no two alike.
        triangles: int64 [m, 3].
    """

    vertices_nm: Floats
    triangles: Ints


def film(die: Die, stack: Stack) -> tuple[Mesh, int]:
    """The chrome of a die from its slot's centre, round z = 0, and the number of corners that touched.

    Every side of a triangle belongs to two, and the triangles round every vertex are one fan. Chrome that openings part
    altogether is several such surfaces. Where openings touch by a corner they get the gap or neck of the stack.

    Raises:
        OutputError: MF436 as :meth:`maskfab.mask.formats.solid.Stack.corner_leg_nm`.
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
    cuts = [y0, *_cuts(die, y0, sum(each.num_points() for each in clear.each())), y0 + height]
    shapes = db.Shapes()
    shapes.insert(clear)
    points: list[Point] = []
    following: list[int] = []
    triangles: list[Ints] = []
    for low, high in pairwise(cuts):
        band = db.Box(x0, low, x0 + width, high)
        near = db.Region([each.polygon for each in shapes.each_overlapping(band)])
        for contours in _contours(db.Region(band) - near):
            triangles.append(triangulated(contours) + len(points))
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
    return [int(each) for each in every[np.arange(1, bands) * len(every) // bands]]


def _contours(chrome: db.Region) -> Iterator[list[Polygon]]:
    """Contours of every piece of a region: hull first, chrome on their left."""
    for piece in chrome.merged(True, 1).each():
        holes = (piece.each_point_hole(n) for n in range(piece.holes()))
        yield [tuple((point.x, point.y) for point in each)[::-1] for each in (piece.each_point_hull(), *holes)]


def triangulated(contours: Sequence[Polygon]) -> NDArray[np.int64]:
    """Triangles between the corners of a polygon: int64 [m, 3], counter-clockwise, counting through all contours.

    All have an area, and none is lower than 5 nm where another diagonal helps.

    Args:
        contours: hull counter-clockwise, holes clockwise, in nanometres. They may touch themselves in a corner, where
            the polygon is parted; no corner lies on a side.
    """
    from manifold3d import triangulate

    triangles = np.array(triangulate([np.array(each, dtype=np.float64) for each in contours]), dtype=np.int64)
    points = np.array([point for each in contours for point in each], dtype=np.int64)
    sides = np.roll(points[triangles], -1, axis=1) - points[triangles]
    doubled = sides[:, 0, 0] * sides[:, 1, 1] - sides[:, 0, 1] * sides[:, 1, 0]
    flat = np.flatnonzero(doubled < _FLAT_NM * np.hypot(sides[..., 0], sides[..., 1]).max(axis=1))
    if not flat.size:
        return triangles
    return np.array(_turned(points.tolist(), [(a, b, c) for a, b, c in triangles.tolist()], flat.tolist()), np.int64)


def _turned(points: Sequence[Point], triangles: list[Triangle], flat: list[int]) -> list[Triangle]:
    """The triangles, diagonals of the flat ones turned wherever that raises the lower of two neighbours.

    Two neighbours on one line stay there, but get a shorter diagonal. So no turn is ever taken back.
    """
    owner = {side: n for n, (a, b, c) in enumerate(triangles) for side in ((a, b), (b, c), (c, a))}
    turned = set(flat)
    while turned:
        flat = [n for n in sorted({*flat, *turned}) if _height(points, triangles[n]) < _FLAT_NM]
        turned = set()
        # The longest first: of several on one line it is the one with a neighbour off the line.
        for n in sorted(flat, key=lambda n: _longest(points, triangles[n]), reverse=True):
            a, b, c = max(_rotations(triangles[n]), key=lambda each: _distance(points, each[0], each[2]))
            across = owner.get((a, c))
            if across is None or _height(points, (a, b, c)) >= _FLAT_NM:
                continue
            (d,) = {*triangles[across]} - {a, c}
            one: Triangle = (a, b, d)
            two: Triangle = (b, c, d)
            old = [_height(points, (a, b, c)), _height(points, (a, c, d))]
            new = [_height(points, one), _height(points, two)]
            closer = not any(old + new) and _distance(points, b, d) < _distance(points, a, c)
            if min(new) > min(old) or closer:
                triangles[n], triangles[across] = one, two
                del owner[a, c], owner[c, a]
                owner |= {(b, d): n, (d, a): n, (d, b): across, (c, d): across, (a, b): n, (b, c): across}
                turned |= {n, across}
    return triangles


def _rotations(triangle: Triangle) -> tuple[Triangle, Triangle, Triangle]:
    a, b, c = triangle
    return (a, b, c), (b, c, a), (c, a, b)


def _distance(points: Sequence[Point], a: int, b: int) -> float:
    return math.dist(points[a], points[b])


def _longest(points: Sequence[Point], triangle: Triangle) -> float:
    return max(_distance(points, a, c) for a, _, c in _rotations(triangle))


def _height(points: Sequence[Point], triangle: Triangle) -> float:
    """Over the longest side; 0 exactly on a line, negative clockwise."""
    (xa, ya), (xb, yb), (xc, yc) = (points[n] for n in triangle)
    return ((xb - xa) * (yc - ya) - (yb - ya) * (xc - xa)) / _longest(points, triangle)


_STL_LIMIT = 100_000_000
_STL_HEAD = 84
_STL_TRIANGLE = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])

_FLOAT, _UNSIGNED = 5126, 5125
_VERTICES, _INDICES = 34962, 34963
_Y_UP = (1, 0, 0, 0, 0, 0, -1, 0, 0, 1, 0, 0, 0, 0, 0, 1)
"""glTF's y points up, a die's z; columns of the matrix."""
_DARK = (0.09, 0.1, 0.11)
_GLASS_ALPHA = 0.2

_MODEL = "3D/3dmodel.model"
_CONTENT_TYPES = (
    '<?xml version="1.0" encoding="UTF-8"?>\n'
    '<Types xmlns="http://schemas.openxmlformats.org/package/2006/content-types">'
    '<Default Extension="rels" ContentType="application/vnd.openxmlformats-package.relationships+xml"/>'
    '<Default Extension="model" ContentType="application/vnd.ms-package.3dmanufacturing-3dmodel+xml"/></Types>\n'
)
_RELATIONS = (
    '<?xml version="1.0" encoding="UTF-8"?>\n'
    '<Relationships xmlns="http://schemas.openxmlformats.org/package/2006/relationships">'
    f'<Relationship Target="/{_MODEL}" Id="rel0" Type="http://schemas.microsoft.com/3dmanufacturing/2013/01/3dmodel"/>'
    "</Relationships>\n"
)


def write_glb(die: Die, path: Path, comments: Sequence[str] = (), stack: Stack | None = None) -> None:
    """Write a die as binary glTF 2.0, in metres: a node of glass, and one of chrome.

    The film's vertices are whole nanometres under a node that scales them, so float32 holds them exactly in dies of up
    to 33.5 mm; beyond, they are rounded to 2 or 4 nm. The root node turns z up into glTF's y up. Comments and
    thicknesses stand in ``asset.extras``.

    Raises:
        OutputError: MF401 if the file cannot be written; MF436 as :func:`maskfab.mask.formats.solid.film`; MF410 or
            MF412 as :func:`maskfab.mask.formats.solid.check_mesh_size`; MF437 if rounding makes one of two vertices.
    """
    stack = stack or Stack()
    check_mesh_size(die, "glb")
    chrome, touches = film(die, stack)
    low, high = glass(die, stack)
    nodes: list[dict[str, Any]] = [{"name": die.name, "matrix": _Y_UP, "children": [1, 2]}]
    blocks: list[bytes] = []
    views: list[dict[str, Any]] = []
    accessors: list[dict[str, Any]] = []
    meshes: list[dict[str, Any]] = []
    # A unit cube of glass and a film one unit thick: in both, scales are exact where corners in metres would not be.
    flat = np.array([1.0, 1.0, stack.film_nm])
    parts = (
        ("GLASS", box_mesh(np.zeros(3), np.ones(3)), {"translation": _metres(low), "scale": _metres(high - low)}),
        ("FILM", Mesh(chrome.vertices_nm / flat, chrome.triangles), {"scale": _metres(flat)}),
    )
    for n, (name, mesh, place) in enumerate(parts):
        points = _float32(die, "glb", mesh.vertices_nm)
        for block, target in ((points, _VERTICES), (mesh.triangles.astype("<u4"), _INDICES)):
            start = sum(view["byteLength"] for view in views)
            views.append({"buffer": 0, "byteOffset": start, "byteLength": block.nbytes, "target": target})
            blocks.append(block.tobytes())
        bounds = {"min": points.min(axis=0).tolist(), "max": points.max(axis=0).tolist()}
        accessors.append({"bufferView": 2 * n, "componentType": _FLOAT, "count": len(points), "type": "VEC3", **bounds})
        indices = {"bufferView": 2 * n + 1, "componentType": _UNSIGNED, "type": "SCALAR"}
        accessors.append({**indices, "count": mesh.triangles.size})
        primitive = {"attributes": {"POSITION": 2 * n}, "indices": 2 * n + 1, "material": n}
        meshes.append({"name": f"{die.name}_{name}", "primitives": [primitive]})
        nodes.append({"name": name, "mesh": n, **place})
    said = [*comments, *stack.remarks(), *stack.touching_remark(die, touches)]
    document = {
        "asset": {
            "version": "2.0",
            "generator": f"maskfab {__version__}",
            "extras": {"comments": said, "exaggeration": stack.exaggeration},
        },
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": nodes,
        "meshes": meshes,
        "materials": [
            {"name": "glass", "alphaMode": "BLEND", "pbrMetallicRoughness": _surface(_GLASS_ALPHA)},
            {"name": "chrome", "pbrMetallicRoughness": _surface(1)},
        ],
        "accessors": accessors,
        "bufferViews": views,
        "buffers": [{"byteLength": sum(map(len, blocks))}],
    }
    text = json.dumps(document, separators=(",", ":")).encode()
    text += b" " * (-len(text) % 4)
    data = b"".join(blocks)
    with partial(path) as place_aside, place_aside.open("wb") as file:
        file.write(struct.pack("<4sII", b"glTF", 2, 12 + 8 + len(text) + 8 + len(data)))
        file.write(struct.pack("<I4s", len(text), b"JSON") + text)
        file.write(struct.pack("<I4s", len(data), b"BIN\0") + data)


def write_3mf(die: Die, path: Path, comments: Sequence[str] = (), stack: Stack | None = None) -> None:
    """Write a die as 3MF, in micrometres: an object of glass, and one of chrome.

    Coordinates are decimals, exact to 1e-4 nm. Comments and thicknesses stand in the metadata ``Description``.

    Raises:
        OutputError: MF401 if the file cannot be written; MF436 as :func:`maskfab.mask.formats.solid.film`; MF410 or
            MF412 as :func:`maskfab.mask.formats.solid.check_mesh_size`.
    """
    stack = stack or Stack()
    check_mesh_size(die, "3mf")
    chrome, touches = film(die, stack)
    low, high = glass(die, stack)
    said = (*comments, *stack.remarks(), *stack.touching_remark(die, touches))
    with partial(path) as place, zipfile.ZipFile(place, "w", zipfile.ZIP_DEFLATED) as package:
        _store(package, "[Content_Types].xml", _CONTENT_TYPES)
        _store(package, "_rels/.rels", _RELATIONS)
        parts = [
            '<?xml version="1.0" encoding="UTF-8"?>\n<model unit="micron" xml:lang="en-US" '
            'xmlns="http://schemas.microsoft.com/3dmanufacturing/core/2015/02">\n',
            f'<metadata name="Title">{escape(die.name)}</metadata>\n',
            f'<metadata name="Application">maskfab {__version__}</metadata>\n',
            f'<metadata name="Description">{escape("; ".join(said))}</metadata>\n',
            "<resources>\n",
        ]
        parts += _mesh_xml(1, f"{die.name}_GLASS", box_mesh(np.zeros(3), high - low))
        parts += _mesh_xml(2, f"{die.name}_FILM", chrome)
        parts += ["</resources>\n<build>\n", _item(1, *low, name="GLASS"), _item(2, 0.0, 0.0, 0.0, name="FILM")]
        parts.append("</build>\n</model>\n")
        _store(package, _MODEL, "".join(parts))


def write_stl(
    die: Die,
    path: Path,
    comments: Sequence[str] = (),
    stack: Stack | None = None,
    *,
    limit_bytes: int = _STL_LIMIT,
    force: bool = False,
) -> None:
    """Write the chrome of a die as binary STL, in millimetres; without the glass, which would touch it everywhere.

    Vertices are float32 millimetres from the middle of the die, so they are rounded to 0.5 nm at 8 to 16 mm from it, to
    1 nm at 16 to 32 mm; those of one place are rounded alike. The head of 80 bytes holds the unit and as much of the
    remarks and of the first comment as fits.

    Args:
        die: what to write.
        path: the file.
        comments: lines about it.
        stack: thicknesses; those of the glass do not matter.
        limit_bytes: the largest file that is written.
        force: write it nonetheless.

    Raises:
        OutputError: MF401 if the file cannot be written; MF411 if it would be larger than ``limit_bytes``; MF436 as
            :func:`maskfab.mask.formats.solid.film`; MF410 or MF412 as
            :func:`maskfab.mask.formats.solid.check_mesh_size`; MF437 if rounding makes one of two vertices.
    """
    stack = stack or Stack()
    check_mesh_size(die, "stl")
    chrome, touches = film(die, stack)
    count = len(chrome.triangles)
    size = _STL_HEAD + _STL_TRIANGLE.itemsize * count
    if size > limit_bytes and not force:
        raise OutputError(
            "MF411",
            f"an STL of {die.panel.orientations.size} cells would take {size / 1e6:.1f} MB, "
            f"more than {limit_bytes / 1e6:g} MB",
            where=f"die {die.name}",
            cure="Use glb, which takes half of it, or raise export.stl_limit_mb",
        )
    table = np.zeros(count, dtype=_STL_TRIANGLE)
    table["corners"] = _float32(die, "stl", chrome.vertices_nm * MM_PER_NM)[chrome.triangles]
    # Of what is exact: a wall is no higher than the rounding of a die's coordinates leaves it.
    corners = chrome.vertices_nm[chrome.triangles]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    table["normal"] = normals / np.linalg.norm(normals, axis=1, keepdims=True)
    said = "; ".join(("unit mm", *stack.remarks()[1:], *stack.touching_remark(die, touches), *comments))
    head = said.encode("ascii", "replace")[:80].ljust(80)
    with partial(path) as place, place.open("wb") as file:
        file.write(head + struct.pack("<I", count))
        file.write(table.tobytes())


def _float32(die: Die, kind: str, vertices: Floats) -> NDArray[np.float32]:
    """Vertices as a format rounds them, [n, 3].

    Raises:
        OutputError: MF437 if two become one.
    """
    rounded = vertices.astype("<f4")
    flat, heights = rounded[:, 0] + 1j * rounded[:, 1], rounded[:, 2]
    if sum(len(np.unique(flat[heights == each])) for each in np.unique(heights)) < len(vertices):
        raise OutputError(
            "MF437",
            f"corners of die {die.name} lie so near to one another that float32 makes one of two in a {kind}",
            where=f"die {die.name}",
            cure=f"Use 3mf, whose decimals are exact, and leave {kind} out of export.formats",
        )
    return rounded


def _surface(alpha: float) -> dict[str, Any]:
    """Appearance of glass and chrome: the same, so that it does not show which of the two a viewer takes to be nearer.

    They lie 100 nm apart, less than the depth buffer of most viewers resolves for a whole die, which mottles the chrome
    with any other colour of glass. Matt and without metal they stay dark where a light shines back at the camera.
    """
    return {"baseColorFactor": [*_DARK, alpha], "metallicFactor": 0, "roughnessFactor": 0.7}


def _metres(point_nm: Sequence[float] | NDArray[np.float64]) -> list[float]:
    # 13 decimals are 1e-4 nm; rounding takes away the noise of the product.
    return [round(float(value) * 1e-9, 13) for value in point_nm]


def _um(value_nm: float) -> str:
    """Micrometres to 1e-4 nm, without trailing zeros."""
    return f"{value_nm * UM_PER_NM:.7f}".rstrip("0").rstrip(".")


def _item(number: int, x: float, y: float, z: float, *, name: str) -> str:
    place = f"1 0 0 0 1 0 0 0 1 {_um(x)} {_um(y)} {_um(z)}"
    return f'<item objectid="{number}" transform="{place}" partnumber="{name}"/>\n'


def _mesh_xml(number: int, name: str, mesh: Mesh) -> Iterator[str]:
    yield f'<object id="{number}" name={quoteattr(name)} type="model"><mesh><vertices>\n'
    for x, y, z in mesh.vertices_nm.tolist():
        yield f'<vertex x="{_um(x)}" y="{_um(y)}" z="{_um(z)}"/>\n'
    yield "</vertices><triangles>\n"
    for a, b, c in mesh.triangles.tolist():
        yield f'<triangle v1="{a}" v2="{b}" v3="{c}"/>\n'
    yield "</triangles></mesh></object>\n"


def _store(package: zipfile.ZipFile, name: str, text: str) -> None:
    """Add a part without the time of day."""
    entry = zipfile.ZipInfo(name, (1980, 1, 1, 0, 0, 0))
    entry.compress_type = zipfile.ZIP_DEFLATED
    package.writestr(entry, text.encode())
