from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from klayout import db
from sweeps import examples

from maskfab.mask import raster
from maskfab.mask.layout import region
from maskfab.mask.raster import coverage, disjoint, placed_boxes, to_boxes

coordinates = st.integers(-20, 60)
boxes = st.lists(st.tuples(coordinates, coordinates, st.integers(1, 40), st.integers(1, 40)), max_size=8)


def boxes_to_array(parts):
    return np.array([(x, y, x + w, y + h) for x, y, w, h in parts], dtype=np.int64).reshape(-1, 4)


def by_unit_cells(array):
    """Clear unit cells of 0..40 squared."""
    clear = np.zeros((40, 40), dtype=np.bool_)
    for x0, y0, x1, y1 in array.tolist():
        clear[max(y0, 0) : max(y1, 0), max(x0, 0) : max(x1, 0)] = True
    return clear


@examples(150)
@given(boxes, st.integers(0, 2**32 - 1))
def test_coverage_of_boxes_agrees_with_counting_unit_cells(parts, seed):
    rng = np.random.default_rng(seed)
    array = boxes_to_array(parts)
    x, y = (np.unique(np.append(rng.integers(0, 41, 6), [0, 40])).astype(float) for _ in range(2))
    unit = by_unit_cells(array).astype(float)
    sums = np.add.reduceat(np.add.reduceat(unit, y[:-1].astype(int), axis=0), x[:-1].astype(int), axis=1)
    exact = sums / np.outer(np.diff(y), np.diff(x))
    assert np.abs(coverage(array, x, y) - exact).max() < 1e-12


@given(boxes)
def test_shapes_on_grid_lines_give_exactly_zero_or_one(parts):
    array = boxes_to_array(parts)
    edges = np.arange(41.0)
    assert np.array_equal(coverage(array, edges, edges), by_unit_cells(array))


def regular_polygon(sides, radius, centre):
    angle = 2 * np.pi * np.arange(sides) / sides
    points = np.rint(centre + radius * np.stack([np.cos(angle), np.sin(angle)], axis=1)).astype(int)
    return db.Polygon([db.Point(x, y) for x, y in points.tolist()])


@pytest.mark.parametrize("sides", [3, 7, 64])
def test_oblique_polygons_keep_their_area_and_their_clipped_area(sides):
    shape = db.Region(regular_polygon(sides, 9000, (10_000, 10_000))) - db.Region(
        regular_polygon(sides, 3000, (9_000, 9_500))
    )
    x, y = np.array([0.0, 3000.5, 3333.25, 11_000.0, 20_000.0]), np.array([0.0, 10_000.0, 10_000.25, 20_000.0])
    share = coverage(shape, x, y)
    areas = share * np.outer(np.diff(y), np.diff(x))
    assert areas.sum() == pytest.approx(shape.area(), rel=1e-12)
    assert share.min() >= 0
    assert share.max() <= 1
    clipped = coverage(shape, x[2:], y[1:])
    assert np.abs(clipped - share[1:, 2:]).max() < 1e-12


def test_an_oblique_edge_halves_the_cells_that_it_crosses():
    triangle = db.Region(db.Polygon([db.Point(0, 0), db.Point(40, 40), db.Point(40, 0)]))
    edges = np.arange(0.0, 50, 10)
    expected = np.triu(np.ones((4, 4))) - 0.5 * np.eye(4)
    assert np.abs(coverage(triangle, edges, edges) - expected).max() < 1e-15


def test_oblique_and_manhattan_paths_agree():
    shape = db.Region(db.Box(3, 5, 17, 31)) + db.Region(db.Box(17, 9, 29, 11))
    speck = db.Region(db.Polygon([db.Point(90, 90), db.Point(92, 90), db.Point(90, 91)]))
    edges = np.array([0.0, 4.5, 10, 11, 40])
    assert np.abs(coverage(shape, edges, edges) - coverage(shape + speck, edges, edges)).max() < 1e-15


@pytest.mark.parametrize("is_oblique", [False, True])
@examples(60)
@given(parts=boxes)
def test_overlaps_count_once_also_where_a_region_keeps_its_polygons_apart(is_oblique, parts):
    array = boxes_to_array(parts)
    apart = db.Region([db.Box(*box) for box in array.tolist()])
    if is_oblique:
        apart.insert(db.Polygon([db.Point(200, 200), db.Point(202, 200), db.Point(200, 201)]))
    apart.merged_semantics = False
    edges = np.arange(0.0, 41, 8)
    exact = by_unit_cells(array).reshape(5, 8, 5, 8).mean(axis=(1, 3))
    assert np.abs(coverage(apart, edges, edges) - exact).max() < 1e-14


