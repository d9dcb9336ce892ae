"""Design rules on a panel, by its distinct parts and neighbourhoods: the work hardly grows with the panel.

Cells are rasters. Connected areas of one tone, which rules within one polygon look at, are joined from cell to cell
without ever drawing the panel; spaces and corners that kiss are looked for once in every distinct neighbourhood. The
narrowest places are exact, corner to corner included, and not hidden by corners that kiss.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Literal, TypeAlias

import numpy as np
import scipy
from klayout import db

from maskfab.base.arrays import Floats, Ints, Mask
from maskfab.base.model import CLEAR, Box, Die, Panel, Polygon
from maskfab.mask.design_rules import (
    LARGEST,
    Canvas,
    Check,
    DesignRules,
    Facing,
    Found,
    Repeated,
    RuleResult,
    distance_checks,
    drawn_rules,
    expanded,
    facing_edges,
    joined,
    listed,
    merged,
    off_grid,
    together,
)
from maskfab.mask.dots import die_edges_nm, die_raster, kissing, smallest_runs
from maskfab.mask.outlines import unit_shapes


@dataclass(frozen=True, eq=False)
class PanelCells:
    """Contents of a panel's cells: distinct orientations, ascending, and int64 [rows, columns] codes into them."""

    panel: Panel
    held: tuple[int, ...]
    codes: Ints

    @classmethod
    def of(cls, panel: Panel) -> PanelCells:
        """The cells of a panel."""
        held, codes = np.unique(panel.orientations, return_inverse=True)
        return cls(panel, tuple(held.tolist()), codes.reshape(panel.orientations.shape).astype(np.int64))

    @cached_property
    def clear(self) -> Mask:
        """bool [held, n, n]: the dots of each, with a ring of gutter round them where the panel has one."""
        ring = int(self.panel.gutter_nm > 0)
        return np.stack([np.pad(self.panel.pattern(cell), ring) for cell in self.held])

    @cached_property
    def edges_nm(self) -> Ints:
        """int64 [n + 1], where the rows and columns of ``clear`` end."""
        return self.panel.cell_size.edges_nm

    @cached_property
    def origins_nm(self) -> Ints:
        """int64 [rows * columns, 2], lower left corners from the panel's."""
        rows, columns = np.indices(self.codes.shape).reshape(2, -1)
        return np.stack([columns, rows], axis=1) * self.panel.pitch_nm

    @cached_property
    def wholes(self) -> list[db.Region]:
        """The clear dots of each, from the cell's corner; one box for each run."""
        return [self.regions(np.where(raster, 0, -1)).get(0, db.Region()) for raster in self.clear]

    def regions(self, labels: Ints) -> dict[int, db.Region]:
        """Regions by label of one cell's raster, int64 [n, n], from the cell's corner; -1 is left out."""
        edges = self.edges_nm.tolist()
        regions: dict[int, db.Region] = {}
        n = labels.shape[1]
        steps = labels[:, 1:] != labels[:, :-1]
        ones = np.ones((len(labels), 1), dtype=np.bool_)
        rows, starts = np.nonzero(np.concatenate([ones, steps], axis=1))
        stops = np.append(starts[1:], 0)
        stops[stops == 0] = n
        every = zip(labels[rows, starts].tolist(), rows.tolist(), starts.tolist(), stops.tolist(), strict=True)
        for name, y, left, right in every:
            if name >= 0:
                box = db.Box(edges[left], edges[y], edges[right], edges[y + 1])
                regions.setdefault(name, db.Region()).insert(box)
        return regions


@dataclass(frozen=True, eq=False)
class Parts:
    """The connected parts of every distinct cell, numbered through.

    Attributes:
        labels: int64 [held, n, n], part of each dot; -1 where the tone is the other.
        owners: int64 [parts], the cell that has it.
        areas_nm2: float64 [parts].
        boxes_nm: int64 [parts, 4], from the cell's corner.
        inner: bool [parts], whether it stays clear of the cell's border.
    """

    labels: Ints
    owners: Ints
    areas_nm2: Floats
    boxes_nm: Ints
    inner: Mask


