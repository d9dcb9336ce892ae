"""Numbers of a PSF's shape against Airy's pattern, gratings, and shapes that are round or grey by construction."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from numpy.polynomial.legendre import leggauss
from optics_cases import camera, noise, panel, pupil
from scipy.special import j0, j1

from maskfab.base.errors import InternalError, JobError
from maskfab.base.model import Panel, Psf
from maskfab.job.camera import Camera, Stop
from maskfab.optics.colour import delta_e_1976, lab_of_linear_srgb
from maskfab.optics.energy import (
    colour_distance,
    energy_normalised_strehl,
    ensquared_energy,
    order_efficiencies,
    order_quantities,
    streak_index,
)
from maskfab.optics.exact_psf import ExactPsf
from maskfab.optics.field.matrix import direct_field
from maskfab.optics.metrics import energy_in_window
from maskfab.optics.mtf import edge_colour_difference, edge_in_window
from maskfab.optics.psf import cutoff, image_scale_um2, pixel_margin, pixel_psf, point_psf
from maskfab.optics.pupil import Pupil

DIAMETER, SCALE = 4000.0, 5300.0
HIGHEST = DIAMETER / SCALE


def airy(step: float, half: int) -> Psf:
    """π D²/4 / (λf)² (2 J1(a)/a)², a = πDr/(λf)."""
    axis = step * np.arange(-half, half + 1)
    argument = np.pi * HIGHEST * np.hypot(axis[:, None], axis)
    with np.errstate(invalid="ignore"):
        field = np.where(argument == 0, 1.0, 2 * j1(argument) / argument)
    return Psf(np.pi / 4 * HIGHEST**2 * field**2, step, 530.0, "point")


def sinc_squared(step: float, half: int) -> Psf:
    """PSF of a clear square stop: (D/λf sinc²(Dx/λf)) along each axis."""
    along = HIGHEST * np.sinc(HIGHEST * step * np.arange(-half, half + 1)) ** 2
    return Psf(along[:, None] * along, step, 530.0, "point")


def gaussian(sigma_x: float, sigma_y: float, step: float = 1.0, half: int = 60) -> Psf:
    axis = step * np.arange(-half, half + 1)
    along = [np.exp(-(axis**2) / (2 * s**2)) / (s * np.sqrt(2 * np.pi)) for s in (sigma_y, sigma_x)]
    return Psf(along[0][:, None] * along[1], step, 530.0, "pixel")


def test_whole_pixels_add_up_exactly() -> None:
    setting = camera(4000.0, window_um=64.0)
    source = pupil(panel(np.ones((5, 5), dtype=np.bool_), cells=100), setting.stop)
    points = point_psf(source, setting, 530.0, pixel_margin(setting))
    pixels = pixel_psf(points, setting)
    for count in (1, 5, 9):
        counted = ensquared_energy(pixels, 2.0 * count, HIGHEST)
        assert counted.uncertainty < 5e-9
        middle = pixels.values.shape[0] // 2
        part = slice(middle - count // 2, middle + count // 2 + 1)
        assert counted.value == pytest.approx(pixels.values[part, part].sum() * 4.0, rel=1e-14)
        assert abs(energy_in_square(source, setting, 2.0 * count) - counted.value) <= counted.uncertainty
    half = ensquared_energy(pixels, 7.0, HIGHEST)
    assert half.uncertainty > 1e-6


def energy_in_square(source: Pupil, setting: Camera, side_um: float) -> float:
    """∫∫ |F|² / ((λf)² E) over a square by Gauss-Legendre nodes, enough for the PSF's highest frequency."""
    scale = image_scale_um2(setting, 530.0)
    nodes, weights = leggauss(40 + int(2 * cutoff(setting, 530.0) * side_um))
    field = direct_field(source, side_um / 2 * nodes / scale, side_um / 2 * nodes / scale)
    return float(weights @ abs(field) ** 2 @ weights * (side_um / 2 / scale) ** 2 / source.energy_um2)


