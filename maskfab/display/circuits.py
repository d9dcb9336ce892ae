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
from functools import cached_property

import numpy as np
from scipy import ndimage

from maskfab.base.arrays import Mask
from maskfab.base.model import ORIENTATIONS, CircuitBox, Opening, Panel, refined
from maskfab.base.units import NM_PER_UM
from maskfab.display.box_packing import Kind, Packed, Packing, Place, Shortage
from maskfab.display.circuit_boxes import BoxRules, check_boxes
from maskfab.display.emitter_rules import Certificate, EmitterGrid, Proof, Verdict
from maskfab.display.free_area import free_region
from maskfab.display.polygon_check import Violation, circuit_violations

MOST_CELLS = 512
"""Cells along a pixel's side on which boxes are placed."""
NODES = 1500
"""Boxes that a search may lay before it gives up."""


@dataclass(frozen=True, eq=False)
class Circuits:
    """Answer on the circuits of a pixel.

    Attributes:
        verdict: whether all boxes have a place.
        boxes: those placed, as many as were found a place for.
        wanted: boxes of a pixel.
        area_um2: of those wanted.
        certificate: why not all can be placed; None if they are, or it is not known.
        cell_nm: side of the cells on which they were placed.
        broken: rules that their polygons break, measured by KLayout; empty where all is well.
    """

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
    """Boxes of a pixel of a panel in their places and measured, a proof that they have none, or neither.

    Args:
        panel: pitch, gutter and orientations.
        opening: what is clear in any of its openings.
        rules: of the circuits.

    Raises:
        JobError: MF117 as :func:`maskfab.display.circuit_boxes.check_boxes`.
    """
    grids = _Grids.of(panel, opening, rules)
    found, proof = grids.quick
    if proof is None and not found.complete:
        found = grids.inner.placed(nodes=NODES)
        if found.exhausted and grids.exact:
            proof = grids.by_search()
    boxes = grids.drawn(found.places)
    verdict = Verdict.FITS if found.complete else Verdict.DOES_NOT_FIT if proof else Verdict.UNKNOWN
    broken = circuit_violations(replace(panel, circuits=boxes), rules) if boxes else ()
    return Circuits(verdict, boxes, rules.boxes, rules.area_um2, proof, grids.cell_nm, broken)


def no_place(panel: Panel, opening: Opening, rules: BoxRules) -> Certificate | None:
    """A proof, by what costs little, that the boxes of a pixel have no place; None where there is none.

    Args:
        panel, opening, rules: as for :func:`place_circuits`.

    Raises:
        JobError: MF117 as :func:`place_circuits`.
    """
    return _Grids.of(panel, opening, rules).quick[1]


