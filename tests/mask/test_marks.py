"""Every mark by itself: its clear area as a formula, its symmetry, and its gauges on what is drawn."""

from __future__ import annotations

import math

import numpy as np
import pytest
from klayout import db

from maskfab.base.model import CLEAR, OUTLINE, Die, Opening, Panel, Plate, Tiling
from maskfab.mask.comparison.roundtrip import clear_length_nm
from maskfab.mask.composition import die_map, outlines, title_block
from maskfab.mask.layout import plate_layout, simple_polygon
from maskfab.mask.marks import (
    DrawnMarks,
    alignment_cross,
    bounding_box,
    box_at,
    cd_bars,
    checkerboards,
    code_text,
    corner_letters,
    data_matrix,
    fiducial,
    inner_radius_nm,
    line_space,
    modules,
    parity_mark,
    siemens_star,
)

AT = (-3_000_001, 7_000_003)
FEATURES = (2_000, 4_033, 50_000)


def shapes_of(polygons) -> db.Region:
    """The polygons as they are drawn, not merged."""
    region = db.Region()
    for polygon in polygons:
        region.insert(simple_polygon(polygon))
    return region


def region_of(mark) -> db.Region:
    return shapes_of(mark.polygons).merged(True, 1)


def about_its_middle(region: db.Region) -> db.Region:
    x, y = bounding_box([[(p.x, p.y) for p in polygon.each_point_hull()] for polygon in region.each()])[:2]
    return region.moved(-(2 * x + region.bbox().width()) // 2, -(2 * y + region.bbox().height()) // 2)


def turns_into_itself(region: db.Region) -> list[bool]:
    """For each of the seven moves of a square other than rest."""
    there = about_its_middle(region)
    moves = [db.Trans(turn, mirror, 0, 0) for mirror in (False, True) for turn in range(4)][1:]
    return [(there ^ about_its_middle(there.transformed(move))).is_empty() for move in moves]


def measured(drawn: DrawnMarks) -> list[tuple[int, int]]:
    """Target and clear length of every gauge, on a plate with nothing but these marks."""
    layout = plate_layout(Plate("MARKS", "", 10**8, 10**8, (), drawn.marks, drawn.gauges, ()))
    return [(gauge.target_nm, clear_length_nm(layout, gauge)) for gauge in drawn.gauges]


def test_a_fiducial_is_a_plain_cross():
    cross = fiducial("F", AT, 1_000_000, 50_000)
    assert region_of(cross).area() == (2 * 1_000_000 - 50_000) * 50_000
    assert all(turns_into_itself(region_of(cross)))
    assert (cross.layer, cross.kind) == (CLEAR, "fiducial")


def test_an_alignment_cross_is_thrice_as_broad_outside_and_the_same_after_every_turn():
    length, line = 3_000_000, 40_000
    cross = alignment_cross("A", AT, length, line)
    thin = line**2 + 4 * (length // 4 - line // 2) * line
    assert region_of(cross).area() == thin + 4 * (length // 4) * 3 * line
    assert region_of(cross).bbox() == db.Box(*box_at(AT, (length, length)))
    assert all(turns_into_itself(region_of(cross)))


def test_the_parity_mark_is_no_other_after_any_turn_or_mirror():
    mark = region_of(parity_mark("P", AT, 2_000_000))
    assert mark.area() == 8 * 400_000**2
    assert not any(turns_into_itself(mark))


@pytest.mark.parametrize("feature", FEATURES)
def test_bars_are_multiples_of_the_smallest_feature_both_ways(feature):
    drawn = cd_bars("CD", AT, feature, (1, 2, 5), 500_000)
    assert [region_of(bar).area() for bar in drawn.marks] == [
        multiple * feature * 500_000 for multiple in (1, 2, 5) for _ in "xy"
    ]
    assert all(target == read for target, read in measured(drawn))
    assert [gauge.name for gauge in drawn.gauges][:2] == ["cd_x_1x", "cd_y_1x"]


@pytest.mark.parametrize("feature", FEATURES)
def test_lines_are_as_wide_as_the_spaces_between_them(feature):
    multiples, lines = (1, 1.5, 2, 5), 5
    drawn = line_space("LS", AT, feature, multiples, lines, 200_000)
    widths = [round(feature * multiple) for multiple in multiples for _ in "VH"]
    for group, width in zip(drawn.marks, widths, strict=True):
        length = max(9 * width, 200_000)
        region = region_of(group)
        assert region.count() == lines
        assert region.area() == lines * width * length
        box = region.bbox()
        assert sorted((box.width(), box.height())) == sorted((9 * width, length))
        spaces = db.Region(box) - region
        assert (spaces.count(), spaces.area()) == (lines - 1, (lines - 1) * width * length)
        assert {round(each.bbox().width() * each.bbox().height() / length) for each in spaces.each()} == {width}
    assert [target for target, _ in measured(drawn)] == widths
    assert all(target == read for target, read in measured(drawn))
    assert [group.name for group in drawn.marks][2:4] == ["LS_V_1_5X", "LS_H_1_5X"]


@pytest.mark.parametrize("lines", [2, 3, 6])
def test_the_gauge_of_a_group_crosses_one_line_whatever_their_number(lines):
    drawn = line_space("LS", AT, 3_001, (1, 3), lines, 100_000)
    assert all(target == read for target, read in measured(drawn))


def test_upright_and_lying_groups_differ_by_a_quarter_turn():
    upright, lying = line_space("LS", (0, 0), 4_000, (5,), 5, 10_000).marks
    turned = about_its_middle(region_of(upright)).transformed(db.Trans.R90)
    assert (about_its_middle(turned) ^ about_its_middle(region_of(lying))).is_empty()


@pytest.mark.parametrize(("feature", "spokes"), [(2_000, 36), (4_033, 36), (50_000, 36), (20_000, 72)])
def test_a_star_has_the_area_of_its_trapezia_and_is_the_same_after_every_turn(feature, spokes):
    radius = 1_800_000
    star = siemens_star("S", (0, 0), feature, radius, spokes)
    inner = inner_radius_nm(feature, spokes)
    expected = spokes * (radius**2 - inner**2) * math.sin(math.pi / spokes) / 2
    around = sum(polygon.perimeter() for polygon in shapes_of(star.polygons).each())
    # A vertex moves by at most half a nanometre in x and in y.
    assert abs(region_of(star).area() - expected) <= around * math.sqrt(0.5)
    assert region_of(star).count() == spokes
    assert all(turns_into_itself(region_of(star)))


def test_spokes_start_one_feature_wide_and_as_far_apart():
    feature = 4_000
    star = siemens_star("S", AT, feature, 1_800_000, 36)
    assert 36 * 2 * feature == pytest.approx(2 * math.pi * inner_radius_nm(feature, 36), rel=2e-3)
    for (x0, y0), _, _, (x1, y1) in star.polygons:
        assert math.hypot(x1 - x0, y1 - y0) == pytest.approx(feature, abs=1.5)
    narrowest = db.Region([simple_polygon(polygon) for polygon in star.polygons]).space_check(feature - 5)
    assert narrowest.count() == 0


@pytest.mark.parametrize("feature", FEATURES)
def test_half_of_a_checkerboard_is_clear_and_its_squares_touch_in_corners_alone(feature):
    drawn = checkerboards("DOSE", AT, feature, (1, 2), 10)
    for board, side in zip(drawn.marks, (feature, 2 * feature), strict=True):
        region = region_of(board)
        assert (region.count(), region.area()) == (50, 50 * side**2)
        assert shapes_of(board.polygons).merged(False, 1).area() == region.area()
        box = region.bbox()
        assert (box.width(), box.height()) == (10 * side, 10 * side)
    assert all(target == read for target, read in measured(drawn))


@pytest.mark.parametrize("feature", FEATURES)
def test_a_corner_letter_has_eleven_squares_and_six_corners(feature):
    drawn = corner_letters("L", AT, feature, (1, 2, 5))
    for letter, multiple in zip(drawn.marks, (1, 2, 5), strict=True):
        assert region_of(letter).area() == 11 * (multiple * feature) ** 2
        assert len(letter.polygons[0]) == 6
    assert len({bounding_box(letter.polygons)[1] for letter in drawn.marks}) == 1
    assert all(target == read for target, read in measured(drawn))


@pytest.mark.parametrize("feature", FEATURES)
def test_the_middle_of_a_row_is_its_place(feature):
    rows = {
        "LS": line_space("LS", AT, feature, (1, 1.5, 5), 5, 1_000),
        "DOSE": checkerboards("DOSE", AT, feature, (1, 2), 10),
        "L": corner_letters("L", AT, feature, (1, 2, 5)),
    }
    for drawn in rows.values():
        x0, y0, x1, y1 = bounding_box([polygon for mark in drawn.marks for polygon in mark.polygons])
        assert (x0 + x1, y0 + y1) == pytest.approx((2 * AT[0], 2 * AT[1]), abs=2)
    # Of bars, which lie and stand in turns, the middles are even about it.
    middles = [gauge.centre_nm for gauge in cd_bars("CD", AT, feature, (1, 2, 5), 500_000).gauges]
    assert np.mean(middles, axis=0).tolist() == list(AT)


@pytest.mark.parametrize("draw", [line_space, checkerboards, corner_letters])
def test_figures_of_twice_the_feature_have_four_times_the_area(draw):
    more = {line_space: (4, 1), checkerboards: (8,), corner_letters: ()}[draw]
    small, large = (draw("X", AT, feature, (1, 2, 5), *more).marks for feature in (4_000, 8_000))
    assert [4 * region_of(one).area() for one in small] == [region_of(other).area() for other in large]


def test_the_code_says_who_made_what():
    assert code_text("maskfab 1.2.3 | job 0123 | seeds none", "ab" * 32) == "maskfab:1.2.3:" + "ab" * 32


def test_a_data_matrix_is_clear_where_its_modules_are_light():
    text, side = "maskfab:0.0.0:" + "a1b2c3d4" * 8, 200_000
    light = modules(text)
    mark = data_matrix("CODE", AT, text, side)
    assert light.shape == (34, 34)
    assert region_of(mark).area() == light.sum() * side**2
    assert light[[0, -1]].all()
    assert light[:, [0, -1]].all()
    inside = light[1:-1, 1:-1]
    # A solid bar on the left and one below, broken ones on the right and above: row 0 is the lowest.
    assert not inside[:, 0].any()
    assert not inside[0].any()
    assert np.array_equal(inside[-1], np.arange(32) % 2 == 1)
    assert all(len(set(polygon)) == len(polygon) for polygon in mark.polygons)


def dies(count: int, pitch: int, slot: int = 8_400_000, stem: str = "DIE") -> list[Die]:
    panel = Panel(Opening("o", np.ones((1, 1), bool), 1000), 1000, 0, np.zeros((1, 1), np.int8), Tiling.PERIODIC, None)
    return [Die(f"{stem}_{i}", "", panel, ((2 * i + 1 - count) * pitch // 2, 0), slot) for i in range(count)]


def drawn_map(count: int, pitch: int, slot: int = 8_400_000, stem: str = "DIE"):
    held = dies(count, pitch, slot, stem)
    return die_map("MAP", AT, 11_500_000, 50_000, blank_nm=127_000_000, die_pitch_nm=pitch, dies=held)


def frame_area(side: int, line: int) -> int:
    return side**2 - (side - 2 * line) ** 2 - 2 * 2 * line * line


def test_a_map_is_frames_and_a_little_text():
    crowded = drawn_map(6, 8_500_000, stem="A_NAME_OF_24_CHARACTERS")
    slot = 8_400_000 * 11_500_000 // 127_000_000
    plain = frame_area(11_500_000, 50_000) + 6 * frame_area(slot, 50_000)
    letters = region_of(crowded).area() - plain
    assert 0 < letters < 6 * 0.3 * slot**2, "numbers from 1 to 6 stand for names that are too long"
    assert region_of(crowded).bbox() == db.Box(*box_at(AT, (11_500_000, 11_500_000)))


def test_frames_of_a_map_are_brackets_that_do_not_meet():
    mark = drawn_map(4, 22_000_000, stem="TOLED")
    brackets = [polygon for polygon in mark.polygons[:10] if len(polygon) == 8]
    assert len(brackets) == 10
    apart = shapes_of(brackets).merged(True, 1)
    assert apart.count() == 10
    assert apart.space_check(99_999).count() == 0
    assert (apart & shapes_of(mark.polygons[10:])).is_empty()


@pytest.mark.parametrize("pitch", [600_000, 2_000_000, 12_000_000, 30_000_000, 60_000_000])
@pytest.mark.parametrize("stem", ["D", "A_NAME_OF_24_CHARACTERS"])
def test_names_stay_inside_the_frame_of_the_map_and_off_the_slots(pitch, stem):
    mark = drawn_map(2, pitch, slot=pitch // 2 if pitch < 8_400_000 else 8_400_000, stem=stem)
    assert bounding_box(mark.polygons) == box_at(AT, (11_500_000, 11_500_000))
    letters = shapes_of(mark.polygons[2:]).merged(True, 1)
    assert letters.bbox().inside(db.Box(*box_at(AT, (11_400_000, 11_400_000))))
    assert shapes_of(mark.polygons).merged(False, 2).is_empty()


def test_dies_too_small_for_a_frame_are_full_squares_on_the_map():
    mark = drawn_map(2, 2_000_000, slot=560_000)
    side = 560_000 * 11_500_000 // 127_000_000
    assert sum(polygon.area() == side**2 for polygon in shapes_of(mark.polygons).each()) == 2


def test_a_title_never_leaves_its_room_and_lines_stand_below_it():
    block = title_block("TITLE", "A" * 80, ["b" * 80, "c"], (0, 0), 1_500_000, 400_000, 20_000_000)
    x0, y0, x1, y1 = bounding_box(block.polygons)
    assert max(-x0, x1) <= 10_100_000
    assert y1 <= 1_500_000
    assert -1_700_000 <= y0 <= -1_500_000


def test_outlines_are_never_written():
    frames = outlines(127_000_000, 100_000_000, dies(2, 22_000_000))
    assert {frame.layer for frame in frames} == {OUTLINE}
    assert not OUTLINE.written
    assert [region_of(frame).area() for frame in frames] == [
        side**2 - (side - 40_000) ** 2 for side in (127_000_000, 100_000_000, 8_400_000, 8_400_000)
    ]
