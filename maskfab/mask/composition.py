"""From a validated job to a plate: panels in their slots, and round them the marks of :mod:`maskfab.mask.marks`.

Coordinates are the plate's: its centre is the origin, y points up, and the chrome is towards the reader. Where [order]
asks for a design that reads right through the glass, all of it lies here as in a mirror. Nothing that is written may
lie on a die, on another mark, or outside the writable area; a data grid keeps the dies and moves vertices of marks."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace

import numpy as np
from klayout import db

from maskfab.base import provenance
from maskfab.base.errors import AtFault, Faults, JobError
from maskfab.base.model import (
    CLEAR,
    ORIENTATIONS,
    OUTLINE,
    Die,
    Mark,
    Note,
    Opening,
    Panel,
    Plate,
    Point,
    Polygon,
    Snapping,
)
from maskfab.base.units import NM_PER_MM, NM_PER_UM, to_nm
from maskfab.job.sections import JobSpec, PlateSection
from maskfab.mask import marks as of_marks
from maskfab.mask.dots import smallest_runs
from maskfab.mask.outlines import fitted_text, text_polygons, text_width_nm
from maskfab.mask.panels import die_panels, laid_out

LARGEST_GRID_NM = 1000


def check_dies(dies: Sequence[Die], grid_nm: int, *, where: str) -> None:
    """Refuse dies of which a dot would have to be moved: dots keep their size and pitch.

    Raises:
        JobError: MF104 for a grid coarser than 1 um, MF107 for the first length that is no multiple of it.
    """
    if grid_nm > LARGEST_GRID_NM:
        what = f"a data grid of {grid_nm} nm is coarser than 1 um"
        raise JobError("MF104", what, where=where, cure="Use at most 1 um")
    for die in dies:
        for name, value_nm in _lengths(die):
            if value_nm % grid_nm:
                what = f"the {name} of die {die.name} is {value_nm} nm, no multiple of the data grid of {grid_nm} nm"
                cure = "Use a finer grid, or a dot, a gutter and a die_pitch that are multiples of twice the grid"
                raise JobError("MF107", what, where=where, cure=cure)


def lies_on(die: Die, grid_nm: int) -> bool:
    """Whether every dot of a die lies on a grid."""
    return all(value_nm % grid_nm == 0 for _, value_nm in _lengths(die))


def _lengths(die: Die) -> tuple[tuple[str, int], ...]:
    panel, (x, y) = die.panel, die.origin_nm
    half = panel.gutter_nm // 2
    return ("dot", panel.dot_nm), ("pitch", panel.pitch_nm), ("half gutter", half), ("left edge", x), ("lower edge", y)


def snapped(plate: Plate, grid_nm: int) -> Plate:
    """The plate with every vertex of its written marks on the nearest line of a grid, and with the count of those that
    were moved; widths that are multiples of the grid stay.
    """
    drawn = [mark.polygons for mark in plate.marks if mark.layer.written]
    corners = np.array([point for polygons in drawn for polygon in polygons for point in polygon]).reshape(-1, 2)
    off = (corners + grid_nm // 2) % grid_nm - grid_nm // 2
    moves = np.hypot(off[:, 0], off[:, 1])
    before = plate.snapped or Snapping(grid_nm, 0, 0.0)
    moved = Snapping(
        grid_nm, before.vertices + int(np.count_nonzero(moves)), before.farthest_nm + float(moves.max(initial=0.0))
    )

    def nearest(polygon: Polygon) -> Polygon:
        """The outline on the grid, without vertices that follow themselves."""
        drawn = [tuple((value + grid_nm // 2) // grid_nm * grid_nm for value in point) for point in polygon]
        return tuple((x, y) for (x, y), before in zip(drawn, (drawn[-1], *drawn), strict=False) if (x, y) != before)

    marks = tuple(
        replace(mark, polygons=tuple(map(nearest, mark.polygons))) if mark.layer.written else mark
        for mark in plate.marks
    )
    return replace(plate, marks=marks, snapped=moved)


_TURNS = ORIENTATIONS // 2


def mirrored(plate: Plate) -> Plate:
    """The plate seen from its other side, names and titles as they are; twice it is the plate itself."""

    def across(place: Point) -> Point:
        return -place[0], place[1]

    return replace(
        plate,
        dies=tuple(
            # Of an odd width the middle lies half a nanometre beside the panel's.
            replace(
                die,
                panel=mirrored_panel(die.panel),
                centre_nm=(die.panel.size_nm[0] // 2 - die.box_nm[2], die.centre_nm[1]),
            )
            for die in plate.dies
        ),
        marks=tuple(replace(mark, polygons=tuple(map(_mirrored_outline, mark.polygons))) for mark in plate.marks),
        gauges=tuple(replace(gauge, centre_nm=across(gauge.centre_nm)) for gauge in plate.gauges),
        notes=tuple(replace(note, position_nm=across(note.position_nm)) for note in plate.notes),
    )


def mirrored_panel(panel: Panel) -> Panel:
    """A panel whose columns run the other way, each cell mirrored; emitters and wires that turn go with their cell.

    Every cell's element of D4, k = r + 4 f, which turns by r quarters after f mirrors, is followed by a mirror.
    """
    opening, element = np.divmod(panel.orientations, ORIENTATIONS)
    mirror, turn = np.divmod(element, _TURNS)
    cells = np.asarray(ORIENTATIONS * opening + _TURNS * (1 - mirror) + (-turn) % _TURNS, dtype=np.int8)
    tracks = tuple(
        track
        if track.turns
        else replace(track, polygons=tuple(_mirrored_outline(polygon, panel.pitch_nm) for polygon in track.polygons))
        for track in panel.tracks
    )
    return replace(panel, orientations=cells[:, ::-1], tracks=tracks)


def _mirrored_outline(polygon: Polygon, width_nm: int = 0) -> Polygon:
    """The outline backwards, so that it runs round what it bounds in the sense that it did."""
    return tuple((width_nm - x, y) for x, y in reversed(polygon))


LINE_FEED = 2
"""From line to line below the title, in heights of their letters."""
_HEIGHT_NM = 420_000
"""With strokes of 60 um, which film holds."""
_GAP_NM = 180_000
LABEL_NM = _GAP_NM + _HEIGHT_NM
"""Height that a label needs below a die's slot."""


