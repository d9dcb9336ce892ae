"""S-CIELAB of photographs against single waves and even fields."""

from __future__ import annotations

import numpy as np
import pytest

from maskfab.camera.scores import PIXELS_PER_DEGREE, Truth, seen
from maskfab.display.eye import OPPONENT_OF_RGB, gains
from maskfab.optics.colour import code_of_light, delta_e_1976, lab_of_linear_srgb


def test_an_even_field_keeps_its_colour():
    light = np.array([0.2, 0.5, 0.7])
    field = np.broadcast_to(code_of_light(light).astype(np.float32)[:, None, None], (3, 24, 40)).copy()
    np.testing.assert_allclose(seen(field), np.broadcast_to(lab_of_linear_srgb(light), (24, 40, 3)), atol=1e-3)


@pytest.mark.parametrize("k", [1, 5, 20, 39])
def test_a_wave_of_grey_fades_by_the_gain_of_its_frequency(k):
    wave = np.cos(np.pi * k * (np.arange(64) + 0.5) / 64)
    light = np.broadcast_to(0.4 + 0.3 * wave, (3, 16, 64))
    opponent = OPPONENT_OF_RGB.sum(axis=1)[:, None] * np.stack([np.full(64, 0.4), 0.3 * wave])[:, None]
    faded = opponent[0] + opponent[1] * gains(np.array(PIXELS_PER_DEGREE * k / 128))[:, None]
    expected = lab_of_linear_srgb((np.linalg.inv(OPPONENT_OF_RGB) @ faded).T)
    found = seen(code_of_light(light).astype(np.float32))
    np.testing.assert_allclose(found, np.broadcast_to(expected, (16, 64, 3)), atol=5e-3)


def test_a_difference_is_nought_with_itself_and_turns_with_the_picture():
    one, other = np.random.default_rng(1).random((2, 3, 24, 32)).astype(np.float32)
    assert Truth(one).delta_e(one).max() < 1e-3
    turned = Truth(np.ascontiguousarray(one[:, ::-1])).delta_e(np.ascontiguousarray(other[:, ::-1]))
    np.testing.assert_allclose(turned[::-1], Truth(one).delta_e(other), atol=2e-3)
    assert delta_e_1976(seen(one), seen(other)).mean() > 1
