"""The display of the job as rules of its opening: emitters, circuits and wires, as ``maskfab check`` judges them."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from maskfab.base.arrays import Mask
from maskfab.display.circuit import pixel_room
from maskfab.display.emitters.emitter_rules import EmitterRules
from maskfab.display.emitters.placement import Certificate, Verdict
from maskfab.display.feasibility import DisplayRules, Feasibility, feasibility
from maskfab.display.wires.wiring import most_lines, wiring
from maskfab.jobfile import SearchSection
from maskfab.model import Opening, Panel, Tiling
from maskfab.optimiser.model.designed_panel import designed_panel
from maskfab.optimiser.rules.footprints import Footprints
from maskfab.optimiser.rules.lines_beside import most_beside
from maskfab.optimiser.rules.rule import Conflict, Rule
from maskfab.plate.maps import CellMap
from maskfab.plate.tiling import orientations
from maskfab.units import NM_PER_UM

if TYPE_CHECKING:
    from maskfab.optimiser.rules.constraints import Constraints

_ROUNDING = 1e-9


@dataclass(frozen=True, eq=False)
class Display:
    """A display that an opening must hold.

    Attributes:
        rules: its maker's.
        cells: int8 [rows, columns] orientations that openings are tried in: of the cells before the stop.
        tiling: that these are of.
        seed: of the tiling.
        across: cells along a side of the die on which the opening is tried at last.
    """

    rules: DisplayRules
    cells: NDArray[np.int8]
    tiling: Tiling
    seed: int
    across: int
    _wired: dict[bytes, str | None] = field(default_factory=dict, repr=False)
    _empty: dict[tuple[int, int], Feasibility | None] = field(default_factory=dict, repr=False)

    @classmethod
    def of(cls, rules: DisplayRules, tiling: Tiling, seed: int, before_stop: int, across: int) -> Display:
        """A display of so many pixels across, and before the stop."""
        return cls(rules, orientations(tiling, before_stop, before_stop, seed), tiling, seed, across)

    def asking(self, *, required: float, lines: int) -> Display:
        """This display with another least footprint, and so many lines each way; 0 for none."""
        wires = self.rules.wires
        held = None if wires is None or not lines else replace(wires, lines=lines)
        rules = replace(self.rules, emitters=replace(self.rules.emitters, required=required), wires=held)
        return replace(self, rules=rules, _wired={}, _empty={})

    def panel(self, unit: Mask, dot_nm: int, cells: NDArray[np.int8] | None = None, outer: Mask | None = None) -> Panel:
        """The panel of an opening, its cells as they are tried or as a map has them."""
        others = () if outer is None else (Opening("outer", outer, dot_nm),)
        held = self.cells if cells is None else cells
        return Panel(Opening("unit", unit, dot_nm), dot_nm, 0, held, self.tiling, self.seed, others=others)

    def die(self, unit: Mask, dot_nm: int, given: CellMap | None, outer: Mask | None = None) -> Panel:
        """The panel of a die, its map in the middle; every cell beyond it draws one of both openings."""
        return designed_panel(
            unit, dot_nm, tiling=self.tiling, seed=self.seed, across=self.across, given=given, outer=outer
        )

    def on(self, panel: Panel) -> Feasibility | None:
        """Answer of the check to a panel, as to a die of a plate; None for a sheet that has no pixels."""
        return feasibility(panel, self.rules)

    def broken_on(self, panel: Panel) -> str | None:
        """Why the display does not fit a die; None if it does."""
        return misfit(self.on(panel))

    def broken_in_trial(self, panel: Panel) -> str | None:
        """Why the display does not fit a panel, its emitters no larger than they must be; None if it does."""
        return misfit(feasibility(panel, self.rules, largest=False))

    def most_lines(self, panel: Panel) -> int | None:
        """Lines that can be drawn each way on a panel that it fits; None where none are asked for."""
        return None if self.rules.wires is None else most_lines(panel, panel.common, self.rules.wires)

    def lines_beside(self, units: Mask, dot_nm: int) -> NDArray[np.int64] | None:
        """Opaque lines for every pixel that pass beside openings [units, dots, dots] at most; None if none must."""
        wires = self.rules.wires
        if wires is None or self.opaque_lines < 1:
            return None
        return most_beside(units, self.cells, dot_nm, wires.rules)

    @property
    def opaque_lines(self) -> int:
        """Lines of metal that must cross every pixel along x, and along y."""
        wires = self.rules.wires
        return 0 if wires is None else wires.lines - int(wires.transparent_nm > 0)

    def asks(self, part: str) -> str:
        """The demand on one of its parts, as :func:`of_display` names them, in words."""
        emitters, wires = self.rules.emitters, self.rules.wires
        told = {
            "emitters": f"{emitters.required:.1%} of the pixel for each colour",
            "circuits": f"{self.rules.circuit.pixel_need_um2:g} µm² for each pixel",
            "wires": "" if wires is None else f"{wires.lines} lines each way",
        }
        return told.get(part, "")

    def lines_told(self, pitch_nm: int) -> str:
        """Opaque lines that must pass, and the width of a pixel that they take."""
        if self.rules.wires is None:
            return "no lines"
        line = self.rules.wires.rules
        width, space, clearance = (each / NM_PER_UM for each in (line.line_nm, line.space_nm, line.clearance_nm))
        return (
            f"{self.opaque_lines} lines {width:g} um wide, {space:g} um apart and {clearance:g} um from openings take "
            f"{self.opaque_lines * (width + space):g} um of the {pitch_nm / NM_PER_UM:g} um of a pixel"
        )

    def without_wires(self, panel: Panel) -> Feasibility | None:
        """Its emitters and their circuits on a panel, were there nothing to wire."""
        return feasibility(panel, replace(self.rules, wires=None), largest=False)

    def without_opening(self, nothing: Mask, dot_nm: int) -> Feasibility | None:
        """Its emitters and their circuits on a pixel without an opening; judged once."""
        key = len(nothing), dot_nm
        if key not in self._empty:
            self._empty[key] = self.without_wires(self.panel(nothing, dot_nm))
        return self._empty[key]

    def unwired(self, unit: Mask, dot_nm: int) -> str | None:
        """Why the lines do not pass an opening's panel; None if they do."""
        if self.rules.wires is None:
            return None
        key = unit.tobytes()
        if key not in self._wired:
            passing = self.lines_beside(unit[None], dot_nm) if unit.any() else None
            if passing is not None and passing[0] < self.opaque_lines:
                self._wired[key] = f"no more than {passing[0]} lines pass beside it, {self.opaque_lines} must"
                return self._wired[key]
            panel = self.panel(unit, dot_nm)
            wires = wiring(panel, panel.opening, self.rules.wires)
            self._wired[key] = None if wires.verdict is Verdict.FITS else _statement(wires.failed)
        return self._wired[key]


