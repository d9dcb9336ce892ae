"""Lights that are no points are told from pictures that were blurred by another path, and points are not."""

from __future__ import annotations

import numpy as np
import pytest
from capture.captured_dies import GAIN, READ_NOISE, exposed, phased_picture, polygon_picture
from optics_cases import camera, noise, panel
from scipy import ndimage

from maskfab.capture.die_image import DieImage, Setting
from maskfab.capture.fit import expecting, fitted, with_terms
from maskfab.capture.light_width import light_width
from maskfab.capture.measured import measured
from maskfab.capture.merge import merged
from maskfab.capture.taken import brightest, taken_of
from maskfab.optics.image.spectrum import line_spectrum

CAMERA = camera(diameter_um=800.0, window_um=128.0)
DIE = panel(noise(8, 0.45, 3), cells=14, seed=5)
LIGHT = {"-": line_spectrum([530.0])}
STACK = (1.0, 4.0, 16.0, 64.0)


@pytest.fixture(scope="module")
def picture():
    return polygon_picture(DIE, CAMERA, {530.0: 1.0}, bias_um=0.0, turn_rad=0.0)


def merging_of(picture, times=STACK, seed=1):
    return merged(exposed(picture, times, 1e4, seed), electrons_per_count=GAIN, read_noise_e=READ_NOISE)


def told(picture, times=STACK, seed=1):
    merging = merging_of(picture, times, seed)
    taken = taken_of(merging, CAMERA.pixel_um, brightest(merging.planes))
    image = DieImage.of(DIE, 0, CAMERA, LIGHT, [each.pixels for each in taken])
    found = fitted(image, taken, Setting(terms=((4, 0.0),)))
    taken = expecting(image, taken, found.setting)
    return light_width(image, taken, with_terms(image, taken, fitted(image, taken, found.setting)))


def test_the_width_of_a_blurred_picture_is_found(picture):
    pixels = 1.5
    found = told(ndimage.gaussian_filter(picture, pixels))
    assert found.um == pytest.approx(2 * np.sqrt(2 * np.log(2)) * pixels * CAMERA.pixel_um, rel=0.03)
    assert found.error_um < 0.02 * found.um


def test_points_are_never_told_to_be_wide(picture):
    aberrated = phased_picture(DIE, CAMERA, ((7, 0.02), (12, 0.02), (14, -0.02)))
    assert [told(aberrated), told(picture, (1.0,)), told(picture, (1.0,), 2)] == [None] * 3


def test_a_wide_light_is_said_and_a_point_is_not(picture):
    wide, point = (
        measured(merging_of(each), {"ONE": DIE}, CAMERA, LIGHT)
        for each in (ndimage.gaussian_filter(picture, 0.8), picture)
    )
    assert any("The light is no point" in each for each in wide.verdict)
    assert [each.unit for each in wide.quantities if each.name == "captured_light_width"] == ["um"]
    assert not any("no point" in each for each in point.verdict)
