"""The gap between panel and stop, against Fresnel integrals dot by dot, and its estimates against simulation."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.polynomial.legendre import leggauss
from optics_cases import camera, noise, panel, pupil
from scipy.special import fresnel

from maskfab.errors import JobError
from maskfab.model import Camera, Panel, Stop
from maskfab.optics.ensemble import mean_psf
from maskfab.optics.field import direct_field
from maskfab.optics.gap import (
    AXIS,
    common_share,
    deblurring_residual,
    field_places,
    fresnel_number,
    gap_error,
    gap_psf,
    moved_aperture,
    psf_over_field,
    residual_blur,
    shift_error,
    shift_um,
    shifted_psf,
    shifted_pupil,
)
from maskfab.optics.metrics import relative_difference
from maskfab.optics.psf import image_scale_um2, point_psf
from maskfab.optics.pupil import cut

LINE = 530.0


def stripes(cells: int, seed: int | None = 1) -> Panel:
    mask = np.zeros((21, 21), dtype=np.bool_)
    mask[1:19, 8:13] = True
    return panel(mask, cells=cells, seed=seed)


def brute_intensity(
    laid_out: Panel, setting: Camera, gap_um: float, moved: tuple[float, float], u: np.ndarray
) -> np.ndarray:
    """|field|²: every dot's Fresnel integrals at polar nodes of the stop, then a plain sum to the sensor."""
    radius = setting.stop.diameter_um / 2
    aperture = moved_aperture(laid_out, moved, radius + 300.0)
    nodes, weights = leggauss(120)
    r, a = radius * (nodes + 1) / 2, 2 * np.pi * np.arange(400) / 400
    x, y = (r[:, None] * np.cos(a)).ravel(), (r[:, None] * np.sin(a)).ravel()
    w = np.repeat(radius / 2 * weights * r * 2 * np.pi / 400, 400)
    scale = np.sqrt(2 / (LINE * 1e-3 * gap_um))

    def interval_waves(edges: np.ndarray, place: np.ndarray) -> np.ndarray:
        sine, cosine = fresnel(scale * (edges[:, None] - place))
        return np.diff((cosine + 1j * sine) / np.sqrt(2j), axis=0)

    field = np.zeros((u.size, u.size), dtype=np.complex128)
    for part in np.array_split(np.arange(x.size), 8):
        across = interval_waves(aperture.x.edges_um(), x[part])
        up = interval_waves(aperture.y.edges_um(), y[part])
        wave = np.einsum("jn,jn->n", up, aperture.transmission @ across) * w[part]
        field += (np.exp(-2j * np.pi * u[:, None] * y[part]) * wave) @ np.exp(-2j * np.pi * u[:, None] * x[part]).T
    return abs(field) ** 2


def test_without_a_gap_it_is_the_plain_psf() -> None:
    setting, laid_out = camera(240.0), panel(noise(7, 0.4, 5), cells=8, seed=3)
    plain = point_psf(pupil(laid_out, setting.stop), setting, LINE)
    coarse, fine = (relative_difference(gap_psf(laid_out, setting, LINE, 0.0, AXIS, n), plain) for n in (4, 8))
    assert fine < 1e-4
    assert fine < coarse / 2 < 5e-4
    assert relative_difference(shifted_psf(laid_out, setting, LINE, 0.0, (500.0, 300.0)), plain) < 1e-12


