"""Design rules on flat geometry: the limits, KLayout's checks that those on distances are made of, and their results.

Many small drawings are laid side by side on one sheet, so that one run of KLayout checks them all."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from klayout import db

from maskfab.base.arrays import Floats, Ints, Mask
from maskfab.base.errors import JobError
from maskfab.base.model import Box, Polygon


@dataclass(frozen=True)
class RuleResult:
    """One rule on one owner.

    Attributes:
        rule: width, space, notch, area, chrome_area, grid, manhattan, acute_angle, corner_touch, overlap, vertices,
            references, name_pattern, forbidden_name, name_length or extent.
        unit: of limit and value; empty for names.
        value: the worst that breaks the rule; None where nothing does.
        count: how many places break it.
        places: the first of them, by y and then x of the lower left corner: x0, y0, x1, y1 in plate nanometres.
        die: the die that owns them; None for marks and for the plate as a whole.
        names: the names that break a rule about names.
    """

    rule: str
    limit: int | str
    unit: str
    value: float | int | str | None
    count: int
    places: tuple[Box, ...] = ()
    die: str | None = None
    names: tuple[str, ...] = ()

    @property
    def passed(self) -> bool:
        return self.count == 0


@dataclass(frozen=True, eq=False)
class Found:
    """Violations of a rule: the worst (None if none), and int64 [n, 4] boxes of the first, by lower left corner."""

    count: int
    value: float | None
    boxes_nm: Ints

    def result(self, rule: str, limit: int, unit: str, die: str | None, origin_nm: tuple[int, int]) -> RuleResult:
        """The violations under a rule's name, moved to where the owner lies on the plate."""
        moved = self.boxes_nm + np.tile(np.asarray(origin_nm, dtype=np.int64), 2)
        places = tuple((x0, y0, x1, y1) for x0, y0, x1, y1 in moved.tolist())
        value = int(self.value) if self.value is not None and self.value == int(self.value) else self.value
        return RuleResult(rule, limit, unit, value, self.count, places, die)


def counted_references(references: int, limit: int) -> RuleResult:
    """The rule on references; the count is 1 if there are too many, and the value how many there are."""
    return RuleResult("references", limit, "references", references, int(references > limit))


def first(boxes: Ints, most: int) -> Ints:
    """The first boxes by y and then x of the lower left corner."""
    return boxes[np.lexsort(boxes.T[[3, 2, 0, 1]])[:most]]


def listed(boxes: Ints, values: Floats, most: int, *, largest: bool = False) -> Found:
    """Violations that were all found at their own place; the worst value is the smallest unless said otherwise."""
    if not len(boxes):
        return Found(0, None, np.zeros((0, 4), dtype=np.int64))
    return Found(len(boxes), float(values.max() if largest else values.min()), first(boxes, most))


def joined(parts: list[Found], most: int, *, largest: bool = False) -> Found:
    """Violations of one rule, found in several ways."""
    boxes = np.concatenate([part.boxes_nm for part in parts]) if parts else np.zeros((0, 4), dtype=np.int64)
    values = [part.value for part in parts if part.value is not None]
    worst = (max(values) if largest else min(values)) if values else None
    return Found(sum(part.count for part in parts), worst, first(boxes, most))


@dataclass(frozen=True, eq=False)
class Repeated:
    """Violations found once in each distinct item, and where the items lie.

    Attributes:
        items: int64 [m], the item that each occurrence is.
        origins_nm: int64 [m, 2], where the occurrence lies.
        owners: int64 [n], the item that each violation was found in.
        boxes_nm: int64 [n, 4], from its item's origin.
        values: float64 [n].
    """

    items: Ints
    origins_nm: Ints
    owners: Ints
    boxes_nm: Ints
    values: Floats

    def found(self, most: int, *, largest: bool = False) -> Found:
        """Violations counted, the first of them placed; only the lowest occurrences are ever written out."""
        empty = Found(0, None, np.zeros((0, 4), dtype=np.int64))
        if not len(self.owners) or not len(self.items):
            return empty
        kinds = int(max(self.items.max(), self.owners.max())) + 1
        owners, times = np.bincount(self.owners, minlength=kinds), np.bincount(self.items, minlength=kinds)
        count = int(owners @ times)
        if count == 0:
            return empty
        values = self.values[times[self.owners] > 0]
        worst = float(values.max() if largest else values.min())
        order = np.flatnonzero(owners[self.items] > 0)
        heights = self.origins_nm[order, 1]
        if (heights[1:] < heights[:-1]).any():
            upwards = np.argsort(heights, kind="stable")
            order, heights = order[upwards], heights[upwards]
        enough = min(int(np.searchsorted(np.cumsum(owners[self.items[order]]), most)), len(order) - 1)
        highest = heights[enough] + self.boxes_nm[:, 1].max() - self.boxes_nm[:, 1].min()
        chosen = order[heights <= highest]
        by_item = np.argsort(self.owners, kind="stable")
        starts = np.cumsum(owners) - owners
        which = expanded(starts[self.items[chosen]], owners[self.items[chosen]])
        origins = np.repeat(self.origins_nm[chosen], owners[self.items[chosen]], axis=0)
        return Found(count, worst, first(self.boxes_nm[by_item][which] + np.tile(origins, 2), most))


