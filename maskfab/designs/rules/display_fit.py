"""The display of a job as rules of its opening: emitters, circuits and wires, as ``maskfab check`` judges them.

A search asks of thousands of openings, so dear questions have cheap bounds. Footprints come with one that costs next to
nothing. Lines that pass beside openings at most follow from chains across a panel, by the theorem of
:mod:`maskfab.display.panel_lines`: of all its chains only those are looked at that go on from every column of cells to
the next, in the same row or one beside it, through the largest piece of each opening from its first dot to its last. So
that bound may be higher than that of all chains.

A map that is still to be designed cannot break a display whose lines run alike in every pixel, in whichever way it is
turned: that is asked of the opening once, exactly, in milliseconds. An opening whose lines pass cells that are laid
alike can be given a map as well, one that is looked at while it is designed.

At last a display is held against a whole die: a design's opening with its map in the middle, and regular cells, or what
is drawn from a seed, beyond it.
"""

from __future__ import annotations

import math
import time
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from enum import StrEnum
from functools import cache, cached_property, partial
from typing import Any

import numpy as np
from scipy import ndimage

from maskfab.base.arrays import Floats, Indices, Ints, Labels, Mask
from maskfab.base.cell_size import CellSize
from maskfab.base.model import ORIENTATIONS, Opening, Panel, Tiling, frozen, orient
from maskfab.base.units import NM_PER_UM
from maskfab.base.work import Progress, silent
from maskfab.designs.model.appraisal import designed_panel
from maskfab.designs.rules.rule import Conflict, Constrained, Rule
from maskfab.display.emitted_light import TELEPHONE_UM, Viewing
from maskfab.display.emitter_rules import Certificate, EmitterGrid, EmitterRules, Verdict, grid_of
from maskfab.display.emitter_shapes import guillotine, rectangle_footprints
from maskfab.display.feasibility import DisplayRules, Feasibility, feasibility
from maskfab.display.free_area import border_margin, free_region
from maskfab.display.panel_lines import AXES, panel_cut
from maskfab.display.pixel_lines import WireRules
from maskfab.display.turned_grain import turned_grain
from maskfab.display.wiring import WireDemand, most_lines, wired_alike, wiring
from maskfab.job.sections import SearchSection
from maskfab.mask.panels import CellMap
from maskfab.optics.tiling import orientations

_TOUCHING = np.ones((3, 3), dtype=np.int8)

_ROUNDING = 1e-9

_NEARLY = 0.8
"""Share of the footprint required that straight emitters must have for crooked ones to be looked for."""

SEEDS = 8
"""Dies that are tried of an opening and its map."""

_EVERY_PAIR = 40
"""Cells along a random panel in which any two orientations meet, side by side and corner to corner."""

_LAID_ALIKE, _LEAST_ALIKE = (64, 3), (6, 6)
"""Rows and columns of a panel that stands, for lines along x, for all whose cells are laid alike, since room too narrow
by a line for every few of them is too narrow by many for all; and of one on which lines are drawn."""

_BOUND_ALIKE = (16, 16)
"""Of one in which lines are only counted, for many openings at once."""


class Wired(StrEnum):
    """Panels in which the lines of a display must pass."""

    TILING = "the job's tiling"
    ANY_MAP = "whatever the map"
    REGULAR = "all cells laid alike"


