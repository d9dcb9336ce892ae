"""Run as a process of its own: reads DXF with ezdxf and writes what it draws, in nanometres, to stdout.

For drawings that have more than polygons and plain references to blocks. Nothing of ezdxf's geometry is used but the
values of entities: it approximates arcs by Bezier curves that leave those of a millimetre by a quarter of a micrometre,
and places blocks of unequal scales by decomposing them. Here every block is drawn once for each linear map that it is
placed by, the product of all scales and turns above it, so that curves keep their bound and corners are rounded once;
what is only shifted, or turned by quarters, stays a reference.

    python -P -W error dxf_process.py NM_PER_UNIT FILE
"""

from __future__ import annotations

import itertools
import math
import sys
import warnings
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np

from maskfab.base.arrays import Floats
from maskfab.base.errors import SourceError
from maskfab.mask.formats.drawing import ReadAs
from maskfab.mask.formats.dxf_curves import LONE_TIMES, Chains, bulged, conic, spline, wide_line
from maskfab.mask.formats.gdstk_process import CellArrays, cell_arrays
from maskfab.mask.process_limits import limit_share
from maskfab.mask.sandbox import answer_message, damaged, error_message

_LARGEST_MEMORY, _MEMORY_PER_BYTE = 3 << 29, 512
_MOST_CORNERS, _MOST_CELLS, _SECONDS = 20_000_000, 20_000, 20
_GAP_UNITS, _NARROWEST_NM, _WIDEST_NM = 1e-4, 2.0, 100.0
"""Ends of lines that lie so close are joined: a ten-thousandth of the drawing's unit, within these bounds."""

_IN_PLANE, _STRAIGHT, _ON_GRID_NM, _MOST_WEIGHT = 1e-9, 1e-12, 1e-4, 1e9
_MIRRORED = np.diag([-1.0, 1.0])
_TEXTS = {"TEXT", "MTEXT"}
PASSED_OVER = {
    *_TEXTS, "ATTRIB", "ATTDEF", "DIMENSION", "ARC_DIMENSION", "LARGE_RADIAL_DIMENSION", "LEADER", "MULTILEADER",
    "MLEADER", "TOLERANCE", "VIEWPORT", "RAY", "XLINE", "ACAD_TABLE",
}  # fmt: skip
"""Notes for people, and lines without end."""
_STYLES = (
    ("even-odd", "fills, islands left open"),
    ("outermost", "fills between the outer boundary and its islands"),
    ("union", "fills that ignore islands"),
)
_AREALESS = {"POINT", "MLINE"}


@dataclass(frozen=True)
class Fault:
    """Entities of one kind on one layer that no polygon can be made of; ``place`` is that of the first, in words."""

    code: str
    kind: str
    layer: str
    count: int
    place: str


@dataclass(frozen=True)
class Drawing:
    """Content of a DXF.

    Attributes:
        cells: as of :mod:`maskfab.mask.formats.gdstk_process`, the first one the drawing itself; the numbers of layers
            are places among ``layers``.
        curves: how many were made chords.
        gap_nm: the largest gap between ends of lines that were joined.
        rounding_nm: the largest distance by which a corner was moved to the nanometre grid where shapes were united.
        counted: entities of each block that is placed, by its name in capitals, "" for the drawing itself, and by kind.
    """

    cells: tuple[CellArrays, ...]
    layers: tuple[str, ...]
    read_as: tuple[ReadAs, ...]
    faults: tuple[Fault, ...]
    curves: int
    gap_nm: float
    rounding_nm: float
    counted: tuple[tuple[str, str, int], ...]


_Key: TypeAlias = tuple[str, str, tuple[float, ...]]
"""A block by its name in capitals, the layer of what it has on layer 0, and the map that it is drawn by."""


