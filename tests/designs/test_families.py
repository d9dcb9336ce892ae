"""Families: exact counts, every place, symmetry, and sums that cannot be."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from maskfab.base.errors import JobError, OpeningError
from maskfab.base.model import orient
from maskfab.designs.rules.families import (
    FAMILIES,
    bars,
    crosses,
    discs,
    explained,
    l_shapes,
    orbits,
    scattered_blobs,
    sums,
)


@pytest.mark.parametrize("family", FAMILIES.values(), ids=FAMILIES)
@pytest.mark.parametrize(("dots", "clear"), [(7, 11), (7, 12), (13, 40), (8, 63)])
def test_every_opening_has_the_count_and_the_shape(family, dots, clear):
    if family is scattered_blobs and clear == 63:
        return
    units = [candidate.unit for candidate in family(dots, clear)]
    if clear < 63:
        assert units
    assert all(unit.shape == (dots, dots) and unit.sum() == clear for unit in units)


def test_bars_lie_everywhere_once():
    units = list(bars(21, 100))
    assert len({candidate.unit.tobytes() for candidate in units}) == len(units) == 1094
    squares = [candidate for candidate in units if candidate.name.startswith("bar 10x10 ")]
    assert len(squares) == 12 * 12


def test_neither_side_of_a_bar_can_be_shorter():
    for candidate in bars(9, 14):
        rows, columns = candidate.unit.any(axis=1).sum(), candidate.unit.any(axis=0).sum()
        assert (rows - 1) * columns < 14
        assert rows * (columns - 1) < 14


@pytest.mark.parametrize("symmetry", ["d4", "mirror", "rot180"])
def test_symmetric_discs_are_their_own_images(symmetry):
    element = {"d4": 1, "mirror": 4, "rot180": 2}[symmetry]
    found = list(discs(9, 20, symmetry=symmetry))
    assert found
    for candidate in found:
        np.testing.assert_array_equal(orient(candidate.unit, element), candidate.unit)
        assert candidate.unit.sum() == 20


def test_discs_stay_where_they_may():
    free = np.zeros((9, 9), dtype=np.bool_)
    free[2:7, 3:8] = True
    assert all(not (candidate.unit & ~free).any() for candidate in discs(9, 12, free=free))


def test_a_disc_is_as_compact_as_can_be():
    (middle,) = (c.unit for c in discs(5, 5) if c.name == "disc at (2, 2)")
    np.testing.assert_array_equal(middle[2], [False, True, True, True, False])
    np.testing.assert_array_equal(middle[:, 2], [False, True, True, True, False])


def test_shapes_are_what_they_are_called():
    corner = next(c.unit for c in l_shapes(6, 9) if c.name == "L 4x6 of 1 at (0, 0)")
    assert corner[0].sum() == 6
    assert corner[:, 0].sum() == 4
    plus = next(c.unit for c in crosses(6, 9) if c.name == "cross 5x5 of 1 at (0, 0)")
    assert plus[2].sum() == 5
    assert plus[:, 2].sum() == 5


def test_blobs_do_not_touch_and_repeat_by_seed():
    first, again = ([c.unit.tobytes() for c in scattered_blobs(9, 12, count=3, most=100, seed=5)] for _ in range(2))
    assert first == again != [c.unit.tobytes() for c in scattered_blobs(9, 12, count=3, most=100, seed=6)]
    from scipy import ndimage

    for candidate in scattered_blobs(9, 12, count=3, most=100):
        assert ndimage.label(candidate.unit, np.ones((3, 3)))[1] == 3


@pytest.mark.parametrize("symmetry", [None, "d4", "mirror", "rot180"])
@pytest.mark.parametrize("dots", [1, 2, 7, 8])
def test_orbits_part_the_cell(dots, symmetry):
    found = orbits(dots, symmetry)
    assert sorted(itertools.chain(*(orbit.tolist() for orbit in found))) == list(range(dots * dots))
    # An odd square has one dot that every turn leaves where it is.
    if symmetry in {"d4", "rot180"}:
        assert sum(len(orbit) == 1 for orbit in found) == dots % 2


def test_sums_are_those_of_all_subsets():
    sizes = (4, 8, 8, 1)
    wanted = {sum(part) for k in range(5) for part in itertools.combinations(sizes, k)}
    assert {k for k in range(30) if sums(sizes)[-1] >> k & 1} == wanted


@pytest.mark.parametrize("family", FAMILIES.values(), ids=FAMILIES)
def test_counts_that_cannot_be(family):
    with pytest.raises(OpeningError, match="MF203"):
        next(family(5, 0))
    for count in (26, -1):
        with pytest.raises(OpeningError, match="MF204"):
            next(family(5, count))
    with pytest.raises(JobError, match="MF104"):
        next(family(0, 1))


def test_odd_counts_have_no_square_symmetry_on_even_cells():
    with pytest.raises(OpeningError, match="MF204"):
        next(discs(6, 7, symmetry="d4"))
    with pytest.raises(JobError, match="MF105"):
        orbits(5, "hexagonal")
    with pytest.raises(JobError, match="MF104"):
        next(scattered_blobs(5, 3, count=4))


@pytest.mark.parametrize(("dots", "clear"), [(1, 1), (2, 1), (2, 3), (5, 24), (5, 25)])
def test_the_smallest_and_the_fullest(dots, clear):
    units = {c.unit.tobytes() for c in discs(dots, clear)}
    assert units
    assert any(True for _ in bars(dots, clear))


def test_the_numbers_of_a_name_are_explained_with_their_unit():
    told = explained(2.75, "L 12x22 of 8 at (0, 12)")
    assert told.startswith("L: two arms that meet at the lower left, height x width of their thickness")
    assert "dots of 2.75 µm" in told
    assert "annealed: " in explained(8, "disc at (3.5, 4), annealed")
    assert explained(8, "start") == ""


@pytest.mark.parametrize("family", FAMILIES.values())
def test_every_shape_that_a_search_may_name_is_explained(family):
    assert all(explained(8, shape.name) for shape in itertools.islice(family(6, 9), 50))


def test_the_place_of_a_shape_is_that_of_its_lower_left_dot():
    shape = next(shape for shape in l_shapes(12, 30) if shape.name.startswith("L 5x") and shape.name.endswith("(2, 1)"))
    rows, columns = np.nonzero(shape.unit)
    assert (rows.min(), columns.min()) == (2, 1)
    assert shape.unit[2, 1]
    assert rows.max() - rows.min() + 1 == 5
