"""Drive of emitters: room for the circuits, and the cost of an emitter's area in current density and life.

A panel that emits upwards hides its circuits under its emitters and closed area. What counts is area at least
``min_width`` wide: the union of squares of that side that hold no opening.

    J_k = L s_k / (η_k a_k),   life ~ J^-n,

L the luminance of white, s_k the colour's share of it, η_k its efficacy and a_k its area as a share of the pixel.

Notes:
    Regimes: efficacy that does not fall with current, no loss in a polariser (divide η by its transmission), one
    ageing exponent for all colours. Extrapolated lives can be wrong by a factor of three.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import scipy

from maskfab.base.arrays import Mask
from maskfab.base.cell_size import MOST_CELLS
from maskfab.base.errors import JobError
from maskfab.base.model import COLOURS, Emitters, Opening, refined
from maskfab.base.units import NM_PER_UM
from maskfab.display.emitter_rules import Certificate, Proof, finest_cell
from maskfab.optics.colour import LUMINANCE

BY_AREA = "circuits by area alone: a bound, not placed"
NOT_PLACED = (
    "Circuits are judged by area alone: none is placed, and no gap between circuits and openings or wires is kept, so "
    "a display that fits may have no place for them"
)
"""A limit of every answer on a display whose job states no boxes of circuits."""
BY_BOXES = "circuits by the places of their boxes"
BOXES_ALONE = (
    "Boxes of circuits keep their gaps to each other and to openings; lines within a circuit, vias, and gaps from "
    "boxes to wires are left out"
)
"""A limit of every other one."""


@dataclass(frozen=True)
class CircuitRules:
    """Area rules of the drive circuits.

    Attributes:
        need_um2: area of the circuit and lines of one subpixel. 1985 um^2 is derived from a panel on sale: BOE
            BF060Y8M, a pixel pitch of 63 um with two subpixels each (green beside red or blue), 63² / 2.
        min_width_nm: narrower closed area holds no circuit. 8 um is a judgement.
    """

    need_um2: float = 1985.0
    circuits: int = 3
    shared_by: int = 1
    min_width_nm: int = 8000

    def __post_init__(self) -> None:
        if not (math.isfinite(self.need_um2) and self.need_um2 > 0):
            what = f"a circuit of {self.need_um2:g} um^2 is not positive"
            raise JobError("MF104", what, where="emitters.circuit", cure="Give an area above 0")

    @property
    def pixel_need_um2(self) -> float:
        return self.need_um2 * self.circuits / self.shared_by


@dataclass(frozen=True, eq=False)
class Room:
    """Area for circuits at least as wide as asked, all of it however narrow, and area needed."""

    area_um2: float
    closed_um2: float
    need_um2: float
    certificate: Certificate | None


def pixel_room(opening: Opening, dot_nm: int, rules: CircuitRules) -> Room:
    """Room of one pixel for all its circuits together, anywhere in the closed area between its dots; not the gutter.

    Raises:
        JobError: MF118 if dots and width are whole numbers only on a grid of more than 128 cells.
    """
    cell = math.gcd(dot_nm, rules.min_width_nm)
    if opening.dots * dot_nm // cell > MOST_CELLS:
        what = (
            f"dots of {dot_nm / NM_PER_UM:g} um and a width of {rules.min_width_nm / NM_PER_UM:g} um are whole numbers "
            f"only on a grid of {cell / NM_PER_UM:g} um; the limit is {MOST_CELLS} cells a side"
        )
        cure = f"Round the width to a multiple of {finest_cell(opening.dots, dot_nm) / NM_PER_UM:g} um"
        raise JobError("MF118", what, where="circuit.min_width", cure=cure)
    per_dot = dot_nm // cell
    closed = refined(~opening.mask, per_dot)
    return _room("the closed area", closed, cell, rules.min_width_nm // cell, rules.pixel_need_um2)


def emitter_rooms(emitters: Emitters, rules: CircuitRules) -> tuple[Room, Room, Room]:
    """Room under the red, the green and the blue emitter for a circuit of its own each."""
    if rules.min_width_nm % emitters.cell_nm:
        what = (
            f"a width of {rules.min_width_nm / NM_PER_UM:g} um is not a multiple of the emitters' "
            f"{emitters.cell_nm / NM_PER_UM:g} um"
        )
        raise JobError("MF118", what, where="circuit.min_width", cure="Round min_width to a multiple of that")
    width, need = rules.min_width_nm // emitters.cell_nm, rules.need_um2 / rules.shared_by
    red, green, blue = (
        _room(f"the {colour} emitter", emitters.labels == k, emitters.cell_nm, width, need)
        for k, colour in enumerate(COLOURS, start=1)
    )
    return red, green, blue


def _room(name: str, cells: Mask, cell_nm: int, width: int, need_um2: float) -> Room:
    square = np.ones((width, width), dtype=np.bool_)
    # Eroding and dilating about opposite ends of the square is the opening, also where its side is even.
    wide = scipy.ndimage.binary_opening(np.pad(cells, width), square)[width:-width, width:-width]
    area, closed = (float(part.sum()) * cell_nm**2 / 1e6 for part in (wide, cells))
    if area >= need_um2 * (1 - 1e-12):
        return Room(area, closed, need_um2, None)
    statement = (
        f"{name} holds {area:.0f} um^2 at least {width * cell_nm / NM_PER_UM:g} um wide ({closed:.0f} um^2 in all); "
        f"the circuits need {need_um2:.0f} um^2"
    )
    numbers = {"area_um2": area, "closed_um2": closed, "need_um2": need_um2}
    return Room(area, closed, need_um2, Certificate(Proof.CIRCUIT_AREA, statement, numbers, wide, cell_nm))


Triple = tuple[float, float, float]

SHARES: Triple = (float(LUMINANCE[0]), float(LUMINANCE[1]), float(LUMINANCE[2]))
"""Luminance of the primaries in white."""

MA_PER_CM2 = 0.1
"""1 A/m² in mA/cm²."""


@dataclass(frozen=True)
class LightDemand:
    """Light required of the emitters, and their efficacies.

    Attributes:
        luminance_cd_per_m2: of white. 500 is a judgement: a phone indoors.
        efficacy_cd_per_a: red, green and blue. 45, 110 and 8 are a judgement; no source was found.
        shares: red's, green's and blue's share of the luminance, by BT.709.
        ageing_exponent: n of life ~ J^-n. 1.44 is derived from a vendor's claim: three times the life at 60 % emitting
            area instead of 28 %, ln 3 / ln (60 / 28).
    """

    luminance_cd_per_m2: float = 500.0
    efficacy_cd_per_a: Triple = (45.0, 110.0, 8.0)
    shares: Triple = SHARES
    ageing_exponent: float = 1.44


def current_density(light: LightDemand, area_shares: Triple) -> Triple:
    """Current density of red, green and blue at white, in mA/cm²; ``area_shares`` are of the pixel with its gutter."""
    red, green, blue = (
        MA_PER_CM2 * light.luminance_cd_per_m2 * share / (efficacy * area)
        for share, efficacy, area in zip(light.shares, light.efficacy_cd_per_a, area_shares, strict=True)
    )
    return red, green, blue


def relative_life(density: float, reference: float, exponent: float = LightDemand.ageing_exponent) -> float:
    """Life at a current density over that at another: (J / J_ref)^-n."""
    return float((density / reference) ** -exponent)


FIXED_V = 5.0
"""Of the supply: 2.5 V at which an emitter turns on, and as much for the transistor that drives it. A judgement."""
RISING_V, AT_MA_PER_CM2 = 1.5, 10.0
"""More that an emitter takes at a current density, a judgement; current limited by space charge rises with the square
of its voltage (Mott and Gurney, 1940)."""


class Lives(NamedTuple):
    """A display over its reference: its light at equal current density, and at equal luminance life and power."""

    luminance: float
    life: float
    power: float


def lives(light: LightDemand, shares: Triple, reference: Triple) -> Lives:
    """Light, life and power of emitters beside those of a reference.

    Equal luminance takes equal current, for efficacies do not fall with its density. So power is as the voltage of the
    supply, which serves all colours and is that of the densest current: 5 V + 1.5 V (J / 10 mA/cm²)^½.
    """
    densest, usual = (max(current_density(light, areas)) for areas in (shares, reference))
    supply, usual_supply = (FIXED_V + RISING_V * math.sqrt(j / AT_MA_PER_CM2) for j in (densest, usual))
    left = min(own / other for own, other in zip(shares, reference, strict=True))
    return Lives(left, relative_life(densest, usual, light.ageing_exponent), supply / usual_supply)
