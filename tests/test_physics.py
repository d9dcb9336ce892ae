"""Optics against answers that are known exactly: read these to see what the engine promises."""

from __future__ import annotations

import numpy as np
import pytest
from optics_cases import camera, noise, panel, pupil
from scipy.special import j1

from maskfab.base.model import Opening, Panel, Tiling
from maskfab.job.camera import Camera, Stop
from maskfab.optics.field.matrix import direct_field, parity_field
from maskfab.optics.lags import lag_table
from maskfab.optics.metrics import relative_difference
from maskfab.optics.mtf import frequency_at, presampled_mtf
from maskfab.optics.psf import image_scale_um2, pixel_margin, pixel_psf, point_psf
from maskfab.optics.tiling import orientations

ALL_CLEAR = np.ones((5, 5), dtype=np.bool_)


def airy(diameter_um: float, frequency: np.ndarray) -> np.ndarray:
    """Field of a clear disc, (πD²/4) 2 J1(πDq) / (πDq): Goodman 4.4.2."""
    argument = np.pi * diameter_um * frequency
    with np.errstate(invalid="ignore"):
        return np.pi * diameter_um**2 / 4 * np.where(argument == 0, 1.0, 2 * j1(argument) / argument)


@pytest.mark.parametrize("diameter_um", [4000.0, 100.0])
def test_open_circular_stop_gives_airy(diameter_um: float) -> None:
    setting = camera(diameter_um, window_um=256.0)
    cells = 2 * int(np.ceil(diameter_um / 80))
    found = point_psf(pupil(panel(ALL_CLEAR, dot_nm=8000, cells=cells), setting.stop), setting, 530.0)
    axis = found.step_um * (np.arange(found.values.shape[0]) - found.values.shape[0] // 2)
    radius = np.hypot(axis[:, None], axis) / image_scale_um2(setting, 530.0)
    expected = airy(diameter_um, radius) ** 2 / (image_scale_um2(setting, 530.0) ** 2 * setting.stop.area_um2)
    assert np.linalg.norm(found.values - expected) < 1e-12 * np.linalg.norm(expected)


@pytest.mark.parametrize("gutter_nm", [0, 8000])
def test_square_dots_against_a_direct_sum(gutter_nm: int) -> None:
    """Every dot's own transform, added one by one; the square stop follows the grid, so no dot is cut."""
    laid_out = panel(noise(6, 0.3, 1), dot_nm=4030, gutter_nm=gutter_nm, cells=4, seed=2)
    stop = Stop("square", laid_out.pitch_nm * 4 / 1e3)
    source = pupil(laid_out, stop)
    u = np.linspace(0.0, 0.02, 41)
    x, y = source.x.edges_um(), source.y.edges_um()
    expected = np.zeros((u.size, u.size), dtype=np.complex128)
    for j, i in zip(*np.nonzero(source.whole), strict=True):
        width, height = x[i + 1] - x[i], y[j + 1] - y[j]
        along_x = width * np.sinc(u * width) * np.exp(-2j * np.pi * u * (x[i] + x[i + 1]) / 2)
        along_y = height * np.sinc(u * height) * np.exp(-2j * np.pi * u * (y[j] + y[j + 1]) / 2)
        expected += along_y[:, None] * along_x
    quadrant = parity_field(source, u, u)
    found = quadrant.amplitude()[u.size - 1 :, u.size - 1 :]
    assert np.linalg.norm(found - expected) < 1e-12 * np.linalg.norm(expected)


def test_square_stop_across_dots_is_a_sinc() -> None:
    """A clear square whose sides cut dots: the cut dots' moments must restore the plain sinc."""
    setting = camera(93.7, shape="square")
    source = pupil(panel(ALL_CLEAR, cells=4), setting.stop)
    u = np.linspace(0.0, 0.02, 33)
    side = 93.7
    expected = side**2 * np.sinc(u * side) * np.sinc(u * side)[:, None]
    found = parity_field(source, u, u).amplitude()[u.size - 1 :, u.size - 1 :]
    assert np.linalg.norm(found - expected) < 1e-10 * np.linalg.norm(expected)


def test_open_stop_has_the_diffraction_limited_mtf() -> None:
    """(2/π)(acos s - s sqrt(1 - s²)) x sinc of the pixel, Goodman 6.32, within the table's own error bar."""
    setting = camera(4000.0)
    table = lag_table(pupil(panel(ALL_CLEAR, cells=100), setting.stop))
    mtf = presampled_mtf(table, setting, 530.0)
    nu = mtf.frequency_cy_per_mm / 1e3
    s = nu * image_scale_um2(setting, 530.0) / 4000.0
    limit = 2 / np.pi * (np.arccos(s) - s * np.sqrt(1 - s**2)) * np.sinc(nu * 2.0)
    error = abs(mtf.cuts["horizontal"] - limit).max()
    assert error < mtf.uncertainty < 2e-3
    exact = table.otf(nu * image_scale_um2(setting, 530.0), 0 * nu) * np.sinc(nu * 2.0)
    assert abs(exact - limit).max() < table.uncertainty < 1e-11


def test_long_slits_put_the_orders_at_lambda_f_over_pitch() -> None:
    """A grating of vertical slits has its orders at whole multiples of λf/T and nothing in between."""
    mask = np.zeros((21, 21), dtype=np.bool_)
    mask[:, 8:13] = True
    setting = camera(4000.0, shape="square", window_um=256.0)
    found = point_psf(pupil(panel(mask, cells=24), setting.stop), setting, 530.0)
    middle = found.values.shape[0] // 2
    row = found.values[middle] / found.values[middle, middle]
    order_um = image_scale_um2(setting, 530.0) / 168.0
    position = found.step_um * (np.arange(row.size) - middle)
    first = row[np.argmin(abs(position - order_um))]
    expected = (np.sinc(5 * 8 / 168) / 1.0) ** 2
    assert first == pytest.approx(expected, rel=0.05)
    between = row[np.argmin(abs(position - order_um / 2))]
    assert between < 1e-2 * first


def test_pixel_psf_is_the_mean_of_the_point_psf() -> None:
    """Pixels by filtered samples against a brute mean of 41 x 41 points in each of some pixels."""
    setting = camera(1000.0, window_um=32.0)
    source = pupil(panel(noise(7, 0.4, 5), cells=20, seed=3), setting.stop)
    found = pixel_psf(point_psf(source, setting, 530.0, pixel_margin(setting)), setting)
    scale = image_scale_um2(setting, 530.0)
    nodes, weights = np.polynomial.legendre.leggauss(41)
    for pixel in (0, 3, 7):
        u, v = (pixel * 2.0 + nodes) / scale, nodes / scale
        power = abs(direct_field(source, u, v)) ** 2
        mean = (weights / 2) @ power @ (weights / 2) / (scale**2 * source.energy_um2)
        middle = found.values.shape[0] // 2
        assert found.values[middle, middle + pixel] == pytest.approx(mean, rel=1e-6)


def test_all_energy_is_found_when_the_window_is_wide() -> None:
    """The clear stop's PSF is narrow: 128 µm hold all but the far rings, whose energy is 2λf/(π² D r)."""
    setting = camera(4000.0, window_um=128.0)
    around = point_psf(pupil(panel(ALL_CLEAR, cells=100), setting.stop), setting, 530.0, pixel_margin(setting))
    found = pixel_psf(around, setting)
    missing = 1 - found.energy_in_window
    ring = 2 * image_scale_um2(setting, 530.0) / (np.pi**2 * 4000.0 * 63.0)
    assert missing == pytest.approx(ring, rel=0.2)


def test_wavelength_only_scales_the_psf() -> None:
    mask = noise(7, 0.4, 9)
    wide, narrow = (Camera(10_000.0, Stop("circle", 400.0), (w,), p, 64 * p) for w, p in ((400.0, 2.0), (600.0, 3.0)))
    source = pupil(panel(mask, cells=8, seed=1), wide.stop)
    first, second = point_psf(source, wide, 400.0), point_psf(source, narrow, 600.0)
    assert second.step_um == pytest.approx(1.5 * first.step_um)
    np.testing.assert_allclose(second.values * 1.5**2, first.values, rtol=1e-9, atol=1e-15)


def test_mtf50_lies_where_the_curve_crosses() -> None:
    setting = camera(400.0)
    mtf = presampled_mtf(lag_table(pupil(panel(ALL_CLEAR, cells=12), setting.stop)), setting, 530.0)
    found = frequency_at(mtf, 0.5)
    assert found is not None
    falls = mtf.falls
    assert np.interp(found[0], falls.frequency_cy_per_mm, falls.modulation) == pytest.approx(0.5, abs=1e-12)
    assert frequency_at(mtf, -1.0) is None


def test_a_random_layout_scatters_about_the_closed_form_mean() -> None:
    """E|A|² = |mean M|² |S|² + n (mean |M|² - |mean M|²) over random D4 tilings: eq. 8 of the paper, in 2-D."""
    mask = noise(5, 0.4, 4)
    setting = camera(8 * 5 * 8.0, shape="square", window_um=64.0)
    psfs = []
    for seed in range(60):
        laid_out = Panel(
            Opening("case", mask, 8000), 8000, 0, orientations(Tiling.RANDOM, 8, 8, seed), Tiling.RANDOM, seed
        )
        psfs.append(point_psf(pupil(laid_out, setting.stop), setting, 530.0).values)
    scale = image_scale_um2(setting, 530.0)
    n = psfs[0].shape[0]
    axis = (
        point_psf(pupil(panel(mask, cells=8), setting.stop), setting, 530.0).step_um * (np.arange(n) - n // 2) / scale
    )
    cells = [
        direct_field(pupil(Panel(Opening("u", mask, 8000), 8000, 0, np.full((1, 1), k), Tiling.PERIODIC, None),
                           Stop("square", 40.0)), axis, axis)
        for k in range(8)
    ]  # fmt: skip
    mean, power = np.mean(cells, axis=0), np.mean(np.abs(cells) ** 2, axis=0)
    comb = np.exp(-2j * np.pi * axis[:, None] * 40.0 * (np.arange(8) - 3.5)).sum(axis=1)
    lattice = abs(comb[:, None] * comb) ** 2
    clear = mask.sum() * 64 * 64.0
    expected = (abs(mean) ** 2 * lattice + 64 * (power - abs(mean) ** 2)) / (scale**2 * clear)
    error = np.linalg.norm(np.mean(psfs, axis=0) - expected) / np.linalg.norm(expected)
    single = np.linalg.norm(psfs[0] - expected) / np.linalg.norm(expected)
    assert error < 0.25 * single


def test_relative_difference_is_zero_only_for_equal_psfs() -> None:
    setting = camera(200.0, window_um=32.0)
    one = point_psf(pupil(panel(ALL_CLEAR, cells=8), setting.stop), setting, 530.0)
    other = point_psf(pupil(panel(noise(5, 0.5, 1), cells=8), setting.stop), setting, 530.0)
    assert relative_difference(one, one) == 0
    assert relative_difference(other, one) > 0.1
