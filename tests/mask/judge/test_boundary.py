"""Boundaries of whole numbers: equal for equal shapes however they are cut, and for no others."""

from __future__ import annotations

from itertools import product
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from klayout import db

from maskfab.mask.judge.dies import Boundary, die_of, figures, narrowed, nearest_die, total

LAYER = db.LayerInfo(1, 0)
NUMBERS = st.integers(-40, 40)
POINTS = st.tuples(NUMBERS, NUMBERS)
HALVES = st.lists(st.tuples(POINTS, st.integers(1, 40), st.integers(0, 4)), min_size=1, max_size=4)


def layout_of(*polygons: db.Polygon) -> tuple[db.Layout, db.Shapes]:
    layout = db.Layout()
    shapes = layout.create_cell("TOP").shapes(layout.layer(LAYER))
    for polygon in polygons:
        shapes.insert(polygon)
    return layout, shapes


def boundary(layout: db.Layout) -> Boundary:
    return total(Boundary.of_edges(each.edges).at(each.places) for _, each in figures(layout, LAYER))


def merged(halves) -> db.Region:
    """The union of squares and of their halves, of even sides, so that they cross on whole nanometres."""
    drawn = db.Region()
    for (x, y), side, lacks in halves:
        corners = [(0, 0), (0, side), (side, side), (side, 0)]
        kept = [corner for number, corner in enumerate(corners) if number != lacks]
        drawn.insert(db.Polygon([db.Point(2 * (x + right), 2 * (y + up)) for right, up in kept]))
    return drawn.merged()


@given(one=HALVES, other=HALVES)
def test_boundaries_are_equal_where_shapes_are(one, other):
    first, second = merged(one), merged(other)
    found = boundary(layout_of(*first.each())[0])
    apart = total([found, boundary(layout_of(*second.each())[0]).times(-1)])
    assert apart.empty == (first ^ second).is_empty()
    pieces = list(first.delaunay().each())
    assert len(pieces) >= len(list(first.each()))
    assert total([found, boundary(layout_of(*pieces)[0]).times(-1)]).empty


@given(cells=st.lists(st.tuples(POINTS, st.integers(0, 7)), min_size=1, max_size=5), array=st.integers(1, 3))
def test_hierarchies_are_followed_as_by_flattening(cells, array):
    layout, _ = layout_of()
    layer, top = layout.layer(LAYER), layout.top_cell()
    child, grandchild = layout.create_cell("CHILD"), layout.create_cell("GRANDCHILD")
    grandchild.shapes(layer).insert(db.Polygon([db.Point(0, 0), db.Point(0, 30), db.Point(20, 10), db.Point(20, 0)]))
    child.shapes(layer).insert(db.Box(1000, 2, 1007, 5))
    step = db.Vector(100, 0), db.Vector(0, 150)
    child.insert(db.CellInstArray(grandchild.cell_index(), db.Trans(1, True, 7, 9), *step, array, 2))
    for (x, y), turn in cells:
        top.insert(db.CellInstArray(child.cell_index(), db.Trans(turn % 4, turn > 3, 9000 * x, 9000 * y)))
    flat, _ = layout_of(*db.Region(top.begin_shapes_rec(layer)).each())
    assert total([boundary(layout), boundary(flat).times(-1)]).empty
    assert not boundary(layout).empty
    assert len(layout.layer_infos()) == 1  # what was added to find places is gone


def test_scaled_and_slanted_cells_are_read_as_they_are_drawn():
    layout, _ = layout_of()
    child = layout.create_cell("CHILD")
    child.shapes(layout.layer(LAYER)).insert(db.Box(0, 0, 100, 40))
    top = layout.cell("TOP")
    top.insert(db.CellInstArray(child.cell_index(), db.ICplxTrans(2.0, 0, False, 5, 7)))
    expected, _ = layout_of(db.Polygon(db.Box(5, 7, 205, 87)))
    assert total([boundary(layout), boundary(expected).times(-1)]).empty
    top.insert(db.CellInstArray(child.cell_index(), db.ICplxTrans(1.0, 45, False, 5000, 0)))
    assert boundary(layout).slanted.size


