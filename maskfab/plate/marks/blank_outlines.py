"""Where blank, writable area and slots end; for orientation only, never written on the plate."""

from __future__ import annotations

from collections.abc import Iterable

from maskfab.model import OUTLINE, Die, Furniture, Point, Polygon
from maskfab.plate.marks.boxes import box_at, rectangle

_LINE_NM = 20_000


def outlines(blank_nm: int, writable_nm: int, dies: Iterable[Die]) -> list[Furniture]:
    """A thin square frame inside each."""
    named = [("BLANK", (0, 0), blank_nm), ("WRITABLE", (0, 0), writable_nm)]
    named += [(f"SLOT_{die.name}", die.centre_nm, die.slot_nm) for die in dies]
    return [Furniture(f"OUTLINE_{name}", "outline", OUTLINE, _frame(place, side)) for name, place, side in named]


def _frame(centre: Point, side_nm: int) -> tuple[Polygon, ...]:
    x0, y0, x1, y1 = box_at(centre, (side_nm, side_nm))
    line = _LINE_NM
    bars = [(x0, y0, x1, y0 + line), (x0, y1 - line, x1, y1)]
    bars += [(x0, y0 + line, x0 + line, y1 - line), (x1 - line, y0 + line, x1, y1 - line)]
    return tuple(rectangle(bar) for bar in bars)
