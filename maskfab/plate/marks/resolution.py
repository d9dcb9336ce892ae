"""Test figures: bars, lines and spaces, stars, boards and corners, by which a writer's resolution is seen."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

from maskfab.model import CLEAR, Furniture, Gauge, Point, Polygon
from maskfab.plate.marks.drawing import DrawnMarks, box_at, multiple_name, rectangle

_CLEARANCE_NM = 200_000
_GAP_NM = 300_000
_LONGER = 6


def cd_bars(name: str, centre_nm: Point, feature_nm: int, multiples: Sequence[int], length_nm: int) -> DrawnMarks:
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
    return DrawnMarks(tuple(bars), tuple(gauges))


def line_space(
    name: str, centre_nm: Point, feature_nm: int, multiples: Sequence[float], lines: int, length_nm: int
) -> DrawnMarks:
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
    return DrawnMarks(tuple(figures), tuple(gauges))


def _lines(centre: Point, width: int, length: int, lines: int, *, upright: bool) -> Iterator[Polygon]:
    first = -((2 * lines - 1) * width) // 2
    for number in range(lines):
        across = first + 2 * number * width
        start, end = -(length // 2), length - length // 2
        box = (across, start, across + width, end) if upright else (start, across, end, across + width)
        yield rectangle((centre[0] + box[0], centre[1] + box[1], centre[0] + box[2], centre[1] + box[3]))


def inner_radius_nm(feature_nm: float, spokes: int) -> float:
    """Where spokes, as wide as the spaces between them, are one smallest feature wide along their chord."""
    return feature_nm / (2 * math.sin(math.pi / (2 * spokes)))


def siemens_star(name: str, centre_nm: Point, feature_nm: int, radius_nm: int, spokes: int) -> Furniture:
    """Clear spokes from where they are one smallest feature wide to a radius.

    Its grey middle shows what a writer resolves in every direction.

    A spoke is a trapezium between chords, its vertices rounded to nanometres; without rounding its area is
    ``(radius^2 - inner_radius^2) sin(pi / spokes) / 2``. A number of spokes that 4 divides makes the star the same
    after every turn by 90 degrees and every mirror.
    """
    inner = inner_radius_nm(feature_nm, spokes)
    return Furniture(
        name, "resolution", CLEAR, tuple(_spoke(centre_nm, inner, radius_nm, k, spokes) for k in range(spokes))
    )


def _spoke(centre: Point, inner: float, outer: float, number: int, spokes: int) -> Polygon:
    low, high = (_direction(4 * number + side, spokes) for side in (-1, 1))
    corners = ((inner, low), (outer, low), (outer, high), (inner, high))
    # To the millionth first: a corner that lies half-way between nanometres must not hang on the last bit of a sine.
    return tuple(
        (centre[0] + round(round(radius * x, 6)), centre[1] + round(round(radius * y, 6))) for radius, (x, y) in corners
    )


def _direction(steps: int, spokes: int) -> tuple[float, float]:
    """Cosine and sine of so many steps, of which a quarter turn has as many as the star has spokes.

    Both are taken from one eighth of the circle, so that its symmetries hold to the last bit.
    """
    quarters, rest = divmod(steps, spokes)
    eighth = min(rest, spokes - rest) * math.pi / (2 * spokes)
    x, y = math.cos(eighth), math.sin(eighth)
    if 2 * rest > spokes:
        x, y = y, x
    for _ in range(quarters % 4):
        x, y = -y, x
    return x, y


def checkerboards(name: str, centre_nm: Point, feature_nm: int, multiples: Sequence[float], squares: int) -> DrawnMarks:
    """One board for each multiple of the smallest feature, from left to right, half of it clear.

    Squares touch in their corners on purpose: an overdose joins the clear ones, too little parts them.

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
    return DrawnMarks(tuple(boards), tuple(gauges))


def corner_letters(name: str, centre_nm: Point, feature_nm: int, multiples: Sequence[float]) -> DrawnMarks:
    """One L for each multiple of the smallest feature, from left to right on one base line.

    An L has one corner of each kind, which show how far a writer rounds them.

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
    return DrawnMarks(tuple(letters), tuple(gauges))
