"""Transfer of a die before the job's own camera: direct sums, the PSF's own path, and what must not change it."""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from optics_cases import aberrated_psf, defocused_psf, focused_psf, noise, panel

from maskfab.base.errors import JobError
from maskfab.base.model import Panel, Psf
from maskfab.camera.die_transfer import DieTransfer, Lines, die_transfer, line_transfer
from maskfab.camera.protocol import evaluate
from maskfab.camera.scenes import Photograph, dead_leaves
from maskfab.camera.stop_cells import F1, PhotoCamera, laid_panel, lay, pupil_transfer
from maskfab.job.camera import Camera, Stop
from maskfab.optics.gap import AXIS, AmplitudeLags, gap_psf, moved_aperture, shift_um
from maskfab.optics.phase import Wavefront
from maskfab.optics.pupil import Lattice, cut, panel_aperture
from maskfab.optics.response import camera_bands, generic_rgb
from maskfab.optics.scene.scene import Scene
from maskfab.optics.spectrum import Band, Curve, band_lines, line_spectrum

RGB = (610.0, 530.0, 470.0)
PHONE = Camera(5560.0, Stop("circle", 3475.0), RGB, 1.4, 256.0)
F1_CAMERA = Camera(F1.focal_um, F1.stop, F1.wavelengths_nm, F1.pixel_um, 256.0)
SMALL = Camera(2000.0, Stop("circle", 300.0), RGB, 1.4, 400.0)
SHAPE = (64, 96)
OPENING = noise(7, 0.4, 4)


def random_panel(cells: int = 8, seed: int = 3, gutter_nm: int = 0) -> Panel:
    return panel(OPENING, cells=cells, seed=seed, gutter_nm=gutter_nm)


def at_frequency(found: DieTransfer, row: int, column: int) -> np.ndarray:
    return found.on(SHAPE)[:, row, column]


@pytest.mark.parametrize(("camera", "cells", "gutter_nm"), [(PHONE, 64, 0), (SMALL, 8, 0), (SMALL, 8, 3000)])
def test_the_transfer_is_a_direct_sum_over_lags(camera, cells, gutter_nm):
    laid_out = random_panel(cells, gutter_nm=gutter_nm)
    pupil = cut(panel_aperture(laid_out, camera.stop.diameter_um / 2), camera.stop)
    # Dots and gutters on the grid of their common measure: a shift by whole micrometres is a shift of the array.
    fine = 8 if gutter_nm == 0 else 1
    widths = np.rint(np.diff(pupil.x.edges_um())).astype(int) // fine
    amplitude = pupil.mean_transmission.repeat(widths, 0).repeat(widths, 1)
    found = die_transfer("D", laid_out, camera)

    def overlap(lag_y: int, lag_x: int) -> float:
        side = len(amplitude)
        if max(abs(lag_y), abs(lag_x)) >= side:
            return 0.0
        if lag_y == lag_x == 0:
            return pupil.energy_um2 / fine**2
        here, there = ([slice(max(0, -lag), side - max(0, lag)) for lag in (s * lag_y, s * lag_x)] for s in (1, -1))
        return float((amplitude[here[0], here[1]] * amplitude[there[0], there[1]]).sum())

    for (row, column), (colour, line) in zip([(0, 5), (3, 0), (61, 40)], enumerate(RGB), strict=True):
        nu = row / 64 - (row > 32), column / 96
        total = 0.0
        for k in product(range(-2, 3), repeat=2):
            lags = [(n + m) * line / 1e3 * camera.focal_um / camera.pixel_um / fine for n, m in zip(nu, k, strict=True)]
            (v, dv), (u, du) = ((math.floor(lag), lag - math.floor(lag)) for lag in lags)
            between = sum(
                weight_y * weight_x * overlap(v + j, u + i)
                for (j, weight_y), (i, weight_x) in product(((0, 1 - dv), (1, dv)), ((0, 1 - du), (1, du)))
                if weight_y * weight_x
            )
            total += between * math.prod(np.sinc(n + m) for n, m in zip(nu, k, strict=True))
        assert found.on(SHAPE)[colour, row, column] == pytest.approx(total * fine**2 / pupil.energy_um2, abs=1e-6)


