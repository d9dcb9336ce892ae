"""Faults of a foreign file's drawing, and the design rules on what it makes clear, by the job's limits.

Faults are duplicates, long outlines, odd angles, odd names and figures beyond the blank. Of rules, where the file is
the design, the design is judged in its place, cell by cell; where it differs, both are looked at, and the count of the
file is that of the design, less what the design breaks there, and more what the file does.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np
from klayout import db
from numpy.typing import NDArray

from maskfab.base.arrays import Ints
from maskfab.base.files import suffix_of
from maskfab.base.model import CLEAR, Plate, Quantity
from maskfab.base.units import NM_PER_MM, NM_PER_UM
from maskfab.job.sections import LimitsSection
from maskfab.mask.comparison.roundtrip import sift
from maskfab.mask.design_rules import DesignRules, distance_checks, facing_edges, flat_results, merged
from maskfab.mask.formats.table import FORMATS
from maskfab.mask.layout import (
    NAME_LENGTH,
    clear_box,
    count_shapes,
    drawn_areas,
    layer_info,
    most_covered,
    own_polygons,
    weight,
)
from maskfab.mask.plate_rules import check_plate, checked_extent, checked_names, smallest_features

GDSII_VERTICES = 8190
"""Most vertices of a GDSII polygon that every reader takes: a record has room for 8191, the first said twice."""

_NAMES = DesignRules(name_pattern="[A-Za-z0-9_?$]+", max_name_length=NAME_LENGTH)
_NM2_PER_UM2 = NM_PER_UM**2
_TOLD = 4

MOST_FLAT = 2_000_000
"""Shapes that are flattened to find where they overlap."""

MOST_FLAT_ALONE = 20_000
"""Of a file that is not the design: it fails, whatever its faults."""


def named_cells(read: db.Layout) -> Iterator[Quantity]:
    """The names of the file's cells: as the GDSII manual allows them, whatever the format."""
    pattern, length = checked_names([cell.name for cell in read.each_cell()], _NAMES)
    for result, what in (
        (pattern, "cells with names of other characters than A-Z a-z 0-9 _ ? $, which some software refuses"),
        (length, f"cells with names of more than {NAME_LENGTH} characters, which some software cuts short"),
    ):
        listed = ", ".join(map(repr, result.names[:_TOLD])) + (" and more" if result.count > _TOLD else "")
        yield Quantity(
            f"rule_{result.rule}", result.count, what + (f": {listed}" if listed else ""), limit=0, passed=result.passed
        )


@dataclass(frozen=True, eq=False)
class Known:
    """Facts known of a file that is aligned with a design.

    Attributes:
        tolerance_nm: what overlaps by no more than this is no fault.
    """

    design: db.Layout
    differing: db.Region
    tolerance_nm: float = 0.0

    @property
    def clear_nm2(self) -> int | None:
        """Area of all that the file makes clear; None where references of the design are scaled."""
        index = self.design.find_layer(layer_info(CLEAR))
        area = _drawn_area(self.design, index)
        if area is None or self.differing.is_empty():
            return area
        places = self.differing.extents().merged()
        near = db.RecursiveShapeIterator(self.design, self.design.top_cell(), index, places, True)
        lost = (self.differing & db.Region(near)).area()
        return area + int(self.differing.area()) - 2 * int(lost)


def drawn_figures(
    layout: db.Layout, path: Path, max_vertices: int | None, known: Known | None = None
) -> Iterator[Quantity]:
    """Duplicate shapes, and outlines of too many vertices, in the layout's own coordinates.

    Args:
        max_vertices: what the job draws at most; None where it does not say.
        known: the design that it lies upon, and how little it differs; None where there is none.
    """
    yield _overlaps(layout, path, known)
    most = max_vertices if max_vertices is not None else GDSII_VERTICES
    judged = max_vertices is not None or suffix_of(path) in FORMATS["gdsii"].suffixes
    long = list(_long_outlines(layout, most))
    by = "the job's max_vertices" if max_vertices is not None else "what GDSII takes"
    first = "".join(f": {count} in cell {cell!r}" for cell, count in long[:1])
    yield Quantity(
        "rule_vertices",
        len(long),
        f"polygons of {path.name} with more than {most} vertices, {by}{first}",
        detail=str(most),
        limit=0 if judged else None,
        passed=not long if judged else None,
    )


