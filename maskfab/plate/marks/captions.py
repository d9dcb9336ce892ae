"""Lines of text on the plate: the title block, and the label under a die."""

from __future__ import annotations

from collections.abc import Iterable

from maskfab.geometry.lettering import fitted_text
from maskfab.model import CLEAR, Die, Furniture, Point

LINE_FEED = 2
"""From line to line below the title, in heights of their letters."""
_HEIGHT_NM = 420_000
"""With strokes of 60 um, which film holds."""
_GAP_NM = 180_000
LABEL_NM = _GAP_NM + _HEIGHT_NM
"""Height that a label needs below a die's slot."""


def title_block(
    name: str, title: str, lines: Iterable[str], anchor_nm: Point, height_nm: int, small_nm: int, room_nm: int
) -> Furniture:
    """A title centred on the anchor, with lines of smaller letters below.

    Args:
        name: of the mark.
        title: first line.
        lines: further lines.
        anchor_nm: middle of the title's base line.
        height_nm: height of the title's letters.
        small_nm: height of the other letters.
        room_nm: widest that a line may be; a longer one is made smaller.
    """
    x, y = anchor_nm
    polygons = fitted_text(title, height_nm, anchor_nm, room_nm)
    for number, line in enumerate(lines, 1):
        polygons += fitted_text(line, small_nm, (x, y - LINE_FEED * small_nm * number), room_nm)
    return Furniture(name, "title", CLEAR, polygons)


def maker(signature: str) -> str:
    """Who made it from which job: the signature without its seeds."""
    return signature.rsplit("|", 1)[0].strip()


def label(die: Die) -> Furniture:
    """Name and label of a die, below its slot and not wider than it."""
    position = (die.centre_nm[0], die.centre_nm[1] - die.slot_nm // 2 - LABEL_NM)
    text = f"{die.name}  {die.label}"
    return Furniture(f"LABEL_{die.name}", "label", CLEAR, fitted_text(text, _HEIGHT_NM, position, die.slot_nm))
