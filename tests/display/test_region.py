"""Where an emitter may lie: checked against distances in a panel that is really laid out."""

import numpy as np
import pytest
from display.shapes import cells
from scipy import ndimage

from maskfab.base.model import orient
from maskfab.display.free_area import EVERY, free_region, relative_orientations

DOTS = np.array(
    [[0, 0, 0, 0, 1], [0, 0, 0, 0, 0], [0, 0, 1, 0, 0], [0, 0, 0, 0, 0], [0, 1, 0, 0, 0]],
    dtype=bool,
)


def far_from_openings(mask, gap):
    return ~ndimage.maximum_filter(mask, 2 * gap + 1, mode="constant")


def test_without_a_gap_it_is_what_is_closed():
    assert np.array_equal(free_region(DOTS, cells(5)), ~DOTS)


def test_dots_are_split_into_cells():
    free = free_region(DOTS, cells(15, per_dot=3))
    assert np.array_equal(free, ~np.kron(DOTS, np.ones((3, 3), dtype=bool)))


@pytest.mark.parametrize("gap", [1, 2])
def test_a_gap_within_the_gutter_looks_at_the_own_opening_only(gap):
    assert np.array_equal(free_region(DOTS, cells(5, to_opening=gap, gutter=2)), far_from_openings(DOTS, gap))


@pytest.mark.parametrize("used", [EVERY, (0, 1, 2, 3), (0, 2), (0, 5), (3,)])
@pytest.mark.parametrize(("gap", "gutter", "per_dot"), [(1, 0, 2), (3, 1, 2), (3, 2, 2), (6, 0, 1), (7, 1, 1)])
def test_neighbours_count_where_the_gap_is_wider_than_the_gutter(used, gap, gutter, per_dot):
    grid = cells(5 * per_dot, to_opening=gap, gutter=gutter, per_dot=per_dot)
    n, rim = grid.cells, grid.cells + gutter
    mask = np.kron(DOTS, np.ones((per_dot, per_dot), dtype=bool))
    expected = np.ones((n, n), dtype=bool)
    for own in used:
        for other in used:
            panel = np.zeros((n + 2 * rim, n + 2 * rim), dtype=bool)
            for y in (0, rim, 2 * rim):
                for x in (0, rim, 2 * rim):
                    panel[y : y + n, x : x + n] = orient(mask, own if y == x == rim else other)
            seen = far_from_openings(panel, gap)[rim : rim + n, rim : rim + n]
            back = next(k for k in EVERY if np.array_equal(orient(orient(np.arange(9).reshape(3, 3), own), k),
                                                           np.arange(9).reshape(3, 3)))  # fmt: skip
            expected &= orient(seen, back)
    if gap <= n:
        assert np.array_equal(free_region(DOTS, grid, used), expected)
    else:
        assert not free_region(DOTS, grid, used).any()


def test_an_opening_on_the_border_reaches_into_every_neighbour():
    mask = np.zeros((9, 9), dtype=bool)
    mask[0, 4] = True
    free = free_region(mask, cells(9, to_opening=2, gutter=1))
    for k in EVERY:
        assert not orient(free, k)[0, 4]
    assert free_region(mask, cells(9, to_opening=2, gutter=1), (0,))[4, 8]
    assert not free_region(mask, cells(9, to_opening=2, gutter=1), (0,))[8, 4]


def test_relative_orientations():
    assert relative_orientations((3,)) == (0,)
    assert relative_orientations((5,)) == (0,)
    assert relative_orientations((0, 2)) == (0, 2)
    assert relative_orientations(range(4)) == (0, 1, 2, 3)
    assert relative_orientations(EVERY) == EVERY


def test_the_margin_is_kept_free_on_all_sides():
    free = free_region(np.zeros((6, 6), dtype=bool), cells(6), margin=2)
    assert free.sum() == 4
    assert free[2:4, 2:4].all()
    assert not free_region(np.zeros((6, 6), dtype=bool), cells(6), margin=3).any()


def test_a_batch_is_its_members():
    rng = np.random.default_rng(1)
    masks = rng.random((2, 3, 7, 7)) < 0.1
    grid = cells(14, to_opening=3, gutter=1, per_dot=2)
    batch = free_region(masks, grid)
    for at in np.ndindex(2, 3):
        assert np.array_equal(batch[at], free_region(masks[at], grid))


def test_all_orientations_of_an_opening_have_the_same_region_turned():
    grid = cells(10, to_opening=3, gutter=1, per_dot=2)
    for k in EVERY:
        assert np.array_equal(free_region(orient(DOTS, k), grid), orient(free_region(DOTS, grid), k))
