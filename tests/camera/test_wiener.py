"""The Wiener filter's limits, and quality against its definition."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.fft

from maskfab.camera.imaging import Margin
from maskfab.camera.restorers.wiener import prior, wiener
from maskfab.camera.scores import Truth, inner, psnr


def picture(shape=(64, 96)):
    return np.random.default_rng(0).random((3, *shape)).astype(np.float32)


def test_without_blur_noise_or_prior_the_record_comes_back():
    scene, margin = picture(), Margin((64, 96), 16)
    one = np.ones((3, 64, 49), dtype=np.float32)
    record = margin.blurred(scipy.fft.rfft2(scene), one)
    np.testing.assert_allclose(record, margin.sensor(scene), atol=1e-6)
    found = margin.blurred(margin.mirrored(record), wiener(one, prior((64, 96)), 0.0))
    np.testing.assert_allclose(found, margin.sensor(scene), atol=1e-6)


def test_a_scene_that_is_its_own_mirror_is_unblurred_exactly():
    """Then the light from outside the sensor is what the filter takes it for."""
    margin, y, x = Margin((64, 96), 16), np.arange(64)[:, None], np.arange(96)
    # Even about the sensor's edge pixels, rows 16 and 47, columns 16 and 79, as far as the margin reaches.
    scene = 0.5 + 0.4 * np.cos(np.pi * (y - 16) / 31) * np.cos(np.pi * (x - 16) / 63)
    scene = np.broadcast_to(scene, (3, 64, 96)).astype(np.float32)
    wanted = np.fft.rfft2(np.pad(margin.sensor(scene), [(0, 0), (16, 16), (16, 16)], mode="reflect"))
    np.testing.assert_allclose(margin.mirrored(margin.sensor(scene)), wanted, atol=2e-3)


def test_mirroring_in_two_steps_is_mirroring():
    margin, record = Margin((64, 96), 16), picture((32, 64))
    wanted = np.fft.rfft2(np.pad(record, [(0, 0), (16, 16), (16, 16)], mode="reflect"))
    np.testing.assert_allclose(margin.mirrored(record), wanted, atol=1e-3)


def test_a_few_columns_at_a_time_are_filtered_as_all_at_once():
    margin, draw = Margin((200, 300), 24), np.random.default_rng(4)
    plane = draw.random((152, 252), dtype=np.float32)
    transfer = draw.random((200, 151), dtype=np.float32)
    found = margin.filtered(plane, lambda part: transfer[:, part])
    np.testing.assert_allclose(found, margin.blurred(margin.mirrored(plane[None]), transfer[None])[0], atol=1e-6)


def test_the_filter_inverts_where_noise_is_none_and_gives_up_where_there_is_nothing():
    transfer = np.array([1.0, 0.5, 1e-3, 0.0], dtype=np.float32)
    inverse_prior = np.array([0.0, 1.0, 1.0, 0.0], dtype=np.float32)
    np.testing.assert_allclose(wiener(transfer, inverse_prior, 0.0), [1, 2, 1000, 0], rtol=1e-6)
    found = wiener(transfer, inverse_prior, 0.1)
    np.testing.assert_allclose(found, [1, 0.5 / 0.35, 1e-3 / 0.100001, 0], rtol=1e-5)


def test_the_prior_is_one_at_a_tenth_of_a_cycle():
    assert prior((40, 40))[4, 0] == pytest.approx(1)
    assert prior((40, 40))[0, 0] == 0


def test_psnr_of_a_known_error():
    scene = np.full((3, 20, 20), 0.5, dtype=np.float32)
    assert psnr(scene + np.float32(0.1), scene) == pytest.approx(20, abs=1e-4)
    assert psnr(scene, scene) == np.inf


def test_ssim_is_one_for_equal_pictures_and_its_formula_for_flat_ones():
    scene = picture()
    np.testing.assert_allclose(Truth(scene).ssim(scene), 1, atol=1e-5)
    flat = np.full((3, 30, 30), 0.5, dtype=np.float32)
    wanted = (2 * 0.5 * 0.25 + 1e-4) / (0.25 + 0.0625 + 1e-4)
    np.testing.assert_allclose(Truth(flat).ssim(flat / 2), wanted, rtol=2e-3)


def test_the_inner_frame():
    assert inner(picture(), 10).shape == (3, 44, 76)
    assert inner(picture(), 0).shape == (3, 64, 96)
