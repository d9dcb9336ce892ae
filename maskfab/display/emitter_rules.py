"""Emitter rules of a display maker, the square grid on which they are whole numbers, and the answer about a pixel.

An answer is a placement, a proof that there is none, or the bracket between the best known of both.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum

from maskfab.base.arrays import Mask
from maskfab.base.cell_size import MOST_CELLS, CellSize
from maskfab.base.errors import JobError
from maskfab.base.model import Emitters, Frozen, Opening, Point
from maskfab.base.units import NM_PER_UM


@dataclass(frozen=True)
class EmitterRules:
    """The rules of placement. Gaps are Chebyshev distances: kept in x or in y, also from corner to corner.

    Attributes:
        gap_to_opening_nm: least distance from an emitter to any opening, that of neighbouring pixels included.
        colour_gap_nm: least distance between emitters of different colours, across pixels too.
        min_width_nm: every emitter is a union of squares of this side joined by shifts along x or y.
        ratio: relative areas of red, green and blue, scaled so that they sum to 3.
        required: least footprint: the mean share of the pixel, gutter included, that one colour covers.
        max_aspect: longest over shortest side of a rectangular emitter; infinity allows any.
    """

    gap_to_opening_nm: int
    colour_gap_nm: int
    min_width_nm: int
    ratio: tuple[float, float, float] = (1.0, 1.0, 1.0)
    required: float = 0.0
    max_aspect: float = math.inf

    def __post_init__(self) -> None:
        total = math.fsum(self.ratio)
        if len(self.ratio) != 3 or not (math.isfinite(total) and min(self.ratio) > 0):
            what = f"the ratio {self.ratio} is not three positive numbers"
            cure = "Give the relative areas of red, green and blue, such as [1, 1, 2]"
            raise JobError("MF116", what, where="emitters.ratio", cure=cure)
        object.__setattr__(self, "ratio", tuple(3 * part / total for part in self.ratio))


@dataclass(frozen=True)
class EmitterGrid:
    """A pixel as square cells along its side less the gutter; the opening and every rule are whole numbers of them."""

    cells: int
    cell_nm: int
    per_dot: int
    gutter_nm: int
    to_opening: int
    colour_gap: int
    min_width: int

    @property
    def pitch_nm(self) -> int:
        return CellSize(self.cells, self.cell_nm, self.gutter_nm).pitch_nm

    @property
    def gutter(self) -> int:
        """The gutter in cells."""
        return self.gutter_nm // self.cell_nm


def finest_cell(dots: int, dot_nm: int, most: int = MOST_CELLS) -> int:
    """The smallest cell, in nanometres, that divides a dot and leaves no more than so many of them along a pixel."""
    return next(dot_nm // parts for parts in range(max(1, most // dots), 0, -1) if dot_nm % parts == 0)


def check_widths(rules: EmitterRules, side_nm: int, *, where: str) -> None:
    """Refuse rules that are wider than a pixel less its gutter. Raises JobError MF117."""
    side = f"{side_nm / NM_PER_UM:g} um"
    for name, value in (
        ("gap_to_opening", rules.gap_to_opening_nm),
        ("colour_gap", rules.colour_gap_nm),
        ("min_width", rules.min_width_nm),
    ):
        if value > side_nm or value < 0 or (name == "min_width" and value == 0):
            what = f"{name} = {value / NM_PER_UM:g} um is not within the {side} of a pixel less its gutter"
            raise JobError("MF117", what, where=f"{where}.{name}", cure=f"Give a length up to {side}")


def grid_of(
    opening: Opening, dot_nm: int, gutter_nm: int, rules: EmitterRules, *, where: str = "emitters"
) -> EmitterGrid:
    """The coarsest grid on which the dots, the gutter and all rules are whole numbers of cells.

    Rectangles and squares that are largest under whole-number rules have whole-number corners, so nothing is lost.

    Raises:
        JobError: MF117 if a rule is wider than the pixel, MF118 if the grid would have more than 128 cells on a side.
    """
    side = CellSize(opening.dots, dot_nm, gutter_nm).dots_nm
    check_widths(rules, side, where=where)
    cell = math.gcd(dot_nm, gutter_nm, rules.gap_to_opening_nm, rules.colour_gap_nm, rules.min_width_nm)
    cells = side // cell
    if cells > MOST_CELLS:
        coarse = finest_cell(opening.dots, dot_nm)
        what = (
            f"dots of {dot_nm / NM_PER_UM:g} um and these rules are whole numbers only on a grid of "
            f"{cell / NM_PER_UM:g} um, {cells} cells a side; the limit is {MOST_CELLS}"
        )
        cure = f"Round the gaps, the width and the gutter to multiples of {coarse / NM_PER_UM:g} um"
        raise JobError("MF118", what, where=where, cure=cure)
    return EmitterGrid(
        cells,
        cell,
        dot_nm // cell,
        gutter_nm,
        rules.gap_to_opening_nm // cell,
        rules.colour_gap_nm // cell,
        rules.min_width_nm // cell,
    )


class Verdict(StrEnum):
    """UNKNOWN is an answer: no placement was found and no proof that there is none."""

    FITS = "FITS"
    DOES_NOT_FIT = "DOES NOT FIT"
    UNKNOWN = "UNKNOWN"


class Proof(StrEnum):
    """Why something cannot be."""

    NO_THREE_SQUARES = "no three squares"
    COMPONENT_PACKING = "component packing"
    SEPARATION = "separation"
    CIRCUIT_AREA = "circuit area"
    CIRCUIT_BOX = "circuit box"
    CIRCUIT_PACKING = "circuit packing"
    CIRCUIT_SEARCH = "circuit search"
    BORDER_PAIR = "border pair"
    FLOW = "flow"


@dataclass(frozen=True, eq=False)
class Certificate(Frozen):
    """A proof that something cannot be, which a reader can check by hand.

    Attributes:
        witness: bool [n, n] the cells to look at; None where there is nothing to draw.
        chain_nm: corners of a line across the panel to look along, from its lower left corner; none where the witness
            says it.
    """

    proof: Proof
    statement: str
    numbers: Mapping[str, float] = field(default_factory=dict)
    witness: Mask | None = None
    cell_nm: int = 0
    chain_nm: tuple[Point, ...] = ()


@dataclass(frozen=True, eq=False)
class Footprint:
    """Bracket of the largest footprint of three emitters.

    Attributes:
        found_share: its footprint (mean share of the pixel, gutter included, per colour; of the smallest relative to
            its ratio); 0 if none.
        bound_share: no placement under the rules has a larger one.
        certificate: why not, if the verdict is that it does not fit; also why ``bound_share`` is what it is.
    """

    verdict: Verdict
    best: Emitters | None
    found_share: float
    bound_share: float
    rectangles_share: float
    certificate: Certificate | None
    method: str
