"""Text as polygons, in the plate's own stick font."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator, Set
from functools import lru_cache
from itertools import pairwise
from typing import Literal

from klayout import db

from maskfab.errors import JobError
from maskfab.geometry.polygonize import simple_pieces
from maskfab.model import Point, Polygon

# All vertices of the font are whole steps, and all its edges run along an axis or at 45 degrees: a letter is 28 steps
# high and 20 wide, its strokes are 4 wide, and their middles run between the points of a lattice, 4 steps apart. Gaps
# are as wide, but for corners of 45 degrees, which end 2 wide.
_STEPS_PER_HEIGHT = 28
_ADVANCE = 24
_WIDTH = 20
_PITCH = 4

# Strokes of a letter, each from lattice point to lattice point: its column from the left, 0 to 4, then its row from
# the base line, 0 to 6. A single point is a dot.
_STROKES = {
    "!": "26-22 20",
    '"': "16-15 36-35",
    "#": "16-10 36-30 04-44 02-42",
    "$": "45-15-04-13-33-42-31-01 26-25 21-20",
    "%": "06-16-15-05-06 46-45-01-00 31-41-40-30-31",
    "&": "42-20-10-01-02-35-26-16-05-04-40",
    "'": "26-25",
    "(": "36-14-12-30",
    ")": "16-34-32-10",
    "*": "25-21 04-13-33-44 02-13 33-42",
    "+": "25-21 03-43",
    ",": "21-10",
    "-": "13-33",
    ".": "20",
    "/": "46-45-01-00",
    "0": "10-01-05-16-36-45-41-30-10 02-12-34-44",
    "1": "04-15-25 26-20 00-40",
    "2": "05-16-36-45-44-11-10 00-40",
    "3": "05-16-36-45-44-33-42-41-30-10-01 23-33",
    "4": "30-36 35-25-03-02-42",
    "5": "46-06-04-34-43-41-30-10-01",
    "6": "36-26-04-01-10-30-41-42-33-03",
    "7": "06-46-45-23-20",
    "8": "13-04-05-16-36-45-44-33-13-02-01-10-30-41-42-33",
    "9": "10-20-42-45-36-16-05-04-13-43",
    ":": "24 22",
    ";": "24 22-11",
    "<": "36-03-30",
    "=": "04-44 02-42",
    ">": "16-43-10",
    "?": "05-16-36-45-44-33-23-22 20",
    "@": "40-10-01-05-16-36-45-42-22-24-44",
    "A": "00-04-26-44-40 02-42",
    "B": "33-44-45-36-06-00-30-41-42-33-03",
    "C": "45-36-16-05-01-10-30-41",
    "D": "00-06-36-45-41-30-00",
    "E": "46-06-00-40 03-33",
    "F": "46-06-00 03-33",
    "G": "45-36-16-05-01-10-40-43-23",
    "H": "06-00 46-40 03-43",
    "I": "16-36 26-20 10-30",
    "J": "46-41-30-10-01-02",
    "K": "06-00 03-23 46-45-23-41-40",
    "L": "06-00-40",
    "M": "00-06 05-15-24-35-45 46-40",
    "N": "00-06 04-14-32-42 46-40",
    "O": "10-01-05-16-36-45-41-30-10",
    "P": "00-06-36-45-44-33-03",
    "Q": "42-20-10-01-05-16-36-45-42 22-40",
    "R": "00-06-36-45-44-33-03 33-32-41-40",
    "S": "45-36-16-05-04-13-33-42-41-30-10-01",
    "T": "06-46 26-20",
    "U": "06-01-10-30-41-46",
    "V": "06-02-20-42-46",
    "W": "06-00 01-11-22-31-41 46-40",
    "X": "06-05-41-40 46-45-01-00",
    "Y": "06-05-23-45-46 23-20",
    "Z": "06-46-45-01-00-40",
    "[": "36-16-10-30",
    "\\": "06-05-41-40",
    "]": "16-36-30-10",
    "^": "04-26-44",
    "_": "00-40",
    "`": "16-25",
    "{": "36-26-24-13-22-20-30",
    "|": "26-20",
    "}": "16-26-24-33-22-20-10",
    "~": "03-14-32-43",
}


def text_polygons(
    text: str, height_nm: int, anchor_nm: Point, align: Literal["left", "centre"] = "left"
) -> tuple[Polygon, ...]:
    """One line of text; letters stand on the anchor's y and start at, or are centred on, its x.

    Args:
        text: characters from ``!`` to ``~`` and spaces; the font draws small letters as capitals.
        height_nm: height of a letter, at least 28 nm; it is rounded to a multiple of 28 nm, so that all 45-degree
            strokes keep to the database grid.
        anchor_nm: where the text stands.
        align: ``left`` or ``centre``: of the letters' cells, whatever a letter leaves blank in its own.

    Returns:
        Simple, hole-free polygons in nanometres.

    Raises:
        JobError: MF110 if the font lacks a character.
    """
    lacking = sorted({c for c in text if not (c == " " or " " < c <= "~")})
    if lacking:
        raise JobError(
            "MF110",
            f"the plate's font has no {', '.join(map(repr, lacking))} for the text {text!r}",
            cure="Use ASCII letters, digits and punctuation",
        )
    step_nm = _step_nm(height_nm)
    x0 = anchor_nm[0] - (text_width_nm(text, height_nm) // 2 if align == "centre" else 0)
    return tuple(
        tuple((x0 + (place * _ADVANCE + x) * step_nm, anchor_nm[1] + y * step_nm) for x, y in piece)
        for place, letter in enumerate(text.upper())
        if letter != " "
        for piece in _letter(letter)
    )


def text_width_nm(text: str, height_nm: int) -> int:
    """Width of the letters' cells, 20 steps each and 4 apart, without spaces at the end."""
    count = len(text.rstrip(" "))
    return max(0, count * _ADVANCE - (_ADVANCE - _WIDTH)) * _step_nm(height_nm)