def expanded(starts: Ints, lengths: Ints) -> Ints:
    """The runs ``start, start + 1, ...`` of the given lengths, one after the other."""
    before = np.cumsum(lengths) - lengths
    runs: Ints = np.arange(int(lengths.sum())) + np.repeat(starts - before, lengths)
    return runs


Check = Callable[[db.Region], db.EdgePairs]
"""Pairs of edges that face each other too closely, of a region merged with kissing corners apart."""


@dataclass(frozen=True)
class DesignRules:
    """Limits on what is clear, on how it is drawn, and on names; a rule that is None or False is not checked.

    Distances are Euclidian, as KLayout measures them: between the facing parts of two edges, corner to corner included;
    of two edges askew only where one lies square before the other, between corners that point at each other, or at a
    blunt end that both part from, for KLayout takes for the width of a disc the chord between any two edges that face
    each other, down to its diameter over the root of two. So a point in which clear corners kiss counts as two spaces
    of zero, and if both corners are of one polygon, as two notches and two widths of zero as well, unless ``kissing``
    is False.

    Attributes:
        min_width_nm: least width of a clear polygon.
        min_space_nm: least chrome between clear edges, of one polygon or of two.
        min_notch_nm: least chrome between two edges of one clear polygon.
        min_area_nm2: least area of a clear polygon, and of an island of chrome inside one. Shapes that only kiss in
            a corner are two.
        grid_nm: every vertex, as drawn, is a multiple of it in plate coordinates.
        manhattan: edges, as drawn, run along x or y only.
        no_acute_angles: no corner, as drawn, is sharper than 90 degrees.
        no_corner_touch: no two clear shapes, and no two corners of one, meet in a point.
        kissing: whether distances of zero, where corners kiss, break the rules on width, space and notch, too.
        no_overlap: nothing is drawn twice.
        max_vertices: most vertices of a polygon as drawn.
        max_references: most references in the file, an array counting once.
        name_pattern: regular expression that every cell name matches as a whole.
        forbidden_names: texts that no cell name contains, in whatever case.
        max_name_length: most characters of a cell name.
        extent_nm: sides of the box, centred on the origin, that holds everything.

    Raises:
        JobError: MF417 if a limit is not positive or the pattern is no regular expression.
    """

    min_width_nm: int | None = None
    min_space_nm: int | None = None
    min_notch_nm: int | None = None
    min_area_nm2: int | None = None
    grid_nm: int | None = None
    manhattan: bool = False
    no_acute_angles: bool = False
    no_corner_touch: bool = False
    kissing: bool = True
    no_overlap: bool = False
    max_vertices: int | None = None
    max_references: int | None = None
    name_pattern: str | None = None
    forbidden_names: tuple[str, ...] = ()
    max_name_length: int | None = None
    extent_nm: tuple[int, int] | None = None

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            numbers = value if field.name == "extent_nm" and value is not None else (value,)
            for number in numbers:
                if isinstance(number, int) and not isinstance(number, bool) and number <= 0:
                    what = f"the design rule {field.name} is {number}; it must be positive"
                    raise JobError("MF417", what, cure="Give a positive number, or leave the rule out")
        if self.name_pattern is not None:
            try:
                re.compile(self.name_pattern)
            except re.error as error:
                what = f"the design rule name_pattern is {self.name_pattern!r}, no regular expression: {error}"
                raise JobError("MF417", what, cure='Correct the expression, for example "[A-Z][A-Z0-9_]*"') from error

    @property
    def reach_nm(self) -> int:
        """Largest distance in nanometres at which two shapes can interact in a rule."""
        return max(1, self.min_width_nm or 0, self.min_space_nm or 0, self.min_notch_nm or 0)


