"""Pixels over the camera beside those around: what is shared, what is left out, and how both are judged."""

from __future__ import annotations

import math

import numpy as np
import pytest
from display.display_jobs import check_refused, job

from maskfab.base.errors import JobError
from maskfab.display.camera_zone import CameraZone
from maskfab.display.emitter_rules import EmitterRules, Verdict
from maskfab.display.feasibility import displays
from maskfab.display.reference import LAYOUTS, Reference
from maskfab.mask.job import load_job

EMITTERS = '\n[emitters]\ncolour_gap = "2 um"\nmin_width = "4 um"\n'
BOXES = """
[circuits]
gap = "2 um"
gap_to_opening = "2 um"
boxes = [{ name = "all of it", width = "10 um", height = "10 um" }]
"""


def checked(folder, more: str = ""):
    """The display of the small job's one die."""
    loaded = load_job(job(folder, EMITTERS + more))
    return next(iter(displays(loaded).displays.values()))


@pytest.mark.parametrize(("sharing", "across"), [(1, 1), (2, 1), (4, 1), (1, 2), (2, 3)])
def test_resolution_counts_pixels_with_circuits_of_their_own(sharing, across):
    zone = CameraZone(sharing, 50_000)
    pitch_nm = 50_000 * across
    area_in = (pitch_nm / 25.4e6) ** 2
    assert zone.resolution_ppi(pitch_nm) ** 2 * area_in == pytest.approx(1 / sharing)
    assert zone.around_nm(pitch_nm) == 50_000
    assert ("left out" in zone.told(pitch_nm)) == (across > 1)


def test_a_pitch_that_is_no_whole_number_of_those_around_is_refused():
    with pytest.raises(JobError, match="no whole number") as caught:
        CameraZone(1, 50_000).across(130_000)
    assert (caught.value.code, caught.value.where) == ("MF105", "display.normal")
    # Its cure: 195.4 dpi to four digits is within the hundredth that is allowed.
    assert CameraZone(1, round(25.4e6 / float(caught.value.cure.split()[3]))).across(130_000) == 3


@pytest.mark.parametrize("layout", LAYOUTS)
@pytest.mark.parametrize("across", [2, 3])
def test_pixels_around_fill_a_larger_pixel_as_they_fill_the_plane(layout, across):
    fine = Reference.of(layout, 60_000, EmitterRules(0, 4000, 4000))
    coarse = fine.beside(across)
    assert coarse.pitch_nm == 60_000 * across
    assert coarse.shares == pytest.approx(fine.shares)
    count, cells = 24, 2
    held = fine.tiled(cells * across, cells * across)
    wide = coarse.tiled(cells, cells)

    def drawn(tiled, samples: int) -> np.ndarray:
        lit = [tile.samples(samples) for tile in tiled.tiles]
        return np.concatenate([np.concatenate([lit[k] for k in row], axis=2) for row in tiled.held], axis=1)

    assert drawn(wide, count * across) == pytest.approx(drawn(held, count), abs=1e-9)


def test_shared_circuits_are_placed_and_told(tmp_path):
    alone = checked(tmp_path, BOXES)
    shared = checked(tmp_path, BOXES + "[display]\nsharing = 4\n")
    assert (alone.circuits.wanted, shared.circuits.wanted) == (3, 1)
    assert shared.resolution_ppi == pytest.approx(alone.resolution_ppi / 2)
    assert "4 pixels share a circuit" in shared.resolution
    assert shared.circuits_by in shared.resolution
    assert "area alone" in checked(tmp_path, "[display]\nsharing = 4\n").resolution


def test_life_and_looks_are_beside_the_display_around(tmp_path):
    own = checked(tmp_path).judged
    pitch_um = own.seen_pitch_um
    finer = checked(tmp_path, f'[display]\nnormal = "{pitch_um / 2:g} um"\n').judged
    # Gaps of 4 um take more of a finer pixel, so that its emitters are smaller and the zone's live longer beside them.
    assert min(finer.reference_shares) < min(own.reference_shares)
    assert {one.name: one.value for one in finer.lives}["life"] > {one.name: one.value for one in own.lives}["life"]
    assert finer.looks[0].value == own.looks[0].value


def test_the_display_around_must_hold_its_own_circuits(tmp_path):
    pitch_um = checked(tmp_path).judged.seen_pitch_um
    answer = checked(tmp_path, f'{BOXES}[display]\nnormal = "{pitch_um / 3:g} um"\nsharing = 4\n')
    assert answer.circuits.verdict is Verdict.FITS
    assert answer.around.wanted == 3
    assert answer.around.verdict is not Verdict.FITS
    assert answer.verdict is not Verdict.FITS
    assert math.isclose(answer.zone.across(answer.pitch_nm), 3)


def test_two_answers_on_sharing_are_refused(capsys, tmp_path):
    extra = EMITTERS + "shared_by = 2\n[display]\nsharing = 4\n"
    check_refused(capsys, tmp_path, extra, "MF105", "2 pixels share a circuit by emitters.shared_by, and 4")


def test_a_zone_without_emitters_is_refused(capsys, tmp_path):
    check_refused(capsys, tmp_path, "[display]\nsharing = 2\n", "MF105", "display")
