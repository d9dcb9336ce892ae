"""The rules on a panel, by its distinct parts and neighbourhoods; the work hardly grows with the panel.

Its narrowest places are exact, corner to corner included, and not hidden by corners that kiss.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal, TypeAlias

import numpy as np
from klayout import db

from maskfab.base.arrays import Ints
from maskfab.drc.canvas import facing_edges
from maskfab.drc.cells import PanelCells
from maskfab.drc.flat import LARGEST, drawn_rules, merged, off_grid
from maskfab.drc.islands import islands, small_islands
from maskfab.drc.neighbours import fits_windows, kissing_corners, narrow_spaces
from maskfab.drc.raster_rules import smallest_runs
from maskfab.drc.results import Found, Repeated, RuleResult, listed
from maskfab.drc.rules import Check, DesignRules, distance_checks
from maskfab.drc.within_polygon import within_polygons
from maskfab.geometry.die_grid import die_edges_nm, die_raster
from maskfab.geometry.unit_cell import unit_shapes
from maskfab.model import CLEAR, Box, Die, Polygon

Tone: TypeAlias = Literal["clear", "opaque"]


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


@dataclass(frozen=True)
class Narrowest:
    """A width of what is clear, or a space between clear edges.

    Attributes:
        value_nm: Euclidian distance; inf where nothing faces anything.
        place: hull of the two edges, in plate nanometres; None where it was not asked for, or there is none.
    """

    value_nm: float
    place: Box | None = None


def narrowest(die: Die, tone: Tone, *, placed: bool = False) -> Narrowest:
    """The least clear width, or the least opaque space, of a die.

    Distances are those of :class:`DesignRules` with ``kissing=False``. The shortest run along x or y is one of them,
    so only what is less than it has to be looked for, and nothing that is no kiss is less than a dot or a gutter.

    Args:
        die: the die, alone.
        tone: "clear" for widths, "opaque" for spaces.
        placed: whether the place is asked for, too.
    """
    runs = smallest_runs(die_raster(die), *die_edges_nm(die))
    run = runs.clear if tone == "clear" else runs.opaque
    panel = die.panel
    if run <= min(panel.dot_nm, panel.gutter_nm or panel.dot_nm) and not placed:
        return Narrowest(run)
    # Where no row and no column has a run there are few edges, however far one looks.
    reach = run if math.isfinite(run) else math.hypot(*panel.size_nm)
    found = _below(die, tone, math.ceil(reach) + int(placed))
    if found.place is None or found.value_nm >= run:
        return Narrowest(run, found.place)
    return found if placed else Narrowest(found.value_nm)


def _below(die: Die, tone: Tone, limit_nm: int) -> Narrowest:
    """The narrowest place that breaks a limit, the first of its kind."""
    width, space = (limit_nm, None) if tone == "clear" else (None, limit_nm)
    results = panel_results(die, DesignRules(min_width_nm=width, min_space_nm=space, kissing=False), 1)
    (result,) = (each for each in results if each.rule == ("width" if tone == "clear" else "space"))
    if result.passed or not isinstance(result.value, int | float):
        return Narrowest(math.inf)
    return Narrowest(float(result.value), result.places[0])
