"""The rules on a panel, by its distinct parts and neighbourhoods; the work hardly grows with the panel."""

from __future__ import annotations

import numpy as np
from klayout import db

from maskfab.drc.areas import small_islands
from maskfab.drc.canvas import facing_edges
from maskfab.drc.cells import PanelCells
from maskfab.drc.drawn_polygons import off_grid
from maskfab.drc.flat import LARGEST, drawn_rules, merged
from maskfab.drc.islands import islands
from maskfab.drc.klayout_checks import Check, distance_checks
from maskfab.drc.results import Found, Ints, Repeated, RuleResult, listed
from maskfab.drc.rules import DesignRules
from maskfab.drc.spaces import fits_windows, narrow_spaces
from maskfab.drc.touches import kissing_corners
from maskfab.drc.within_polygon import within_polygons
from maskfab.geometry.unit_cell import unit_shapes
from maskfab.model import CLEAR, Die, Polygon


def panel_results(die: Die, rules: DesignRules, most: int) -> tuple[RuleResult, ...]:
    """Every rule on the geometry of one die; nothing else lies within the rules' reach of it.

    Places are those of the plate, counts those of the whole panel.
    """
    cells = PanelCells.of(die.panel)
    found: list[tuple[str, int, str, Found]] = []
    checks = distance_checks(rules)
    space = checks.pop("space", None)
    found += _on_islands(cells, rules, checks, most)
    if space is not None:
        found.append(("space", space[0], "nm", _spaces(cells, *space, most)))
    if rules.no_corner_touch:
        found.append(("corner_touch", 0, "nm", kissing_corners(cells, most)))
    shapes = [unit_shapes(die.panel, each).get(CLEAR, ()) for each in cells.held]
    for name, limit, unit, rule in drawn_rules(rules):
        if name == "grid":
            found.append((name, limit, unit, _off_grid(cells, shapes, limit, die.origin_nm, most)))
            continue
        parts = [rule(polygons) for polygons in shapes]
        owners = np.repeat(np.arange(len(parts)), [len(boxes) for boxes, _ in parts])
        boxes = np.concatenate([boxes for boxes, _ in parts])
        values = np.concatenate([values for _, values in parts])
        repeated = Repeated(cells.codes.ravel(), cells.origins_nm, owners, boxes, values)
        found.append((name, limit, unit, repeated.found(most, largest=name in LARGEST)))
    order = ("width", "space", "notch", "area", "chrome_area", "corner_touch")
    found.sort(key=lambda each: order.index(each[0]) if each[0] in order else len(order))
    return tuple(each.result(name, limit, unit, die.name, die.origin_nm) for name, limit, unit, each in found)


def _on_islands(
    cells: PanelCells, rules: DesignRules, checks: dict[str, tuple[int, Check]], most: int
) -> list[tuple[str, int, str, Found]]:
    """The rules within one polygon: those of ``checks``, and the one on areas."""
    found: list[tuple[str, int, str, Found]] = []
    if not checks and rules.min_area_nm2 is None:
        return found
    clear = islands(cells, clear=True)
    if checks:
        results = within_polygons(cells, clear, [check for _, check in checks.values()], rules.reach_nm, most)
        found += [(name, limit, "nm", each) for (name, (limit, _)), each in zip(checks.items(), results, strict=True)]
    if rules.min_area_nm2 is not None:
        limit = rules.min_area_nm2
        found.append(("area", limit, "nm2", small_islands(cells, clear, limit, most)))
        chrome = islands(cells, clear=False)
        found.append(("chrome_area", limit, "nm2", small_islands(cells, chrome, limit, most)))
    return found


def _spaces(cells: PanelCells, limit_nm: int, check: Check, most: int) -> Found:
    if fits_windows(cells, limit_nm):
        return narrow_spaces(cells, limit_nm, check, most)
    units, whole = [cells.region(raster) for raster in cells.clear], db.Region()
    for code, (x, y) in zip(cells.codes.ravel().tolist(), cells.origins_nm.tolist(), strict=True):
        whole.insert(units[code].moved(x, y))
    facing = facing_edges(check(merged(whole)))
    return listed(facing.boxes_nm, facing.values, most)


def _off_grid(
    cells: PanelCells, shapes: list[tuple[Polygon, ...]], grid_nm: int, origin_nm: tuple[int, int], most: int
) -> Found:
    """Vertices off the grid, looked for once in every cell at every place that it takes on the grid."""
    rest = (cells.origins_nm + np.asarray(origin_nm)) % grid_nm
    key = (cells.codes.ravel() * grid_nm + rest[:, 0]) * grid_nm + rest[:, 1]
    distinct, items = np.unique(key, return_inverse=True)
    owners, boxes, values = [], [], []
    for item, each in enumerate(distinct.tolist()):
        code, x, y = each // grid_nm**2, each // grid_nm % grid_nm, each % grid_nm
        box, off = off_grid(shapes[code], grid_nm, (x, y))
        owners.append(np.full(len(off), item))
        boxes.append(box)
        values.append(off)
    every: Ints = np.concatenate(owners)
    repeated = Repeated(items, cells.origins_nm, every, np.concatenate(boxes), np.concatenate(values))
    return repeated.found(most, largest=True)
