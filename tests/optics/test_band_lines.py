"""Bands of lamps, lasers and narrow filters as a few lines: no light lost, and no error larger than foretold."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.polynomial.legendre import leggauss
from optics_cases import camera, noise, panel, pupil
from sweeps import examples, in_turns, sweep

from maskfab.job.camera import Camera
from maskfab.optics.field import matrix
from maskfab.optics.psf import point_psf
from maskfab.optics.pupil import Pupil
from maskfab.optics.response import generic_rgb
from maskfab.optics.spectrum import BAND_SAFETY, Band, Curve, Spectrum, band_errors, band_lines, line_spectrum


def curve(name: str, *rows: tuple[float, float]) -> Curve:
    wavelengths, values = np.array(sorted(rows), dtype=np.float64).T
    return Curve(wavelengths, values, name)


def peak(middle: float, half_width: float, height: float, floor: float = 0.0) -> list[tuple[float, float]]:
    return [(middle - half_width, floor), (middle, height), (middle + half_width, floor)]


FLAT = curve("flat", (400, 1), (700, 1))
LAMPS = {
    "sodium": curve("sodium", (400, 1), *peak(589.3, 1.0, 1000, 1), (700, 1)),
    "lasers": curve("lasers", *peak(450, 1.0, 1), *peak(638, 0.05, 30)),
    "mercury": curve(
        "mercury", (400, 0.2), *peak(435.8, 1.2, 60, 0.3), *peak(546.1, 0.6, 90, 1), *peak(611, 2.0, 50, 1), (700, 0.1)
    ),
}
BANDS = {
    "sodium": Band((FLAT, LAMPS["sodium"]), "sodium"),
    "lasers": Band((FLAT, LAMPS["lasers"]), "lasers"),
    "mercury": Band((FLAT, LAMPS["mercury"]), "mercury"),
    "sodium in blue": Band((generic_rgb()["blue"], LAMPS["sodium"]), "sodium in blue"),
    "narrow filter": Band((FLAT, curve("filter", *peak(532.07, 0.01, 1)), LAMPS["mercury"]), "narrow filter"),
}


# It covers what a white band does, and takes hardly a line.
DARK_BUT_ONE = Band((FLAT, curve("laser", (400, 0), *peak(532.0, 0.01, 1), (700, 0))), "laser")


def fine_lines(band: Band, apart_nm: float) -> Spectrum:
    """Gauss-Legendre nodes between all rows, closer than a distance: brute force, but it sees every row."""
    low, high = band.range_nm
    rows = np.unique(np.concatenate([each.wavelengths_nm for each in band.curves]))
    rows = rows[(rows >= low) & (rows <= high)]
    parts = [np.linspace(a, b, max(1, math.ceil((b - a) / apart_nm)) + 1)[:-1] for a, b in itertools.pairwise(rows)]
    edges = np.append(np.concatenate(parts), rows[-1])
    nodes, weights = leggauss(4)
    half = np.diff(edges)[:, None] / 2
    places, energies = edges[:-1, None] + half * (1 + nodes), half * weights
    energies = energies * band.density(places)
    kept = energies > 0
    return line_spectrum(places[kept], energies[kept])


def psf(source: Pupil, setting: Camera, spectrum: Spectrum) -> np.ndarray:
    return sum(
        weight * point_psf(source, setting, float(line)).values
        for line, weight in zip(spectrum.wavelengths_nm, spectrum.weights, strict=True)
    )


@pytest.mark.parametrize("name", BANDS)
@pytest.mark.parametrize("panels", [1, 2, 7, 64])
def test_polynomials_have_the_bands_own_mean_over_its_lines(name: str, panels: int) -> None:
    band = BANDS[name]
    fine, found = fine_lines(band, 20.0), band.quadrature(panels)
    assert found.wavelengths_nm.size == 4 * panels
    for degree in range(6):
        expected, value = (each.weights @ ((each.wavelengths_nm - 550) / 150) ** degree for each in (fine, found))
        assert value == pytest.approx(expected, abs=1e-11)
    assert band.centroid_nm == pytest.approx(fine.centroid_nm, abs=1e-9)


@given(st.floats(401, 699), st.floats(1e-3, 1.0))
@examples(50)
def test_light_is_found_wherever_it_is(middle: float, half_width: float) -> None:
    band = Band((FLAT, curve("laser", *peak(middle, half_width, 1))), "laser")
    for count in (1, 4, 16):
        found = band_lines(band, count)
        assert (abs(found.wavelengths_nm - middle) <= half_width * (1 + 1e-9)).all()
        assert found.centroid_nm == pytest.approx(middle, abs=1e-9)


def check(name: str, diameter_um: float, seed: int | None, apart_nm: float) -> None:
    band = BANDS[name]
    setting = camera(diameter_um, wavelengths=band.range_nm, window_um=96.0)
    source = pupil(panel(noise(7, 0.5, 4), cells=2 * math.ceil((diameter_um / 2 + 20) / 56), seed=seed), setting.stop)
    exact = psf(source, setting, fine_lines(band, apart_nm))
    foretold = band_errors(source, setting, [band])
    assert foretold
    for count, error in foretold.items():
        real = np.linalg.norm(psf(source, setting, band_lines(band, count)) - exact) / np.linalg.norm(exact)
        print(f"{name:14} {diameter_um:6g} um {count:3} lines: foretold {error:.1e}, real {real:.1e}")
        # What is left is the brute force's own.
        assert real <= error + 1e-10, count
    assert min(foretold.values()) < 2e-3


@pytest.mark.parametrize(("die", "name"), sweep(in_turns([(50.0, None), (200.0, 1)], BANDS), len(BANDS)))
def test_lines_err_no_more_than_foretold(die: tuple[float, int | None], name: str) -> None:
    check(name, *die, 20.0)


@pytest.mark.slow
@pytest.mark.parametrize("name", BANDS)
@pytest.mark.parametrize("seed", [None, 1])
@pytest.mark.parametrize(("diameter_um", "apart_nm"), [(800.0, 2.0), (4000.0, 1.0)])
def test_lines_err_no_more_than_foretold_at_any_stop(
    name: str, seed: int | None, diameter_um: float, apart_nm: float
) -> None:
    check(name, diameter_um, seed, apart_nm)


def test_the_pupil_is_transformed_once_for_all_lines_of_a_band(monkeypatch: pytest.MonkeyPatch) -> None:
    calls = []
    term = matrix.WaveProduct.part

    def counted(self: matrix.WaveProduct, *arguments: object) -> object:
        calls.append(self)
        return term(self, *arguments)  # type: ignore[arg-type]

    monkeypatch.setattr(matrix.WaveProduct, "part", counted)
    band = BANDS["mercury"]
    setting = camera(400.0, wavelengths=band.range_nm, window_um=96.0)
    source = pupil(panel(noise(7, 0.5, 4), cells=8, seed=1), setting.stop)
    foretold = band_errors(source, setting, [band])
    assert sum(foretold) >= 5
    # Four parities of the whole dots and of either band of the rim.
    assert len(calls) <= 12


def test_more_bands_and_lines_look_at_the_field_no_more_often(monkeypatch: pytest.MonkeyPatch) -> None:
    calls = []
    at = matrix.SampledField.field

    def counted(self: matrix.SampledField, *arguments: object) -> object:
        calls.append(self)
        return at(self, *arguments)  # type: ignore[arg-type]

    monkeypatch.setattr(matrix.SampledField, "field", counted)
    white = Band((FLAT,), "white")
    setting = camera(400.0, wavelengths=(400.0, 700.0), window_um=96.0)
    source = pupil(panel(noise(7, 0.5, 4), cells=8, seed=1), setting.stop)
    looks, most = [], []
    for bands in ([DARK_BUT_ONE], [white, DARK_BUT_ONE, *BANDS.values()]):
        found = band_errors(source, setting, bands)
        looks.append(len(calls))
        most.append(max(found))
        calls.clear()
    assert looks[0] == looks[1]
    assert most[1] > most[0]


def test_the_worst_band_tells_the_error_of_a_number_of_lines_and_the_easiest_caps_none() -> None:
    """A narrow line of light stands still at once; a wide band takes more lines than the narrow one was tried with."""
    wide = Band((FLAT,), "white")
    setting = camera(400.0, wavelengths=(400.0, 700.0), window_um=96.0)
    source = pupil(panel(noise(7, 0.5, 4), cells=8, seed=1), setting.stop)
    both = band_errors(source, setting, [DARK_BUT_ONE, wide])
    easy, hard = (band_errors(source, setting, [band]) for band in (DARK_BUT_ONE, wide))
    assert max(easy) < max(hard) == max(both)
    assert all(both[count] >= error for alone in (easy, hard) for count, error in alone.items())
    assert both[max(both)] < 1e-6
    assert band_errors(source, setting, []) == {}


def test_rays_measure_the_window_as_its_places_do() -> None:
    band = Band((FLAT,), "white")
    # As wide as a whole number of the samples that it is held against.
    setting = camera(400.0, wavelengths=band.range_nm, window_um=94.0)
    source = pupil(panel(noise(7, 0.5, 4), cells=8, seed=1), setting.stop)
    foretold = band_errors(source, setting, [band])
    exact = psf(source, setting, band.quadrature(8))
    for count in (1, 4):
        real = np.linalg.norm(psf(source, setting, band_lines(band, count)) - exact) / np.linalg.norm(exact)
        assert foretold[count] == pytest.approx(BAND_SAFETY * real, rel=0.01)
