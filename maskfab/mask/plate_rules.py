"""Design rules of a plate, checked exactly without drawing its panels where dies lie apart; the smallest
features by which a house judges and prices it; and a marker file (.lyrdb) that KLayout shows on top of the plate."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from klayout import db, rdb

from maskfab.base.findings import LIMITS
from maskfab.base.model import CLEAR, Box, Die, Mark, Plate, Polygon, Quantity
from maskfab.base.units import NM_PER_UM
from maskfab.job.process import Process
from maskfab.job.sections import LimitsSection
from maskfab.mask.design_rules import DesignRules, RuleResult, counted_references, flat_results, merged
from maskfab.mask.layout import DBU_UM, drawn_region, file_references, layer_info, plate_layout, plate_names, region
from maskfab.mask.marks import bounding_box
from maskfab.mask.panel_rules import Narrowest, PanelCells, Tone, narrowest, panel_results


def checked_names(names: Iterable[str], rules: DesignRules) -> tuple[RuleResult, ...]:
    """One result for each rule on names; names that break it are listed in alphabetical order."""
    every = sorted(names)
    results = []
    if rules.name_pattern is not None:
        pattern = re.compile(rules.name_pattern)
        bad = tuple(name for name in every if pattern.fullmatch(name) is None)
        results.append(RuleResult("name_pattern", rules.name_pattern, "", next(iter(bad), None), len(bad), names=bad))
    for text in rules.forbidden_names:
        bad = tuple(name for name in every if text.casefold() in name.casefold())
        results.append(RuleResult("forbidden_name", text, "", next(iter(bad), None), len(bad), names=bad))
    if rules.max_name_length is not None:
        bad = tuple(name for name in every if len(name) > rules.max_name_length)
        longest = max((len(name) for name in bad), default=None)
        results.append(RuleResult("name_length", rules.max_name_length, "characters", longest, len(bad), names=bad))
    return tuple(results)


def checked_extent(boxes: Iterable[Box], extent_nm: tuple[int, int]) -> RuleResult:
    """Boxes that leave a box about the origin; the value is how far the worst sticks out, in nm.

    Args:
        boxes: of everything that is written, in plate coordinates.
    """
    width, height = extent_nm
    out = []
    for x0, y0, x1, y1 in boxes:
        beyond = max(max(-x0, x1) - width / 2, max(-y0, y1) - height / 2)
        if beyond > 0:
            out.append((y0, x0, y1, x1, beyond))
    places = tuple((x0, y0, x1, y1) for y0, x0, y1, x1, _ in sorted(out))
    worst = max((beyond for *_, beyond in out), default=None)
    return RuleResult("extent", f"{width} x {height}", "nm", worst, len(out), places)


def drawn_polygons(layout: db.Layout, indices: Sequence[int]) -> list[Polygon]:
    """The polygons of layers as they are drawn, flattened; holes are outlines of their own."""
    polygons: list[Polygon] = []
    for index in indices:
        region = db.Region(layout.top_cell().begin_shapes_rec(index))
        region.merged_semantics = False
        for polygon in region.each():
            polygons.append(tuple((point.x, point.y) for point in polygon.each_point_hull()))
            for hole in range(polygon.holes()):
                polygons.append(tuple((point.x, point.y) for point in polygon.each_point_hole(hole)))
    return polygons


def check_plate(plate: Plate, rules: DesignRules, *, most: int = 16) -> tuple[RuleResult, ...]:
    """Every rule on every die, on the marks, and on the plate as a whole.

    Counts and places are those of KLayout's checks on the flat, merged plate, places to the nanometre to which it
    rounds; of a space that runs on through several cells only the lower left corner of the place is. Dies and marks
    are looked at one by one, unless some lie within the rules' reach of each other: then the plate is flattened, which
    takes as long as it does in KLayout, and the rules on geometry have one result, without a die.

    Returns:
        For each die and then for the marks (``die`` is None) one result for each rule on geometry; then the rules on
        names, references and extent.
    """
    marks = _written_marks(plate)
    results: list[RuleResult] = []
    if dies_apart(plate, rules.reach_nm):
        for die in plate.dies:
            results += panel_results(die, rules, most)
        results += flat_results(merged(drawn_region(marks)), marks, rules, most)
    else:
        layout = plate_layout(plate)
        index = layout.find_layer(layer_info(CLEAR))
        polygons = drawn_polygons(layout, [index])
        results += flat_results(merged(region(layout, CLEAR)), polygons, rules, most)
    names = plate_names(plate)
    results += checked_names([names.top, *names.dies, *names.marks, *names.units.values()], rules)
    if rules.max_references is not None:
        results.append(counted_references(file_references(plate), rules.max_references))
    if rules.extent_nm is not None:
        results.append(
            checked_extent([*_clear_boxes(plate), *(bounding_box([mark]) for mark in marks)], rules.extent_nm)
        )
    return tuple(results)


def dies_apart(plate: Plate, reach_nm: int) -> bool:
    """Whether no die comes within reach of another, or of a mark."""
    marks = _written_marks(plate)
    dies = np.array([die.box_nm for die in plate.dies], dtype=np.int64).reshape(-1, 4)
    every = np.concatenate([dies, np.array([bounding_box([mark]) for mark in marks], dtype=np.int64).reshape(-1, 4)])
    low = np.maximum(dies[:, None, :2], every[None, :, :2])
    high = np.minimum(dies[:, None, 2:], every[None, :, 2:])
    near = ((low - high) <= reach_nm).all(axis=2)
    near[np.arange(len(dies)), np.arange(len(dies))] = False
    return not near.any()


def _written_marks(plate: Plate) -> list[Polygon]:
    return [polygon for mark in plate.marks if mark.layer.written for polygon in mark.polygons]


def _clear_boxes(plate: Plate) -> Iterator[Box]:
    for die in plate.dies:
        cells = PanelCells.of(die.panel)
        hulls = np.zeros((len(cells.held), 4), dtype=np.int64)
        for code, raster in enumerate(cells.clear):
            ys, xs = np.nonzero(raster)
            if xs.size:
                low, high = cells.edges_nm[:-1], cells.edges_nm[1:]
                hulls[code] = low[xs.min()], low[ys.min()], high[xs.max()], high[ys.max()]
        full = (hulls[:, 2] > hulls[:, 0])[cells.codes.ravel()]
        if full.any():
            boxes = (hulls[cells.codes.ravel()] + np.tile(cells.origins_nm + np.asarray(die.origin_nm), 2))[full]
            low, high = boxes.min(axis=0), boxes.max(axis=0)
            yield int(low[0]), int(low[1]), int(high[2]), int(high[3])


def smallest_features(die: Die) -> tuple[Quantity, Quantity]:
    """Least clear width and least opaque space of the whole panel, corner to corner included, in micrometres; exact."""
    return _smallest(die, "min_feature", "clear"), _smallest(die, "min_space", "opaque")


def _smallest(die: Die, name: str, tone: Tone) -> Quantity:
    what = "width of what is clear" if tone == "clear" else "chrome between clear edges"
    method = f"least {what} over the panel, corner to corner too; corners that kiss are counted apart; exact"
    length_nm = narrowest(die, tone).value_nm
    value = length_nm / NM_PER_UM if math.isfinite(length_nm) else None
    return Quantity(name, value, method, die=die.name)


def written_features(drawn: tuple[Quantity, Quantity], process: Process) -> tuple[Quantity, ...]:
    """The smallest features as drawn, and as a process writes straight edges: wider by its bias, spaces narrower."""
    change = f"{abs(process.cd_bias_um):g} um, {'less' if process.cd_bias_um < 0 else 'more'} of what is clear"
    written = []
    for quantity, sign in zip(drawn, (1, -1), strict=True):
        value = quantity.value + sign * process.cd_bias_um if isinstance(quantity.value, float) else None
        name, method = f"written_{quantity.name}", f"{quantity.name} by a bias of {change}"
        written.append(replace(quantity, name=name, value=value, method=method))
    return (*drawn, *written)


def limits_as_rules(limits: LimitsSection) -> DesignRules:
    """Width and space by the job's limits, and no corners that only touch, which are no width or space of nothing."""
    width, space = (
        None if limit is None else round(limit * NM_PER_UM) for limit in (limits.min_feature, limits.min_space)
    )
    return DesignRules(min_width_nm=width, min_space_nm=space, no_corner_touch=True, kissing=False)


