"""The cross in a corner, by which a plate is registered."""

from __future__ import annotations

from maskfab.model import CLEAR, Furniture, Point
from maskfab.plate.marks.arms import four_arms


def fiducial(name: str, centre_nm: Point, length_nm: int, line_nm: int) -> Furniture:
    """A plain cross, of area ``(2 length - line) line`` for even lengths."""
    arm, half = length_nm // 2, line_nm // 2
    upper = [(half, half), (half, arm), (-half, arm), (-half, half)]
    return Furniture(name, "fiducial", CLEAR, (four_arms(centre_nm, upper),))