@dataclass(frozen=True, eq=False)
class Display:
    """A display that an opening must hold.

    Attributes:
        cells: int8 [rows, columns] orientations that openings are tried in: of the cells before the stop.
        across: cells along a side of the die on which the opening is tried at last.
        wired: where its lines must pass; but for the job's tiling, emitters must suit any two neighbours.
        crooked: whether a search looks for crooked emitters too, as the check does, where straight ones nearly do.
    """

    rules: DisplayRules
    cells: Labels
    tiling: Tiling
    seed: int
    across: int
    wired: Wired = Wired.TILING
    crooked: bool = False
    _wired: dict[bytes, str | None] = field(default_factory=dict, repr=False)
    _lit: dict[bytes, Feasibility | None] = field(default_factory=dict, repr=False)
    _empty: dict[tuple[int, int], Feasibility | None] = field(default_factory=dict, repr=False)

    @classmethod
    def of(cls, rules: DisplayRules, tiling: Tiling, seed: int, before_stop: int, across: int) -> Display:
        """A display of so many pixels across, and before the stop."""
        return cls(rules, orientations(tiling, before_stop, before_stop, seed), tiling, seed, across)

    def wired_as(self, wired: Wired) -> Display:
        """This display before a map that is not designed yet."""
        cells = self.cells if wired is Wired.TILING else every_pair()
        return replace(self, cells=cells, wired=wired, _wired={}, _lit={}, _empty={})

    def asking(self, *, required: float, lines: int) -> Display:
        """This display with another least footprint, and so many lines each way; 0 for none."""
        wires = self.rules.wires
        held = None if wires is None or not lines else replace(wires, lines=lines)
        rules = replace(self.rules, emitters=replace(self.rules.emitters, required=required), wires=held)
        return replace(self, rules=rules, _wired={}, _lit={}, _empty={})

    def panel(self, unit: Mask, dot_nm: int, cells: Labels | None = None, outer: Mask | None = None) -> Panel:
        """The panel of an opening, its cells as they are tried or as a map has them."""
        others = () if outer is None else (Opening("outer", outer, dot_nm),)
        held = self.cells if cells is None else cells
        return Panel(Opening("unit", unit, dot_nm), dot_nm, 0, held, self.tiling, self.seed, others=others)

    def die(self, unit: Mask, dot_nm: int, given: CellMap | None, outer: Mask | None = None) -> Panel:
        """The panel of a die, its map in the middle; every cell beyond it draws one of both openings."""
        return designed_panel(
            unit, dot_nm, tiling=self.tiling, seed=self.seed, across=self.across, given=given, outer=outer
        )

    def small_die(self, unit: Mask, dot_nm: int, most: int, *, alike: bool) -> Panel:
        """At most so many pixels along a side of a die without a map, turned at random or all alike."""
        small = replace(self, across=min(most, self.across), tiling=Tiling.PERIODIC if alike else self.tiling)
        return small.die(unit, dot_nm, None)

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

    def lines_beside(self, units: Mask, dot_nm: int) -> Ints | None:
        """Opaque lines for every pixel that pass beside openings [units, dots, dots] at most; None if none must.

        Before any map that is in a panel whose cells are laid alike, which is one of those that the lines must pass.
        """
        wires = self.rules.wires
        if wires is None or self.opaque_lines < 1:
            return None
        cells = self.cells if self.wired is Wired.TILING else np.zeros(_BOUND_ALIKE, dtype=np.int8)
        return most_beside(units, cells, dot_nm, wires.rules)

    @property
    def opaque_lines(self) -> int:
        """Lines of metal that must cross every pixel along x, and along y."""
        wires = self.rules.wires
        return 0 if wires is None else wires.lines - int(wires.transparent_nm > 0)

    def asks(self, part: str) -> str:
        """The demand on one of its parts, as :func:`of_display` names them, in words."""
        emitters, wires = self.rules.emitters, self.rules.wires
        demands = {
            "emitters": f"{emitters.required:.1%} of the pixel for each colour",
            "circuits": self.rules.circuits_asked,
            "wires": "" if wires is None else f"{wires.lines} lines each way",
        }
        return demands.get(part, "")

    def lines_told(self, pitch_nm: int) -> str:
        """Opaque lines that must pass, and the width of a pixel that they take."""
        if self.rules.wires is None:
            return "no lines"
        line = self.rules.wires.rules
        width, space, clearance = (nm / NM_PER_UM for nm in (line.line_nm, line.space_nm, line.clearance_nm))
        return (
            f"{self.opaque_lines} lines {width:g} um wide, {space:g} um apart and {clearance:g} um from openings take "
            f"{self.opaque_lines * (width + space):g} um of the {pitch_nm / NM_PER_UM:g} um of a pixel"
        )

    def crowded(self, unit: Mask, dot_nm: int) -> str | None:
        """Why the circuits have no room behind an opening, or no place; None where nothing that costs little tells."""
        proof = self.rules.crowded(self.panel(unit, dot_nm))
        return None if proof is None else proof.statement

    def without_wires(self, panel: Panel) -> Feasibility | None:
        """Its emitters and their circuits on a panel, were there nothing to wire."""
        return feasibility(panel, replace(self.rules, wires=None), largest=False)

    def lit(self, unit: Mask, dot_nm: int) -> Feasibility | None:
        """Its emitters around an opening, as large as they must be; judged once."""
        key = unit.tobytes()
        if key not in self._lit:
            self._lit[key] = self.without_wires(self.panel(unit, dot_nm))
        return self._lit[key]

    def grain(self, unit: Mask, dot_nm: int) -> float | None:
        """Slow grain of these emitters where pixels are turned at random, as a telephone is held; None without any."""
        answer = self.lit(unit, dot_nm)
        if answer is None or answer.emitters is None:
            return None
        viewing = Viewing(CellSize(len(unit), dot_nm).pitch_um, TELEPHONE_UM)
        return turned_grain(answer.emitters, viewing, elements=np.unique(self.cells % ORIENTATIONS).tolist())

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
            self._wired[key] = self._unwired(unit, dot_nm, self.rules.wires)
        return self._wired[key]

    def _unwired(self, unit: Mask, dot_nm: int, demand: WireDemand) -> str | None:
        passing = self.lines_beside(unit[None], dot_nm) if unit.any() else None
        if passing is not None and passing[0] < self.opaque_lines:
            return f"no more than {passing[0]} lines pass beside it, {self.opaque_lines} must"
        panel = self.panel(unit, dot_nm)
        if self.wired is Wired.ANY_MAP:
            alike = wired_alike(panel, panel.opening, demand, whole=True)
            return None if min(alike.lines) >= demand.lines else "the lines cannot be drawn alike in all its turns"
        if self.wired is Wired.REGULAR:
            for axis, shape in zip(AXES, (_LAID_ALIKE, _LAID_ALIKE[::-1]), strict=True):
                panel = self.panel(unit, dot_nm, np.zeros(shape, dtype=np.int8))
                cut = panel_cut(panel, demand.rules, self.opaque_lines, axis)
                if cut is not None:
                    return cut.statement
            panel = self.panel(unit, dot_nm, np.zeros(_LEAST_ALIKE, dtype=np.int8))
        wires = wiring(panel, panel.opening, demand)
        return None if wires.verdict is Verdict.FITS else _statement(wires.failed)