def judged(quantity: Quantity, limits: LimitsSection) -> Quantity:
    """The quantity with the job's limit and verdict, where the job sets one."""
    limit = getattr(limits, LIMITS[quantity.name]) if quantity.name in LIMITS else None
    if limit is None or isinstance(quantity.value, str):
        return quantity
    if quantity.value is None:
        return replace(quantity, limit=limit, passed=True)
    passed = quantity.value <= limit if quantity.name == "corner_touches" else quantity.value >= limit
    return replace(quantity, limit=limit, passed=passed)


FINE_ON_PURPOSE = ("resolution", "code")
"""Kinds of marks that show how fine a writer is, or that only a camera reads."""

_FIRST_NM, _LAST_NM = 2_000, 512_000


@dataclass(frozen=True)
class Smallest:
    """Least widths of one kind of shapes.

    Attributes:
        fine: whether they are fine on purpose.
        clear_um: least width of what is clear; infinite where nothing is narrower than half a millimetre, 0 where
            it tapers to a point.
        chrome_um: least width of the chrome between them, likewise.
    """

    of: str
    fine: bool
    clear_um: float
    chrome_um: float

    @property
    def least_um(self) -> float:
        """The lesser of both; a corner that tapers to a point has no width that anybody could hold."""
        return min((width for width in (self.clear_um, self.chrome_um) if width), default=math.inf)

    def __str__(self) -> str:
        return f"clear {_width_text(self.clear_um)}, chrome between {_width_text(self.chrome_um)}"