def slanted(laid: db.Layout, design: db.Layout | None) -> Quantity:
    """Edges as drawn that run along neither axis, but for those of shapes of the design that have such edges, too."""
    method = "edges as drawn that run along neither x nor y"
    edges = db.Edges()
    around = db.Region()
    if _any_slanted(laid):
        if design is None and _too_many(laid, laid.find_layer(layer_info(CLEAR))):
            method += f"; not counted among more than {MOST_FLAT_ALONE} shapes, of which some have any"
            return Quantity("rule_manhattan", None, method, limit=0, passed=False)
        edges = _slanted_edges(laid)
        around = db.Region() if design is None else _slanted_polygons(design).extents(1)
    left = edges if around.is_empty() else edges.not_interacting(around)
    boxes = sorted((edge.bbox() for edge in left.each()), key=lambda box: (box.bottom, box.left))
    places = f", at {_listed(boxes)} um" if boxes else ""
    method += "" if design is None else ", where no shape of the design has any"
    return Quantity("rule_manhattan", len(boxes), method + places, limit=0, passed=not boxes)


def reach(plate: Plate, box: db.Box, size: float) -> Quantity:
    """Distance by which the drawing extends beyond the blank.

    Args:
        size: nanometres of the plate that one of the file becomes.
    """
    side = round(plate.blank_nm * size)
    boxes = [] if box.empty() else [(box.left, box.bottom, box.right, box.top)]
    extent = checked_extent(boxes, (side, side))
    beyond = extent.value / size / NM_PER_UM if isinstance(extent.value, int | float) else 0
    return Quantity(
        "rule_extent",
        beyond,
        f"how far what is drawn reaches beyond the blank of {plate.blank_nm / NM_PER_MM:g} mm",
        limit=0,
        passed=extent.passed,
    )


def _overlaps(layout: db.Layout, path: Path, known: Known | None) -> Quantity:
    """Where the areas of all shapes sum up to what is clear, none overlap."""
    index = layout.find_layer(layer_info(CLEAR))
    tolerance_nm = 0.0 if known is None else known.tolerance_nm
    what = f"areas of {path.name} that are drawn more than once"
    what += f" and wider than {tolerance_nm:g} nm" if tolerance_nm else ""
    clear_nm2 = None if known is None else known.clear_nm2
    if clear_nm2 is not None and _drawn_area(layout, index) == clear_nm2:
        return Quantity("rule_overlap", 0, what, limit=0, passed=True)
    most = MOST_FLAT if known is not None else MOST_FLAT_ALONE
    if _too_many(layout, index) if known is None else count_shapes(layout, [index]) > most:
        what += f"; not looked for among more than {most} shapes"
        return Quantity("rule_overlap", None, what)
    # In hierarchy klayout takes two references to one cell at one place for one.
    twice = list(sift(db.Region(layout.top_cell().begin_shapes_rec(index)).merged(True, 2), tolerance_nm).faults.each())
    area = sum(polygon.area() for polygon in twice) / _NM2_PER_UM2
    boxes = sorted((polygon.bbox() for polygon in twice), key=lambda box: (box.bottom, box.left))
    places = f": {area:g} um^2, at {_listed(boxes)} um" if boxes else ""
    return Quantity("rule_overlap", len(boxes), what + places, limit=0, passed=not boxes)


def _too_many(layout: db.Layout, index: int) -> bool:
    return weight(layout.top_cell().begin_shapes_rec(index), MOST_FLAT_ALONE) > MOST_FLAT_ALONE


def _drawn_area(layout: db.Layout, index: int) -> int | None:
    """Sum of the areas of all shapes in nm², every reference followed; None where some are scaled."""
    if any(instance.is_complex() for cell in layout.each_cell() for instance in cell.each_inst()):
        return None
    return int(drawn_areas(layout, index)[layout.top_cell().cell_index()])


def _long_outlines(layout: db.Layout, most: int) -> Iterator[tuple[str, int]]:
    index = layout.find_layer(layer_info(CLEAR))
    for cell in layout.each_cell():
        for polygon in own_polygons(cell, index).each():
            if polygon.num_points() > most:
                yield cell.name, polygon.num_points()


