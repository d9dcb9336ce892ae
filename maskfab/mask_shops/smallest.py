"""Smallest features and spaces of a plate, of openings and marks apart: what a house judges and prices it by."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

from maskfab.drc.panel_rules import Narrowest, Tone, narrowest
from maskfab.drc.plate_rules import check_plate
from maskfab.drc.rules import DesignRules
from maskfab.model import Die, Furniture, Plate
from maskfab.units import NM_PER_UM

FINE_ON_PURPOSE = ("resolution", "code")
"""Kinds of marks that show how fine a writer is, or that only a camera reads."""

_FIRST_NM, _LAST_NM = 2_000, 512_000


@dataclass(frozen=True)
class Smallest:
    """Least widths of one kind of shapes.

    Attributes:
        of: which shapes, for people.
        fine: whether they are fine on purpose.
        clear_um: least width of what is clear; infinite where nothing is narrower than half a millimetre, 0 where
            it tapers to a point.
        chrome_um: least width of the chrome between them, likewise.
    """

    of: str
    fine: bool
    clear_um: float
    chrome_um: float

    @property
    def least_um(self) -> float:
        """The lesser of both; a corner that tapers to a point has no width that anybody could hold."""
        return min((width for width in (self.clear_um, self.chrome_um) if width), default=math.inf)

    def __str__(self) -> str:
        return f"clear {_told(self.clear_um)}, chrome between {_told(self.chrome_um)}"


def smallest_features(plate: Plate, of_die: Callable[[Die, Tone], Narrowest] = narrowest) -> tuple[Smallest, ...]:
    """Least widths on a plate that is :func:`maskfab.mask_shops.adapt.fitted`, measured between edges of its polygons.

    Corners that only meet have a rule of their own and do not count.

    Args:
        plate: what is written.
        of_die: as :func:`maskfab.drc.panel_rules.narrowest`, from which it may be kept.

    Returns:
        Those of the openings; of the marks and letters; and of the marks that are fine on purpose. Kinds of which the
        plate has none are left out.
    """
    found = []
    if plate.dies:
        clear, chrome = (
            min(of_die(die, tone).value_nm / NM_PER_UM for die in plate.dies) for tone in ("clear", "opaque")
        )
        found.append(Smallest("openings", False, clear, chrome))
    marks = [mark for mark in plate.furniture if mark.layer.written]
    for told, fine in (("marks and letters", False), ("test figures, fine on purpose", True)):
        kept = tuple(mark for mark in marks if (mark.kind in FINE_ON_PURPOSE) == fine)
        if kept:
            found.append(Smallest(told, fine, *(_least_um(plate, kept, rule) for rule in ("width", "space"))))
    return tuple(found)


def _least_um(plate: Plate, marks: tuple[Furniture, ...], rule: str) -> float:
    """Least width or space of marks, looked for ever further: near distances are found in far less time."""
    alone, reach = replace(plate, dies=(), furniture=marks), _FIRST_NM
    while reach <= _LAST_NM:
        clear = rule == "width"
        rules = DesignRules(min_width_nm=reach if clear else None, min_space_nm=None if clear else reach, kissing=False)
        values = [each.value for each in check_plate(alone, rules, most=1) if not each.passed]
        if values:
            return min(float(value) for value in values if isinstance(value, int | float)) / NM_PER_UM
        reach *= 4
    return math.inf


def _told(width_um: float) -> str:
    if not width_um:
        return "tapering to a point"
    return f"{width_um:.6g} um" if math.isfinite(width_um) else f"wider than {_LAST_NM / NM_PER_UM:g} um"
