"""Drive circuits as boxes: transistors, capacitors and contacts that are placed under the emitters, or a proof that
they have no place.

A panel that emits upwards has its circuits under its emitters, so that boxes lie anywhere in closed area. Every pixel
is drawn alike and holds circuits of its own, which turn with it; where pixels take turns at one, so many fewer. Boxes
keep their gaps to each other, to the openings of their pixel and, in every orientation in use, to those of its
neighbours. From a border they stay half the gap, less half the gutter, so that those of any two neighbours keep it too.
Gaps are Chebyshev distances. An island of closed dots among openings holds none, for no line leads there.

Notes:
    Boxes are placed on a grid on which dots, sizes and gaps are whole numbers, and nothing is lost. Where that has more
    than 512 cells along a pixel, places are sought on a coarser one with sizes and gaps rounded up, and proofs are made
    on one with all rounded down. Lines within a circuit, vias, and gaps from boxes to wires are not modelled.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
import scipy

from maskfab.base.arrays import Mask
from maskfab.base.model import ORIENTATIONS, CircuitBox, Opening, Panel, refined
from maskfab.base.units import NM_PER_UM
from maskfab.display.box_packing import Kind, Packed, Packing, Place, Shortage
from maskfab.display.circuit_boxes import BoxRules, check_boxes
from maskfab.display.emitter_rules import Certificate, EmitterGrid, Proof, Verdict, finest_cell
from maskfab.display.free_area import free_region
from maskfab.display.polygon_check import Violation, circuit_violations

MOST_CELLS = 512
"""Cells along a pixel's side on which boxes are placed."""
NODES = 500
"""Boxes that a search may lay before it gives up."""
_MOST_NAMED = 4
"""Kinds of box that a proof names."""
_FEW_CELLS = 64
"""Cells along a pixel's side of the coarse grid that is tried first: most circuits that fit do so on it."""


@dataclass(frozen=True, eq=False)
class Circuits:
    """Answer on the circuits of a pixel; ``certificate`` says why not all can be placed, if that is known."""

    verdict: Verdict
    boxes: tuple[CircuitBox, ...]
    wanted: int
    area_um2: float
    certificate: Certificate | None
    cell_nm: int
    broken: tuple[Violation, ...] = ()

    @property
    def told(self) -> str:
        """Words on how many boxes were placed."""
        if self.verdict is Verdict.FITS:
            return f"all {self.wanted} boxes of a pixel placed"
        found = f"{len(self.boxes)} of {self.wanted} boxes of a pixel placed"
        return f"{found}, and more cannot be" if self.certificate else f"{found}; whether all can be is not known"