def _any_slanted(layout: db.Layout) -> bool:
    index = layout.find_layer(layer_info(CLEAR))
    for cell in layout.each_cell():
        if not own_polygons(cell, index).non_rectilinear().is_empty() or any(
            instance.is_complex() for instance in cell.each_inst()
        ):
            return True
    return False


def _slanted_polygons(layout: db.Layout) -> db.Region:
    store = db.DeepShapeStore()
    drawn = db.Region(layout.top_cell().begin_shapes_rec(layout.find_layer(layer_info(CLEAR))), store)
    drawn.merged_semantics = False
    slanted_shapes = db.Region(list(drawn.non_rectilinear().each()))
    slanted_shapes.merged_semantics = False
    return slanted_shapes


def _slanted_edges(layout: db.Layout) -> db.Edges:
    edges = _slanted_polygons(layout).edges()
    edges.merged_semantics = False
    slanted_edges = edges.with_angle(db.Edges.OrthoEdges, True)
    slanted_edges.merged_semantics = False
    return slanted_edges


def _listed(boxes: Iterable[db.Box]) -> str:
    first = list(boxes)[:_TOLD]
    return ", ".join(f"({box.left / NM_PER_UM:g}, {box.bottom / NM_PER_UM:g})" for box in first)


MOST_LOOKED = 200_000
"""Shapes that are flattened for the rules of a file that is the design, or nearly."""

MOST_LOOKED_ALONE = 10_000
"""Limit for a file that is not: it fails, whatever its rules."""

_MOST_FACING = 20_000_000
"""Steps that the rules may take in such a file."""

_SAMPLE = 1000
"""Vertices, in a part of a region that tells about how near its sides are."""

_NEARER = 1024
"""Of sides that are told one by one."""
_AT_A_TIME = 20_000_000


@dataclass(frozen=True)
class Asked:
    """Rules that apply to a file.

    Attributes:
        rules: on what is clear, in nanometres of the plate.
        stated: the rules that the job's [limits] set; the others are the smallest features of the design itself.
        size: nanometres of the plate that one nanometre of the file becomes when the file is laid on the design.
    """

    rules: DesignRules
    stated: frozenset[str]
    size: float = 1.0


@dataclass(frozen=True, eq=False)
class Broken:
    """Where one rule is broken: boxes int64 [n, 4], all of them, or the first."""

    count: int
    worst: float | None
    boxes_nm: Ints


NOTHING = Broken(0, None, np.zeros((0, 4), dtype=np.int64))


def asked(plate: Plate, limits: LimitsSection, scale: float = 1.0) -> Asked:
    """Width and space by the job's limits, else by the smallest features of the design itself.

    Args:
        scale: what the file's coordinates are multiplied by to be the design's. Sizes are the file's own, unless it
            is so far off that its unit is mistaken.
    """
    stated = {"width": limits.min_feature, "space": limits.min_space}
    own = [smallest_features(die) for die in plate.dies] if None in stated.values() else []
    size = scale if 0.5 < scale < 2 else 1.0
    asked_nm: dict[str, int | None] = {}
    for k, (name, limit_um) in enumerate(stated.items()):
        smallest = [pair[k].value for pair in own]
        least = min((value for value in smallest if isinstance(value, float)), default=None)
        limit = limit_um if limit_um is not None else least
        asked_nm[name] = None if limit is None else max(1, math.floor(size * limit * NM_PER_UM + 1e-6))
    sides = [side for side in asked_nm.values() if side is not None]
    rules = DesignRules(
        min_width_nm=asked_nm["width"],
        min_space_nm=asked_nm["space"],
        min_notch_nm=asked_nm["space"],
        min_area_nm2=min(sides) ** 2 if sides else None,
        no_corner_touch=True,
        kissing=False,
    )
    names = {name for name, limit in stated.items() if limit is not None}
    return Asked(rules, frozenset(names | ({"notch"} if "space" in names else set())), size)


