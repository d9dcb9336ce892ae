"""Lengths, pitches and wavelengths as people write them."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from maskfab.base.errors import JobError
from maskfab.base.units import dpi, parse_length_um, parse_pitch_um, parse_wavelength_nm, to_nm


def refused(code: str, function, text, **options) -> JobError:
    with pytest.raises(JobError) as caught:
        function(text, where="file: key", **options)
    error = caught.value
    assert error.code == code, str(error)
    assert error.where == "file: key"
    assert error.cure
    return error


@pytest.mark.parametrize(
    ("text", "um"),
    [
        ("168 um", 168.0), ("168um", 168.0), ("168 µm", 168.0), ("168 μm", 168.0), ("0.168 mm", 168.0),
        ("168000 nm", 168.0), ("1.68e-4 m", 168.0), (" 168  um ", 168.0), ("+168. um", 168.0), (".5 cm", 5000.0),
        ("5 in", 127_000.0), ("1 mil", 25.4), ("1E3 nm", 1.0),
    ],
)  # fmt: skip
def test_a_length_in_any_unit(text, um):
    assert parse_length_um(text) == um


@given(st.integers(1, 10**9))
def test_a_length_is_the_same_in_every_unit(nm):
    um = parse_length_um(f"{nm} nm")
    assert parse_length_um(f"{nm}e-3 um") == parse_length_um(f"{nm}e-6 mm") == parse_length_um(f"{nm}e-9 m") == um
    assert to_nm(um) == nm


@pytest.mark.parametrize(
    "text", ["168", 168, 168.0, "168 px", "168 UM", "168 dpi", "", "um", "1,5 um", "1 2 um", "0x1 um"]
)
def test_what_has_no_unit_of_length_is_refused(text):
    assert repr(text).strip("'") in refused("MF103", parse_length_um, text).what


@pytest.mark.parametrize("value", [None, True, False, [], {}, b"1 um", ["1 um"]])
def test_what_is_no_text_is_refused(value):
    refused("MF103", parse_length_um, value)


@pytest.mark.parametrize(
    "text", ["0 um", "-1 um", "-0 um", "nan um", "inf um", "-inf nm", "NaN mm", "Infinity m", "1e999 um"]
)
def test_what_is_no_length_is_refused(text):
    assert repr(text) in refused("MF104", parse_length_um, text).what


def test_zero_is_a_length_where_it_is_allowed():
    assert parse_length_um("0 um", zero_allowed=True) == 0
    assert "at least 0" in refused("MF104", parse_length_um, "-1 nm", zero_allowed=True).what


def test_150_dpi_is_not_the_pitch_that_is_called_so():
    assert parse_pitch_um("150 dpi") == pytest.approx(169.3333333, abs=1e-7)
    assert parse_pitch_um("150 PPI") == parse_pitch_um("150dpi") == 25400 / 150
    assert parse_pitch_um("168 um") == 168
    assert dpi(168) == pytest.approx(151.19, abs=0.005)


@given(st.floats(1, 1e4))
def test_a_density_is_a_pitch_and_back(density):
    assert math.isclose(dpi(parse_pitch_um(f"{density!r} dpi")), density, rel_tol=1e-15)


@pytest.mark.parametrize("text", ["0 dpi", "-1 dpi", "nan dpi", "inf ppi"])
def test_what_is_no_density_is_refused(text):
    assert repr(text) in refused("MF104", parse_pitch_um, text).what


@pytest.mark.parametrize(("text", "nm"), [("530 nm", 530), ("0.53 um", 530), ("200 nm", 200), ("2 um", 2000)])
def test_a_wavelength(text, nm):
    assert parse_wavelength_nm(text) == nm


@pytest.mark.parametrize("text", ["199.999 nm", "2000.001 nm", "530 um", "0.53 nm"])
def test_what_no_camera_sees_is_refused(text):
    problem = refused("MF112", parse_wavelength_nm, text)
    assert "200 nm to 2000 nm" in problem.what


def test_what_lies_off_the_database_grid_is_told_with_its_distance():
    assert to_nm(84.667) == 84667
    problem = refused("MF107", to_nm, 25400 / 300, name="pitch")
    assert "pitch 84.666667 um" in problem.what
    assert "1 nm" in problem.what
    assert "-0.333 nm" in problem.what
    assert "84.667 um" in problem.cure


@pytest.mark.parametrize("length", [1e308, -1e308, 1e13, math.inf, math.nan])
def test_a_length_beyond_what_nanometres_can_count_is_refused(length):
    assert "pitch" in refused("MF104", to_nm, length, name="pitch").what


@given(st.integers(-(10**9), 10**9))
def test_whole_nanometres_lie_on_the_grid(nm):
    assert to_nm(nm / 1000) == nm
