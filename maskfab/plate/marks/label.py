"""The line of text under a die."""

from __future__ import annotations

from maskfab.geometry.lettering import fitted_text
from maskfab.model import CLEAR, Die, Furniture

_HEIGHT_NM = 400_000
_GAP_NM = 200_000

LABEL_NM = _GAP_NM + _HEIGHT_NM
"""Height that a label needs below a die's slot."""


def label(die: Die) -> Furniture:
    """Name and label of a die, below its slot and not wider than it."""
    position = (die.centre_nm[0], die.centre_nm[1] - die.slot_nm // 2 - LABEL_NM)
    text = f"{die.name}  {die.label}"
    return Furniture(f"LABEL_{die.name}", "label", CLEAR, fitted_text(text, _HEIGHT_NM, position, die.slot_nm))
