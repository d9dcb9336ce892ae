"""A letter F: no mirror or turn carries it into itself, so it shows how a plate lies."""

from __future__ import annotations

from maskfab.model import CLEAR, Furniture, Point

_OUTLINE = ((0, 0), (1, 0), (1, 2), (2, 2), (2, 3), (1, 3), (1, 4), (3, 4), (3, 5), (0, 5))
WIDTH, HEIGHT = 3, 5
"""Of the letter, in widths of its stroke."""


def parity_mark(name: str, corner_nm: Point, height_nm: int) -> Furniture:
    """The letter with its lower left corner there; its area is 8 squares of a fifth of the height."""
    unit = height_nm // HEIGHT
    polygon = tuple((corner_nm[0] + x * unit, corner_nm[1] + y * unit) for x, y in _OUTLINE)
    return Furniture(name, "parity", CLEAR, (polygon,))
