"""Hole-free, simple polygons whose union is a mask, exactly: of dots, of a panel's cells on every layer, of text.

GDSII and OASIS know no holes and mask writers refuse outlines that touch themselves, so a polygon with either is
bisected along a line of its own grid until neither is left. Mask houses differ, so :func:`recut` also draws holes as
keyholes, as trapezoids or as figures to subtract, and corners that kiss as one re-entrant outline. Text is drawn in the
plate's own stick font.
"""

from __future__ import annotations

import json
import math
from collections import Counter, defaultdict
from collections.abc import Iterator, Mapping, Set
from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise
from pathlib import Path
from types import MappingProxyType
from typing import Any, Literal, NamedTuple, TypeAlias

import numpy as np
from klayout import db
from numpy.typing import NDArray

from maskfab.base.arrays import Mask
from maskfab.base.errors import JobError
from maskfab.base.model import (
    BLACK,
    CIRCUIT,
    CLEAR,
    EMITTERS,
    GUTTER,
    ORIENTATIONS,
    VEIL,
    WIRES,
    CircuitBox,
    Layer,
    Panel,
    Point,
    Polygon,
    Track,
    orient,
    refined,
)

Holes: TypeAlias = Literal["bisect", "keyhole", "trapezoids", "layer"]
Corners: TypeAlias = Literal["apart", "joined"]

# An outline that visits a point twice is two loops: 6 and 4 vertices where all angles are right, else 3 and 3.
_FEWEST_THAT_TOUCH_RIGHT = 10
_FEWEST_THAT_TOUCH = 6


def outline(mask: Mask, dot_nm: int, origin_nm: Point = (0, 0)) -> tuple[Polygon, ...]:
    """The clear dots of a mask as polygons.

    Dots that share a side are joined; dots that only share a corner are not, so corners may kiss but no outline
    touches itself. Vertices are corners: none lies on a straight edge.

    Args:
        mask: bool [y, x], row 0 lowest, True is clear.
        origin_nm: lower left corner of dot [0, 0].

    Returns:
        Polygons in nanometres, clockwise from their lowest leftmost vertex, sorted by (y, x) of their vertices.
    """
    x0, y0 = origin_nm
    pieces = (hull_points(piece) for piece in simple_pieces(_dots(mask)))
    polygons = (tuple((x0 + x * dot_nm, y0 + y * dot_nm) for x, y in piece) for piece in pieces)
    return tuple(sorted(polygons, key=lambda polygon: [(y, x) for x, y in polygon]))


def simple_pieces(region: db.Region, *, apart: bool = True) -> Iterator[db.Polygon]:
    """Hole-free polygons that touch neither themselves nor overlap one another; their union is the region.

    Every cut is a vertical line at an integer x through a hole or a point of self-touch, so the result is exact
    wherever the edges it crosses have integer coordinates there: always for Manhattan polygons.

    Args:
        region: what to cut; overlaps are merged.
        apart: False lets an outline visit a corner twice, and only holes are cut.
    """
    for polygon in region.merged(apart, 1).each():
        cut = _cut_position(polygon, apart)
        if cut is None:
            yield polygon
            continue
        for half in _halves(polygon, cut, upright=True):
            yield from simple_pieces(half, apart=apart)


@dataclass(frozen=True, eq=False)
class Recut:
    """A region drawn in the way that was asked for.

    Attributes:
        pieces: hole-free polygons, raw; their union is the region, or the region with its holes filled.
        holes: polygons to subtract from ``pieces``; empty unless holes have a layer of their own.
        holed: polygons that had a hole.
        parted: polygons that touched themselves in a point and were parted there.
        split: polygons with more vertices than allowed, cut into several.
    """

    pieces: db.Region
    holes: db.Region
    holed: int
    parted: int
    split: int
    polygons: int
    vertices: int
    longest: int