def fitted_text(text: str, height_nm: int, anchor_nm: Point, room_nm: int) -> tuple[Polygon, ...]:
    """Centred text as :func:`text_polygons` draws it, made smaller if it would be wider than its room."""
    width = text_width_nm(text, height_nm)
    if width > room_nm:
        return text_polygons(text, height_nm * room_nm // width, anchor_nm, align="centre")
    return text_polygons(text, height_nm, anchor_nm, align="centre")


def _step_nm(height_nm: int) -> int:
    return max(1, round(height_nm / _STEPS_PER_HEIGHT))


@lru_cache(128)
def _letter(letter: str) -> tuple[Polygon, ...]:
    """A capital, digit or sign in steps of the font, from its lower left corner.

    Joined on a grid of half steps, since edges inside a stroke meet there; no vertex of the outline lies between.
    """
    links: defaultdict[Point, set[Point]] = defaultdict(set)
    for stroke in _STROKES[letter].split():
        points = [(int(point[0]), int(point[1])) for point in stroke.split("-")]
        links[points[0]] |= set()
        for start, end in pairwise(points):
            _link(links, start, end)
    region = db.Region()
    for point, others in links.items():
        region.insert(_pen(point, others))
        for other in others:
            region.insert(_stroke(point, other))
            for strip in _webs(point, other, links.keys()):
                region.insert(strip)
    joined = region.merged().transformed(db.ICplxTrans(0.5))
    return tuple(tuple((point.x, point.y) for point in piece.each_point_hull()) for piece in simple_pieces(joined))


def _link(links: defaultdict[Point, set[Point]], start: Point, end: Point) -> None:
    """Links from lattice point to lattice point all along a stroke."""
    length = max(abs(end[0] - start[0]), abs(end[1] - start[1]))
    step = (end[0] - start[0]) // length, (end[1] - start[1]) // length
    way = [(start[0] + step[0] * done, start[1] + step[1] * done) for done in range(length + 1)]
    for here, there in pairwise(way):
        links[here].add(there)
        links[there].add(here)


def _pen(point: Point, others: set[Point]) -> db.SimplePolygon:
    """A square, an octagon where a slanting stroke meets another, or nothing where a slanting stroke ends."""
    x, y = _middle(point)
    half, corner = _PITCH // 2, _PITCH // 4
    slanting = any(other[0] != point[0] and other[1] != point[1] for other in others)
    if not slanting:
        corner = half
    elif len(others) == 1:
        half = corner = 0
    ring = [(half, -corner), (half, corner), (corner, half), (-corner, half)]
    ring += [(-u, -v) for u, v in ring]
    return db.SimplePolygon([2 * db.Point(x + u, y + v) for u, v in ring])


def _stroke(start: Point, end: Point) -> db.SimplePolygon:
    """A stroke between neighbours of the lattice: 4 steps wide along an axis, and from middle to middle; at 45 degrees
    3 sqrt(2) wide, which keeps to the steps, and half a sqrt(2) longer at either end."""
    (x0, y0), (x1, y1) = _middle(start), _middle(end)
    u, v = (x1 - x0) // _PITCH, (y1 - y0) // _PITCH
    wide, beyond = (3, 1) if u and v else (4, 0)
    right = (v * wide - u * beyond) // 2, (-u * wide - v * beyond) // 2
    left = (-v * wide - u * beyond) // 2, (u * wide - v * beyond) // 2
    ring = [(x0 + left[0], y0 + left[1]), (x0 + right[0], y0 + right[1])]
    ring += [(x1 - left[0], y1 - left[1]), (x1 - right[0], y1 - right[1])]
    return db.SimplePolygon([2 * db.Point(*point) for point in ring])


def _webs(start: Point, end: Point, inked: Set[Point]) -> Iterator[db.Box]:
    """Strips of one step that keep a gap 2 wide where a slanting stroke comes from a bar that it meets at its end."""
    for corner in ((start[0], end[1]), (end[0], start[1])):
        u, v = corner[0] - end[0], corner[1] - end[1]
        beyond = 2 * corner[0] - start[0], 2 * corner[1] - start[1]
        if corner not in (start, end) and {beyond, (beyond[0] - u, beyond[1] - v)} <= inked:
            x, y = _middle(corner)
            across, up = 2 * abs(v), 2 * abs(u)
            yield 2 * db.Box(x - 2 * u - across, y - 2 * v - up, x - u + across, y - v + up)


def _middle(point: Point) -> Point:
    return point[0] * _PITCH + _PITCH // 2, point[1] * _PITCH + _PITCH // 2
