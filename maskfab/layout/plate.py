"""From a validated job to a plate: panels in their slots, and round them the marks of :mod:`maskfab.layout.furniture`.

Coordinates are the plate's: its centre is the origin, y points up, and the data read right with the chrome towards
the reader.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from maskfab import provenance
from maskfab.errors import JobError, SourceError
from maskfab.geometry.rules import smallest_runs
from maskfab.layout import maps
from maskfab.layout.furniture.clearances import check_clearances
from maskfab.layout.furniture.label import LABEL_NM
from maskfab.layout.furniture.plain import MARGIN_NM, SMALLEST_WRITABLE_NM, TITLE_HEIGHT_NM, plain
from maskfab.layout.furniture.setting import Setting
from maskfab.layout.furniture.template import PlateTemplate, plate_template
from maskfab.layout.furniture.templated import templated
from maskfab.layout.hexagonal import hexagonal_sheet
from maskfab.layout.tiling import orientations
from maskfab.model import Die, Note, Opening, Panel, Plate, Point, Stop, Tiling
from maskfab.optics.aperture import panel_aperture
from maskfab.optics.pupil import cut
from maskfab.spec import DieSection, JobSpec, PlateSection
from maskfab.units import NM_PER_UM, UM_PER_INCH, to_nm

_LARGEST_FEATURE_NM = 50_000
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
        JobError: MF105 if there is nothing to lay out, or neither a template nor a blank to do it on; MF106 or MF107 if
            a die's pitch is not its dots and gutter, or off the grid; MF108 if something is larger than its room; MF114
            if a stop is wider than its panel; MF124 to MF126 if the plate's template cannot be used, is unknown, or
            contradicts the job.
    """
    section, heading = spec.plate, spec.job
    if section is None or heading is None or not spec.die:
        missing = "[job]" if heading is None else "[plate]" if section is None else "[[die]]"
        raise JobError("MF105", f"the job has no {missing} section", where=where, cure=f"Add {missing}")
    template = None if section.template is None else plate_template(section.template, where=f"{where}: plate.template")
    blank_nm, writable_nm = (_side(section, template, key, where) for key in ("blank", "writable"))
    _check_rooms(section, template, len(spec.die), (blank_nm, writable_nm), where)
    pitch_nm = to_nm(section.die_pitch, where=f"{where}: plate.die_pitch", name="die_pitch")
    size_nm = to_nm(section.die_size, where=f"{where}: plate.die_size", name="die_size")
    centres = _slots(pitch_nm, section.columns, len(spec.die))
    dies = tuple(
        Die(die.name, die.label, _panel(die, openings[die.name], spec, section, f"{where}: die[{i}]"), centre, size_nm)
        for i, (die, centre) in enumerate(zip(spec.die, centres, strict=True))
    )
    setting = Setting(
        title=heading.title,
        signature=signature,
        digest=provenance.job_hash(spec.dump()),
        blank_nm=blank_nm,
        writable_nm=writable_nm,
        die_pitch_nm=pitch_nm,
        dies=dies,
        feature_nm=_smallest_feature_nm(dies),
    )
    drawn = plain(setting) if template is None else templated(template, setting, where=f"{where}: plate.template")
    check_clearances(dies, drawn.furniture, writable_nm, where=f"{where}: plate")
    corner = writable_nm // 2 - MARGIN_NM
    note = Note(signature, (-corner, -corner - MARGIN_NM // 2))
    return Plate(heading.name, heading.title, blank_nm, writable_nm, dies, drawn.furniture, drawn.gauges, (note,))


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
    stop = spec.camera.camera().stop
    if min(rows, columns) * pitch_nm < stop.diameter_um * 1e3:
        raise JobError(
            "MF114",
            f"die {die.name!r} is {min(rows, columns) * pitch_nm / 1e3:g} um wide, less than the stop of "
            f"{stop.diameter_um:g} um",
            where=where,
            cure="Use a larger plate.die_size or a smaller camera.stop",
        )
    check_size(cells, opening.dots, f"die {die.name!r}", where=where)
    if die.tiling is Tiling.HEXAGONAL:
        opening, rows, columns = hexagonal_sheet(opening, to_nm(section.die_size) // dot_nm, die.seed or 0), 1, 1
    if given is None:
        chosen = orientations(die.tiling, rows, columns, die.seed, openings=len(held), where=f"{where}.seed")
    else:
        chosen = maps.placed(given, rows, columns, die.seed, openings=len(held), where=f"{where}.map")
    panel = Panel(opening, dot_nm, gutter_nm, chosen, die.tiling, die.seed, others=tuple(others))
    check_light(panel, stop, where=where)
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
    if stop.shape not in ("circle", "square"):
        if cut(panel_aperture(panel, stop.diameter_um / 2), stop).energy_um2 > 0:
            return
        raise SourceError(
            "MF309",
            f"nothing of the opening {panel.opening.name!r} is clear inside a stop, the {stop.shape} of "
            f"{stop.diameter_um:g} um",
            where=where,
            cure="Use a larger stop",
        )
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


def _side(section: PlateSection, template: PlateTemplate | None, key: str, where: str) -> int:
    """Blank or writable area in nanometres, from the job or its template, which do not contradict each other."""
    stated: float | None = getattr(section, key)
    given: float | None = None if template is None else getattr(template, key)
    chosen = given if stated is None else stated
    if chosen is None:
        raise JobError(
            "MF105",
            f"the key 'plate.{key}' is missing, and no template says it",
            where=f"{where}: plate.{key}",
            cure=f'Add {key}, or template = "5in"',
        )
    if given is not None and abs(chosen - given) * NM_PER_UM > 1e-6:
        raise JobError(
            "MF126",
            f"{key} is {chosen:.10g} um, and the template {section.template!r} says {given:.10g} um",
            where=f"{where}: plate.{key}",
            cure=f"Remove {key}, or the template",
        )
    return to_nm(chosen, where=f"{where}: plate.{key}", name=key)


def _check_rooms(
    section: PlateSection, template: PlateTemplate | None, count: int, sides_nm: tuple[int, int], where: str
) -> None:
    """Refuse what cannot fit (MF108) before panels are made; marks of a template are looked at when they are drawn."""
    blank_nm, writable_nm = sides_nm
    if template is None and writable_nm < SMALLEST_WRITABLE_NM:
        raise JobError(
            "MF108",
            f"title and marks need a writable area of {SMALLEST_WRITABLE_NM / 1e6:g} mm, but it has "
            f"{writable_nm / 1e6:g} mm",
            where=f"{where}: plate.writable",
            cure=f'Use writable = "{SMALLEST_WRITABLE_NM / 1e6:g} mm" or more',
        )
    columns = min(section.columns, count)
    rows = -(-count // columns)
    marks_nm = 2 * (2 * MARGIN_NM + TITLE_HEIGHT_NM) if template is None else 0
    left = "the writable area less title and marks" if template is None else "the writable area"
    across, room_um = max(columns, rows), (writable_nm - marks_nm) / 1e3
    grid = f"{left}, for {rows} x {columns} dies,"
    smaller = "Use smaller or fewer dies"
    rooms = (
        ("writable", writable_nm / 1e3, blank_nm / 1e3, "the blank", "Use a smaller writable, or a larger blank"),
        # As close as their labels let them lie: if that is too much, no die_pitch helps.
        ("die_size", (across - 1) * (section.die_size + LABEL_NM / 1e3) + section.die_size, room_um, grid,
         f"{smaller}, other columns, or a larger plate"),
        ("die_size", section.die_size, section.die_pitch - LABEL_NM / 1e3, "its slot less the label",
         "Use smaller dies, or a wider die_pitch"),
        ("die_pitch", (across - 1) * section.die_pitch + section.die_size, room_um, grid,
         f"{smaller}, a closer die_pitch, or a larger plate"),
    )  # fmt: skip
    for key, size, limit, what, cure in rooms:
        if size > limit:
            raise JobError(
                "MF108",
                f"{key} needs {size:g} um, but {what} leaves {limit:g} um",
                where=f"{where}: plate.{key}",
                cure=cure,
            )


def _slots(pitch_nm: int, most_columns: int, count: int) -> list[Point]:
    """Centres of the dies' slots, row by row from the top left, the whole grid centred on the plate."""
    columns = min(most_columns, count)
    rows = -(-count // columns)
    left, top = -(columns - 1) * pitch_nm // 2, (rows - 1) * pitch_nm // 2
    return [(left + (i % columns) * pitch_nm, top - (i // columns) * pitch_nm) for i in range(count)]


def _smallest_feature_nm(dies: tuple[Die, ...]) -> int:
    """The shortest clear run of any opening, as laid out; a dot where an opening has no run that ends.

    At most 50 um, so that test figures of its multiples keep clear of each other.
    """

    def shortest(panel: Panel) -> int:
        run = min(smallest_runs(opening.mask, periodic=True).clear for opening in panel.openings)
        return panel.dot_nm * (round(run) if math.isfinite(run) else 1)

    return min(_LARGEST_FEATURE_NM, *(shortest(die.panel) for die in dies))
