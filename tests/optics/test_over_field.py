"""Tangential and sagittal MTF from a PSF over a window, against the lag table."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from optics_cases import camera, noise, panel, pupil

from maskfab.base.model import Psf
from maskfab.optics.lags import lag_table
from maskfab.optics.mtf import presampled_mtf
from maskfab.optics.psf import point_psf
from maskfab.optics.scene.point_images import restored_error, sagittal_cut, tangential_cut, window_modulation
from maskfab.optics.spectrum import pixel_transfer


@given(st.floats(0, 7), st.floats(0.01, 400))
def test_tangential_frequencies_lie_along_the_radius_and_sagittal_ones_across(azimuth: float, frequency: float) -> None:
    radius = np.array([np.cos(azimuth), np.sin(azimuth)])
    tangential = np.array(tangential_cut(np.array(frequency), azimuth))
    sagittal = np.array(sagittal_cut(np.array(frequency), azimuth))
    assert tangential @ radius == pytest.approx(frequency)
    assert sagittal @ radius == pytest.approx(0.0, abs=1e-9 * max(1.0, frequency))
    assert np.linalg.norm(sagittal) == pytest.approx(frequency)


def test_a_window_has_the_mtf_of_the_lag_table_but_for_the_light_outside() -> None:
    setting = camera(480.0, window_um=256.0)
    source = pupil(panel(noise(7, 0.8, 3), cells=10, seed=2), setting.stop)
    seen = point_psf(source, setting, 530.0)
    exact = presampled_mtf(lag_table(source), setting, 530.0)
    nu = 1e-3 * exact.frequency_cy_per_mm
    for cut, azimuth in (("horizontal", 0.0), ("diagonal", np.pi / 4), ("vertical", np.pi / 2)):
        chosen = tangential_cut(nu, azimuth)
        optics, outside = window_modulation(seen, *chosen)
        found = optics * pixel_transfer(setting, *chosen)
        assert 0 < outside < 0.5
        assert abs(found - exact.cuts[cut]).max() <= outside
        # Away from zero, where all of the missing light is missed.
        assert abs(found - exact.cuts[cut])[20:].max() < outside / 3
        across, _ = window_modulation(seen, *sagittal_cut(nu, azimuth - np.pi / 2))
        assert across == pytest.approx(optics, abs=1e-12)


def test_a_picture_is_restored_best_by_its_own_blur_and_loses_by_less_light() -> None:
    rng = np.random.default_rng(2)
    own, other = (Psf(rng.uniform(0, 1, (15, 15)) ** 4, 2.0, 530.0, "pixel") for _ in range(2))
    least = restored_error(own, own, 0.015)
    assert least < restored_error(own, other, 0.015)
    assert least < restored_error(own, own, 0.015, light=0.25)
    # Without blur all frequencies keep S / (S + e) of themselves.
    point = np.zeros((15, 15))
    point[7, 7] = 3.0
    f = np.hypot(*np.meshgrid(*2 * [np.fft.fftfreq(15)]))
    power = 0.01 / f[f > 0] ** 2
    sharp = Psf(point, 2.0, 530.0, "pixel")
    expected = (power * 0.015 / (power + 0.015)).sum() / power.sum()
    assert restored_error(sharp, sharp, 0.015) == pytest.approx(expected)