@cache
def every_pair() -> Labels:
    """Orientations of a panel in which any two are neighbours, int8 [rows, columns]."""
    drawn = np.random.default_rng(0).integers(ORIENTATIONS, size=(_EVERY_PAIR, _EVERY_PAIR))
    return frozen(drawn.astype(np.int8))


def of_display(display: Display) -> dict[str, Any]:
    """The arguments by which constraints hold a display."""
    parts = ("circuits", "emitters", *(() if display.rules.wires is None else ("wires",)))
    return dict.fromkeys(parts, display)


def _statement(proof: Certificate | None) -> str:
    return "not all wires were found" if proof is None else proof.statement


def misfit(answer: Feasibility | None) -> str | None:
    """Why a display does not fit; None if it does, or there are no pixels that it must fit."""
    if answer is None or answer.verdict is Verdict.FITS:
        return None
    if answer.certificates:
        return answer.certificates[0].statement
    if answer.broken:
        return f"emitters break the rule of {answer.broken[0].rule}"
    if answer.circuits is not None and answer.circuits.verdict is not Verdict.FITS:
        return answer.circuits.told
    if answer.stranded:
        return answer.stranded[0].statement
    if answer.wiring is not None and answer.wiring.verdict is not Verdict.FITS:
        return _statement(answer.wiring.failed)
    return f"{answer.footprint.found_share:.1%} found, least {answer.required:.1%}"


