from __future__ import annotations

import itertools

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from klayout import db
from sweeps import examples

from maskfab.mask.figures import pairs
from maskfab.mask.outlines import exact, hull_points, recut

HOLES = ("bisect", "keyhole", "trapezoids", "layer")
WAYS = list(itertools.product(HOLES, ("apart", "joined")))
masks = arrays(np.bool_, st.tuples(st.integers(1, 8), st.integers(1, 8)))


def as_region(mask, dot=10):
    region = db.Region()
    for y, x in np.argwhere(mask).tolist():
        region.insert(db.Box(x * dot, y * dot, (x + 1) * dot, (y + 1) * dot))
    return region


def area(region):
    return sum(polygon.area() for polygon in region.each())


@pytest.mark.parametrize(("holes", "corners"), WAYS)
@examples(40)
@given(mask=masks, most=st.sampled_from([None, 4, 6, 9]))
def test_every_way_covers_the_same_without_holes(holes, corners, mask, most):
    drawn = recut(as_region(mask), holes, corners, most)
    every = [*drawn.pieces.each(), *drawn.holes.each()]
    assert exact(as_region(mask), drawn)
    assert not any(polygon.holes() for polygon in every)
    assert drawn.polygons == len(every)
    assert drawn.vertices == sum(polygon.num_points() for polygon in every)
    if most is not None:
        assert all(polygon.num_points() <= most for polygon in every)
    if holes != "layer":
        assert area(drawn.pieces) == mask.sum() * 100  # nothing drawn twice
        assert drawn.holes.is_empty()
    if corners == "apart" and holes in ("bisect", "layer"):
        assert all(len(set(hull_points(polygon))) == polygon.num_points() for polygon in every)


@examples(40)
@given(mask=masks)
def test_turning_the_mask_changes_neither_area_nor_what_is_counted(mask):
    one, other = recut(as_region(mask), "keyhole"), recut(as_region(mask[::-1, ::-1]), "keyhole")
    assert (one.holed, one.parted) == (other.holed, other.parted)
    assert area(one.pieces) == area(other.pieces)


def ring(side=5):
    mask = np.ones((side, side), dtype=np.bool_)
    mask[1:-1, 1:-1] = False
    return mask


def test_a_ring_in_every_way():
    figures = {holes: recut(as_region(ring()), holes) for holes in HOLES}
    assert {holes: drawn.polygons for holes, drawn in figures.items()} == {
        "bisect": 2,
        "keyhole": 1,
        "trapezoids": 4,
        "layer": 2,
    }
    assert all(drawn.holed == 1 for drawn in figures.values())
    assert area(figures["layer"].pieces) == 2500
    assert area(figures["layer"].holes) == 900


def test_an_island_in_a_hole_is_not_cut_away():
    mask = ring(7)
    mask[2:5, 2:5] = ring(3)
    drawn = recut(as_region(mask), "layer")
    assert exact(as_region(mask), drawn)
    assert drawn.holed == 2


def test_kissing_corners_are_one_outline_only_if_asked():
    mask = np.eye(3, dtype=np.bool_)
    assert recut(as_region(mask)).polygons == 3
    joined = recut(as_region(mask), corners="joined")
    (outline,) = map(hull_points, joined.pieces.each())
    assert len(outline) - len(set(outline)) == 2


def test_a_loop_closed_by_a_corner_is_said_to_be_parted():
    mask = np.ones((3, 3), dtype=np.bool_)
    mask[1, 1] = mask[2, 2] = False
    assert recut(as_region(mask)).parted == 1
    assert recut(as_region(mask)).holed == 0


def test_edges_of_45_degrees_stay_exact():
    outer = db.Polygon([db.Point(*p) for p in [(0, 20), (20, 40), (40, 20), (20, 0)]])
    inner = db.Polygon([db.Point(*p) for p in [(10, 20), (20, 30), (30, 20), (20, 10)]])
    diamond = db.Region(outer) - db.Region(inner)
    for holes in HOLES:
        assert exact(diamond, recut(diamond, holes))


def test_a_cut_off_the_grid_is_seen():
    slanted = db.Region(db.Polygon([db.Point(*p) for p in [(0, 0), (1, 7), (3, 8), (101, 6), (103, 3), (50, 1)]]))
    assert not exact(slanted, recut(slanted, max_vertices=4))


@given(cells=arrays(np.int8, st.tuples(st.integers(1, 6), st.integers(1, 7)), elements=st.integers(0, 7)))
def test_pairs_put_together_are_the_cells(cells):
    found = pairs(cells)
    both = found.kinds[found.index].reshape(cells.shape[0], -1)
    assert np.array_equal(np.concatenate([both, found.rest], axis=1), cells)
    assert len(np.unique(found.kinds, axis=0)) == len(found.kinds)