def rules_of_like(
    plate: Plate, design: db.Layout, laid: db.Layout, differing: db.Region, wanted: Asked
) -> Iterator[Quantity]:
    """The rows of a file that is the design, or nearly; rules are looked at where only one of them is clear."""
    rules = wanted.rules
    in_design = _of_plate(plate, rules)
    marks = _of_plate(replace(plate, dies=()), rules)
    places, beyond = _cropped(_round(differing, rules.reach_nm), (design, laid), MOST_LOOKED, _count)
    in_file, expected = (_look(layout, places, rules) for layout in (laid, design))
    for name, before in in_design.items():
        here, there = in_file.get(name, NOTHING), expected.get(name, NOTHING)
        count = max(0, before.count - there.count) + here.count
        hard = name in wanted.stated
        # A job's limits are for its dies: the small letters of a label never keep them.
        allowed = marks[name].count if hard else before.count
        worst = min((side.worst for side in (here, before) if side.count and side.worst is not None), default=None)
        boxes = np.concatenate([here.boxes_nm, before.boxes_nm]) if count else before.boxes_nm[:0]
        said = [f"the design itself has {before.count}"]
        if hard and allowed:
            said[0] += f", {allowed} of them in its marks, of which the limit asks nothing"
        if here.count > there.count:
            said.append(f"{here.count - there.count} more where the file differs from it")
        elif there.count > here.count:
            said.append(f"{there.count - here.count} fewer where the file differs from it")
        broken = Broken(count, worst if count else None, boxes)
        yield _row(name, wanted, broken, allowed, "; ".join(said), beyond)


def rules_of_unlike(read: db.Layout, wanted: Asked) -> Iterator[Quantity]:
    """The rows of a file that is not the design at all, in its own coordinates, and its smallest features."""
    index = read.find_layer(layer_info(CLEAR))
    # Sides cross as often as shapes lie upon each other.
    most = math.ceil(MOST_LOOKED_ALONE / max(1.0, most_covered(read, index)))
    places, beyond = _cropped(db.Region(read.top_cell().bbox(index)), (read,), most, _weight)
    few, part = _cropped(places, (read,), _MOST_FACING, partial(_facing, wanted.rules.reach_nm))
    crowded = _facing(wanted.rules.reach_nm, read, few, _MOST_FACING) > _MOST_FACING
    for name, broken in ({} if crowded else _look(read, few, wanted.rules)).items():
        yield _row(name, wanted, broken, 0, "of the file alone", part or beyond)
    if crowded:
        method = "not counted: within the reach of the rules lie too many sides of a file that is not the design"
        width_nm = wanted.rules.min_width_nm
        yield Quantity("rule_width", None, method, detail=f"places under {width_nm} nm", limit=0, passed=False)
    clear = merged(_shapes(read, places) & places)
    for name, tone in (("width", "what is clear"), ("space", "chrome between clear edges")):
        value, box = _narrowest(clear, name)
        at = "" if box is None else f", at {_at(box)}"
        method = f"least width of {tone} in the file, corner to corner too{at}; corners that kiss are counted apart"
        quantity = "min_feature" if name == "width" else "min_space"
        width_um = None if value is None else value / NM_PER_UM
        yield Quantity(quantity, width_um, method + beyond)


def _of_plate(plate: Plate, rules: DesignRules) -> dict[str, Broken]:
    broken: dict[str, Broken] = {}
    for result in check_plate(plate, rules, most=_TOLD):
        before = broken.get(result.rule, NOTHING)
        values = [value for value in (before.worst, result.value) if isinstance(value, int | float)]
        boxes = np.array(result.places, dtype=np.int64).reshape(-1, 4)
        together = np.concatenate([before.boxes_nm, boxes])
        broken[result.rule] = Broken(before.count + result.count, min(values, default=None), together)
    return broken


