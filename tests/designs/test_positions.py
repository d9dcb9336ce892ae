"""Places inside the cell, the choice among them, and maps that move their opening there."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from maskfab.base.errors import JobError, OpeningError
from maskfab.base.model import ORIENTATIONS, orient
from maskfab.camera.stop_cells import lay
from maskfab.designs.maps.orientation_map import LIGHT_TOLERANCE, best_places, design_map, places
from maskfab.mask.panels import shifted

DOTS = 7
BAR = np.zeros((DOTS, DOTS), dtype=np.bool_)
BAR[:5, :2] = True


def images(mask):
    return {orient(mask, k).tobytes() for k in range(ORIENTATIONS)}


def test_every_place_but_for_the_turns_is_offered_once():
    """A bar of 2 x 5 dots has 6 x 3 places in 7 x 7, of which turns and mirrors leave 3 x 2."""
    found = places(BAR)
    assert found[0] == (0, 0)
    assert len(found) == 6
    assert all(shifted(BAR, shift).sum() == 10 for shift in found)
    assert not any(images(shifted(BAR, a)) & images(shifted(BAR, b)) for a, b in itertools.combinations(found, 2))


def test_an_l_has_all_its_places():
    mask = np.zeros((DOTS, DOTS), dtype=np.bool_)
    mask[1:5, 2] = mask[1, 2:5] = True
    assert len(places(mask)) == 4 * 5


def test_a_full_cell_stays():
    assert places(np.ones((DOTS, DOTS), dtype=np.bool_)) == ((0, 0),)


@pytest.mark.parametrize("most", [1, 5, 20])
def test_many_places_are_thinned(most):
    dot = np.zeros((21, 21), dtype=np.bool_)
    dot[3, 1] = dot[3, 2] = dot[4, 1] = dot[4, 4] = True
    found = places(dot, most)
    assert 1 <= len(found) <= most
    assert found[0] == (0, 0)
    assert all(shifted(dot, shift).sum() == 4 for shift in found)


def test_a_closed_opening_has_no_place():
    with pytest.raises(OpeningError, match="MF203"):
        places(np.zeros((3, 3), dtype=np.bool_))


def test_places_are_chosen_for_what_they_add():
    worth = np.array([[0.0, -3.0, -3.0, 0.0], [0.0, -2.0, -2.1, 0.0], [-1.0, 0.0, 0.0, -1.5]])
    assert best_places(worth, 1) == (0,)
    assert best_places(worth, 3) == (0, 2, 3)
    assert sorted(best_places(worth, 9)) == [0, 1, 2, 3]
    with pytest.raises(JobError, match="MF104"):
        best_places(worth, 0)


def test_a_map_with_places_keeps_the_light_and_restores_better(coarse):
    still = design_map(BAR, coarse, kicks=0)
    moving = design_map(BAR, coarse, kicks=0, positions=5)
    assert still.shifts == ()
    assert len(moving.shifts) == len(set(moving.shifts)) == 5
    assert moving.shifts[0] == (0, 0)
    units = np.stack([shifted(BAR, shift) for shift in moving.shifts])
    pupil = lay("map", units, moving.orientations, dot_nm=48_000).pupil
    assert pupil.sum() == moving.clear_dots
    assert moving.start_clear_dots == still.start_clear_dots
    assert abs(moving.clear_dots / moving.start_clear_dots - 1) <= LIGHT_TOLERANCE
    assert moving.start_psnr == still.start_psnr
    assert np.mean(moving.gain_db) > np.mean(still.gain_db)
    given = design_map(BAR, coarse, kicks=0, shifts=moving.shifts)
    assert np.array_equal(given.orientations, moving.orientations)


def test_a_map_goes_on_from_where_it_was(coarse):
    once = design_map(BAR, coarse, kicks=0)
    again = design_map(BAR, coarse, kicks=0, start=once.orientations)
    assert np.mean(again.psnr) >= np.mean(once.psnr)
    assert again.fields < once.fields
    assert again.start_psnr == once.start_psnr


@pytest.mark.parametrize(
    ("units", "asked", "code"),
    [
        (BAR, {"positions": 0}, "MF104"),
        (BAR, {"positions": 16}, "MF104"),
        (BAR, {"shifts": [(0, 0)] * 16}, "MF104"),
        (BAR, {"shifts": [(1, 0), (0, 0)]}, "MF122"),
        (BAR, {"shifts": [(0, 0), (6, 0)]}, "MF122"),
        (np.stack([BAR, BAR]), {"positions": 2}, "MF122"),
    ],
)
def test_places_that_cannot_be_are_told(error, units, asked, code):
    with pytest.raises(JobError, match=code):
        design_map(units, error, **asked)
