"""Complex pupils against quadrature that knows nothing of dots' moments, and Strehl ratios known in closed form."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.polynomial.legendre import leggauss
from optics_cases import aberrated, aberrated_psf, camera, noise, panel, pupil

from maskfab.base.errors import JobError
from maskfab.job.camera import Stop
from maskfab.optics.field.matrix import parity_field
from maskfab.optics.metrics import relative_difference
from maskfab.optics.phase import (
    HIGHEST_TERM,
    NOLL,
    PhasedPupil,
    Wavefront,
    aberration_error,
    halved,
    marechal_strehl,
    noll_degrees,
    phased,
    window_frequency,
    zernike,
)
from maskfab.optics.psf import point_psf
from maskfab.optics.pupil import Pupil
from maskfab.optics.stop import Waves
from maskfab.optics.tiling_mean import mean_psf

LINE = 530.0
ALL_CLEAR = np.ones((5, 5), dtype=np.bool_)


def flat(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    return np.zeros(np.broadcast(x, y).shape)


def brute_field(source: Pupil, waves: Waves, u: np.ndarray) -> np.ndarray:
    """Row by row, interval by interval of open dot ∩ disc, Gauss-Legendre nodes in an angle and along x."""
    x, y, radius = source.x.edges_um(), source.y.edges_um(), source.stop.diameter_um / 2
    open_dots = source.whole.astype(bool)
    open_dots[source.rim_row, source.rim_column] = True
    nodes, weights = leggauss(24)
    total = np.zeros((u.size, u.size), dtype=np.complex128)
    for j in range(y.size - 1):
        # Slices at y = R sin t, split where the circle crosses dot edges.
        corners = np.sqrt(np.clip(radius**2 - x**2, 0, None))
        ends = np.clip([y[j], y[j + 1]], -radius, radius)
        cuts = np.unique(np.clip(np.concatenate([ends, corners, -corners]), *ends))
        angles = np.arcsin(np.clip(cuts / radius, -1, 1))
        for low, high in itertools.pairwise(angles):
            for t, w in zip((low + high) / 2 + (high - low) / 2 * nodes, (high - low) / 2 * weights, strict=True):
                height, chord = radius * np.sin(t), radius * np.cos(t)
                left = np.clip(x[:-1][open_dots[j]], -chord, chord)[:, None]
                right = np.clip(x[1:][open_dots[j]], -chord, chord)[:, None]
                place = ((left + right) / 2 + (right - left) / 2 * nodes[None, :]).ravel()
                weight = ((right - left) / 2 * weights).ravel() * w * chord
                value = weight * np.exp(2j * np.pi * waves(place, np.full_like(place, height)))
                along_x = np.exp(-2j * np.pi * u[:, None] * place) @ value
                total += np.exp(-2j * np.pi * u[:, None] * height) * along_x
    return total


def test_zernikes_are_orthonormal_on_the_disc() -> None:
    nodes, weights = leggauss(40)
    radius, angle = np.sqrt((nodes + 1) / 2)[:, None], 2 * np.pi * np.arange(80) / 80
    values = [zernike(j, radius * np.cos(angle), radius * np.sin(angle)) for j in range(1, HIGHEST_TERM + 1)]
    gram = np.einsum("jra,kra,r->jk", values, values, weights / 2) / 80
    np.testing.assert_allclose(gram, np.eye(HIGHEST_TERM), atol=1e-12)


def test_noll_numbers() -> None:
    """The first rows of Noll's table, and the names."""
    expected = [(0, 0), (1, 1), (1, -1), (2, 0), (2, -2), (2, 2), (3, -1), (3, 1), (3, -3), (3, 3), (4, 0)]
    assert [noll_degrees(j) for j in range(1, 12)] == expected
    assert noll_degrees(HIGHEST_TERM) == (10, 10)
    x, y = np.array([0.3]), np.array([-0.4])
    assert zernike(NOLL["defocus"], x, y) == pytest.approx(math.sqrt(3) * (2 * 0.25 - 1))
    assert zernike(NOLL["coma_x"], x, y) == pytest.approx(math.sqrt(8) * (3 * 0.25 - 2) * 0.3)
    assert zernike(NOLL["astigmatism"], x, y) == pytest.approx(math.sqrt(6) * (0.09 - 0.16))