def recut(
    region: db.Region, holes: Holes = "bisect", corners: Corners = "apart", max_vertices: int | None = None
) -> Recut:
    """Draw a region without holes, and exactly.

    All cuts are vertical or horizontal and on integers, so they are exact for Manhattan polygons and for those of 45
    degrees; for others see :func:`exact`.

    Args:
        region: in nanometres; overlaps are merged.
        holes: ``bisect`` cuts through every hole, ``keyhole`` joins it to the outline by a line of no width,
            ``trapezoids`` takes a polygon with holes apart, ``layer`` fills the holes and gives them back on their own.
        corners: ``apart`` keeps dots that only share a corner two polygons, ``joined`` makes them one outline that
            visits the corner twice.
        max_vertices: polygons with more are cut at a line through one of their own vertices.
    """
    apart = corners == "apart"
    merged = region.merged(apart, 1)
    # Or klayout merges again at every question, and by another rule for corners.
    merged.merged_semantics = False
    holed = merged.with_holes(1, None, False).count()
    filled, subtracted = _raw(), _raw()
    pen = _Pen(holes, apart, max_vertices)
    if holes == "layer" and holed:
        hulls = merged.hulls()
        for polygon in simple_pieces(hulls - merged):
            pen.draw(polygon, subtracted)
        merged = hulls.merged(apart, 1)
        merged.merged_semantics = False
    boxes, others = merged.split_rectangles()
    filled.insert(boxes)
    for polygon in others.each():
        pen.draw(polygon, filled)
    boxes_drawn = boxes.count()
    return Recut(
        filled,
        subtracted,
        holed=holed,
        parted=pen.parted,
        split=pen.split,
        polygons=pen.polygons + boxes_drawn,
        vertices=pen.vertices + 4 * boxes_drawn,
        longest=max(pen.longest, 4 if boxes_drawn else 0),
    )


def exact(region: db.Region, drawn: Recut) -> bool:
    """Whether what is drawn covers the region and nothing else."""
    covered = drawn.pieces if drawn.holes.is_empty() else drawn.pieces.merged() - drawn.holes
    return bool((covered ^ region).is_empty())


def triangles(region: db.Region) -> db.Region:
    """A region as triangles between its own vertices (constrained Delaunay), raw: exact whatever its edges' slant."""
    drawn = _raw()
    for polygon in region.merged(True, 1).each():
        drawn += polygon.delaunay()
    return drawn


def hull_points(polygon: db.Polygon) -> Polygon:
    """The outline of a polygon without holes."""
    return tuple((point.x, point.y) for point in polygon.each_point_hull())


def _dots(mask: Mask) -> db.Region:
    """One box per horizontal run of clear dots, in units of one dot."""
    padded = np.pad(mask.astype(np.int8), ((0, 0), (1, 1)))
    steps = np.diff(padded, axis=1)
    rows, starts = np.nonzero(steps == 1)
    _, stops = np.nonzero(steps == -1)
    region = db.Region()
    for y, left, right in zip(rows.tolist(), starts.tolist(), stops.tolist(), strict=True):
        region.insert(db.Box(left, y, right, y + 1))
    return region


class _Pen:
    """Draws polygons one by one under the rules of :func:`recut`, and counts what it had to cut."""

    def __init__(self, holes: Holes, apart: bool, max_vertices: int | None) -> None:
        self._holes, self._apart, self._most = holes, apart, max_vertices
        self.parted = self.split = self.polygons = self.vertices = self.longest = 0

    def draw(self, polygon: db.Polygon, onto: db.Region) -> None:
        holed = polygon.holes() > 0
        cut = None if holed else _cut_position(polygon, self._apart)
        self.parted += cut is not None
        for piece in self._closed(polygon) if holed or cut is not None else (polygon,):
            long = self._most is not None and piece.num_points() > self._most
            self.split += long
            for part in self._short(piece) if long else (piece,):
                onto.insert(part)
                count = part.num_points()
                self.polygons += 1
                self.vertices += count
                self.longest = max(self.longest, count)

    def _closed(self, polygon: db.Polygon) -> Iterator[db.Polygon]:
        if polygon.holes() and self._holes == "keyhole":
            yield polygon.resolved_holes()
        elif polygon.holes() and self._holes == "trapezoids":
            yield from db.Region(polygon).decompose_trapezoids_to_region().each()
        elif _cut_position(polygon, self._apart) is None:
            yield polygon
        else:
            yield from simple_pieces(db.Region(polygon), apart=self._apart)

    def _short(self, polygon: db.Polygon) -> Iterator[db.Polygon]:
        """The polygon as pieces with no more vertices than allowed, cut through vertices of its own."""
        if self._most is None or polygon.num_points() <= self._most:
            yield polygon
            return
        box = polygon.bbox()
        upright = box.width() >= box.height()
        cut = _middle_vertex(polygon, upright)
        if cut is None:
            upright = not upright
            cut = _middle_vertex(polygon, upright)
        if cut is None:
            yield polygon
            return
        for half in _halves(polygon, cut, upright):
            # A keyhole's two sides merge, so that its hole comes back.
            for part in half.merged(self._apart, 1).each():
                for piece in self._closed(part):
                    yield from self._short(piece)