def test_through_the_dots_of_f1_the_transfer_is_that_of_f1():
    laid = laid_panel("D", panel(OPENING, cells=80), F1)
    room = laid.lattice
    axis = Lattice(-room.side * room.dot_um / 2, room.side, 1, room.dot_um, room.dot_um)
    dots = laid.pupil[:, None, :, None]
    lags = AmplitudeLags.of(axis, axis, dots, float((dots**2).sum()) * room.dot_um**2)
    expected = pupil_transfer(laid.pupil, room, SHAPE)
    y, x = np.fft.fftfreq(SHAPE[0]), np.fft.rfftfreq(SHAPE[1])
    for colour, line in enumerate(RGB):
        assert line_transfer(lags, F1.cycle_um(line), y, x) == pytest.approx(expected[colour], abs=1e-6)
    # A die's own transfer knows the stop's rim better than by whole dots.
    own = die_transfer("D", panel(OPENING, cells=80), F1_CAMERA)
    assert 1e-6 < abs(own.on(SHAPE) - expected).max() < 5e-4


def test_photographs_before_the_camera_of_f1_score_as_in_f1():
    laid_out = panel(OPENING, cells=80)
    designs = [laid_panel("F1", laid_out, F1), die_transfer("own", laid_out, F1_CAMERA)]
    scene = Photograph("S", 7, dead_leaves(3, 832, 832).values)
    known, own = (each.psnr for each in evaluate(designs, [scene], [scene], [32], details=False).scores)
    assert own == pytest.approx(known, abs=0.02)


def test_a_random_die_is_seen_through_its_own_cells():
    camera = replace(SMALL, stop=Stop("circle", 650.0))
    dies = [random_panel(14, seed) for seed in (3, 4)]
    own, other = (die_transfer("D", each, camera).on(SHAPE) for each in dies)
    room = laid_panel("D", dies[0], PhotoCamera.of(camera)).lattice
    first = (14 - room.cells) // 2
    middle = dies[0].orientations[first : first + room.cells, first : first + room.cells]
    laid = lay("D", OPENING, middle, room=room)
    by_whole_dots = pupil_transfer(laid.pupil, room, SHAPE)
    assert abs(own - by_whole_dots).max() < 0.1 * abs(own - other).max()


ROWS, COLUMNS = [0, 1, 5, 60, 31], [1, 3, 20, 9, 47]
COMA = Wavefront(((8, 0.1), (5, 0.1)), 610.0)