def distance_checks(rules: DesignRules) -> dict[str, tuple[int, Check]]:
    """Limit and check of the rules on width, space and notch that are set, by their names."""
    # Corners that kiss are edges that touch at a distance of nothing.
    options: dict[str, Any] = {} if rules.kissing else {"zero_distance_mode": db.Region.NeverIncludeZeroDistance}
    checks: dict[str, tuple[int, Check]] = {}
    if (width := rules.min_width_nm) is not None:
        checks["width"] = width, lambda region: _across(region, "width_check", width, options)
    if (space := rules.min_space_nm) is not None:
        checks["space"] = space, lambda region: _across(region, "space_check", space, options)
    if (notch := rules.min_notch_nm) is not None:
        checks["notch"] = notch, lambda region: _across(region, "notch_check", notch, options)
    return checks


_ASKEW_DEG = 1e-3
"""Between edges that are no longer antiparallel; KLayout looks at angles below a limit that is not 0."""


def _across(region: db.Region, check: str, limit_nm: int, options: Mapping[str, Any]) -> db.EdgePairs:
    """Pairs of facing edges closer than the limit, without chords that begin or end beside what they should cross."""
    run: Callable[..., db.EdgePairs] = getattr(region, check)
    if region.edges().with_angle(db.Edges.OrthoEdges, True).is_empty():
        return run(limit_nm, **options)
    found = run(limit_nm, ignore_angle=_ASKEW_DEG, **options)
    askew = run(limit_nm, **options).with_internal_angle(0, True)
    if askew.is_empty():
        return found
    # Corners that point into what is measured: a left turn of clear, which lies to the right of its edges.
    angles = (0.001, 180.0) if check == "width_check" else (-180.0, -0.001)
    corners = {(dot.p1.x, dot.p1.y) for dot in region.corners_dots(*angles).each()}
    # Of two edges that part from a third between them the blunt end is that third one.
    blunt = {(side.x1, side.y1, side.x2, side.y2) for side in region.edges().with_length(1, limit_nm, False).each()}
    ends = _ends(askew)
    between = ends[:, :2, None] - ends[:, None, 2:]
    gaps = (between**2).sum(axis=-1).reshape(-1, 4)
    nearest = np.argmin(gaps, axis=1)
    kept = _foot(ends, gaps.min(axis=1))
    for k in np.flatnonzero(~kept).tolist():
        one, two = (tuple(ends[k, place].tolist()) for place in (nearest[k] // 2, 2 + nearest[k] % 2))
        pointed = one == two or (one in corners and two in corners)
        kept[k] = pointed or not blunt.isdisjoint([(*one, *two), (*two, *one)])
    for first, last, start, stop in ends[kept].tolist():
        found.insert(db.EdgePair(db.Edge(*first, *last), db.Edge(*start, *stop)))
    return found


def _foot(ends: Ints, gaps: Floats) -> Mask:
    """Whether some end of one edge of a pair lies square before the other, nearer than any two ends."""
    found = np.zeros(len(ends), dtype=bool)
    for end, start, stop in ((0, 2, 3), (1, 2, 3), (2, 0, 1), (3, 0, 1)):
        along = (ends[:, stop] - ends[:, start]).astype(np.float64)
        from_start = (ends[:, end] - ends[:, start]).astype(np.float64)
        squared = np.maximum((along**2).sum(axis=1), 1.0)
        share = (from_start * along).sum(axis=1) / squared
        across = from_start[:, 0] * along[:, 1] - from_start[:, 1] * along[:, 0]
        found |= (share > 0) & (share < 1) & (across**2 / squared < gaps)
    return found


_LARGEST_SHEET_NM = 1_000_000_000
_DIGITS = str.maketrans(dict.fromkeys("(),;/|", " "))


@dataclass(frozen=True, eq=False)
class Facing:
    """Pairs of edges that face each other too closely.

    Attributes:
        items: int64 [n], the drawing that each was found in.
        points: int64 [n, 2], lowest endpoint of the pair, leftmost among these, from the drawing's origin.
        boxes_nm: int64 [n, 4], hull of the pair, from the drawing's origin.
        values: float64 [n], distance of the two edges.
    """

    items: Ints
    points: Ints
    boxes_nm: Ints
    values: Floats

    def chosen(self, keep: Mask) -> Facing:
        """Those for which ``keep`` holds."""
        return Facing(self.items[keep], self.points[keep], self.boxes_nm[keep], self.values[keep])


class Canvas:
    """Drawings composed of pieces, each drawn once however many drawings use it.

    Args:
        size_nm: side of the square, from -size to size about a drawing's origin, that holds every drawing.
        reach_nm: drawings stay further apart than this.
    """

    def __init__(self, size_nm: int, reach_nm: int) -> None:
        self._step = 2 * size_nm + 2 * reach_nm + 2
        self._layout = db.Layout()
        self._layer = self._layout.layer(1, 0)
        self._pieces: list[int] = []

    def piece(self, region: db.Region) -> int:
        """A shape that drawings can use, by its number."""
        cell = self._layout.create_cell(f"P{len(self._pieces)}")
        cell.shapes(self._layer).insert(region)
        self._pieces.append(cell.cell_index())
        return len(self._pieces) - 1

    def check(self, drawings: Sequence[Sequence[tuple[int, int, int]]], checks: Sequence[Check]) -> tuple[Facing, ...]:
        """Run checks over drawings, each a sequence of (piece, x, y); polygons that kiss stay apart."""
        most = max(1, _LARGEST_SHEET_NM // self._step) ** 2
        parts = [self._sheet(drawings[k : k + most], checks, k) for k in range(0, max(1, len(drawings)), most)]
        return tuple(together([part[n] for part in parts]) for n in range(len(checks)))

    def _sheet(
        self, drawings: Sequence[Sequence[tuple[int, int, int]]], checks: Sequence[Check], before: int
    ) -> list[Facing]:
        across, step = max(1, math.isqrt(max(0, len(drawings) - 1)) + 1), self._step
        sheet, pieces = self._layout.create_cell(f"SHEET{before}"), self._pieces
        for n, drawing in enumerate(drawings):
            x0, y0 = (n % across) * step, (n // across) * step
            for piece, x, y in drawing:
                sheet.insert(db.CellInstArray(pieces[piece], db.Trans(x0 + x, y0 + y)))
        region = db.Region(sheet.begin_shapes_rec(self._layer)).merged(True, 1)
        region.merged_semantics = False
        sheets = []
        for check in checks:
            facing = facing_edges(check(region))
            column, row = np.rint(facing.points / step).astype(np.int64).T
            origins = np.stack([column, row], axis=1) * step
            sheets.append(
                Facing(
                    before + row * across + column,
                    facing.points - origins,
                    facing.boxes_nm - np.tile(origins, 2),
                    facing.values,
                )
            )
        return sheets


def _ends(pairs: db.EdgePairs) -> Ints:
    """Ends of both edges of every pair, int64 [n, 4, 2]."""
    count = pairs.count()
    # One text is read a hundred times faster than attributes of so many objects.
    numbers = np.array(pairs.to_s(count).translate(_DIGITS).split(), dtype=np.int64)
    return np.asarray(numbers.reshape(count, 4, 2))


def facing_edges(pairs: db.EdgePairs) -> Facing:
    """Edge pairs as arrays, all of item 0."""
    count, ends = pairs.count(), _ends(pairs)
    boxes = np.concatenate([ends.min(axis=1), ends.max(axis=1)], axis=1)
    lowest = np.where(ends[..., 1] == boxes[:, 1, None], ends[..., 0], np.iinfo(np.int64).max).min(axis=1)
    points = np.stack([lowest, boxes[:, 1]], axis=1)
    straight = ((ends[:, 0] == ends[:, 1]) | (ends[:, 2] == ends[:, 3])).any(axis=1)
    straight &= (ends[:, 0] == ends[:, 1]).any(axis=1) & (ends[:, 2] == ends[:, 3]).any(axis=1)
    one, two = ends[:, :2], ends[:, 2:]
    gaps = np.maximum(0, np.maximum(one.min(axis=1) - two.max(axis=1), two.min(axis=1) - one.max(axis=1)))
    values = np.hypot(gaps[:, 0], gaps[:, 1])
    if not straight.all():
        values[~straight] = _distances(ends[~straight].astype(np.float64))
    return Facing(np.zeros(count, dtype=np.int64), points, boxes, values)


def _distances(ends: Floats) -> Floats:
    """Distances of the two edges of pairs [n, 4, 2] that do not cross: from an end of one to the other."""
    distances = []
    for point, start, stop in ((0, 2, 3), (1, 2, 3), (2, 0, 1), (3, 0, 1)):
        along, away = ends[:, stop] - ends[:, start], ends[:, point] - ends[:, start]
        length = (along**2).sum(axis=1)
        part = np.clip((away * along).sum(axis=1) / np.where(length > 0, length, 1), 0, 1)
        distances.append(np.hypot(*(away - part[:, None] * along).T))
    least: Floats = np.min(distances, axis=0)
    return least


def together(parts: Sequence[Facing]) -> Facing:
    """Several findings as one."""
    nothing = np.zeros((0, 2), dtype=np.int64)
    return Facing(
        np.concatenate([nothing[:, 0], *(part.items for part in parts)]),
        np.concatenate([nothing, *(part.points for part in parts)]),
        np.concatenate([np.zeros((0, 4), dtype=np.int64), *(part.boxes_nm for part in parts)]),
        np.concatenate([np.zeros(0), *(part.values for part in parts)]),
    )


Violations = tuple[Ints, Floats]
"""Boxes int64 [n, 4] and values float64 [n]."""
DrawnRule = Callable[[Sequence[Polygon]], Violations]
LARGEST = frozenset({"grid", "manhattan", "overlap", "vertices"})
"""Rules whose worst value is the largest."""


def off_grid(polygons: Sequence[Polygon], grid_nm: int, origin_nm: tuple[int, int] = (0, 0)) -> Violations:
    """Vertices that are no multiple of the grid once the origin is added; the value is how far off the worse axis."""
    points = _points(polygons)
    rest = (points + np.asarray(origin_nm)) % grid_nm
    off = np.minimum(rest, grid_nm - rest).max(axis=1)
    return np.tile(points[off > 0], 2), off[off > 0].astype(np.float64)


def slanted_edges(polygons: Sequence[Polygon]) -> Violations:
    """Edges that run along neither axis; the value is their angle to the nearer one, in degrees."""
    points = _points(polygons)
    after = points[_neighbours(polygons, 1)]
    step = np.abs(after - points)
    slanted = step.min(axis=1) > 0
    angle = np.degrees(np.arctan2(step.min(axis=1), step.max(axis=1)))
    boxes = np.concatenate([np.minimum(points, after), np.maximum(points, after)], axis=1)
    return boxes[slanted], angle[slanted]


def acute_corners(polygons: Sequence[Polygon]) -> Violations:
    """Corners whose sides make less than 90 degrees, inside or outside; the value is that angle."""
    points = _points(polygons)
    back, on = points[_neighbours(polygons, -1)] - points, points[_neighbours(polygons, 1)] - points
    along, turned = (back * on).sum(axis=1), np.abs(back[:, 0] * on[:, 1] - back[:, 1] * on[:, 0])
    acute = along > 0
    return np.tile(points[acute], 2), np.degrees(np.arctan2(turned, along))[acute]


def long_outlines(polygons: Sequence[Polygon], most_vertices: int) -> Violations:
    """Polygons of more vertices than allowed; the value is how many they have."""
    long = [polygon for polygon in polygons if len(polygon) > most_vertices]
    boxes = [[*np.min(polygon, axis=0).tolist(), *np.max(polygon, axis=0).tolist()] for polygon in long]
    return np.array(boxes, dtype=np.int64).reshape(-1, 4), np.array([len(polygon) for polygon in long], np.float64)


def overlaps(polygons: Sequence[Polygon]) -> Violations:
    """Areas that are drawn more than once; the value is the area in nm²."""
    region = db.Region([db.SimplePolygon([db.Point(x, y) for x, y in polygon], True) for polygon in polygons])
    twice = region.merged(True, 2)
    boxes = [box.bbox() for box in twice.each()]
    areas = [float(polygon.area()) for polygon in twice.each()]
    return np.array([[b.left, b.bottom, b.right, b.top] for b in boxes], np.int64).reshape(-1, 4), np.array(areas)


def _points(polygons: Sequence[Polygon]) -> Ints:
    return np.array([point for polygon in polygons for point in polygon], dtype=np.int64).reshape(-1, 2)


def _neighbours(polygons: Sequence[Polygon], step: int) -> Ints:
    """Index of the vertex so many steps on along its own polygon."""
    runs, before = [np.zeros(0, dtype=np.int64)], 0
    for polygon in polygons:
        runs.append(before + (np.arange(len(polygon)) + step) % len(polygon))
        before += len(polygon)
    return np.concatenate(runs)


def flat_results(
    region: db.Region, polygons: Sequence[Polygon], rules: DesignRules, most: int, die: str | None = None
) -> tuple[RuleResult, ...]:
    """Every rule on geometry in plate coordinates, of what is clear, kissing corners apart (:func:`merged`)."""
    results: list[tuple[str, int, str, Found]] = []
    for name, (limit, check) in distance_checks(rules).items():
        facing = facing_edges(check(region))
        results.append((name, limit, "nm", listed(facing.boxes_nm, facing.values, most)))
    if rules.min_area_nm2 is not None:
        results.append(("area", rules.min_area_nm2, "nm2", _small(region, rules.min_area_nm2, most)))
        around = region.bbox().enlarged(1, 1)
        chrome = (db.Region(around) - region).merged(True, 1).each()
        islands = merged(db.Region([polygon for polygon in chrome if polygon.bbox() != around]))
        results.append(("chrome_area", rules.min_area_nm2, "nm2", _small(islands, rules.min_area_nm2, most)))
    if rules.no_corner_touch:
        results.append(("corner_touch", 0, "nm", _kissing(region, most)))
    for name, limit, unit, rule in drawn_rules(rules):
        boxes, values = rule(polygons)
        results.append((name, limit, unit, listed(boxes, values, most, largest=name in LARGEST)))
    return tuple(violations.result(name, limit, unit, die, (0, 0)) for name, limit, unit, violations in results)


def drawn_rules(rules: DesignRules, origin_nm: tuple[int, int] = (0, 0)) -> list[tuple[str, int, str, DrawnRule]]:
    """Name, limit, unit and check of the rules on polygons as drawn; the grid counts from the origin given."""
    chosen: list[tuple[str, int, str, DrawnRule]] = []
    if rules.grid_nm is not None:
        grid_nm = rules.grid_nm
        chosen.append(("grid", grid_nm, "nm", lambda polygons: off_grid(polygons, grid_nm, origin_nm)))
    if rules.manhattan:
        chosen.append(("manhattan", 0, "deg", slanted_edges))
    if rules.no_acute_angles:
        chosen.append(("acute_angle", 90, "deg", acute_corners))
    if rules.no_overlap:
        chosen.append(("overlap", 0, "nm2", overlaps))
    if rules.max_vertices is not None:
        most_vertices = rules.max_vertices
        chosen.append(("vertices", most_vertices, "vertices", lambda polygons: long_outlines(polygons, most_vertices)))
    return chosen


def merged(region: db.Region) -> db.Region:
    """A region whose polygons are joined along sides, and stay apart where they kiss."""
    whole = region.merged(True, 1)
    whole.merged_semantics = False
    return whole


def _small(region: db.Region, limit_nm2: int, most: int) -> Found:
    small = list(region.with_area(0, limit_nm2, False).each())
    boxes = [polygon.bbox() for polygon in small]
    corners = np.array([[b.left, b.bottom, b.right, b.top] for b in boxes], dtype=np.int64).reshape(-1, 4)
    return listed(corners, np.array([float(polygon.area()) for polygon in small]), most)


def _kissing(region: db.Region, most: int) -> Found:
    """Points that are a corner more than once."""
    edges = region.edges()
    numbers = edges.to_s(edges.count()).translate(str.maketrans("(),;", "    ")).split()
    corners, times = np.unique(np.array(numbers, dtype=np.int64).reshape(-1, 4)[:, :2], axis=0, return_counts=True)
    kisses = np.tile(corners[times > 1], 2)
    return listed(kisses, np.zeros(len(kisses)), most)
