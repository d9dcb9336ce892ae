"""Marks of a plate: those by which it is placed, test figures by which a writer's resolution is seen, a data matrix
(ISO/IEC 16022) of what it was made from, and templates of blanks as they are sold with the marks that go on them.

A template is a file of export_templates/plates/. Places are the plate's: its centre is the origin, y points up. Every
mark has a room of its own, a box round its place, so that templates are judged without a job."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import cache, cached_property
from itertools import combinations
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from pydantic import BeforeValidator, Field

from maskfab.base import resources
from maskfab.base.arrays import Mask
from maskfab.base.errors import JobError, ManyFaultsError
from maskfab.base.model import CLEAR, Box, Die, Gauge, Mark, Point, Polygon
from maskfab.base.units import NM_PER_UM, to_nm
from maskfab.job.faults import parse_section
from maskfab.job.order import ChromeSide, Tone
from maskfab.job.toml import loads
from maskfab.job.values import DrawnText, Name, PlateLength, Section, length_um, refusing
from maskfab.mask.outlines import outline


@dataclass(frozen=True, eq=False)
class Setting:
    """A plate before its marks.

    Attributes:
        texts: of the title after its maker.
        signature: who made it from what.
        feature_nm: the smallest feature, of which test figures are multiples.
        chrome: side from which the plate reads right, marks included.
    """

    title: str
    texts: tuple[str, ...]
    signature: str
    digest: str
    blank_nm: int
    writable_nm: int
    die_pitch_nm: int
    dies: tuple[Die, ...]
    feature_nm: int
    tone: Tone = "clear"
    chrome: ChromeSide = "up"


@dataclass(frozen=True)
class DrawnMarks:
    """Marks with their gauges; most marks have none."""

    marks: tuple[Mark, ...]
    gauges: tuple[Gauge, ...] = ()


def multiple_name(multiple: float) -> str:
    """A multiple of the smallest feature as part of a cell's name: ``1_5X``."""
    return f"{multiple:g}".replace(".", "_") + "X"


def box_at(centre_nm: Point, size_nm: Point) -> Box:
    """The box of that width and height round a centre; an odd length reaches one nanometre more up or right."""
    x0, y0 = centre_nm[0] - size_nm[0] // 2, centre_nm[1] - size_nm[1] // 2
    return x0, y0, x0 + size_nm[0], y0 + size_nm[1]


def rectangle(box_nm: Box) -> Polygon:
    """The box as a polygon."""
    x0, y0, x1, y1 = box_nm
    return (x0, y0), (x1, y0), (x1, y1), (x0, y1)


def bounding_box(polygons: Iterable[Polygon]) -> Box:
    """The bounding box of at least one polygon."""
    xs, ys = zip(*(point for polygon in polygons for point in polygon), strict=True)
    return min(xs), min(ys), max(xs), max(ys)


def four_arms(centre_nm: Point, arm: Sequence[Point]) -> Polygon:
    """One outline from one arm and its three quarter turns.

    Args:
        centre_nm: what the arm is turned round.
        arm: counter-clockwise outline of the upper arm about (0, 0), from its right foot to its left one, where the
            next arm starts.
    """
    turned = [list(arm)]
    for _ in range(3):
        turned.append([(-y, x) for x, y in turned[-1]])
    points = dict.fromkeys(point for side in turned for point in side)
    return tuple((centre_nm[0] + x, centre_nm[1] + y) for x, y in points)


_BROADER = 3
_LETTER_F = ((0, 0), (1, 0), (1, 2), (2, 2), (2, 3), (1, 3), (1, 4), (3, 4), (3, 5), (0, 5))
WIDTH, HEIGHT = 3, 5
"""Sides of the letter, in widths of its stroke."""


def fiducial(name: str, centre_nm: Point, length_nm: int, line_nm: int) -> Mark:
    """A plain cross, of area ``(2 length - line) line`` for even lengths."""
    arm, half = length_nm // 2, line_nm // 2
    upper = [(half, half), (half, arm), (-half, arm), (-half, half)]
    return Mark(name, "fiducial", CLEAR, (four_arms(centre_nm, upper),))


