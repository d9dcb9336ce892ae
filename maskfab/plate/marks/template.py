"""Plate templates: blanks as they are sold, and the marks that go on them.

A template is a file of export_templates/plates/. Places are the plate's: its centre is the origin, y points up. Every
mark has a room of its own, a box round its place, so that templates are judged without a job.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from functools import cache, cached_property
from itertools import combinations
from pathlib import Path
from typing import Annotated, Literal

from pydantic import BeforeValidator, Field

from maskfab import resources
from maskfab.errors import JobError
from maskfab.jobfile import parse_section
from maskfab.jobfile.problems import refusing
from maskfab.jobfile.section import Section
from maskfab.jobfile.toml import loads
from maskfab.jobfile.values import DrawnText, Name, PlateLength, length_um
from maskfab.model import Box, Point
from maskfab.plate.marks.drawing import box_at
from maskfab.units import NM_PER_UM, to_nm

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
        raise JobError(
            "MF104",
            f"{value!r} is less than the {_SMALLEST_MODULE_UM} um that a camera reads",
            cure=f'Use module = "{_SMALLEST_MODULE_UM} um" or more',
        )
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
        summary: one line that says what it is.
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
    """A template by its name.

    Args:
        name: one of :func:`template_names`.
        where: what asks for it, for errors.

    Raises:
        JobError: MF124 if the file cannot be used, MF125 if there is none of that name.
    """
    if name not in template_names():
        raise JobError(
            "MF125",
            f"there is no plate template {name!r}; there are {', '.join(template_names())}",
            where=where,
            cure="Use one of these, or state blank and writable",
        )
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
        raise _unusable(error.what, error.where, error.cure) from error
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
                yield from ((f"{place}.{name}", name, each) for each in value)
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
