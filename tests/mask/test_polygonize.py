from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from klayout import db
from sweeps import examples

from maskfab.base.model import ORIENTATIONS, Polygon, orient
from maskfab.mask.outlines import outline
from maskfab.mask.raster import coverage

masks = arrays(np.bool_, st.tuples(st.integers(1, 9), st.integers(1, 9)))


def as_region(polygons: tuple[Polygon, ...]) -> db.Region:
    region = db.Region()
    for polygon in polygons:
        region.insert(db.SimplePolygon([db.Point(x, y) for x, y in polygon], True))
    return region


def signed_area(polygon: Polygon) -> float:
    points = np.array(polygon)
    x, y = points[:, 0], points[:, 1]
    return float((x * np.roll(y, -1) - np.roll(x, -1) * y).sum()) / 2


def assert_simple(polygon: Polygon) -> None:
    """No vertex twice, every corner a right angle, no vertex on another side."""
    assert len(set(polygon)) == len(polygon)
    points = np.array(polygon)
    sides = np.roll(points, -1, axis=0) - points
    assert np.all((sides != 0).sum(axis=1) == 1)
    assert np.all((sides * np.roll(sides, 1, axis=0)).sum(axis=1) == 0)
    low, high = np.minimum(points, points + sides), np.maximum(points, points + sides)
    for point in points:
        touching = ((point >= low) & (point <= high)).all(axis=1)
        assert touching.sum() == 2  # the two sides that meet there


@examples(200)
@given(masks)
def test_union_is_the_mask_and_nothing_overlaps(mask):
    polygons = outline(mask, 8, (-3, 5))
    x, y = (-3 + 8.0 * np.arange(mask.shape[1] + 1), 5 + 8.0 * np.arange(mask.shape[0] + 1))
    assert np.array_equal(coverage(as_region(polygons), x, y), mask)
    assert -sum(map(signed_area, polygons)) == mask.sum() * 64  # all clockwise, none overlapping
    for polygon in polygons:
        assert_simple(polygon)


@examples(50)
@given(masks, st.integers(0, ORIENTATIONS - 1))
def test_outline_commutes_with_orientation(mask, orientation):
    square = np.zeros((max(mask.shape),) * 2, dtype=np.bool_)
    square[: mask.shape[0], : mask.shape[1]] = mask
    side = len(square) * 10
    turn = db.Trans(orientation % 4, False) * (db.Trans(db.Trans.M90) if orientation >= 4 else db.Trans())
    moved = as_region(outline(square, 10)).transformed(db.Trans(-side // 2, -side // 2)).transformed(turn)
    back = moved.transformed(db.Trans(side // 2, side // 2))
    assert (back ^ as_region(outline(orient(square, orientation), 10))).is_empty()


def test_a_checkerboard_falls_into_its_dots():
    board = np.indices((6, 6)).sum(axis=0) % 2 == 0
    polygons = outline(board, 5)
    assert len(polygons) == 18
    assert all(len(polygon) == 4 for polygon in polygons)


def test_a_hole_is_opened_by_one_cut():
    mask = np.ones((3, 3), dtype=np.bool_)
    mask[1, 1] = False
    polygons = outline(mask, 1)
    assert len(polygons) == 2
    assert sorted(map(len, polygons)) == [4, 8]


def test_a_loop_closed_by_a_corner_is_parted_there():
    mask = np.ones((3, 3), dtype=np.bool_)
    mask[1, 1] = mask[2, 2] = False
    for polygon in outline(mask, 1):
        assert_simple(polygon)


@pytest.mark.parametrize("share", [0.2, 0.5, 0.8, 0.95])
def test_large_random_masks(share):
    mask = np.random.default_rng(3).random((60, 60)) < share
    polygons = outline(mask, 2)
    assert -sum(map(signed_area, polygons)) == mask.sum() * 4
    for polygon in polygons:
        assert_simple(polygon)


def test_order_is_by_position_and_repeats():
    mask = np.random.default_rng(4).random((20, 20)) < 0.5
    polygons = outline(mask, 3)
    assert polygons == outline(mask.copy(), 3)
    starts = [min((y, x) for x, y in polygon) for polygon in polygons]
    assert starts == sorted(starts)


def test_nothing_clear_gives_nothing():
    assert outline(np.zeros((4, 4), dtype=np.bool_), 8) == ()
