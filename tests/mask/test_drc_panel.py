"""Counts and places on panels against KLayout's own checks on the flat, merged plate."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from klayout import db
from sweeps import examples, sweep

from maskfab.base.model import CLEAR, Die, Opening, Panel, Plate, Tiling
from maskfab.mask.design_rules import DesignRules
from maskfab.mask.dots import corner_touches, die_edges_nm, die_raster, smallest_runs
from maskfab.mask.layout import plate_layout, region
from maskfab.mask.panel_rules import narrowest
from maskfab.mask.plate_rules import check_plate

EVERY = 10**6


def plate_of(panel):
    side = max(panel.size_nm) + 2
    return Plate("plate", "", 10**8, 10**8, (Die("A", "a", panel, (1000, -3000), side),), (), (), ())


def panel_of(masks, orientations, dot_nm=8000, gutter_nm=0):
    openings = [Opening(f"o{k}", mask, dot_nm) for k, mask in enumerate(masks)]
    return Panel(openings[0], dot_nm, gutter_nm, orientations, Tiling.RANDOM, 1, others=tuple(openings[1:]))


def flat(plate):
    clear = region(plate_layout(plate), CLEAR)
    clear.merged_semantics = False
    return clear


def hulls(pairs):
    found = []
    for pair in pairs.each():
        box = pair.bbox()
        found.append((box.left, box.bottom, box.right, box.top))
    return sorted(found)


def polygon_boxes(polygons):
    return sorted((b.left, b.bottom, b.right, b.top) for b in (polygon.bbox() for polygon in polygons))


def islands(clear, box):
    return [polygon for polygon in (db.Region(box) - clear).merged(True, 1).each() if polygon.bbox() != box]


def rounded(boxes):
    """KLayout rounds the ends of slanted distances to whole nanometres, not the same everywhere."""
    return sorted(tuple((value + 37) // 100 for value in box) for box in boxes)


def agrees(plate, d, area, kissing=True):
    """All rules on a plate with one die and no marks, every violation placed."""
    rules = DesignRules(
        min_width_nm=d, min_space_nm=d, min_notch_nm=d, min_area_nm2=area, no_corner_touch=True, kissing=kissing
    )
    zero = {} if kissing else {"zero_distance_mode": db.Region.NeverIncludeZeroDistance}
    results = {r.rule: r for r in check_plate(plate, rules, most=EVERY) if r.die == "A"}
    clear = flat(plate)
    outside = clear.bbox().enlarged(1, 1)
    expected = {
        "width": hulls(clear.width_check(d, **zero)),
        "space": hulls(clear.space_check(d, **zero)),
        "notch": hulls(clear.notch_check(d, **zero)),
        "area": polygon_boxes(clear.with_area(0, area, False).each()),
        "chrome_area": polygon_boxes(p for p in islands(clear, outside) if p.area() < area),
    }
    for rule, boxes in expected.items():
        places = results[rule].places
        # The marker of a long space may end where its neighbourhood does.
        known = 2 if rule == "space" else 4
        assert rounded(place[:known] for place in places) == rounded(box[:known] for box in boxes), rule
        assert results[rule].count == len(boxes)
    spaces = list(clear.space_check(d, **zero).each())
    if spaces and not any(edge.is_degenerate() for pair in spaces for edge in (pair.first, pair.second)):
        # KLayout takes two points to be no distance apart.
        assert results["space"].value == pytest.approx(min(pair.distance() for pair in spaces), abs=1)
    return results


@st.composite
def panels(draw):
    dots = draw(st.integers(3, 6))
    seed = draw(st.integers(0, 2**32 - 1))
    rng = np.random.default_rng(seed)
    masks = rng.random((draw(st.integers(1, 2)), dots, dots)) < draw(st.sampled_from((0.1, 0.3, 0.5, 0.7, 0.9)))
    rows, columns = draw(st.integers(1, 7)), draw(st.integers(1, 7))
    turns = rng.integers(0, 8 * len(masks), (rows, columns))
    return panel_of(masks, turns, 8000, draw(st.sampled_from((0, 2000, 8000, 20_000))))


@given(panels(), st.sampled_from((1, 5, 8, 9, 11, 12, 17, 25, 40)), st.sampled_from((64, 65, 129, 700)), st.booleans())
@examples(150)
def test_violations_are_those_of_klayout_flat(panel, d, area, kissing):
    agrees(plate_of(panel), d * 1000, area * 10**6, kissing)


def least(pairs):
    """Edges at right angles to the axes: the gap between their hulls."""
    gaps = [math.inf]
    for pair in pairs.each():
        one, two = pair.first.bbox(), pair.second.bbox()
        across = max(0, one.left - two.right, two.left - one.right)
        up = max(0, one.bottom - two.top, two.bottom - one.top)
        gaps.append(math.hypot(across, up))
    return min(gaps)


@given(panels())
@examples(80)
def test_the_narrowest_places_are_those_of_klayout_flat(panel):
    plate = plate_of(panel)
    clear, (die,) = flat(plate), plate.dies
    never = db.Region.NeverIncludeZeroDistance
    runs = smallest_runs(die_raster(die), *die_edges_nm(die))
    # A run is a distance, so nothing that lies further apart is the least.
    reach = [int(min(run, 2 * max(panel.size_nm))) + 1 for run in (runs.clear, runs.opaque)]
    for tone, pairs in (
        ("clear", clear.width_check(reach[0], zero_distance_mode=never)),
        ("opaque", clear.space_check(reach[1], zero_distance_mode=never)),
    ):
        found, placed = narrowest(die, tone), narrowest(die, tone, placed=True)
        # Ends of slanted distances are rounded to whole nanometres.
        assert found.value_nm == pytest.approx(least(pairs), abs=1), tone
        assert found.value_nm == placed.value_nm
        assert (placed.place is None) == math.isinf(found.value_nm)


def test_kisses_hide_no_diagonal_space():
    """Corners across a gutter of 0.6 um are 0.85 um apart, whether or not corners kiss elsewhere in the cell."""
    mask = np.zeros((7, 7), dtype=np.bool_)
    mask[0, 0] = mask[6, 6] = True
    kissing = mask.copy()
    kissing[3, 3] = kissing[4, 4] = True
    for opening in (mask, kissing):
        panel = panel_of([opening], np.zeros((4, 4), dtype=np.int64), 8000, 600)
        found = narrowest(plate_of(panel).dies[0], "opaque", placed=True)
        assert found.value_nm == pytest.approx(600 * math.sqrt(2))
        x0, y0, x1, y1 = found.place
        assert (x1 - x0, y1 - y0) == (600, 600) or min(x1 - x0, y1 - y0) >= 600


@pytest.mark.parametrize(("d", "gutter_nm"), sweep([(9000, 0), (9000, 8000), (17_000, 0), (4000, 8000)], 2))
def test_a_large_panel_of_two_openings(d, gutter_nm):
    rng = np.random.default_rng(5)
    masks = rng.random((2, 9, 9)) < 0.35
    agrees(plate_of(panel_of(masks, rng.integers(0, 16, (12, 12)), 8000, gutter_nm)), d, 129 * 10**6)


def test_long_bars_through_many_cells_are_one_violation_each():
    mask = np.zeros((4, 4), dtype=np.bool_)
    mask[:, 1] = True
    panel = panel_of([mask], np.zeros((5, 6), dtype=np.int64))
    results = agrees(plate_of(panel), 9000, 10**6)
    assert results["width"].count == 6
    assert results["width"].value == 8000
    assert results["space"].count == 0
    assert results["corner_touch"].count == 0


def test_the_first_places_are_the_lowest_of_all():
    rng = np.random.default_rng(3)
    plate = plate_of(panel_of([rng.random((5, 5)) < 0.4], rng.integers(0, 8, (8, 8))))
    rules = DesignRules(min_width_nm=9000, min_space_nm=9000, min_area_nm2=10**8, no_corner_touch=True)
    every = {r.rule: r for r in check_plate(plate, rules, most=EVERY) if r.die == "A"}
    for result in check_plate(plate, rules, most=5):
        if result.die == "A":
            assert [b[:2] for b in result.places] == [b[:2] for b in every[result.rule].places[:5]]
            assert (result.count, result.value) == (every[result.rule].count, every[result.rule].value)


@given(panels())
@settings(max_examples=30)
def test_corner_touches_are_counted_as_on_the_whole_raster(panel):
    ring = int(panel.gutter_nm > 0)
    cells = [[np.pad(panel.pattern(int(v)), ring) for v in row] for row in panel.orientations]
    rules = DesignRules(no_corner_touch=True)
    (result,) = (r for r in check_plate(plate_of(panel), rules, most=EVERY) if r.die == "A")
    assert result.count == corner_touches(np.block(cells))
    points = {place[:2] for place in result.places}
    assert len(points) == result.count
    assert all(place[:2] == place[2:] for place in result.places)


def test_a_tone_of_its_own_breaks_nothing():
    rules = DesignRules(min_width_nm=9000, min_space_nm=9000, min_notch_nm=9000, min_area_nm2=10**8)
    for mask in (np.zeros((3, 3), dtype=np.bool_), np.ones((3, 3), dtype=np.bool_)):
        plate = plate_of(panel_of([mask], np.zeros((4, 4), dtype=np.int64)))
        assert all(result.passed for result in check_plate(plate, rules))


def test_behind_a_gutter_every_cell_counts_for_itself():
    rng = np.random.default_rng(11)
    mask, turns = rng.random((21, 21)) < 0.3, rng.integers(0, 8, (150, 150))
    rules = DesignRules(min_width_nm=9000, min_space_nm=9000, min_notch_nm=9000, min_area_nm2=65 * 10**6)
    many = check_plate(plate_of(panel_of([mask], turns, gutter_nm=10_000)), rules)
    one = [check_plate(plate_of(panel_of([mask], np.array([[k]]), gutter_nm=10_000)), rules) for k in range(8)]
    for n, result in enumerate(many):
        assert result.count == sum(one[k][n].count * int((turns == k).sum()) for k in range(8))


def test_turning_a_panel_over_turns_its_violations_over():
    rng = np.random.default_rng(12)
    mask, turns = rng.random((6, 6)) < 0.45, rng.integers(0, 8, (6, 9))
    rules = DesignRules(min_width_nm=9000, min_space_nm=17_000, min_notch_nm=9000, min_area_nm2=129 * 10**6)
    plain = panel_of([mask], turns)
    cells = np.block([[plain.pattern(int(code)) for code in row] for row in turns])
    square = np.zeros((54, 54), dtype=np.bool_)
    square[:36] = cells
    whole = panel_of([square.T], np.array([[0]]))
    for one, other in zip(check_plate(plate_of(plain), rules), check_plate(plate_of(whole), rules), strict=True):
        assert (one.rule, one.count, one.value) == (other.rule, other.count, other.value)
