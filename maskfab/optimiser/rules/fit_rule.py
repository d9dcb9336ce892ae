"""The display of the job as a rule of its opening: it fits by the very checks that ``maskfab check`` makes."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from maskfab.display.circuit import pixel_room
from maskfab.display.emitters.placement import Certificate, Verdict
from maskfab.display.feasibility import DisplayRules, Feasibility, feasibility
from maskfab.display.wires.wiring import most_lines, wiring
from maskfab.jobfile import SearchSection
from maskfab.model import Opening, Panel, Tiling
from maskfab.optimiser.rules.display_rules import found_quickly
from maskfab.optimiser.rules.lines_beside import most_beside
from maskfab.optimiser.rules.rule import Conflict, Mask, Rule
from maskfab.plate.maps import CellMap, panel_shape, placed
from maskfab.plate.tiling import orientations
from maskfab.units import NM_PER_UM

if TYPE_CHECKING:
    from maskfab.optimiser.rules.constraints import Constraints


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
    _known: dict[bytes, str | None] = field(default_factory=dict, repr=False)
    _empty: dict[tuple[int, int], str | None] = field(default_factory=dict, repr=False)

    @classmethod
    def of(cls, rules: DisplayRules, tiling: Tiling, seed: int, before_stop: int, across: int) -> Display:
        """A display of so many pixels across, and before the stop."""
        return cls(rules, orientations(tiling, before_stop, before_stop, seed), tiling, seed, across)

    def panel(self, unit: Mask, dot_nm: int, cells: NDArray[np.int8] | None = None, outer: Mask | None = None) -> Panel:
        """The panel of an opening, its cells as they are tried or as a map has them."""
        others = () if outer is None else (Opening("outer", outer, dot_nm),)
        held = self.cells if cells is None else cells
        return Panel(Opening("unit", unit, dot_nm), dot_nm, 0, held, self.tiling, self.seed, others=others)

    def die(self, unit: Mask, dot_nm: int, given: CellMap | None, outer: Mask | None = None) -> Panel:
        """The panel of a die, its map in the middle; every cell beyond it draws one of both openings."""
        held = 1 if outer is None else 2
        if given is None:
            drawn = orientations(self.tiling, self.across, self.across, self.seed, openings=held)
            return self.panel(unit, dot_nm, drawn, outer)
        rows, columns = panel_shape(given, self.across, self.across)
        return self.panel(unit, dot_nm, placed(given, rows, columns, self.seed, openings=held, where="design"), outer)

    def broken_on(self, panel: Panel) -> str | None:
        """Why the display does not fit a panel; None if it does."""
        found = feasibility(panel, self.rules)
        return None if found is None or found.verdict is Verdict.FITS else _why(found)

    def most_lines(self, panel: Panel) -> int | None:
        """Lines that can be drawn each way on a panel that it fits; None where none are asked for."""
        return None if self.rules.wires is None else most_lines(panel, panel.common, self.rules.wires)

    def broken_without(self, nothing: Mask, dot_nm: int) -> str | None:
        """Why the display does not fit a pixel without an opening; None if it does. Judged once."""
        key = len(nothing), dot_nm
        if key not in self._empty:
            self._empty[key] = self.broken_on(self.panel(nothing, dot_nm))
        return self._empty[key]

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

    def broken_quickly(self, constraints: Constraints, unit: Mask) -> str | None:
        """Why an opening does not hold it, no laxer: with emitters that are rectangles or parted by straight cuts."""
        key = unit.tobytes()
        if key not in self._known:
            self._known[key] = self._first_broken(constraints, unit)
        return self._known[key]

    def _first_broken(self, constraints: Constraints, unit: Mask) -> str | None:
        most = self.lines_beside(unit[None], constraints.dot_nm)
        if most is not None and (passing := int(most[0])) < self.opaque_lines:
            return f"no more than {passing} lines pass beside it, {self.opaque_lines} must"
        required, emitters = self.rules.emitters.required, self.rules.emitters
        if (share := found_quickly(constraints, unit, emitters, required)) < required - 1e-9:
            return f"{share:.1%} found, least {required:.1%}"
        panel = self.panel(unit, constraints.dot_nm)
        if (tight := pixel_room(panel.opening, panel.dot_nm, self.rules.circuit).certificate) is not None:
            return tight.statement
        if self.rules.wires is None:
            return None
        wires = wiring(panel, panel.opening, self.rules.wires)
        return None if wires.verdict is Verdict.FITS else _statement(wires.failed)


def _statement(proof: Certificate | None) -> str:
    return "not all wires were found" if proof is None else proof.statement


def _why(found: Feasibility) -> str:
    if found.certificates:
        return found.certificates[0].statement
    if found.broken:
        return f"emitters break the rule of {found.broken[0].rule}"
    if found.stranded:
        return found.stranded[0].statement
    if found.wiring is not None and found.wiring.verdict is not Verdict.FITS:
        return _statement(found.wiring.failed)
    return f"{found.footprint.found_share:.1%} found, least {found.required:.1%}"


def _not_fitting(constraints: Constraints, unit: Mask) -> str | None:
    display: Display = constraints["fit"]
    return display.broken_on(display.panel(unit, constraints.dot_nm))


def _not_fitting_quickly(constraints: Constraints, unit: Mask) -> str | None:
    display: Display = constraints["fit"]
    return display.broken_quickly(constraints, unit)


def _not_fitting_beside(constraints: Constraints, units: Mask) -> bool:
    """Whether it does not fit a die whose cells draw one of two openings."""
    display: Display = constraints["fit"]
    dense, sparse = units
    return display.broken_on(display.die(dense, constraints.dot_nm, None, sparse)) is not None


def _by_nothing(constraints: Constraints) -> Conflict | None:
    """Emitters or circuits cover more than the count leaves closed, or do not fit even a pixel without an opening."""
    display: Display = constraints["fit"]
    rules, pixel_um2 = display.rules, (constraints.dots * constraints.dot_nm / NM_PER_UM) ** 2
    closed = pixel_um2 - constraints.clear_dots * (constraints.dot_nm / NM_PER_UM) ** 2
    for what, need in (
        (f"three emitters of {rules.emitters.required:.1%} of the pixel", 3 * rules.emitters.required * pixel_um2),
        (f"circuits of {rules.circuit.pixel_need_um2:g} um^2", rules.circuit.pixel_need_um2),
    ):
        if need > closed * (1 + 1e-9):
            told = f"{what} need {need - closed:.0f} um^2 more than the {closed:.0f} um^2 of the pixel that are closed"
            return Conflict(("fit", "clear_dots"), told)
    why = display.broken_without(constraints.nothing, constraints.dot_nm)
    return None if why is None else Conflict(("fit",), f"not even a pixel without an opening holds the display: {why}")


FIT = Rule(
    "fit",
    "",
    _not_fitting,
    _not_fitting_quickly,
    _by_nothing,
    beside=_not_fitting_beside,
    one_place=lambda _: True,
    slow=True,
    section=SearchSection,
    asker="the display of [emitters] and [wires]",
)
