"""From a validated job to a plate: panels in their slots, and round them the marks of :mod:`maskfab.plate.marks`.

Coordinates are the plate's: its centre is the origin, y points up, and the chrome is towards the reader. Where [order]
asks for a design that reads right through the glass, all of it lies here as in a mirror.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

from maskfab import provenance
from maskfab.drc.raster_rules import smallest_runs
from maskfab.errors import JobError
from maskfab.jobfile import JobSpec, PlateSection
from maskfab.model import Die, Note, Opening, Panel, Plate, Point
from maskfab.plate.data_grid import check_dies, snapped
from maskfab.plate.marks.captions import LABEL_NM
from maskfab.plate.marks.clearances import check_clearances
from maskfab.plate.marks.drawing import Setting
from maskfab.plate.marks.plain import MARGIN_NM, SMALLEST_WRITABLE_NM, TITLE_HEIGHT_NM, plain_marks
from maskfab.plate.marks.template import PlateTemplate, plate_template
from maskfab.plate.marks.templated import templated
from maskfab.plate.mirrored import mirrored
from maskfab.plate.panels import die_panels, laid_out
from maskfab.units import NM_PER_UM, to_nm

_LARGEST_FEATURE_NM = 50_000


def compose(spec: JobSpec, openings: Mapping[str, tuple[Opening, ...]], signature: str, *, where: str) -> Plate:
    """Lay a job out as a plate.

    Args:
        spec: a validated job with [plate] and at least one [[die]].
        openings: the openings of every die, by the die's name.
        signature: who made this from what, noted in the files.
        where: the job file, for errors.

    Raises:
        JobError: MF105 if there is nothing to lay out, or neither a template nor a blank to do it on; MF106 or MF107 if
            a die's pitch is not its dots and gutter, or off the grid; MF104 for a data grid beyond 1 um; MF108 if
            something is larger than its room; MF114 if a stop is wider than its panel; MF124 to MF126 if the plate's
            template cannot be used, is unknown, or contradicts the job.
    """
    heading, section = laid_out(spec, where=where)
    template = None if section.template is None else plate_template(section.template, where=f"{where}: plate.template")
    blank_nm, writable_nm = (_side(section, template, key, where) for key in ("blank", "writable"))
    _check_rooms(section, template, len(spec.die), (blank_nm, writable_nm), where)
    pitch_nm = to_nm(section.die_pitch, where=f"{where}: plate.die_pitch", name="die_pitch")
    size_nm = to_nm(section.die_size, where=f"{where}: plate.die_size", name="die_size")
    centres = _slots(pitch_nm, section.columns, len(spec.die))
    panels = die_panels(spec, openings, where=where)
    dies = tuple(
        Die(die.name, die.label, panels[die.name], centre, size_nm)
        for die, centre in zip(spec.die, centres, strict=True)
    )
    setting = Setting(
        title=heading.title,
        signature=signature,
        digest=provenance.job_hash(spec.drawn()),
        blank_nm=blank_nm,
        writable_nm=writable_nm,
        die_pitch_nm=pitch_nm,
        dies=dies,
        feature_nm=_smallest_feature_nm(dies),
        tone=spec.tone,
        chrome="down" if spec.mirrored else "up",
    )
    drawn = plain_marks(setting) if template is None else templated(template, setting, where=f"{where}: plate.template")
    check_clearances(dies, drawn.furniture, writable_nm, where=f"{where}: plate")
    corner = writable_nm // 2 - MARGIN_NM
    note = Note(signature, (-corner, -corner - MARGIN_NM // 2))
    plate = Plate(heading.name, heading.title, blank_nm, writable_nm, dies, drawn.furniture, drawn.gauges, (note,))
    plate = mirrored(plate) if spec.mirrored else plate
    grid_um = None if spec.export is None else spec.export.grid
    if grid_um is None:
        return plate
    place = f"{where}: export.grid"
    grid_nm = to_nm(grid_um, where=place, name="grid")
    check_dies(plate.dies, grid_nm, where=place)
    return snapped(plate, grid_nm) if grid_nm > 1 else plate


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
    across, room_um = max(columns, rows), (writable_nm - marks_nm) / NM_PER_UM
    grid = f"{left}, for {rows} x {columns} dies,"
    smaller = "Use smaller or fewer dies"
    rooms = (
        ("writable", writable_nm / NM_PER_UM, blank_nm / NM_PER_UM, "the blank",
         "Use a smaller writable, or a larger blank"),
        # As close as their labels let them lie: if that is too much, no die_pitch helps.
        ("die_size", (across - 1) * (section.die_size + LABEL_NM / NM_PER_UM) + section.die_size, room_um, grid,
         f"{smaller}, other columns, or a larger plate"),
        ("die_size", section.die_size, section.die_pitch - LABEL_NM / NM_PER_UM, "its slot less the label",
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