@dataclass(frozen=True, eq=False)
class Footprints:
    """Largest footprints behind openings of one grid, and a bound on them.

    Attributes:
        orientations: elements of D4 in use; any two may be neighbours.

    Raises:
        JobError: MF117, MF118 from :attr:`grid` where the rules do not suit the pixel.
    """

    rules: EmitterRules
    dots: int
    dot_nm: int
    orientations: tuple[int, ...] = tuple(range(ORIENTATIONS))

    @cached_property
    def grid(self) -> EmitterGrid:
        """Cells on which the rules are whole numbers."""
        nothing = Opening("unit", np.zeros((self.dots, self.dots), dtype=np.bool_), self.dot_nm)
        return grid_of(nothing, self.dot_nm, 0, self.rules)

    def __call__(self, unit: Mask, *, enough: float = math.inf) -> float:
        """Footprint of rectangles, and of straight cuts where rectangles are not enough."""
        rectangles = rectangle_footprints(
            unit[None],
            self.grid,
            self.rules.ratio,
            orientations=self.orientations,
            margin=border_margin(self.grid),
            max_aspect=self.rules.max_aspect,
        )
        share = float(rectangles[0])
        if share >= enough:
            return share
        cells, _ = guillotine(self._regions(unit), self.grid, self.rules.ratio)
        return max(share, cells * self.share_of_cell)

    def bounds(self, units: Mask) -> Floats:
        """Upper bounds of the footprint that leave the gap across borders free, in some 30 us each.

        An emitter swept by the gap along x and y grows from an area a to at least (sqrt(a) + gap)^2, by Brunn and
        Minkowski; swept emitters of different colours share nothing, and lie where the free squares of the least width
        are swept.

        Args:
            units: bool [k, dots, dots].

        Returns:
            float [k], share of the pixel.
        """
        width, gap = self.grid.min_width, self.grid.colour_gap
        squares = _windowed(self._regions(units), width, np.logical_and)
        swept = width + gap
        beyond = (swept - 1, swept - 1)
        area = _windowed(np.pad(squares, ((0, 0), beyond, beyond)), swept, np.logical_or).sum(axis=(1, 2), dtype=float)
        root = sum(part**0.5 for part in self.rules.ratio)
        # Areas of ratio_k x, which sum to 3 x: 3 x + 2 gap root sqrt(x) + 3 gap^2 = area.
        rest = np.maximum(area - 3 * gap**2, 0)
        side = (np.sqrt((gap * root) ** 2 + 3 * rest) - gap * root) / 3
        return np.asarray(side**2 * self.share_of_cell)

    @property
    def share_of_cell(self) -> float:
        """Area of a cell of the emitters' grid over that of the pixel."""
        return (self.grid.cell_nm / self.grid.pitch_nm) ** 2

    def _regions(self, units: Mask) -> Mask:
        return free_region(units, self.grid, self.orientations, margin=border_margin(self.grid))


def _windowed(cells: Mask, width: int, both: np.ufunc) -> Mask:
    """[k, n - width + 1, n - width + 1]: all (``logical_and``) or any of the ``width`` x ``width`` cells from there."""
    for axis in (1, 2):
        parts = np.lib.stride_tricks.sliding_window_view(cells, width, axis=axis)
        cells = np.asarray(both.reduce(parts, axis=-1))
    return cells


def footprints_of(constraints: Constrained, asked: EmitterRules) -> Footprints:
    """Footprints of openings that are asked for by constraints."""
    return Footprints(asked, constraints.dots, constraints.dot_nm, constraints.orientations)


def _crowded(constraints: Constrained, unit: Mask) -> str | None:
    display: Display = constraints["circuits"]
    return display.crowded(unit, constraints.dot_nm)


def _by_closed_area(constraints: Constrained) -> Conflict | None:
    """The circuits need more than what the count leaves closed."""
    need_um2 = constraints["circuits"].rules.least_circuits_um2
    crowd = _crowd(constraints, need_um2, f"circuits of {need_um2:g} um^2")
    return None if crowd is None else Conflict(("circuits", "clear_dots"), crowd)


def _crowd(constraints: Constrained, need_um2: float, what: str) -> str | None:
    """Words on how much the closed area is too small for something; None if it is not."""
    closed = (constraints.dots**2 - constraints.clear_dots) * (constraints.dot_nm / NM_PER_UM) ** 2
    if need_um2 <= closed * (1 + _ROUNDING):
        return None
    return f"{what} need {need_um2 - closed:.0f} um^2 more than the {closed:.0f} um^2 of the pixel that are closed"


