"""The transfer model behind any camera: against the optics of a report, at its limits, and beside protocol F1."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch
from estimates import surrogate

from maskfab.base.errors import JobError
from maskfab.base.model import Opening, Panel, Tiling
from maskfab.camera.protocol import EPSILONS
from maskfab.camera.scenes import Photograph
from maskfab.camera.stop_cells import F1, OpenStop, PhotoCamera, laid_panel, lattice, lay, pupil_transfer
from maskfab.designs.descent.losses import expected_error
from maskfab.designs.model.expected_psnr import interior
from maskfab.designs.model.limits import bounds, rings
from maskfab.designs.model.panel_error import pupil_error
from maskfab.job.camera import Camera, Stop
from maskfab.optics.lags import lag_table
from maskfab.optics.pupil import cut, panel_aperture

RGB = (610.0, 530.0, 470.0)
PHONE = Camera(5560.0, Stop("circle", 1000.0), RGB, 1.0, 64.0)
FAST = Camera(3700.0, Stop("circle", 1850.0), RGB, 1.4, 64.0)
COARSE = Camera(4000.0, Stop("square", 2500.0), RGB, 6.0, 64.0)


def bar(dots: int = 21) -> np.ndarray:
    found = np.zeros((dots, dots), dtype=np.bool_)
    found[: dots // 3, : dots - dots // 5] = True
    return found


def panel(cells: int, gutter_nm: int = 0) -> Panel:
    turned = np.random.default_rng(5).integers(8, size=(cells, cells)).astype(np.int8)
    return Panel(Opening("bar", bar(), 8000), 8000, gutter_nm, turned, Tiling.PAPER4, 1)


@pytest.fixture(scope="module")
def scenes() -> tuple[Photograph, ...]:
    """Noise of a spectrum f^-1.5, as wide as photographs are."""
    draw = np.random.default_rng(1).standard_normal((1024, 1536))
    distance = np.hypot(np.fft.fftfreq(1024)[:, None], np.fft.rfftfreq(1536))
    values = np.fft.irfft2(np.fft.rfft2(draw) / np.maximum(distance, 1e-3) ** 1.5)
    values = np.clip(0.4 + 0.15 * values / values.std(), 0, 1).astype(np.float32)
    return (Photograph("noise", 1, np.repeat(values[None], 3, axis=0)),)


@pytest.mark.parametrize(
    ("camera", "cells", "gutter_nm", "tolerance"),
    [(PHONE, 51, 0, 2e-3), (PHONE, 50, 0, 2e-3), (FAST, 31, 8000, 5e-4), (COARSE, 30, 0, 2e-3)],
    ids=["phone, axis in a cell", "phone, axis between cells", "fast, gutter of one dot", "coarse, square stop"],
)
def test_the_transfer_is_that_of_the_optics_summed_over_what_sampling_folds_back(camera, cells, gutter_nm, tolerance):
    """The optics cut dots by the stop, keep gutters as they are, and know no grid; whole dots cost so much."""
    made = panel(cells, gutter_nm)
    laid = laid_panel("bar", made, PhotoCamera.of(camera))
    found = pupil_transfer(laid.pupil, laid.lattice, (24, 36))
    table = lag_table(cut(panel_aperture(made, camera.stop.diameter_um / 2 + 1), camera.stop))
    for colour, nm in enumerate(RGB):
        cycle_um = nm / 1e3 * camera.focal_um / camera.pixel_um
        most = int(camera.stop.diameter_um / cycle_um + 0.5) + 1
        for row, column in ((1, 2), (21, 10), (12, 18)):
            y, x = (v.ravel() for v in np.mgrid[-most : most + 1, -most : most + 1].astype(np.float64))
            y, x = y + np.fft.fftfreq(24)[row], x + column / 36
            inside = np.maximum(abs(y), abs(x)) * cycle_um < camera.stop.diameter_um
            y, x = y[inside], x[inside]
            summed = (table.otf(x * cycle_um, y * cycle_um) * np.sinc(y) * np.sinc(x)).sum()
            assert found[colour, row, column] == pytest.approx(summed, abs=tolerance)


@pytest.mark.parametrize("camera", [PHONE, COARSE], ids=["phone", "coarse"])
def test_the_error_of_a_layout_sees_the_transfer_of_its_photographs(scenes, camera):
    """Frequencies of the layout's error are those of a picture of as many pixels; no lag is rounded."""
    estimate = surrogate(scenes, 21, dot_nm=8000, camera=PhotoCamera.of(camera))
    error = pupil_error(estimate, (32,))
    pupil = error.laid(bar(), seed=3)
    seen = error._transfers(torch.from_numpy(error._table(pupil)[1]))[0].numpy()
    half = error.cycle // 2
    photographed = pupil_transfer(pupil, estimate.lattice, (error.cycle, error.cycle))[1]
    np.testing.assert_allclose(seen[:, half:], photographed[: half + 1], atol=1e-5)


