"""What a die and an analysis report of their optics: every number once, in its place, in agreement with the others."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

from maskfab.base.model import Opening, Panel, Psf, Quantity, Tiling
from maskfab.findings.analysis import Request, analyse_opening
from maskfab.job.camera import Camera, Stop
from maskfab.mask.raster import read_aperture
from maskfab.optics import metrics
from maskfab.optics.energy import order_efficiencies, streak_index
from maskfab.optics.exact_psf import ExactPsf
from maskfab.optics.lags import axis_lags, lag_table
from maskfab.optics.mtf import aliased_mtf, longest_lag_um, presampled_mtf
from maskfab.optics.pupil import Lattice, cut, panel_aperture
from maskfab.optics.spectrum import Spectrum, pixel_transfer, polychromatic_otf

CAMERA = Camera(5000.0, Stop("circle", 400.0), (610.0, 530.0, 470.0), 2.0, 128.0)
TWO = dataclasses.replace(CAMERA, wavelengths_nm=(610.0, 530.0), window_um=32.0)
RING = np.array([[0, 1, 1, 0, 1], [1, 1, 0, 0, 1], [1, 0, 0, 1, 1], [0, 0, 1, 1, 0], [0, 0, 0, 0, 0]], dtype=bool)
OPENING = Opening("ring", RING, 8000)

EACH_LINE = {
    "auc_radial_min", "mtf50", "mtf30", "mtf10", "mtf50_per_pixel", "mtf30_per_pixel", "mtf10_per_pixel",
    "psf_energy_in_window", "peak_strehl", "strehl_invariant_error", "readback_psf_difference", "mtf_aliasing",
    "mtf_phase_range", "wiener_worst30", "wiener_noise_gain", "ensquared_energy", "halo_energy", "first_side_lobe",
    "streak_index", "energy_normalised_strehl",
}  # fmt: skip
ORDERS = {
    "order_zero_incident", "order_zero_transmitted", "orders_lowest_five_incident", "orders_lowest_five_transmitted",
}  # fmt: skip


def analysed(camera: Camera = CAMERA, **request) -> tuple[Quantity, ...]:
    return analyse_opening(OPENING, Request(camera=camera, **request)).quantities


@pytest.fixture(scope="module")
def periodic() -> tuple[Quantity, ...]:
    return analysed()


def at(quantities: tuple[Quantity, ...], name: str, line: float | None = None) -> Quantity:
    (found,) = (q for q in quantities if q.name == name and q.wavelength_nm == line)
    return found


def test_every_number_is_there_once_with_unit_method_and_words(periodic):
    places = [(q.name, q.wavelength_nm) for q in periodic]
    assert len(set(places)) == len(places)
    for line in CAMERA.wavelengths_nm:
        of_line = {name for name, where in places if where == line}
        assert of_line == EACH_LINE | ({"peak_to_side_lobe"} if line == CAMERA.middle_nm else set())
    of_all = {name for name, where in places if where is None}
    assert of_all >= ORDERS | {"colour_distance", "edge_colour_difference"}
    for quantity in periodic:
        assert quantity.method
        assert quantity.unit
        assert quantity.uncertainty is None or 0 <= quantity.uncertainty < math.inf, quantity


@pytest.fixture(scope="module")
def shuffled() -> tuple[Quantity, ...]:
    """Of a random tiling, its lines in no order."""
    camera = dataclasses.replace(CAMERA, wavelengths_nm=(470.0, 610.0, 530.0), window_um=32.0)
    return analysed(camera, tiling=Tiling.RANDOM, seed=1)


@pytest.fixture(scope="module")
def two_colours() -> tuple[Quantity, ...]:
    return analysed(TWO)


def test_the_middle_line_is_the_median_in_any_order(shuffled):
    (told,) = (q for q in shuffled if q.name == "peak_to_side_lobe")
    assert told.wavelength_nm == CAMERA.middle_nm == 530.0


def test_a_random_tiling_has_no_orders_and_two_colours_no_difference(shuffled, two_colours):
    names = {q.name for q in shuffled}
    assert not names & ORDERS
    assert "colour_distance" in names
    assert not {q.name for q in two_colours} & {"colour_distance", "edge_colour_difference"}


def test_equal_runs_give_equal_numbers(two_colours):
    assert analysed(TWO) == two_colours


def test_cycles_per_pixel_are_cycles_per_millimetre_times_the_pixel(periodic):
    for line in CAMERA.wavelengths_nm:
        for level in (50, 30, 10):
            on_sensor, per_pixel = (at(periodic, f"mtf{level}{end}", line) for end in ("", "_per_pixel"))
            assert per_pixel.value == pytest.approx(on_sensor.value * 2e-3)
            assert per_pixel.uncertainty == pytest.approx(on_sensor.uncertainty * 2e-3)
            assert per_pixel.unit == "cy/pixel"


def test_numbers_that_physics_ties_together_agree(periodic):
    ratio = at(periodic, "stop_open_ratio").value
    total = order_efficiencies(_panel(), 1)
    five = total[1, 1] + total[0, 1] + total[2, 1] + total[1, 0] + total[1, 2]
    assert at(periodic, "orders_lowest_five_incident").value == pytest.approx(five)
    for line in CAMERA.wavelengths_nm:
        assert at(periodic, "energy_normalised_strehl", line).value == pytest.approx(ratio, rel=1e-6)
        core, halo = at(periodic, "ensquared_energy", line).value, at(periodic, "halo_energy", line).value
        assert 0 < core < 1 - halo < at(periodic, "psf_energy_in_window", line).value <= 1
        assert 0 <= at(periodic, "wiener_worst30", line).value <= 1
        assert at(periodic, "wiener_noise_gain", line).value <= 0.5 / math.sqrt(metrics.NOISE_TO_SIGNAL)
        assert 1 <= at(periodic, "streak_index", line).value <= 19


@pytest.mark.parametrize("gutter_um", [0.0, 3.0])
@pytest.mark.parametrize("shape", ["circle", "square"])
def test_aliasing_along_an_axis_needs_only_lags_along_it(gutter_um, shape):
    """Against the aliased MTF from the lags of the whole plane."""
    camera = dataclasses.replace(CAMERA, stop=Stop(shape, 400.0))
    pupil = cut(panel_aperture(_panel(gutter_um, mask=RING[:, ::-1])), camera.stop)
    table, whole = lag_table(pupil, longest_lag_um(camera)), lag_table(pupil, camera.stop.diameter_um)
    mtf = presampled_mtf(table, camera, 470.0)
    found = metrics.aliased_cuts(axis_lags(pupil, table.energy_um2), table, mtf, camera)
    line = Spectrum(np.array([470.0]), np.ones(1), "line")
    nu_x, nu_y = found.frequency_cy_per_mm * 1e-3
    expected = aliased_mtf(whole, camera, line, nu_x, nu_y)
    np.testing.assert_allclose(found.values, expected.values, atol=1e-9)
    np.testing.assert_array_equal(found.phases, expected.phases)
    presampled = abs(polychromatic_otf(table, camera, line, nu_x, nu_y)) * pixel_transfer(camera, nu_x, nu_y)
    spread, swing = metrics.aliasing_quantities(axis_lags(pupil, table.energy_um2), table, mtf, camera, "d")
    assert spread.value == pytest.approx(abs(expected.values - presampled).max(), abs=1e-9)
    assert swing.value == pytest.approx((expected.highest - expected.lowest).max(), abs=1e-9)
    assert spread.value <= swing.value + 1e-9 <= 2 * spread.value + 2e-9
    assert {q.method.split(":")[0].split(",")[0] for q in (spread, swing)} == {"aliased"}
    assert {(q.die, q.wavelength_nm) for q in (spread, swing)} == {("d", 470.0)}


def _exact(psf: Psf) -> ExactPsf:
    """Dark between its samples, for numbers that ask for those alone."""
    return ExactPsf(psf, lambda x, y: np.zeros((y.size, x.size)), 1.0, 0.1, 0.0, True)


def test_streaks_of_the_middle_part_are_those_of_the_whole():
    axis = 0.5 * np.arange(-100, 101)
    values = np.sinc(axis / 3)[:, None] ** 2 * np.sinc(axis / 4) ** 2
    psf = Psf(values, 0.5, 530.0, "point")
    _, _, streaks, _ = metrics.shape_quantities(_exact(psf), _pixels(psf), CAMERA, None)
    assert streaks == streak_index(psf, 10.0, 50.0)


def test_a_small_window_shrinks_radii_and_a_dark_annulus_is_none():
    values = np.zeros((9, 9))
    values[4, 4] = 4.0
    psf = Psf(values, 0.5, 530.0, "point")
    core, halo, streaks, _ = metrics.shape_quantities(_exact(psf), _pixels(psf), CAMERA, None)
    assert core.symbol == "SE(6 um)"
    assert halo.symbol == "1 - EE(3 um)"
    assert streaks.value is None
    assert "no light" in streaks.method


def test_colours_are_told_by_wavelength_whatever_their_order():
    axis = 2.0 * np.arange(-20, 21)
    psfs = []
    for line in (470.0, 610.0, 530.0):
        values = np.sinc(axis / (line / 50))[:, None] ** 2 * np.sinc(axis / (line / 50)) ** 2
        psfs.append(Psf(values / values.sum() / 4, 2.0, line, "pixel"))
    assert metrics.colour_quantities(psfs, None) == metrics.colour_quantities(sorted(psfs, key=_nm), None)
    distance, edge = metrics.colour_quantities(psfs, None)
    assert 0 < distance.value < 1
    assert edge.value > 0
    grey = [dataclasses.replace(psfs[0], wavelength_nm=psf.wavelength_nm) for psf in psfs]
    same, none = metrics.colour_quantities(grey, None)
    assert same.value == pytest.approx(0, abs=1e-15)
    assert none.value == pytest.approx(0, abs=1e-9)


def test_a_fringe_is_told_only_where_its_bar_leaves_it_a_meaning():
    """The same colours, all of their light in the window or a fifth of it outside."""
    axis = 2.0 * np.arange(-20, 21)
    waves = [np.exp(-(axis**2)[:, None] / width**2 - axis**2 / width**2) for width in (8.0, 8.4, 8.8)]
    for share, told in ((1.0, True), (0.8, False)):
        psfs = [
            Psf(share * values / values.sum() / 4, 2.0, line, "pixel")
            for values, line in zip(waves, (470.0, 530.0, 610.0), strict=True)
        ]
        distance, edge = metrics.colour_quantities(psfs, None)
        for each in (distance, edge):
            assert (each.value is not None) == told
            assert ("not told" in each.method) != told
            if told:
                assert each.uncertainty < 0.15 * each.value


def test_binary_coverage_varies_nowhere_and_partial_coverage_does():
    lattice = Lattice(-8.0, 2, 1, 8.0, 8.0)
    binary = read_aperture(lattice, lattice, np.eye(2))
    assert not any(binary.variance.strides)
    assert not binary.variance.any()
    partial = read_aperture(lattice, lattice, np.eye(2) / 2)
    np.testing.assert_array_equal(partial.variance, np.eye(2) / 4)


def _nm(psf: Psf) -> float:
    return psf.wavelength_nm


def _pixels(psf: Psf) -> Psf:
    """Something like pixel means of four points a side."""
    middle = psf.values.shape[0] // 2
    kept = 4 * (middle // 4)
    part = psf.values[middle - kept : middle + kept + 1 : 4, middle - kept : middle + kept + 1 : 4]
    return Psf(part, 4 * psf.step_um, psf.wavelength_nm, "pixel")


def _panel(gutter_um: float = 0.0, mask: np.ndarray = RING) -> Panel:
    """A panel over the stop of 400 um."""
    cells = 12
    orientations = np.zeros((cells, cells), dtype=np.int8)
    return Panel(Opening("ring", mask, 8000), 8000, int(gutter_um * 2000), orientations, Tiling.PERIODIC, None)