def _on_dots(constraints: Constrained, given: Display) -> Display:
    given.crowded(constraints.nothing, constraints.dot_nm)
    return given


def _dark(constraints: Constrained, unit: Mask) -> str | None:
    display: Display = constraints["emitters"]
    return misfit(display.without_wires(display.panel(unit, constraints.dot_nm)))


def _dark_quickly(constraints: Constrained, unit: Mask) -> str | None:
    asked = constraints["emitters"].rules.emitters
    share = footprints_of(constraints, asked)(unit, enough=asked.required - _ROUNDING)
    if share >= asked.required - _ROUNDING:
        return None
    if constraints["emitters"].crooked and share >= _NEARLY * asked.required:
        return _dark(constraints, unit)
    return f"{share:.1%} found, least {asked.required:.1%}"


def _by_room(constraints: Constrained) -> Conflict | None:
    """Three emitters cover more than what the count leaves closed, or do not fit even a pixel without an opening."""
    asked = constraints["emitters"].rules.emitters
    pixel_um2 = (constraints.dots * constraints.dot_nm / NM_PER_UM) ** 2
    emitters = f"three emitters of {asked.required:.1%} of the pixel"
    if (crowd := _crowd(constraints, 3 * asked.required * pixel_um2, emitters)) is not None:
        return Conflict(("emitters", "clear_dots"), crowd)
    answer = constraints["emitters"].without_opening(constraints.nothing, constraints.dot_nm)
    if answer is None or answer.footprint.verdict is not Verdict.DOES_NOT_FIT or answer.footprint.certificate is None:
        return None
    proof = answer.footprint.certificate
    return Conflict(
        ("emitters",),
        f"even a pixel without an opening has room for at most {answer.footprint.bound_share:.1%} of each colour, not "
        f"{asked.required:.1%}: {proof.statement}",
        proof,
    )


def _not_fitting_beside(constraints: Constrained, units: Mask) -> bool:
    """Whether it does not fit a die whose cells draw one of two openings."""
    display: Display = constraints["emitters"]
    dense, sparse = units
    return display.broken_in_trial(display.die(dense, constraints.dot_nm, None, sparse)) is not None


def _on_cells(constraints: Constrained, given: Display) -> Display:
    _ = footprints_of(constraints, given.rules.emitters).grid
    return given


def _unwired(constraints: Constrained, unit: Mask) -> str | None:
    """Why the whole display does not fit, so that emitters without a way to the pixel's side count too."""
    display: Display = constraints["wires"]
    cells = np.zeros(_LEAST_ALIKE, dtype=np.int8) if display.wired is Wired.REGULAR else display.cells
    panel = display.panel(unit, constraints.dot_nm, cells)
    return display.unwired(unit, constraints.dot_nm) or display.broken_in_trial(panel)


def _unwired_quickly(constraints: Constrained, unit: Mask) -> str | None:
    display: Display = constraints["wires"]
    return display.unwired(unit, constraints.dot_nm)


def _by_lines(constraints: Constrained) -> Conflict | None:
    """Not even a pixel without an opening can be wired, or its lines close more than the count leaves closed."""
    display: Display = constraints["wires"]
    pitch_nm = CellSize(constraints.dots, constraints.dot_nm).pitch_nm
    lines = display.lines_told(pitch_nm)
    regular = display if display.wired is Wired.TILING else display.wired_as(Wired.REGULAR)
    if regular.unwired(constraints.nothing, constraints.dot_nm) is not None:
        return Conflict(("wires",), f"not even a pixel without an opening can be wired: {lines}")
    if display.rules.wires is None or display.opaque_lines < 1:
        return None
    # A section across a row of pixels meets each of its lines, and between any two either a space or an opening that
    # keeps its clearance from both; the last one of a row has no next.
    rules, many = display.rules.wires.rules, display.opaque_lines
    shut_nm = many * rules.line_nm + (many - 1) * min(rules.space_nm, 2 * rules.clearance_nm)
    most = (pitch_nm - shut_nm) * pitch_nm // constraints.dot_nm**2
    if constraints.clear_dots <= most:
        return None
    return Conflict(("wires", "clear_dots"), f"beside {lines}, no more than {most} dots are clear")