@pytest.mark.parametrize(("gap_um", "image_um"), [(100.0, AXIS), (800.0, AXIS), (800.0, (300.0, -200.0))])
def test_gap_against_fresnel_integrals(gap_um: float, image_um: tuple[float, float]) -> None:
    setting, laid_out = camera(160.0), panel(noise(7, 0.4, 5), cells=10, seed=3)
    found = gap_psf(laid_out, setting, LINE, gap_um, image_um, 8)
    chosen = slice(None, None, 12)
    scale = image_scale_um2(setting, LINE)
    u = found.step_um * (np.arange(found.values.shape[0]) - found.values.shape[0] // 2)[chosen] / scale
    expected = brute_intensity(laid_out, setting, gap_um, shift_um(setting, gap_um, image_um), u)
    values = found.values[chosen, chosen]
    energy = (values * expected).sum() / (values**2).sum() / scale**2
    assert np.linalg.norm(values * energy * scale**2 - expected) < 1.5e-3 * np.linalg.norm(expected)
    # What the stop passes is the clear area but for what crosses its rim.
    assert energy == pytest.approx(pupil(laid_out, setting.stop).energy_um2, rel=0.06)


def test_shifting_openings_by_whole_cells_of_a_periodic_panel_changes_nothing() -> None:
    laid_out, stop = stripes(6, seed=None), Stop("circle", 300.0)
    u = np.linspace(0, 0.02, 15)
    here, there = (abs(direct_field(shifted_pupil(laid_out, stop, moved), u, u)) for moved in (AXIS, (168.0, -168.0)))
    np.testing.assert_allclose(there, here, atol=1e-9 * here.max())


def test_a_shifted_pupil_is_the_moved_openings_cut() -> None:
    """Centring the lattices must not change intensities, gutters or not."""
    for gutter_nm in (0, 6000):
        laid_out, stop = panel(noise(7, 0.4, 5), cells=8, seed=3, gutter_nm=gutter_nm), Stop("circle", 200.0)
        moved = (31.4, -17.7)
        u = np.linspace(0, 0.02, 15)
        reference = abs(direct_field(cut(moved_aperture(laid_out, moved, 100.0), stop), u, u))
        found = abs(direct_field(shifted_pupil(laid_out, stop, moved), u, u))
        np.testing.assert_allclose(found, reference, atol=1e-9 * reference.max())


def test_the_panel_must_cover_the_stop() -> None:
    setting = camera(240.0)
    laid_out = panel(noise(7, 0.4, 5), cells=5)
    for call in (shifted_psf, gap_psf):
        with pytest.raises(JobError, match="MF114"):
            call(laid_out, setting, LINE, 500.0, (800.0, 0.0))
    for gap in (-1.0, math.nan, math.inf):
        with pytest.raises(JobError, match="MF104"):
            shifted_psf(laid_out, setting, LINE, gap, AXIS)
    with pytest.raises(JobError, match="MF115"):
        gap_psf(laid_out, setting, LINE, 10.0, AXIS, 64)


def test_the_grid_over_the_field_and_its_residual() -> None:
    setting, laid_out = camera(400.0, window_um=96.0), stripes(6)
    places = field_places(1000.0, 3)
    assert places[0][0] == (-1000.0, -1000.0)
    assert places[1][1] == AXIS
    grid = psf_over_field(laid_out, setting, LINE, 400.0, places)
    centre = grid[1][1]
    assert deblurring_residual(centre, centre, 0.015) == 0
    residuals = [deblurring_residual(each, centre, 0.015) for row in grid for each in row if each is not centre]
    assert min(residuals) > 0.02
    periodic = psf_over_field(stripes(6, seed=None), setting, LINE, 400.0, places)
    ordered = [deblurring_residual(each, periodic[1][1], 0.015) for row in periodic for each in row]
    assert np.mean(ordered) < np.mean(residuals)


def test_residual_blur_of_itself_peaks_in_the_middle() -> None:
    psf = point_psf(pupil(stripes(4), Stop("circle", 300.0)), camera(300.0), LINE)
    blur = residual_blur(psf, psf, 1e-4)
    assert np.unravel_index(blur.argmax(), blur.shape) == (blur.shape[0] // 2, blur.shape[1] // 2)
    assert blur.sum() == pytest.approx(1.0, abs=0.05)


def test_fresnel_number() -> None:
    assert fresnel_number(8.0, 1000.0, 500.0) == pytest.approx(16 / 500)
    assert fresnel_number(8.0, 0.0, 500.0) == math.inf


def test_common_share_of_a_clear_stop() -> None:
    """The closed form against the integral of |transform|² times Fresnel's transfer function."""
    stop, gap = Stop("circle", 4000.0), 1000.0
    span = 0.53 * gap
    kernel = np.linspace(1e-3, 40.0, 400_001) * math.sqrt(span)
    # ∫ |s - s0| h(s) d²s at s0 = 0 by rotating the contour of ∫ s² exp(iπs²/λg) ds, its oscillation damped away.
    turned = kernel * np.exp(0.25j * np.pi)
    mean = np.trapezoid(2 * np.pi / (1j * span) * turned**2 * np.exp(-np.pi * kernel**2 / span), kernel)
    mean *= np.exp(0.25j * np.pi)
    assert common_share(stop, 0.0, gap, 530.0) == pytest.approx(abs(1 - 4 * mean / (np.pi * 4000.0)), abs=1e-6)
    far = np.array([300.0, 500.0])
    np.testing.assert_allclose(common_share(stop, far, 10.0, 530.0), 1 - 4 * far / (np.pi * 4000.0), atol=1e-3)
    np.testing.assert_allclose(common_share(stop, far), 1 - 4 * far / (np.pi * 4000.0))


@pytest.mark.parametrize(("gap_um", "image_um"), [(200.0, (300.0, 0.0)), (800.0, (200.0, -300.0))])
def test_estimates_of_leaving_the_gap_out(gap_um: float, image_um: tuple[float, float]) -> None:
    setting = camera(400.0, window_um=96.0)
    shifts, spreads = [], []
    for seed in range(5):
        laid_out = stripes(5, seed)
        plain = point_psf(pupil(laid_out, setting.stop), setting, LINE)
        moved = shifted_psf(laid_out, setting, LINE, gap_um, image_um)
        shifts.append(relative_difference(moved, plain))
        spreads.append(relative_difference(gap_psf(laid_out, setting, LINE, gap_um), plain))
    mean = mean_psf(stripes(5), setting, LINE)
    assert 0.12 < np.mean(shifts) / shift_error(mean, setting, gap_um, image_um) < 3
    assert 0.03 < np.mean(spreads) / gap_error(mean, setting, gap_um) < 3
    assert shift_error(mean, setting, gap_um, AXIS) == 0
    assert gap_error(mean, setting, 0.0) == 0
