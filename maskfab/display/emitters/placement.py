"""Answer about a pixel: a placement, a proof that there is none, or the bracket between the best known of both."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray

from maskfab.model import Emitters, Point, frozen


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
    BORDER_PAIR = "border pair"
    FLOW = "flow"


@dataclass(frozen=True, eq=False)
class Certificate:
    """A proof that something cannot be, which a reader can check by hand.

    Attributes:
        proof: the kind.
        statement: one sentence with the numbers and their units.
        numbers: what the sentence was made from, by name.
        witness: bool [n, n] the cells to look at; None where there is nothing to draw.
        cell_nm: side of the witness's cells.
        chain_nm: corners of a line across the panel to look along, from its lower left corner; none where the witness
            says it.
    """

    proof: Proof
    statement: str
    numbers: Mapping[str, float] = field(default_factory=dict)
    witness: NDArray[np.bool_] | None = None
    cell_nm: int = 0
    chain_nm: tuple[Point, ...] = ()

    def __post_init__(self) -> None:
        if self.witness is not None:
            object.__setattr__(self, "witness", frozen(self.witness))


@dataclass(frozen=True, eq=False)
class Footprint:
    """Bracket of the largest footprint of three emitters.

    Attributes:
        verdict: whether the required footprint is reached.
        found: the best placement that keeps all rules; None if none was found.
        found_share: its footprint (mean share of the pixel, gutter included, per colour; of the smallest relative to
            its ratio); 0 if none.
        bound_share: no placement under the rules has a larger one.
        rectangles_share: the largest footprint of three rectangles, exact.
        certificate: why not, if the verdict is that it does not fit; also why ``bound_share`` is what it is.
        method: how ``found`` was found.
    """

    verdict: Verdict
    found: Emitters | None
    found_share: float
    bound_share: float
    rectangles_share: float
    certificate: Certificate | None
    method: str
