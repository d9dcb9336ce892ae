"""The gap between panel and stop, against Fresnel integrals dot by dot, and its estimates against simulation."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from numpy.polynomial.legendre import leggauss
from optics_cases import camera, focused_psf, noise, panel, pupil, shifted_psf
from scipy.special import fresnel
from sweeps import sweep

from maskfab.base.errors import JobError
from maskfab.base.model import Panel, Psf
from maskfab.job.camera import Camera, Stop
from maskfab.job.process import Glass
from maskfab.optics import gap
from maskfab.optics.field.matrix import direct_field, parity_field
from maskfab.optics.gap import (
    AXIS,
    common_share,
    gap_error,
    gap_psf,
    glass_as_air_um,
    magnified,
    moved_aperture,
    moved_pupil,
    share_across_gap,
    shift_error,
    shift_um,
    shifted_pupil,
)
from maskfab.optics.metrics import relative_difference
from maskfab.optics.phase import image_distance_um, phased, phased_psf, window_frequency
from maskfab.optics.psf import point_psf
from maskfab.optics.pupil import Aperture, cut, panel_aperture
from maskfab.optics.scene.plan import cost_model
from maskfab.optics.scene.point_images import deblurring_residual, field_places, residual_blur
from maskfab.optics.scene.scene import Scene
from maskfab.optics.stop import Waves
from maskfab.optics.tiling_mean import mean_psf

LINE = 530.0


def stripes(cells: int, seed: int | None = 1) -> Panel:
    mask = np.zeros((21, 21), dtype=np.bool_)
    mask[1:19, 8:13] = True
    return panel(mask, cells=cells, seed=seed)


def coma(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """A phase without symmetry, half a wave at the rim of a stop of 160 um."""
    return 0.2 * (x / 80) ** 2 + 0.3 * (x / 80) * ((x / 80) ** 2 + (y / 80) ** 2) - 0.1 * (y / 80)


def brute_intensity(
    laid_out: Panel, setting: Camera, gap_um: float, moved: tuple[float, float], u: np.ndarray, waves: Waves | None
) -> np.ndarray:
    """|field|²: every dot's Fresnel integrals at polar nodes of the stop, then a plain sum to the sensor."""
    radius = setting.stop.diameter_um / 2
    aperture = moved_aperture(panel_aperture(laid_out), moved, radius + 300.0)
    nodes, weights = leggauss(120)
    r, a = radius * (nodes + 1) / 2, 2 * np.pi * np.arange(400) / 400
    x, y = (r[:, None] * np.cos(a)).ravel(), (r[:, None] * np.sin(a)).ravel()
    w = np.repeat(radius / 2 * weights * r * 2 * np.pi / 400, 400).astype(np.complex128)
    if waves is not None:
        w *= np.exp(2j * np.pi * waves(x, y))
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
    coarse, fine = (
        relative_difference(gap_psf(panel_aperture(laid_out), setting, LINE, 0.0, AXIS, n), plain) for n in (4, 8)
    )
    assert fine < 1e-4
    assert fine < coarse / 2 < 5e-4
    assert relative_difference(shifted_psf(panel_aperture(laid_out), setting, LINE, 0.0, (500.0, 300.0)), plain) < 1e-12


