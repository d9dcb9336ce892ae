"""The simulator of captures against optics in closed form, against polygons, and against what a sensor does."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import scipy
from camera.capture.captured_dies import phased_picture, polygon_picture
from capture_simulator import Dots, Optics, Sensor, Stack, picture, record, srgb8, zernike
from optics_cases import camera, noise, panel

CAMERA = camera(diameter_um=800.0, window_um=128.0)
DIE = panel(noise(8, 0.45, 3), cells=14, seed=5)
OPTICS = Optics(800.0, CAMERA.focal_um, CAMERA.pixel_um, 63, {530.0: 1.0})


def test_a_clear_stop_makes_airy_s_picture():
    open_dot = Dots(np.array([-500.0, 500.0]), np.array([-500.0, 500.0]), np.ones((1, 1)))
    optics = replace(OPTICS, pixel_um=0.5, pixels=121)
    found = picture(open_dot, optics)
    axis = 0.5 * (np.arange(121) - 60)
    fine = axis[60:61] + 0.5 * (np.arange(40) + 0.5) / 40 - 0.25
    scale = np.pi * 800.0 / (0.53 * CAMERA.focal_um)

    def mean(x, y):
        v = scale * np.hypot(x + fine, (y + fine)[:, None])
        return ((2 * scipy.special.j1(v) / v) ** 2).mean()

    # The whole light of Airy's picture is 4π over the square of the scale.
    expected = np.array([mean(x, 3.0) for x in axis]) * 0.25 * scale**2 / (4 * np.pi)
    assert np.abs(found[60 - 6] - expected).max() < 1e-3 * found.max()
    assert found.sum() == pytest.approx(0.97, abs=0.02)


def test_a_slit_makes_a_sinc_that_moves_with_the_light_and_its_line():
    slit = Dots(np.array([-40.0, 40.0]), np.array([-20.0, 20.0]), np.ones((1, 1)))
    found = picture(slit, replace(OPTICS, pixel_um=0.5, lines={530.0: 1.0, 610.0: 3.0}), (1.3, -0.7))
    axis = 0.5 * (np.arange(63) - 31)

    def at(line):
        scale = line * 1e-3 * CAMERA.focal_um
        x, y = np.sinc(80 * (axis - 1.3) / scale) ** 2, np.sinc(40 * (-axis + 0.7) / scale) ** 2
        return 80 * 40 / scale**2 * 0.25 * y[:, None] * x

    # The mean over a pixel of half a micrometre is that of its middle to 1e-5.
    assert found == pytest.approx(at(530.0) / 4 + 3 * at(610.0) / 4, abs=1e-4 * found.max())


@pytest.mark.parametrize("bias_um", [0.0, 0.15, -0.2])
def test_pictures_of_written_polygons(bias_um):
    expected = polygon_picture(DIE, CAMERA, {530.0: 1.0}, bias_um=bias_um, turn_rad=0.0)
    found = picture(Dots.of(DIE).grown(bias_um), OPTICS)
    assert np.linalg.norm(found - expected) < 1e-3 * np.linalg.norm(expected)


def test_pictures_behind_a_lens_with_errors():
    terms = {4: 0.05, 7: 0.04, 11: -0.03}
    expected = phased_picture(DIE, CAMERA, tuple(terms.items()))
    found = picture(Dots.of(DIE), replace(OPTICS, terms=terms))
    assert np.linalg.norm(found - expected) < 1e-3 * np.linalg.norm(expected)


def test_terms_are_orthonormal_on_the_disc():
    axis = np.linspace(-1, 1, 401)
    x, y = np.meshgrid(axis, axis)
    inside = np.hypot(x, y) < 1
    terms = np.stack([zernike(k, x[inside], y[inside]) for k in range(1, 12)])
    assert terms @ terms.T / inside.sum() == pytest.approx(np.eye(11), abs=0.02)


def test_a_gutter_stays_dark():
    gap = panel(noise(8, 0.45, 3), cells=3, seed=5, gutter_nm=2000)
    dots = Dots.of(gap)
    assert dots.x_um[[0, -1]] == pytest.approx([-98.0, 98.0])
    assert dots.clear.shape == (26, 26)
    assert not dots.clear[8].any()
    assert (dots.clear[:8, :8] == gap.pattern(int(gap.orientations[0, 0]))).all()


def test_a_sensor_blooms_bands_and_counts():
    light, random = np.zeros((21, 9)), np.random.default_rng(1)
    light[10, 4] = 1e5
    sensor = Sensor(read_noise_e=0.0, full_well_e=3e4, electrons_per_count=1.0, black=100.0)
    spilt = sensor.counts(light, random) - 100.0
    assert spilt.sum() == pytest.approx(1e5, rel=0.02)
    assert spilt[10, 4] == 3e4
    assert (spilt[8:13, 4] > 0).all()
    assert not spilt[:, 5].any()
    even = np.full((200, 200), 1000.0)
    counts = Sensor(banding_e=20.0).counts(even, random)
    assert counts.mean() == pytest.approx(512 + 1000 / 1.3, rel=0.01)
    assert counts.mean(axis=1).std() == pytest.approx(20 / 1.3, rel=0.2)
    assert counts.std(axis=1).mean() == pytest.approx(np.hypot(np.sqrt(1000), 4.87) / 1.3, rel=0.02)


def test_stacks_drift_and_are_shaded_and_records_are_convolved():
    light, dust = np.full((16, 16), 1e-3), np.ones((16, 16))
    dust[3, 5] = 0.5
    stack = Stack(light, (1.0, 2.0), dust=dust, drift=(1.0, 1.1), beneath_e=0.0)
    one, two = (1.3 * (each.counts - 512.0) for each in stack.frames(0))
    assert one.mean() == pytest.approx(1e4, rel=0.01)
    assert two.mean() == pytest.approx(2.2e4, rel=0.01)
    assert two[3, 5] == pytest.approx(1.1e4, rel=0.05)
    point = np.zeros((32, 32))
    point[16, 16] = 1.0
    taken = record(point, np.full((5, 5), 0.04), 1e6, 0)
    assert taken[14:19, 14:19] == pytest.approx(0.04, abs=1e-3)
    assert abs(taken).sum() == pytest.approx(1.0, abs=0.02)
    assert srgb8(np.array([0.0, 0.5, 1.0])).tolist() == [0, 188, 255]