def _off_centre(constraints: Constrained, unit: Mask) -> str | None:
    limit, display = constraints["centroid_px"], constraints["emitters"]
    answer = display.lit(unit, constraints.dot_nm)
    if answer is None or answer.emitters is None:
        return "no emitters were found whose light has a centroid"
    away = math.hypot(*answer.centroid_px)
    return f"the light's centroid is {away:.3f} pixels off, at most {limit:g}" if away > limit else None


def _grainy(constraints: Constrained, unit: Mask) -> str | None:
    limit, display = constraints["slow_grain"], constraints["emitters"]
    grain = display.grain(unit, constraints.dot_nm)
    if grain is None:
        return "no emitters were found whose light has a grain"
    return f"the slow grain of an even field is {grain:.4f}, at most {limit:g}" if grain > limit else None


_FIT = partial(Rule, unit="", one_place=lambda _: True, slow=True, section=SearchSection, key="fit")

CIRCUITS = _FIT("circuits", check=_crowded, proof=_by_closed_area, checked=_on_dots, asker="the circuits of [emitters]")

EMITTERS = _FIT(
    "emitters",
    check=_dark,
    quick=_dark_quickly,
    proof=_by_room,
    beside=_not_fitting_beside,
    checked=_on_cells,
    asker="the emitters of [emitters]",
)

WIRES = _FIT("wires", check=_unwired, quick=_unwired_quickly, proof=_by_lines, asker="the lines of [wires]")

CENTROID = Rule("centroid_px", "pixels", _off_centre, one_place=lambda _: True, slow=True)
GRAIN = Rule("slow_grain", "", _grainy, one_place=lambda _: True, slow=True)
DISPLAY_RULES = CIRCUITS, EMITTERS, WIRES, CENTROID, GRAIN
"""In the order in which they are judged."""

OF_THE_EYE = CENTROID.name, GRAIN.name, "grain", "delta_e"
"""Rules of the emitters' light, the dearest to judge; the last two are those of :mod:`maskfab.designs.rules.eye`."""


def most_beside(units: Mask, cells: Labels, dot_nm: int, rules: WireRules) -> Ints:
    """Lines for every pixel that can be laid along x and along y, at most, [units].

    Args:
        units: bool [units, dots, dots], some of each clear; cells have no gutter.
        cells: orientations of the panel, [rows, columns].
    """
    pieces = []
    for unit in units:
        labels, count = ndimage.label(unit, structure=_TOUCHING)
        pieces.append(unit if count == 1 else labels == np.bincount(labels.ravel())[1:].argmax() + 1)
    single = np.stack(pieces)
    turned = np.stack([orient(single.transpose(1, 2, 0), kind) for kind in range(ORIENTATIONS)])
    upright = turned.transpose(3, 0, 1, 2)
    along_y = _passing(upright, cells % ORIENTATIONS, dot_nm, rules)
    along_x = _passing(upright.swapaxes(2, 3), cells.T % ORIENTATIONS, dot_nm, rules)
    return np.minimum(along_y, along_x)


