"""Marks by which a plate is placed: fiducials, alignment crosses, and the letter F that shows how it lies."""

from __future__ import annotations

from maskfab.model import CLEAR, Furniture, Point
from maskfab.plate.marks.drawing import four_arms

_BROADER = 3
_LETTER_F = ((0, 0), (1, 0), (1, 2), (2, 2), (2, 3), (1, 3), (1, 4), (3, 4), (3, 5), (0, 5))
WIDTH, HEIGHT = 3, 5
"""Of the letter, in widths of its stroke."""


def fiducial(name: str, centre_nm: Point, length_nm: int, line_nm: int) -> Furniture:
    """A plain cross, of area ``(2 length - line) line`` for even lengths."""
    arm, half = length_nm // 2, line_nm // 2
    upper = [(half, half), (half, arm), (-half, arm), (-half, half)]
    return Furniture(name, "fiducial", CLEAR, (four_arms(centre_nm, upper),))


def alignment_cross(name: str, centre_nm: Point, length_nm: int, line_nm: int) -> Furniture:
    """A cross whose arms are thrice as broad in their outer half.

    The broad arms find a panel under a microscope, the thin middle sets it.

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


def parity_mark(name: str, corner_nm: Point, height_nm: int) -> Furniture:
    """A letter F, which no mirror or turn carries into itself, with its lower left corner there.

    Its area is 8 squares of a fifth of the height.
    """
    unit = height_nm // HEIGHT
    polygon = tuple((corner_nm[0] + x * unit, corner_nm[1] + y * unit) for x, y in _LETTER_F)
    return Furniture(name, "parity", CLEAR, (polygon,))