def alignment_cross(name: str, centre_nm: Point, length_nm: int, line_nm: int) -> Mark:
    """A cross whose arms are thrice as broad in their outer half.

    The broad arms find a panel under a microscope, the thin middle sets it.

    Args:
        length_nm: from tip to tip, a multiple of 4.
        line_nm: width of the inner half of the arms, even and less than a sixth of the length.
    """
    arm, middle, half = length_nm // 2, length_nm // 4, line_nm // 2
    broad = _BROADER * half
    right = [(half, half), (half, middle), (broad, middle), (broad, arm)]
    return Mark(name, "alignment", CLEAR, (four_arms(centre_nm, [*right, *((-x, y) for x, y in reversed(right))]),))


def parity_mark(name: str, corner_nm: Point, height_nm: int) -> Mark:
    """A letter F, which no mirror or turn carries into itself, with its lower left corner there.

    Its area is 8 squares of a fifth of the height.
    """
    unit = height_nm // HEIGHT
    polygon = tuple((corner_nm[0] + x * unit, corner_nm[1] + y * unit) for x, y in _LETTER_F)
    return Mark(name, "parity", CLEAR, (polygon,))


_CLEARANCE_NM = 200_000
_GAP_NM = 300_000
_LONGER = 6


def cd_bars(name: str, centre_nm: Point, feature_nm: int, multiples: Sequence[int], length_nm: int) -> DrawnMarks:
    """Bars across x and across y at multiples of the smallest feature, each with the gauge that measures it.

    Args:
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
            bars.append(Mark(bar, "cd", CLEAR, (rectangle(box_at(place, size)),)))
            gauges.append(Gauge(bar.lower(), "x" if axis == "x" else "y", place, width // 2 + _CLEARANCE_NM, width))
    return DrawnMarks(tuple(bars), tuple(gauges))


def _in_a_row(
    name: str, centre_x: int, feature_nm: int, multiples: Sequence[float], side: Callable[[int], int]
) -> Iterator[tuple[str, int, int]]:
    """Name, width and left end of a row's figures, of which one is as broad as ``side`` tells of its width."""
    widths = [round(feature_nm * multiple) for multiple in multiples]
    x = centre_x - (sum(map(side, widths)) + _GAP_NM * (len(widths) - 1)) // 2
    for multiple, width in zip(multiples, widths, strict=True):
        yield f"{name}_{multiple_name(multiple)}", width, x
        x += side(width) + _GAP_NM


