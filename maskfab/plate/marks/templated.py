"""The marks of a plate as its template says."""

from __future__ import annotations

from maskfab.errors import InternalError, JobError
from maskfab.geometry.lettering import fitted_text
from maskfab.model import CLEAR, Furniture
from maskfab.plate.marks.captions import label, maker, title_block
from maskfab.plate.marks.data_matrix import code_text, data_matrix
from maskfab.plate.marks.die_map import die_map, outlines
from maskfab.plate.marks.drawing import DrawnMarks, Setting, bounding_box
from maskfab.plate.marks.registration import HEIGHT, WIDTH, alignment_cross, fiducial, parity_mark
from maskfab.plate.marks.resolution import (
    cd_bars,
    checkerboards,
    corner_letters,
    inner_radius_nm,
    line_space,
    siemens_star,
)
from maskfab.plate.marks.template import (
    AlignmentSection,
    AnyMark,
    BarsSection,
    BoardSection,
    CodeSection,
    CornersSection,
    FiducialSection,
    LinesSection,
    MapSection,
    MarkSection,
    ParitySection,
    PlateTemplate,
    StarSection,
    TitleSection,
)
from maskfab.units import NM_PER_MM, NM_PER_UM, to_nm

_CAPTION_NM = 150_000


def templated(template: PlateTemplate, setting: Setting, *, where: str) -> DrawnMarks:
    """Every mark of a template, then labels and outlines.

    Raises:
        JobError: MF126 if a mark is larger than the room that the template gives it.
    """
    drawn = [
        _in_room(mark, _captioned(mark, _draw(mark, template, setting, where), setting), where)
        for mark in template.mark
    ]
    return DrawnMarks(
        (
            *(figure for each in drawn for figure in each.furniture),
            *(label(die) for die in setting.dies),
            *outlines(setting.blank_nm, setting.writable_nm, setting.dies),
        ),
        tuple(gauge for each in drawn for gauge in each.gauges),
    )


def _draw(mark: AnyMark, template: PlateTemplate, setting: Setting, where: str) -> DrawnMarks:
    name, centre, feature = mark.name, mark.centre_nm, setting.feature_nm
    match mark:
        case BarsSection():
            return cd_bars(name, centre, feature, mark.multiples, to_nm(mark.length))
        case LinesSection():
            return line_space(name, centre, feature, mark.multiples, mark.lines, to_nm(mark.length))
        case BoardSection():
            return checkerboards(name, centre, feature, mark.multiples, mark.squares)
        case CornersSection():
            return corner_letters(name, centre, feature, mark.multiples)
        case _:
            return DrawnMarks((_single(mark, template, setting, where),))


def _captioned(mark: AnyMark, drawn: DrawnMarks, setting: Setting) -> DrawnMarks:
    """Test figures with a line at the bottom of their room that says which they are, and multiples of what."""
    feature = f"{setting.feature_nm / NM_PER_UM:g} um"
    match mark:
        case BarsSection() | LinesSection() | BoardSection() | CornersSection():
            text = f"{mark.name}  {feature} x {', '.join(f'{multiple:g}' for multiple in mark.multiples)}"
        case StarSection():
            text = f"{mark.name}  {feature} inside"
        case _:
            return drawn
    anchor = mark.centre_nm[0], mark.room_nm[1]
    caption = fitted_text(text, _CAPTION_NM, anchor, _for_text(mark))
    return DrawnMarks((*drawn.furniture, Furniture(f"{mark.name}_TEXT", "label", CLEAR, caption)), drawn.gauges)


def _for_text(mark: MarkSection) -> int:
    """Width of a room less what letters may gain when their height is rounded to the font's steps."""
    x0, _, x1, _ = mark.room_nm
    return (x1 - x0) * 999 // 1000


def _single(mark: AnyMark, template: PlateTemplate, setting: Setting, where: str) -> Furniture:
    name, (x, y) = mark.name, mark.centre_nm
    x0, y0, x1, y1 = mark.room_nm
    match mark:
        case FiducialSection():
            return fiducial(name, (x, y), to_nm(mark.length), to_nm(mark.line))
        case AlignmentSection():
            return alignment_cross(name, (x, y), to_nm(mark.length), to_nm(mark.line))
        case ParitySection():
            height = to_nm(mark.height)
            return parity_mark(name, (x - height * WIDTH // HEIGHT // 2, y - height // 2), height)
        case TitleSection():
            height = to_nm(mark.height)
            lines = (maker(setting.signature), _reading(template, setting))
            room_nm = _for_text(mark)
            return title_block(name, setting.title, lines, (x, y1 - height), height, to_nm(mark.small), room_nm)
        case CodeSection():
            return data_matrix(name, (x, y), code_text(setting.signature, setting.digest), to_nm(mark.module))
        case MapSection():
            return die_map(
                name,
                (x, y),
                min(x1 - x0, y1 - y0),
                to_nm(mark.line),
                blank_nm=setting.blank_nm,
                die_pitch_nm=setting.die_pitch_nm,
                dies=setting.dies,
            )
        case StarSection():
            _check_star(mark, setting.feature_nm, where)
            return siemens_star(name, (x, y), setting.feature_nm, to_nm(mark.radius), mark.spokes)
    raise InternalError("MF901", f"nothing draws a mark of the kind {mark.kind!r}")


def _reading(template: PlateTemplate, setting: Setting) -> str:
    """Tone and parity in the words of mask houses, and the blank."""
    side, thickness = template.blank * NM_PER_UM / NM_PER_MM, template.thickness * NM_PER_UM / NM_PER_MM
    reading = f"digitized data = {setting.tone} | right reading, chrome {setting.chrome}"
    return f"{reading} | {side:g} x {side:g} x {thickness:g} mm"


def _check_star(mark: StarSection, feature_nm: int, where: str) -> None:
    inner = inner_radius_nm(feature_nm, mark.spokes)
    if inner >= to_nm(mark.radius):
        raise JobError(
            "MF126",
            f"spokes of the star {mark.name!r} are {feature_nm / NM_PER_UM:g} um wide at {inner / NM_PER_UM:g} um from "
            f"its centre, and it ends at {mark.radius:g} um",
            where=where,
            cure="Give it a larger radius, or fewer spokes",
        )


def _in_room(mark: MarkSection, drawn: DrawnMarks, where: str) -> DrawnMarks:
    """The mark, refused if a figure of it leaves its room."""
    boxes = [bounding_box(figure.polygons) for figure in drawn.furniture if figure.polygons]
    x0, y0, x1, y1 = mark.room_nm
    over = max((max(x0 - a, y0 - b, c - x1, d - y1) for a, b, c, d in boxes), default=0)
    if over > 0:
        raise JobError(
            "MF126",
            f"the mark {mark.name!r} leaves its room of {mark.room[0]:g} x {mark.room[1]:g} um by {over / NM_PER_UM:g} "
            "um on this plate",
            where=where,
            cure="Give it a larger room in the template",
        )
    return drawn