def place_circuits(panel: Panel, opening: Opening, rules: BoxRules) -> Circuits:
    """Boxes of a pixel of a panel in their places and measured, a proof that they have none, or neither."""
    pixel = _Pixel.of(panel, opening, rules)
    grid, found, proof = pixel.quick()
    if proof is not None:
        found = grid.packing.quickly()
    if proof is None and not found.complete:
        found = grid.packing.placed(nodes=NODES)
        if found.exhausted and pixel.exact:
            proof = _by_search(grid, rules)
    boxes = _drawn(grid, found.places, rules, panel.gutter_nm // 2)
    verdict = Verdict.FITS if found.complete else Verdict.DOES_NOT_FIT if proof else Verdict.UNKNOWN
    broken = circuit_violations(replace(panel, circuits=boxes), rules) if boxes else ()
    return Circuits(verdict, boxes, rules.boxes, rules.area_um2, proof, grid.cell_nm, broken)


def no_place(panel: Panel, opening: Opening, rules: BoxRules) -> Certificate | None:
    """A proof, by what costs little, that the boxes of a pixel have no place; None where there is none."""
    _, _, proof = _Pixel.of(panel, opening, rules).quick()
    return proof


class _Grid(NamedTuple):
    """Boxes on a grid, and the side of its cells."""

    packing: Packing
    cell_nm: int


@dataclass(frozen=True, eq=False)
class _Pixel:
    """A pixel in which boxes are placed."""

    panel: Panel
    opening: Opening
    rules: BoxRules
    used: tuple[int, ...]
    cell_nm: int
    exact: bool

    @classmethod
    def of(cls, panel: Panel, opening: Opening, rules: BoxRules) -> _Pixel:
        """Its finest grid is the coarsest on which all lengths are whole numbers, or the finest that is allowed."""
        dot_nm, gutter_nm = panel.dot_nm, panel.gutter_nm
        check_boxes(rules, opening.dots * dot_nm)
        # Neighbours' openings matter where the gap reaches over the gutter.
        beyond_nm = gutter_nm if rules.to_opening_nm > gutter_nm else 0
        sides = [side for kind in rules.kinds for side in (kind.width_nm, kind.height_nm)]
        margin_nm = rules.margin_nm(gutter_nm)
        cell_nm = math.gcd(dot_nm, rules.gap_nm, rules.to_opening_nm, beyond_nm, margin_nm, *sides)
        exact = opening.dots * dot_nm // cell_nm <= MOST_CELLS
        if not exact:
            cell_nm = finest_cell(opening.dots, dot_nm, MOST_CELLS)
        used = tuple(int(k) for k in np.unique(panel.orientations % ORIENTATIONS))
        return cls(panel, opening, rules, used, cell_nm, exact)

    def quick(self) -> tuple[_Grid, Packed, Certificate | None]:
        """Places by a rule of thumb, first on a coarse grid; or a proof, whichever comes at less cost."""
        coarse_nm = finest_cell(self.opening.dots, self.panel.dot_nm, _FEW_CELLS)
        if coarse_nm > self.cell_nm:
            coarse = self._grid(coarse_nm, up=True)
            found = coarse.packing.by_groups()
            if found.complete:
                return coarse, found, None
        inner = self._grid(self.cell_nm, up=True)
        outer = inner if self.exact else self._grid(self.cell_nm, up=False)
        lonely = outer.packing.homeless()
        if lonely is not None:
            return inner, Packed((), False), _no_place(outer, self.rules, lonely)
        short = outer.packing.short_of_area()
        found = Packed((), False) if short else inner.packing.quickly()
        if not short and not found.complete:
            short = outer.packing.shortage()
        return inner, found, None if short is None else _too_few(outer, self.rules, short)

    def _grid(self, cell_nm: int, *, up: bool) -> _Grid:
        rules = self.rules

        def cells(length_nm: int, *, more: bool = up) -> int:
            return -(-length_nm // cell_nm) if more else length_nm // cell_nm

        per_dot, gutter_nm = self.panel.dot_nm // cell_nm, self.panel.gutter_nm
        gutter = cells(gutter_nm, more=not up) * cell_nm
        to_opening, gap = cells(rules.to_opening_nm), cells(rules.gap_nm)
        grid = EmitterGrid(self.opening.dots * per_dot, cell_nm, per_dot, gutter, to_opening, gap, 1)
        free = free_region(self.opening.mask, grid, self.used, margin=cells(rules.margin_nm(gutter_nm)))
        free &= refined(_reached(~self.opening.mask), per_dot)
        kinds = tuple(
            Kind(
                rules.held * kind.count,
                (cells(kind.height_nm), cells(kind.width_nm)),
                (cells(kind.height_nm + rules.gap_nm), cells(kind.width_nm + rules.gap_nm)),
                rules.turnable and kind.width_nm != kind.height_nm,
            )
            for kind in rules.kinds
        )
        return _Grid(Packing(free, kinds, rules.held), cell_nm)


def _reached(closed: Mask) -> Mask:
    """Closed dots from which a chain of closed dots that share sides leads to the pixel's side."""
    pieces, _ = scipy.ndimage.label(closed)
    rim = np.concatenate([pieces[0], pieces[-1], pieces[:, 0], pieces[:, -1]])
    return np.asarray(np.isin(pieces, rim[rim > 0]))


def _drawn(grid: _Grid, places: tuple[Place, ...], rules: BoxRules, half_nm: int) -> tuple[CircuitBox, ...]:
    """Boxes in the pixel, with its gutter, of orientation 0; by circuit, the first of each kind to the first."""
    shapes = grid.packing.shapes
    found = []
    laid = [0] * len(rules.kinds)
    for index, row, column in places:
        kind = rules.kinds[shapes[index].kind]
        circuit = laid[shapes[index].kind] // kind.count
        laid[shapes[index].kind] += 1
        width, height = (kind.height_nm, kind.width_nm) if shapes[index].turned else (kind.width_nm, kind.height_nm)
        x, y = column * grid.cell_nm + half_nm, row * grid.cell_nm + half_nm
        found.append(CircuitBox(kind.name, circuit + 1, (x, y, x + width, y + height)))
    return tuple(sorted(found, key=lambda box: box.circuit))


def _by_search(grid: _Grid, rules: BoxRules) -> Certificate:
    statement = (
        f"A search that tried every place of every box, on a grid of {grid.cell_nm / NM_PER_UM:g} um on which "
        f"dots, sizes and gaps are whole numbers, found none for all {rules.boxes}"
    )
    numbers = {"boxes": float(rules.boxes)}
    return Certificate(Proof.CIRCUIT_SEARCH, statement, numbers, grid.packing.free, grid.cell_nm)


def _no_place(grid: _Grid, rules: BoxRules, number: int) -> Certificate:
    kind = rules.kinds[number]
    width, height = kind.width_nm / NM_PER_UM, kind.height_nm / NM_PER_UM
    free_um2 = float(grid.packing.free.sum()) * (grid.cell_nm / NM_PER_UM) ** 2
    turned = ", upright or on its side" if rules.turnable and width != height else ""
    statement = (
        f"The box {kind.name!r} of {width:g} x {height:g} um has no place in the {free_um2:g} um^2 of closed area "
        f"at least {rules.to_opening_nm / NM_PER_UM:g} um from openings{turned}"
    )
    numbers = {"width_um": width, "height_um": height, "free_um2": free_um2}
    return Certificate(Proof.CIRCUIT_BOX, statement, numbers, grid.packing.free, grid.cell_nm)


def _too_few(grid: _Grid, rules: BoxRules, short: Shortage) -> Certificate:
    *others, last = (repr(rules.kinds[number].name) for number in short.kinds)
    names = f"{', '.join(others)} and {last}" if others else last
    if len(short.kinds) > _MOST_NAMED:
        names = f"of {len(short.kinds)} kinds"
    many = sum(grid.packing.kinds[number].count for number in short.kinds)
    down, across = (cells * grid.cell_nm / NM_PER_UM for cells in short.spacing)
    numbers = {"boxes": float(many), "areas": float(short.areas)}
    where = "one connected area" if short.areas == 1 else f"{short.areas} separate areas"
    if short.spacing == (1, 1):
        cell_um2 = (grid.cell_nm / NM_PER_UM) ** 2
        need, room = short.covered * cell_um2, short.points * cell_um2
        statement = (
            f"With the gap between them the {many} boxes {names} take {need:g} um^2; wherever they may lie, in "
            f"{where}, they can cover {room:g} um^2"
        )
        numbers |= {"need_um2": need, "room_um2": room}
    else:
        statement = (
            f"Of points no more than {across:g} um apart along x and {down:g} um along y, the {many} boxes {names} "
            f"with the gap between them cover {short.covered} at least, each its own; wherever they may lie, in "
            f"{where}, there are {short.points}"
        )
        numbers |= {"need": float(short.covered), "points": float(short.points), "x_um": across, "y_um": down}
    return Certificate(Proof.CIRCUIT_PACKING, statement, numbers, short.marks, grid.cell_nm)