def transformed(psf: Psf) -> np.ndarray:
    """H of green light from samples of its point PSF, at ``ROWS`` and ``COLUMNS`` of ``SHAPE``."""
    place = psf.step_um * (np.arange(len(psf.values)) - len(psf.values) // 2)
    found = []
    for row, column in zip(ROWS, COLUMNS, strict=True):
        total = 0j
        for nu_y, nu_x in product(*((n + np.arange(-1, 2)) for n in (row / 64 - (row > 32), column / 96))):
            up, across = (np.exp(-2j * np.pi * nu * place / SMALL.pixel_um) * np.sinc(nu) for nu in (nu_y, nu_x))
            total += up @ psf.values @ across
        found.append(total * psf.step_um**2)
    return np.array(found)


@pytest.mark.parametrize(
    ("scene", "psf"),
    [
        pytest.param(
            Scene(aberrations=COMA.terms), lambda p: aberrated_psf(p, COMA, SMALL, 530.0, 1e-4), marks=pytest.mark.slow
        ),
        (Scene(nearest_um=1e4, farthest_um=1e4), lambda p: defocused_psf(p, SMALL, 530.0, 1e4, tolerance=1e-4)),
        (Scene(nearest_um=1e4, farthest_um=1e4, focus_um=1e4), lambda p: focused_psf(p, SMALL, 530.0, 1e4)),
    ],
    ids=["aberrations", "out of focus", "in focus nearby"],
)
def test_the_transfer_is_the_transform_of_the_psf_but_for_the_light_outside_the_window(scene, psf):
    laid_out = random_panel()
    found, plain = (die_transfer("D", laid_out, SMALL, each) for each in (scene, Scene()))
    seen = psf(cut(panel_aperture(laid_out), SMALL.stop))
    expected = transformed(seen)
    worst, change = (abs(expected - each.on(SHAPE)[1, ROWS, COLUMNS]).max() for each in (found, plain))
    assert worst < 1 - seen.energy_in_window + found.error
    assert worst < 0.2 * change


@pytest.mark.parametrize(
    ("scene", "image_um"),
    [
        (Scene(gap_um=400.0, field_um=400.0), (250.0, -100.0)),
        (Scene(gap_um=400.0, aberrations=((8, 0.04), (5, 0.1))), AXIS),
    ],
    ids=["off the axis", "aberrations"],
)
def test_a_gap_changes_the_transfer_as_it_changes_the_psf(scene, image_um):
    laid_out = random_panel(9)
    openings, waves = panel_aperture(laid_out), scene.wavefront(SMALL).waves(SMALL.stop, 530.0)
    moved = moved_aperture(openings, shift_um(SMALL, scene.gap_um, image_um), 200.0)
    there = gap_psf(openings, SMALL, 530.0, scene.gap_um, image_um, 3, waves=waves)
    expected = transformed(there) - transformed(gap_psf(moved, SMALL, 530.0, 0.0, AXIS, 3, waves=waves))
    found = die_transfer("D", laid_out, SMALL, scene).at(image_um)
    still = replace(found, view=found.view.without_gap())
    change = (found.on(SHAPE) - still.on(SHAPE))[1, ROWS, COLUMNS]
    assert abs(change - expected).max() < 0.3 * abs(expected).max()
    assert abs(expected).max() > found.error


@pytest.mark.parametrize("scene", [Scene(), Scene(gap_um=100.0), Scene(aberrations=((8, 0.05),))])
def test_no_light_is_made_or_lost_and_real_scenes_stay_real(scene):
    found = die_transfer("D", random_panel(), SMALL, scene).on(SHAPE)
    assert found[:, 0, 0] == pytest.approx(1.0, abs=2e-6)
    mirrored = np.roll(found[:, ::-1, :], 1, axis=1)
    for column in (0, -1):
        assert mirrored[:, :, column].conj() == pytest.approx(found[:, :, column], abs=2e-6)
    assert np.iscomplexobj(found) == (scene != Scene())


def test_only_what_a_half_turn_changes_has_a_complex_transfer():
    symmetric = panel(OPENING | OPENING[::-1, ::-1], cells=8)
    blurred = Scene(nearest_um=4e4, farthest_um=4e4)
    parts = [abs(die_transfer("D", each, SMALL, blurred).on(SHAPE).imag).max() for each in (symmetric, random_panel())]
    assert parts[0] < 1e-6
    assert parts[1] > 1e-3


def test_a_tilted_wavefront_moves_the_picture_to_the_right_and_down():
    waves = 0.25
    scene = Scene(aberrations=((2, waves), (3, 2 * waves)))
    found = die_transfer("D", panel(np.ones((7, 7), dtype=np.bool_), cells=8), SMALL, scene).on((64, 64))
    light = np.fft.irfft2(found[0])
    pixels = np.fft.fftfreq(64, 1 / 64)
    # W = 2 c x / R waves: a slope of 2 c λ / R, hence a shift of that times f.
    expected = 2 * waves * 0.610 / 150.0 * SMALL.focal_um / SMALL.pixel_um
    shifts = [float((light.sum(axis=axis) * pixels).sum() / light.sum()) for axis in (0, 1)]
    assert shifts == pytest.approx([expected, 2 * expected], rel=0.1)


def test_a_band_of_one_line_is_that_line_and_wide_bands_err_no_more_than_told():
    narrow = tuple(
        Band((Curve(np.array([line - 0.02, line, line + 0.02]), np.array([0.0, 1.0, 0.0]), "c"),), "b") for line in RGB
    )
    laid_out = random_panel()
    by_lines = die_transfer("D", laid_out, SMALL)
    assert die_transfer("D", laid_out, SMALL, Scene(bands=narrow)).on(SHAPE) == pytest.approx(
        by_lines.on(SHAPE), abs=2e-5
    )
    wide = die_transfer("D", laid_out, SMALL, Scene(bands=tuple(camera_bands(generic_rgb()).values())))
    red = max(wide.view.scene.bands, key=lambda band: band.centroid_nm)
    y, x = np.fft.fftfreq(16), np.fft.rfftfreq(24)
    fine = wide.view.shadow(band_lines(red, 256), 1, y, x)
    assert abs(wide.on((16, 24))[0] - fine).max() < wide.by_lines < abs(by_lines.on((16, 24))[0] - fine).max()


def test_a_band_over_a_gap_is_the_sum_of_its_lines_over_it():
    laid_out, bands = random_panel(9), tuple(camera_bands(generic_rgb()).values())
    found = die_transfer("D", laid_out, SMALL, Scene(bands=bands, gap_um=100.0))
    red = band_lines(max(bands, key=lambda band: band.centroid_nm), 16)
    y, x = np.fft.fftfreq(16), np.fft.rfftfreq(24)
    parts = [Lines(each, each) for each in (line_spectrum([float(line)]) for line in red.wavelengths_nm)]
    lines = [found.view.transfer(each, found.samples, y, x) for each in parts]
    undersampled = found.view.shadow(red, 1, y, x) - found.view.shadow(found.lines[0].shadow, 1, y, x)
    expected = sum(weight * each for weight, each in zip(red.weights, lines, strict=True)) - undersampled
    assert abs(found.on((16, 24))[0] - expected).max() < found.by_lines < 1e-2
    assert len(found.lines[0].gap.weights) < len(found.lines[0].shadow.weights)


def test_moving_a_repeated_panel_by_a_cell_changes_nothing_and_by_half_a_cell_does():
    laid_out, scene = panel(OPENING, cells=12), Scene(gap_um=400.0, field_um=400.0)
    known = die_transfer("D", laid_out, SMALL, scene)
    shadow = replace(known, view=known.view.without_gap())
    cell = 56.0 * SMALL.focal_um / scene.gap_um
    moved, half = (shadow.at((share * cell, 0.0)).on(SHAPE) for share in (1.0, 0.5))
    assert moved == pytest.approx(shadow.on(SHAPE), abs=1e-5)
    assert abs(half - shadow.on(SHAPE)).max() > 1e-3


def test_the_light_that_passes_is_the_clear_share_of_the_stop():
    full = panel(np.ones((7, 7), dtype=np.bool_), cells=8)
    assert die_transfer("D", full, SMALL).transmission == pytest.approx(1.0, abs=1e-9)
    # Half of every cell: a stripe of no more than a cell decides how much of the stop's rim it holds.
    half = np.zeros((8, 8), dtype=np.bool_)
    half[:4] = True
    striped = panel(half, cells=8)
    assert die_transfer("D", striped, SMALL).transmission == pytest.approx(0.5, abs=0.03)
    there = die_transfer("D", striped, SMALL, Scene(gap_um=300.0))
    assert there.transmission == pytest.approx(die_transfer("D", striped, SMALL).transmission, abs=0.03)


@pytest.mark.parametrize(
    ("code", "change"),
    [
        ("MF134", {"camera": replace(SMALL, wavelengths_nm=(530.0, 470.0))}),
        ("MF134", {"scene": Scene(bands=tuple(camera_bands(generic_rgb()).values())[:2])}),
        ("MF114", {"panel": random_panel(4)}),
        ("MF104", {"object_um": 1e5}),
        ("MF115", {"camera": replace(SMALL, stop=Stop("circle", 34_000.0)), "panel": random_panel(610)}),
        ("MF115", {"scene": Scene(aberrations=((11, 40.0),))}),
    ],
)
def test_what_no_photograph_can_be_taken_through_is_refused(code, change):
    given = {"name": "D", "panel": random_panel(), "camera": SMALL, "scene": Scene()} | change
    with pytest.raises(JobError, match=code) as refusal:
        die_transfer(**given)
    assert refusal.value.where