@pytest.mark.parametrize("gutter_nm", [0, 6000])
def test_complex_pupil_against_direct_quadrature(gutter_nm: int) -> None:
    source = pupil(panel(noise(5, 0.4, 2), cells=5, seed=1, gutter_nm=gutter_nm), Stop("circle", 190.0))
    waves = Wavefront(((4, 0.4), (6, -0.2), (7, 0.15), (11, 0.1)), LINE).waves(source.stop, LINE)
    u = np.array([0.0, 0.004, 0.011, 0.024])
    found = phased(source, waves, 0.024, 1e-9).field(u, u)[u.size - 1 :, u.size - 1 :]
    expected = brute_field(source, waves, u)
    assert np.linalg.norm(found - expected) < 1e-8 * np.linalg.norm(expected)


def test_all_four_quadrants() -> None:
    """Mirroring the wavefront and the pupil mirrors the field: each quadrant is checked by the brute one."""
    source = pupil(panel(noise(5, 0.4, 2), cells=4, seed=1), Stop("circle", 120.0))
    waves = Wavefront(((5, 0.3), (8, 0.2)), LINE).waves(source.stop, LINE)
    u = np.array([0.0, 0.007, 0.02])
    found = phased(source, waves, 0.02, 1e-9).field(u, u)
    whole_axis = np.concatenate([-u[:0:-1], u])
    expected = brute_field(source, waves, whole_axis)
    assert np.linalg.norm(found - expected) < 1e-8 * np.linalg.norm(expected)


def test_without_phase_it_is_the_real_field() -> None:
    source = pupil(panel(noise(7, 0.4, 5), cells=6, seed=3), Stop("circle", 300.0))
    u = np.linspace(0, 0.024, 30)
    plain = phased(source, flat, 0.024)
    real = parity_field(source, u, u).amplitude()
    assert plain.degree == 1
    assert np.linalg.norm(plain.field(u, u) - real) < 1e-10 * np.linalg.norm(real)


@settings(max_examples=12, deadline=None)
@given(
    st.floats(-3, 3),
    st.floats(-0.5, 0.5),
    st.sampled_from([1e-2, 1e-4, 1e-6]),
    st.integers(0, 100),
)
def test_the_error_bound_holds(defocus: float, coma: float, tolerance: float, seed: int) -> None:
    source = pupil(panel(noise(5, 0.4, seed), cells=6, seed=seed), Stop("circle", 200.0))
    waves = Wavefront(((4, defocus), (8, coma)), LINE).waves(source.stop, LINE)
    u = np.linspace(0, 0.024, 40)
    found = phased(source, waves, 0.024, tolerance)
    assert found.error <= tolerance
    reference = phased(halved(source), waves, 0.024, 1e-8).field(u, u)
    difference = np.linalg.norm(found.field(u, u) - reference) * u[1] / np.sqrt(source.energy_um2)
    # The cut dots are done more finely than the bound counts on.
    assert difference <= found.error + 1e-7


def test_a_tilt_shifts_the_psf() -> None:
    """W = a x moves the image by λ f a; a whole number of samples must move values exactly."""
    setting = camera(200.0, window_um=64.0)
    source = pupil(panel(noise(5, 0.4, 3), cells=6, seed=2), setting.stop)
    plain = point_psf(source, setting, LINE)
    samples = 7
    slope = samples * plain.step_um / (LINE * 1e-3 * setting.focal_um)
    wavefront = Wavefront(((NOLL["tilt_x"], slope * 100.0 / 2),), LINE)
    moved = aberrated_psf(source, wavefront, setting, LINE, 1e-8)
    np.testing.assert_allclose(moved.values[:, samples:], plain.values[:, :-samples], rtol=1e-5, atol=1e-9)


def test_energy_is_kept() -> None:
    setting = camera(100.0, window_um=2400.0)
    source = pupil(panel(ALL_CLEAR, cells=4), setting.stop)
    plain = point_psf(source, setting, LINE).energy_in_window
    found = aberrated_psf(source, Wavefront(((4, 0.3),), LINE), setting, LINE)
    assert found.energy_in_window == pytest.approx(plain, abs=3e-3)


def strehl_ratio(source: PhasedPupil) -> float:
    """Intensity on the axis over that of the same openings without the phase."""
    return abs(source.field_integral_um2) ** 2 / source.pupil.field_integral_um2**2


@pytest.mark.parametrize("edge", [0.1, 0.5, 1.0, 2.3])
def test_defocused_clear_stop_has_a_sinc_squared_peak(edge: float) -> None:
    source = pupil(panel(ALL_CLEAR, cells=8), Stop("circle", 300.0))
    found = phased(source, lambda x, y: edge * (x**2 + y**2) / 150.0**2, 0.0, 1e-9)
    assert strehl_ratio(found) == pytest.approx(np.sinc(edge) ** 2, abs=1e-8)