def smallest_of_plate(plate: Plate, of_die: Callable[[Die, Tone], Narrowest] = narrowest) -> tuple[Smallest, ...]:
    """Least widths on a plate that is :func:`maskfab.mask.houses.adaptation.fitted`, measured between edges of its
    polygons.

    Corners that only meet have a rule of their own and do not count.

    Args:
        of_die: as :func:`maskfab.mask.panel_rules.narrowest`, from which it may be kept.

    Returns:
        Those of the openings; of the marks and letters; and of the marks that are fine on purpose. Kinds of which the
        plate has none are left out.
    """
    widths = []
    if plate.dies:
        clear, chrome = (
            min(of_die(die, tone).value_nm / NM_PER_UM for die in plate.dies) for tone in ("clear", "opaque")
        )
        widths.append(Smallest("openings", False, clear, chrome))
    marks = [mark for mark in plate.marks if mark.layer.written]
    for kind, fine in (("marks and letters", False), ("test figures, fine on purpose", True)):
        alike = tuple(mark for mark in marks if (mark.kind in FINE_ON_PURPOSE) == fine)
        if alike:
            widths.append(Smallest(kind, fine, *(_least_um(plate, alike, rule) for rule in ("width", "space"))))
    return tuple(widths)


def _least_um(plate: Plate, marks: tuple[Mark, ...], rule: str) -> float:
    """Least width or space of marks, looked for ever further: near distances are found in far less time."""
    alone, reach = replace(plate, dies=(), marks=marks), _FIRST_NM
    while reach <= _LAST_NM:
        clear = rule == "width"
        rules = DesignRules(min_width_nm=reach if clear else None, min_space_nm=None if clear else reach, kissing=False)
        values = [result.value for result in check_plate(alone, rules, most=1) if not result.passed]
        if values:
            return min(float(value) for value in values if isinstance(value, int | float)) / NM_PER_UM
        reach *= 4
    return math.inf


def _width_text(width_um: float) -> str:
    if not width_um:
        return "tapering to a point"
    return f"{width_um:.6g} um" if math.isfinite(width_um) else f"wider than {_LAST_NM / NM_PER_UM:g} um"


_DESCRIPTIONS: Mapping[str, str] = json.loads(Path(__file__).with_name("rules.json").read_text(encoding="utf-8"))


def write_markers(results: Iterable[RuleResult], top_cell: str, path: Path) -> None:
    """Write what rules found as a report database; equal results give equal bytes.

    Every rule that was broken is a category, described with its limit; rules on several limits of one name are told
    apart by a number. Each placed violation is a box on the top cell in micrometres, each name a text. The first item
    of every owner carries the number of violations and the worst value, for only the first are placed.
    """
    database = rdb.ReportDatabase("design rules")
    database.description = f"Design rules of {top_cell}"
    database.generator = "maskfab"
    database.top_cell_name = top_cell
    cell = database.create_cell(top_cell)
    categories: dict[tuple[str, int | str], rdb.RdbCategory] = {}
    for result in results:
        if result.passed:
            continue
        key = result.rule, result.limit
        if key not in categories:
            alike = sum(rule == result.rule for rule, _ in categories)
            categories[key] = database.create_category(f"{result.rule}_{alike + 1}" if alike else result.rule)
            text = _DESCRIPTIONS[result.rule]
            categories[key].description = text.format(limit=result.limit, unit=result.unit)
        # An item with neither place nor name still says that the rule is broken.
        markers: list[db.DBox | str] = [db.DBox(*(value * DBU_UM for value in box)) for box in result.places]
        for n, marker in enumerate([*markers, *result.names] or [result.rule]):
            item = database.create_item(cell.rdb_id(), categories[key].rdb_id())
            item.add_value(marker)
            if n == 0:
                owner = f"die {result.die}" if result.die is not None else "plate"
                item.add_value(f"{owner}: {result.count} in all, worst {result.value} {result.unit}".rstrip())
    database.save(str(path))