def test_the_slope_of_a_layout_between_whole_lags_tells_what_one_dot_changes(scenes):
    """To first order in the autocorrelation, whose own change is the dot with all others, and with itself."""
    estimate = surrogate(scenes, 21, dot_nm=8000, camera=PhotoCamera.of(PHONE))
    error = pupil_error(estimate, (32,))
    pupil = error.laid(bar(), seed=3)
    epsilons = error.epsilons(pupil)
    judged = error.judge(pupil, epsilons)
    slope = judged.slope()
    field, alone = slope.field, slope.near[20, 20]
    place = np.unravel_index(np.argmax(abs(field) * error.inside), pupil.shape)
    changed = pupil.copy()
    changed[place] = 1 - pupil[place]
    step = changed[place] - pupil[place]
    assert error.judge(changed, epsilons).loss - judged.loss == pytest.approx(step * field[place] + alone, rel=0.02)


def test_a_camera_next_to_that_of_f1_gives_next_to_its_numbers(scenes):
    """F1 takes whole lags where others interpolate: 0.1 dB of one layout for dots of 24 um, 0.02 dB for 8 um."""
    close = replace(F1, focal_um=F1.focal_um * (1 + 1e-9))
    assert (F1.is_f1, close.is_f1) == (True, False)
    ours, theirs = (surrogate(scenes, 7, dot_nm=24_000, camera=camera) for camera in (F1, close))
    assert theirs(bar(7)) == pytest.approx(ours(bar(7)), abs=0.02)
    errors = [pupil_error(estimate, (32,)) for estimate in (ours, theirs)]
    pupil = errors[0].laid(bar(7), seed=3)
    assert errors[1].psnr(pupil) == pytest.approx(errors[0].psnr(pupil), abs=0.1)


def test_f1_stated_is_f1_bit_for_bit(scenes):
    job = Camera(10_000.0, Stop("circle", 4000.0), (470.0, 610.0, 530.0), 2.0, 128.0)
    stated, ours = surrogate(scenes, dot_nm=8000, camera=PhotoCamera.of(job)), surrogate(scenes)
    assert stated(bar()) == ours(bar())
    np.testing.assert_array_equal(stated.folded, ours.folded)
    assert PhotoCamera.of(job) == F1


def test_every_number_of_a_search_follows_the_camera(scenes):
    unit = bar(6)
    told = []
    for camera in (replace(PHONE, pixel_um=5.0), replace(FAST, pixel_um=3.8)):
        estimate = surrogate(scenes, 6, dot_nm=14_000, camera=PhotoCamera.of(camera))
        limit = bounds(estimate, int(unit.sum()), levels=(32,))
        worth = estimate(unit, levels=(32,))[0]
        error = pupil_error(estimate, (32,))
        assert limit.psnr[0] >= worth
        assert limit.psnr[0] >= interior(estimate).of_unit(unit, levels=(32,))[0]
        area = rings(6, room=estimate.lattice).of_unit(unit)
        assert limit.auc is not None
        assert limit.auc >= area
        told.append((worth, error.psnr(error.laid(unit))[0], limit.psnr[0], area))
    assert all(abs(a - b) > 1e-3 for a, b in zip(*told, strict=True))


def test_rings_that_a_small_stop_leaves_dark_count(scenes):
    around = rings(21, room=lattice(21, 8000, camera=PhotoCamera.of(PHONE)))
    per_cycle = 470 * 5.56 / 8
    assert around.count == int(per_cycle / 2) + 1
    dark = around.ring * 8 > 1000
    assert dark.any()
    assert (around.clear[dark] < 1e-12).all()