@dataclass(eq=False)
class _Cell:
    """One block under one map, collected entity by entity."""

    name: str
    matrix: Floats
    base: Floats
    layer: str
    outlines: list[tuple[int, Floats]] = field(default_factory=list)
    pieces: dict[int, list[tuple[Any, Floats]]] = field(default_factory=dict)
    labels: list[tuple[Any, ...]] = field(default_factory=list)
    references: list[tuple[Any, ...]] = field(default_factory=list)

    def at(self, points: Any, matrix: Floats | None = None) -> Floats:
        """Points of the block in nanometres of the cell."""
        whole = np.asarray(points, dtype=np.float64).reshape(-1, np.shape(points)[-1])[:, :2]
        placed: Floats = whole @ (self.matrix if matrix is None else matrix).T - self.matrix @ self.base
        return placed

    def arrays(self) -> CellArrays:
        corners = [points for _, points in self.outlines]
        polygons = {
            "corners": np.concatenate([np.empty((0, 2)), *corners]),
            "sizes": np.array([len(points) for points in corners], dtype=np.int64),
            "layers": np.array([(layer, 0) for layer, _ in self.outlines], dtype=np.int64).reshape(-1, 2),
            "repetitions": {},
        }
        return cell_arrays(
            {"name": self.name, "polygons": polygons, "labels": self.labels, "references": self.references}
        )


class _UnreadableError(Exception):
    """An entity that no polygon can be made of, with the code of its fault."""

    def __init__(self, code: str, what: str) -> None:
        super().__init__(what)
        self.code, self.what = code, what


