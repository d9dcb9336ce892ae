"""The design rules on a plate, without drawing its panels."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from klayout import db

from maskfab.drc.cells import PanelCells
from maskfab.drc.flat import flat_results, merged
from maskfab.drc.layout_rules import checked_extent, checked_names, drawn_polygons
from maskfab.drc.panel_rules import panel_results
from maskfab.drc.results import RuleResult, counted_references
from maskfab.drc.rules import DesignRules
from maskfab.geometry.plate_layout import layer_info, plate_layout, plate_names, region, simple_polygon
from maskfab.model import CLEAR, Box, Die, Plate, Polygon


def check_plate(plate: Plate, rules: DesignRules, *, most: int = 16) -> tuple[RuleResult, ...]:
    """Every rule on every die, on the marks, and on the plate as a whole.

    Counts and places are those of KLayout's checks on the flat, merged plate, places to the nanometre to which it
    rounds; of a space that runs on through several cells only the lower left corner of the place is. Dies and marks
    are looked at one by one, unless some lie within the rules' reach of each other: then the plate is flattened, which
    takes as long as it does in KLayout, and the rules on geometry have one result, without a die.

    Args:
        plate: the plate; only what is written counts.
        rules: what to check.
        most: how many violations of a rule are placed.

    Returns:
        For each die and then for the marks (``die`` is None) one result for each rule on geometry; then the rules on
        names, references and extent.
    """
    marks = _written_marks(plate)
    results: list[RuleResult] = []
    if dies_apart(plate, rules.reach_nm):
        for die in plate.dies:
            results += panel_results(die, rules, most)
        drawn = db.Region([simple_polygon(polygon) for polygon in marks])
        results += flat_results(merged(drawn), marks, rules, most)
    else:
        layout = plate_layout(plate)
        index = layout.find_layer(layer_info(CLEAR))
        polygons = drawn_polygons(layout, [index])
        results += flat_results(merged(region(layout, CLEAR)), polygons, rules, most)
    names = plate_names(plate)
    results += checked_names([names.top, *names.dies, *names.marks, *names.units.values()], rules)
    if rules.max_references is not None:
        references = sum(_references(die) + 1 for die in plate.dies) + len(plate.furniture)
        results.append(counted_references(references, rules.max_references))
    if rules.extent_nm is not None:
        results.append(checked_extent([*_clear_boxes(plate), *map(_box, marks)], rules.extent_nm))
    return tuple(results)


def dies_apart(plate: Plate, reach_nm: int) -> bool:
    """Whether no die comes within reach of another, or of a mark."""
    marks = _written_marks(plate)
    dies = np.array([die.box_nm for die in plate.dies], dtype=np.int64).reshape(-1, 4)
    every = np.concatenate([dies, np.array([_box(mark) for mark in marks], dtype=np.int64).reshape(-1, 4)])
    low = np.maximum(dies[:, None, :2], every[None, :, :2])
    high = np.minimum(dies[:, None, 2:], every[None, :, 2:])
    near = ((low - high) <= reach_nm).all(axis=2)
    near[np.arange(len(dies)), np.arange(len(dies))] = False
    return not near.any()


def _written_marks(plate: Plate) -> list[Polygon]:
    return [polygon for mark in plate.furniture if mark.layer.written for polygon in mark.polygons]


def _references(die: Die) -> int:
    return 1 if len(np.unique(die.panel.orientations)) == 1 else die.panel.orientations.size


def _clear_boxes(plate: Plate) -> Iterator[Box]:
    """Hull of what is clear in each die."""
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


def _box(polygon: Polygon) -> Box:
    xs, ys = zip(*polygon, strict=True)
    return min(xs), min(ys), max(xs), max(ys)
