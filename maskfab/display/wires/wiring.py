"""Can a panel's pixels be wired: lines in gutters, through closed area and across the panel, or a proof that not."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from maskfab.display.emitters.measure import Violation
from maskfab.display.emitters.placement import Certificate, Verdict
from maskfab.display.wires.flow import DIRECTIONS, Direction
from maskfab.display.wires.gutter import WireRules, lines_per_layer
from maskfab.display.wires.line_rules import line_violations
from maskfab.display.wires.panel_cut import panel_cut
from maskfab.display.wires.panel_routing import AXES, PanelLines, panel_lines
from maskfab.display.wires.ports import ports
from maskfab.display.wires.routing import RoutingGrid, routing_grids
from maskfab.display.wires.tracks import gutter_tracks, routed_track, transparent_tracks
from maskfab.errors import JobError
from maskfab.model import ORIENTATIONS, Opening, Panel, Track
from maskfab.units import NM_PER_UM


@dataclass(frozen=True)
class WireDemand:
    """Wires required by the display maker.

    Attributes:
        rules: width, space and clearance of opaque lines.
        lines: that must cross every pixel along x, and along y.
        transparent_nm: width of a transparent wire along each axis; 0 for none.
        transmission: share of light that it passes.
    """

    rules: WireRules
    lines: int
    transparent_nm: int = 0
    transmission: float = 1.0


@dataclass(frozen=True, eq=False)
class Wiring:
    """Wiring of the pixels of a panel.

    Attributes:
        wanted: lines along each axis.
        in_gutter: opaque lines that every gutter holds, of those wanted.
        through: opaque lines drawn through closed area of every pixel alike, along x and along y, at ports that all
            orientations share.
        transparent: transparent lines along each axis.
        laid: opaque lines laid across the whole panel, along x and along y, one for each that is wanted and not
            transparent in every row and column of pixels; None where every pixel is drawn alike.
        failed: a proof that the lines asked for cannot be; None without.
        tracks: the wires that every pixel is drawn with.
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
    """Refuse wires that no pixel can hold.

    Raises:
        JobError: MF120 if a line or a transparent wire is wider than the pixel.
    """
    for name, width_nm in (("line", demand.rules.line_nm), ("transparent", demand.transparent_nm)):
        if width_nm > panel.pitch_nm:
            raise JobError(
                "MF120",
                f"{name} = {width_nm / NM_PER_UM:g} um is wider than the {panel.cell_size.pitch_um:g} um of a pixel",
                where=f"wires.{name}",
                cure=f"Give a width up to {panel.cell_size.pitch_um:g} um",
            )


def wiring(panel: Panel, opening: Opening, demand: WireDemand) -> Wiring:
    """Wires of the pixels of a panel.

    First every pixel is drawn alike: gutters are filled, and what they cannot hold runs through closed area. Where
    that is too little, lines are laid across the whole panel as its cells lie, each within a pixel of its own, unless
    a chain of openings proves that they cannot be.

    Args:
        panel: pitch, gutter and orientations.
        opening: what is clear in any of its openings.
        demand: what is asked.
    """
    transparent = int(demand.transparent_nm > 0)
    crossing = transparent_tracks(panel.pitch_nm, demand.transparent_nm, demand.transmission) if transparent else ()
    alike = _alike(panel, opening, demand, demand.lines - transparent)
    drawn = replace(alike, transparent=transparent, tracks=(*alike.tracks, *crossing))
    if drawn.verdict is Verdict.FITS:
        return drawn
    asked = panel, demand.rules, demand.lines - transparent
    cut = next((found for axis in AXES if (found := panel_cut(*asked, axis)) is not None), None)
    if cut is not None:
        return replace(drawn, failed=cut)
    laid = panel_lines(*asked, "x"), panel_lines(*asked, "y")
    if not all(each.paths for each in laid):
        return drawn
    broken = line_violations(panel, laid, demand.rules)
    return Wiring(demand.lines, 0, (0, 0), transparent, laid, None, crossing, broken)


def most_lines(panel: Panel, opening: Opening, demand: WireDemand) -> int:
    """Lines that can be drawn for every pixel along each axis, if those asked for can: so many, and not one more.

    Args:
        panel, opening, demand: as for :func:`wiring`.
    """
    lines = demand.lines
    while wiring(panel, opening, replace(demand, lines=lines + 1)).verdict is Verdict.FITS:
        lines += 1
    return lines


def _alike(panel: Panel, opening: Opening, demand: WireDemand, wanted: int) -> Wiring:
    """Opaque wires that every pixel is drawn with, as many as can be."""
    rules = demand.rules
    in_gutter = min(wanted, _gutter_lines(panel.gutter_nm, rules))
    used = np.unique(panel.orientations % ORIENTATIONS)
    turned, mirrored = bool((used % 2 != used[0] % 2).any()), used.size > 1
    needed = wanted - in_gutter
    tracks: list[Track] = list(gutter_tracks(panel.pitch_nm, panel.gutter_nm, in_gutter, rules))
    through = dict.fromkeys(DIRECTIONS, 0)
    groups: list[tuple[Direction, ...]] = [DIRECTIONS] if turned else [(direction,) for direction in DIRECTIONS]
    grids = list(routing_grids(opening, panel.dot_nm, panel.gutter_nm, rules)) if needed > 0 else []
    for group in groups if grids else []:
        grid, places = _best(grids, group, mirrored, needed)
        for direction in group:
            through[direction] = len(places)
            if places:
                tracks.append(routed_track(grid, direction, places, panel.pitch_nm, rules))
    both = through["horizontal"], through["vertical"]
    return Wiring(demand.lines, in_gutter, both, 0, None, None, tuple(each for each in tracks if each.polygons))


def _gutter_lines(gutter_nm: int, rules: WireRules) -> int:
    """Lines of a gutter that also keep half a space from those in the closed area beside it."""
    margin = max(rules.clearance_nm, -(-rules.space_nm // 2))
    return lines_per_layer(gutter_nm, WireRules(rules.line_nm, rules.space_nm, margin))


def _best(
    grids: Sequence[RoutingGrid], group: Sequence[Direction], symmetric: bool, needed: int
) -> tuple[RoutingGrid, tuple[int, ...]]:
    """The grid with most ports, up to those needed, and its ports."""
    best = grids[0]
    places: tuple[int, ...] = ()
    for grid in grids:
        found = ports(grid.free, group, symmetric=symmetric, enough=needed).places
        if len(found) > len(places):
            best, places = grid, found
        if len(places) >= needed:
            break
    return best, places
