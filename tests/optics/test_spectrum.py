"""Spectra: sums of lines against single lines, quadrature against exact integrals, files against their errors."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from optics_cases import camera, noise, panel, pupil

from maskfab.base.errors import InternalError, JobError, SourceError
from maskfab.job.camera import Camera, Stop
from maskfab.optics import spectrum as spectrum_module
from maskfab.optics.lags import LagTable, lag_table
from maskfab.optics.response import GENERIC_RGB, black_body, camera_bands, generic_rgb, read_curves
from maskfab.optics.spectrum import (
    Band,
    Curve,
    Spectrum,
    line_spectrum,
    polychromatic_otf,
    polychromatic_otf_grid,
    quadrature,
    reach_um,
)

FREQUENCY = np.linspace(0.0, 0.25, 60)


def small_table(gutter_nm: int = 0, shape: str = "circle") -> LagTable:
    return lag_table(
        pupil(
            panel(noise(7, 0.4, 3), gutter_nm=gutter_nm, cells=10, seed=1),
            Stop("square" if shape == "square" else "circle", 480.0),
        )
    )


@pytest.mark.parametrize("gutter_nm", [0, 3000])
def test_polychromatic_otf_is_the_sum_of_its_lines(gutter_nm: int) -> None:
    table, setting = small_table(gutter_nm), camera(480.0)
    spectrum = line_spectrum(np.linspace(400, 700, 31), np.linspace(1, 2, 31))
    ny, nx = np.meshgrid(FREQUENCY[:20], np.concatenate([-FREQUENCY[:0:-1], FREQUENCY]), indexing="ij")
    direct = sum(
        w * table.coarse_otf(setting.focal_um * wl * 1e-3 * nx, setting.focal_um * wl * 1e-3 * ny)
        for wl, w in zip(spectrum.wavelengths_nm, spectrum.weights, strict=True)
    )
    np.testing.assert_allclose(polychromatic_otf(table, setting, spectrum, nx, ny), direct, rtol=0, atol=1e-12)
    found = polychromatic_otf_grid(table, setting, spectrum, nx[0], ny[:, 0])
    np.testing.assert_allclose(found, direct, rtol=0, atol=1e-12)


def test_the_table_is_not_read_beyond_its_reach() -> None:
    setting = camera(480.0)
    spectrum = line_spectrum([450.0, 650.0])
    reach = reach_um(setting, spectrum.wavelengths_nm, 0.02)
    table = lag_table(pupil(panel(noise(7, 0.4, 3), cells=10), setting.stop), reach)
    assert polychromatic_otf(table, setting, spectrum, np.array([0.02]), np.array([0.0])).shape == (1,)
    with pytest.raises(InternalError, match="MF901"):
        polychromatic_otf_grid(table, setting, spectrum, np.array([0.03]), np.array([0.0]))


@settings(max_examples=10, deadline=None)
@given(st.floats(300, 1500), st.integers(1, 5))
def test_equal_lines_are_one_line(wavelength: float, count: int) -> None:
    table, setting = small_table(), camera(480.0)
    one = polychromatic_otf(table, setting, line_spectrum([wavelength]), FREQUENCY, 0 * FREQUENCY)
    many = polychromatic_otf(table, setting, line_spectrum([wavelength] * count), FREQUENCY, 0 * FREQUENCY)
    np.testing.assert_allclose(many, one, atol=1e-14)


def exact_band_otf(band: Band, table: LagTable, setting: Camera, nu: float) -> float:
    """Between the wavelengths at which a lag crosses a dot's edge the integrand is a polynomial of degree 4 at most."""
    low, high = band.range_nm
    lag = setting.focal_um * 1e-3 * nu
    edges = table.x.dot_um * np.arange(1, 1000) / lag if nu else np.empty(0)
    knots = np.concatenate([c.wavelengths_nm for c in band.curves])
    breaks = np.unique(np.concatenate([[low, high], edges, knots]))
    breaks = breaks[(breaks >= low) & (breaks <= high)]
    nodes, weights = np.polynomial.legendre.leggauss(3)
    half = np.diff(breaks)[:, None] / 2
    wavelength = (breaks[:-1, None] + half + half * nodes).ravel()
    weight = (half * weights).ravel() * band.density(wavelength)
    return float(weight @ table.coarse_otf(lag * wavelength, 0 * wavelength) / weight.sum())


