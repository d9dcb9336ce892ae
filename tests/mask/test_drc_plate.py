"""Rules on polygons as drawn, on names and on plates; flat layouts."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from klayout import db

from maskfab.base.errors import JobError
from maskfab.base.model import CLEAR, Die, Mark
from maskfab.mask.design_rules import DesignRules, distance_checks, facing_edges, flat_results, merged
from maskfab.mask.layout import plate_layout, region
from maskfab.mask.plate_rules import check_plate, drawn_polygons

EVERY = 10**6
RULES = DesignRules(
    min_width_nm=5000,
    min_space_nm=5000,
    min_notch_nm=5000,
    min_area_nm2=50_000_000,
    grid_nm=5,
    manhattan=True,
    no_acute_angles=True,
    no_corner_touch=True,
    no_overlap=True,
    max_vertices=20,
    max_references=30,
    name_pattern="[A-Z_]+",
    forbidden_names=("ring", "cd"),
    max_name_length=8,
    extent_nm=(2_100_000, 8_000_000),
)


def layout_of(*polygons, name="TOP"):
    layout = db.Layout()
    layout.dbu = 0.001
    top, layer = layout.create_cell(name), layout.layer(CLEAR.number, CLEAR.datatype)
    for polygon in polygons:
        top.shapes(layer).insert(db.Polygon([db.Point(x, y) for x, y in polygon], True))
    return layout


def flat(layout, rules, most=16):
    """Every rule on geometry, of a layout that is flattened."""
    index = layout.find_layer(CLEAR.number, CLEAR.datatype)
    return flat_results(merged(region(layout, CLEAR)), drawn_polygons(layout, [index]), rules, most)


def box(x0, y0, x1, y1):
    return (x0, y0), (x0, y1), (x1, y1), (x1, y0)


def by_rule(results):
    return {result.rule: result for result in results}


def test_a_plate_breaks_the_rules_that_its_layout_breaks(small_plate):
    plate, layout = check_plate(small_plate, RULES), by_rule(flat(plate_layout(small_plate), RULES))
    for rule, whole in layout.items():
        parts = [result for result in plate if result.rule == rule and result.limit == whole.limit]
        assert sum(part.count for part in parts) == whole.count, rule
        values = [part.value for part in parts if part.value is not None]
        assert whole.value in values or (whole.value is None and not values), rule
    assert {result.die for result in plate} == {"PERIODIC", "DENSE", "RANDOM", None}
    assert layout["vertices"].count > 0
    assert layout["grid"].count > 0
    bar = next(result for result in plate if result.rule == "width" and result.die is None)
    assert (bar.value, bar.count) == (2000, 1)
    # A polygon that kisses itself has no width there.
    assert layout["width"].value == 0


def test_places_lie_in_their_die(small_plate):
    boxes = {die.name: die.box_nm for die in small_plate.dies}
    placed = [result for result in check_plate(small_plate, RULES) if result.die and result.places]
    assert placed
    for result in placed:
        x0, y0, x1, y1 = boxes[result.die]
        for a, b, c, d in result.places:
            assert x0 <= a <= c <= x1
            assert y0 <= b <= d <= y1


def test_a_mark_that_comes_too_close_is_checked_together_with_the_die(small_plate):
    x0, y0, _, _ = small_plate.dies[1].box_nm
    rules = DesignRules(min_space_nm=5000, min_area_nm2=10**6)
    beside = Mark("NEAR", "cd", CLEAR, (box(x0 - 20_000, y0, x0 - 1000, y0 + 60_000),))
    plate = replace(small_plate, dies=small_plate.dies[1:2], marks=(beside,))
    space = by_rule(check_plate(plate, rules))["space"]
    assert space.die is None
    assert space.value in {0, 1000}
    assert space.count == by_rule(flat(plate_layout(plate), rules))["space"].count
    alone = by_rule(check_plate(replace(plate, marks=()), rules)[:1])["space"]
    assert space.count > alone.count


def test_every_cell_is_looked_at_where_it_lies_on_the_grid(small_plate):
    die = small_plate.dies[1]
    rules = DesignRules(grid_nm=7)
    for centre in ((1, 1), (5, 4)):
        moved = Die(die.name, die.label, die.panel, centre, die.slot_nm)
        plate = replace(small_plate, dies=(moved,), marks=())
        grid, whole = check_plate(plate, rules, most=EVERY)[0], flat(plate_layout(plate), rules, most=EVERY)[0]
        assert (grid.count, grid.value, grid.places) == (whole.count, whole.value, whole.places)


def test_what_is_drawn_slanted_acute_or_twice():
    triangle = ((0, 0), (0, 10_000), (30_000, 0))
    found = by_rule(flat(layout_of(triangle, box(50_000, 0, 60_000, 10_000), box(55_000, 0, 70_000, 4000)), RULES))
    assert (found["manhattan"].count, found["manhattan"].places) == (1, ((0, 0, 30_000, 10_000),))
    assert found["manhattan"].value == pytest.approx(np.degrees(np.arctan(1 / 3)))
    assert found["acute_angle"].count == 2
    assert found["acute_angle"].value == pytest.approx(np.degrees(np.arctan(1 / 3)))
    assert (found["overlap"].count, found["overlap"].value) == (1, 5000 * 4000)
    assert found["overlap"].places == ((55_000, 0, 60_000, 4000),)


def test_widths_spaces_and_islands_by_hand():
    frame = [box(0, 0, 60_000, 20_000), box(0, 20_000, 20_000, 26_000), box(26_000, 20_000, 60_000, 26_000)]
    bars = [box(0, 26_000, 60_000, 46_000), box(100_000, 0, 103_000, 50_000), box(107_000, 0, 127_000, 50_000)]
    found = by_rule(flat(layout_of(*frame, *bars), RULES))
    assert (found["width"].value, found["width"].count) == (3000, 1)
    assert found["width"].places == ((100_000, 0, 103_000, 50_000),)
    assert (found["space"].value, found["space"].places) == (4000, ((103_000, 0, 107_000, 50_000),))
    assert found["notch"].passed
    assert (found["chrome_area"].value, found["chrome_area"].places) == (
        36_000_000,
        ((20_000, 20_000, 26_000, 26_000),),
    )
    assert found["area"].passed


def disc(diameter, sides=64):
    angle = np.arange(sides) * 2 * np.pi / sides + 0.3
    return db.Region(
        db.Polygon([db.Point(*map(round, diameter / 2 * each)) for each in np.c_[np.cos(angle), np.sin(angle)]])
    )


def least(region, rule, limit):
    """The least value that breaks a rule on distances, nanometres; infinite if nothing does."""
    _, check = distance_checks(DesignRules(**{f"min_{rule}_nm": limit}))[rule]
    return facing_edges(check(region)).values.min(initial=np.inf)


@pytest.mark.parametrize("sides", [8, 16, 64])
def test_a_disc_is_as_wide_as_its_diameter_as_hole_and_as_island(sides):
    """KLayout takes the chords between edges a quarter of the round apart for widths, too."""
    wide = 20_000 * np.cos(np.pi / sides)  # across the flats
    around = db.Region(db.Box(-50_000, -50_000, 50_000, 50_000)) - disc(20_000, sides)
    for shape, rules in ((disc(20_000, sides), ["width"]), (around, ["space", "notch"])):
        for rule in rules:
            assert least(shape, rule, 22_000) == pytest.approx(wide, abs=2)
            assert least(shape, rule, int(wide) - 3) == np.inf


def test_narrow_places_of_slanted_shapes_are_found():
    square = disc(20_000, 4)
    assert least(square, "width", 15_000) == pytest.approx(20_000 / 2**0.5, abs=2)
    apart = disc(20_000) + disc(20_000).moved(17_000, 17_000)
    assert least(apart, "space", 9_000) == pytest.approx(17_000 * 2**0.5 - 20_000, abs=20)
    # Corners that point at each other, of edges none of which are parallel.
    corners = [(0, 9_000), (20_000, 11_000), (11_000, 800), (19_000, -9_000), (1_000, -8_000), (8_000, -500)]
    waist = db.Region(db.Polygon([db.Point(*corner) for corner in corners]))
    at = facing_edges(distance_checks(DesignRules(min_width_nm=4_000))["width"][1](waist))
    assert np.isclose(at.values, np.hypot(3_000, 1_300)).any()


def test_names(small_plate):
    results = check_plate(small_plate, RULES)
    found = by_rule(results)
    forbidden = {r.limit: r.names for r in results if r.rule == "forbidden_name"}
    assert all("RING" in name for name in forbidden["ring"])
    assert forbidden["cd"] == ("CD_2UM",)
    assert "TITLE" not in found["name_pattern"].names
    assert "CD_2UM" in found["name_pattern"].names
    assert found["name_length"].value == max(len(name) for name in found["name_length"].names)
    assert (found["references"].value, found["references"].count) == (47, 1)
    assert found["extent"].count > 0
    (alone,) = check_plate(small_plate, DesignRules(extent_nm=(10**7, 10**7)))
    assert alone.passed


def test_the_limits_themselves_are_kept():
    exact = box(-5000, -5000, 5000, 5000)
    rules = DesignRules(min_width_nm=10_000, min_area_nm2=10**8, max_vertices=4)
    assert all(result.passed for result in flat(layout_of(exact), rules))
    tight = DesignRules(min_width_nm=10_001, min_area_nm2=10**8 + 1, max_vertices=3)
    assert [result.count for result in flat(layout_of(exact), tight)] == [1 + 1, 1, 0, 1]


def test_no_rule_no_result(small_plate):
    assert check_plate(small_plate, DesignRules()) == ()
    assert flat(layout_of(), DesignRules()) == ()
    assert all(result.passed for result in flat(layout_of(), RULES))


@pytest.mark.parametrize(
    "wrong", [{"min_width_nm": 0}, {"grid_nm": -5}, {"extent_nm": (0, 1)}, {"max_vertices": 0}, {"name_pattern": "["}]
)
def test_rules_that_cannot_be_checked_are_refused(wrong):
    with pytest.raises(JobError, match="MF417"):
        DesignRules(**wrong)


@pytest.mark.parametrize(
    ("corners", "width"),
    [
        pytest.param([(0, 0), (30000, 0), (30000, 3000), (0, 3000)], 3000, id="bar"),
        pytest.param([(0, 0), (20000, -6000), (20000, 7500), (0, 1500)], 1500, id="blunt end of a wedge"),
        pytest.param(
            [(0, 0), (30000, 0), (30000, 10000), (16000, 1200), (0, 10000)], 1200, id="corner that points at an edge"
        ),
        pytest.param(
            [(-10000, -20000), (10000, -20000), (1000, 0), (10000, 20000), (-10000, 20000), (-1000, 0)],
            2000,
            id="corners that point at each other",
        ),
        pytest.param([(0, 0), (30000, 0), (30000, 10000), (14000, 10000), (12000, 4000), (0, 4000)], 4000, id="step"),
    ],
)
@pytest.mark.parametrize("degrees", [0, 17, 45, 118, 271.5])
def test_no_narrow_place_is_lost_in_whatever_direction(corners, width, degrees):
    turned = db.DPolygon([db.DPoint(*corner) for corner in corners])
    region = db.Region(turned.transformed(db.DCplxTrans(1, degrees, False, 17, -5)).to_itype(1))

    def narrow(limit):
        """Pairs that do not share a corner, which is acute or within a rounding of a right angle."""
        pairs = distance_checks(DesignRules(min_width_nm=limit))["width"][1](region)
        return [pair for pair in pairs.each() if pair.distance() > 0]

    assert narrow(round(1.01 * width))
    assert not narrow(round(0.98 * width))