def _middle_vertex(polygon: db.Polygon, upright: bool) -> int | None:
    """x (or y) of a vertex inside the polygon's box with about as many vertices on either side."""
    values: list[int] = sorted(point.x if upright else point.y for point in polygon.each_point_hull())
    low, high = values[0], values[-1]
    inner = [value for value in values if low < value < high]
    return inner[len(inner) // 2] if inner else None


def _halves(polygon: db.Polygon, cut: int, upright: bool) -> tuple[db.Region, db.Region]:
    """Parts of a polygon left and right of x = cut, or below and above y = cut."""
    box, whole = polygon.bbox(), db.Region(polygon)
    if upright:
        boxes = db.Box(box.left, box.bottom, cut, box.top), db.Box(cut, box.bottom, box.right, box.top)
    else:
        boxes = db.Box(box.left, box.bottom, box.right, cut), db.Box(box.left, cut, box.right, box.top)
    return whole & db.Region(boxes[0]), whole & db.Region(boxes[1])


def _raw() -> db.Region:
    """An empty region that gives back its polygons as they were put in."""
    region = db.Region()
    region.merged_semantics = False
    return region


def _cut_position(polygon: db.Polygon, apart: bool) -> int | None:
    """x of a vertical line that opens a hole or, if corners stay apart, parts a self-touch; None if none is needed."""
    if polygon.holes():
        xs: list[int] = [point.x for point in polygon.each_point_hole(0)]
        return (min(xs) + max(xs)) // 2
    count = polygon.num_points()
    if not apart or count < _FEWEST_THAT_TOUCH or (count < _FEWEST_THAT_TOUCH_RIGHT and polygon.is_rectilinear()):
        return None
    visits: Counter[Point] = Counter((point.x, point.y) for point in polygon.each_point_hull())
    return min((x for (x, _), count in visits.items() if count > 1), default=None)


class UnitKey(NamedTuple):
    """Key of a unit cell: equal for two cells that are drawn once."""

    opening: str
    mask: bytes
    dot_nm: int
    gutter_nm: int
    orientation: int
    emitters: tuple[bytes, int] | None
    tracks: tuple[Track, ...]
    circuits: tuple[CircuitBox, ...]


def unit_key(panel: Panel, cell: int) -> UnitKey:
    """The key of what a cell of a panel draws."""
    opening = panel.openings[cell // ORIENTATIONS]
    drawn = panel.emitters
    emitters = None if drawn is None else (drawn.labels.tobytes(), drawn.cell_nm)
    mask, orientation = opening.mask.tobytes(), cell % ORIENTATIONS
    return UnitKey(
        opening.name, mask, panel.dot_nm, panel.gutter_nm, orientation, emitters, panel.tracks, panel.circuits
    )


def unit_name(panel: Panel, cell: int) -> tuple[str, str]:
    """Stem and suffix of a unit's name: the opening's, and ``_D<dot>_G<gutter>_R<orientation>``."""
    opening = panel.openings[cell // ORIENTATIONS]
    return opening.name, f"_D{panel.dot_nm}_G{panel.gutter_nm}_R{cell % ORIENTATIONS}"


def unit_shapes(panel: Panel, cell: int) -> Mapping[Layer, tuple[Polygon, ...]]:
    """Simple, hole-free outlines by layer; the cell's lower left corner, gutter included, is the origin.

    Emitters and circuits turn with their opening, and so do the tracks that say so. The gutter and the black matrix
    (what neither passes light nor emits) are drawn where emitters or wires are; a panel of openings alone has only
    these.
    """
    return _shapes(unit_key(panel, cell)._replace(opening=""))


@lru_cache(maxsize=128)
def _shapes(unit: UnitKey) -> Mapping[Layer, tuple[Polygon, ...]]:
    """Shapes that a unit draws; files, checks and pictures ask for few others. 128 x 128 random dots take 2 MB."""
    orientation, half, dot = unit.orientation, unit.gutter_nm // 2, unit.dot_nm
    clear = orient(_square(unit.mask, np.bool_), orientation)
    pitch = len(clear) * dot + unit.gutter_nm
    shapes = {CLEAR: outline(clear, dot, (half, half))}
    if unit.emitters is None and not unit.tracks and not unit.circuits:
        return MappingProxyType(shapes)
    shapes[CIRCUIT] = tuple(_oriented(box.polygon, pitch, orientation) for box in unit.circuits)
    for track in unit.tracks:
        # A quarter turn lays a wire along the other axis, and so on the other metal: no pixel needs a via to the next.
        upper = (track.axis == "y") != (track.turns and orientation % 2 == 1)
        layer = VEIL if track.transmission else WIRES[upper]
        shapes[layer] = (*shapes.get(layer, ()), *oriented_track(track, pitch, orientation))
    dark, side = ~clear, dot
    if unit.emitters is not None:
        given, side = unit.emitters
        labels = orient(_square(given, np.int8), orientation)
        for colour, layer in enumerate(EMITTERS, 1):
            shapes[layer] = outline(labels == colour, side, (half, half))
        dark = refined(dark, dot // side) & (labels == 0)
    shapes[BLACK] = outline(dark, side, (half, half))
    if half:
        # The gutter's share of a cell as four bars that do not overlap.
        inner = pitch - half
        bars = [(0, 0, pitch, half), (0, inner, pitch, pitch), (0, half, half, inner), (inner, half, pitch, inner)]
        shapes[GUTTER] = tuple(((x0, y0), (x1, y0), (x1, y1), (x0, y1)) for x0, y0, x1, y1 in bars)
    return MappingProxyType({layer: polygons for layer, polygons in shapes.items() if polygons})


def _square(content: bytes, kind: type[np.generic]) -> NDArray[Any]:
    flat = np.frombuffer(content, dtype=kind)
    return flat.reshape(math.isqrt(flat.size), -1)


def oriented_track(track: Track, pitch_nm: int, orientation: int) -> tuple[Polygon, ...]:
    """A track's outlines in a cell of that orientation, as :func:`maskfab.base.model.orient` turns its opening."""
    if not track.turns:
        return track.polygons
    return tuple(_oriented(polygon, pitch_nm, orientation) for polygon in track.polygons)


def _oriented(polygon: Polygon, pitch_nm: int, orientation: int) -> Polygon:
    return tuple(_turned(point, pitch_nm, orientation) for point in polygon)


def _turned(point: Point, pitch_nm: int, orientation: int) -> Point:
    x, y = point
    if orientation >= 4:
        x = pitch_nm - x
    for _ in range(orientation % 4):
        x, y = pitch_nm - y, x
    return x, y


# All vertices of the font are whole steps, and all its edges run along an axis or at 45 degrees: a letter is 28 steps
# high and 20 wide, its strokes are 4 wide, and their middles run between the points of a lattice, 4 steps apart. Gaps
# are as wide, but for corners of 45 degrees, which end 2 wide.
_STEPS_PER_HEIGHT = 28
_ADVANCE = 24
_WIDTH = 20
_PITCH = 4

# Strokes of a letter, each from lattice point to lattice point: its column from the left, 0 to 4, then its row from
# the base line, 0 to 6. A single point is a dot.
_STROKES: dict[str, str] = json.loads(Path(__file__).with_name("strokes.json").read_text(encoding="utf-8"))


def text_polygons(
    text: str, height_nm: int, anchor_nm: Point, align: Literal["left", "centre"] = "left"
) -> tuple[Polygon, ...]:
    """One line of text; letters stand on the anchor's y and start at, or are centred on, its x.

    Args:
        text: characters from ``!`` to ``~`` and spaces; the font draws small letters as capitals.
        height_nm: height of a letter, at least 28 nm; it is rounded to a multiple of 28 nm, so that all 45-degree
            strokes keep to the database grid.
        align: ``left`` or ``centre``: of the letters' cells, whatever a letter leaves blank in its own.

    Returns:
        Simple, hole-free polygons in nanometres.

    Raises:
        JobError: MF110 if the font lacks a character.
    """
    lacking = sorted({c for c in text if not (c == " " or " " < c <= "~")})
    if lacking:
        what = f"the plate's font has no {', '.join(map(repr, lacking))} for the text {text!r}"
        raise JobError("MF110", what, cure="Use ASCII letters, digits and punctuation")
    step_nm = _step_nm(height_nm)
    x0 = anchor_nm[0] - (text_width_nm(text, height_nm) // 2 if align == "centre" else 0)
    return tuple(
        tuple((x0 + (place * _ADVANCE + x) * step_nm, anchor_nm[1] + y * step_nm) for x, y in piece)
        for place, letter in enumerate(text.upper())
        if letter != " "
        for piece in _letter(letter)
    )


def text_width_nm(text: str, height_nm: int) -> int:
    """Width of the letters' cells, 20 steps each and 4 apart, without spaces at the end."""
    count = len(text.rstrip(" "))
    return max(0, count * _ADVANCE - (_ADVANCE - _WIDTH)) * _step_nm(height_nm)


def fitted_text(text: str, height_nm: int, anchor_nm: Point, room_nm: int) -> tuple[Polygon, ...]:
    """Centred text as :func:`text_polygons` draws it, made smaller if it would be wider than its room."""
    width = text_width_nm(text, height_nm)
    if width > room_nm:
        return text_polygons(text, height_nm * room_nm // width, anchor_nm, align="centre")
    return text_polygons(text, height_nm, anchor_nm, align="centre")


def _step_nm(height_nm: int) -> int:
    return max(1, round(height_nm / _STEPS_PER_HEIGHT))


@lru_cache(128)
def _letter(letter: str) -> tuple[Polygon, ...]:
    """A capital, digit or sign in steps of the font, from its lower left corner.

    Joined on a grid of half steps, since edges inside a stroke meet there; no vertex of the outline lies between.
    """
    links: defaultdict[Point, set[Point]] = defaultdict(set)
    for stroke in _STROKES[letter].split():
        points = [(int(point[0]), int(point[1])) for point in stroke.split("-")]
        links[points[0]] |= set()
        for start, end in pairwise(points):
            _link(links, start, end)
    region = db.Region()
    for point, others in links.items():
        region.insert(_pen(point, others))
        for other in others:
            region.insert(_stroke(point, other))
            for strip in _webs(point, other, links.keys()):
                region.insert(strip)
    joined = region.merged().transformed(db.ICplxTrans(0.5))
    return tuple(tuple((point.x, point.y) for point in piece.each_point_hull()) for piece in simple_pieces(joined))


def _link(links: defaultdict[Point, set[Point]], start: Point, end: Point) -> None:
    """Links from lattice point to lattice point all along a stroke."""
    length = max(abs(end[0] - start[0]), abs(end[1] - start[1]))
    step = (end[0] - start[0]) // length, (end[1] - start[1]) // length
    way = [(start[0] + step[0] * done, start[1] + step[1] * done) for done in range(length + 1)]
    for here, there in pairwise(way):
        links[here].add(there)
        links[there].add(here)


def _pen(point: Point, others: set[Point]) -> db.SimplePolygon:
    """A square, an octagon where a slanting stroke meets another, or nothing where a slanting stroke ends."""
    x, y = _middle(point)
    half, corner = _PITCH // 2, _PITCH // 4
    slanting = any(other[0] != point[0] and other[1] != point[1] for other in others)
    if not slanting:
        corner = half
    elif len(others) == 1:
        half = corner = 0
    ring = [(half, -corner), (half, corner), (corner, half), (-corner, half)]
    ring += [(-u, -v) for u, v in ring]
    return db.SimplePolygon([2 * db.Point(x + u, y + v) for u, v in ring])


def _stroke(start: Point, end: Point) -> db.SimplePolygon:
    """A stroke between neighbours of the lattice: 4 steps wide along an axis, and from middle to middle; at 45 degrees
    3 sqrt(2) wide, which keeps to the steps, and half a sqrt(2) longer at either end."""
    (x0, y0), (x1, y1) = _middle(start), _middle(end)
    u, v = (x1 - x0) // _PITCH, (y1 - y0) // _PITCH
    wide, beyond = (3, 1) if u and v else (4, 0)
    right = (v * wide - u * beyond) // 2, (-u * wide - v * beyond) // 2
    left = (-v * wide - u * beyond) // 2, (u * wide - v * beyond) // 2
    ring = [(x0 + left[0], y0 + left[1]), (x0 + right[0], y0 + right[1])]
    ring += [(x1 - left[0], y1 - left[1]), (x1 - right[0], y1 - right[1])]
    return db.SimplePolygon([2 * db.Point(*point) for point in ring])


def _webs(start: Point, end: Point, inked: Set[Point]) -> Iterator[db.Box]:
    """Strips of one step that keep a gap 2 wide where a slanting stroke comes from a bar that it meets at its end."""
    for corner in ((start[0], end[1]), (end[0], start[1])):
        u, v = corner[0] - end[0], corner[1] - end[1]
        beyond = 2 * corner[0] - start[0], 2 * corner[1] - start[1]
        if corner not in (start, end) and {beyond, (beyond[0] - u, beyond[1] - v)} <= inked:
            x, y = _middle(corner)
            across, up = 2 * abs(v), 2 * abs(u)
            yield 2 * db.Box(x - 2 * u - across, y - 2 * v - up, x - u + across, y - v + up)


def _middle(point: Point) -> Point:
    return point[0] * _PITCH + _PITCH // 2, point[1] * _PITCH + _PITCH // 2
