"""The marks of a plate without a template, laid out to whatever its writable area is."""

from __future__ import annotations

from maskfab.plate.marks.captions import label, maker, title_block
from maskfab.plate.marks.die_map import outlines
from maskfab.plate.marks.drawing import DrawnMarks, Setting
from maskfab.plate.marks.registration import fiducial, parity_mark
from maskfab.plate.marks.resolution import cd_bars

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


def plain_marks(setting: Setting) -> DrawnMarks:
    """Title, labels, a fiducial in each corner, parity mark, CD bars and outlines, in the order in which they are
    written."""
    corner = setting.writable_nm // 2 - MARGIN_NM
    places = {"SW": (-corner, -corner), "SE": (corner, -corner), "NW": (-corner, corner), "NE": (corner, corner)}
    lines = (f"{maker(setting.signature)} | digitized data = {setting.tone}",)
    room_nm = setting.writable_nm - 4 * MARGIN_NM
    anchor = (0, corner - TITLE_HEIGHT_NM // 2)
    bars = cd_bars("CD", (0, -corner), setting.feature_nm, _CD_MULTIPLES, _CD_LENGTH_NM)
    furniture = (
        title_block("TITLE", setting.title, lines, anchor, TITLE_HEIGHT_NM, _SMALL_NM, room_nm),
        *(label(die) for die in setting.dies),
        *(fiducial(f"FIDUCIAL_{name}", at, _FIDUCIAL_NM, _FIDUCIAL_LINE_NM) for name, at in places.items()),
        parity_mark("PARITY", (-corner + 2 * MARGIN_NM, -corner), _PARITY_NM),
        *bars.furniture,
        *outlines(setting.blank_nm, setting.writable_nm, setting.dies),
    )
    return DrawnMarks(furniture, bars.gauges)
