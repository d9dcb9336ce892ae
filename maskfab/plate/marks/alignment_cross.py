"""The cross to which a panel is aligned under a microscope: found by its broad arms, set by its thin middle."""

from __future__ import annotations

from maskfab.model import CLEAR, Furniture, Point
from maskfab.plate.marks.arms import four_arms

_BROADER = 3


def alignment_cross(name: str, centre_nm: Point, length_nm: int, line_nm: int) -> Furniture:
    """A cross whose arms are thrice as broad in their outer half.

    Args:
        name: of the mark.
        centre_nm: of the cross.
        length_nm: from tip to tip, a multiple of 4.
        line_nm: width of the inner half of the arms, even and less than a sixth of the length.
    """
    arm, middle, half = length_nm // 2, length_nm // 4, line_nm // 2
    broad = _BROADER * half
    right = [(half, half), (half, middle), (broad, middle), (broad, arm)]
    return Furniture(
        name, "alignment", CLEAR, (four_arms(centre_nm, [*right, *((-x, y) for x, y in reversed(right))]),)
    )