@pytest.mark.parametrize(
    ("diameter_um", "pixel_um", "window_um"), [(120.0, 1.0, 129.0), (400.0, 2.0, 70.0), (700.0, 10.0, 50.0)]
)
def test_pixels_sum_to_the_energy_of_their_squares_within_their_bar(
    diameter_um: float, pixel_um: float, window_um: float
) -> None:
    setting = replace(camera(diameter_um, window_um=window_um), pixel_um=pixel_um)
    source = pupil(panel(noise(5, 0.4, 8), cells=math.ceil(diameter_um / 40), seed=2), setting.stop)
    pixels = pixel_psf(point_psf(source, setting, 530.0, pixel_margin(setting)), setting)
    count = pixels.values.shape[0]
    whole = energy_in_window(pixels, setting, 0.0, None)
    assert abs(whole.value - energy_in_square(source, setting, count * pixel_um)) < whole.uncertainty < 1e-8
    for odd in (1, 3, count):
        found = ensquared_energy(pixels, odd * pixel_um, cutoff(setting, 530.0))
        assert abs(found.value - energy_in_square(source, setting, odd * pixel_um)) < found.uncertainty < 1e-8


def test_one_pixel_of_hundreds_of_steps_fills_a_window() -> None:
    setting = replace(camera(2000.0, window_um=256.0), pixel_um=250.0)
    source = pupil(panel(noise(5, 0.4, 8), cells=52, seed=2), setting.stop)
    pixels = pixel_psf(point_psf(source, setting, 530.0, pixel_margin(setting)), setting)
    assert pixels.values.shape == (1, 1)
    whole = energy_in_window(pixels, setting, 0.0, None)
    assert abs(whole.value - energy_in_square(source, setting, 250.0)) < whole.uncertainty < 1e-7


def test_orders_of_slits_are_sinc_squared() -> None:
    """Slits of width w at pitch T: η_m0 = (w/T)² sinc²(m w/T), and nothing for n other than 0."""
    mask = np.zeros((21, 21), dtype=np.bool_)
    mask[:, 8:13] = True
    found = order_efficiencies(panel(mask), 7)
    expected = (5 / 21) ** 2 * np.sinc(np.arange(-7, 8) * 5 / 21) ** 2
    np.testing.assert_allclose(found[7], expected, atol=1e-15)
    np.testing.assert_allclose(np.delete(found, 7, axis=0), 0, atol=1e-15)


@pytest.mark.parametrize("gutter_nm", [0, 8000])
def test_orders_add_up_to_the_open_ratio(gutter_nm: int) -> None:
    """Parseval; the orders beyond |m| fall off as 1/m²."""
    laid_out = panel(noise(5, 0.4, 1), gutter_nm=gutter_nm)
    sums = [order_efficiencies(laid_out, h).sum() for h in (100, 200)]
    assert sums[0] < sums[1] < laid_out.open_ratio
    assert 2 * sums[1] - sums[0] == pytest.approx(laid_out.open_ratio, rel=2e-3)


def test_order_quantities() -> None:
    laid_out = panel(noise(5, 0.4, 1), gutter_nm=2000)
    found = {q.name: q.value for q in order_quantities(laid_out, "d")}
    assert found["order_zero_incident"] == pytest.approx(laid_out.open_ratio**2)
    assert found["order_zero_transmitted"] == pytest.approx(laid_out.open_ratio)
    share = order_efficiencies(laid_out, 1)
    five = share[1].sum() + share[:, 1].sum() - share[1, 1]
    assert found["orders_lowest_five_incident"] == pytest.approx(five)
    assert found["orders_lowest_five_transmitted"] == pytest.approx(five / laid_out.open_ratio)


