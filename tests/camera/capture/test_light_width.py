"""Lights that are no points are told from pictures that were blurred by another path, and points are not."""

from __future__ import annotations

import numpy as np
import pytest
from camera.capture.captured_dies import GAIN, READ_NOISE, exposed, phased_picture, polygon_picture
from hypothesis import given
from hypothesis import strategies as st
from optics_cases import camera, noise, panel
from scipy import ndimage

from maskfab.camera.frames.merge import merged
from maskfab.camera.inspection.die_image import OVERSAMPLING, DieImage, Setting, gaussian_nodes
from maskfab.camera.inspection.fit import brightest, expecting, fitted, taken_of
from maskfab.camera.inspection.identity import FWHM, with_width_and_terms
from maskfab.camera.inspection.measurement import measured
from maskfab.optics.spectrum import line_spectrum

CAMERA = camera(diameter_um=800.0, window_um=128.0)
DIE = panel(noise(8, 0.45, 3), cells=14, seed=5)
LIGHT = {"-": line_spectrum([530.0])}
STACK = (1.0, 4.0, 16.0, 64.0)
MIDDLE = (slice(12, -12),) * 2


@pytest.fixture(scope="module")
def picture():
    return polygon_picture(DIE, CAMERA, {530.0: 1.0}, bias_um=0.0, turn_rad=0.0)


def merging_of(picture, times=STACK, seed=1):
    return merged(exposed(picture, times, 1e4, seed), electrons_per_count=GAIN, read_noise_e=READ_NOISE)


def fit_of(picture, times=STACK, seed=1):
    merging = merging_of(picture, times, seed)
    taken = taken_of(merging, CAMERA.pixel_um, brightest(merging.planes))
    image = DieImage.of(DIE, 0, CAMERA, LIGHT, [each.pixels for each in taken])
    found = fitted(image, taken, Setting(terms=((4, 0.0),)))
    taken = expecting(image, taken, found.setting)
    _, fit, width = with_width_and_terms(image, taken, fitted(image, taken, found.setting))
    return fit, width


@pytest.mark.slow
def test_the_width_of_a_blurred_picture_is_found_beside_all_else():
    sigma_um, terms = 3.0, {"z4": 0.05, "z7": 0.04}
    fit, (width_um, error_um) = fit_of(phased_picture(DIE, CAMERA, ((4, 0.05), (7, 0.04)), sigma_um))
    assert abs(width_um - FWHM * sigma_um) < 3.5 * error_um < 0.05 * width_um
    assert fit.chi2 / fit.freedom < 1.1
    values = dict(zip(fit.setting.names, fit.setting.values, strict=True))
    assert len(fit.setting.terms) <= len(terms) + 1, "errors that the lens does not have"
    for name, value in {**terms, "bias_um": 0.0, "scale": 0.0}.items():
        assert abs(values[name] - value) < 4 * fit.errors[name], name


@pytest.mark.slow
def test_points_are_never_told_to_be_wide(picture):
    aberrated = phased_picture(DIE, CAMERA, ((7, 0.02), (12, 0.02), (14, -0.02)))
    untold = phased_picture(DIE, CAMERA, ((4, 0.05), (22, 0.03), (28, 0.03)))
    pictures = ((aberrated, STACK, 1), (untold, STACK, 1), (picture, (1.0,), 1), (picture, (1.0,), 2))
    assert [fit_of(*each)[1] for each in pictures] == [None] * 4


@given(st.floats(0.01, 8.0), st.floats(0.0, 0.5 / OVERSAMPLING))
def test_a_light_smooths_waves_as_a_gaussian_does(sigma, wave):
    places, weights = gaussian_nodes(sigma)
    assert weights @ np.cos(2 * np.pi * wave * places) == pytest.approx(
        np.exp(-2 * (np.pi * sigma * wave) ** 2), abs=2e-5
    )


def test_a_wide_light_is_said_and_a_point_is_not(picture):
    wide, point = (
        measured(merging_of(each, (1.0, 32.0)), {"ONE": DIE}, CAMERA, LIGHT, priced=False)
        for each in (ndimage.gaussian_filter(picture, 0.8)[MIDDLE], picture[MIDDLE])
    )
    assert any("The light is no point" in each for each in wide.sentences)
    assert [each.unit for each in wide.quantities if each.name == "captured_light_width"] == ["um"]
    assert not any("no point" in each for each in point.sentences)
