"""Letters of the plate and the judge's pictures of them: two tables by hand, which have to say the same."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from klayout import db
from sweeps import sweep

from maskfab.mask.judge.dies import Boundary
from maskfab.mask.judge.marks import ADVANCE, HEIGHT, area_steps2, drawing, points
from maskfab.mask.judge.marks import read as read_letters
from maskfab.mask.outlines import text_polygons

LETTERS = "".join(map(chr, range(ord("!"), ord("~") + 1)))
HEIGHT_NM = 420_000
STEP_NM = HEIGHT_NM // 28
LEFT, BASE = -1_234_567, 89


def drawn(text, height_nm=HEIGHT_NM):
    return [np.array(polygon) for polygon in text_polygons(text, height_nm, (LEFT, BASE))]


def area(polygons):
    """Shoelace formula."""
    return sum(abs(np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y)) / 2 for x, y in (part.T for part in polygons))


def seen(polygons, letters, left=LEFT, base=BASE, step=STEP_NM):
    boundary = Boundary.of_polygons([tuple(map(tuple, part.tolist())) for part in polygons])
    return boundary.seen(left + step * points(letters * ADVANCE), base + step * points(HEIGHT)) != 0


def read(polygons, letters, **place):
    return read_letters(seen(polygons, letters, **place))


def difference(polygons, text, **place):
    return area_steps2(seen(polygons, len(text), **place) ^ drawing(text))


def ink_steps2(text):
    return area_steps2(drawing(text))


@pytest.mark.parametrize("letter", [" ", *LETTERS])
def test_font_and_judge_agree_on_every_letter(letter):
    polygons = drawn(letter)
    assert read(polygons, 1) == letter.upper()
    assert difference(polygons, letter) == 0
    assert area(polygons) == ink_steps2(letter) * STEP_NM**2


@pytest.mark.parametrize("letter", sweep(LETTERS[::3] + LETTERS[1::3] + LETTERS[2::3], len(LETTERS) // 3))
def test_every_other_letter_is_another(letter):
    polygons = drawn(letter)
    told = {other for other in LETTERS.upper() if difference(polygons, other) > 0}
    assert told == set(LETTERS.upper()) - {letter.upper()}


@given(
    text=st.text(" " + LETTERS, min_size=1, max_size=9),
    cut=st.sampled_from(["boxes", "trapezoids", "triangles", "across"]),
    seed=st.integers(0, 9),
)
def test_lines_are_read_from_any_pieces(text, cut, seed):
    region = db.Region(
        [db.Polygon([db.Point(*point) for point in part]) for part in text_polygons(text, 28_000, (0, 0))]
    )
    if cut == "across":
        halves = db.Box(-100, -100, 300_000, 13_333), db.Box(-100, 13_333, 300_000, 30_000)
        pieces = [piece for half in halves for piece in (region & db.Region(half)).each()]
    elif cut == "triangles":
        pieces = list(region.delaunay().each())
    else:
        mode = db.Polygon.TD_htrapezoids if cut == "boxes" else db.Polygon.TD_vtrapezoids
        pieces = list(region.decompose_trapezoids_to_region(mode).each())
    polygons = [np.array([(point.x, point.y) for point in piece.to_simple_polygon().each_point()]) for piece in pieces]
    polygons = [polygon[:: (-1) ** number] for number, polygon in enumerate(polygons)]
    np.random.default_rng(seed).shuffle(polygons)
    place = {"left": 0, "base": 0, "step": 1000}
    assert read(polygons, len(text), **place) == text.upper()
    assert difference(polygons, text, **place) == 0


def test_a_hole_reached_by_a_cut_is_a_hole():
    (ring,) = (
        np.array([(0, 0), (5, 0), (5, 7), (0, 7), (0, 2), (1, 2), (1, 6), (4, 6), (4, 1), (1, 1), (1, 2), (0, 2)]),
    )
    (whole,) = (np.array([(0, 0), (5, 0), (5, 7), (0, 7)]),)
    ring, whole = ring * 4000, whole * 4000
    place = {"left": 0, "base": 0, "step": 1000}
    assert read([ring], 1, **place) == read([whole], 1, **place) == "?"
    assert difference([whole], " ", **place) == 560
    assert difference([ring], " ", **place) == 560 - 15 * 16


def test_mirrored_lines_are_told():
    text = "F 0.9 maskfab"
    width = len(text) * ADVANCE - 4
    within = [part * (-1, 1) + (2 * LEFT + width * STEP_NM, 0) for part in drawn(text)]
    assert read(within, 13).rstrip("AMOUVWXYI018") != "F 0.9 MASKFAB".rstrip("AMOUVWXYI018")
    assert read([part * (-1, 1) + (2 * LEFT + 20 * STEP_NM, 0) for part in drawn("F")], 1) == "?"
    assert difference(within, text) > 100


def test_dropped_and_exchanged_letters_are_told():
    polygons = drawn("identity")
    per_letter = [len(drawn(letter)) for letter in "identity"]
    dropped = polygons[per_letter[0] :]
    assert read(dropped, 8) == " DENTITY"
    assert difference(dropped, "identity") == ink_steps2("i")
    assert read(drawn("1dentity"), 8) == "1DENTITY"
    assert read([*polygons, np.array([(0, 0), (4, 0), (4, 4), (0, 4)]) * STEP_NM + (LEFT, BASE)], 8)[0] == "?"


@pytest.mark.parametrize("way", [(1, 0), (-1, 0), (0, 1), (0, -1)])
def test_shifts_are_told(way):
    polygons = drawn("maskfab 0.9")
    for share, least in ((1 / 3, 10), (1 / 2, 20), (2, 100)):
        moved = [part + (np.array(way) * (share * STEP_NM + 1)).astype(int) for part in polygons]
        assert difference(moved, "maskfab 0.9") > least
    half_a_square = [part + np.array(way) * (2 * STEP_NM + 1) for part in polygons]
    assert read(half_a_square, 11) != "MASKFAB 0.9"