@pytest.mark.parametrize("name", ["defocus", "astigmatism", "coma_x", "trefoil_y", "spherical"])
def test_weak_wavefronts_follow_marechal(name: str) -> None:
    source = pupil(panel(ALL_CLEAR, cells=8), Stop("circle", 300.0))
    for rms in (0.01, 1 / 14):
        wavefront = Wavefront(((NOLL[name], rms),), 633.0)
        assert wavefront.rms_waves(633.0) == pytest.approx(rms)
        found = strehl_ratio(aberrated(source, wavefront, 633.0, 0.0, 1e-9))
        assert found == pytest.approx(marechal_strehl(rms), abs=3 * (2 * np.pi * rms) ** 4 / 2)


def test_waves_scale_with_the_wavelength() -> None:
    """The same glass path: twice the wavelength, half the waves, and its own variance is what rms_waves says."""
    wavefront, stop = Wavefront(((4, 0.2), (7, 0.1), (4, 0.1)), 600.0), Stop("circle", 100.0)
    place = np.linspace(-30, 30, 7)
    np.testing.assert_allclose(
        wavefront.waves(stop, 1200.0)(place, place), wavefront.waves(stop, 600.0)(place, place) / 2
    )
    assert wavefront.rms_waves(600.0) == pytest.approx(math.hypot(0.3, 0.1))


def test_the_estimate_of_leaving_it_out() -> None:
    setting = camera(400.0, window_um=96.0)
    mask = np.zeros((21, 21), dtype=np.bool_)
    mask[1:19, 8:13] = True
    laid_out = panel(mask, cells=4, seed=1)
    source = pupil(laid_out, setting.stop)
    plain, mean = point_psf(source, setting, LINE), mean_psf(laid_out, setting, LINE)
    for term in (6, 8, 11):
        wavefront = Wavefront(((term, 0.05),), LINE)
        change = relative_difference(aberrated_psf(source, wavefront, setting, LINE), plain)
        assert 0.3 < change / aberration_error(wavefront, LINE, mean) < 1.6
        assert change < 1.2 * aberration_error(wavefront, LINE)
    assert aberration_error(Wavefront((), LINE), LINE) == 0


def test_a_strong_wavefront_halves_the_dots() -> None:
    source = pupil(panel(noise(5, 0.4, 1), dot_nm=24000, cells=2), Stop("circle", 200.0))
    found = phased(source, Wavefront(((4, 4.0),), LINE).waves(source.stop, LINE), 0.024, 1e-4)
    assert found.pupil.x.dot_um < source.x.dot_um
    assert found.pupil.energy_um2 == pytest.approx(source.energy_um2, rel=1e-12)
    assert found.error <= 1e-4


@pytest.mark.parametrize("gutter_nm", [0, 6000])
def test_halving_dots_changes_nothing(gutter_nm: int) -> None:
    source = pupil(panel(noise(5, 0.4, 1), cells=4, gutter_nm=gutter_nm, seed=1), Stop("circle", 150.0))
    u = np.linspace(0, 0.02, 11)
    fine, coarse = parity_field(halved(source), u, u).amplitude(), parity_field(source, u, u).amplitude()
    assert np.linalg.norm(fine - coarse) < 1e-7 * np.linalg.norm(coarse)


def test_what_cannot_be_done_is_refused() -> None:
    for terms in (((0, 0.1),), ((67, 0.1),), ((4, math.nan),)):
        with pytest.raises(JobError, match="MF104"):
            Wavefront(terms, LINE)
    with pytest.raises(JobError, match="MF104"):
        Wavefront(((4, 0.1),), 0.0)
    source = pupil(panel(noise(5, 0.4, 1), cells=2), Stop("circle", 60.0))
    with pytest.raises(JobError, match="MF115"):
        phased(source, Wavefront(((4, 1e5),), LINE).waves(source.stop, LINE), 0.02, 1e-12)
    with pytest.raises(JobError, match="MF104"):
        phased(source, lambda x, y: flat(x, y) + math.inf, 0.02)


def test_window_frequency() -> None:
    setting = camera(200.0, window_um=96.0)
    assert window_frequency(setting, LINE) == pytest.approx(48.0 / 5300.0)
    assert window_frequency(setting, LINE, 20_000.0) == pytest.approx(24.0 / 5300.0)
