"""Groups of two by two pixels that share their light: the same light in every group, laid and turned as one."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from estimates import surrogate
from hypothesis import given
from hypothesis import strategies as st
from once import leaves

from maskfab.base.errors import JobError
from maskfab.base.model import ORIENTATIONS, orient, side_by_side
from maskfab.designs.maps import light
from maskfab.designs.maps.light import Arrangement, clustered, most_dots, shares
from maskfab.designs.maps.orientation_map import LIGHT_TOLERANCE
from maskfab.designs.model.panel_error import pupil_error
from maskfab.designs.rules.constraints import Constraints
from maskfab.designs.search.annealing import ExpectedPsnr
from maskfab.job.faults import parse_section
from maskfab.job.sections import SearchSection

DOTS = 7
RULES = Constraints(12, dots=DOTS, dot_nm=24000)

elements = st.integers(0, ORIENTATIONS - 1)
arrangements = st.builds(
    Arrangement,
    st.permutations([0, 0, 1, 1]).map(tuple),
    st.tuples(elements, elements, elements, elements),
)


def block(count):
    """So many dots, column by column from the corner."""
    mask = np.zeros(DOTS * DOTS, dtype=np.bool_)
    mask[:count] = True
    return mask.reshape(DOTS, DOTS).T


def blocks(count):
    return [np.roll(block(count), step, axis=1) for step in (0, 1, 2)]


@pytest.fixture(scope="module")
def groups():
    estimate = surrogate([leaves(1)], 2 * DOTS, dot_nm=24_000)
    return ExpectedPsnr(estimate, levels=(32,)), pupil_error(estimate, (24, 40))


@pytest.fixture(scope="module")
def found(error, groups):
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(light, "_PAIRS", 20)
        patch.setattr(light, "_ARRANGED", 60)
        patch.setattr(light, "_BEST", 30)
        return clustered(block(12), error, 18, blocks, *groups, constraints=RULES)


@given(arrangements, elements)
def test_the_pixels_of_a_turned_group_are_the_group_turned(arranged, element):
    units = np.stack([block(18), block(6)])
    patterns = np.stack([orient(unit, k) for unit in units for k in range(ORIENTATIONS)])
    assert np.array_equal(side_by_side(patterns[arranged.cells(element)]), orient(arranged.group(units), element))


def test_every_group_passes_what_four_equal_pixels_do(found):
    held = found.designed.orientations // ORIENTATIONS
    rows, columns = held.shape
    in_groups = held.reshape(rows // 2, 2, columns // 2, 2).sum(axis=(1, 3))
    assert (in_groups == 2).all()
    assert [int(unit.sum()) for unit in found.units] == [18, 6]


def test_groups_do_not_repeat(found):
    """A lattice of equal groups would be seen by its orders."""
    cells = found.designed.orientations
    rows = [tuple(row) for row in cells.reshape(len(cells) // 2, -1).tolist()]
    assert len(set(rows)) == len(rows)
    assert all(one != other for one, other in pairwise(rows))


def test_light_is_that_of_the_uniform_panel(error, found):
    assert found.uniform_clear_dots == error.laid(block(12)).sum()
    assert abs(found.designed.clear_dots / found.uniform_clear_dots - 1) <= 10 * LIGHT_TOLERANCE


def test_the_map_of_pixels_restores_as_told(error, found):
    """The pixels' own panel, judged without any groups."""
    judged = error.psnr(error.laid(found.units, found.designed.orientations))
    assert judged == pytest.approx(found.designed.psnr, abs=0.02)
    assert np.mean(found.gain_db) > 0


def test_the_sparser_pixel_takes_no_room_from_the_emitters(found):
    dense, sparse = found.units
    assert not (sparse & ~dense).any()
    assert 0 < found.share < found.uniform_share


def test_units_that_break_a_rule_beside_one_another_are_refused(error, groups, monkeypatch):
    """A whole column at the border beside a corner of another."""
    monkeypatch.setattr(light, "_PAIRS", 20)
    rules = Constraints(12, dots=DOTS, dot_nm=24000, min_space_dots=3)
    with pytest.raises(JobError, match=r"MF123.*18 and 6 clear dots.*min_space_dots"):
        clustered(block(12), error, 18, blocks, *groups, constraints=rules)


@pytest.mark.parametrize("most", [1, 12, 24, 30])
def test_dots_that_no_two_pixels_share_are_refused(most):
    with pytest.raises(JobError, match=rf"MF104.*most_dots = {most} .*12 .*Choose 13 to 23"):
        shares(12, most)


def test_denser_pixels_have_half_as_many_dots_again_unless_told():
    plain = {"name": "x", "dots": 7, "pitch": "168 um", "clear_dots": 12, "map": "equal_light", "cluster": 2}
    assert most_dots(parse_section(SearchSection, plain, where="x")) == 18
    assert most_dots(parse_section(SearchSection, {**plain, "most_dots": 20}, where="x")) == 20
