"""Text as polygons, in the stick font of KLayout's text generator."""

from __future__ import annotations

from functools import lru_cache
from typing import Literal

from klayout import db

from maskfab.errors import JobError
from maskfab.geometry.polygonize import simple_pieces
from maskfab.model import Point, Polygon

# Every coordinate of the font is a multiple of this step, and every letter is 28 steps high.
_STEP_UM = 0.025
_STEPS_PER_HEIGHT = 28


def text_polygons(
    text: str, height_nm: int, anchor_nm: Point, align: Literal["left", "centre"] = "left"
) -> tuple[Polygon, ...]:
    """One line of text; letters stand on the anchor's y and start at, or are centred on, its x.

    Args:
        text: characters from ``!`` to ``~`` and spaces; the font draws small letters as capitals.
        height_nm: height of a letter, at least 28 nm; it is rounded to a multiple of 28 nm, so that all 45-degree
            strokes keep to the database grid.
        anchor_nm: where the text stands.
        align: ``left`` or ``centre``.

    Returns:
        Simple, hole-free polygons in nanometres.

    Raises:
        JobError: MF110 if the font lacks a character.
    """
    step_nm = max(1, round(height_nm / _STEPS_PER_HEIGHT))
    lacking = sorted({c for c in text if not (c == " " or " " < c <= "~")})
    if lacking:
        raise JobError(
            "MF110",
            f"the plate's font has no {', '.join(map(repr, lacking))} for the text {text!r}",
            cure="Use ASCII letters, digits and punctuation",
        )
    letters = _letters(text)
    width = max((x for letter in letters for x, _ in letter), default=0) * step_nm
    x0 = anchor_nm[0] - (width // 2 if align == "centre" else 0)
    return tuple(tuple((x0 + x * step_nm, anchor_nm[1] + y * step_nm) for x, y in letter) for letter in letters)


@lru_cache(4096)
def _letters(text: str) -> tuple[Polygon, ...]:
    """One line of text in steps of the font, from x = 0; marks, and plates one like the other, repeat most lines."""
    drawn = simple_pieces(db.TextGenerator.default_generator().text(text, _STEP_UM, 1.0))
    return tuple(tuple((point.x, point.y) for point in piece.each_point_hull()) for piece in drawn)


def fitted_text(text: str, height_nm: int, anchor_nm: Point, room_nm: int) -> tuple[Polygon, ...]:
    """Centred text as :func:`text_polygons` draws it, made smaller if it would be wider than its room."""
    polygons = text_polygons(text, height_nm, anchor_nm, align="centre")
    xs = [x for polygon in polygons for x, _ in polygon]
    width = max(xs) - min(xs) if xs else 0
    if width > room_nm:
        return text_polygons(text, height_nm * room_nm // width, anchor_nm, align="centre")
    return polygons