class _Reader:
    def __init__(self, path: Path, document: Any, nm_per_unit: float) -> None:
        self._path, self._document, self._nm = path, document, nm_per_unit
        self._gap_limit = min(max(_GAP_UNITS * nm_per_unit, _NARROWEST_NM), _WIDEST_NM)
        self._layers: list[str] = []
        self._places: dict[str, int] = {}
        self._cells: dict[_Key, _Cell] = {}
        self._names = set[str]()
        self._todo: list[tuple[_Cell, Any]] = []
        self._fates: Counter[tuple[str, str, str]] = Counter()
        self._faults: dict[tuple[str, str, str], list[Any]] = {}
        self._told: set[Any] = set()
        self._counted: Counter[tuple[str, str]] = Counter()
        self._corners = self._curves = 0
        self._gap_nm = self._rounding_nm = 0.0
        self._kinds: dict[str, Callable[[_Cell, Any, int], str]] = {
            "LWPOLYLINE": self._lwpolyline,
            "POLYLINE": self._polyline,
            "CIRCLE": self._round,
            "ARC": self._round,
            "ELLIPSE": self._round,
            "SPLINE": self._spline,
            "LINE": self._line,
            "SOLID": self._face,
            "TRACE": self._face,
            "3DFACE": self._face,
            "HATCH": self._hatch,
            "INSERT": self._insert,
        }

    def drawing(self) -> Drawing:
        space = self._document.modelspace()
        self._todo.append((_Cell("TOP", np.eye(2) * self._nm, np.zeros(2), "0"), space))
        contents, counted = [], set[str]()
        while self._todo:
            cell, block = self._todo.pop()
            name = "" if block is space else str(block.name).upper()
            if name not in counted:
                counted.add(name)
                self._counted.update((name, entity.dxftype()) for entity in block)
            for entity in block:
                self._take(cell, entity)
            for layer in list(cell.pieces):
                self._join(cell, layer)
            contents.append(cell.arrays())
        return Drawing(
            tuple(contents),
            tuple(self._layers),
            tuple(ReadAs(kind, layer, read_as, n) for (kind, layer, read_as), n in sorted(self._fates.items())),
            tuple(
                Fault(code, kind, layer, n, place)
                for (code, kind, layer), (n, place) in sorted(self._faults.items(), key=lambda item: item[0])
            ),
            self._curves,
            self._gap_nm,
            self._rounding_nm,
            tuple((*key, n) for key, n in self._counted.items()),
        )

    def _layer(self, entity: Any, cell: _Cell) -> int:
        """Place of a layer, by the first spelling of its name."""
        from ezdxf.lldxf.encoding import decode_dxf_unicode

        name = decode_dxf_unicode(str(entity.dxf.get("layer", "0")))
        name = cell.layer if name == "0" else name
        name.encode()  # refuses what is no text
        place = self._places.setdefault(name.upper(), len(self._layers))
        if place == len(self._layers):
            self._layers.append(name)
        return place

    def _take(self, cell: _Cell, entity: Any) -> None:
        kind, layer = entity.dxftype(), self._layer(entity, cell)
        if entity.dxf.get("invisible", 0) or entity.dxf.get("paperspace", 0):
            return  # told by who looks for what is out of sight
        if kind in _TEXTS and _facing(entity):
            ((x, y),) = np.rint(cell.at([entity.dxf.insert], self._plane(cell, entity)))
            cell.labels.append((str(entity.dxf.get("text", "") or "text")[:80], (x, y), layer, 0, None))
        if kind in PASSED_OVER:
            self._tell(entity, layer, "")
            return
        try:
            if kind not in self._kinds:
                raise _UnreadableError("MF310" if kind in _AREALESS else "MF311", kind)
            read_as = self._kinds[kind](cell, entity, layer)
        except _UnreadableError as fault:
            self._blame(entity, layer, fault.code, fault.what, "" if cell.name == "TOP" else f"in block {cell.name}")
        else:
            if read_as:
                self._tell(entity, layer, read_as)

    def _tell(self, entity: Any, layer: int, read_as: str) -> None:
        if (entity, layer) not in self._told:  # in a block that is drawn by several maps
            self._told.add((entity, layer))
            self._fates[entity.dxftype(), self._layers[layer], read_as] += 1

    def _blame(self, entity: Any, layer: int, code: str, what: str, place: str) -> None:
        if (entity, layer) not in self._told:
            self._told.add((entity, layer))
            self._faults.setdefault((code, what, self._layers[layer]), [0, place])[0] += 1

    def _plane(self, cell: _Cell, entity: Any) -> Floats:
        """Map of an entity whose coordinates are those of its own plane, which may be seen from below."""
        facing = _facing(entity)
        if not facing:
            raise _UnreadableError("MF317", f"{entity.dxftype()} out of the plane")
        return cell.matrix @ _MIRRORED if facing < 0 else cell.matrix

    def _draw(self, cell: _Cell, layer: int, points: Floats) -> None:
        self._corners += len(points)
        if self._corners > _MOST_CORNERS:
            cure = "Draw one die at a time, or fewer curves"
            what = f"{self._path.name} has over {_MOST_CORNERS:.0e} corners once its curves are chords"
            raise SourceError("MF313", what, where=str(self._path), cure=cure)
        if not np.isfinite(points).all():
            raise _UnreadableError("MF303", "coordinates that are no numbers")
        cell.outlines.append((layer, points))

    def _fill(self, cell: _Cell, layer: int, loops: Sequence[Floats], style: str) -> None:
        if len(loops) == 1:
            self._draw(cell, layer, loops[0])
            return
        for loop in loops:
            off = float(np.abs(loop - np.rint(loop)).max())
            self._rounding_nm = max(self._rounding_nm, off if off > _ON_GRID_NM else 0.0)
        for outline in _merged(loops, style):
            self._draw(cell, layer, outline)

    def _curve(self, cell: _Cell, layer: int, points: Floats) -> None:
        self._curves += 1
        self._draw(cell, layer, _distinct(points))

    def _piece(self, cell: _Cell, layer: int, entity: Any, points: Floats) -> str:
        if not np.isfinite(points).all():
            raise _UnreadableError("MF303", "coordinates that are no numbers")
        if float(np.ptp(points, axis=0).max()) <= self._gap_limit:
            return "nothing, for it has no length"
        cell.pieces.setdefault(layer, []).append((entity, points))
        return ""

    def _arc_piece(self, cell: _Cell, layer: int, entity: Any, points: Floats) -> str:
        self._curves += 1
        return self._piece(cell, layer, entity, _distinct(points, closed=False))

    def _join(self, cell: _Cell, layer: int) -> None:
        """Outlines of the open pieces on a layer; those that are drawn twice count once."""
        found: dict[bytes, tuple[Any, Floats]] = {}
        for entity, points in cell.pieces[layer]:
            forth, back = np.rint(points) + 0.0, np.rint(points[::-1]) + 0.0  # no zero below zero
            key = min(forth.tobytes(), back.tobytes())
            if key in found:
                self._tell(entity, layer, "nothing, for it repeats another")
            else:
                found[key] = entity, points
        chains = Chains([points for _, points in found.values()], self._gap_limit)
        faults, used = chains.faults, set[int]()
        for loops, pieces, met in chains.groups:
            if met is not None and _is_open_within(loops):
                faults.append(met)
            else:
                self._fill(cell, layer, loops, "even-odd")
                used.update(pieces)
        self._gap_nm = max(self._gap_nm, chains.gap_nm)
        place = ""
        if faults:
            at, ends = faults[0]
            x, y = np.linalg.solve(cell.matrix, at) + cell.base
            there = f"at ({x:.6g}, {y:.6g})" + ("" if cell.name == "TOP" else f" of block {cell.name}")
            place = f"{ends} ends meet {there}"
            if ends == 1:
                apart = np.partition(np.linalg.norm(chains.ends - at, axis=1), 1)[1]
                within = LONE_TIMES * self._gap_limit
                place = f"1 end lies alone {there}, {apart:.4g} nm from the next; {within:g} nm are joined"
        for number, (entity, _) in enumerate(found.values()):
            if number in used:
                self._tell(entity, layer, "a part of an outline")
            else:
                kind = entity.dxftype()
                what = f"open {kind}" if kind.endswith("LINE") and kind != "LINE" else kind
                self._blame(entity, layer, "MF310", what, place)

    # --- kinds of entities; each says what it was read as, and pieces only once they are joined ----------------------

    def _round(self, cell: _Cell, entity: Any, layer: int) -> str:
        matrix, dxf, start, stop = self._plane(cell, entity), entity.dxf, 0.0, 2 * math.pi
        if entity.dxftype() == "ELLIPSE":  # in the plane of the drawing, around its own direction
            matrix = cell.matrix
            major = np.array(tuple(dxf.major_axis)[:2])
            minor = np.array([-major[1], major[0]]) * dxf.ratio * _facing(entity)
            start, stop = _turn(dxf.start_param, dxf.end_param)
        else:
            if not 0 <= dxf.radius < math.inf:
                raise _UnreadableError("MF303", f"{entity.dxftype()} of radius {dxf.radius:g}")
            major, minor = np.eye(2) * dxf.radius
            if entity.dxftype() == "ARC":
                start, stop = _turn(math.radians(dxf.start_angle), math.radians(dxf.end_angle))
        points = self._conic(cell, dxf.center, matrix, major, minor, (start, stop))
        if stop - start < 2 * math.pi:
            return self._arc_piece(cell, layer, entity, points)
        self._curve(cell, layer, points[:-1])
        return "curves"

    def _conic(
        self, cell: _Cell, at: Any, matrix: Floats, major: Floats, minor: Floats, turn: tuple[float, float]
    ) -> Floats:
        self._refuse_large(float(np.linalg.norm(matrix, 2) * np.linalg.norm(major)))
        (centre,) = cell.at([tuple(at)], matrix)
        return conic(centre, matrix @ major, matrix @ minor, *turn)

    def _refuse_large(self, reach_nm: float) -> None:
        if not reach_nm <= 2**31:
            what = f"{self._path.name} reaches beyond 2.1 m"
            raise SourceError("MF313", what, where=str(self._path), cure="State its --unit")

    def _spline(self, cell: _Cell, entity: Any, layer: int) -> str:
        points = self._spline_points(cell, entity.control_points, entity.weights, entity.knots, entity.dxf.degree)
        return self._arc_piece(cell, layer, entity, points)

    def _spline_points(
        self, cell: _Cell, control: Any, weights: Any, knots: Any, degree: int, matrix: Floats | None = None
    ) -> Floats:
        places, at = np.array([tuple(point) for point in control]), np.array(knots, dtype=np.float64)
        if not len(places):
            raise _UnreadableError(
                "MF311", "SPLINE without control points, through which programs draw different curves"
            )
        if places.shape[1] > 2 and np.ptp(places[:, 2]) > _IN_PLANE * max(1.0, float(np.abs(places).max())):
            raise _UnreadableError("MF317", "SPLINE out of the plane")
        load = np.array(weights, dtype=np.float64) if len(weights) else np.ones(len(places))
        whole = len(at) == len(places) + degree + 1 and len(load) == len(places) and 1 <= degree < len(places)
        if not (whole and (np.diff(at) >= 0).all() and 0 < load.max() <= _MOST_WEIGHT * load.min()):
            raise _UnreadableError("MF311", "SPLINE whose knots or weights are none")
        nm = cell.at(places, matrix)
        self._refuse_large(float(np.abs(nm).max()))
        return spline(nm, load, at, degree)

    def _line(self, cell: _Cell, entity: Any, layer: int) -> str:
        _refuse_inclined(entity, [entity.dxf.start, entity.dxf.end])
        return self._piece(cell, layer, entity, cell.at([entity.dxf.start, entity.dxf.end]))

    def _face(self, cell: _Cell, entity: Any, layer: int) -> str:
        third, fourth = entity.dxf.vtx2, entity.dxf.get("vtx3", entity.dxf.vtx2)
        # Corners of a SOLID and a TRACE stand crosswise, in a plane of their own.
        flat = entity.dxftype() == "3DFACE"
        corners = [entity.dxf.vtx0, entity.dxf.vtx1, *((third, fourth) if flat else (fourth, third))]
        _refuse_inclined(entity, corners)
        points = cell.at(corners, cell.matrix if flat else self._plane(cell, entity))
        # A triangle has its last corner twice.
        self._draw(cell, layer, points[(points != np.roll(points, 1, axis=0)).any(axis=1)])
        return "polygons"

    def _lwpolyline(self, cell: _Cell, entity: Any, layer: int) -> str:
        rows = np.array(entity.get_points("xyseb"), dtype=np.float64).reshape(-1, 5)
        said = entity.dxf.get("const_width")
        if said is not None and rows[:, 2:4].any() and (rows[:, 2:4] != said).any():
            # The reference of DXF says that those of vertices count, and programs take the other.
            raise _UnreadableError("MF311", "LWPOLYLINE of two widths")
        rows[:, 2:4] = rows[:, 2:4] if said is None else said
        return self._vertices(cell, entity, layer, rows, self._plane(cell, entity), closed=bool(entity.closed))

    def _polyline(self, cell: _Cell, entity: Any, layer: int) -> str:
        if not (entity.is_2d_polyline or entity.is_3d_polyline):
            raise _UnreadableError("MF311", "POLYLINE of a surface")
        # Of a line that was smoothed the frame is kept beside what is drawn.
        drawn = [vertex.dxf for vertex in entity.vertices if not vertex.dxf.get("flags", 0) & 16]
        rows, matrix = np.zeros((len(drawn), 5)), cell.matrix
        rows[:, :2] = np.array([tuple(vertex.location)[:2] for vertex in drawn]).reshape(-1, 2)
        if entity.is_2d_polyline:
            matrix = self._plane(cell, entity)
            usual = (("start_width", "default_start_width"), ("end_width", "default_end_width"), ("bulge", ""))
            for column, (name, default) in enumerate(usual, 2):
                said = entity.dxf.get(default, 0.0) if default else 0.0
                rows[:, column] = [vertex.get(name, said) for vertex in drawn]
        elif drawn:
            _refuse_inclined(entity, [vertex.location for vertex in drawn])
        return self._vertices(cell, entity, layer, rows, matrix, closed=bool(entity.is_closed))

    def _vertices(self, cell: _Cell, entity: Any, layer: int, rows: Floats, matrix: Floats, *, closed: bool) -> str:
        """Draw a line of rows x, y, width at the start and at the end, bulge."""
        if len(rows) < 2:
            return "nothing, for it has no length"
        if rows[: len(rows) if closed else -1, 2:4].any():
            return self._wide(cell, layer, rows, matrix, closed=closed)
        returns = bool((rows[0, :2] == rows[-1, :2]).all()) and len(rows) > 2
        if closed or returns:
            rows = rows if closed and not returns else rows[:-1]
        if not rows[:, 4].any():
            points = cell.at(rows[:, :2], matrix)
            if closed or returns:
                self._draw(cell, layer, points)
                return "polygons"
            return self._piece(cell, layer, entity, points)
        ends = np.vstack([rows, rows[:1]]) if closed or returns else rows
        shift = cell.at(np.zeros((1, 2)), matrix)
        self._refuse_large(float(np.abs(ends[:, :2] @ matrix.T).max()))
        arcs = [bulged(a[:2], b[:2], a[4], matrix) + shift for a, b in itertools.pairwise(ends)]
        points = np.concatenate([*(arc[:-1] for arc in arcs), arcs[-1][-1:]])
        if closed or returns:
            self._curve(cell, layer, points[:-1])
            return "curves"
        return self._arc_piece(cell, layer, entity, points)

    def _wide(self, cell: _Cell, layer: int, rows: Floats, matrix: Floats, *, closed: bool) -> str:
        # Drawn as large as its map makes it, and then mapped, which makes no distance larger.
        size = float(np.linalg.norm(matrix, 2))
        ends = np.vstack([rows, rows[:1]]) if closed else rows
        self._refuse_large(float(np.abs(ends[:, :4]).max()) * size)
        self._curves += int(np.count_nonzero(ends[:-1, 4]))
        shift = cell.at(np.zeros((1, 2)), matrix)
        outlines = wide_line(ends * [size, size, size, size, 1], closed=closed)
        parts = [part @ (matrix / size).T + shift for part in outlines]
        if not parts:
            return "nothing, for it has no length"
        self._fill(cell, layer, parts, "union")
        return "lines with a width" + (", closed ones as rings" if closed else "")

    def _hatch(self, cell: _Cell, entity: Any, layer: int) -> str:
        if not entity.dxf.solid_fill:
            raise _UnreadableError("MF310", "HATCH of a pattern")
        matrix = self._plane(cell, entity)
        shift = cell.at(np.zeros((1, 2)), matrix)
        loops: list[Floats] = []
        for boundary in entity.paths:
            if hasattr(boundary, "vertices"):
                rows = np.array(boundary.vertices, dtype=np.float64).reshape(-1, 3)
                self._refuse_large(float(np.abs(rows[:, :2] @ matrix.T).max(initial=0.0)))
                ends = np.vstack([rows, rows[:1]])
                arcs = [bulged(a[:2], b[:2], a[2], matrix)[:-1] for a, b in itertools.pairwise(ends)]
                loops += [np.concatenate(arcs) + shift] if arcs else []
                self._curves += int(np.count_nonzero(rows[:, 2]))
                continue
            self._curves += sum(type(edge).__name__ != "LineEdge" for edge in boundary.edges)
            pieces = [self._edge(cell, edge, matrix) for edge in boundary.edges]
            pieces = [piece for piece in pieces if float(np.ptp(piece, axis=0).max()) > self._gap_limit]
            chains = Chains(pieces, self._gap_limit)
            if chains.faults or any(met for _, _, met in chains.groups):
                raise _UnreadableError("MF310", "HATCH whose boundary has gaps")
            self._gap_nm = max(self._gap_nm, chains.gap_nm)
            loops += [loop for group, _, _ in chains.groups for loop in group]
        style, read_as = _STYLES[min(max(int(entity.dxf.get("hatch_style", 0)), 0), 2)]
        self._fill(cell, layer, loops, style)
        return read_as

    def _edge(self, cell: _Cell, edge: Any, matrix: Floats) -> Floats:
        kind = type(edge).__name__
        if kind == "LineEdge":
            return cell.at([tuple(edge.start), tuple(edge.end)], matrix)
        if kind == "SplineEdge":
            return self._spline_points(cell, edge.control_points, edge.weights, edge.knot_values, edge.degree, matrix)
        if kind == "ArcEdge":
            major = np.array([edge.radius, 0.0])
            minor, turn = major[::-1], _turn(math.radians(edge.start_angle), math.radians(edge.end_angle))
        else:
            major = np.array(tuple(edge.major_axis)[:2])
            minor, turn = np.array([-major[1], major[0]]) * edge.ratio, _turn(edge.start_param, edge.end_param)
            if abs(edge.end_angle - edge.start_angle) >= 360:
                turn = 0.0, 2 * math.pi
        return self._conic(cell, edge.center, matrix, major, minor, turn)

    def _insert(self, cell: _Cell, entity: Any, layer: int) -> str:
        from ezdxf.xclip import XClip

        dxf = entity.dxf
        block = self._document.blocks.get(dxf.name)
        clip = XClip(entity)
        if clip.has_clipping_path and clip.is_clipping_enabled:
            raise _UnreadableError("MF317", "INSERT that is clipped")
        if block is None or block.block.is_xref:
            return ""  # told by who looks for what is lacking
        plane = self._plane(cell, entity)
        angle = math.radians(dxf.get("rotation", 0.0))
        turn = np.array([[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]])
        matrix = plane @ turn @ np.diag([dxf.get("xscale", 1.0), dxf.get("yscale", 1.0)])
        if not abs(np.linalg.det(matrix)) > 0:
            raise _UnreadableError("MF317", "INSERT of no size")
        (origin,) = cell.at([dxf.insert], plane)
        steps = (plane @ turn @ np.diag([dxf.get("column_spacing", 0.0), dxf.get("row_spacing", 0.0)])).T
        columns, rows = max(1, dxf.get("column_count", 1)), max(1, dxf.get("row_count", 1))
        placed = matrix / self._nm
        quarter = np.rint(placed)
        if np.abs(placed - quarter).max() <= _STRAIGHT and np.abs(quarter).sum() == 2:
            placed, matrix = quarter, np.eye(2) * self._nm
        else:
            placed = np.eye(2)
        name = self._cell(str(dxf.name).upper(), self._layers[layer], matrix, block)
        repetition = (columns, rows, steps) if columns * rows > 1 else None
        radians = math.atan2(placed[1, 0], placed[0, 0])
        cell.references.append((name, tuple(origin), radians, 1.0, np.linalg.det(placed) < 0, repetition))
        return ""

    def _cell(self, block: str, layer: str, matrix: Floats, content: Any) -> str:
        key = block, layer.upper(), tuple(matrix.ravel().tolist())
        if key not in self._cells:
            if len(self._cells) > _MOST_CELLS:
                what = f"{self._path.name} places blocks in over {_MOST_CELLS} different sizes and directions"
                raise SourceError("MF313", what, where=str(self._path), cure="Write one die at a time")
            content.name.encode()
            # What is called as its block is drawn as its block is; asked for by name, it is that.
            name = content.name if block != "TOP" else "TOP_"
            if name in self._names or not np.array_equal(matrix, np.eye(2) * self._nm):
                name += f"${len(self._names)}"
            self._names.add(name)
            base = np.array(tuple(content.block.dxf.base_point)[:2])
            self._cells[key] = _Cell(name, matrix, base, layer)
            self._todo.append((self._cells[key], content))
        return self._cells[key].name