def test_between_whole_lags_the_open_stop_is_bilinear_and_f1_rounds():
    room = lattice(21, 8000, camera=PhotoCamera.of(PHONE))
    exact = OpenStop.of(room, 530.0)
    y, x = np.array([10.25, -3.5]) / exact.per_cycle, np.array([2.5, 7.0]) / exact.per_cycle
    v, u = np.array([10, -4]), np.array([2, 7])
    corners = [(0.75, 0.5), (0.5, 1.0)]
    expected = [
        b * (c * exact.at(v, u)[k] + (1 - c) * exact.at(v, u + 1)[k])
        + (1 - b) * (c * exact.at(v + 1, u)[k] + (1 - c) * exact.at(v + 1, u + 1)[k])
        for k, (b, c) in enumerate(corners)
    ]
    np.testing.assert_allclose(exact(y, x) / np.sinc(y) / np.sinc(x), expected, rtol=1e-12)
    whole = OpenStop.of(lattice(21), 530.0)
    lag = np.array([10.3, 10.7])
    expected = whole.at(np.array([10, 11]), np.array([0, 0]))
    seen = lag / whole.per_cycle
    np.testing.assert_array_equal(whole(seen, np.zeros(2)), expected * np.sinc(seen))


@pytest.mark.parametrize(
    ("code", "change"),
    [
        ("MF133", {"stop": Stop.ellipse(4000, 3000)}),
        ("MF133", {"stop": Stop.polygon([(0, 0), (900, 0), (0, 900)])}),
        ("MF134", {"wavelengths_nm": (610.0, 530.0)}),
    ],
)
def test_cameras_that_take_no_photographs_are_refused(code, change):
    with pytest.raises(JobError, match=code) as told:
        PhotoCamera.of(replace(PHONE, **change), where="x.toml", colours=True)
    assert told.value.where.startswith("x.toml: camera.")


@pytest.mark.parametrize(
    ("change", "dot_nm", "told"),
    [
        ({"stop": Stop("circle", 500.0)}, 8000, "62.5 dots"),
        ({"pixel_um": 12.0}, 8000, "a lag of 27"),
        ({"focal_um": 30_000.0}, 8000, "to 2288 dots"),
    ],
)
def test_dots_that_do_not_suit_a_camera_are_refused_with_the_limit(change, dot_nm, told):
    with pytest.raises(JobError, match=f"MF135.*{told}"):
        lattice(21, dot_nm, camera=PhotoCamera.of(replace(PHONE, **change)))


def test_a_panel_whose_axis_is_on_an_edge_is_refused():
    made = panel(50)
    uneven = replace(made, orientations=made.orientations[:, :49])
    with pytest.raises(JobError, match=r"MF122.*one side only"):
        laid_panel("x", uneven, PhotoCamera.of(PHONE))
    assert laid_panel("x", uneven, F1).lattice.cells == 24


def test_an_odd_panel_is_seen_round_its_middle_cell():
    made = panel(9)
    laid = laid_panel("x", made, PhotoCamera.of(PHONE))
    assert laid.lattice.cells == 7
    whole = lay("y", bar(), made.orientations[1:-1, 1:-1], room=laid.lattice)
    np.testing.assert_array_equal(laid.pupil, whole.pupil)


def test_two_models_of_one_layout_agree_behind_a_stop_that_ends_before_half_a_cycle_per_pixel(scenes, monkeypatch):
    """One samples lags of the tiled stop, the other sees every frequency and folds the layout's own."""
    estimate = surrogate(scenes, 12, dot_nm=14_000, camera=PhotoCamera.of(PHONE))
    turned = np.random.default_rng(3).integers(8, size=(6, 6)).astype(np.int8)
    error = pupil_error(estimate)
    monkeypatch.setattr("maskfab.designs.descent.losses.FEW_EPSILONS", EPSILONS)
    sampled = expected_error(estimate, turned, precision="float64")
    found = -float(sampled(torch.from_numpy(bar(12).astype(np.float64))))
    assert found == pytest.approx(np.mean(error.psnr(error.laid(bar(12), turned))), abs=0.2)
