"""Tables of curves as text: what is kept of them, and black bodies against Planck, Wien and Stefan-Boltzmann."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import quad

from maskfab.base.errors import JobError, SourceError
from maskfab.job.values import COLDEST_K, HOTTEST_K
from maskfab.optics.response import GENERIC_RGB, black_body, camera_bands, curves_text, parse_curves, read_curves

TABLE = "# a camera\nwavelength_nm,a,b\n400,0,1\n500,0,2\n600,1,0\n700,0,0\n800,0,0\n"

temperatures = st.floats(COLDEST_K, HOTTEST_K)


def test_a_file_and_its_text_hold_the_same_curves() -> None:
    from_file, from_text = read_curves(GENERIC_RGB), parse_curves(curves_text(GENERIC_RGB, "here"), "here")
    assert list(from_file) == list(from_text)
    for name, curve in from_file.items():
        assert np.array_equal(curve.wavelengths_nm, from_text[name].wavelengths_nm)
        assert np.array_equal(curve.values, from_text[name].values)


@pytest.mark.parametrize("mark", [b"", b"\xef\xbb\xbf"])
@pytest.mark.parametrize("line_end", ["\n", "\r\n"])
def test_the_text_is_the_same_from_any_editor(tmp_path: Path, line_end: str, mark: bytes) -> None:
    path = tmp_path / "camera.csv"
    path.write_bytes(mark + TABLE.replace("\n", line_end).encode())
    assert curves_text(path, "here") == TABLE


def test_rows_of_zeros_do_not_widen_a_band_and_do_not_change_it() -> None:
    curves = parse_curves(TABLE, "here")
    bands = camera_bands(curves)
    assert [band.range_nm for band in bands.values()] == [(500, 700), (400, 600)]
    places = np.linspace(390, 810, 421)
    for name, band in bands.items():
        assert np.array_equal(band.density(places), curves[name].at(places))


@pytest.mark.parametrize("row", [0, 1])
def test_one_row_of_light_is_a_band(row: int) -> None:
    values = [0, 0]
    values[row] = 3
    band = camera_bands(parse_curves(f"wavelength_nm,a\n400,{values[0]}\n500,{values[1]}\n", "here"))["a"]
    assert (band.range_nm, band.density(np.array([450.0]))[0]) == ((400, 500), 1.5)


def test_errors_name_the_place_that_was_given_and_its_line() -> None:
    with pytest.raises(SourceError) as damaged:
        parse_curves("wavelength_nm,a\n400,1\n\n500,x\n", "job.toml: scene.spectrum: camera.csv")
    assert damaged.value.where == "job.toml: scene.spectrum: camera.csv: line 4"
    with pytest.raises(SourceError) as missing:
        curves_text(Path("nowhere/camera.csv"), "job.toml: scene.spectrum")
    assert (missing.value.code, missing.value.where) == ("MF301", "job.toml: scene.spectrum")
    assert "nowhere/camera.csv" in missing.value.what


def test_curves_that_do_not_overlap_are_refused_where_the_light_is_named() -> None:
    light = parse_curves("wavelength_nm,lamp\n900,1\n1000,1\n", "here")["lamp"]
    with pytest.raises(JobError, match="a x lamp do not overlap") as caught:
        camera_bands(parse_curves(TABLE, "here"), light, "job.toml: scene.illuminant")
    assert (caught.value.code, caught.value.where) == ("MF104", "job.toml: scene.illuminant")


def planck(wavelength_nm: float, temperature_k: float) -> float:
    """Planck's law from h, c and k of the 2019 SI, in any unit."""
    planck_js, light_m_s, boltzmann_j_k = 6.62607015e-34, 299792458.0, 1.380649e-23
    exponent = planck_js * light_m_s / (wavelength_nm * 1e-9 * boltzmann_j_k * temperature_k)
    return float(wavelength_nm**-5 / math.expm1(exponent))


@given(temperatures)
def test_a_black_body_radiates_as_planck_says(temperature_k: float) -> None:
    curve = black_body(temperature_k, 400.0, 700.0)
    assert curve.values.max() == 1
    stated = np.array([planck(line, temperature_k) for line in curve.wavelengths_nm])
    assert curve.values == pytest.approx(stated / stated.max(), rel=1e-7)


@given(st.floats(1500.0, 14_000.0))
def test_a_black_body_peaks_where_wien_says(temperature_k: float) -> None:
    """2.897771955e6 nm K; the samples are one nanometre apart."""
    curve = black_body(temperature_k, 200.0, 2000.0)
    assert abs(curve.wavelengths_nm[np.argmax(curve.values)] - 2.897771955e6 / temperature_k) <= 1


@given(temperatures, temperatures)
def test_the_hotter_body_is_the_bluer(one: float, other: float) -> None:
    colder, hotter = sorted((one, other))
    cold, hot = (black_body(each, 400.0, 700.0).values for each in (colder, hotter))
    # The ratio of a hotter body to a colder one falls with the wavelength, for every pair.
    assert (np.diff(np.log(hot) - np.log(cold)) <= 1e-12).all()


def test_the_share_of_visible_light_is_that_of_plancks_integral() -> None:
    curve = black_body(5772.0, 200.0, 2000.0)
    inside = (curve.wavelengths_nm >= 400) & (curve.wavelengths_nm <= 700)
    share = np.trapezoid(curve.values[inside]) / np.trapezoid(curve.values)
    visible, all_light = (quad(planck, *ends, args=(5772.0,), epsrel=1e-10)[0] for ends in ((400, 700), (200, 2000)))
    assert share == pytest.approx(visible / all_light, rel=1e-5)


@pytest.mark.parametrize("temperature_k", [math.nextafter(COLDEST_K, 0), math.nextafter(HOTTEST_K, 1e9), math.nan])
def test_temperatures_out_of_range(temperature_k: float) -> None:
    with pytest.raises(JobError, match="MF104"):
        black_body(temperature_k)