@pytest.mark.parametrize("tolerance", [1e-2, 1e-3, 1e-4])
def test_quadrature_error_is_what_it_says(tolerance: float) -> None:
    table, setting = small_table(shape="square"), camera(480.0, shape="square")
    band = Band((generic_rgb()["green"], black_body(5500.0)), "green by daylight")
    nu = np.linspace(0.0, 0.2, 41)
    lines, bound = quadrature(band, table, setting, tolerance, nu, 0 * nu)
    assert bound < tolerance
    exact = np.array([exact_band_otf(band, table, setting, float(v)) for v in nu])
    error = abs(polychromatic_otf(table, setting, lines, nu, 0 * nu) - exact).max()
    assert error <= bound


def test_a_narrow_band_is_a_line() -> None:
    table, setting = small_table(), camera(480.0)
    band = Band((Curve(np.array([529.99, 530.01]), np.ones(2), "laser"),), "laser")
    lines, _ = quadrature(band, table, setting, 1e-3, FREQUENCY, 0 * FREQUENCY)
    assert lines.wavelengths_nm.size == 8
    assert lines.centroid_nm == pytest.approx(530.0, abs=1e-9)


def test_quadrature_says_when_it_cannot(monkeypatch: pytest.MonkeyPatch) -> None:
    table, setting = small_table(), camera(480.0)
    band = Band((generic_rgb()["green"],), "green")
    with pytest.raises(JobError, match="MF104"):
        quadrature(band, table, setting, 0.0, FREQUENCY, 0 * FREQUENCY)
    monkeypatch.setattr(spectrum_module, "_MOST_PANELS", 64)
    with pytest.raises(JobError, match="MF115"):
        quadrature(band, table, setting, 1e-15, np.array([0.1]), np.zeros(1))


def test_generic_camera_follows_the_formula_in_its_header() -> None:
    peaks = {"red": (605, 28, 42), "green": (532, 36, 38), "blue": (462, 26, 32)}
    curves = generic_rgb()
    assert set(curves) == set(peaks)
    for name, (peak, left, right) in peaks.items():
        wavelength = curves[name].wavelengths_nm
        assert (wavelength[0], wavelength[-1]) == (400.0, 700.0)
        side = np.where(wavelength < peak, left, right)
        expected = np.exp(-(((wavelength - peak) / side) ** 2) / 2) / (1 + np.exp((wavelength - 680) / 8))
        np.testing.assert_allclose(curves[name].values, expected, atol=5.1e-7)
        assert f"{name}:" in GENERIC_RGB.read_text(encoding="utf-8")


def test_black_body_peaks_where_wien_says_and_is_straight_enough() -> None:
    curve = black_body(5500.0, 300.0, 900.0)
    assert curve.wavelengths_nm[np.argmax(curve.values)] == pytest.approx(2.897771955e6 / 5500, abs=0.6)
    coarse, fine = black_body(2000.0), black_body(2000.0, 300.0, 1100.0)
    middle = (coarse.wavelengths_nm[1:] + coarse.wavelengths_nm[:-1]) / 2
    exponent = 1.438776877e7 / (middle * 2000.0)
    exact = middle**-5 / np.expm1(exponent)
    peak = 1100.0**-5 / np.expm1(1.438776877e7 / (1100.0 * 2000.0))
    assert abs(fine.at(middle) - exact / peak).max() < 1e-5
    with pytest.raises(JobError, match="MF104"):
        black_body(10.0)
    with pytest.raises(JobError, match="MF112"):
        black_body(5500.0, 100.0)
    with pytest.raises(JobError, match="MF104"):
        black_body(5500.0, 500.0, 400.0)