def of_display(display: Display) -> dict[str, Any]:
    """The arguments by which constraints hold a display."""
    parts = ("circuits", "emitters", *(() if display.rules.wires is None else ("wires",)))
    return dict.fromkeys(parts, display)


def _statement(proof: Certificate | None) -> str:
    return "not all wires were found" if proof is None else proof.statement


def misfit(found: Feasibility | None) -> str | None:
    """Why a display does not fit; None if it does, or there are no pixels that it must fit."""
    if found is None or found.verdict is Verdict.FITS:
        return None
    if found.certificates:
        return found.certificates[0].statement
    if found.broken:
        return f"emitters break the rule of {found.broken[0].rule}"
    if found.stranded:
        return found.stranded[0].statement
    if found.wiring is not None and found.wiring.verdict is not Verdict.FITS:
        return _statement(found.wiring.failed)
    return f"{found.footprint.found_share:.1%} found, least {found.required:.1%}"


def footprints_of(constraints: Constraints, asked: EmitterRules) -> Footprints:
    """Footprints of openings that are asked for by constraints."""
    return Footprints(asked, constraints.dots, constraints.dot_nm, constraints.orientations)


def _dark(constraints: Constraints, unit: Mask) -> str | None:
    display: Display = constraints["emitters"]
    return misfit(display.without_wires(display.panel(unit, constraints.dot_nm)))


def _dark_quickly(constraints: Constraints, unit: Mask) -> str | None:
    asked = constraints["emitters"].rules.emitters
    found = footprints_of(constraints, asked)(unit, enough=asked.required - _ROUNDING)
    return None if found >= asked.required - _ROUNDING else f"{found:.1%} found, least {asked.required:.1%}"


def _by_room(constraints: Constraints) -> Conflict | None:
    """Three emitters cover more than what the count leaves closed, or do not fit even a pixel without an opening."""
    asked = constraints["emitters"].rules.emitters
    pixel_um2 = (constraints.dots * constraints.dot_nm / NM_PER_UM) ** 2
    said = f"three emitters of {asked.required:.1%} of the pixel"
    if (crowd := _crowd(constraints, 3 * asked.required * pixel_um2, said)) is not None:
        return Conflict(("emitters", "clear_dots"), crowd)
    found = constraints["emitters"].without_opening(constraints.nothing, constraints.dot_nm)
    if found is None or found.footprint.verdict is not Verdict.DOES_NOT_FIT or found.footprint.certificate is None:
        return None
    proof = found.footprint.certificate
    return Conflict(
        ("emitters",),
        f"even a pixel without an opening has room for at most {found.footprint.bound_share:.1%} of each colour, not "
        f"{asked.required:.1%}: {proof.statement}",
        proof,
    )