@dataclass(frozen=True, eq=False)
class _Grids:
    """Boxes on a grid.

    Attributes:
        rules: of the circuits.
        cell_nm: side of its cells.
        half_nm: half the gutter.
        inner: all lengths rounded up, on which boxes are placed.
        outer: all rounded down, on which proofs are made; the same where nothing is rounded.
    """

    rules: BoxRules
    cell_nm: int
    half_nm: int
    inner: Packing
    outer: Packing

    @classmethod
    def of(cls, panel: Panel, opening: Opening, rules: BoxRules) -> _Grids:
        """The coarsest grid on which dots, sizes and gaps are whole numbers, or the finest that is allowed."""
        dots, dot_nm, gutter_nm = opening.dots, panel.dot_nm, panel.gutter_nm
        check_boxes(rules, dots * dot_nm)
        # Neighbours' openings matter where the gap reaches over the gutter.
        beyond_nm = gutter_nm if rules.to_opening_nm > gutter_nm else 0
        sides = [side for kind in rules.kinds for side in (kind.width_nm, kind.height_nm)]
        margin_nm = rules.margin_nm(gutter_nm)
        cell_nm = math.gcd(dot_nm, rules.gap_nm, rules.to_opening_nm, beyond_nm, margin_nm, *sides)
        exact = dots * dot_nm // cell_nm <= MOST_CELLS
        if not exact:
            cell_nm = next(dot_nm // parts for parts in range(max(1, MOST_CELLS // dots), 0, -1) if dot_nm % parts == 0)
        inner = _packing(panel, opening, rules, cell_nm, up=True)
        outer = inner if exact else _packing(panel, opening, rules, cell_nm, up=False)
        return cls(rules, cell_nm, gutter_nm // 2, inner, outer)

    @property
    def exact(self) -> bool:
        return self.inner is self.outer

    @cached_property
    def quick(self) -> tuple[Packed, Certificate | None]:
        """Places by a rule of thumb, and where these are too few a proof, if there is one."""
        lonely = self.outer.homeless()
        if lonely is not None:
            return Packed((), False), self._no_place(lonely)
        found = self.inner.quickly()
        short = None if found.complete else self.outer.shortage()
        return found, None if short is None else self._too_few(short)

    def drawn(self, places: tuple[Place, ...]) -> tuple[CircuitBox, ...]:
        """Boxes in the pixel, with its gutter, of orientation 0; by circuit, the first of each kind to the first."""
        shapes = self.inner.shapes
        found = []
        laid = [0] * len(self.rules.kinds)
        for index, row, column in places:
            kind = self.rules.kinds[shapes[index].kind]
            circuit = laid[shapes[index].kind] // kind.count
            laid[shapes[index].kind] += 1
            width, height = (kind.height_nm, kind.width_nm) if shapes[index].turned else (kind.width_nm, kind.height_nm)
            x, y = column * self.cell_nm + self.half_nm, row * self.cell_nm + self.half_nm
            found.append(CircuitBox(kind.name, circuit + 1, (x, y, x + width, y + height)))
        return tuple(sorted(found, key=lambda box: box.circuit))

    def by_search(self) -> Certificate:
        """A proof by a search that has ended."""
        statement = (
            f"A search that tried every place of every box, on a grid of {self.cell_nm / NM_PER_UM:g} um on which "
            f"dots, sizes and gaps are whole numbers, found none for all {self.rules.boxes}"
        )
        numbers = {"boxes": float(self.rules.boxes)}
        return Certificate(Proof.CIRCUIT_SEARCH, statement, numbers, self.outer.free, self.cell_nm)

    def _no_place(self, number: int) -> Certificate:
        kind = self.rules.kinds[number]
        width, height = kind.width_nm / NM_PER_UM, kind.height_nm / NM_PER_UM
        free_um2 = float(self.outer.free.sum()) * (self.cell_nm / NM_PER_UM) ** 2
        turned = ", upright or on its side" if self.rules.turnable and width != height else ""
        statement = (
            f"The box {kind.name!r} of {width:g} x {height:g} um has no place in the {free_um2:g} um^2 of closed area "
            f"at least {self.rules.to_opening_nm / NM_PER_UM:g} um from openings{turned}"
        )
        numbers = {"width_um": width, "height_um": height, "free_um2": free_um2}
        return Certificate(Proof.CIRCUIT_BOX, statement, numbers, self.outer.free, self.cell_nm)

    def _too_few(self, short: Shortage) -> Certificate:
        names = " and ".join(repr(self.rules.kinds[number].name) for number in short.kinds)
        many = sum(self.outer.kinds[number].count for number in short.kinds)
        down, across = (cells * self.cell_nm / NM_PER_UM for cells in short.spacing)
        numbers = {"boxes": float(many), "areas": float(short.areas)}
        where = "one connected area" if short.areas == 1 else f"{short.areas} separate areas"
        if short.spacing == (1, 1):
            cell_um2 = (self.cell_nm / NM_PER_UM) ** 2
            need, room = short.covered * cell_um2, short.points * cell_um2
            statement = (
                f"With the gap between them the {many} boxes {names} take {need:g} um^2; wherever they may lie, in "
                f"{where}, they can cover {room:g} um^2"
            )
            numbers |= {"need_um2": need, "room_um2": room}
        else:
            statement = (
                f"Of points {across:g} um apart along x and {down:g} um along y, the {many} boxes {names} with the gap "
                f"between them cover {short.covered} at least, each its own; wherever they may lie, in {where}, they "
                f"can cover {short.points}"
            )
            numbers |= {"need": float(short.covered), "points": float(short.points), "x_um": across, "y_um": down}
        return Certificate(Proof.CIRCUIT_PACKING, statement, numbers, short.swept, self.cell_nm)


def _packing(panel: Panel, opening: Opening, rules: BoxRules, cell_nm: int, *, up: bool) -> Packing:
    """Boxes on a grid, sizes and gaps rounded up to its cells or down."""

    def cells(length_nm: int, *, more: bool = up) -> int:
        return -(-length_nm // cell_nm) if more else length_nm // cell_nm

    used = tuple(int(k) for k in np.unique(panel.orientations % ORIENTATIONS))
    per_dot, gutter_nm = panel.dot_nm // cell_nm, panel.gutter_nm
    gutter = cells(gutter_nm, more=not up) * cell_nm
    to_opening, gap = cells(rules.to_opening_nm), cells(rules.gap_nm)
    grid = EmitterGrid(opening.dots * per_dot, cell_nm, per_dot, gutter, to_opening, gap, 1)
    free = free_region(opening.mask, grid, used, margin=cells(rules.margin_nm(gutter_nm)))
    free &= refined(_reached(~opening.mask), per_dot)
    kinds = tuple(
        Kind(
            rules.held * kind.count,
            (cells(kind.height_nm), cells(kind.width_nm)),
            (cells(kind.height_nm + rules.gap_nm), cells(kind.width_nm + rules.gap_nm)),
            rules.turnable and kind.width_nm != kind.height_nm,
        )
        for kind in rules.kinds
    )
    return Packing(free, kinds, rules.held)


def _reached(closed: Mask) -> Mask:
    """Closed dots from which a chain of closed dots that share sides leads to the pixel's side."""
    pieces, _ = ndimage.label(closed)
    rim = np.concatenate([pieces[0], pieces[-1], pieces[:, 0], pieces[:, -1]])
    return np.asarray(np.isin(pieces, rim[rim > 0]))