def _facing(entity: Any) -> int:
    """1 if what is drawn is seen from its front, -1 from its back, 0 from the side."""
    x, y, z = entity.dxf.get("extrusion", (0, 0, 1))
    return (1 if z > 0 else -1) if math.hypot(x, y) < _IN_PLANE * abs(z) else 0


def _turn(start: float, stop: float) -> tuple[float, float]:
    """From an angle counterclockwise to another, once round at most."""
    turn = (stop - start) % (2 * math.pi)
    return start, start + (turn if turn > _IN_PLANE else 2 * math.pi)


def _refuse_inclined(entity: Any, corners: Sequence[Any]) -> None:
    heights = [corner[2] if len(corner) > 2 else 0.0 for corner in corners]
    reach = max(max(map(abs, tuple(corner))) for corner in corners)
    if max(heights) - min(heights) > _IN_PLANE * max(1.0, reach):
        raise _UnreadableError("MF317", f"{entity.dxftype()} out of the plane")


def _distinct(points: Floats, *, closed: bool = True) -> Floats:
    """Corners of a curve on the nanometre grid, without those that repeat the one before: no file drew them."""
    nearest = np.rint(points)
    moves = (nearest != np.roll(nearest, 1, axis=0)).any(axis=1)
    moves[0] |= not closed
    kept: Floats = nearest[moves] if moves.any() else nearest[:1]
    return kept