def _crowded(constraints: Constraints, unit: Mask) -> str | None:
    room = pixel_room(constraints.opening(unit), constraints.dot_nm, constraints["circuits"].rules.circuit)
    return None if room.certificate is None else room.certificate.statement


def _by_closed_area(constraints: Constraints) -> Conflict | None:
    """The circuits need more than what the count leaves closed."""
    need_um2 = constraints["circuits"].rules.circuit.pixel_need_um2
    crowd = _crowd(constraints, need_um2, f"circuits of {need_um2:g} um^2")
    return None if crowd is None else Conflict(("circuits", "clear_dots"), crowd)


def _crowd(constraints: Constraints, need_um2: float, what: str) -> str | None:
    """By how much the closed area is too small for something; None if it is not."""
    closed = (constraints.dots**2 - constraints.clear_dots) * (constraints.dot_nm / NM_PER_UM) ** 2
    if need_um2 <= closed * (1 + _ROUNDING):
        return None
    return f"{what} need {need_um2 - closed:.0f} um^2 more than the {closed:.0f} um^2 of the pixel that are closed"


def _unwired(constraints: Constraints, unit: Mask) -> str | None:
    """The whole display, so that emitters without a way to the pixel's side count too."""
    display: Display = constraints["wires"]
    return display.unwired(unit, constraints.dot_nm) or display.broken_in_trial(display.panel(unit, constraints.dot_nm))


def _unwired_quickly(constraints: Constraints, unit: Mask) -> str | None:
    display: Display = constraints["wires"]
    return display.unwired(unit, constraints.dot_nm)


def _not_fitting_beside(constraints: Constraints, units: Mask) -> bool:
    """Whether it does not fit a die whose cells draw one of two openings."""
    display: Display = constraints["emitters"]
    dense, sparse = units
    return display.broken_in_trial(display.die(dense, constraints.dot_nm, None, sparse)) is not None


def _by_nothing(constraints: Constraints) -> Conflict | None:
    """Not even a pixel without an opening can be wired."""
    display: Display = constraints["wires"]
    if display.unwired(constraints.nothing, constraints.dot_nm) is None:
        return None
    told = display.lines_told(constraints.dots * constraints.dot_nm)
    return Conflict(("wires",), f"not even a pixel without an opening can be wired: {told}")


def _off_centre(constraints: Constraints, unit: Mask) -> str | None:
    limit, display = constraints["centroid_px"], constraints["emitters"]
    found = display.without_wires(display.panel(unit, constraints.dot_nm))
    if found is None or found.emitters is None:
        return "no emitters were found whose light has a centroid"
    away = math.hypot(*found.centroid_px)
    return f"the light's centroid is {away:.3f} pixels off, at most {limit:g}" if away > limit else None


def _on_dots(constraints: Constraints, given: Display) -> Display:
    pixel_room(constraints.opening(constraints.nothing), constraints.dot_nm, given.rules.circuit)
    return given


def _on_cells(constraints: Constraints, given: Display) -> Display:
    _ = footprints_of(constraints, given.rules.emitters).grid
    return given


def _always(constraints: Constraints) -> bool:
    return True


CIRCUITS = Rule(
    "circuits",
    "",
    _crowded,
    proof=_by_closed_area,
    one_place=_always,
    slow=True,
    checked=_on_dots,
    section=SearchSection,
    key="fit",
    asker="the circuits of [emitters]",
)
EMITTERS = Rule(
    "emitters",
    "",
    _dark,
    _dark_quickly,
    _by_room,
    beside=_not_fitting_beside,
    one_place=_always,
    slow=True,
    checked=_on_cells,
    section=SearchSection,
    key="fit",
    asker="the emitters of [emitters]",
)
WIRES = Rule(
    "wires",
    "",
    _unwired,
    _unwired_quickly,
    _by_nothing,
    one_place=_always,
    slow=True,
    section=SearchSection,
    key="fit",
    asker="the lines of [wires]",
)
CENTROID = Rule("centroid_px", "pixels", _off_centre, one_place=_always, slow=True)
