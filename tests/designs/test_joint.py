"""Units and maps designed in turns, and the slope of a panel by the unit's dots."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from maskfab.base.errors import JobError
from maskfab.camera.stop_cells import CELLS, lattice, lay
from maskfab.designs.maps.alternation import dot_slopes, joint
from maskfab.designs.maps.orientation_map import LIGHT_TOLERANCE, design_map
from maskfab.designs.model.panel_judgement import Slope
from maskfab.designs.rules.constraints import Constraints
from maskfab.mask.panels import shifted

DOTS = 7
BAR = np.zeros((DOTS, DOTS), dtype=np.bool_)
BAR[:5, :2] = True
ROOM = lattice(DOTS, 48_000)
"""Of the coarse panel."""
SHIFTS = ((0, 0), (2, 1), (4, 0))


@pytest.fixture(scope="module")
def together(coarse):
    return joint(BAR, coarse, Constraints(10, dots=DOTS), rounds=2)


def laid(unit, shifts, orientations, error):
    return error.laid(np.stack([shifted(unit, shift) for shift in shifts]), orientations)


def test_the_slope_by_a_dot_is_the_sum_of_its_images(error):
    """Whatever the field, opening a dot adds the field where the dot appears inside the stop."""
    draw = np.random.default_rng(1)
    orientations = draw.integers(8 * len(SHIFTS), size=(CELLS, CELLS)).astype(np.int8)
    field = draw.normal(size=error.inside.shape).astype(np.float32)
    slopes = dot_slopes(Slope(np.zeros((13, 13)), field), orientations, SHIFTS, error.inside)
    for row, column in ((0, 0), (4, 1), (3, 2), (5, 0)):
        dot = np.zeros((DOTS, DOTS), dtype=np.bool_)
        dot[row, column] = True
        assert slopes[row, column] == pytest.approx((laid(dot, SHIFTS, orientations, error) * field).sum(), abs=1e-3)


def test_rounds_never_lose(coarse, together):
    assert list(together.losses) == sorted(together.losses, reverse=True)
    assert together.losses[0] == pytest.approx(-np.mean(together.alone.psnr))
    assert together.losses[-1] == pytest.approx(-np.mean(together.designed.psnr))
    assert (
        coarse.psnr(lay("panel", together.unit, together.designed.orientations, room=ROOM).pupil)
        == together.designed.psnr
    )


def test_a_unit_fitted_to_its_map_restores_better(together):
    assert together.swaps > 0
    assert together.losses[-1] < together.losses[0] - 0.005
    assert not np.array_equal(together.unit, BAR)


def test_the_light_is_that_of_the_first_random_map(together):
    designed = together.designed
    assert together.unit.sum() == BAR.sum()
    assert designed.start_clear_dots == lay("random", BAR, room=ROOM).pupil.sum()
    assert designed.clear_dots == lay("panel", together.unit, designed.orientations, room=ROOM).pupil.sum()
    assert abs(designed.clear_dots / designed.start_clear_dots - 1) <= LIGHT_TOLERANCE


def test_the_seed_decides(coarse):
    once, again = (joint(BAR, coarse, Constraints(10, dots=DOTS), rounds=2) for _ in range(2))
    assert np.array_equal(again.unit, once.unit)
    assert np.array_equal(again.designed.orientations, once.designed.orientations)
    assert again.losses == once.losses


def test_no_round_is_the_map_alone(coarse):
    none = joint(BAR, coarse, Constraints(10, dots=DOTS), rounds=0)
    map_alone = design_map(BAR, coarse, kicks=0)
    assert none.swaps == 0
    assert np.array_equal(none.unit, BAR)
    assert np.array_equal(none.designed.orientations, map_alone.orientations)


def test_the_constraints_are_kept(coarse):
    rules = Constraints(10, dots=DOTS, min_feature_dots=2, kissing="cell")
    found = joint(BAR, coarse, rules, rounds=1)
    assert not rules.violations(found.unit)
    still = Constraints(10, dots=DOTS, keep_out=~BAR)
    assert np.array_equal(joint(BAR, coarse, still, rounds=1).unit, BAR)


def test_every_place_keeps_the_unit_in_its_cell(coarse):
    found = joint(BAR, coarse, Constraints(10, dots=DOTS), rounds=1, positions=3)
    assert len(found.designed.shifts) == 3
    assert all(shifted(found.unit, shift).sum() == BAR.sum() for shift in found.designed.shifts)
    pupil = laid(found.unit, found.designed.shifts, found.designed.orientations, coarse)
    assert pupil.sum() == found.designed.clear_dots
    assert coarse.psnr(pupil) == found.designed.psnr


def test_no_place_breaks_the_constraints(coarse):
    rules = Constraints(10, dots=DOTS, keep_out=np.arange(DOTS) * np.ones((DOTS, 1)) > 4)
    found = joint(BAR, coarse, rules, rounds=1, positions=4)
    assert len(found.designed.shifts) > 1
    assert all(rules.allows(shifted(found.unit, shift)) for shift in found.designed.shifts)


@pytest.mark.parametrize("rule", [{"kissing": "neighbours"}, {"ports": 1}])
def test_rules_about_neighbours_want_one_place(error, rule):
    middle = np.roll(BAR, (1, 2), axis=(0, 1))
    with pytest.raises(JobError, match=r"MF123.*at several places"):
        joint(middle, error, Constraints(10, dots=DOTS, **rule), rounds=0, positions=2)


@pytest.mark.parametrize(
    ("rules", "rounds", "code"),
    [
        (Constraints(10, dots=DOTS), -1, "MF104"),
        (Constraints(9, dots=DOTS), 1, "MF123"),
        (replace(Constraints(10, dots=DOTS), rim_dots=1), 1, "MF123"),
    ],
)
def test_what_cannot_begin_is_told(error, rules, rounds, code):
    with pytest.raises(JobError, match=code):
        joint(BAR, error, rules, rounds=rounds)
