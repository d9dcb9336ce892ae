"""Openings searched for their area: never above the proven bound, close to it, and what a laid panel shows."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from sweeps import sweep

from maskfab.base.errors import JobError, OpeningError
from maskfab.base.model import ORIENTATIONS, orient
from maskfab.camera.lens import CELLS, lattice, lay, pupil_autocorrelation
from maskfab.designs.descent.losses import mtf_auc
from maskfab.designs.descent.objective import tiled_stop
from maskfab.designs.descent.schedule import PAPER_CAMERA
from maskfab.designs.model.expected_psnr import unit_modulation
from maskfab.designs.model.limits import auc_bound, rings
from maskfab.designs.search.mtf_exchange import DotPairs, Smoothed, best_for_auc

DOTS, CLEAR = 21, 100


def noise(seed, clear=CLEAR, dots=DOTS):
    unit = np.zeros(dots * dots, dtype=np.bool_)
    unit[np.random.default_rng(seed).permutation(dots * dots)[:clear]] = True
    return unit.reshape(dots, dots)


def square(side=10, dots=DOTS):
    unit = np.zeros((dots, dots), dtype=np.bool_)
    unit[:side, :side] = True
    return unit


def laid_area(unit, orientations):
    """Of one panel, at whole lags as in the bound."""
    around = rings(len(unit))
    table = pupil_autocorrelation(lay("panel", unit, orientations).pupil)
    middle = len(table) // 2
    y, x = around.lags
    images = [(y, x), (-y, x), (x, y), (-x, y)]
    open_stop = pupil_autocorrelation(lattice(len(unit)).stop.astype(np.float64))[middle + y, middle + x]
    modulation = np.stack([table[middle + v, middle + u] for v, u in images]) / table[middle, middle]
    return around.area(modulation * open_stop[0] / np.maximum(open_stop, 1e-9))


def turns(seed):
    return np.random.default_rng(seed).integers(ORIENTATIONS, size=(CELLS, CELLS)).astype(np.int8)


@pytest.mark.parametrize("clear", sweep([100, 88], 1))
def test_a_repeated_unit_comes_within_a_seventh_of_the_bound(clear):
    around = rings(DOTS)
    unit = best_for_auc(DOTS, clear, periodic=True, steps=500)
    limit = auc_bound(around, clear, periodic=True)
    reached = around.of_unit(unit, periodic=True)
    assert unit.sum() == clear
    assert 0.86 * limit < reached <= limit
    # A difference set would have all counts alike; this one has none far below the mean.
    count = np.rint(unit_modulation(unit, periodic=True)[0] * clear)
    mean = clear * (clear - 1) / (DOTS**2 - 1)
    assert count.min() > 0.7 * mean
    assert np.rint(unit_modulation(noise(1, clear), periodic=True)[0] * clear).min() < 0.6 * mean


@pytest.mark.slow
def test_a_turned_unit_comes_within_a_thirtieth_of_the_bound():
    around = rings(DOTS)
    unit = best_for_auc(DOTS, CLEAR, steps=80)
    limit = auc_bound(around, CLEAR, periodic=False)
    assert unit.sum() == CLEAR
    assert 0.967 * limit < around.of_unit(unit) <= limit


@pytest.mark.parametrize("dots", sweep([1, 2, 5, 8], 3))
@pytest.mark.parametrize("periodic", [False, True], ids=["turned", "repeated"])
def test_small_units_stay_below_the_bound_and_beat_chance(dots, periodic):
    around = rings(dots)
    for clear in sorted({1, dots, dots**2 // 2, dots**2 - 1, dots**2} - {0}):
        unit = best_for_auc(dots, clear, periodic=periodic, steps=15)
        reached = around.of_unit(unit, periodic=periodic)
        assert unit.shape == (dots, dots)
        assert unit.sum() == clear
        assert reached <= auc_bound(around, clear, periodic=periodic) + 1e-9
        assert reached >= around.of_unit(noise(0, clear, dots), periodic=periodic) - 1e-12


@pytest.mark.parametrize(("dots", "clear", "pairs"), [(4, 6, 2), (6, 15, 6)])
def test_difference_sets_are_found(dots, clear, pairs):
    """Each difference of their dots occurs equally often (Menon 1962), so that the modulation is flat."""
    around = rings(dots)
    unit = best_for_auc(dots, clear, periodic=True, steps=300)
    count = unit_modulation(unit, periodic=True)[0] * clear
    assert count[0, 0] == pytest.approx(clear)
    np.testing.assert_allclose(count.ravel()[1:], pairs, atol=1e-9)
    reached = around.of_unit(unit, periodic=True)
    assert reached <= auc_bound(around, clear, periodic=True) < 1.001 * reached


def test_the_same_seed_gives_the_same_unit():
    for periodic in (False, True):
        first, again, other = (best_for_auc(9, 20, periodic=periodic, seed=s, steps=8) for s in (3, 3, 4))
        assert np.array_equal(first, again)
        assert not np.array_equal(first, other)


def test_more_steps_are_never_worse():
    around = rings(9)
    told = []
    reached = [
        around.of_unit(best_for_auc(9, 20, steps=steps, progress=lambda *each: told.append(each)))
        for steps in (0, 20, 60)
    ]
    assert reached == sorted(reached)
    assert told[-1] == (f"exchange, area {reached[-1]:.4f}", 60, 60)


@pytest.mark.parametrize("dots", [4, 7])
def test_pairs_of_every_dot_make_up_the_circular_autocorrelation(dots):
    around = rings(dots)
    pairs = DotPairs.of(around)
    unit = noise(3, dots * 2, dots)
    clear = np.flatnonzero(unit)
    count = np.zeros(len(pairs.repeats))
    for dot in clear:
        np.add.at(count, pairs.kind[clear, dot], pairs.made_with(int(dot))[clear] / 2)
    circular = np.rint(unit_modulation(unit, periodic=True)[0] * len(clear))
    y, x = np.divmod(np.arange(dots * dots), dots)
    for dot in range(1, dots * dots):
        assert count[pairs.kind[dot, 0]] == circular[y[dot], x[dot]]
    assert np.nanmin(np.where(np.isfinite(pairs.faintest), pairs.faintest, np.nan)) > 0


@pytest.mark.parametrize("unit", [noise(0), square(), noise(2, 40)], ids=["noise", "square", "darker"])
def test_the_searched_area_is_the_bounds(unit):
    around = rings(DOTS)
    area = Smoothed.of(around, 0)
    assert area.of_mask(unit) == pytest.approx(around.of_unit(unit), abs=1e-12)
    # The smoothed minimum of m lags is at most log(m) temperatures below the minimum.
    assert 0 <= area.of_mask(unit) - area.of_mask(unit, 1e-4) < 1e-4 * np.log(600)


@pytest.mark.parametrize("scatter", [0.0, 1.6])
def test_slopes_are_those_of_differences(scatter):
    area = Smoothed.of(rings(5), scatter)
    unit = noise(1, 8, 5)
    slope = area.slope(unit)
    relaxed = torch.from_numpy(unit.astype(np.float64))
    for dot in (0, 7, 24):
        step = torch.zeros(25, dtype=torch.float64)
        step[dot] = 1e-6
        step = step.view(5, 5)
        rise = float(area(relaxed + step, 0.002) - area(relaxed - step, 0.002)) / 2e-6
        assert slope[dot] == pytest.approx(rise, rel=1e-4, abs=1e-8)


def test_a_repeated_panel_shows_what_is_expected():
    around = rings(DOTS)
    alike = np.zeros((CELLS, CELLS), dtype=np.int8)
    report = mtf_auc(tiled_stop(DOTS, 8000, alike, PAPER_CAMERA))
    for unit in (noise(0), square()):
        expected = around.of_unit(unit, periodic=True)
        assert laid_area(unit, alike) == pytest.approx(expected, abs=2e-3)
        # What is reported is sampled 1.006 lags apart. In between, the lags' extremes are levelled.
        blue = report.auc(torch.from_numpy(unit.astype(np.float64)))[2]
        assert expected - 2e-3 < blue < 1.3 * expected


@pytest.mark.parametrize("unit", [noise(0), square()], ids=["noise", "square"])
def test_scatter_predicts_what_a_turned_panel_shows(unit):
    around = rings(DOTS)
    shown = np.mean([laid_area(unit, turns(seed)) for seed in range(3)])
    predicted = Smoothed.of(around, 1.6).of_mask(unit)
    assert shown == pytest.approx(predicted, abs=1.5e-3)
    assert shown < around.of_unit(unit)


@pytest.mark.parametrize("unit", [noise(0, 20, 9), square(4, 9)], ids=["noise", "square"])
def test_variance_of_laid_panels(unit):
    n = len(unit)
    area = Smoothed.of(rings(n), 1)
    turned = torch.from_numpy(np.stack([orient(unit, k) for k in range(ORIENTATIONS)]).astype(np.float64))
    long, short = area._variance(torch.fft.rfft2(turned, s=(2 * n, 2 * n)))
    tables = [pupil_autocorrelation(lay("panel", unit, seed=seed).pupil) for seed in range(60)]
    middle = CELLS * n - 1
    open_stop = pupil_autocorrelation(lattice(n).stop.astype(np.float64))
    for y, x, variance in ((2, 4, short), (5, 6, short), (4, 23, long), (30, 8, long)):
        lags = [(a, b) for v, u in ((y, x), (x, y)) for a, b in ((v, u), (v, -u))]
        seen = np.mean([np.var([t[middle + a, middle + b] / t[middle, middle] for t in tables]) for a, b in lags])
        overlap = open_stop[middle + y, middle + x] / open_stop[middle, middle]
        expected = float(variance[y % n, x % n]) * overlap / area.cells / unit.sum() ** 2
        # Four variances of sixty each are good to a tenth; the cells that the stop cuts are left out.
        assert seen == pytest.approx(expected, rel=0.4)


@pytest.mark.slow
def test_units_found_with_scatter_show_more():
    plain, wary = (best_for_auc(11, 27, scatter=scatter, steps=50) for scatter in (0.0, 1.6))
    around = rings(11)
    assert around.of_unit(plain) > around.of_unit(wary)
    shown = [np.mean([laid_area(unit, turns(seed)) for seed in range(3)]) for unit in (plain, wary)]
    assert shown[0] < shown[1]


def test_bad_input():
    for bad in ({"dots": 0, "clear_dots": 1}, {"steps": -1}, {"scatter": -1.0}, {"scatter": float("nan")}):
        with pytest.raises(JobError, match="MF104"):
            best_for_auc(**bad)
    with pytest.raises(OpeningError, match="MF203"):
        best_for_auc(clear_dots=0)
    with pytest.raises(OpeningError, match="MF204"):
        best_for_auc(clear_dots=442)
