"""The error of realised panels and its slope, and the maps designed with them."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from estimates import surrogate
from once import leaves

from maskfab.base.errors import JobError, OpeningError
from maskfab.base.model import ORIENTATIONS, orient
from maskfab.camera.stop_cells import CELLS, lattice, lay, pupil_autocorrelation
from maskfab.designs.maps.orientation_map import LIGHT_TOLERANCE, MapMode, _Search, design_map, require_size
from maskfab.designs.model import panel_error
from maskfab.designs.model.panel_error import pupil_error

DOTS = 7


def bar(high=5, wide=2):
    mask = np.zeros((DOTS, DOTS), dtype=np.bool_)
    mask[:high, :wide] = True
    return mask


@pytest.fixture(scope="module")
def designed(error):
    return {mode: design_map(bar(), error, mode=mode, kicks=0) for mode in MapMode}


@pytest.fixture(scope="module")
def fine(estimate):
    """With steps of maps judged by every second lag, as those of finer dots are."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(panel_error, "_MOST_FREQUENCIES", 60)
        return pupil_error(estimate, (24, 40))


def searched(error, units, seed=0, mode=MapMode.EDGE_PACKING):
    kinds = ORIENTATIONS * len(units)
    drawn = np.random.default_rng(seed).integers(kinds, size=(CELLS, CELLS)).astype(np.int8)
    light = float(lay("start", np.stack(units), drawn).pupil.sum())
    return _Search(np.stack(units), error, mode, light), drawn.ravel().astype(np.int64)


def test_the_transforms_agree_with_the_autocorrelation(error):
    pupil = lay("bar", bar()).pupil
    _, table = error._table(pupil)
    whole = pupil_autocorrelation(pupil)
    middle, reach = len(pupil) - 1, len(table) - 1
    assert np.array_equal(table, np.rint(whole[middle : middle + reach + 1, middle - reach : middle + reach + 1]))