def _passing(patterns: Mask, cells: Labels, dot_nm: int, rules: WireRules) -> Ints:
    """Lines for every pixel that pass every row of cells, [units], of patterns [units, orientations, dots, dots]."""
    dots = patterns.shape[-1]
    lane, pitch = rules.line_nm + rules.space_nm, dots * dot_nm
    held = np.asarray(patterns.any(axis=2))
    left, right = held.argmax(axis=2), dots - 1 - held[:, :, ::-1].argmax(axis=2)
    first, last = (_ends(patterns, column) for column in (left, right))
    beside = left[:, None, :] + dots - right[:, :, None]

    def between(up: int) -> Ints:
        """From the last column of one to the first column of the next, which lies so many cells higher."""
        apart: Ints = last[:, :, None, :, None] - first[:, None, :, None, :] - up * dots
        above = np.abs(apart).min(axis=(3, 4))
        gap = (np.maximum(beside, above) - 1) * dot_nm
        return np.asarray(np.maximum((gap + rules.space_nm - 2 * rules.clearance_nm) // lane, 0))

    tables = {up: between(up) for up in (-1, 0, 1)}
    spare = pitch + rules.space_nm - rules.clearance_nm
    before = np.maximum((left * dot_nm + spare) // lane, 0)
    after = np.maximum(((dots - 1 - right) * dot_nm + spare) // lane, 0)
    rows, columns = cells.shape
    total = before[:, cells[:, 0]]
    for column in range(columns - 1):
        reached = np.full_like(total, np.iinfo(np.int64).max)
        for up, table in tables.items():
            here = np.arange(max(0, -up), rows - max(0, up))
            passing = total[:, here] + table[:, cells[here, column], cells[here + up, column + 1]]
            reached[:, here + up] = np.minimum(reached[:, here + up], passing)
        total = reached
    return np.asarray((total + after[:, cells[:, -1]]).min(axis=1) // columns)


def _ends(patterns: Mask, column: Indices) -> Indices:
    """Lowest and highest clear dot of a column of each pattern, [units, orientations, 2]."""
    dots = patterns.shape[-1]
    clear = np.take_along_axis(patterns, column[:, :, None, None], axis=3)[..., 0]
    return np.stack([clear.argmax(axis=2), dots - 1 - clear[:, :, ::-1].argmax(axis=2)], axis=2)


@dataclass(frozen=True)
class DieFit:
    """A check of a display on a die.

    Attributes:
        across: pixels along a side of the die.
        side_um: of these pixels together.
        seed: of the die that the display fits; None if it fits none.
        failed: why it does not fit dies of other seeds, by seed, as they were tried.
    """

    across: int
    side_um: float
    seed: int | None
    failed: dict[int, str]
    seconds: float

    @property
    def why(self) -> str | None:
        """Why it fits no die, of the first that was tried; None if it fits one."""
        return None if self.seed is not None else self.first_failure

    @property
    def first_failure(self) -> str | None:
        """Why it does not fit the first that it does not; None if that fits."""
        return next(iter(self.failed.values()), None)


def fitting_die(
    display: Display,
    unit: Mask,
    dot_nm: int,
    cells: CellMap | None = None,
    outer: Mask | None = None,
    *,
    most: int = SEEDS,
    progress: Progress = silent,
) -> DieFit:
    """The first die that a display fits: of its own seed, and of those that follow.

    What the seed does not change is not tried again: a die that the map covers, a periodic one, and a map that does not
    hold the display even by itself.

    Args:
        unit: bool [dots, dots].
        cells: the opening's map; None for none.
        outer: the opening beside it, bool [dots, dots]; None for none.

    Raises:
        JobError: as :func:`maskfab.display.feasibility.feasibility`.
    """
    start = time.process_time()
    failed: dict[int, str] = {}
    fitting: int | None = None
    for seed, die in _dies(display, unit, dot_nm, cells, outer, most):
        progress("die", len(failed), most)
        why = display.broken_on(die)
        if why is None:
            fitting = seed
            break
        failed[seed] = why
        if cells is not None and len(failed) == 1 and most > 1:
            alone = replace(display, across=max(cells.cells.shape))
            if alone.across < display.across and alone.broken_on(alone.die(unit, dot_nm, cells, outer)) is not None:
                break
    progress("die", most, most)
    side_um = display.across * len(unit) * dot_nm / NM_PER_UM
    return DieFit(display.across, side_um, fitting, failed, time.process_time() - start)


def _dies(
    display: Display, unit: Mask, dot_nm: int, cells: CellMap | None, outer: Mask | None, most: int
) -> Iterator[tuple[int, Panel]]:
    first: Panel | None = None
    for seed in range(display.seed, display.seed + most):
        die = replace(display, seed=seed).die(unit, dot_nm, cells, outer)
        if first is not None and np.array_equal(die.orientations, first.orientations):
            return
        first = first or die
        yield seed, die
