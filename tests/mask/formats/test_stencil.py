"""Marks without figures that share a piece of edge: what is taken away, and that they can still be read."""

from __future__ import annotations

import numpy as np
import pytest
import zxingcpp
from klayout import db

from maskfab.base.model import CLEAR, Mark
from maskfab.job.shop import parse_shop
from maskfab.mask.figures import PolygonOptions, draw
from maskfab.mask.houses.adaptation import fitted, inner_edges, shared_edges, stencilled, suited
from maskfab.mask.layout import simple_polygon
from maskfab.mask.marks import data_matrix
from maskfab.mask.outlines import outline, text_polygons

RING = np.array([[row in (0, 4) or column in (0, 4) for column in range(5)] for row in range(5)])
STEP_NM = 20_000


def mark_of(mask) -> Mark:
    return Mark("RING", "label", CLEAR, outline(mask, STEP_NM))


def drawn(mark: Mark) -> db.Region:
    region = db.Region([db.Polygon(simple_polygon(polygon)) for polygon in mark.polygons])
    region.merged_semantics = False
    return region


@pytest.mark.parametrize(("narrowest_nm", "bar_nm"), [(0, 4_000), (1_000, 4_000), (3_000, 6_000)])
def test_a_ring_loses_two_bars(narrowest_nm, bar_nm):
    ring = mark_of(RING)
    cut = stencilled(ring, "bisect", narrowest_nm)
    assert not inner_edges(drawn(ring)).is_empty()
    assert inner_edges(drawn(cut)).is_empty()
    assert drawn(ring).merged().area() - drawn(cut).merged().area() == 2 * bar_nm * STEP_NM
    assert stencilled(cut, "bisect", narrowest_nm) is cut


def test_a_hole_on_a_layer_of_its_own_needs_no_bar_unless_something_stands_in_it():
    assert stencilled(mark := mark_of(RING), "layer") is mark
    inhabited = RING.copy()
    inhabited[2, 2] = True
    assert stencilled(mark := mark_of(inhabited), "layer") is not mark


def test_a_mark_without_holes_is_the_mark():
    assert stencilled(mark := mark_of(~RING), "bisect") is mark


def test_nothing_is_shared_of_any_letter_or_code():
    letters = "".join(map(chr, range(33, 127)))
    text = Mark("TEXT", "label", CLEAR, text_polygons(letters, 150_000, (0, 0)))
    code = data_matrix("CODE", (0, 0), "maskfab:0:" + "0123456789abcdef" * 4, 200_000)
    for mark, holes in ((text, "bisect"), (code, "bisect"), (code, "layer")):
        cut = stencilled(mark, holes)
        before, after = (drawn(each).merged().area() for each in (mark, cut))
        assert 0 < before - after < 0.02 * before
        if holes == "bisect":
            assert inner_edges(drawn(cut)).is_empty()
    # Nothing clear stands in a letter's hole.
    assert stencilled(text, "layer") is text


def test_a_stencilled_code_is_read_by_a_camera():
    text = "maskfab:0:" + "0123456789abcdef" * 4
    code = stencilled(data_matrix("CODE", (0, 0), text, 200_000), "layer")
    region = drawn(code).merged()
    box = region.bbox().enlarged(400_000, 400_000)
    step = 20_000
    rows, columns = box.height() // step, box.width() // step
    picture = np.zeros((rows, columns), dtype=np.uint8)
    for polygon in region.decompose_trapezoids_to_region().each():
        part = polygon.bbox()
        x0, x1 = (round((x - box.left) / step) for x in (part.left, part.right))
        y0, y1 = (round((y - box.bottom) / step) for y in (part.bottom, part.top))
        picture[y0:y1, x0:x1] = 255
    picture = np.pad(picture[::-1], 40, constant_values=255)
    # What is light on the plate is light here; the margin stands for the quiet zone.
    picture[:60], picture[-60:], picture[:, :60], picture[:, -60:] = 255, 255, 255, 255
    assert [each.text for each in zxingcpp.read_barcodes(picture)] == [text]


def house(text: str):
    return parse_shop(f'title = "A"\nsources = []\n{text}', "mine", where="mine.toml")


@pytest.mark.parametrize("holes", ["bisect", "layer", "trapezoids"])
def test_marks_of_a_plate_share_nothing_for_a_house_that_minds(small_plate, holes):
    shop = house(f'[polygons]\nshared_boundaries = false\nholes = "{holes}"\n')
    figures = draw(fitted(small_plate, shop), PolygonOptions(holes=holes, notes="none"))
    assert not [each for each in shared_edges(figures) if each.owner.startswith("mark")]
    assert suited(small_plate, house(""), "bisect").marks == small_plate.marks