def title_block(
    name: str, title: str, lines: Iterable[str], anchor_nm: Point, height_nm: int, small_nm: int, room_nm: int
) -> Mark:
    """A title centred on the anchor, with lines of smaller letters below; longer ones than ``room_nm`` get smaller."""
    x, y = anchor_nm
    polygons = fitted_text(title, height_nm, anchor_nm, room_nm)
    for number, line in enumerate(lines, 1):
        polygons += fitted_text(line, small_nm, (x, y - LINE_FEED * small_nm * number), room_nm)
    return Mark(name, "title", CLEAR, polygons)


def maker(signature: str) -> str:
    """Who made it from which job: the signature without its seeds."""
    return signature.rsplit("|", 1)[0].strip()


def label(die: Die) -> Mark:
    """Name and label of a die, below its slot and not wider than it."""
    position = (die.centre_nm[0], die.centre_nm[1] - die.slot_nm // 2 - LABEL_NM)
    text = f"{die.name}  {die.label}"
    return Mark(f"LABEL_{die.name}", "label", CLEAR, fitted_text(text, _HEIGHT_NM, position, die.slot_nm))


_SMALLEST_LETTER_NM = 60_000
_LARGEST_LETTER_NM = 250_000
_SAMPLE_NM = 280_000
_SHARE_OF_GAP = 0.6
_SHARE_OF_PITCH = 0.9
_FEET = 1.5
"""Where letters stand below a slot, in their heights."""
_OUTLINE_NM = 20_000


def die_map(
    name: str, centre_nm: Point, side_nm: int, line_nm: int, *, blank_nm: int, die_pitch_nm: int, dies: Sequence[Die]
) -> Mark:
    """Blank and slots as frames, and names in or under the slots, whichever leaves room for larger letters.

    Where letters would be less than 60 um high the dies' numbers stand for their names, in the plate's order from 1;
    where even these would be, there is no text. A frame is two brackets, so that no figure has a hole.

    Args:
        side_nm: of the drawn blank.
        blank_nm: side of the true blank.
        die_pitch_nm: true distance from die to die.
    """

    def drawn(length_nm: int) -> int:
        return length_nm * side_nm // blank_nm

    slot, pitch = drawn(dies[0].slot_nm), drawn(die_pitch_nm)
    polygons = list(_frame(centre_nm, side_nm, line_nm))
    offsets = [(drawn(die.centre_nm[0]), drawn(die.centre_nm[1])) for die in dies]
    places = [(centre_nm[0] + x, centre_nm[1] + y) for x, y in offsets]
    for place in places:
        polygons += _frame(place, slot, line_nm)
    # Under a slot, letters keep clear of the next slots and of the blank's frame.
    inner = side_nm // 2 - 2 * line_nm
    wide = min(_SHARE_OF_PITCH * pitch, *(2 * (inner - abs(x)) for x, _ in offsets))
    high = min(_SHARE_OF_GAP * (pitch - slot), *((inner + y - slot // 2) / _FEET for _, y in offsets))
    for words in ([die.name for die in dies], [str(number) for number, _ in enumerate(dies, 1)]):
        widest, inner = max(text_width_nm(word, _SAMPLE_NM) for word in words), slot - 4 * line_nm
        inside, under = (
            int(min(tall, broad * _SAMPLE_NM / widest, _LARGEST_LETTER_NM))
            for broad, tall in ((inner, inner), (wide, high))
        )
        height, drop = (inside, 0) if inside >= under else (under, slot // 2 + under)
        if height >= _SMALLEST_LETTER_NM:
            for word, (x, y) in zip(words, places, strict=True):
                polygons += text_polygons(word, height, (x, y - drop - height // 2), align="centre")
            break
    return Mark(name, "map", CLEAR, tuple(polygons))


def _frame(centre: Point, side: int, line: int) -> tuple[Polygon, ...]:
    """Two brackets with two widths of their line between their tips, or a full square where they would not be told."""
    x0, y0, x1, y1 = of_marks.box_at(centre, (side, side))
    if side < 8 * line:
        return (of_marks.rectangle((x0, y0, x1, y1)),)
    inner, outer = x0 + line, centre[0] - line
    lower = ((x0, y0), (outer, y0), (outer, y0 + line), (inner, y0 + line))
    left: Polygon = (*lower, (inner, y1 - line), (outer, y1 - line), (outer, y1), (x0, y1))
    right = tuple((x0 + x1 - x, y) for x, y in reversed(left))
    return left, right


def outlines(blank_nm: int, writable_nm: int, dies: Iterable[Die]) -> list[Mark]:
    """A thin square frame inside blank, writable area and slots, for orientation only; never written on the plate."""
    named = [("BLANK", (0, 0), blank_nm), ("WRITABLE", (0, 0), writable_nm)]
    named += [(f"SLOT_{die.name}", die.centre_nm, die.slot_nm) for die in dies]
    marks, line = [], _OUTLINE_NM
    for name, centre, side in named:
        x0, y0, x1, y1 = of_marks.box_at(centre, (side, side))
        bars = [(x0, y0, x1, y0 + line), (x0, y1 - line, x1, y1)]
        bars += [(x0, y0 + line, x0 + line, y1 - line), (x1 - line, y0 + line, x1, y1 - line)]
        marks.append(Mark(f"OUTLINE_{name}", "outline", OUTLINE, tuple(map(of_marks.rectangle, bars))))
    return marks


def check_clearances(dies: Sequence[Die], marks: Sequence[Mark], writable_nm: int, *, where: str) -> None:
    """Compare the slots of the dies and the bounding boxes of all marks that are written.

    Raises:
        JobError: MF108 if one leaves the writable area, MF126 if two overlap.
    """
    boxes = [(f"die {die.name!r}", of_marks.box_at(die.centre_nm, (die.slot_nm, die.slot_nm))) for die in dies]
    boxes += [
        (f"mark {mark.name!r}", of_marks.bounding_box(mark.polygons))
        for mark in marks
        if mark.layer.written and mark.polygons
    ]
    half, cure = writable_nm // 2, "Use smaller or fewer dies, a closer die_pitch, or a larger plate"
    for name, (x0, y0, x1, y1) in boxes:
        over = max(-half - x0, -half - y0, x1 - half, y1 - half)
        if over > 0:
            what = f"{name} leaves the writable area of {writable_nm / NM_PER_UM:g} um by {over / NM_PER_UM:g} um"
            raise JobError("MF108", what, where=where, cure=cure)
    shared = db.Region([db.Box(*box) for _, box in boxes]).merged(False, 2)
    if shared.is_empty():
        return
    place = next(shared.each()).bbox()
    one, other, *_ = (name for name, box in boxes if db.Box(*box).overlaps(place))
    x, y = place.left / NM_PER_UM, place.bottom / NM_PER_UM
    raise JobError("MF126", f"{one} and {other} overlap at ({x:g}, {y:g}) um", where=where, cure=cure)


MARGIN_NM = 2_000_000
TITLE_HEIGHT_NM = 1_500_000
SMALLEST_WRITABLE_NM = 20_300_000
"""Narrower than this, title and marks would meet."""

_SMALL_NM = 420_000
_FIDUCIAL_NM = 1_000_000
_FIDUCIAL_LINE_NM = 50_000
_PARITY_NM = 2_000_000
_CD_MULTIPLES = (1, 2, 5)
_CD_LENGTH_NM = 500_000


def _maker_line(setting: of_marks.Setting) -> str:
    return " | ".join((maker(setting.signature), *setting.texts))


def plain_marks(setting: of_marks.Setting) -> of_marks.DrawnMarks:
    """Title, labels, corner fiducials, parity mark, CD bars and outlines, in the order in which they are written."""
    corner = setting.writable_nm // 2 - MARGIN_NM
    places = {"SW": (-corner, -corner), "SE": (corner, -corner), "NW": (-corner, corner), "NE": (corner, corner)}
    lines = (f"{_maker_line(setting)} | digitized data = {setting.tone}",)
    room_nm = setting.writable_nm - 4 * MARGIN_NM
    anchor = (0, corner - TITLE_HEIGHT_NM // 2)
    bars = of_marks.cd_bars("CD", (0, -corner), setting.feature_nm, _CD_MULTIPLES, _CD_LENGTH_NM)
    marks = (
        title_block("TITLE", setting.title, lines, anchor, TITLE_HEIGHT_NM, _SMALL_NM, room_nm),
        *(label(die) for die in setting.dies),
        *(of_marks.fiducial(f"FIDUCIAL_{name}", at, _FIDUCIAL_NM, _FIDUCIAL_LINE_NM) for name, at in places.items()),
        of_marks.parity_mark("PARITY", (-corner + 2 * MARGIN_NM, -corner), _PARITY_NM),
        *bars.marks,
        *outlines(setting.blank_nm, setting.writable_nm, setting.dies),
    )
    return of_marks.DrawnMarks(marks, bars.gauges)


_CAPTION_NM = 150_000


def templated(template: of_marks.PlateTemplate, setting: of_marks.Setting, *, where: str) -> of_marks.DrawnMarks:
    """Every mark of a template, then labels and outlines.

    Raises:
        JobError: MF126 if a mark is larger than the room that the template gives it.
    """
    drawn = []
    for mark in template.mark:
        figures = _captioned(mark, _draw(mark, template, setting, where), setting)
        _check_room(mark, figures, where)
        drawn.append(figures)
    return of_marks.DrawnMarks(
        (
            *(figure for template_part in drawn for figure in template_part.marks),
            *(label(die) for die in setting.dies),
            *outlines(setting.blank_nm, setting.writable_nm, setting.dies),
        ),
        tuple(gauge for template_part in drawn for gauge in template_part.gauges),
    )


def _draw(
    mark: of_marks.AnyMark, template: of_marks.PlateTemplate, setting: of_marks.Setting, where: str
) -> of_marks.DrawnMarks:
    name, (x, y), (x0, y0, x1, y1) = mark.name, mark.centre_nm, mark.room_nm
    centre, feature = (x, y), setting.feature_nm
    match mark:
        case of_marks.BarsSection():
            return of_marks.cd_bars(name, centre, feature, mark.multiples, to_nm(mark.length))
        case of_marks.LinesSection():
            return of_marks.line_space(name, centre, feature, mark.multiples, mark.lines, to_nm(mark.length))
        case of_marks.BoardSection():
            return of_marks.checkerboards(name, centre, feature, mark.multiples, mark.squares)
        case of_marks.CornersSection():
            return of_marks.corner_letters(name, centre, feature, mark.multiples)
        case of_marks.FiducialSection():
            drawn = of_marks.fiducial(name, centre, to_nm(mark.length), to_nm(mark.line))
        case of_marks.AlignmentSection():
            drawn = of_marks.alignment_cross(name, centre, to_nm(mark.length), to_nm(mark.line))
        case of_marks.ParitySection():
            height = to_nm(mark.height)
            drawn = of_marks.parity_mark(
                name, (x - height * of_marks.WIDTH // of_marks.HEIGHT // 2, y - height // 2), height
            )
        case of_marks.TitleSection():
            # Tone and parity in the words of mask houses, and the blank.
            side, thickness = (value * NM_PER_UM / NM_PER_MM for value in (template.blank, template.thickness))
            reading = f"digitized data = {setting.tone} | right reading, chrome {setting.chrome}"
            lines = (_maker_line(setting), f"{reading} | {side:g} x {side:g} x {thickness:g} mm")
            height, small, room_nm = to_nm(mark.height), to_nm(mark.small), _for_text(mark)
            drawn = title_block(name, setting.title, lines, (x, y1 - height), height, small, room_nm)
        case of_marks.CodeSection():
            drawn = of_marks.data_matrix(
                name, centre, of_marks.code_text(setting.signature, setting.digest), to_nm(mark.module)
            )
        case of_marks.MapSection():
            drawn = die_map(
                name,
                centre,
                min(x1 - x0, y1 - y0),
                to_nm(mark.line),
                blank_nm=setting.blank_nm,
                die_pitch_nm=setting.die_pitch_nm,
                dies=setting.dies,
            )
        case of_marks.StarSection():
            inner = of_marks.inner_radius_nm(feature, mark.spokes)
            if inner >= to_nm(mark.radius):
                what = (
                    f"spokes of the star {mark.name!r} are {feature / NM_PER_UM:g} um wide at {inner / NM_PER_UM:g} um "
                    f"from its centre, and it ends at {mark.radius:g} um"
                )
                raise JobError("MF126", what, where=where, cure="Give it a larger radius, or fewer spokes")
            drawn = of_marks.siemens_star(name, centre, feature, to_nm(mark.radius), mark.spokes)
    return of_marks.DrawnMarks((drawn,))


def _captioned(mark: of_marks.AnyMark, drawn: of_marks.DrawnMarks, setting: of_marks.Setting) -> of_marks.DrawnMarks:
    """Test figures with a line at the bottom of their room that says which they are, and multiples of what."""
    feature = f"{setting.feature_nm / NM_PER_UM:g} um"
    match mark:
        case of_marks.BarsSection() | of_marks.LinesSection() | of_marks.BoardSection() | of_marks.CornersSection():
            text = f"{mark.name}  {feature} x {', '.join(f'{multiple:g}' for multiple in mark.multiples)}"
        case of_marks.StarSection():
            text = f"{mark.name}  {feature} inside"
        case _:
            return drawn
    anchor = mark.centre_nm[0], mark.room_nm[1]
    caption = fitted_text(text, _CAPTION_NM, anchor, _for_text(mark))
    return of_marks.DrawnMarks((*drawn.marks, Mark(f"{mark.name}_TEXT", "label", CLEAR, caption)), drawn.gauges)


def _for_text(mark: of_marks.MarkSection) -> int:
    """Width of a room less what letters may gain when their height is rounded to the font's steps."""
    x0, _, x1, _ = mark.room_nm
    return (x1 - x0) * 999 // 1000


def _check_room(mark: of_marks.MarkSection, drawn: of_marks.DrawnMarks, where: str) -> None:
    boxes = [of_marks.bounding_box(figure.polygons) for figure in drawn.marks if figure.polygons]
    x0, y0, x1, y1 = mark.room_nm
    over = max((max(x0 - a, y0 - b, c - x1, d - y1) for a, b, c, d in boxes), default=0)
    if over > 0:
        what = (
            f"the mark {mark.name!r} leaves its room of {mark.room[0]:g} x {mark.room[1]:g} um by {over / NM_PER_UM:g} "
            "um on this plate"
        )
        raise JobError("MF126", what, where=where, cure="Give it a larger room in the template")


_LARGEST_FEATURE_NM = 50_000


def compose(spec: JobSpec, openings: Mapping[str, tuple[Opening, ...]], signature: str, *, where: str) -> Plate:
    """Lay a job out as a plate.

    Args:
        signature: who made this from what, noted in the files.

    Raises:
        JobError: MF105 if there is nothing to lay out, or neither a template nor a blank to do it on; MF106 or MF107 if
            a die's pitch is not its dots and gutter, or off the grid; MF104 for a data grid beyond 1 um; MF108 if
            something is larger than its room; MF114 if a stop is wider than its panel; MF124 to MF126 if the plate's
            template cannot be used, is unknown, or contradicts the job.
    """
    heading, section = laid_out(spec, where=where)
    template = (
        None
        if section.template is None
        else of_marks.plate_template(section.template, where=f"{where}: plate.template")
    )
    faults = Faults()
    blank_nm = writable_nm = 0
    with faults:
        blank_nm, writable_nm = (_side(section, template, key, where) for key in ("blank", "writable"))
        _check_rooms(section, template, len(spec.die), (blank_nm, writable_nm), where)
    panels: dict[str, Panel] = {}
    with faults:
        panels = die_panels(spec, openings, where=where)
    faults.refuse()
    if len(panels) < len(spec.die) or not blank_nm:
        raise AtFault
    pitch_nm = to_nm(section.die_pitch, where=f"{where}: plate.die_pitch", name="die_pitch")
    size_nm = to_nm(section.die_size, where=f"{where}: plate.die_size", name="die_size")
    # Row by row from the top left, the whole grid centred on the plate.
    columns = min(section.columns, len(spec.die))
    rows = -(-len(spec.die) // columns)
    left, top = -(columns - 1) * pitch_nm // 2, (rows - 1) * pitch_nm // 2
    dies = tuple(
        Die(
            die.name,
            die.label,
            panels[die.name],
            (left + i % columns * pitch_nm, top - i // columns * pitch_nm),
            size_nm,
        )
        for i, die in enumerate(spec.die)
    )
    setting = of_marks.Setting(
        title=heading.title,
        texts=tuple(f"{key} {text}" for key, text in section.texts.items()),
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
    check_clearances(dies, drawn.marks, writable_nm, where=f"{where}: plate")
    corner = writable_nm // 2 - MARGIN_NM
    note = Note(signature, (-corner, -corner - MARGIN_NM // 2))
    plate = Plate(
        heading.name,
        heading.title,
        blank_nm,
        writable_nm,
        dies,
        drawn.marks,
        drawn.gauges,
        (note,),
        texts=section.texts,
    )
    plate = mirrored(plate) if spec.mirrored else plate
    grid_um = None if spec.export is None else spec.export.grid
    if grid_um is None:
        return plate
    place = f"{where}: export.grid"
    grid_nm = to_nm(grid_um, where=place, name="grid")
    check_dies(plate.dies, grid_nm, where=place)
    return snapped(plate, grid_nm) if grid_nm > 1 else plate


def _side(section: PlateSection, template: of_marks.PlateTemplate | None, key: str, where: str) -> int:
    """Blank or writable area in nanometres, from the job or its template, which do not contradict each other."""
    stated: float | None = getattr(section, key)
    given: float | None = None if template is None else getattr(template, key)
    chosen = given if stated is None else stated
    if chosen is None:
        what = f"the key 'plate.{key}' is missing, and no template says it"
        raise JobError("MF105", what, where=f"{where}: plate.{key}", cure=f'Add {key}, or template = "5in"')
    if given is not None and abs(chosen - given) * NM_PER_UM > 1e-6:
        what = f"{key} is {chosen:.10g} um, and the template {section.template!r} says {given:.10g} um"
        raise JobError("MF126", what, where=f"{where}: plate.{key}", cure=f"Remove {key}, or the template")
    return to_nm(chosen, where=f"{where}: plate.{key}", name=key)


def _check_rooms(
    section: PlateSection, template: of_marks.PlateTemplate | None, count: int, sides_nm: tuple[int, int], where: str
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


def _smallest_feature_nm(dies: tuple[Die, ...]) -> int:
    """The shortest clear run of any opening as laid out (a dot if none ends), at most 50 um to keep figures apart."""

    def shortest(panel: Panel) -> int:
        run = min(smallest_runs(opening.mask, periodic=True).clear for opening in panel.openings)
        return panel.dot_nm * (round(run) if math.isfinite(run) else 1)

    return min(_LARGEST_FEATURE_NM, *(shortest(die.panel) for die in dies))