@dataclass(frozen=True, eq=False)
class Islands:
    """Connected areas that reach from cell to cell, and those that do not.

    Attributes:
        cells: int64 [nodes], the cell (row-major) of every part that meets its cell's border, panel-wide.
        nodes: int64 [nodes], that part.
        islands: int64 [nodes], the island it belongs to.
        outside: the island that is the surroundings of the panel.
    """

    parts: Parts
    cells: Ints
    nodes: Ints
    islands: Ints
    outside: int

    @cached_property
    def alone(self) -> Mask:
        """bool [nodes], whether a part is an island by itself."""
        alone: Mask = (self._sizes[self.islands] == 1) & (self.islands != self.outside)
        return alone

    @cached_property
    def joined(self) -> tuple[Ints, Ints]:
        """Indices of the parts of islands of several, island by island and by cell in each, and where each begins."""
        many = np.flatnonzero((self._sizes[self.islands] > 1) & (self.islands != self.outside))
        order = many[np.argsort(self.islands[many], kind="stable")]
        numbers = self.islands[order]
        return order, np.flatnonzero(np.diff(numbers, prepend=-1))

    @cached_property
    def _sizes(self) -> Ints:
        return np.bincount(self.islands)


def parts(cells: PanelCells, *, clear: bool) -> Parts:
    """Parts joined along sides; corners that kiss stay apart."""
    rasters = cells.clear if clear else ~cells.clear
    edges, widths = cells.edges_nm, np.diff(cells.edges_nm).astype(np.float64)
    labels = np.full(rasters.shape, -1, dtype=np.int64)
    owners: list[int] = []
    boxes: list[list[int]] = []
    areas: list[Floats] = []
    for code, raster in enumerate(rasters):
        numbered, count = scipy.ndimage.label(raster)
        labels[code][raster] = numbered[raster] - 1 + len(owners)
        owners += [code] * count
        dots_nm2 = np.outer(widths, widths).ravel()
        sums = np.bincount(numbered.ravel(), weights=dots_nm2, minlength=count + 1)
        areas.append(sums[1:].astype(np.float64))
        for ys, xs in scipy.ndimage.find_objects(numbered):
            boxes.append([int(edges[k]) for k in (xs.start, ys.start, xs.stop, ys.stop)])
    inner = np.ones(len(owners), dtype=np.bool_)
    for side in (labels[:, 0], labels[:, -1], labels[:, :, 0], labels[:, :, -1]):
        inner[side[side >= 0]] = False
    return Parts(
        labels,
        np.array(owners, dtype=np.int64),
        np.concatenate([np.zeros(0), *areas]),
        np.array(boxes, dtype=np.int64).reshape(-1, 4),
        inner,
    )


