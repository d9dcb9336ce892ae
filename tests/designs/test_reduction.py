"""Openings with their least useful dots closed."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from once import leaves

import maskfab as mf
from maskfab.base.errors import JobError, OpeningError
from maskfab.base.model import Opening
from maskfab.camera.stop_cells import F1, lattice
from maskfab.designs.model.expected_psnr import surrogate_behind
from maskfab.designs.search.scan import reduced, reduced_opening

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


def test_of_an_opening_the_dots_go_that_photographs_miss_least():
    scenes = [leaves(1)]
    opening = Opening("given", UNIT, 56_000)
    found = reduced_opening(opening, 5, F1, scenes, "test")
    estimate = surrogate_behind(scenes, lattice(3, 56_000))
    every = {}
    for place in np.argwhere(UNIT):
        mask = UNIT.copy()
        mask[tuple(place)] = False
        every[mask.tobytes()] = np.mean(estimate(mask))
    assert every[found.mask.tobytes()] == max(every.values())
    assert (found.name, found.dot_nm, found.provenance["from"]) == ("given_5", 56_000, "given")


@pytest.mark.parametrize(
    ("clear_dots", "options", "code"),
    [(0, {}, "MF203"), (7, {}, "MF104"), (2.5, {}, "MF105"), (3, {"tiling": "map"}, "MF105")],
)
def test_an_opening_refuses_what_it_cannot_be_reduced_to(clear_dots, options, code):
    opening = mf.Opening.of(UNIT, "168 um")
    with pytest.raises((JobError, OpeningError), match=code):
        opening.reduced(clear_dots, **options)