@pytest.mark.parametrize(
    ("gap_um", "image_um", "waves", "distance_um"),
    sweep(
        [
            (100.0, AXIS, None, None),
            (800.0, (300.0, -200.0), coma, 10_400.0),
            (800.0, (300.0, -200.0), None, None),
        ],
        2,
    ),
)
def test_gap_against_fresnel_integrals(
    gap_um: float, image_um: tuple[float, float], waves: Waves | None, distance_um: float | None
) -> None:
    setting, laid_out = camera(160.0), panel(noise(7, 0.4, 5), cells=10, seed=3)
    clear = panel_aperture(laid_out)
    found = gap_psf(clear, setting, LINE, gap_um, image_um, 8, waves=waves, distance_um=distance_um)
    chosen = slice(None, None, 12)
    scale = LINE * 1e-3 * (distance_um or setting.focal_um)
    u = found.step_um * (np.arange(found.values.shape[0]) - found.values.shape[0] // 2)[chosen] / scale
    moved = shift_um(setting, gap_um, image_um, distance_um)
    expected = brute_intensity(laid_out, setting, gap_um, moved, u, waves)
    values = found.values[chosen, chosen]
    energy = (values * expected).sum() / (values**2).sum() / scale**2
    assert np.linalg.norm(values * energy * scale**2 - expected) < 1.5e-3 * np.linalg.norm(expected)
    # What the stop passes is the clear area but for what crosses its rim.
    assert energy == pytest.approx(pupil(laid_out, setting.stop).energy_um2, rel=0.06)
    if waves is not None:
        plain = gap_psf(clear, setting, LINE, gap_um, image_um, 8, distance_um=distance_um)
        assert relative_difference(plain, found) > 0.1


@pytest.mark.parametrize("shape", ["circle", "square"])
@pytest.mark.parametrize(("diameter", "gap_um"), sweep([(200.0, 200.0), (400.0, 300.0)], 1))
def test_samples_over_a_gap_err_no_more_than_their_price_says(shape: str, diameter: float, gap_um: float) -> None:
    laid_out = panel(noise(7, 0.4, 5), cells=24, seed=3)
    setting = Camera(10_000.0, Stop(shape, diameter), (LINE,), 2.0, 128.0)
    scene = Scene(gap_um=gap_um, field_um=400.0)
    known = cost_model(laid_out, setting, scene, 0.1)
    chosen = {each.samples_per_dot: each for each in known.choices() if each.diffraction}
    clear, place = panel_aperture(laid_out), (300.0, 100.0)
    fine = gap_psf(clear, setting, LINE, gap_um, place, 16)
    for samples in (1, 2, 4):
        error = relative_difference(gap_psf(clear, setting, LINE, gap_um, place, samples), fine)
        assert error < known.own_error(chosen[samples]), samples


def test_samples_that_do_not_resolve_the_window_are_no_choice() -> None:
    laid_out, scene = panel(noise(7, 0.4, 5), cells=12, seed=3), Scene(gap_um=300.0)
    for window, coarsest in ((128.0, 1), (600.0, 2)):
        setting = Camera(10_000.0, Stop("circle", 400.0), (LINE,), 2.0, window)
        found = {
            each.samples_per_dot for each in cost_model(laid_out, setting, scene, 0.1).choices() if each.diffraction
        }
        assert min(found) == coarsest


def test_over_a_tiny_gap_a_phase_is_that_of_the_phased_pupil() -> None:
    setting, laid_out = camera(240.0), panel(noise(7, 0.4, 5), cells=8, seed=3)
    distance = 10_300.0
    for shape in ("circle", "square"):
        stop = Stop(shape, 240.0)
        seen = replace(setting, stop=stop)
        source = phased(pupil(laid_out, stop), coma, window_frequency(seen, LINE, distance), 1e-8)
        expected = phased_psf(source, seen, LINE, distance_um=distance)
        errors = [
            relative_difference(
                gap_psf(
                    panel_aperture(laid_out), seen, LINE, 1e-6, samples_per_dot=n, waves=coma, distance_um=distance
                ),
                expected,
            )
            for n in (4, 8)
        ]
        # The dots' edges fall on the square's, where samples hold half of what they should or twice.
        assert errors[1] < errors[0] < (1.5e-2 if shape == "circle" else 5e-2)
        assert errors[1] < (3e-3 if shape == "circle" else 3e-2)


def test_a_phase_of_zero_is_no_phase() -> None:
    setting, clear = camera(160.0), panel_aperture(panel(noise(7, 0.4, 5), cells=8, seed=3))
    plain = gap_psf(clear, setting, LINE, 50.0, (300.0, 100.0))
    flat = gap_psf(clear, setting, LINE, 50.0, (300.0, 100.0), waves=lambda x, y: 0 * x * y)
    np.testing.assert_allclose(flat.values, plain.values, rtol=1e-9)


def test_a_gap_with_a_distance_scales_as_a_near_focus_does() -> None:
    setting, laid_out = camera(240.0), panel(noise(7, 0.4, 5), cells=8, seed=3)
    near = 4e5
    expected = focused_psf(pupil(laid_out, setting.stop), setting, LINE, near)
    distance = image_distance_um(setting.focal_um, near)
    found = gap_psf(panel_aperture(laid_out), setting, LINE, 0.0, AXIS, 8, distance_um=distance)
    assert relative_difference(found, expected) < 1e-4
    assert relative_difference(gap_psf(panel_aperture(laid_out), setting, LINE, 0.0, AXIS, 8), expected) > 1e-2
    assert shift_um(setting, 100.0, (500.0, -250.0), 20_000.0) == (2.5, -1.25)


def test_a_near_object_sees_magnified_openings() -> None:
    """A spherical wave through every dot by quadrature, on to the stop and, in focus, to the sensor; no m anywhere."""
    gap, away, image, wavelength = 1000.0, 15_000.0, 350.0, LINE * 1e-3
    setting, clear = camera(96.0), panel_aperture(panel(noise(7, 0.4, 5), cells=4, seed=3))
    distance = image_distance_um(setting.focal_um, away)
    larger, farther = magnified(clear, gap, away)
    found = gap_psf(larger, setting, LINE, farther, (image, 0.0), 8, distance_um=distance)
    nodes, weights = leggauss(10)
    edges = clear.x.edges_um()
    place = (edges[:-1, None] + 4 * (nodes + 1)).ravel()
    weight = np.tile(4 * weights, edges.size - 1)
    nodes, weights = leggauss(60)
    r, a = 24 * (nodes + 1), 2 * np.pi * np.arange(160) / 160
    stop_x, stop_y = (r[:, None] * np.cos(a)).ravel(), (r[:, None] * np.sin(a)).ravel()
    share = np.repeat(24 * weights * r, 160)

    def waves(at: np.ndarray, source: float) -> np.ndarray:
        """[dots, points]: source to panel to stop, less the way in focus from source to stop."""
        path = (
            (place - source) ** 2 / (away - gap) + (at[:, None] - place) ** 2 / gap - (at[:, None] - source) ** 2 / away
        )
        return (weight * np.exp(1j * np.pi / wavelength * path)).reshape(at.size, -1, 10).sum(axis=2).T

    across, up = waves(stop_x, -away * image / distance), waves(stop_y, 0.0)
    field = np.einsum("jn,jn->n", up, clear.transmission @ across) * share
    chosen = slice(None, None, 6)
    u = found.step_um * (np.arange(found.values.shape[0]) - found.values.shape[0] // 2)[chosen]
    turn = -2j * np.pi / (wavelength * distance)
    expected = abs(np.exp(turn * u[:, None] * stop_y) @ (field[:, None] * np.exp(turn * stop_x[:, None] * u))) ** 2
    values = found.values[chosen, chosen]
    plain = gap_psf(clear, setting, LINE, gap, (image, 0.0), 8, distance_um=distance).values[chosen, chosen]
    errors = [
        np.linalg.norm(each * (each * expected).sum() / (each**2).sum() - expected) / np.linalg.norm(expected)
        for each in (values, plain)
    ]
    assert errors[0] < 3e-3
    assert errors[1] > 1e-2
    with pytest.raises(JobError, match="MF104"):
        magnified(clear, gap, 200.0)


def test_a_moved_pupil_keeps_the_stop_in_the_middle() -> None:
    clear, stop, moved = panel_aperture(panel(noise(7, 0.4, 5), cells=8, seed=3)), Stop("circle", 200.0), (31.4, -17.7)
    source, centred = moved_pupil(clear, stop, moved), shifted_pupil(clear, stop, moved)
    x = source.x.edges_um()
    assert abs(x[source.rim_column].min()) <= 100 + source.x.dot_um
    assert x[source.rim_column + 1].max() <= 100 + source.x.dot_um
    u = np.linspace(0, 0.02, 15)
    np.testing.assert_allclose(abs(direct_field(source, u, u)), abs(direct_field(centred, u, u)), atol=1e-7)


def test_shifting_openings_by_whole_cells_of_a_periodic_panel_changes_nothing() -> None:
    laid_out, stop = stripes(6, seed=None), Stop("circle", 300.0)
    u = np.linspace(0, 0.02, 15)
    here, there = (
        abs(direct_field(shifted_pupil(panel_aperture(laid_out), stop, moved), u, u))
        for moved in (AXIS, (168.0, -168.0))
    )
    np.testing.assert_allclose(there, here, atol=1e-9 * here.max())


def test_a_shifted_pupil_is_the_moved_openings_cut() -> None:
    """Centring the lattices must not change intensities, gutters or not."""
    for gutter_nm in (0, 6000):
        laid_out, stop = panel(noise(7, 0.4, 5), cells=8, seed=3, gutter_nm=gutter_nm), Stop("circle", 200.0)
        moved = (31.4, -17.7)
        u = np.linspace(0, 0.02, 15)
        reference = abs(direct_field(cut(moved_aperture(panel_aperture(laid_out), moved, 100.0), stop), u, u))
        found = abs(direct_field(shifted_pupil(panel_aperture(laid_out), stop, moved), u, u))
        np.testing.assert_allclose(found, reference, atol=1e-9 * reference.max())


def test_the_panel_must_cover_the_stop() -> None:
    setting = camera(240.0)
    laid_out = panel(noise(7, 0.4, 5), cells=5)
    for call in (shifted_psf, gap_psf):
        with pytest.raises(JobError, match="MF114"):
            call(panel_aperture(laid_out), setting, LINE, 500.0, (800.0, 0.0))
    for gap_um in (-1.0, math.nan, math.inf):
        with pytest.raises(JobError, match="MF104"):
            shifted_psf(panel_aperture(laid_out), setting, LINE, gap_um, AXIS)
    with pytest.raises(JobError, match="MF115"):
        gap_psf(panel_aperture(laid_out), setting, LINE, 10.0, AXIS, 64)
    with pytest.raises(JobError, match="MF115"):
        gap_psf(panel_aperture(laid_out), setting, LINE, 10.0, waves=lambda x, y: 0.1 * x + 0 * y)
    with pytest.raises(JobError, match="MF104"):
        gap_psf(panel_aperture(laid_out), setting, LINE, 10.0, waves=lambda x, y: np.nan * x * y)


def test_the_grid_over_the_field_and_its_residual() -> None:
    setting, laid_out = camera(400.0, window_um=96.0), stripes(6)
    places = field_places(1000.0, 3)
    assert places[0][0] == (-1000.0, -1000.0)
    assert places[1][1] == AXIS

    def seen(openings: Aperture) -> list[list[Psf]]:
        return [[shifted_psf(openings, setting, LINE, 400.0, place) for place in row] for row in places]

    grid = seen(panel_aperture(laid_out))
    centre = grid[1][1]
    assert deblurring_residual(centre, centre, 0.015) == 0
    residuals = [deblurring_residual(each, centre, 0.015) for row in grid for each in row if each is not centre]
    assert min(residuals) > 0.02
    periodic = seen(panel_aperture(stripes(6, seed=None)))
    ordered = [deblurring_residual(each, periodic[1][1], 0.015) for row in periodic for each in row]
    assert np.mean(ordered) < np.mean(residuals)


def test_residual_blur_of_itself_peaks_in_the_middle() -> None:
    psf = point_psf(pupil(stripes(4), Stop("circle", 300.0)), camera(300.0), LINE)
    blur = residual_blur(psf, psf, 1e-4)
    assert np.unravel_index(blur.argmax(), blur.shape) == (blur.shape[0] // 2, blur.shape[1] // 2)
    assert blur.sum() == pytest.approx(1.0, abs=0.05)


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


def test_the_share_across_a_gap_is_that_of_every_samples_own_distance() -> None:
    setting = camera(400.0)
    psf = Psf(np.ones((9, 9)), 3.0, 530.0, "point")
    place = 3.0 * (np.arange(9) - 4)
    moved = 500.0 / setting.focal_um * np.hypot(place[:, None], place)
    expected = common_share(setting.stop, moved, 500.0, 530.0)
    np.testing.assert_array_equal(share_across_gap(psf, setting, 500.0), expected)
    assert expected[4, 4] > expected[0, 4] > expected[0, 0]


@pytest.mark.parametrize(("gap_um", "image_um"), [(200.0, (300.0, 0.0)), (800.0, (200.0, -300.0))])
def test_estimates_of_leaving_the_gap_out(gap_um: float, image_um: tuple[float, float]) -> None:
    setting = camera(400.0, window_um=96.0)
    shifts, spreads = [], []
    for seed in range(5):
        laid_out = stripes(5, seed)
        plain = point_psf(pupil(laid_out, setting.stop), setting, LINE)
        moved = shifted_psf(panel_aperture(laid_out), setting, LINE, gap_um, image_um)
        shifts.append(relative_difference(moved, plain))
        spreads.append(relative_difference(gap_psf(panel_aperture(laid_out), setting, LINE, gap_um), plain))
    mean = mean_psf(stripes(5), setting, LINE)
    assert 0.12 < np.mean(shifts) / shift_error(mean, setting, gap_um, image_um) < 3
    assert 0.03 < np.mean(spreads) / gap_error(mean, share_across_gap(mean.psf, setting, gap_um)) < 3
    assert shift_error(mean, setting, gap_um, AXIS) == 0
    assert gap_error(mean, share_across_gap(mean.psf, setting, 0.0)) == 0


def test_a_shifted_pupil_keeps_its_stop_where_coarse_dots_need_more_of_the_rim() -> None:
    """Dots a tenth of the stop wide, at phases beyond what a cut dot's stored orders hold."""
    laid_out, moved = panel(noise(6, 0.4, 3), dot_nm=100_000, cells=4, seed=3), (31.0, -17.0)
    u = np.linspace(0, 0.03, 20)
    whole = np.concatenate([-u[:0:-1], u])
    expected = abs(direct_field(moved_pupil(panel_aperture(laid_out), Stop("circle", 1000.0), moved), whole, whole))
    shifted = shifted_pupil(panel_aperture(laid_out), Stop("circle", 1000.0), moved)
    found = np.sqrt(parity_field(shifted, u, u).intensity())
    assert np.linalg.norm(found - expected) < 1e-12 * np.linalg.norm(expected)


def test_glass_in_a_gap_has_its_own_phase_and_walk() -> None:
    """H from w = sqrt(n²/λ² - q²) of either layer, without carrier and shift; of index 1 it is the air's."""
    wavelength, sample, count, air, thickness, index = 0.53, 2.0, 40, 30.0, 80.0, 1.5
    across, up = 0.3 / wavelength, -0.45 / wavelength
    size = math.hypot(across, up)
    slope = wavelength * size / math.sqrt(1 - (wavelength * size) ** 2)
    glass = Glass(thickness, index, "away")
    sine = wavelength * size / index
    walk = thickness * sine / math.sqrt(1 - sine**2)
    assert glass_as_air_um(glass, slope) * slope == pytest.approx(walk)
    found = gap._transfer(wavelength, (across, up, size), air + glass_as_air_um(glass, slope), sample, count, glass)
    u, v = np.meshgrid(*2 * [np.fft.fftfreq(count, sample)])
    phase = (u * across + v * up) / size * (air * slope + walk)
    for depth, n in ((air, 1.0), (thickness, index)):
        squares = ((u + across) ** 2 + (v + up) ** 2, size**2)
        phase = phase + depth * np.subtract(*(np.sqrt((n / wavelength) ** 2 - square) for square in squares))
    assert abs(found - np.exp(2j * np.pi * phase)).max() < 1e-9
    thin = replace(glass, index=1.0)
    same = [gap._transfer(wavelength, (across, up, size), air + thickness, sample, count, g) for g in (thin, None)]
    np.testing.assert_allclose(*same, atol=1e-9)
