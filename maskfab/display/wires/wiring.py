"""Can a panel's pixels be wired: lines in gutters and through closed area, drawn, bounded, and proved impossible."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from maskfab.display.emitters.placement import Certificate, Verdict
from maskfab.display.wires.flow import DIRECTIONS, Direction
from maskfab.display.wires.gutter import WireRules, lines_per_layer
from maskfab.display.wires.ports import ports
from maskfab.display.wires.routing import RoutingGrid, most_lines, routing_grids
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
        through: opaque lines drawn through closed area, along x and along y, at ports that all orientations share.
        transparent: transparent lines along each axis.
        bounds: no drawing has more opaque lines across a pixel, along x and along y.
        proofs: of the two bounds.
        tracks: the wires.
    """

    wanted: int
    in_gutter: int
    through: tuple[int, int]
    transparent: int
    bounds: tuple[int, int]
    proofs: tuple[Certificate, Certificate]
    tracks: tuple[Track, ...]

    @property
    def verdict(self) -> Verdict:
        """FITS if all lines are drawn; a proof that they cannot be counts what a pixel could carry at best."""
        if self.lines >= self.wanted:
            return Verdict.FITS
        return Verdict.DOES_NOT_FIT if self.failed is not None else Verdict.UNKNOWN

    @property
    def lines(self) -> int:
        """Lines drawn along both axes."""
        return self.in_gutter + min(self.through) + self.transparent

    @property
    def failed(self) -> Certificate | None:
        """Why the lines asked for cannot be, if that is proved."""
        worst = int(np.argmin(self.bounds))
        return self.proofs[worst] if self.bounds[worst] + self.transparent < self.wanted else None


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
    """Wires of every pixel of a panel.

    Gutters are filled first; what they cannot hold runs through closed area, as far as it can.

    Args:
        panel: pitch, gutter and the orientations that meet.
        opening: what is clear in any of its openings.
        demand: what is asked.
    """
    rules = demand.rules
    transparent = int(demand.transparent_nm > 0)
    in_gutter = min(demand.lines - transparent, _gutter_lines(panel.gutter_nm, rules))
    used = np.unique(panel.orientations % ORIENTATIONS)
    turned, mirrored = bool((used % 2 != used[0] % 2).any()), used.size > 1
    needed = demand.lines - transparent - in_gutter
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
    if demand.transparent_nm:
        tracks += transparent_tracks(panel.pitch_nm, demand.transparent_nm, demand.transmission)
    along_x, proof_x = most_lines(opening, panel.dot_nm, panel.gutter_nm, rules, "horizontal")
    along_y, proof_y = most_lines(opening, panel.dot_nm, panel.gutter_nm, rules, "vertical")
    if turned:
        # A pixel that is turned lays either of its nets along either axis.
        along_x = along_y = min(along_x, along_y)
        proof_x = proof_y = min((proof_x, proof_y), key=lambda proof: proof.numbers["lines"])
    return Wiring(
        demand.lines,
        in_gutter,
        (through["horizontal"], through["vertical"]),
        transparent,
        (along_x, along_y),
        (proof_x, proof_y),
        tuple(track for track in tracks if track.polygons),
    )


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
