"""From a validated job to a plate: panels in their slots, and the marks a mask house and a lab need around them.

Coordinates are the plate's: its centre is the origin, y points up, and the data read right with the chrome towards
the reader.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from maskfab.errors import JobError, SourceError
from maskfab.geometry.lettering import text_polygons
from maskfab.geometry.rules import smallest_runs
from maskfab.layout import maps
from maskfab.layout.hexagonal import hexagonal_sheet
from maskfab.layout.tiling import orientations
from maskfab.model import (
    CLEAR,
    OUTLINE,
    Box,
    Die,
    Furniture,
    Gauge,
    Note,
    Opening,
    Panel,
    Plate,
    Point,
    Polygon,
    Stop,
    Tiling,
)
from maskfab.spec import DieSection, JobSpec, PlateSection
from maskfab.units import NM_PER_UM, UM_PER_INCH, to_nm

_LABEL_HEIGHT_NM = 400_000
_LABEL_GAP_NM = 200_000
_TITLE_HEIGHT_NM = 1_500_000
_MARGIN_NM = 2_000_000
_FIDUCIAL_NM = 1_000_000
_FIDUCIAL_LINE_NM = 50_000
_PARITY_NM = 2_000_000
_CD_MULTIPLES = (1, 2, 5)
_CD_LENGTH_NM = 500_000
_CD_CLEARANCE_NM = 200_000
_CD_LARGEST_NM = 50_000
_OUTLINE_LINE_NM = 20_000
_SMALLEST_WRITABLE_NM = 20_300_000
_MOST_CELLS_ACROSS = 1000
_MOST_DOTS_ACROSS = 10_000


def compose(spec: JobSpec, openings: Mapping[str, tuple[Opening, ...]], signature: str, *, where: str) -> Plate:
    """Lay a job out as a plate.

    Args:
        spec: a validated job with [plate] and at least one [[die]].
        openings: the openings of every die, by the die's name.
        signature: who made this from what, noted in the files.
        where: the job file, for errors.

    Raises:
        JobError: MF105 if there is nothing to lay out; MF106 or MF107 if a die's pitch is not its dots and gutter, or
            off the grid; MF108 if something is larger than its room; MF114 if a stop is wider than its panel.
    """
    section, heading = spec.plate, spec.job
    if section is None or heading is None or not spec.die:
        missing = "[job]" if heading is None else "[plate]" if section is None else "[[die]]"
        raise JobError("MF105", f"the job has no {missing} section", where=where, cure=f"Add {missing}")
    centres = _slots(section, len(spec.die), where)
    size_nm = to_nm(section.die_size, where=f"{where}: plate.die_size", name="die_size")
    dies = tuple(
        Die(die.name, die.label, _panel(die, openings[die.name], spec, section, f"{where}: die[{i}]"), centre, size_nm)
        for i, (die, centre) in enumerate(zip(spec.die, centres, strict=True))
    )
    blank_nm, writable_nm = to_nm(section.blank), to_nm(section.writable)
    corner = writable_nm // 2 - _MARGIN_NM
    bars, gauges = _cd_bars(_smallest_feature_nm(dies), (0, -corner))
    furniture = (
        _titles(heading.title, signature, corner, writable_nm - 4 * _MARGIN_NM),
        *(_label(die) for die in dies),
        *_fiducials(corner),
        _parity_mark((-corner + 2 * _MARGIN_NM, -corner)),
        *bars,
        *_outlines(blank_nm, writable_nm, dies),
    )
    note = Note(signature, (-corner, -corner - _MARGIN_NM // 2))
    return Plate(heading.name, heading.title, blank_nm, writable_nm, dies, furniture, gauges, (note,))


def _panel(die: DieSection, held: tuple[Opening, ...], spec: JobSpec, section: PlateSection, where: str) -> Panel:
    opening, *others = held
    dot_nm, gutter_nm = to_nm(die.dot), to_nm(die.gutter)
    pitch_nm = opening.dots * dot_nm + gutter_nm
    _check_pitch(die, opening.dots, pitch_nm, where)
    cells = to_nm(section.die_size) // pitch_nm
    if cells < 1:
        raise JobError(
            "MF108",
            f"die {die.name!r}: one cell of {pitch_nm / 1e3:g} um does not fit a die of {section.die_size:g} um",
            where=where,
            cure="Use a larger plate.die_size or a finer dot",
        )
    given = None if die.map is None else maps.parse(spec.maps[die.map], f"{where}.map")
    rows, columns = (cells, cells) if given is None else maps.panel_shape(given, cells, cells)
    if min(rows, columns) * pitch_nm < spec.camera.stop.diameter * 1e3:
        raise JobError(
            "MF114",
            f"die {die.name!r} is {min(rows, columns) * pitch_nm / 1e3:g} um wide, less than the stop of "
            f"{spec.camera.stop.diameter:g} um",
            where=where,
            cure="Use a larger plate.die_size or a smaller camera.stop.diameter",
        )
    check_size(cells, opening.dots, f"die {die.name!r}", where=where)
    if die.tiling is Tiling.HEXAGONAL:
        opening, rows, columns = hexagonal_sheet(opening, to_nm(section.die_size) // dot_nm, die.seed or 0), 1, 1
    if given is None:
        chosen = orientations(die.tiling, rows, columns, die.seed, openings=len(held), where=f"{where}.seed")
    else:
        chosen = maps.placed(given, rows, columns, die.seed, openings=len(held), where=f"{where}.map")
    panel = Panel(opening, dot_nm, gutter_nm, chosen, die.tiling, die.seed, others=tuple(others))
    check_light(panel, spec.camera.camera().stop, where=where)
    return panel


def dot_on_grid(pitch_um: float, gutter_um: float, dots: int, *, where: str) -> int:
    """Nanometres of the dot that a pitch is made of; a pitch off the database grid is told with its nearest (MF107)."""
    dot_nm = max(1, round((pitch_um - gutter_um) * NM_PER_UM / dots))
    reached = dots * dot_nm / NM_PER_UM + gutter_um
    if abs(reached - pitch_um) * NM_PER_UM > 1e-6:
        raise JobError(
            "MF107",
            f"pitch {pitch_um:.6f} um ({UM_PER_INCH / pitch_um:.2f} DPI) cannot be made of {dots} dots on the 1 nm "
            f"grid; the nearest is {reached:.10g} um = {UM_PER_INCH / reached:.4f} DPI, "
            f"{(reached - pitch_um) * NM_PER_UM:+.1f} nm or {(reached / pitch_um - 1) * 1e6:+.0f} ppm off",
            where=where,
            cure=f'Use dot = "{dot_nm / NM_PER_UM:g} um" and pitch = "{reached:.10g} um"',
        )
    return dot_nm


def check_size(cells: int, dots: int, what: str, *, where: str) -> None:
    """Refuse a panel of more cells or dots than can be drawn and compared (MF115)."""
    if cells > _MOST_CELLS_ACROSS or cells * dots > _MOST_DOTS_ACROSS:
        raise JobError(
            "MF115",
            f"{what} is {cells} cells or {cells * dots} dots across; the limits are {_MOST_CELLS_ACROSS} cells and "
            f"{_MOST_DOTS_ACROSS} dots",
            where=where,
            cure="Use a smaller panel, or a coarser dot",
        )


def check_light(panel: Panel, stop: Stop, *, where: str) -> None:
    """Refuse a stop, centred on the panel, that nothing clear lies in (MF309)."""
    pitch_um = panel.pitch_nm / NM_PER_UM
    if stop.diameter_um >= 3 * pitch_um:
        return  # it holds a whole cell, wherever it lies
    rows, columns = panel.orientations.shape
    gaps = []
    for row in range(max(0, rows // 2 - 3), min(rows, rows // 2 + 3)):
        for column in range(max(0, columns // 2 - 3), min(columns, columns // 2 + 3)):
            mask = panel.pattern(int(panel.orientations[row, column]))
            up, right = (
                (cell - cells / 2) * pitch_um + (panel.gutter_nm / 2 + index * panel.dot_nm) / NM_PER_UM
                for cell, cells, index in zip((row, column), (rows, columns), np.nonzero(mask), strict=True)
            )
            dot_um = panel.dot_nm / NM_PER_UM
            away = [np.maximum(0.0, np.maximum(low, -low - dot_um)) for low in (up, right)]
            gaps.append(float((np.hypot(*away) if stop.shape == "circle" else np.maximum(*away)).min()))
    if min(gaps) >= stop.diameter_um / 2:
        raise SourceError(
            "MF309",
            f"nothing of the opening {panel.opening.name!r} is clear inside a stop of {stop.diameter_um:g} um; the "
            f"nearest clear dot is {min(gaps):g} um from its centre",
            where=where,
            cure="Use a larger stop",
        )


def _check_pitch(die: DieSection, dots: int, pitch_nm: int, where: str) -> None:
    if die.pitch is None or abs(die.pitch * 1e3 - pitch_nm) < 1e-6:
        return
    dot_nm = dot_on_grid(die.pitch, die.gutter, dots, where=f"{where}.pitch")
    raise JobError(
        "MF106",
        f"{dots} dots x {die.dot:g} um + gutter {die.gutter:g} um = {pitch_nm / 1e3:g} um, but pitch says "
        f"{die.pitch:g} um",
        where=f"{where}.pitch",
        cure=f'Use dot = "{dot_nm / 1e3:g} um", or pitch = "{pitch_nm / 1e3:g} um"',
    )


def _slots(section: PlateSection, count: int, where: str) -> list[Point]:
    """Centres of the dies' slots, row by row from the top left, the whole grid centred on the plate."""
    pitch_nm = to_nm(section.die_pitch, where=f"{where}: plate.die_pitch", name="die_pitch")
    writable_nm = to_nm(section.writable, where=f"{where}: plate.writable", name="writable")
    blank_nm = to_nm(section.blank, where=f"{where}: plate.blank", name="blank")
    if writable_nm < _SMALLEST_WRITABLE_NM:
        raise JobError(
            "MF108",
            f"title and marks need a writable area of {_SMALLEST_WRITABLE_NM / 1e6:g} mm, but it has "
            f"{writable_nm / 1e6:g} mm",
            where=f"{where}: plate.writable",
            cure=f'Use writable = "{_SMALLEST_WRITABLE_NM / 1e6:g} mm" or more',
        )
    columns = min(section.columns, count)
    rows = -(-count // columns)
    label_nm = _LABEL_GAP_NM + _LABEL_HEIGHT_NM
    room = {
        "plate.die_size": (section.die_size, (pitch_nm - label_nm) / 1e3, "its slot less the label"),
        "plate.writable": (section.writable, blank_nm / 1e3, "the blank"),
        "plate.die_pitch": (
            (max(columns, rows) - 1) * section.die_pitch + section.die_size,
            (writable_nm - 2 * (2 * _MARGIN_NM + _TITLE_HEIGHT_NM)) / 1e3,
            f"the writable area less title and marks, for {rows} rows of {columns} dies",
        ),
    }
    for key, (size, limit, what) in room.items():
        if size > limit:
            raise JobError(
                "MF108",
                f"{key.split('.')[1]} needs {size:g} um, but {what} leaves {limit:g} um",
                where=f"{where}: {key}",
                cure="Use smaller or fewer dies, a closer die_pitch, or a larger plate",
            )
    left, top = -(columns - 1) * pitch_nm // 2, (rows - 1) * pitch_nm // 2
    return [(left + (i % columns) * pitch_nm, top - (i // columns) * pitch_nm) for i in range(count)]


def _smallest_feature_nm(dies: tuple[Die, ...]) -> int:
    """The shortest clear run of any opening, as laid out; a dot where an opening has no run that ends.

    At most 50 um, so that bars of its multiples keep clear of each other.
    """

    def shortest(panel: Panel) -> int:
        run = min(smallest_runs(opening.mask, periodic=True).clear for opening in panel.openings)
        return panel.dot_nm * (round(run) if math.isfinite(run) else 1)

    return min(_CD_LARGEST_NM, *(shortest(die.panel) for die in dies))


def _label(die: Die) -> Furniture:
    position = (die.centre_nm[0], die.centre_nm[1] - die.slot_nm // 2 - _LABEL_GAP_NM - _LABEL_HEIGHT_NM)
    text = f"{die.name}  {die.label}"
    return Furniture(f"LABEL_{die.name}", "label", CLEAR, _fitted_text(text, _LABEL_HEIGHT_NM, position, die.slot_nm))


def _titles(title: str, signature: str, corner: int, room_nm: int) -> Furniture:
    first = _fitted_text(title, _TITLE_HEIGHT_NM, (0, corner - _TITLE_HEIGHT_NM // 2), room_nm)
    small = _LABEL_HEIGHT_NM
    brief = signature.rsplit("|", 1)[0].strip() + " | digitized data = clear"
    second = _fitted_text(brief, small, (0, corner - _TITLE_HEIGHT_NM // 2 - 2 * small), room_nm)
    return Furniture("TITLE", "title", CLEAR, first + second)


def _fitted_text(text: str, height_nm: int, anchor_nm: Point, room_nm: int) -> tuple[Polygon, ...]:
    """Centred text, made smaller if it would be wider than its room."""
    polygons = text_polygons(text, height_nm, anchor_nm, align="centre")
    xs = [x for polygon in polygons for x, _ in polygon]
    width = max(xs) - min(xs) if xs else 0
    if width > room_nm:
        return text_polygons(text, height_nm * room_nm // width, anchor_nm, align="centre")
    return polygons


def _fiducials(corner: int) -> list[Furniture]:
    places = {"SW": (-corner, -corner), "SE": (corner, -corner), "NW": (-corner, corner), "NE": (corner, corner)}
    return [Furniture(f"FIDUCIAL_{name}", "fiducial", CLEAR, (_cross(place),)) for name, place in places.items()]


def _cross(centre: Point) -> Polygon:
    arm, half = _FIDUCIAL_NM // 2, _FIDUCIAL_LINE_NM // 2
    quarter = [(half, half), (half, arm), (-half, arm), (-half, half)]
    turned = [quarter]
    for _ in range(3):
        turned.append([(-y, x) for x, y in turned[-1]])
    points = dict.fromkeys(point for side in turned for point in side)
    return tuple((centre[0] + x, centre[1] + y) for x, y in points)


def _parity_mark(corner: Point) -> Furniture:
    """A letter F: no mirror or turn carries it into itself, so it shows how a plate lies."""
    unit = _PARITY_NM // 5
    outline = [(0, 0), (1, 0), (1, 2), (2, 2), (2, 3), (1, 3), (1, 4), (3, 4), (3, 5), (0, 5)]
    return Furniture(
        "PARITY", "parity", CLEAR, (tuple((corner[0] + x * unit, corner[1] + y * unit) for x, y in outline),)
    )


def _cd_bars(feature_nm: int, centre: Point) -> tuple[list[Furniture], tuple[Gauge, ...]]:
    """Bars across x and across y at multiples of the smallest feature, each with the gauge that measures it."""
    bars, gauges = [], []
    for column, multiple in enumerate(_CD_MULTIPLES):
        width = feature_nm * multiple
        offset = 2 * _CD_LENGTH_NM * (2 * column + 1 - len(_CD_MULTIPLES))
        for axis, middle in (("x", centre[0] + offset - _CD_LENGTH_NM), ("y", centre[0] + offset + _CD_LENGTH_NM)):
            place = (middle, centre[1])
            size = (width, _CD_LENGTH_NM) if axis == "x" else (_CD_LENGTH_NM, width)
            name = f"CD_{axis.upper()}_{multiple}X"
            bars.append(Furniture(name, "cd", CLEAR, (_rectangle(_box_at(place, size)),)))
            reach = width // 2 + _CD_CLEARANCE_NM
            gauges.append(Gauge(name.lower(), "x" if axis == "x" else "y", place, reach, width))
    return bars, tuple(gauges)


def _outlines(blank_nm: int, writable_nm: int, dies: tuple[Die, ...]) -> list[Furniture]:
    named = [("BLANK", (0, 0), blank_nm), ("WRITABLE", (0, 0), writable_nm)]
    named += [(f"SLOT_{die.name}", die.centre_nm, die.slot_nm) for die in dies]
    return [Furniture(f"OUTLINE_{name}", "outline", OUTLINE, _frame(place, side)) for name, place, side in named]


def _frame(centre: Point, side_nm: int) -> tuple[Polygon, ...]:
    """A thin square frame inside a square, as four bars."""
    x0, y0, x1, y1 = _box_at(centre, (side_nm, side_nm))
    line = _OUTLINE_LINE_NM
    bars = [(x0, y0, x1, y0 + line), (x0, y1 - line, x1, y1)]
    bars += [(x0, y0 + line, x0 + line, y1 - line), (x1 - line, y0 + line, x1, y1 - line)]
    return tuple(_rectangle(bar) for bar in bars)


def _box_at(centre: Point, size: Point) -> Box:
    x0, y0 = centre[0] - size[0] // 2, centre[1] - size[1] // 2
    return x0, y0, x0 + size[0], y0 + size[1]


def _rectangle(box: Box) -> Polygon:
    x0, y0, x1, y1 = box
    return (x0, y0), (x1, y0), (x1, y1), (x0, y1)
