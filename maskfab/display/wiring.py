"""Wiring of a panel's pixels: lines in gutters, through closed area and across it, or a proof that there is none.

Wires are polygons: straight ones in the gutters, crooked ones through closed area, transparent ones across. Everything
along x lies on the lower metal and everything along y on the upper, in every orientation, so pixels meet without vias.
Each emitter also needs a path to a gutter through closed dots.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy
from klayout import db

from maskfab.base.arrays import Indices, Ints, Mask
from maskfab.base.errors import JobError
from maskfab.base.model import COLOURS, ORIENTATIONS, Emitters, Opening, Panel, Polygon, Track
from maskfab.base.units import NM_PER_UM
from maskfab.display.emitter_rules import Certificate, Proof, Verdict
from maskfab.display.kept_layouts import origin_of, shipped
from maskfab.display.panel_lines import AXES, Axis, PanelLines, in_their_pixels, panel_cut, panel_lines
from maskfab.display.pixel_lines import (
    DIRECTIONS,
    Direction,
    Net,
    RoutingGrid,
    WireRules,
    lines_per_layer,
    ports,
    routing_grids,
)
from maskfab.display.polygon_check import Violation, line_violations


@dataclass(frozen=True, eq=False)
class Reach:
    """The way from one connected emitter to a gutter.

    Attributes:
        colour: 1 to 3 for red, green and blue.
        path: intp [k, 2] row and column of the dots from the emitter to the pixel's side; None if there is no way.
        certificate: the island that the emitter lies on, if there is no way.
    """

    colour: int
    path: Indices | None
    certificate: Certificate | None


def reaches(closed: Mask, emitters: Emitters) -> tuple[Reach, ...]:
    """Shortest way of each connected emitter, by colour, through closed dots (bool [n, n], True) that share sides."""
    per_dot = emitters.labels.shape[0] // closed.shape[0]
    ways = []
    for colour in range(1, len(COLOURS) + 1):
        pieces, count = scipy.ndimage.label(emitters.labels == colour)
        for piece in range(1, count + 1):
            start = np.zeros(closed.shape, dtype=np.bool_)
            rows, columns = np.nonzero(pieces == piece)
            start[rows // per_dot, columns // per_dot] = True
            ways.append(_reach(closed, start & closed, colour, emitters.cell_nm * per_dot))
    return tuple(ways)


def _reach(closed: Mask, start: Mask, colour: int, dot_nm: int) -> Reach:
    n = closed.shape[0]
    before: dict[tuple[int, int], tuple[int, int] | None] = {(int(y), int(x)): None for y, x in np.argwhere(start)}
    queue = list(before)
    for y, x in queue:
        if y in (0, n - 1) or x in (0, n - 1):
            path = [(y, x)]
            while (last := before[path[-1]]) is not None:
                path.append(last)
            return Reach(colour, np.array(path[::-1], dtype=np.intp), None)
        for step in ((y + 1, x), (y - 1, x), (y, x + 1), (y, x - 1)):
            if closed[step] and step not in before:
                before[step] = (y, x)
                queue.append(step)
    island = np.zeros(closed.shape, dtype=np.bool_)
    for place in before:
        island[place] = True
    statement = (
        f"the {COLOURS[colour - 1]} emitter lies on an island of {len(before)} closed dots with openings all round"
    )
    return Reach(colour, None, Certificate(Proof.FLOW, statement, {"dots": float(len(before))}, island, dot_nm))


_AXES: dict[Direction, Axis] = {"vertical": "y", "horizontal": "x"}


def gutter_tracks(pitch_nm: int, gutter_nm: int, count: int, rules: WireRules) -> tuple[Track, ...]:
    """``count`` lines along each axis, centred in the gutters; a pixel draws its half of each gutter."""
    step = rules.line_nm + rules.space_nm
    # Of a gutter centred on the pixel's border at 0, what reaches into this pixel, and into the one before.
    starts = [round((number - (count - 1) / 2) * step - rules.line_nm / 2) for number in range(count)]
    bars = []
    for start in starts:
        for low in (start, start + pitch_nm):
            bounded = max(low, 0), min(low + rules.line_nm, pitch_nm)
            if bounded[0] < bounded[1]:
                bars.append(bounded)
    across = tuple(_box(0, low, pitch_nm, high) for low, high in bars)
    upright = tuple(_box(low, 0, high, pitch_nm) for low, high in bars)
    return (Track("gutter", "x", across, False), Track("gutter", "y", upright, False)) if bars else ()


def transparent_tracks(pitch_nm: int, width_nm: int, transmission: float) -> tuple[Track, Track]:
    """A transparent wire along each axis through the middle of every pixel."""
    low = (pitch_nm - width_nm) // 2
    return (
        Track("transparent", "x", (_box(0, low, pitch_nm, low + width_nm),), False, transmission),
        Track("transparent", "y", (_box(low, 0, low + width_nm, pitch_nm),), False, transmission),
    )


def _line(path: Indices, places_nm: Ints, direction: Direction, pitch_nm: int, width_nm: int) -> Polygon:
    """The outline of a line along nodes (row, column), drawn on to both borders."""
    points = [(int(places_nm[column]), int(places_nm[row])) for row, column in path]
    (x0, y0), (x1, y1) = points[0], points[-1]
    ends = ((x0, 0), (x1, pitch_nm)) if direction == "vertical" else ((0, y0), (pitch_nm, y1))
    whole = [db.Point(*point) for point in (ends[0], *points, ends[1])]
    outline = db.Path(whole, width_nm).simple_polygon()
    return tuple((point.x, point.y) for point in outline.each_point())


def _box(x0: int, y0: int, x1: int, y1: int) -> Polygon:
    return (x0, y0), (x1, y0), (x1, y1), (x0, y1)


@dataclass(frozen=True)
class WireDemand:
    """Wires required by the display maker; ``transparent_nm`` wide along each axis, 0 for none."""

    rules: WireRules
    lines: int
    transparent_nm: int = 0
    transmission: float = 1.0


@dataclass(frozen=True, eq=False)
class Wiring:
    """Wiring of the pixels of a panel.

    Attributes:
        through: opaque lines drawn through closed area of every pixel alike, along x and along y, at ports that all
            orientations share.
        laid: opaque lines laid across the whole panel, along x and along y, one for each that is wanted and not
            transparent in every row and column of pixels; None where every pixel is drawn alike.
        broken: rules that the laid lines break, measured from their polygons.
    """

    wanted: int
    in_gutter: int
    through: tuple[int, int]
    transparent: int
    laid: tuple[PanelLines, PanelLines] | None
    failed: Certificate | None
    tracks: tuple[Track, ...]
    broken: tuple[Violation, ...] = ()

    @property
    def verdict(self) -> Verdict:
        """FITS if all lines are drawn and keep the rules."""
        if min(self.lines) >= self.wanted and not self.broken:
            return Verdict.FITS
        return Verdict.DOES_NOT_FIT if self.failed is not None else Verdict.UNKNOWN

    @property
    def lines(self) -> tuple[int, int]:
        """Lines drawn for every pixel along x and along y."""
        if self.laid is None:
            along_x, along_y = self.through
            return self.in_gutter + along_x + self.transparent, self.in_gutter + along_y + self.transparent
        return self.wanted, self.wanted


def check_wires(panel: Panel, demand: WireDemand) -> None:
    """Refuse wires that no pixel can hold."""
    for name, width_nm in (("line", demand.rules.line_nm), ("transparent", demand.transparent_nm)):
        if width_nm > panel.pitch_nm:
            what = f"{name} = {width_nm / NM_PER_UM:g} um is wider than the {panel.cell_size.pitch_um:g} um of a pixel"
            cure = f"Give a width up to {panel.cell_size.pitch_um:g} um"
            raise JobError("MF120", what, where=f"wires.{name}", cure=cure)


def wiring(panel: Panel, opening: Opening, demand: WireDemand) -> Wiring:
    """Wires of the pixels of a panel.

    First every pixel is drawn alike: gutters are filled, and what they cannot hold runs through closed area. Where
    that is too little, lines are laid across the whole panel as its cells lie, each within a pixel of its own, unless
    a chain of openings proves that they cannot be.
    """
    # Sets of ports that are too few are left out first: of all sets only so many are looked at.
    for whole in (True, False):
        drawn = wired_alike(panel, opening, demand, whole=whole)
        if drawn.verdict is Verdict.FITS:
            return drawn
    transparent = drawn.transparent
    asked = panel, demand.rules, demand.lines - transparent
    laid, cut = _laid(*asked)
    if laid is None:
        return drawn if cut is None else replace(drawn, failed=cut)
    broken = () if laid[0].kept else line_violations(panel, laid, demand.rules)
    crossing = tuple(track for track in drawn.tracks if track.name == "transparent")
    return Wiring(demand.lines, 0, (0, 0), transparent, laid, None, crossing, broken)


def _laid(
    panel: Panel, rules: WireRules, count: int
) -> tuple[tuple[PanelLines, PanelLines] | None, Certificate | None]:
    """Lines across a panel along x and along y; None where not all were found, and a proof if they cannot be."""
    cuts: list[Certificate] = []
    # Lines along y are numbered on from those along x.
    after_x = count * panel.orientations.shape[0]

    def lines(corners: Ints, kept: bool = False) -> tuple[PanelLines, PanelLines]:
        upright = corners[:, 0] >= after_x
        along_y = PanelLines.of_corners("y", corners[upright] - (after_x, 0, 0), kept)
        return PanelLines.of_corners("x", corners[~upright], kept), along_y

    def proved(corners: Ints) -> bool:
        if corners.dtype != np.int64 or corners.ndim != 2 or corners.shape[1] != 3:
            return False
        laid = lines(corners)
        own = all(in_their_pixels(each, panel, rules, count) for each in laid)
        return own and not line_violations(panel, laid, rules)

    def search() -> Ints | None:
        for axis in AXES:
            if (proof := panel_cut(panel, rules, count, axis)) is not None:
                cuts.append(proof)
                return None
        along_x, along_y = (panel_lines(panel, rules, count, axis) for axis in AXES)
        if not along_x.paths or not along_y.paths:
            return None
        return np.concatenate([along_x.corners, along_y.corners + np.array((after_x, 0, 0))])

    given = panel.patterns, panel.orientations, panel.pitch_nm, panel.dot_nm, panel.gutter_nm, rules, count
    corners, kept = shipped().layout(origin_of("lines across a panel", 1, *given), proved, search)
    return (None if corners is None else lines(corners, kept)), next(iter(cuts), None)


def wired_alike(panel: Panel, opening: Opening, demand: WireDemand, *, whole: bool = False) -> Wiring:
    """Wires with which every pixel of a panel is drawn alike, as many as can be, up to those asked for.

    They depend on the opening and on which orientations there are, not on where these lie: an opening whose wires are
    all drawn alike in eight orientations is wired whatever the map.

    Args:
        whole: fewer lines than are asked for are of no use, and are not sought.
    """
    transparent = int(demand.transparent_nm > 0)
    crossing = transparent_tracks(panel.pitch_nm, demand.transparent_nm, demand.transmission) if transparent else ()
    alike = _alike(panel, opening, demand, demand.lines - transparent, whole=whole)
    return replace(alike, transparent=transparent, tracks=(*alike.tracks, *crossing))


def most_lines(panel: Panel, opening: Opening, demand: WireDemand) -> int:
    """Lines that can be drawn for every pixel along each axis, if those asked for can: so many, and not one more."""
    lines = demand.lines
    while wiring(panel, opening, replace(demand, lines=lines + 1)).verdict is Verdict.FITS:
        lines += 1
    return lines


def _alike(panel: Panel, opening: Opening, demand: WireDemand, wanted: int, *, whole: bool) -> Wiring:
    rules = demand.rules
    # Lines of a gutter also keep half a space from those in the closed area beside it.
    beside = replace(rules, clearance_nm=max(rules.clearance_nm, -(-rules.space_nm // 2)))
    in_gutter = min(wanted, lines_per_layer(panel.gutter_nm, beside))
    used = np.unique(panel.orientations % ORIENTATIONS)
    turned, mirrored = bool((used % 2 != used[0] % 2).any()), used.size > 1
    needed = wanted - in_gutter
    tracks: list[Track] = list(gutter_tracks(panel.pitch_nm, panel.gutter_nm, in_gutter, rules))
    through = dict.fromkeys(DIRECTIONS, 0)
    groups: list[tuple[Direction, ...]] = [DIRECTIONS] if turned else [(direction,) for direction in DIRECTIONS]
    grids = list(routing_grids(opening, panel.dot_nm, panel.gutter_nm, rules)) if needed > 0 else []
    for group in groups if grids else []:
        grid, places = _best(grids, group, mirrored, needed, least=needed if whole else 0)
        for direction in group:
            through[direction] = len(places)
            if places:
                # One line for each port, along free nodes from border to border; port i comes out as port i.
                paths = Net(grid.free, direction).paths(np.array(sorted(places), dtype=np.intp))
                polygons = tuple(
                    _line(path, grid.places_nm, direction, panel.pitch_nm, rules.line_nm) for path in paths
                )
                tracks.append(Track("line", _AXES[direction], polygons, True))
    both = through["horizontal"], through["vertical"]
    return Wiring(demand.lines, in_gutter, both, 0, None, None, tuple(track for track in tracks if track.polygons))


def _best(
    grids: Sequence[RoutingGrid], group: Sequence[Direction], symmetric: bool, needed: int, *, least: int
) -> tuple[RoutingGrid, tuple[int, ...]]:
    """The grid with most ports, up to those needed, and its ports."""
    best = grids[0]
    places: tuple[int, ...] = ()
    for grid in grids:
        places_open = ports(grid.free, group, symmetric=symmetric, enough=needed, least=least).places
        if len(places_open) > len(places):
            best, places = grid, places_open
        if len(places) >= needed:
            break
    return best, places