def line_space(
    name: str, centre_nm: Point, feature_nm: int, multiples: Sequence[float], lines: int, length_nm: int
) -> DrawnMarks:
    """One upright group (V) over one lying group (H) for each multiple, from left to right.

    Args:
        multiples: of it, the widths of lines and of the spaces between them, rounded to nanometres.
        lines: clear lines in a group.
        length_nm: shortest a line may be; lines are as long as their group is wide where that is more.

    Returns:
        Groups of area ``lines x width x length``, each with a gauge across its middle line.
    """

    def side(width: int) -> int:
        return max((2 * lines - 1) * width, length_nm)

    rise = (side(round(feature_nm * max(multiples))) + _GAP_NM) // 2
    figures, gauges = [], []
    for (_, width, left), multiple in zip(
        _in_a_row(name, centre_nm[0], feature_nm, multiples, side), multiples, strict=True
    ):
        for axis, y in (("V", centre_nm[1] + rise), ("H", centre_nm[1] - rise)):
            group, place = f"{name}_{axis}_{multiple_name(multiple)}", (left + side(width) // 2, y)
            polygons = tuple(_lines(place, width, side(width), lines, upright=axis == "V"))
            figures.append(Mark(group, "resolution", CLEAR, polygons))
            (x0, y0), _, (x1, y1), _ = polygons[lines // 2]
            middle = ((x0 + x1) // 2, (y0 + y1) // 2)
            # To the middle of the spaces on either side, short of the next line.
            gauges.append(Gauge(group.lower(), "x" if axis == "V" else "y", middle, 2 * (width // 2), width))
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


def siemens_star(name: str, centre_nm: Point, feature_nm: int, radius_nm: int, spokes: int) -> Mark:
    """Clear spokes from where they are one smallest feature wide to a radius.

    Its grey middle shows what a writer resolves in every direction.

    A spoke is a trapezium between chords, its vertices rounded to nanometres; without rounding its area is
    ``(radius^2 - inner_radius^2) sin(pi / spokes) / 2``. A number of spokes that 4 divides makes the star the same
    after every turn by 90 degrees and every mirror.
    """
    inner, polygons = inner_radius_nm(feature_nm, spokes), []
    for number in range(spokes):
        low, high = (_direction(4 * number + side, spokes) for side in (-1, 1))
        corners = ((inner, low), (radius_nm, low), (radius_nm, high), (inner, high))
        # To the millionth first: a corner half-way between nanometres must not hang on the last bit of a sine.
        offsets = ((round(round(radius * x, 6)), round(round(radius * y, 6))) for radius, (x, y) in corners)
        polygons.append(tuple((centre_nm[0] + x, centre_nm[1] + y) for x, y in offsets))
    return Mark(name, "resolution", CLEAR, tuple(polygons))


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
        multiples: of it, the sides of the squares, rounded to nanometres.
        squares: along a side of a board.

    Returns:
        Boards, each with a gauge across a clear square near its middle.
    """
    boards, gauges = [], []
    for board, side, x in _in_a_row(name, centre_nm[0], feature_nm, multiples, lambda side: squares * side):
        y = centre_nm[1] - squares * side // 2
        boxes = [
            (x + i * side, y + j * side, x + (i + 1) * side, y + (j + 1) * side)
            for j in range(squares)
            for i in range(squares)
            if (i + j) % 2 == 0
        ]
        boards.append(Mark(board, "resolution", CLEAR, tuple(rectangle(box) for box in boxes)))
        low = squares // 2 * side + side // 2
        gauges.append(Gauge(board.lower(), "x", (x + low, y + low), 2 * (side // 2), side))
    return DrawnMarks(tuple(boards), tuple(gauges))


def corner_letters(name: str, centre_nm: Point, feature_nm: int, multiples: Sequence[float]) -> DrawnMarks:
    """One L for each multiple of the smallest feature, from left to right on one base line.

    An L has one corner of each kind, which show how far a writer rounds them.

    Args:
        multiples: of it, the widths of the arms, rounded to nanometres; arms are six widths long.

    Returns:
        Letters of area 11 squares of their width, each with a gauge across its upright arm.
    """
    y = centre_nm[1] - _LONGER * round(feature_nm * max(multiples)) // 2
    letters, gauges = [], []
    for letter, width, x in _in_a_row(name, centre_nm[0], feature_nm, multiples, lambda width: _LONGER * width):
        length = _LONGER * width
        outline = ((0, 0), (length, 0), (length, width), (width, width), (width, length), (0, length))
        polygon = tuple((x + right, y + up) for right, up in outline)
        letters.append(Mark(letter, "resolution", CLEAR, (polygon,)))
        gauges.append(Gauge(letter.lower(), "x", (x + width // 2, y + length // 2), 2 * (width // 2), width))
    return DrawnMarks(tuple(letters), tuple(gauges))


def code_text(signature: str, digest: str) -> str:
    """``maskfab:<version>:<job hash>`` of a plate whose signature starts with program and version."""
    return ":".join((*signature.split("|", 1)[0].split(), digest))


def modules(text: str) -> Mask:
    """The square symbol of a text with its quiet zone, bool [y, x], row 0 lowest, True where it is light."""
    import zxingcpp

    symbol = zxingcpp.create_barcode(text, zxingcpp.BarcodeFormat.DataMatrix, force_square=True)
    return np.array(symbol.to_image(scale=1, add_quiet_zones=True))[::-1] > 127


def data_matrix(name: str, centre_nm: Point, text: str, module_nm: int) -> Mark:
    """The symbol in clear light modules; dark ones stay chrome."""
    light = modules(text)
    corner = centre_nm[0] - light.shape[1] * module_nm // 2, centre_nm[1] - light.shape[0] * module_nm // 2
    return Mark(name, "code", CLEAR, outline(light, module_nm, corner))


_FOLDER = "export_templates/plates"
_SMALLEST_MODULE_UM = 200
_LENGTH_PER_LINE = 8
_ROOM_PER_LINE = 50


def _signed(value: object) -> float:
    """Micrometres of a length that may point down or to the left."""
    if isinstance(value, str) and value.strip().startswith("-"):
        return -length_um(value.strip()[1:], zero_allowed=True)
    return length_um(value, zero_allowed=True)


def _module(value: object) -> float:
    side = length_um(value)
    if side < _SMALLEST_MODULE_UM:
        what = f"{value!r} is less than the {_SMALLEST_MODULE_UM} um that a camera reads"
        raise JobError("MF104", what, cure=f'Use module = "{_SMALLEST_MODULE_UM} um" or more')
    return side


Coordinate = Annotated[float, BeforeValidator(lambda value: refusing(_signed, value))]
Multiple = Annotated[float, Field(ge=1, le=20, allow_inf_nan=False)]
Multiples = Annotated[tuple[Multiple, ...], Field(min_length=1, max_length=12, strict=False)]


class MarkSection(Section):
    """[[mark]]: where a mark is, and the width and height of its room, both in micrometres."""

    name: Name
    at: Annotated[tuple[Coordinate, Coordinate], Field(strict=False)]
    room: Annotated[tuple[PlateLength, PlateLength], Field(strict=False)]

    @property
    def centre_nm(self) -> Point:
        x, y = self.at
        return to_nm(x), to_nm(y)

    @property
    def room_nm(self) -> Box:
        """The room in plate coordinates."""
        width, height = self.room
        return box_at(self.centre_nm, (to_nm(width), to_nm(height)))


class FiducialSection(MarkSection):
    """A plain cross."""

    kind: Literal["fiducial"]
    length: PlateLength
    line: PlateLength


class AlignmentSection(MarkSection):
    """A cross with a thin middle."""

    kind: Literal["alignment"]
    length: PlateLength
    line: PlateLength


class ParitySection(MarkSection):
    """A letter F."""

    kind: Literal["parity"]
    height: PlateLength


class TitleSection(MarkSection):
    """The title in letters of a height, and lines in small ones."""

    kind: Literal["title"]
    height: PlateLength
    small: PlateLength


class CodeSection(MarkSection):
    """A data matrix of the job's hash."""

    kind: Literal["data_matrix"]
    module: Annotated[float, BeforeValidator(lambda value: refusing(_module, value))]


class MapSection(MarkSection):
    """A drawing of the plate with the dies' names, as large as its room."""

    kind: Literal["die_map"]
    line: PlateLength


class BarsSection(MarkSection):
    """Bars for critical dimensions, at whole multiples of the smallest feature."""

    kind: Literal["cd_bars"]
    multiples: Annotated[
        tuple[Annotated[int, Field(ge=1, le=20)], ...], Field(min_length=1, max_length=12, strict=False)
    ]
    length: PlateLength


class LinesSection(MarkSection):
    """Groups of lines and spaces."""

    kind: Literal["line_space"]
    multiples: Multiples
    lines: int = Field(default=5, ge=2, le=50)
    length: PlateLength


class StarSection(MarkSection):
    """A Siemens star."""

    kind: Literal["siemens_star"]
    radius: PlateLength
    spokes: int = Field(default=36, ge=4, le=360, multiple_of=4)


class BoardSection(MarkSection):
    """Checkerboards for the dose."""

    kind: Literal["checkerboard"]
    multiples: Multiples
    squares: int = Field(default=10, ge=2, le=100, multiple_of=2)


class CornersSection(MarkSection):
    """Letters L for the rounding of corners."""

    kind: Literal["corners"]
    multiples: Multiples


AnyMark = Annotated[
    FiducialSection
    | AlignmentSection
    | ParitySection
    | TitleSection
    | CodeSection
    | MapSection
    | BarsSection
    | LinesSection
    | StarSection
    | BoardSection
    | CornersSection,
    Field(discriminator="kind"),
]


class PlateTemplate(Section):
    """A whole template.

    Attributes:
        source: where its numbers were published, or that they are a choice.
        blank: side of the square blank, micrometres.
        thickness: of the blank, micrometres.
        writable: side of the square that is written, centred on the blank, micrometres.
        mark: what goes on it besides dies, their labels and outlines.
    """

    summary: DrawnText = Field(min_length=1, max_length=120)
    source: str = Field(min_length=1)
    blank: PlateLength
    thickness: PlateLength
    writable: PlateLength
    mark: Annotated[tuple[AnyMark, ...], Field(strict=False)] = ()

    @cached_property
    def blank_nm(self) -> int:
        return to_nm(self.blank)

    @cached_property
    def writable_nm(self) -> int:
        return to_nm(self.writable)


def template_names() -> tuple[str, ...]:
    """The templates that this installation has, in order."""
    return tuple(sorted(path.stem for path in resources.path(_FOLDER).glob("*.toml")))


def plate_template(name: str, *, where: str = "") -> PlateTemplate:
    """A template by its name. Raises JobError MF124 if the file cannot be used, MF125 if there is none of that name."""
    if name not in template_names():
        what = f"there is no plate template {name!r}; there are {', '.join(template_names())}"
        raise JobError("MF125", what, where=where, cure="Use one of these, or state blank and writable")
    return _shipped(name)


@cache
def _shipped(name: str) -> PlateTemplate:
    """Read once: a comparison of houses asks for every template at each of them."""
    return load_template(resources.path(f"{_FOLDER}/{name}.toml"))


def load_template(path: Path) -> PlateTemplate:
    """A template from a file.

    Raises:
        JobError: MF124 with the file and the key, for text that is no TOML, a wrong key or value, a line too broad for
            its mark, two marks of one name, rooms that overlap, or a room beyond the writable area.
    """
    try:
        template = parse_section(PlateTemplate, loads(path.read_text(encoding="utf-8")), where=str(path))
        for place, what, length in _lengths(template):
            to_nm(length, where=f"{path}: {place}", name=what)
    except (ValueError, RecursionError) as error:
        raise _unusable(f"it is no TOML: {error}", str(path), "Mend the syntax there") from error
    except JobError as error:
        faults = [_unusable(fault.what, fault.where, fault.cure) for fault in error.faults]
        raise (faults[0] if len(faults) == 1 else ManyFaultsError(faults)) from error
    _check_lines(template, str(path))
    _check_rooms(template, str(path))
    return template


def _lengths(template: PlateTemplate) -> Iterator[tuple[str, str, float]]:
    """Every length of a template, which must lie on the database grid, with its key and its name."""
    for name in ("blank", "thickness", "writable"):
        yield name, name, getattr(template, name)
    for number, mark in enumerate(template.mark):
        place = f"mark[{number}]"
        for name, value in mark:
            if name in {"at", "room"}:
                yield from ((f"{place}.{name}", name, length) for length in value)
            elif isinstance(value, float):
                yield f"{place}.{name}", name, value


def _check_lines(template: PlateTemplate, where: str) -> None:
    """Lines that are too broad for their mark would make something else of it."""
    for number, mark in enumerate(template.mark):
        if isinstance(mark, FiducialSection | AlignmentSection):
            longest, what = mark.length / _LENGTH_PER_LINE, f"a {_LENGTH_PER_LINE}th of the length"
        elif isinstance(mark, MapSection):
            longest, what = min(mark.room) / _ROOM_PER_LINE, f"a {_ROOM_PER_LINE}th of the room"
        else:
            continue
        if mark.line > longest:
            raise _unusable(
                f"the line of {mark.name!r} is {mark.line:g} um wide; the limit is {what}, {longest:g} um",
                f"{where}: mark[{number}].line",
                "Use a thinner line",
            )


def _check_rooms(template: PlateTemplate, where: str) -> None:
    if template.writable > template.blank:
        what = f"the writable area of {template.writable:g} um is wider than the blank of {template.blank:g} um"
        raise _unusable(what, f"{where}: writable", "Use a smaller writable area")
    for name, count in Counter(mark.name for mark in template.mark).items():
        if count > 1:
            raise _unusable(f"{count} marks have the name {name!r}", f"{where}: mark", "Rename all but one")
    half = template.writable_nm // 2
    for number, mark in enumerate(template.mark):
        x0, y0, x1, y1 = mark.room_nm
        over = max(-half - x0, -half - y0, x1 - half, y1 - half)
        if over > 0:
            what = f"the room of {mark.name!r} leaves the writable area by {over / NM_PER_UM:g} um"
            raise _unusable(what, f"{where}: mark[{number}].at", "Move it inward, or make it smaller")
    for (_, one), (number, other) in combinations(enumerate(template.mark), 2):
        if overlap(one.room_nm, other.room_nm):
            what = f"the rooms of {one.name!r} and {other.name!r} overlap"
            raise _unusable(what, f"{where}: mark[{number}].at", "Move one of them")


def overlap(one: Box, other: Box) -> bool:
    """Whether two boxes share more than an edge."""
    return one[0] < other[2] and other[0] < one[2] and one[1] < other[3] and other[1] < one[3]


def _unusable(what: str, where: str, cure: str) -> JobError:
    return JobError("MF124", what, where=where, cure=cure)