def test_transfer_at_the_lags_of_one_cycle(error):
    """At frequency 0 nothing is lost; elsewhere each lag has its sinc, and those a cycle away are folded back."""
    pupil = lay("bar", bar()).pupil
    _, table = error._table(pupil)
    transfer, _, light = error._transfers(torch.from_numpy(table))
    assert float(light) == pupil.sum()
    whole = pupil_autocorrelation(pupil) / pupil.sum()
    middle, cycle = len(pupil) - 1, error.cycle
    for y, x in ((0, 0), (0, 3), (4, -11), (cycle // 2, cycle // 2), (17, -cycle // 2 + 1)):
        lags = [(y + k * cycle, x + j * cycle) for k in (-1, 0, 1) for j in (-1, 0, 1)]
        reach = len(error.pixel) // 2
        expected = sum(
            whole[middle + v, middle + u] * np.sinc(v / cycle) * np.sinc(u / cycle)
            for v, u in lags
            if max(abs(v), abs(u)) <= reach
        )
        assert float(transfer[y, x + cycle // 2]) == pytest.approx(expected, abs=1e-6)


def test_the_loss_is_the_weighted_mean_of_the_decibels(estimate):
    error = pupil_error(estimate, (24, 40), (3, 1))
    pupil = lay("bar", bar()).pupil
    low, high = error.psnr(pupil)
    assert error.judge(pupil, error.epsilons(pupil)).loss == pytest.approx(-(0.75 * low + 0.25 * high), rel=1e-9)


@pytest.mark.parametrize("weights", [(1,), (1, -1), (0, 0), (1, np.nan), ()])
def test_weights_that_are_none_are_told(estimate, weights):
    with pytest.raises(JobError, match="MF104"):
        pupil_error(estimate, (24, 40), weights)


def test_wider_bars_restore_better(error):
    psnr = [error.psnr(lay("bar", bar(5, wide)).pupil) for wide in (1, 2, 5)]
    assert all(a < b < c for a, b, c in zip(*psnr, strict=True))


def test_the_mean_over_random_panels_is_near_the_surrogate(estimate, error):
    psnr = np.mean([error.psnr(lay("bar", bar(), seed=seed).pupil) for seed in range(4)], axis=0)
    np.testing.assert_allclose(psnr, estimate(bar(), levels=error.levels), atol=0.8)


def test_half_a_turn_of_the_whole_panel_changes_nothing(error):
    pupil = lay("bar", bar(), seed=3).pupil
    np.testing.assert_allclose(error.psnr(pupil[::-1, ::-1]), error.psnr(pupil), rtol=1e-6)


def test_fewer_lags_are_some_of_all(fine):
    pupil = lay("bar", bar()).pupil
    steps = fine.of_steps
    assert (fine.stride, steps.stride) == (1, 2)
    every, some = fine.table(pupil), steps.table(pupil)
    reach = min(steps.reach, fine.reach // 2)
    ours = some[: reach + 1, steps.reach - reach : steps.reach + reach + 1]
    columns = slice(fine.reach - 2 * reach, fine.reach + 2 * reach + 1, 2)
    assert np.array_equal(ours, every[: 2 * reach + 1 : 2, columns])
    assert np.array_equal(steps._table(pupil)[1], some)


def test_a_map_whose_steps_fewer_lags_judge_is_about_as_good_and_told_by_all(fine, designed):
    found = design_map(bar(), fine, kicks=0)
    assert found.psnr == fine.psnr(lay("bar", bar(), found.orientations).pupil)
    assert np.mean(found.psnr) == pytest.approx(np.mean(designed[MapMode.EQUAL_LIGHT].psnr), abs=0.03)


@pytest.mark.parametrize("units", [[bar()], [bar(), bar(2, 5), bar(7, 1)]])
@pytest.mark.parametrize("lags", ["error", "fine"])
def test_the_turns_are_those_of_every_single_cell(lags, units, request):
    """The one field prices whole and cut cells as exact evaluation does, to the curvature left out."""
    error = request.getfixturevalue(lags).of_steps
    search, chosen = searched(error, units)
    state = search.fresh(chosen)
    draw = np.random.default_rng(1)
    cells = np.concatenate([draw.choice(search.cut, 8), draw.choice(np.setdiff1d(search.live, search.cut), 12)])
    kinds = draw.integers(len(search.flat), size=len(cells))
    exact = []
    for cell, kind in zip(cells, kinds, strict=True):
        turned = chosen.copy()
        turned[cell] = kind
        exact.append(error.judge(search.pupil(turned), state.epsilons).loss - state.loss)
    told = state.turns[cells, kinds]
    assert np.linalg.norm(told - exact) < 0.15 * np.linalg.norm(exact)
    assert np.corrcoef(told, exact)[0, 1] > 0.99
    assert np.all(state.turns[np.arange(len(chosen)), chosen] == 0)


def test_cells_behind_the_stop_are_left_alone(error):
    search, chosen = searched(error, [bar()])
    dark = np.setdiff1d(np.arange(CELLS**2), search.live)
    assert len(dark)
    assert not search.fresh(chosen).turns[dark].any()


def test_light_is_kept_where_it_should_be(designed):
    equal, packed = designed[MapMode.EQUAL_LIGHT], designed[MapMode.EDGE_PACKING]
    assert abs(equal.clear_dots / equal.start_clear_dots - 1) <= LIGHT_TOLERANCE
    assert packed.clear_dots > 1.02 * packed.start_clear_dots
    for found in designed.values():
        assert found.clear_dots == lay("map", bar(), found.orientations).pupil.sum()


def test_a_designed_map_restores_better_at_every_level(designed):
    equal, packed = designed[MapMode.EQUAL_LIGHT], designed[MapMode.EDGE_PACKING]
    assert min(equal.gain_db) > 0.1
    assert sum(packed.gain_db) > sum(equal.gain_db)


def test_no_single_turn_of_a_finished_map_helps_much(error, designed):
    search, _ = searched(error, [bar()])
    state = search.fresh(designed[MapMode.EDGE_PACKING].orientations.ravel().astype(np.int64))
    start = search.fresh(search.packed(np.zeros((CELLS, CELLS), dtype=np.int8)).astype(np.int64))
    assert state.turns.min(axis=1).sum() > 0.05 * start.turns.min(axis=1).sum()


def test_the_seed_decides(coarse):
    one, again, other = (design_map(bar(), coarse, seed=seed, kicks=0) for seed in (0, 0, 5))
    assert np.array_equal(one.orientations, again.orientations)
    assert one.psnr == again.psnr
    assert not np.array_equal(one.orientations, other.orientations)


def test_more_kicks_are_never_worse(coarse):
    told = []
    none = design_map(bar(), coarse, kicks=0)
    many = design_map(bar(), coarse, kicks=1, progress=lambda stage, done, total: told.append((stage, done, total)))
    assert np.mean(many.psnr) >= np.mean(none.psnr)
    assert told == [("map", 1, 2), ("map", 2, 2)]


def test_several_units_are_no_worse_than_one(coarse):
    moved = np.roll(bar(), 1, axis=1)
    both = design_map(np.stack([bar(), moved]), coarse, kicks=0)
    assert set(np.unique(both.orientations // ORIENTATIONS).tolist()) == {0, 1}
    assert abs(both.clear_dots / both.start_clear_dots - 1) <= LIGHT_TOLERANCE
    assert min(both.gain_db) > 0.1


def test_units_of_unequal_light_keep_the_sum(coarse):
    units = np.stack([bar(), bar(6, 2)])
    found = design_map(units, coarse, kicks=0)
    assert abs(found.clear_dots / found.start_clear_dots - 1) <= LIGHT_TOLERANCE


@pytest.mark.parametrize("arm", [0, 3])
def test_a_unit_without_orientations_has_nothing_to_design(error, arm):
    """A cross, and an opening without a closed dot."""
    square = np.zeros((DOTS, DOTS), dtype=np.bool_)
    square[arm : DOTS - arm] = square[:, arm : DOTS - arm] = True
    assert all(np.array_equal(orient(square, k), square) for k in range(ORIENTATIONS))
    found = design_map(square, error, kicks=1)
    assert found.gain_db == pytest.approx((0, 0), abs=1e-9)
    assert found.clear_dots == found.start_clear_dots


@pytest.mark.parametrize(
    ("units", "kind", "code"),
    [
        (np.zeros((DOTS, DOTS), dtype=np.bool_), OpeningError, "MF203"),
        (np.full((DOTS, DOTS), 2), OpeningError, "MF202"),
        (np.ones((DOTS + 1, DOTS), dtype=np.bool_), OpeningError, "MF201"),
        (np.ones((DOTS + 1, DOTS + 1), dtype=np.bool_), JobError, "MF122"),
        (np.ones((16, DOTS, DOTS), dtype=np.bool_), JobError, "MF122"),
        (np.ones((0, DOTS, DOTS), dtype=np.bool_), JobError, "MF122"),
    ],
)
def test_units_that_cannot_be_laid_are_told(error, units, kind, code):
    with pytest.raises(kind, match=code):
        design_map(units, error)


SMALL_NM = 14_000
"""Of six to a cell of 84 um, and twelve to one of 168 um."""


def corner(dots):
    mask = np.zeros((dots, dots), dtype=np.bool_)
    mask[:3, :2] = True
    return mask


@pytest.fixture(scope="module")
def small():
    return pupil_error(surrogate([leaves(1)], 6, dot_nm=SMALL_NM), (24, 40))


def test_four_cells_are_one_of_twice_the_pitch(small):
    """A panel of 48 x 48 cells of 84 um, repeated, is one of 24 x 24 cells that hold two by two of them."""
    twice = pupil_error(surrogate([leaves(1)], 12), (24, 40))
    assert (small.cells, twice.cells) == (48, 24)
    fine = small.laid(corner(6), np.zeros((48, 48), dtype=np.int8))
    coarse = twice.laid(np.tile(corner(6), (2, 2)), np.zeros((24, 24), dtype=np.int8))
    assert np.array_equal(fine, coarse)
    assert small.psnr(fine) == pytest.approx(twice.psnr(coarse), abs=1e-4)


def test_cells_of_168_um_are_the_same_however_they_are_told(estimate, error):
    told = pupil_error(surrogate([leaves(1)], DOTS, dot_nm=24_000), (24, 40))
    assert np.array_equal(told.laid(bar()), lay("bar", bar()).pupil)
    assert told.psnr(told.laid(bar())) == error.psnr(error.laid(bar()))


def test_what_a_realised_panel_of_168_um_is_worth_stays(error):
    """Designs of former versions are compared with those of this one; processors differ in single precision."""
    assert error.psnr(error.laid(bar())) == pytest.approx((21.9891172, 28.4786547), abs=1e-5)


@pytest.mark.parametrize("cells", [12, pytest.param(48, marks=pytest.mark.slow)])
def test_a_map_of_other_cells_restores_better(small, coarse, cells):
    error, unit = (small, corner(6)) if cells == 48 else (coarse, bar())
    found = design_map(unit, error, kicks=0)
    assert found.orientations.shape == (cells, cells)
    assert min(found.gain_db) > 0.03
    assert abs(found.clear_dots / found.start_clear_dots - 1) <= LIGHT_TOLERANCE
    assert error.psnr(error.laid(unit, found.orientations)) == found.psnr


@pytest.mark.parametrize(("dots", "dot_nm"), [(1, 1_175_000), (3, 1_000_000), (9, 500_000), (5, 333_333), (2, 20_000)])
def test_the_slope_is_exact_for_cells_of_any_size(dots, dot_nm):
    """Cells wider than the stop, cells of one dot, dots of a third of a millimetre: the field is the slope."""
    from scipy.signal import correlate  # which takes a second to import

    error = pupil_error(surrogate([leaves(1)], dots, dot_nm=dot_nm), (24, 40))
    pupil = error.lattice.stop.astype(np.float64)
    pupil[::2, 1::3] = 0
    epsilons = error.epsilons(pupil)
    judged = error.judge(pupil, epsilons)
    slope = judged.slope()
    assert slope.near.shape == (2 * dots - 1, 2 * dots - 1)
    assert slope.field.shape == pupil.shape
    place = np.unravel_index(np.argmax(abs(slope.field)), pupil.shape)
    one = np.zeros_like(pupil)
    one[place] = 1
    # The autocorrelation's own slope by that dot: the pupil seen from it, both ways.
    moves = correlate(pupil, one) + correlate(one, pupil)
    middle, reach = len(pupil) - 1, len(error.pixel) // 2
    moves = np.pad(moves, max(0, reach - middle))
    centre = len(moves) // 2
    half = moves[centre : centre + reach + 1, centre - reach : centre + reach + 1].astype(np.float32)
    table = error._table(pupil)[1]
    # Small beside the light, and yet more than single precision loses of it.
    step = 1e-4 * float(table.max())
    ends = [float(error._loss(torch.from_numpy(table + sign * step * half), epsilons)) for sign in (1, -1)]
    assert (ends[0] - ends[1]) / (2 * step) == pytest.approx(float(slope.field[place]), rel=0.02, abs=1e-5)


def test_cells_too_fine_for_a_map_are_told():
    with pytest.raises(JobError, match=r"MF115.*86 dots"):
        require_size(lattice(86, 4_000))
    with pytest.raises(JobError, match=r"MF115.*1002 cells"):
        require_size(lattice(1, 3_995))
