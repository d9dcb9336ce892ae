from __future__ import annotations

import pytest
from klayout import db

from maskfab.base.errors import JobError
from maskfab.mask.outlines import fitted_text, text_polygons, text_width_nm

PRINTABLE = "".join(map(chr, range(ord("!"), ord("~") + 1)))


def region_of(polygons):
    region = db.Region()
    for polygon in polygons:
        region.insert(db.SimplePolygon([db.Point(*point) for point in polygon], True))
    return region


@pytest.mark.parametrize("character", PRINTABLE)
def test_every_letter_is_simple_and_of_whole_strokes(character):
    polygons = text_polygons(character, 28 * 100, (0, 0))
    region = region_of(polygons)
    box = region.bbox()
    assert 0 <= box.left < box.right <= 2000
    assert 0 <= box.bottom < box.top <= 2800
    assert sum(polygon.area() for polygon in region.each()) == region.merged().area()
    assert all(len(set(polygon)) == len(polygon) for polygon in polygons)
    assert all(value % 100 == 0 for polygon in polygons for point in polygon for value in point)
    for edge in region.merged().edges().each():
        assert 0 in (edge.dx(), edge.dy()) or abs(edge.dx()) == abs(edge.dy())
    assert region.width_check(400).is_empty()
    # Limbs that meet at 45 degrees are nearer in the corner between them.
    assert region.merged().space_check(400, ignore_angle=45).is_empty()
    assert region.merged().space_check(200).is_empty()


def test_small_letters_look_like_capitals():
    for capital in map(chr, range(ord("A"), ord("Z") + 1)):
        assert text_polygons(capital.lower(), 2800, (0, 0)) == text_polygons(capital, 2800, (0, 0))


def test_height_and_anchor():
    box = region_of(text_polygons("HIJ", 1_500_000, (1000, -2000))).bbox()
    assert (box.left, box.bottom) == (1000, -2000)
    assert abs(box.height() - 1_500_000) <= 14


def test_letters_stand_in_cells():
    boxes = [region_of(text_polygons(text, 28_000, (0, 0))).bbox() for text in ("H", "H H", "H H ")]
    assert [box.right for box in boxes] == [20_000, 68_000, 68_000]
    assert [text_width_nm(text, 28_000) for text in ("H", "H H", "H H ", "", " ")] == [20_000, 68_000, 68_000, 0, 0]


@pytest.mark.parametrize("text", ["OHO", "OHO  ", "OIO"])
def test_centred_text_is_centred(text):
    box = region_of(text_polygons(text, 280_000, (5000, 0), align="centre")).bbox()
    assert abs(box.center().x - 5000) <= 1


def test_spaces_alone_draw_nothing():
    assert text_polygons("   ", 1000, (0, 0)) == ()


@pytest.mark.parametrize("text", ["168 µm", "Maßstab", "line\nbreak", "tab\t"])
def test_what_the_font_lacks_is_refused_by_name(text):
    with pytest.raises(JobError) as caught:
        text_polygons(text, 1000, (0, 0))
    assert caught.value.code == "MF110"
    assert repr(text) in caught.value.what


def test_text_is_made_smaller_only_where_it_would_be_wider_than_its_room():
    wide = text_polygons("WIDE", 400_000, (0, 0), align="centre")
    width = region_of(wide).bbox().width()
    assert fitted_text("WIDE", 400_000, (0, 0), width) == wide
    narrow = region_of(fitted_text("WIDE", 400_000, (0, 0), width // 3)).bbox()
    assert abs(narrow.width() - width / 3) <= 1e-3 * width
    assert abs(narrow.center().x) <= 1
    assert fitted_text("", 400_000, (0, 0), 1) == ()