def islands(cells: PanelCells, *, clear: bool) -> Islands:
    """The islands of one tone; the panel lies in chrome."""
    labels = parts(cells, clear=clear)
    codes, (rows, columns) = cells.codes, cells.codes.shape
    outer = np.flatnonzero(~labels.inner)
    # Parts are numbered cell by cell, so those of one cell that meet its border are consecutive among all such.
    rank = np.cumsum(~labels.inner) - 1
    many = np.bincount(labels.owners[outer], minlength=len(cells.held))
    first_of_code = np.cumsum(many) - many
    lengths = many[codes.ravel()]
    base = np.cumsum(lengths) - lengths
    node_cells = np.repeat(np.arange(codes.size), lengths)
    nodes = outer[expanded(first_of_code[codes.ravel()], lengths)]
    local = rank - first_of_code[labels.owners]
    index = np.arange(codes.size).reshape(rows, columns)
    ends = [np.zeros((2, 0), dtype=np.int64)]
    for low, high, last, start in (
        (index[:, :-1], index[:, 1:], labels.labels[:, :, -1], labels.labels[:, :, 0]),
        (index[:-1], index[1:], labels.labels[:, -1], labels.labels[:, 0]),
    ):
        ends.append(_joints(codes.ravel(), low.ravel(), high.ravel(), last, start, local, base))
    outside = len(nodes)
    if not clear:
        for border, side in (
            (index[:, 0], labels.labels[:, :, 0]),
            (index[:, -1], labels.labels[:, :, -1]),
            (index[0], labels.labels[:, 0]),
            (index[-1], labels.labels[:, -1]),
        ):
            touching = side[codes.ravel()[border]]
            met = touching >= 0
            here = np.broadcast_to(base[border][:, None], touching.shape)[met] + local[touching[met]]
            ends.append(np.stack([here, np.full_like(here, outside)]))
    one, two = np.concatenate(ends, axis=1)
    graph = scipy.sparse.coo_array((np.ones(one.size, dtype=np.int8), (one, two)), shape=(outside + 1, outside + 1))
    _, belongs = scipy.sparse.csgraph.connected_components(graph, directed=False)
    return Islands(labels, node_cells, nodes, belongs[:-1].astype(np.int64), int(belongs[-1]))


