"""The design rules on a layout that maskfab did not make, or whose panels it does not know: names, extent, shapes."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence

from klayout import db

from maskfab.drc.flat import flat_results, merged
from maskfab.drc.results import RuleResult, counted_references
from maskfab.drc.rules import DesignRules
from maskfab.errors import SourceError
from maskfab.geometry.plate_layout import layer_info
from maskfab.model import CLEAR, Box, Layer, Polygon

MOST_SHAPES = 200_000


def checked_names(names: Iterable[str], rules: DesignRules) -> tuple[RuleResult, ...]:
    """One result for each rule on names; names that break it are listed in alphabetical order."""
    every = sorted(names)
    results = []
    if rules.name_pattern is not None:
        pattern = re.compile(rules.name_pattern)
        bad = tuple(name for name in every if pattern.fullmatch(name) is None)
        results.append(_result("name_pattern", rules.name_pattern, "", bad))
    for text in rules.forbidden_names:
        bad = tuple(name for name in every if text.casefold() in name.casefold())
        results.append(_result("forbidden_name", text, "", bad))
    if rules.max_name_length is not None:
        bad = tuple(name for name in every if len(name) > rules.max_name_length)
        longest = max((len(name) for name in bad), default=None)
        results.append(RuleResult("name_length", rules.max_name_length, "characters", longest, len(bad), names=bad))
    return tuple(results)


def _result(rule: str, limit: str, unit: str, bad: tuple[str, ...]) -> RuleResult:
    return RuleResult(rule, limit, unit, bad[0] if bad else None, len(bad), names=bad)


def checked_extent(boxes: Iterable[Box], extent_nm: tuple[int, int]) -> RuleResult:
    """Boxes that leave a box about the origin; the value is how far the worst sticks out, in nm.

    Args:
        boxes: of everything that is written, in plate coordinates.
        extent_nm: width and height of the box that should hold them.
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


def check_layout(
    layout: db.Layout,
    rules: DesignRules,
    *,
    layers: Sequence[Layer | db.LayerInfo] = (CLEAR,),
    most: int = 16,
    most_shapes: int = MOST_SHAPES,
) -> tuple[RuleResult, ...]:
    """Every rule on a flattened layout.

    Args:
        layout: one top cell, database unit 1 nm.
        rules: what to check.
        layers: what is written; layers are joined, one that the layout lacks is empty.
        most: how many violations of a rule are placed.
        most_shapes: the largest number of shapes that is flattened.

    Raises:
        SourceError: MF305 if there is not one top cell, MF418 if the layout has more shapes than that.
    """
    tops = layout.top_cells()
    if len(tops) != 1:
        raise SourceError(
            "MF305", f"the layout has {len(tops)} top cells; one is needed", cure="Keep the one that is the plate"
        )
    infos = [layer_info(layer) if isinstance(layer, Layer) else layer for layer in layers]
    indices = [index for index in map(layout.find_layer, infos) if index is not None]
    shapes = sum(flat_shapes(layout, index) for index in indices)
    if shapes > most_shapes:
        raise SourceError(
            "MF418",
            f"the layout has {shapes} shapes once flattened; design rules are checked on at most {most_shapes}",
            cure="Check the plate itself, or a smaller cell",
        )
    polygons = drawn_polygons(layout, indices)
    region = db.Region()
    for index in indices:
        region += db.Region(tops[0].begin_shapes_rec(index))
    results = [*flat_results(merged(region), polygons, rules, most)]
    results += checked_names([cell.name for cell in layout.each_cell()], rules)
    if rules.max_references is not None:
        references = sum(cell.child_instances() for cell in layout.each_cell())
        results.append(counted_references(references, rules.max_references))
    if rules.extent_nm is not None:
        box = region.bbox()
        boxes = [] if box.empty() else [(box.left, box.bottom, box.right, box.top)]
        results.append(checked_extent(boxes, rules.extent_nm))
    return tuple(results)


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


def flat_shapes(layout: db.Layout, index: int) -> int:
    """Number of shapes on a layer once the hierarchy is flattened, found without flattening it."""
    times = {layout.top_cell().cell_index(): 1}
    total = 0
    for cell_index in layout.each_cell_top_down():
        cell, placed = layout.cell(cell_index), times.get(cell_index, 0)
        total += placed * cell.shapes(index).size()
        for instance in cell.each_inst():
            copies = instance.na * instance.nb if instance.is_regular_array() else 1
            times[instance.cell_index] = times.get(instance.cell_index, 0) + placed * copies
    return total
