"""Letters L, which have one corner of each kind: how far a writer rounds them."""

from __future__ import annotations

from collections.abc import Sequence

from maskfab.model import CLEAR, Furniture, Gauge, Point
from maskfab.plate.marks.mark import Drawn, multiple_name

_GAP_NM = 300_000
_LONGER = 6


def corner_letters(name: str, centre_nm: Point, feature_nm: int, multiples: Sequence[float]) -> Drawn:
    """One L for each multiple of the smallest feature, from left to right on one base line.

    Args:
        name: first part of the names of letters and gauges.
        centre_nm: of the row of letters.
        feature_nm: the smallest feature of the plate.
        multiples: of it, the widths of the arms, rounded to nanometres; arms are six widths long.

    Returns:
        Letters of area 11 squares of their width, each with a gauge across its upright arm.
    """
    widths = [round(feature_nm * multiple) for multiple in multiples]
    x = centre_nm[0] - (_LONGER * sum(widths) + _GAP_NM * (len(widths) - 1)) // 2
    y = centre_nm[1] - _LONGER * max(widths) // 2
    letters, gauges = [], []
    for multiple, width in zip(multiples, widths, strict=True):
        letter, length = f"{name}_{multiple_name(multiple)}", _LONGER * width
        outline = ((0, 0), (length, 0), (length, width), (width, width), (width, length), (0, length))
        polygon = tuple((x + right, y + up) for right, up in outline)
        letters.append(Furniture(letter, "resolution", CLEAR, (polygon,)))
        gauges.append(Gauge(letter.lower(), "x", (x + width // 2, y + length // 2), 2 * (width // 2), width))
        x += length + _GAP_NM
    return Drawn(tuple(letters), tuple(gauges))
