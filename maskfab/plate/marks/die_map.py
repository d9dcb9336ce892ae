"""A small drawing of the plate with the name of every die, and thin outlines of all that has a border."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from maskfab.geometry.lettering import text_polygons, text_width_nm
from maskfab.model import CLEAR, OUTLINE, Die, Furniture, Point, Polygon
from maskfab.plate.marks.drawing import box_at, rectangle

_SMALLEST_LETTER_NM = 60_000
_LARGEST_LETTER_NM = 250_000
_SAMPLE_NM = 280_000
_SHARE_OF_GAP = 0.6
_SHARE_OF_PITCH = 0.9
_FEET = 1.5
"""Where letters stand below a slot, in their heights."""
_OUTLINE_NM = 20_000


@dataclass(frozen=True)
class _Lettering:
    """Height of all names, and where their middles lie below those of their dies."""

    height_nm: int
    drop_nm: int


def die_map(
    name: str, centre_nm: Point, side_nm: int, line_nm: int, *, blank_nm: int, die_pitch_nm: int, dies: Sequence[Die]
) -> Furniture:
    """Blank and slots as frames, and names in or under the slots, whichever leaves room for larger letters.

    Where letters would be less than 60 um high the dies' numbers stand for their names, in the plate's order from 1;
    where even these would be, there is no text. A frame is two brackets, so that no figure has a hole.

    Args:
        name: of the mark.
        centre_nm: of the drawing.
        side_nm: of the drawn blank.
        line_nm: width of the frames.
        blank_nm: side of the true blank.
        die_pitch_nm: true distance from die to die.
        dies: of the plate, at least one.
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
        lettering = _lettering(words, slot, slot - 4 * line_nm, (wide, high))
        if lettering.height_nm >= _SMALLEST_LETTER_NM:
            for word, (x, y) in zip(words, places, strict=True):
                base = (x, y - lettering.drop_nm - lettering.height_nm // 2)
                polygons += text_polygons(word, lettering.height_nm, base, align="centre")
            break
    return Furniture(name, "map", CLEAR, tuple(polygons))


def _lettering(words: Sequence[str], slot: int, inside: int, under: tuple[float, float]) -> _Lettering:
    """The larger of two: inside the slots' frames, a square of that side, or under them, that wide and high."""
    widest = max(text_width_nm(word, _SAMPLE_NM) for word in words)

    def height(room: tuple[float, float]) -> int:
        return int(min(room[1], room[0] * _SAMPLE_NM / widest, _LARGEST_LETTER_NM))

    below = height(under)
    choices = (_Lettering(height((inside, inside)), 0), _Lettering(below, slot // 2 + below))
    return max(choices, key=lambda choice: choice.height_nm)


def _frame(centre: Point, side: int, line: int) -> tuple[Polygon, ...]:
    """Two brackets with two widths of their line between their tips, or a full square where they would not be told."""
    x0, y0, x1, y1 = box_at(centre, (side, side))
    if side < 8 * line:
        return (rectangle((x0, y0, x1, y1)),)
    inner, outer = x0 + line, centre[0] - line
    lower = ((x0, y0), (outer, y0), (outer, y0 + line), (inner, y0 + line))
    left: Polygon = (*lower, (inner, y1 - line), (outer, y1 - line), (outer, y1), (x0, y1))
    right = tuple((x0 + x1 - x, y) for x, y in reversed(left))
    return left, right


def outlines(blank_nm: int, writable_nm: int, dies: Iterable[Die]) -> list[Furniture]:
    """A thin square frame inside blank, writable area and slots, for orientation only; never written on the plate."""
    named = [("BLANK", (0, 0), blank_nm), ("WRITABLE", (0, 0), writable_nm)]
    named += [(f"SLOT_{die.name}", die.centre_nm, die.slot_nm) for die in dies]
    return [Furniture(f"OUTLINE_{name}", "outline", OUTLINE, _square_frame(place, side)) for name, place, side in named]


def _square_frame(centre: Point, side_nm: int) -> tuple[Polygon, ...]:
    x0, y0, x1, y1 = box_at(centre, (side_nm, side_nm))
    line = _OUTLINE_NM
    bars = [(x0, y0, x1, y0 + line), (x0, y1 - line, x1, y1)]
    bars += [(x0, y0 + line, x0 + line, y1 - line), (x1 - line, y0 + line, x1, y1 - line)]
    return tuple(rectangle(bar) for bar in bars)
