"""The contract: what the optics promise, against answers that are known exactly, for several lenses and lines."""

from __future__ import annotations

import math
from dataclasses import replace

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
from maskfab.optics.pupil import Pupil
from maskfab.optics.tiling import orientations

ALL_CLEAR = np.ones((5, 5), dtype=np.bool_)
PRECISION = 1e-12
"""Relative L2 error of a field, and absolute error of an OTF, that is rounding alone."""
LENSES = tuple(
    Camera(focal_um, Stop("square", side_um), (line_nm,), 2.0, 128.0)
    for focal_um, side_um, line_nm in ((10_000.0, 4000.0, 530.0), (4_500.0, 937.3, 470.0), (25_000.0, 100.0, 610.0))
)
lenses = pytest.mark.parametrize("lens", LENSES, ids=lambda lens: f"{lens.focal_um:g}-{lens.stop.diameter_um:g}")


def agree(found: np.ndarray, expected: np.ndarray) -> None:
    assert np.linalg.norm(found - expected) < PRECISION * np.linalg.norm(expected)


def round_stop(lens: Camera) -> Camera:
    return replace(lens, stop=Stop("circle", lens.stop.diameter_um))


def open_pupil(lens: Camera) -> Pupil:
    """No mask before the stop, on dots of 8 um."""
    return pupil(panel(ALL_CLEAR, cells=2 * math.ceil(lens.stop.diameter_um / 80)), lens.stop)


def airy(diameter_um: float, frequency: np.ndarray) -> np.ndarray:
    """Field of a clear disc, (πD²/4) 2 J1(πDq) / (πDq): Goodman 4.4.2."""
    argument = np.pi * diameter_um * frequency
    with np.errstate(invalid="ignore"):
        return np.pi * diameter_um**2 / 4 * np.where(argument == 0, 1.0, 2 * j1(argument) / argument)


@lenses
def test_airy(lens: Camera) -> None:
    """Goodman 4.4.2: (πD²/4 / λf)² (2 J1(x) / x)², x = πDr / λf."""
    wide = round_stop(lens)
    scale = image_scale_um2(wide, wide.middle_nm)
    found = point_psf(open_pupil(wide), wide, wide.middle_nm)
    axis = found.step_um * (np.arange(len(found.values)) - len(found.values) // 2)
    expected = airy(wide.stop.diameter_um, np.hypot(axis[:, None], axis) / scale) ** 2 / (scale**2 * wide.stop.area_um2)
    agree(found.values, expected)


@lenses
def test_slit(lens: Camera) -> None:
    """A square stop, whose sides cut dots: the product of two sinc."""
    found = point_psf(open_pupil(lens), lens, lens.middle_nm)
    side, scale = lens.stop.diameter_um, image_scale_um2(lens, lens.middle_nm)
    axis = found.step_um * (np.arange(len(found.values)) - len(found.values) // 2)
    along = (side * np.sinc(side * axis / scale)) ** 2
    agree(found.values, along * along[:, None] / (scale * side) ** 2)


def test_grating() -> None:
    """Slits of 2 in 5 dots: the slit's sinc, times sin(πNTq) / sin(πTq) of N slits T apart."""
    mask, cells, pitch = np.zeros((5, 5), dtype=np.bool_), 8, 40.0
    mask[:, 1:3] = True
    u = np.linspace(1e-5, 0.05, 64)
    found = direct_field(pupil(panel(mask, cells=cells), Stop("square", cells * pitch)), u, u)
    slits = np.exp(-2j * np.pi * u[:, None] * (pitch * (np.arange(cells) - cells / 2) + 16.0)).sum(axis=1)
    up = cells * pitch * np.sinc(cells * pitch * u)
    agree(found, up[:, None] * (16.0 * np.sinc(16.0 * u) * slits))


@lenses
def test_babinet(lens: Camera) -> None:
    """A mask and its complement add up to the open stop."""
    mask, stop = noise(5, 0.4, 3), round_stop(lens).stop
    u = np.linspace(0.0, 0.03, 21)
    cells = 2 * math.ceil(stop.diameter_um / 80)
    one, other, whole = (direct_field(pupil(panel(m, cells=cells), stop), u, u) for m in (mask, ~mask, mask | True))
    agree(one + other, whole)


def test_parseval() -> None:
    """All light of a band-limited PSF, summed over samples finer than its Nyquist's, is the clear area's."""
    mask = noise(5, 0.4, 4)
    source = pupil(panel(mask, cells=8, seed=1), Stop("square", 8 * 40.0))
    n, dot = source.whole.shape[0], 8.0
    u = np.arange(2 * n) / (2 * n * dot)
    # Frequencies repeat after 1 / dot but for the dot's own factor, whose squares over all repeats add up to 1.
    power = abs(direct_field(source, u, u) / (np.sinc(u * dot) * np.sinc(u * dot)[:, None])) ** 2
    assert power.mean() * (1 / dot) ** 2 == pytest.approx(source.energy_um2, rel=PRECISION)


def test_autocorrelation() -> None:
    """The OTF at a lag of whole dots is the share of clear dots that meet clear ones there."""
    mask = noise(5, 0.4, 6)
    source = pupil(panel(mask, cells=6, seed=2), Stop("square", 6 * 40.0))
    dots, table = source.whole, lag_table(source)
    for y, x in ((0, 1), (3, 0), (4, 7), (11, 2)):
        shared = (dots[y:, x:] * dots[: len(dots) - y, : len(dots) - x]).sum() / (dots**2).sum()
        assert table.otf(np.array([8.0 * x]), np.array([8.0 * y]))[0] == pytest.approx(shared, abs=PRECISION)


@lenses
def test_diffraction_limit(lens: Camera) -> None:
    """(2/π)(acos s - s sqrt(1 - s²)) x sinc of the pixel, Goodman 6.32, within the table's own error bar."""
    wide = round_stop(lens)
    table = lag_table(open_pupil(wide))
    mtf = presampled_mtf(table, wide, wide.middle_nm)
    nu = mtf.frequency_cy_per_mm / 1e3
    lag = nu * image_scale_um2(wide, wide.middle_nm)
    s = np.minimum(lag / wide.stop.diameter_um, 1.0)
    limit = 2 / np.pi * (np.arccos(s) - s * np.sqrt(1 - s**2)) * np.sinc(nu * wide.pixel_um)
    assert abs(mtf.cuts["horizontal"] - limit).max() <= mtf.uncertainty
    assert abs(table.otf(lag, 0 * lag) * np.sinc(nu * wide.pixel_um) - limit).max() <= table.uncertainty + PRECISION


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