def _merged(loops: Sequence[Floats], fill: str) -> Iterator[Floats]:
    """Outlines without holes of what some loops fill, on the nanometre grid."""
    from klayout import db

    polygons = [_polygon(loop) for loop in loops]
    if fill == "even-odd":
        merged = db.EdgeProcessor().simple_merge_p2p(polygons, True, True, 0)
    else:
        drawn = db.Region(polygons)
        drawn.merged_semantics = False
        region = drawn.merged(True, 1)
        if fill == "outermost":
            region -= drawn.merged(True, 2)
        merged = db.EdgeProcessor().simple_merge_p2p(list(region.each()), True, True, 1)
    for polygon in merged:
        yield np.array([(point.x, point.y) for point in polygon.each_point_hull()], dtype=np.float64)


def _is_open_within(loops: Sequence[Floats]) -> bool:
    """Whether outlines that touch leave something open between or within them that they might also fill."""
    from klayout import db

    drawn = db.Region([_polygon(loop) for loop in _merged(loops, "even-odd")])
    around = db.Region(drawn.bbox().enlarged(1000)) - drawn
    return bool(around.merged(True, 1).count() > 1)


def _polygon(loop: Floats) -> Any:
    from klayout import db

    return db.Polygon([db.Point(int(x), int(y)) for x, y in np.rint(loop).tolist()])


def content(path: Path, nm_per_unit: float) -> Drawing:
    """All that a file draws. Raises SourceError MF303 if ezdxf cannot read it, MF313 for too much."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)  # those of its own packages are no fault of a file
        import ezdxf
        from ezdxf import recover

    try:
        try:
            document = ezdxf.readfile(path)
        except (ezdxf.DXFError, UnicodeError, ValueError):
            document, auditor = recover.readfile(path)
            if auditor.has_errors:
                raise damaged(path, str(auditor.errors[0].message)) from None
        return _Reader(path, document, nm_per_unit).drawing()
    except (ezdxf.DXFError, UnicodeError, ValueError, TypeError, AttributeError, LookupError, ArithmeticError) as error:
        raise damaged(path, f"it holds values that cannot be used ({str(error)[:200]})") from error


if __name__ == "__main__":
    file = Path(sys.argv[2])
    limit_share(file, _LARGEST_MEMORY, _MEMORY_PER_BYTE, _SECONDS)
    try:
        message = answer_message(content(file, float(sys.argv[1])), Drawing)
    except SourceError as error:
        message = error_message(error)
    sys.stdout.buffer.write(message)