def test_orders_turn_with_the_cells_and_belong_to_periodic_panels() -> None:
    laid_out = panel(noise(5, 0.4, 1))
    turned = replace(laid_out, orientations=np.ones_like(laid_out.orientations))
    plain = order_efficiencies(laid_out, 3)
    np.testing.assert_allclose(order_efficiencies(turned, 3), np.rot90(plain, -1), atol=1e-15)
    np.testing.assert_allclose(order_efficiencies(laid_out, 0), plain[3:4, 3:4], atol=1e-15)
    with pytest.raises(InternalError, match="MF901"):
        order_efficiencies(panel(noise(5, 0.4, 1), seed=1), 1)
    with pytest.raises(JobError, match="MF104"):
        order_efficiencies(laid_out, -1)


def test_orders_are_the_peaks_of_the_psf() -> None:
    """N x N cells: intensity at order (m, n) is η_mn (N T)⁴ / ((λf)² E)."""
    laid_out: Panel = panel(noise(5, 0.4, 1), gutter_nm=2000, cells=6)
    pitch = laid_out.pitch_nm / 1e3
    scale = 5300.0
    setting = replace(camera(6 * pitch, shape="square"), pixel_um=scale / pitch, window_um=5.1 * scale / pitch)
    psf = point_psf(pupil(laid_out, Stop("square", 6 * pitch)), setting, 530.0)
    stride, middle = round(scale / pitch / psf.step_um), psf.values.shape[0] // 2
    peaks = psf.values[middle % stride :: stride, middle % stride :: stride]
    found = peaks * scale**2 * laid_out.open_ratio * (6 * pitch) ** 2 / (6 * pitch) ** 4
    reach = peaks.shape[0] // 2
    np.testing.assert_allclose(found, order_efficiencies(laid_out, reach), atol=1e-9)


@pytest.mark.parametrize(("inner", "outer"), [(10.0, 20.0), (20.0, 100.0), (3.0, 60.0)])
def test_streak_index_of_a_round_psf_is_1(inner: float, outer: float) -> None:
    found = streak_index(airy(0.5, 220), inner, outer)
    assert found.value == pytest.approx(1.0, abs=max(found.uncertainty, 1e-6))
    assert found.uncertainty < 1e-2
    assert f"{inner:g} um to {outer:g} um" in found.method.replace(" and ", " to ")


@pytest.mark.parametrize("angle", [0.0, 0.3, np.pi / 4, 2.0])
def test_streak_index_of_one_line_is_19(angle: float) -> None:
    axis = np.arange(-200.0, 201.0)
    x, y = np.meshgrid(axis, axis)
    across = -x * np.sin(angle) + y * np.cos(angle)
    found = streak_index(Psf(np.exp(-(across**2) / 4), 1.0, 530.0, "point"), 100.0, 200.0)
    assert found.value == pytest.approx(19.0, rel=0.02)


def test_streak_index_of_a_square_stop_is_that_of_two_lines_at_most() -> None:
    found = streak_index(sinc_squared(0.5, 250), 20.0, 100.0)
    assert 5.0 < found.value <= 10.0


def test_streak_index_does_not_turn_with_the_psf() -> None:
    source = pupil(panel(noise(7, 0.4, 3), cells=10), Stop("circle", 480.0))
    psf = point_psf(source, camera(480.0, window_um=200.0), 530.0)
    turned = replace(psf, values=np.rot90(psf.values).copy())
    assert streak_index(turned, 30.0, 90.0).value == pytest.approx(streak_index(psf, 30.0, 90.0).value, rel=1e-9)


@pytest.mark.parametrize(("inner", "outer"), [(5.0, 5.0), (-1.0, 5.0), (5.0, 1e3), (1.0, float("nan"))])
def test_impossible_annuli(inner: float, outer: float) -> None:
    with pytest.raises(JobError, match="MF104"):
        streak_index(airy(0.5, 50), inner, outer)


def test_dark_annulus() -> None:
    dark = np.zeros((21, 21))
    dark[10, 10] = 1.0
    with pytest.raises(JobError, match="no light"):
        streak_index(Psf(dark, 1.0, 530.0, "point"), 3.0, 9.0)