def _joints(codes: Ints, low: Ints, high: Ints, last: Ints, start: Ints, local: Ints, base: Ints) -> Ints:
    """int64 [2, joints]: nodes that meet across the border of neighbouring cells, found once for each pair of codes."""
    kinds = int(codes.max()) + 1
    pairs, which = np.unique(codes[low] * kinds + codes[high], return_inverse=True)
    lefts, rights, many = [], [], []
    for pair in pairs.tolist():
        a, b = last[pair // kinds], start[pair % kinds]
        both = (a >= 0) & (b >= 0)
        met = np.unique(np.stack([local[a[both]], local[b[both]]]), axis=1)
        lefts.append(met[0])
        rights.append(met[1])
        many.append(met.shape[1])
    if not many:
        return np.zeros((2, 0), dtype=np.int64)
    lengths = np.array(many, dtype=np.int64)
    where = expanded((np.cumsum(lengths) - lengths)[which], lengths[which])
    times = lengths[which]
    one = np.repeat(base[low], times) + np.concatenate(lefts)[where]
    two = np.repeat(base[high], times) + np.concatenate(rights)[where]
    return np.stack([one, two])


def small_islands(cells: PanelCells, islands: Islands, limit_nm2: int, most: int) -> Found:
    """Islands of less than an area; the panel's surroundings are none."""
    parts = islands.parts
    small = np.flatnonzero(parts.inner & (parts.areas_nm2 < limit_nm2))
    inner = Repeated(
        cells.codes.ravel(), cells.origins_nm, parts.owners[small], parts.boxes_nm[small], parts.areas_nm2[small]
    )
    small = np.flatnonzero(~parts.inner & (parts.areas_nm2 < limit_nm2))
    alone = Repeated(
        islands.nodes[islands.alone],
        cells.origins_nm[islands.cells[islands.alone]],
        small,
        parts.boxes_nm[small],
        parts.areas_nm2[small],
    )
    order, starts = islands.joined
    if not order.size:
        return joined([inner.found(most), alone.found(most)], most)
    nodes = islands.nodes[order]
    # Sums of whole numbers stay exact in float64 up to 9e15 nm², a square of 95 mm.
    areas = np.add.reduceat(parts.areas_nm2[nodes], starts)
    boxes = parts.boxes_nm[nodes] + np.tile(cells.origins_nm[islands.cells[order]], 2)
    low, high = np.minimum.reduceat(boxes[:, :2], starts), np.maximum.reduceat(boxes[:, 2:], starts)
    below = areas < limit_nm2
    across = listed(np.concatenate([low, high], axis=1)[below], areas[below], most)
    return joined([inner.found(most), alone.found(most), across], most)


@dataclass(frozen=True, eq=False)
class Windows:
    """Neighbourhoods of one shape.

    Attributes:
        codes: int64 [n, cells], what the distinct ones hold, row by row from the lowest; -1 lies beyond the panel.
        offsets_nm: int64 [cells, 2], lower left corners of the cells from the neighbourhood's origin, which is the
            corner (or side's lower or left end) that its last cell begins at.
        items: int64 [m], which of them every occurrence is.
        origins_nm: int64 [m, 2], where, from the panel's lower left corner.
    """

    codes: Ints
    offsets_nm: Ints
    items: Ints
    origins_nm: Ints


def windows(cells: PanelCells, across: int, up: int) -> Windows:
    """Neighbourhoods of ``across`` x ``up`` cells, each 1 or 2, those that hang over the panel's rim included."""
    pitch, kinds = cells.panel.pitch_nm, len(cells.held) + 1
    padded = np.pad(cells.codes, ((up - 1, up - 1), (across - 1, across - 1)), constant_values=-1)
    rows, columns = padded.shape[0] - up + 1, padded.shape[1] - across + 1
    views = [padded[y : y + rows, x : x + columns].ravel() for y in range(up) for x in range(across)]
    key = np.zeros(rows * columns, dtype=np.int64)
    for view in views:
        key = key * kinds + view + 1
    distinct, items = np.unique(key, return_inverse=True)
    codes = np.stack([distinct // kinds**power % kinds - 1 for power in range(len(views) - 1, -1, -1)], axis=1)
    offsets = [((x - across + 1) * pitch, (y - up + 1) * pitch) for y in range(up) for x in range(across)]
    row, column = np.indices((rows, columns)).reshape(2, -1)
    return Windows(codes, np.array(offsets, dtype=np.int64), items, np.stack([column, row], axis=1) * pitch)


def narrow_spaces(cells: PanelCells, limit_nm: int, check: Check, most: int) -> Found:
    """Pairs of clear edges with less chrome between them than a limit, of one polygon or of two.

    Where edges face each other depends on what lies within the limit of that place. A pair belongs to the
    neighbourhood round its lowest endpoint: to a cell, if that lies deep enough in it; else to the cells on both sides
    of a border, or round a corner. Each neighbourhood is drawn so much larger that its own clipped sides do not
    matter. A limit may be as wide as the gutter, or such that twice of it and two nanometres fit the pitch.
    """
    pitch, margin = cells.panel.pitch_nm, limit_nm + 1
    if limit_nm <= cells.panel.gutter_nm:
        return _found(cells, windows(cells, 1, 1), (0, 0, pitch, pitch), limit_nm, check, 0, most)
    inner = (margin, pitch - margin)
    parts = []
    for across, up in ((1, 1), (2, 1), (1, 2), (2, 2)):
        x = inner if across == 1 else (-margin, margin)
        y = inner if up == 1 else (-margin, margin)
        core = (x[0], y[0], x[1], y[1])
        parts.append(_found(cells, windows(cells, across, up), core, limit_nm, check, margin, most))
    return joined(parts, most)


def _found(cells: PanelCells, seen: Windows, core: Box, limit_nm: int, check: Check, margin: int, most: int) -> Found:
    x0, y0, x1, y1 = core
    clip = db.Box(x0 - margin, y0 - margin, x1 + margin, y1 + margin)
    canvas = Canvas(cells.panel.pitch_nm, limit_nm)
    offsets = seen.offsets_nm.tolist()
    pieces = [[canvas.piece(whole & db.Region(clip.moved(-x, -y))) for whole in cells.wholes] for x, y in offsets]
    drawings = [
        [(chosen[code], x, y) for code, (x, y), chosen in zip(codes, offsets, pieces, strict=True) if code >= 0]
        for codes in seen.codes.tolist()
    ]
    (facing,) = canvas.check(drawings, [check])
    x, y = facing.points.T
    facing = facing.chosen((x >= x0) & (x < x1) & (y >= y0) & (y < y1))
    repeated = Repeated(seen.items, seen.origins_nm, facing.items, facing.boxes_nm, facing.values)
    return repeated.found(most)


def kissing_corners(cells: PanelCells, most: int) -> Found:
    """Vertices at which exactly two of the four dots are clear, and these lie on a diagonal; neighbours included."""
    clear, edges = cells.clear, cells.edges_nm
    held = np.pad(clear, ((1, 0), (0, 0), (0, 0)))
    parts = []
    within = windows(cells, 1, 1)
    n, y, x = np.nonzero(kissing(clear[:, :-1, :-1], clear[:, :-1, 1:], clear[:, 1:, :-1], clear[:, 1:, 1:]))
    order = np.argsort(within.codes[:, 0])
    parts.append(_repeated(within, order[n], edges[x + 1], edges[y + 1]))
    beside = windows(cells, 2, 1)
    left, right = held[beside.codes[:, 0] + 1, :, -1], held[beside.codes[:, 1] + 1, :, 0]
    n, y = np.nonzero(kissing(left[:, :-1], right[:, :-1], left[:, 1:], right[:, 1:]))
    parts.append(_repeated(beside, n, np.zeros_like(y), edges[y + 1]))
    above = windows(cells, 1, 2)
    low, high = held[above.codes[:, 0] + 1, -1], held[above.codes[:, 1] + 1, 0]
    n, x = np.nonzero(kissing(low[:, :-1], low[:, 1:], high[:, :-1], high[:, 1:]))
    parts.append(_repeated(above, n, edges[x + 1], np.zeros_like(x)))
    fours = windows(cells, 2, 2)
    codes = fours.codes.T + 1
    corner = kissing(held[codes[0], -1, -1], held[codes[1], -1, 0], held[codes[2], 0, -1], held[codes[3], 0, 0])
    (n,) = np.nonzero(corner)
    parts.append(_repeated(fours, n, np.zeros_like(n), np.zeros_like(n)))
    return joined([part.found(most) for part in parts], most)


def _repeated(seen: Windows, owners: Ints, x: Ints, y: Ints) -> Repeated:
    return Repeated(seen.items, seen.origins_nm, owners, np.stack([x, y, x, y], axis=1), np.zeros(len(owners)))


Drawing = list[tuple[int, int, int]]


def within_polygons(
    cells: PanelCells, islands: Islands, checks: Sequence[Check], reach_nm: int, most: int
) -> tuple[Found, ...]:
    """Violations of rules that look at one clear polygon at a time, one result for each check.

    Polygons that reach over several cells are told apart by the parts they are composed of; those of one composition
    are checked once. The work grows with the number of compositions, so with the panel only where clear shapes
    percolate through it.

    Args:
        reach_nm: no check looks further.
    """
    parts = islands.parts
    singles = _checked(cells, parts, [[(part, 0, 0)] for part in range(len(parts.owners))], checks, reach_nm)
    compositions, items, homes = _compositions(cells, islands)
    several = _checked(cells, parts, compositions, checks, reach_nm)
    alone = islands.nodes[islands.alone], cells.origins_nm[islands.cells[islands.alone]]
    results = []
    for single, composed in zip(singles, several, strict=True):
        inside = parts.inner[single.items]
        own, rim = single.chosen(inside), single.chosen(~inside)
        repeats = [
            Repeated(cells.codes.ravel(), cells.origins_nm, parts.owners[own.items], own.boxes_nm, own.values),
            Repeated(*alone, rim.items, rim.boxes_nm, rim.values),
            Repeated(items, cells.origins_nm[homes], composed.items, composed.boxes_nm, composed.values),
        ]
        results.append(joined([facing.found(most) for facing in repeats], most))
    return tuple(results)


def _compositions(cells: PanelCells, islands: Islands) -> tuple[list[Drawing], Ints, Ints]:
    """Distinct polygons of several parts, placed from their first cell; which of them occur, and in which cell."""
    drawings: list[Drawing] = []
    items, homes = [np.zeros(0, dtype=np.int64)], [np.zeros(0, dtype=np.int64)]
    order, starts = islands.joined
    nodes, cell = islands.nodes[order], islands.cells[order]
    columns = cells.codes.shape[1]
    sizes = np.diff(np.append(starts, order.size))
    # A part beside the first is known by its number and its step to there, in one integer.
    reach, pitch = 2 * columns, cells.panel.pitch_nm
    kinds = len(islands.parts.owners)
    for size in np.unique(sizes).tolist():
        members = starts[sizes == size][:, None] + np.arange(size)
        first = cell[members[:, 0]]
        up = cell[members] // columns - (first // columns)[:, None]
        across = cell[members] % columns - (first % columns)[:, None] + columns
        distinct, which = _distinct((up * reach + across) * kinds + nodes[members])
        items.append(which + len(drawings))
        homes.append(first)
        for row in distinct.tolist():
            places = [divmod(key, kinds) for key in row]
            drawings.append([(p, (at % reach - columns) * pitch, at // reach * pitch) for at, p in places])
    return drawings, np.concatenate(items), np.concatenate(homes)


def _distinct(rows: Ints) -> tuple[Ints, Ints]:
    span = int(rows.max()) + 1
    packed = rows
    if rows.shape[1] * np.log2(span) < 62:
        packed = rows @ (span ** np.arange(rows.shape[1], dtype=np.int64))[:, None]
    # Rows that are compared as bytes sort several times faster than rows of numbers.
    whole = np.ascontiguousarray(packed).view(np.dtype((np.void, packed[0].nbytes))).ravel()
    _, chosen, which = np.unique(
        packed[:, 0] if packed.shape[1] == 1 else whole, return_index=True, return_inverse=True
    )
    return rows[chosen], which


def _checked(
    cells: PanelCells, parts: Parts, drawings: list[Drawing], checks: Sequence[Check], reach_nm: int
) -> list[Facing]:
    sizes = np.array([max(max(abs(x), abs(y)) for _, x, y in drawing) for drawing in drawings], dtype=np.int64)
    # Drawings of one size share a sheet: the largest decides how far apart they lie.
    classes = np.ceil(np.log2(sizes + cells.panel.pitch_nm)).astype(np.int64)
    violations: list[list[Facing]] = [[] for _ in checks]
    regions = {part: region for labels in parts.labels for part, region in cells.regions(labels).items()}
    for size in np.unique(classes).tolist():
        members = np.flatnonzero(classes == size)
        canvas = Canvas(2**size, reach_nm)
        used = {part for member in members.tolist() for part, _, _ in drawings[member]}
        pieces = {part: canvas.piece(regions[part]) for part in sorted(used)}
        sheet = [[(pieces[part], x, y) for part, x, y in drawings[member]] for member in members.tolist()]
        for facings, facing in zip(violations, canvas.check(sheet, checks), strict=True):
            facings.append(Facing(members[facing.items], facing.points, facing.boxes_nm, facing.values))
    return [together(facings) for facings in violations]


Tone: TypeAlias = Literal["clear", "opaque"]


def panel_results(die: Die, rules: DesignRules, most: int) -> tuple[RuleResult, ...]:
    """Every rule on the geometry of one die, no other within reach; places of the plate, counts of the panel."""
    cells = PanelCells.of(die.panel)
    results: list[tuple[str, int, str, Found]] = []
    checks = distance_checks(rules)
    space = checks.pop("space", None)
    results += _on_islands(cells, rules, checks, most)
    if space is not None:
        results.append(("space", space[0], "nm", _spaces(cells, *space, most)))
    if rules.no_corner_touch:
        results.append(("corner_touch", 0, "nm", kissing_corners(cells, most)))
    shapes = [unit_shapes(die.panel, cell).get(CLEAR, ()) for cell in cells.held]
    for name, limit, unit, rule in drawn_rules(rules):
        if name == "grid":
            results.append((name, limit, unit, _off_grid(cells, shapes, limit, die.origin_nm, most)))
            continue
        parts = [rule(polygons) for polygons in shapes]
        owners = np.repeat(np.arange(len(parts)), [len(boxes) for boxes, _ in parts])
        boxes = np.concatenate([boxes for boxes, _ in parts])
        values = np.concatenate([values for _, values in parts])
        repeated = Repeated(cells.codes.ravel(), cells.origins_nm, owners, boxes, values)
        results.append((name, limit, unit, repeated.found(most, largest=name in LARGEST)))
    order = ("width", "space", "notch", "area", "chrome_area", "corner_touch")
    results.sort(key=lambda row: order.index(row[0]) if row[0] in order else len(order))
    return tuple(result.result(name, limit, unit, die.name, die.origin_nm) for name, limit, unit, result in results)


def _on_islands(
    cells: PanelCells, rules: DesignRules, checks: dict[str, tuple[int, Check]], most: int
) -> list[tuple[str, int, str, Found]]:
    """The rules within one polygon: those of ``checks``, and the one on areas."""
    violations: list[tuple[str, int, str, Found]] = []
    if not checks and rules.min_area_nm2 is None:
        return violations
    clear = islands(cells, clear=True)
    if checks:
        results = within_polygons(cells, clear, [check for _, check in checks.values()], rules.reach_nm, most)
        violations += [
            (name, limit, "nm", result) for (name, (limit, _)), result in zip(checks.items(), results, strict=True)
        ]
    if rules.min_area_nm2 is not None:
        limit = rules.min_area_nm2
        violations.append(("area", limit, "nm2", small_islands(cells, clear, limit, most)))
        chrome = islands(cells, clear=False)
        violations.append(("chrome_area", limit, "nm2", small_islands(cells, chrome, limit, most)))
    return violations


def _spaces(cells: PanelCells, limit_nm: int, check: Check, most: int) -> Found:
    # Short enough for its neighbourhoods to be at most two cells wide.
    if limit_nm <= cells.panel.gutter_nm or 2 * (limit_nm + 1) <= cells.panel.pitch_nm:
        return narrow_spaces(cells, limit_nm, check, most)
    whole = db.Region()
    for code, (x, y) in zip(cells.codes.ravel().tolist(), cells.origins_nm.tolist(), strict=True):
        whole.insert(cells.wholes[code].moved(x, y))
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
    for item, composition in enumerate(distinct.tolist()):
        code, x, y = composition // grid_nm**2, composition // grid_nm % grid_nm, composition % grid_nm
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
        placed: whether the place is asked for, too.
    """
    runs = smallest_runs(die_raster(die), *die_edges_nm(die))
    run = runs.clear if tone == "clear" else runs.opaque
    panel = die.panel
    if run <= min(panel.dot_nm, panel.gutter_nm or panel.dot_nm) and not placed:
        return Narrowest(run)
    # Where no row and no column has a run there are few edges, however far one looks.
    reach = run if math.isfinite(run) else math.hypot(*panel.size_nm)
    results = _below(die, tone, math.ceil(reach) + int(placed))
    if results.place is None or results.value_nm >= run:
        return Narrowest(run, results.place)
    return results if placed else Narrowest(results.value_nm)


def _below(die: Die, tone: Tone, limit_nm: int) -> Narrowest:
    """The narrowest place that breaks a limit, the first of its kind."""
    width, space = (limit_nm, None) if tone == "clear" else (None, limit_nm)
    results = panel_results(die, DesignRules(min_width_nm=width, min_space_nm=space, kissing=False), 1)
    (result,) = (judged for judged in results if judged.rule == ("width" if tone == "clear" else "space"))
    if result.passed or not isinstance(result.value, int | float):
        return Narrowest(math.inf)
    return Narrowest(float(result.value), result.places[0])
