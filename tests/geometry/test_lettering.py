from __future__ import annotations

import pytest
from klayout import db

from maskfab.errors import JobError
from maskfab.geometry.lettering import fitted_text, text_polygons

PRINTABLE = "".join(map(chr, range(ord("!"), ord("~") + 1)))


def region_of(polygons):
    region = db.Region()
    for polygon in polygons:
        region.insert(db.SimplePolygon([db.Point(*point) for point in polygon], True))
    return region


@pytest.mark.parametrize("character", PRINTABLE)
def test_every_letter_is_simple_and_has_the_area_of_the_font(character):
    polygons = text_polygons(character, 28 * 25, (0, 0))
    region = region_of(polygons)
    drawn = db.TextGenerator.default_generator().text(character, 0.001, 1.0)
    assert (region ^ drawn).is_empty()
    assert sum(polygon.area() for polygon in region.each()) == region.merged().area()
    assert all(len(set(polygon)) == len(polygon) for polygon in polygons)


def test_height_and_anchor():
    box = region_of(text_polygons("HIJ", 1_500_000, (1000, -2000))).bbox()
    assert (box.left, box.bottom) == (1000, -2000)
    assert abs(box.height() - 1_500_000) <= 14


def test_centred_text_is_centred():
    box = region_of(text_polygons("OHO", 280_000, (5000, 0), align="centre")).bbox()
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
