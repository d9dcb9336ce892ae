"""Lights that are no points are told from pictures that were blurred by another path, and points are not."""

from __future__ import annotations

import numpy as np
import pytest
from camera.capture.captured_dies import GAIN, READ_NOISE, exposed, phased_picture, polygon_picture
from optics_cases import camera, noise, panel
from scipy import ndimage

from maskfab.camera.frames.merge import merged
from maskfab.camera.inspection.bench import FULL, LIGHT_BELL, LIGHT_DISC, light_transfer
from maskfab.camera.inspection.bench_search import with_bench_and_terms
from maskfab.camera.inspection.die_image import DieImage, Setting, smoothed
from maskfab.camera.inspection.fit import brightest, expecting, fitted, taken_of
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
    return with_bench_and_terms(image, taken, fitted(image, taken, found.setting))


@pytest.mark.slow
def test_the_width_of_a_blurred_picture_is_found_beside_all_else():
    sigma_um, terms = 3.0, {"z4": 0.05, "z7": 0.04}
    fit = fit_of(phased_picture(DIE, CAMERA, ((4, 0.05), (7, 0.04)), sigma_um))
    square, error = dict(fit.setting.bench)[LIGHT_BELL], fit.errors[LIGHT_BELL]
    assert abs(square - sigma_um**2) < 3.5 * error < 0.1 * square
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
    assert not any({LIGHT_BELL, LIGHT_DISC} & {*dict(fit_of(*each).setting.bench)} for each in pictures)


@pytest.mark.parametrize("name", [LIGHT_BELL, LIGHT_DISC])
def test_a_light_smooths_a_wave_by_its_transfer(name):
    """Points of the light, one by one, against the transfer."""
    width, per_um, wave = 6.0, 0.5, 0.11
    places = np.linspace(-4, 4, 401) * width
    x, y = np.meshgrid(places, places)
    light = np.hypot(x, y) <= width / 2
    if name == LIGHT_BELL:
        light = np.exp(-4 * np.log(2) * (x**2 + y**2) / width**2)
    share = (light * np.cos(2 * np.pi * wave * x)).sum() / light.sum()
    rows = np.arange(600) / per_um
    seen = smoothed(
        np.broadcast_to(np.cos(2 * np.pi * wave * rows)[:, None], (600, 600)).copy(),
        per_um,
        light_transfer({name: (width / FULL[name]) ** 2}),
    )
    middle = slice(200, 400), slice(200, 400)
    expected = share * np.cos(2 * np.pi * wave * rows)[middle[0], None]
    assert seen[middle] == pytest.approx(np.broadcast_to(expected, (200, 200)), abs=0.004)


def test_a_wide_light_is_said_and_a_point_is_not(picture):
    wide, point = (
        measured(merging_of(each, (1.0, 32.0)), {"ONE": DIE}, CAMERA, LIGHT, priced=False)
        for each in (ndimage.gaussian_filter(picture, 0.8)[MIDDLE], picture[MIDDLE])
    )
    assert any("The light is no point" in each for each in wide.sentences)
    assert [each.unit for each in wide.quantities if each.name == "captured_light_width"] == ["um"]
    assert not any("no point" in each for each in point.sentences)
