"""Boards of squares that touch in their corners on purpose: an overdose joins the clear ones, too little parts them."""

from __future__ import annotations

from collections.abc import Sequence

from maskfab.model import CLEAR, Furniture, Gauge, Point
from maskfab.plate.marks.boxes import rectangle
from maskfab.plate.marks.mark import Drawn, multiple_name

_GAP_NM = 300_000


def checkerboards(name: str, centre_nm: Point, feature_nm: int, multiples: Sequence[float], squares: int) -> Drawn:
    """One board for each multiple of the smallest feature, from left to right, half of it clear.

    Args:
        name: first part of the names of boards and gauges.
        centre_nm: of the row of boards.
        feature_nm: the smallest feature of the plate.
        multiples: of it, the sides of the squares, rounded to nanometres.
        squares: along a side of a board.

    Returns:
        Boards, each with a gauge across a clear square near its middle.
    """
    sides = [round(feature_nm * multiple) for multiple in multiples]
    x = centre_nm[0] - (squares * sum(sides) + _GAP_NM * (len(sides) - 1)) // 2
    boards, gauges = [], []
    for multiple, side in zip(multiples, sides, strict=True):
        board, y = f"{name}_{multiple_name(multiple)}", centre_nm[1] - squares * side // 2
        boxes = [
            (x + i * side, y + j * side, x + (i + 1) * side, y + (j + 1) * side)
            for j in range(squares)
            for i in range(squares)
            if (i + j) % 2 == 0
        ]
        boards.append(Furniture(board, "resolution", CLEAR, tuple(rectangle(box) for box in boxes)))
        low = squares // 2 * side + side // 2
        gauges.append(Gauge(board.lower(), "x", (x + low, y + low), 2 * (side // 2), side))
        x += squares * side + _GAP_NM
    return Drawn(tuple(boards), tuple(gauges))
