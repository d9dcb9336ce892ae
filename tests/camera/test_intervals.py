"""Intervals of mean differences cover what they say."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy import stats

from maskfab.camera.scores import MeanDifference


def test_the_interval_is_that_of_students_t():
    draws = [0.3, 0.1, 0.5, 0.2]
    found = MeanDifference.of(draws)
    low, high = stats.t.interval(0.95, 3, loc=np.mean(draws), scale=stats.sem(draws))
    assert (found.mean - found.half_width, found.mean + found.half_width) == pytest.approx((low, high))
    assert found.count == 4


def test_ninety_five_of_a_hundred_intervals_hold_the_mean():
    draws = np.random.default_rng(0).normal(0.4, 0.3, (2000, 6))
    held = [abs(found.mean - 0.4) <= found.half_width for found in map(MeanDifference.of, draws.tolist())]
    assert np.mean(held) == pytest.approx(0.95, abs=0.015)


def test_what_holds_nought_is_a_tie_and_one_photograph_tells_nothing():
    assert MeanDifference.of([0.3, -0.2, 0.1]).tie
    assert not MeanDifference.of([0.3, 0.31, 0.29]).tie
    alone = MeanDifference.of([2.0])
    assert alone.tie
    assert math.isnan(alone.half_width)


def test_a_difference_that_rounds_to_nought_has_no_minus():
    assert MeanDifference(-0.004, 0.01, 5).told() == "+0.00 ± 0.01 dB tie"
    assert MeanDifference(-0.006, 0.001, 5).told() == "-0.01 ± 0.00 dB"