@pytest.mark.parametrize("share", [0.1, 0.5, 0.9])
def test_energy_normalised_strehl_is_the_open_ratio(share: float) -> None:
    mask = noise(7, share, 3)
    setting = camera(8.0 * 7 * 8, shape="square", window_um=16.0)
    psf = point_psf(pupil(panel(mask, cells=8, seed=1), setting.stop), setting, 530.0)
    found = energy_normalised_strehl(psf, setting)
    assert found.value == pytest.approx(mask.mean(), rel=1e-9)
    assert "open ratio fixes it" in found.method
    with pytest.raises(InternalError, match="MF901"):
        energy_normalised_strehl(gaussian(2, 2), setting)


def test_white_black_and_grey_have_no_colour() -> None:
    grey = np.repeat(np.array([0.0, 1e-4, 0.18, 1.0])[:, None], 3, axis=1)
    found = lab_of_linear_srgb(grey)
    np.testing.assert_allclose(found[:, 1:], 0, atol=1e-12)
    np.testing.assert_allclose(found[[0, 3], 0], [0.0, 100.0], atol=1e-12)
    assert found[2, 0] == pytest.approx(49.496, abs=1e-3)


def test_lab_of_the_primaries() -> None:
    """L*a*b* of pure sRGB red, green and blue under D65."""
    found = lab_of_linear_srgb(np.eye(3))
    expected = [[53.24, 80.09, 67.20], [87.73, -86.18, 83.18], [32.30, 79.19, -107.86]]
    np.testing.assert_allclose(found, expected, atol=0.06)
    assert delta_e_1976(found[0], found[0]) == 0


def test_equal_psfs_have_no_fringe() -> None:
    psf = gaussian(4.0, 5.0)
    assert colour_distance(psf, psf).value == 0
    assert edge_colour_difference(*3 * [edge_in_window(psf)]).value == pytest.approx(0.0, abs=1e-10)


def test_colour_distance_of_disjoint_psfs_is_1() -> None:
    first, second = np.zeros((9, 9)), np.zeros((9, 9))
    first[4, 4], second[4, 3], second[4, 5] = 0.25, 0.125, 0.125
    psfs: list[Psf] = [Psf(v, 2.0, 530.0, "pixel") for v in (first, second)]
    assert colour_distance(psfs[0], psfs[1]).value == 1.0
    with pytest.raises(InternalError, match="MF901"):
        colour_distance(psfs[0], gaussian(1.0, 1.0))


def test_wider_separation_of_lines_shows_more_fringe() -> None:
    setting = camera(480.0, wavelengths=(470.0, 530.0, 610.0), window_um=128.0)
    source = pupil(panel(noise(7, 0.4, 3), cells=10), setting.stop)
    psfs = {w: pixel_psf(point_psf(source, setting, w, pixel_margin(setting)), setting) for w in setting.wavelengths_nm}
    wide = edge_colour_difference(*(edge_in_window(psfs[line]) for line in (610.0, 530.0, 470.0)))
    none = edge_colour_difference(*3 * [edge_in_window(psfs[530.0])])
    assert wide.value > 1.0 > none.value
    assert colour_distance(psfs[610.0], psfs[470.0]).value > colour_distance(psfs[610.0], psfs[530.0]).value
    assert cutoff(setting, 470.0) > cutoff(setting, 610.0)


@pytest.mark.parametrize("radius", [0.4, 3.0, 24.0, 80.0])
def test_the_energy_in_a_circle_is_exact(radius):
    """Airy's pattern holds 1 - J0² - J1² (Goodman 4.4.2)."""
    argument = np.pi * HIGHEST * radius

    def intensity(x, y):
        turns = np.pi * HIGHEST * np.hypot(x, y[:, None])
        return np.pi / 4 * HIGHEST**2 * np.where(turns == 0, 1.0, 2 * j1(turns) / np.where(turns, turns, 1.0)) ** 2

    psf = ExactPsf(airy(0.5, 10), intensity, np.pi / 4 * HIGHEST**2, HIGHEST, 2e-14, True)
    value, bar = psf.in_circle(radius)
    assert abs(value - (1 - j0(argument) ** 2 - j1(argument) ** 2)) <= bar < 1e-8