def _row(name: str, wanted: Asked, broken: Broken, allowed: int, said: str, beyond: str) -> Quantity:
    rules, size = wanted.rules, wanted.size
    limit_nm = {"width": rules.min_width_nm, "space": rules.min_space_nm, "notch": rules.min_notch_nm}.get(name)
    if limit_nm is not None:
        own = round(limit_nm / size)
        unit, worst = f"places under {own} nm", f"the smallest is {(broken.worst or 0) / size:.4g} nm"
        by = "the job's limit" if name in wanted.stated else "the smallest of the design"
        what = {
            "width": "where what is clear is narrower",
            "space": "with less chrome between clear edges",
            "notch": "with less chrome between two edges of one polygon",
        }[name]
        method = f"places {what} than {own} nm, {by}; corners that kiss are counted apart"
    elif name == "corner_touch":
        unit, worst, method = "points", "", "points in which two clear corners kiss"
    else:
        least = (rules.min_area_nm2 or 0) / size**2 / _NM2_PER_UM2
        unit, worst = f"islands under {least:.4g} um^2", f"the smallest has {(broken.worst or 0) / size**2:.4g} nm^2"
        tone = "clear" if name == "area" else "chrome"
        method = f"{tone} islands of less area than a square of the smallest feature and space, {least:.4g} um^2"
    places = ", ".join(map(_at, broken.boxes_nm[:_TOLD].tolist()))
    where = "; ".join(part for part in (worst, f"at {places}") if part) if broken.count else ""
    words = "; ".join(part for part in (method, said + beyond, where) if part)
    passed, unit = broken.count <= allowed, f"{unit}, in part" if beyond else unit
    limit = f"{allowed} in {'its marks' if name in wanted.stated else 'the design'}" if allowed else 0
    return Quantity(f"rule_{name}", broken.count, words, detail=unit, limit=limit, passed=passed)


def _at(box: Iterable[int]) -> str:
    x, y, *_ = box
    return f"({x / NM_PER_UM:g}, {y / NM_PER_UM:g}) um"


def _round(differing: db.Region, reach_nm: int) -> db.Region:
    """Boxes round all that differs, wide enough for every rule."""
    wide = differing.sized(reach_nm)
    return db.Region([polygon.bbox() for polygon in wide.merged().each()]).merged()


def _cropped(
    places: db.Region, layouts: tuple[db.Layout, ...], most: int, count: Callable[[db.Layout, db.Region, int], int]
) -> tuple[db.Region, str]:
    """The places, or as large a part of them as holds few enough shapes; and what that leaves out, in words."""
    box, whole = places.bbox(), True
    while any(count(layout, places, most) > most for layout in layouts):
        x, y = box.center().x, box.center().y
        if box.width() >= box.height():
            halves = db.Box(box.left, box.bottom, x, box.top), db.Box(x, box.bottom, box.right, box.top)
        else:
            halves = db.Box(box.left, box.bottom, box.right, y), db.Box(box.left, y, box.right, box.top)
        if box in halves:
            break
        parts = [places & db.Region(half) for half in halves]
        # A half without shapes would tell nothing.
        counts = [max(count(layout, part, most) for layout in layouts) for part in parts[:1]]
        if counts[0] <= most:
            counts.append(max(count(layout, parts[1], most) for layout in layouts))
        fuller = counts.index(max(counts))
        box, places, whole = halves[fuller], parts[fuller], False
    if whole:
        return places, ""
    low, high = _at((box.left, box.bottom)), _at((box.right, box.top))
    return places, f"; of more than {most} shapes, only those from {low} to {high} were looked at"


def _count(layout: db.Layout, places: db.Region, _most: int) -> int:
    return int(_shapes(layout, places).count())


def _facing(reach_nm: int, layout: db.Layout, places: db.Region, _most: int) -> int:
    """About how many steps the rules take in some places and round them: every side is held against those within reach,
    and whether a third one stands between two is asked of each."""
    around = places.bbox().enlarged(2 * reach_nm, 2 * reach_nm)
    around &= clear_box(layout)
    sides = 4 * _weight(layout, db.Region(around), MOST_LOOKED_ALONE)
    near: float = min(1.0, (2 * reach_nm) ** 2 / max(1, around.area()))
    return math.ceil(sides * max(1.0, near * sides) ** 2)


def _weight(layout: db.Layout, places: db.Region, most: int) -> int:
    return 0 if places.is_empty() else weight(_within_places(layout, places), most)


def _shapes(layout: db.Layout, places: db.Region) -> db.Region:
    return db.Region() if places.is_empty() else db.Region(_within_places(layout, places))


def _within_places(layout: db.Layout, places: db.Region) -> db.RecursiveShapeIterator:
    index = layout.find_layer(layer_info(CLEAR))
    return db.RecursiveShapeIterator(layout, layout.top_cell(), index, places, True)


