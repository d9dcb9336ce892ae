"""The error of realised panels and its slope, and the maps designed with them."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from maskfab.design.orientation_map import LIGHT_TOLERANCE, MapMode, _Search, design_map
from maskfab.design.pupil_error import pupil_error
from maskfab.design.surrogate import surrogate
from maskfab.errors import JobError, OpeningError
from maskfab.imaging.scenes import dead_leaves
from maskfab.imaging.transfer import CELLS, autocorrelation, lay
from maskfab.model import ORIENTATIONS, orient

DOTS = 7


def bar(high=5, wide=2):
    mask = np.zeros((DOTS, DOTS), dtype=np.bool_)
    mask[:high, :wide] = True
    return mask


@pytest.fixture(scope="module")
def estimate():
    return surrogate([dead_leaves(1)], DOTS)


@pytest.fixture(scope="module")
def error(estimate):
    return pupil_error(estimate, (24, 40))


@pytest.fixture(scope="module")
def designed(error):
    return {mode: design_map(bar(), error, mode=mode, kicks=0) for mode in MapMode}


def searched(error, units, seed=0, mode=MapMode.EDGE_PACKING):
    kinds = ORIENTATIONS * len(units)
    drawn = np.random.default_rng(seed).integers(kinds, size=(CELLS, CELLS)).astype(np.int8)
    return _Search(np.stack(units), error, mode, drawn), drawn.ravel().astype(np.int64)


def test_the_transforms_agree_with_the_autocorrelation(error):
    pupil = lay("bar", bar()).pupil
    _, table = error._table(pupil)
    whole = autocorrelation(pupil)
    middle, reach = len(pupil) - 1, len(table) - 1
    assert np.array_equal(table, np.rint(whole[middle : middle + reach + 1, middle - reach : middle + reach + 1]))


def test_transfer_at_the_lags_of_one_cycle(error):
    """At frequency 0 nothing is lost; elsewhere each lag has its sinc, and those a cycle away are folded back."""
    pupil = lay("bar", bar()).pupil
    _, table = error._table(pupil)
    transfer, _, light = error._transfers(torch.from_numpy(table))
    assert float(light) == pupil.sum()
    whole = autocorrelation(pupil) / pupil.sum()
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


@pytest.mark.parametrize("units", [[bar()], [bar(), bar(2, 5), bar(7, 1)]])
def test_the_turns_are_those_of_every_single_cell(error, units):
    """The one field prices whole and cut cells as exact evaluation does, to the curvature left out."""
    search, chosen = searched(error, units)
    state = search._fresh(chosen)
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
    assert not search._fresh(chosen).turns[dark].any()


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
    state = search._fresh(designed[MapMode.EDGE_PACKING].orientations.ravel().astype(np.int64))
    start = search._fresh(search.packed(np.zeros((CELLS, CELLS), dtype=np.int8)).astype(np.int64))
    assert state.turns.min(axis=1).sum() > 0.05 * start.turns.min(axis=1).sum()


def test_the_seed_decides(error, designed):
    one = designed[MapMode.EQUAL_LIGHT]
    again, other = (design_map(bar(), error, seed=seed, kicks=0) for seed in (0, 5))
    assert np.array_equal(one.orientations, again.orientations)
    assert one.psnr == again.psnr
    assert not np.array_equal(one.orientations, other.orientations)


def test_more_kicks_are_never_worse(error, designed):
    told = []
    many = design_map(bar(), error, kicks=1, progress=lambda stage, done, total: told.append((stage, done, total)))
    assert np.mean(many.psnr) >= np.mean(designed[MapMode.EQUAL_LIGHT].psnr)
    assert told == [("map", 1, 2), ("map", 2, 2)]


def test_several_units_are_no_worse_than_one(error):
    moved = np.roll(bar(), 1, axis=1)
    both = design_map(np.stack([bar(), moved]), error, kicks=0)
    assert set(np.unique(both.orientations // ORIENTATIONS).tolist()) == {0, 1}
    assert abs(both.clear_dots / both.start_clear_dots - 1) <= LIGHT_TOLERANCE
    assert min(both.gain_db) > 0.1


def test_units_of_unequal_light_keep_the_sum(error):
    units = np.stack([bar(), bar(6, 2)])
    found = design_map(units, error, kicks=0)
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