@pytest.mark.parametrize("turn", [db.ICplxTrans(2.0, 0, False, 5, 7), db.ICplxTrans(1.0, 45, False, 500, 0)])
def test_a_scaled_cell_is_not_taken_for_the_next(turn):
    layout, _ = layout_of()
    layer, top = layout.layer(LAYER), layout.top_cell()
    for number, place in enumerate((turn, db.ICplxTrans(0, 900))):
        child = layout.create_cell(f"CHILD{number}")
        child.shapes(layer).insert(db.Box(0, 0, 100, 40 + number))
        top.insert(db.CellInstArray(child.cell_index(), place))
    flat, _ = layout_of(*db.Region(top.begin_shapes_rec(layer)).each())
    assert total([boundary(layout), boundary(flat).times(-1)]).empty


@pytest.mark.parametrize("turns", [(0, 1, 2, 3), (3, 2, 1, 0)])
def test_holes_and_keyholes_are_the_same(turns):
    ring = db.Polygon([db.Point(0, 0), db.Point(0, 90), db.Point(90, 90), db.Point(90, 0)])
    ring.insert_hole([[db.Point(30, 30), db.Point(60, 30), db.Point(60, 60), db.Point(30, 60)][k] for k in turns])
    keyhole = ((0, 0), (0, 90), (90, 90), (90, 0), (30, 0), (30, 30), (60, 30), (60, 60), (30, 60), (30, 0))
    drawn = boundary(layout_of(ring)[0])
    assert total([drawn, Boundary.of_polygons([keyhole]).times(-1)]).empty
    clear = np.ones((3, 3), dtype=np.bool_)
    clear[1, 1] = False
    lines = np.array([0, 30, 60, 90])
    assert total([drawn, Boundary.of_raster(lines, lines, clear).times(-1)]).empty
    middles = np.array([-5.0, 15, 45, 75, 95])
    assert drawn.seen(middles, middles).tolist() == np.pad(clear.astype(int), 1).tolist()


@given(
    x=st.lists(st.integers(4, 9), min_size=1, max_size=6),
    y=st.lists(st.integers(4, 9), min_size=1, max_size=6),
    bias=st.sampled_from([-4, -2, 2, 4]),
    seed=st.integers(0, 999),
)
def test_a_bias_moves_every_edge_by_half_of_it(x, y, bias, seed):
    clear = np.random.default_rng(seed).random((len(y), len(x))) < 0.5
    across, up = np.cumsum([3, *x]), np.cumsum([-7, *y])
    dots = db.Region()
    for row, column in np.argwhere(clear).tolist():
        dots.insert(db.Box(*map(int, (across[column], up[row], across[column + 1], up[row + 1]))))
    moved = dots.merged(True, 1).sized(-bias // 2).merged(True, 1)
    found = Boundary.of_raster(*narrowed(across, up, clear, bias))
    assert total([found, boundary(layout_of(*moved.each())[0]).times(-1)]).empty


def test_a_box_is_of_the_die_in_whose_slot_its_middle_lies():
    """Three columns at uneven steps and two rows, of which one place is empty."""
    places = [(x, y) for x, y in product((-900, 0, 300), (-40, 60)) if (x, y) != (300, -40)]
    dies = [SimpleNamespace(centre=(x, y), box=(x - 20, y - 9, x + 20, y + 9)) for x, y in places]
    inside = np.array([(x - 20, y - 9, x - 12, y + 9) for x, y in places])
    assert nearest_die(inside, dies).tolist() == die_of(inside, dies).tolist() == [0, 1, 2, 3, 4]
    beside = inside + np.array([0, 1, 0, 1])
    assert nearest_die(beside, dies).tolist() == [0, 1, 2, 3, 4]
    assert die_of(beside, dies).tolist() == [5] * 5
    assert nearest_die(np.array([(299, -41, 301, -39)]), dies).tolist() == [5]
