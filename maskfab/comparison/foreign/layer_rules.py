"""The design rules on what a file from elsewhere makes clear, by the job's limits.

Where the file is the design, the design is judged in its place, cell by cell; where it differs, both are looked at, and
the count of the file is that of the design, less what the design breaks there, and more what the file does.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from klayout import db
from numpy.typing import NDArray

from maskfab.base.arrays import Ints
from maskfab.drc.canvas import facing_edges
from maskfab.drc.flat import flat_results, merged
from maskfab.drc.plate_rules import check_plate
from maskfab.drc.rules import DesignRules, distance_checks
from maskfab.geometry.plate_layout import clear_box, layer_info
from maskfab.geometry.shape_limits import most_covered, weight
from maskfab.jobfile import LimitsSection
from maskfab.measurement.features import smallest_features
from maskfab.model import CLEAR, Plate, Quantity
from maskfab.units import NM_PER_UM

MOST_LOOKED = 200_000
"""Shapes that are flattened for the rules of a file that is the design, or nearly."""

MOST_LOOKED_ALONE = 10_000
"""Limit for a file that is not: it fails, whatever its rules."""

_MOST_FACING = 20_000_000
"""Steps that the rules may take in such a file."""

_TOLD = 4
_SAMPLE = 1000
"""Vertices, in a part of a region that tells about how near its sides are."""

_NEARER = 1024
_MOST_PAIRS = 20_000
"""Of sides that are told one by one."""
_NM2_PER_UM2 = NM_PER_UM**2
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
    """Where one rule is broken.

    Attributes:
        count: at how many places.
        worst: the smallest value; None where it is kept.
        boxes_nm: int64 [n, 4], all of them, or the first.
    """

    count: int
    worst: float | None
    boxes_nm: Ints


NOTHING = Broken(0, None, np.zeros((0, 4), dtype=np.int64))


def asked(plate: Plate, limits: LimitsSection, scale: float = 1.0) -> Asked:
    """Width and space by the job's limits, else by the smallest features of the design itself.

    Args:
        plate: the design.
        limits: the job's.
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
    """The rows of a file that is the design, or nearly.

    Args:
        plate: the design.
        design: its layout.
        laid: the file, lying as the design does.
        differing: what only one of them makes clear, where rules are looked at.
        wanted: what is asked of it.
    """
    rules = wanted.rules
    known = _of_plate(plate, rules)
    marks = _of_plate(replace(plate, dies=()), rules)
    places, beyond = _cropped(_round(differing, rules.reach_nm), (design, laid), MOST_LOOKED, _count)
    found, expected = (_look(layout, places, rules) for layout in (laid, design))
    for name, before in known.items():
        here, there = found.get(name, NOTHING), expected.get(name, NOTHING)
        count = max(0, before.count - there.count) + here.count
        hard = name in wanted.stated
        # A job's limits are for its dies: the small letters of a label never keep them.
        allowed = marks[name].count if hard else before.count
        worst = min((each.worst for each in (here, before) if each.count and each.worst is not None), default=None)
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
        told = None if value is None else value / NM_PER_UM
        yield Quantity(quantity, told, method + beyond)


def _of_plate(plate: Plate, rules: DesignRules) -> dict[str, Broken]:
    """Rules broken by the design, all its dies and marks together."""
    known: dict[str, Broken] = {}
    for result in check_plate(plate, rules, most=_TOLD):
        before = known.get(result.rule, NOTHING)
        values = [each for each in (before.worst, result.value) if isinstance(each, int | float)]
        boxes = np.array(result.places, dtype=np.int64).reshape(-1, 4)
        together = np.concatenate([before.boxes_nm, boxes])
        known[result.rule] = Broken(before.count + result.count, min(values, default=None), together)
    return known


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
    where = "; ".join(part for part in (worst, f"at {_listed(broken.boxes_nm)}") if part) if broken.count else ""
    told = "; ".join(part for part in (method, said + beyond, where) if part)
    passed, unit = broken.count <= allowed, f"{unit}, in part" if beyond else unit
    limit = f"{allowed} in {'its marks' if name in wanted.stated else 'the design'}" if allowed else 0
    return Quantity(f"rule_{name}", broken.count, told, detail=unit, limit=limit, passed=passed)


def _listed(boxes: Ints) -> str:
    return ", ".join(_at(box) for box in boxes[:_TOLD].tolist())


def _at(box: Iterable[int]) -> str:
    x, y, *_ = box
    return f"({x / NM_PER_UM:g}, {y / NM_PER_UM:g}) um"


def _round(differing: db.Region, reach_nm: int) -> db.Region:
    """Boxes round all that differs, wide enough for every rule."""
    wide = differing.sized(reach_nm)
    return db.Region([polygon.bbox() for polygon in wide.merged().each()]).merged()


def _cropped(
    places: db.Region,
    layouts: tuple[db.Layout, ...],
    most: int,
    count: Callable[[db.Layout, db.Region, int], int],
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
    """Shapes of a layout in some boxes, not cut at their sides."""
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
    found: dict[str, Broken] = {}
    for name, (_, check) in distance_checks(rules).items():
        facing = facing_edges(check(clear))
        found[name] = _within(boxes, facing.boxes_nm, facing.values)
    if rules.min_area_nm2 is not None:
        chrome = merged(ring - clear)
        for name, islands in (("area", clear), ("chrome_area", chrome)):
            small = _whole(list(islands.with_area(0, rules.min_area_nm2, False).each()), ring)
            areas = np.array([float(each.area()) for each in small])
            found[name] = _within(boxes, _corners(small), areas)
    (kisses,) = flat_results(clear, (), DesignRules(no_corner_touch=True), clear.count() * 64)
    points = np.array(kisses.places, dtype=np.int64).reshape(-1, 4)
    found["corner_touch"] = _within(boxes, points, np.zeros(len(points)))
    return found


def _corners(polygons: Iterable[db.Polygon]) -> Ints:
    boxes = [polygon.bbox() for polygon in polygons]
    return np.array([[box.left, box.bottom, box.right, box.top] for box in boxes], dtype=np.int64).reshape(-1, 4)


def _whole(islands: list[db.Polygon], ring: db.Region) -> list[db.Polygon]:
    """Those that the ring does not cut."""
    if not islands:
        return []
    drawn = db.Region(islands)
    drawn.merged_semantics = False
    return list(drawn.not_interacting(ring.edges()).each())


def _within(places: Ints, boxes: Ints, values: NDArray[np.float64]) -> Broken:
    """Those of some violations that meet the places."""
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

    One looks twice as far each time, for within a wide limit round outlines have as many pairs of sides as sides
    squared; and not quite as far again where there are many pairs. A part tells where to begin.
    """
    if clear.is_empty():
        return None, None
    box = clear.bbox()
    farthest = box.width() + box.height()
    about, _ = _near(_part(clear), name, 1, farthest)
    limit, pairs = _near(clear, name, 1 if about is None else max(1, about // _NEARER), farthest)
    if limit is None:
        return None, None
    low = 0
    while pairs.count() > _MOST_PAIRS and limit - low > 1:
        middle = (low + limit) // 2
        fewer = _pairs(clear, name, middle)
        if fewer.is_empty():
            low = middle
        else:
            limit, pairs = middle, fewer
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