def test_nothing_covers_nothing():
    edges = np.arange(4.0)
    assert not coverage(db.Region(), edges, edges).any()
    assert not coverage(np.zeros((0, 4), dtype=np.int64), edges, edges).any()


@given(parts=st.lists(st.tuples(*[st.integers(0, 9)] * 2, *[st.integers(1, 4)] * 2), max_size=5))
def test_boxes_are_disjoint_where_their_areas_add_up(parts):
    array = boxes_to_array(parts)
    drawn = db.Region([db.Box(*box) for box in array.tolist()])
    assert disjoint(array) == (drawn.merged(True, 1).area() == sum(wide * high for *_, wide, high in parts))


def test_to_boxes_tiles_a_region():
    ring = db.Region(db.Box(0, 0, 30, 30)) - db.Region(db.Box(10, 10, 20, 20))
    found = to_boxes(ring)
    assert found.shape[1] == 4
    assert ((found[:, 2] - found[:, 0]) * (found[:, 3] - found[:, 1])).sum() == 800


def nested_layout():
    """An F placed in all eight orientations, as an array and alone, two levels deep."""
    layout = db.Layout()
    layer = layout.layer(1, 0)
    letter, block, top = (layout.create_cell(name) for name in ("F", "BLOCK", "TOP"))
    for box in (db.Box(0, 0, 2, 10), db.Box(2, 8, 7, 10), db.Box(1, 4, 5, 6)):
        letter.shapes(layer).insert(box)
    for code in range(8):
        turn = db.Trans(code % 4, code >= 4, 30 * code, 7)
        block.insert(db.CellInstArray(letter.cell_index(), turn, db.Vector(0, 25), db.Vector(240, 3), 3, 2))
        block.insert(db.CellInstArray(letter.cell_index(), db.Trans(code % 4, code >= 4, -40, 30 * code)))
        top.insert(db.CellInstArray(block.cell_index(), db.Trans(code % 4, code >= 4, 900 * code, 11)))
    top.shapes(layer).insert(db.Box(-50, -50, -40, -20))
    return layout, layer, top


@pytest.mark.parametrize("window", [None, (0, 0, 1500, 200), (-60, -60, -30, -10), (99_000, 0, 99_001, 1)])
def test_placed_boxes_cover_what_the_flat_region_covers(window):
    layout, layer, top = nested_layout()
    found = placed_boxes(top, layer, None if window is None else db.Box(*window))
    rebuilt = db.Region()
    for box in found.tolist():
        rebuilt.insert(db.Box(*box))
    clip = db.Region(layout.top_cell().bbox() if window is None else db.Box(*window))
    assert ((rebuilt & clip) ^ region(layout, db.LayerInfo(1, 0), window)).is_empty()


def test_of_a_crowd_of_cells_only_those_near_the_window_are_asked(monkeypatch):
    asked = []
    whole = raster._reaching
    monkeypatch.setattr(raster, "_reaching", lambda *given: asked.append(given) or whole(*given))
    layout = db.Layout()
    layer, top = layout.layer(1, 0), layout.create_cell("TOP")
    for number in range(400):
        cell = layout.create_cell(f"C{number}")
        cell.shapes(layer).insert(db.Box(0, 0, 10 + number, 10))
        top.insert(db.CellInstArray(cell.cell_index(), db.Trans(1000 * number, 0)))
    found = placed_boxes(top, layer, db.Box(299_900, -100, 300_900, 100))
    assert found.tolist() == [[300_000, 0, 300_310, 10]]
    assert len(asked) < 5


def test_placed_boxes_decline_what_is_not_manhattan():
    layout, layer, top = nested_layout()
    layout.cell("F").shapes(layer).insert(db.Polygon([db.Point(0, 0), db.Point(5, 5), db.Point(5, 0)]))
    assert placed_boxes(top, layer) is None


def test_placed_boxes_decline_other_than_quarter_turns():
    layout, layer, top = nested_layout()
    turn = db.ICplxTrans(1.0, 30.0, False, 0, 0)
    top.insert(db.CellInstArray(layout.cell("F").cell_index(), turn))
    assert placed_boxes(top, layer) is None