def _look(layout: db.Layout, places: db.Region, rules: DesignRules) -> dict[str, Broken]:
    """Violations in some boxes. A ring round them is cut off with them, so that its own rim breaks nothing."""
    reach = rules.reach_nm
    ring = places.sized(2 * reach + 1).merged()
    clear = merged(_shapes(layout, ring) & ring)
    boxes = _corners(places.each())
    broken: dict[str, Broken] = {}
    for name, (_, check) in distance_checks(rules).items():
        facing = facing_edges(check(clear))
        broken[name] = _within(boxes, facing.boxes_nm, facing.values)
    if rules.min_area_nm2 is not None:
        chrome = merged(ring - clear)
        for name, islands in (("area", clear), ("chrome_area", chrome)):
            small = _whole(list(islands.with_area(0, rules.min_area_nm2, False).each()), ring)
            areas = np.array([float(island.area()) for island in small])
            broken[name] = _within(boxes, _corners(small), areas)
    (kisses,) = flat_results(clear, (), DesignRules(no_corner_touch=True), clear.count() * 64)
    points = np.array(kisses.places, dtype=np.int64).reshape(-1, 4)
    broken["corner_touch"] = _within(boxes, points, np.zeros(len(points)))
    return broken


def _corners(polygons: Iterable[db.Polygon]) -> Ints:
    boxes = [polygon.bbox() for polygon in polygons]
    return np.array([[box.left, box.bottom, box.right, box.top] for box in boxes], dtype=np.int64).reshape(-1, 4)


def _whole(islands: list[db.Polygon], ring: db.Region) -> list[db.Polygon]:
    if not islands:
        return []
    drawn = db.Region(islands)
    drawn.merged_semantics = False
    return list(drawn.not_interacting(ring.edges()).each())


def _within(places: Ints, boxes: Ints, values: NDArray[np.float64]) -> Broken:
    step = max(1, _AT_A_TIME // max(1, len(places)))
    keep = np.zeros(len(boxes), dtype=np.bool_)
    for k in range(0, len(boxes), step):
        some = boxes[k : k + step, None]
        meets = (some[..., :2] <= places[:, 2:]).all(axis=-1) & (some[..., 2:] >= places[:, :2]).all(axis=-1)
        keep[k : k + step] = meets.any(axis=-1)
    order = np.argsort(values[keep], kind="stable")
    chosen = boxes[keep][order]
    return Broken(len(chosen), float(values[keep].min()) if len(chosen) else None, chosen)


def _narrowest(clear: db.Region, name: str) -> tuple[float | None, Iterable[int] | None]:
    """The least width or space in nanometres, and where; None if nothing faces anything.

    One looks twice as far each time, for within a wide limit outlines have many pairs of sides. A part tells where to
    begin.
    """
    if clear.is_empty():
        return None, None
    box = clear.bbox()
    farthest = box.width() + box.height()
    about, _ = _near(_part(clear), name, 1, farthest)
    limit, pairs = _near(clear, name, 1 if about is None else max(1, about // _NEARER), farthest)
    if limit is None:
        return None, None
    facing = facing_edges(pairs)
    worst = int(facing.values.argmin())
    return float(facing.values[worst]), facing.boxes_nm[worst].tolist()


def _part(clear: db.Region) -> db.Region:
    """Polygons of few vertices all together, one at least."""
    part, vertices = db.Region(), 0
    part.merged_semantics = False
    for polygon in clear.each():
        part.insert(polygon)
        vertices += polygon.num_points()
        if vertices > _SAMPLE:
            break
    return part


def _near(clear: db.Region, name: str, limit_nm: int, farthest_nm: int) -> tuple[int | None, db.EdgePairs]:
    """The first limit, of those that double up to the farthest, within which sides face each other; and the pairs."""
    while (pairs := _pairs(clear, name, limit_nm)).is_empty():
        if limit_nm >= farthest_nm:
            return None, pairs
        limit_nm = min(2 * limit_nm, farthest_nm)
    return limit_nm, pairs


def _pairs(clear: db.Region, name: str, limit_nm: int) -> db.EdgePairs:
    width, space = (limit_nm, None) if name == "width" else (None, limit_nm)
    _, check = distance_checks(DesignRules(min_width_nm=width, min_space_nm=space, kissing=False))[name]
    return check(clear)