def test_bands_weigh_by_the_light_that_falls() -> None:
    tungsten, blue_sky = (camera_bands(generic_rgb(), black_body(t))["green"].quadrature(8) for t in (2856.0, 12_000.0))
    plain = camera_bands(generic_rgb())["green"].quadrature(8)
    assert blue_sky.centroid_nm < plain.centroid_nm < tungsten.centroid_nm
    assert plain.weights.sum() == pytest.approx(1.0, abs=1e-12)
    with pytest.raises(JobError, match="do not overlap"):
        Band((generic_rgb()["red"], black_body(3000.0, 800.0, 900.0)), "nothing")


@pytest.mark.parametrize(
    ("wavelengths", "weights", "code"),
    [
        ([], [], "MF104"),
        ([199.0], [1.0], "MF112"),
        ([2001.0], [1.0], "MF112"),
        ([float("nan")], [1.0], "MF112"),
        ([500.0, 600.0], [1.0], "MF104"),
        ([500.0, 600.0], [1.5, -0.5], "MF104"),
        ([500.0, 600.0], [0.5, 0.6], "MF104"),
        ([500.0], [float("inf")], "MF104"),
    ],
)
def test_impossible_spectra_are_refused(wavelengths: list[float], weights: list[float], code: str) -> None:
    with pytest.raises(JobError, match=code):
        Spectrum(np.array(wavelengths), np.array(weights), "x")


@pytest.mark.parametrize(
    ("wavelengths", "values"),
    [([500.0], [1.0]), ([500.0, 500.0], [1, 1]), ([500.0, 600.0], [1.0]), ([500, 600], [0, 0])],
)
def test_impossible_curves_are_refused(wavelengths: list[float], values: list[float]) -> None:
    with pytest.raises(JobError, match="MF104"):
        Curve(np.array(wavelengths, dtype=float), np.array(values, dtype=float), "x")


HEADER = "wavelength_nm,a,b\n"


@pytest.mark.parametrize(
    ("content", "error", "code"),
    [
        ("", SourceError, "MF302"),
        ("# only a comment\n", SourceError, "MF302"),
        (HEADER + "500,1,1\n", SourceError, "MF303"),
        ("nm,a\n500,1\n600,1\n", SourceError, "MF303"),
        ("wavelength_nm,a,a\n500,1,1\n600,1,1\n", SourceError, "MF303"),
        (HEADER + "500,1\n600,1,1\n", SourceError, "MF303"),
        (HEADER + "500,1,x\n600,1,1\n", SourceError, "MF303.*line 2"),
        (HEADER + "600,1,1\n500,1,1\n", SourceError, "MF303.*ascend"),
        (HEADER + "100,1,1\n500,1,1\n", JobError, "MF112"),
        (HEADER + "500,1,-1\n600,1,1\n", JobError, "MF104"),
        (HEADER + "500,1,nan\n600,1,1\n", JobError, "MF104"),
        (HEADER + "500,1,0\n600,1,0\n", JobError, "MF104"),
    ],
)
def test_damaged_files_of_curves(tmp_path: Path, content: str, error: type[Exception], code: str) -> None:
    path = tmp_path / "camera.csv"
    path.write_text(content, encoding="utf-8")
    with pytest.raises(error, match=code):
        read_curves(path)


def test_files_of_curves(tmp_path: Path) -> None:
    with pytest.raises(SourceError, match="MF308"):
        read_curves(tmp_path / "camera.xlsx")
    with pytest.raises(SourceError, match="MF301"):
        read_curves(tmp_path / "camera.csv")
    path = tmp_path / "camera.csv"
    path.write_bytes(b"\xff\xfe\x00\x01")
    with pytest.raises(SourceError, match="MF304"):
        read_curves(path)
    path.write_text("\ufeff# made up\n\n" + HEADER + "500, 1, 0\r\n600,0.5,2e-1\n", encoding="utf-8")
    curves = read_curves(path)
    assert curves["a"].at(np.array([550.0, 499.0]))[0] == pytest.approx(0.75)
    assert curves["b"].at(np.array([499.0]))[0] == 0
