"""Rules that leave room for the display: drive circuits, wires, ports, emitters and where their light comes from."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from maskfab.cell_size import CellSize
from maskfab.display.circuit import CircuitRules, pixel_room
from maskfab.display.emitters.across_borders import border_margin
from maskfab.display.emitters.assign import centred
from maskfab.display.emitters.bound import upper_bound
from maskfab.display.emitters.emitter_rules import EmitterRules
from maskfab.display.emitters.fit import footprint
from maskfab.display.emitters.free_area import free_region
from maskfab.display.emitters.freeform import guillotine
from maskfab.display.emitters.placement import Footprint, Verdict
from maskfab.display.emitters.rectangles import rectangle_footprints
from maskfab.display.wires.flow import DIRECTIONS, Net, line_flow
from maskfab.display.wires.ports import ports
from maskfab.errors import JobError
from maskfab.jobfile.sections import DesignSection
from maskfab.optics.numbers.centroid import luminance_centroid
from maskfab.optimiser.rules.rule import Conflict, Mask, Rule
from maskfab.units import NM_PER_UM

if TYPE_CHECKING:
    from maskfab.optimiser.rules.constraints import Constraints

_KEEP = 0.9


def _circuits(need_um2: Any, section: DesignSection, emitters: EmitterRules, where: str) -> CircuitRules | None:
    if need_um2 == 0:
        raise JobError(
            "MF104",
            "a circuit of 0 um^2 has no effect",
            where=f"{where}.rules.circuit",
            cure="Give its area, or remove the key",
        )
    return None if need_um2 is None else CircuitRules(need_um2, min_width_nm=emitters.min_width_nm)


def _on_dots(constraints: Constraints, given: Any) -> Any:
    pixel_room(constraints.opening(constraints.nothing), constraints.dot_nm, given)
    return given


def _no_room(constraints: Constraints, unit: Mask) -> str | None:
    room = pixel_room(constraints.opening(unit), constraints.dot_nm, constraints["circuit"])
    return None if room.certificate is None else room.certificate.statement


def _by_closed_area(constraints: Constraints) -> Conflict | None:
    """The circuits need more than what the count leaves closed."""
    asked = constraints["circuit"]
    closed = (constraints.dots**2 - constraints.clear_dots) * (constraints.dot_nm / NM_PER_UM) ** 2
    if asked.pixel_need_um2 <= closed * (1 + 1e-9):
        return None
    return Conflict(
        ("circuit", "clear_dots"),
        f"{asked.circuits} circuits of {asked.need_um2:g} um^2 need more than the {closed:g} um^2 of the pixel that "
        "are closed",
    )


def _few_lines_quickly(constraints: Constraints, unit: Mask) -> str | None:
    wanted, closed = constraints["wire_flow"], ~unit
    # Every line crosses every row, or every column.
    if min(int(closed.sum(axis=0).min()), int(closed.sum(axis=1).min())) < wanted:
        return f"a row or column has fewer than {wanted} closed dots"
    kept = all(Net(closed, direction).count() >= wanted for direction in DIRECTIONS)
    return None if kept else f"fewer than {wanted} lines in one direction"


def _few_lines(constraints: Constraints, unit: Mask) -> str | None:
    wanted = constraints["wire_flow"]
    for direction in DIRECTIONS:
        found = line_flow(~unit, direction, dot_nm=constraints.dot_nm)
        if found.count < wanted:
            return f"{found.count} {direction} lines, least {wanted}; {found.certificate.statement}"
    return None


def _few_ports(constraints: Constraints, unit: Mask) -> str | None:
    wanted = constraints["ports"]
    found = ports(~unit, enough=wanted)
    more = "" if found.exact else " were found"
    return f"{found.count} symmetric ports{more}, least {wanted}" if found.count < wanted else None


def _by_lines(constraints: Constraints, name: str) -> Conflict | None:
    wanted, dots = constraints[name], constraints.dots
    most = dots * (dots - min(wanted, dots))
    if wanted <= dots and constraints.clear_dots <= most:
        return None
    return Conflict(
        (name, "clear_dots") if wanted <= dots else (name,),
        f"{wanted} lines close {wanted} dots of every row, so that at most {most} of {dots} x {dots} are clear",
    )


def _by_wires(constraints: Constraints) -> Conflict | None:
    """Every line closes a dot of each row, and the count leaves fewer."""
    return _by_lines(constraints, "wire_flow")


def _by_ports(constraints: Constraints) -> Conflict | None:
    """A line through every port closes a dot of each row, and the count leaves fewer."""
    return _by_lines(constraints, "ports")


def _on_cells(constraints: Constraints, given: Any) -> Any:
    _ = constraints.grid
    return given


def _small_footprint_quickly(constraints: Constraints, unit: Mask) -> str | None:
    wanted = constraints["footprint"]
    found = found_quickly(constraints, unit, constraints.emitters, wanted)
    return None if found >= wanted - 1e-9 else f"{found:.1%} found, least {wanted:.1%}"


def found_quickly(constraints: Constraints, unit: Mask, asked: EmitterRules, wanted: float) -> float:
    """A footprint round an opening: that of rectangles, and of other shapes if those are less than what is wanted."""
    grid, used = constraints.grid, constraints.orientations
    margin = border_margin(grid)
    found = float(
        rectangle_footprints(
            unit[None], grid, asked.ratio, orientations=used, margin=margin, max_aspect=asked.max_aspect
        )[0]
    )
    if found < wanted - 1e-9:
        cells, _ = guillotine(free_region(unit, grid, used, margin=margin), grid, asked.ratio)
        found = max(found, cells * _cell_share(constraints))
    return found


def _laid(constraints: Constraints, unit: Mask) -> tuple[Footprint, EmitterRules]:
    rules = replace(constraints.emitters, required=constraints["footprint"] or 0.0)
    dot_nm, gutter_nm = constraints.dot_nm, constraints.gutter_nm
    return footprint(constraints.opening(unit), dot_nm, gutter_nm, constraints.orientations, rules), rules


def _small_footprint(constraints: Constraints, unit: Mask) -> str | None:
    found, rules = _laid(constraints, unit)
    if found.verdict is Verdict.FITS:
        return None
    proved = found.verdict is Verdict.DOES_NOT_FIT and found.certificate is not None
    why = found.certificate.statement if proved and found.certificate else f"at most {found.bound_share:.1%}"
    return f"{found.found_share:.1%} found, least {rules.required:.1%}; {why}"


def _by_area(constraints: Constraints) -> Conflict | None:
    """Three emitters cover more than what the count leaves closed, or do not fit even a pixel without an opening."""
    wanted, dots, dot_nm = constraints["footprint"], constraints.dots, constraints.dot_nm
    pitch_nm = CellSize(dots, dot_nm, constraints.gutter_nm).pitch_nm
    closed = 1 - constraints.clear_dots * (dot_nm / pitch_nm) ** 2
    if 3 * wanted > closed + 1e-9:
        return Conflict(
            ("footprint", "clear_dots"),
            f"three emitters of {wanted:.1%} are more than the {closed:.1%} of the pixel that is closed",
        )
    region = free_region(constraints.nothing, constraints.grid, constraints.orientations)
    cells, certificate = upper_bound(region, constraints.grid, constraints.emitters.ratio)
    share = cells * _cell_share(constraints)
    if share >= wanted - 1e-9:
        return None
    return Conflict(
        ("footprint",),
        f"even a pixel without an opening has room for {share:.1%} of each colour, not {wanted:.1%}: "
        f"{certificate.statement}",
        certificate,
    )


def _cell_share(constraints: Constraints) -> float:
    return (constraints.grid.cell_nm / constraints.grid.pitch_nm) ** 2


def _off_centre(constraints: Constraints, unit: Mask) -> str | None:
    limit, (found, rules) = constraints["centroid_px"], _laid(constraints, unit)
    panel = np.random.default_rng(0).choice(np.array(constraints.orientations, dtype=np.int8), size=(24, 24))
    placed = centred(found.found, constraints.opening(unit), constraints.grid, panel, rules, keep=_KEEP)
    if placed is None:
        return "no emitters were found whose light has a centroid"
    away = math.hypot(*luminance_centroid(placed, constraints.grid.pitch_nm))
    return f"the light's centroid is {away:.3f} pixels off, at most {limit:g}" if away > limit else None


def _always(constraints: Constraints) -> bool:
    return True


CIRCUIT = Rule("circuit", "um^2", _no_room, proof=_by_closed_area, one_place=_always, read=_circuits, checked=_on_dots)
WIRES = Rule("wire_flow", "lines", _few_lines, _few_lines_quickly, _by_wires, one_place=_always)
PORTS = Rule("ports", "ports", _few_ports, proof=_by_ports, one_place=_always, slow=True)
FOOTPRINT = Rule(
    "footprint",
    "of the pixel",
    _small_footprint,
    _small_footprint_quickly,
    _by_area,
    one_place=_always,
    slow=True,
    checked=_on_cells,
)
CENTROID = Rule("centroid_px", "pixels", _off_centre, one_place=_always, slow=True, checked=_on_cells)
