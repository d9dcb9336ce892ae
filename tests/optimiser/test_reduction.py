"""Openings with their least useful dots closed."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from maskfab.errors import JobError, OpeningError
from maskfab.optimiser.reduction import reduced

UNIT = np.array([[1, 1, 0], [0, 1, 1], [1, 0, 1]], dtype=np.bool_)
WORTH = np.arange(1.0, 10.0).reshape(3, 3)


def worth(mask):
    return float(WORTH[mask].sum())


@pytest.mark.parametrize("clear_dots", range(1, 7))
def test_of_independent_dots_the_best_remain(clear_dots):
    """Where dots add up, one after the other is the best of all choices."""
    kept = reduced(UNIT, clear_dots, worth)
    assert kept.sum() == clear_dots
    assert not (kept & ~UNIT).any()
    every = itertools.combinations(WORTH[UNIT].tolist(), clear_dots)
    assert worth(kept) == max(map(sum, every))


def test_the_given_opening_is_left_alone():
    before = UNIT.copy()
    reduced(UNIT, 2, worth)
    assert np.array_equal(UNIT, before)


@pytest.mark.parametrize(("clear_dots", "kind", "code"), [(0, OpeningError, "MF203"), (7, JobError, "MF104")])
def test_counts_that_cannot_be_are_told(clear_dots, kind, code):
    with pytest.raises(kind, match=code):
        reduced(UNIT, clear_dots, worth)
