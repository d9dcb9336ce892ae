"""Single bars for critical dimensions."""

from __future__ import annotations

from collections.abc import Sequence

from maskfab.model import CLEAR, Furniture, Gauge, Point
from maskfab.plate.marks.boxes import box_at, rectangle
from maskfab.plate.marks.mark import Drawn, multiple_name

_CLEARANCE_NM = 200_000


def cd_bars(name: str, centre_nm: Point, feature_nm: int, multiples: Sequence[int], length_nm: int) -> Drawn:
    """Bars across x and across y at multiples of the smallest feature, each with the gauge that measures it.

    Args:
        name: first part of the names of bars and gauges.
        centre_nm: of the row of bars, which are two lengths apart.
        feature_nm: the smallest feature of the plate.
        multiples: of it, one pair of bars for each.
        length_nm: of a bar, at least 400 um for the widest to keep clear of a neighbour's gauge.
    """
    bars, gauges = [], []
    for column, multiple in enumerate(multiples):
        width = feature_nm * multiple
        offset = 2 * length_nm * (2 * column + 1 - len(multiples))
        for axis, middle in (("x", centre_nm[0] + offset - length_nm), ("y", centre_nm[0] + offset + length_nm)):
            place = (middle, centre_nm[1])
            size = (width, length_nm) if axis == "x" else (length_nm, width)
            bar = f"{name}_{axis.upper()}_{multiple_name(multiple)}"
            bars.append(Furniture(bar, "cd", CLEAR, (rectangle(box_at(place, size)),)))
            gauges.append(Gauge(bar.lower(), "x" if axis == "x" else "y", place, width // 2 + _CLEARANCE_NM, width))
    return Drawn(tuple(bars), tuple(gauges))
