"""Groups of equal lines and spaces, upright and lying, by which a writer's resolution is seen."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from maskfab.model import CLEAR, Furniture, Gauge, Point, Polygon
from maskfab.plate.marks.boxes import rectangle
from maskfab.plate.marks.mark import Drawn, multiple_name

_GAP_NM = 300_000


def line_space(
    name: str, centre_nm: Point, feature_nm: int, multiples: Sequence[float], lines: int, length_nm: int
) -> Drawn:
    """One upright group (V) over one lying group (H) for each multiple, from left to right.

    Args:
        name: first part of the names of groups and gauges.
        centre_nm: of all groups together.
        feature_nm: the smallest feature of the plate.
        multiples: of it, the widths of lines and of the spaces between them, rounded to nanometres.
        lines: clear lines in a group.
        length_nm: shortest a line may be; lines are as long as their group is wide where that is more.

    Returns:
        Groups of area ``lines x width x length``, each with a gauge across its middle line.
    """
    widths = [round(feature_nm * multiple) for multiple in multiples]
    sides = [max((2 * lines - 1) * width, length_nm) for width in widths]
    x = centre_nm[0] - (sum(sides) + _GAP_NM * (len(sides) - 1)) // 2
    rise = (max(sides) + _GAP_NM) // 2
    figures, gauges = [], []
    for multiple, width, side in zip(multiples, widths, sides, strict=True):
        for axis, y in (("V", centre_nm[1] + rise), ("H", centre_nm[1] - rise)):
            group = f"{name}_{axis}_{multiple_name(multiple)}"
            place = (x + side // 2, y)
            polygons = tuple(_lines(place, width, side, lines, upright=axis == "V"))
            figures.append(Furniture(group, "resolution", CLEAR, polygons))
            (x0, y0), _, (x1, y1), _ = polygons[lines // 2]
            middle = ((x0 + x1) // 2, (y0 + y1) // 2)
            # To the middle of the spaces on either side, short of the next line.
            gauges.append(Gauge(group.lower(), "x" if axis == "V" else "y", middle, 2 * (width // 2), width))
        x += side + _GAP_NM
    return Drawn(tuple(figures), tuple(gauges))


def _lines(centre: Point, width: int, length: int, lines: int, *, upright: bool) -> Iterator[Polygon]:
    first = -((2 * lines - 1) * width) // 2
    for number in range(lines):
        across = first + 2 * number * width
        start, end = -(length // 2), length - length // 2
        box = (across, start, across + width, end) if upright else (start, across, end, across + width)
        yield rectangle((centre[0] + box[0], centre[1] + box[1], centre[0] + box[2], centre[1] + box[3]))
