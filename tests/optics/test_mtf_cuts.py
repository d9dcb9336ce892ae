"""The reported MTF's cuts, along the axes and at 45 degrees to them, against sums over the point PSF."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from optics_cases import camera, noise, panel, pupil

from maskfab.optics.lags import lag_table
from maskfab.optics.mtf import longest_lag_um, presampled_mtf
from maskfab.optics.psf import image_scale_um2, point_psf

CAMERA = camera(1000.0, window_um=1800.0)
# Dots so large that nearly all light falls within the window of the PSF; without any symmetry.
PUPIL = pupil(panel(noise(4, 0.4, 3), dot_nm=60_000, cells=6), CAMERA.stop)
LINE_NM = 530.0


@pytest.fixture(scope="module")
def psf():
    # Points half a pixel apart: a sum of points repeats its spectrum at 2 cycles per pixel.
    return point_psf(PUPIL, replace(CAMERA, pixel_um=1.0), LINE_NM)


@pytest.mark.parametrize(
    ("cut", "normal_deg"), [("horizontal", 0.0), ("vertical", 90.0), ("diagonal", 45.0), ("antidiagonal", -45.0)]
)
def test_a_cut_is_the_transform_of_the_psf_along_its_direction(psf, cut, normal_deg):
    table = lag_table(PUPIL, longest_lag_um(CAMERA))
    told = presampled_mtf(table, CAMERA, LINE_NM)
    place = psf.step_um * (np.arange(len(psf.values)) - len(psf.values) // 2)
    x, y = np.cos(np.radians(normal_deg)), np.sin(np.radians(normal_deg))
    expected, exact = [], []
    for nu in told.frequency_cy_per_mm / 1000:
        across, up = (np.exp(-2j * np.pi * nu * part * place) for part in (x, y))
        pixel = np.sinc(nu * x * CAMERA.pixel_um) * np.sinc(nu * y * CAMERA.pixel_um)
        expected.append(abs(up @ psf.values @ across * pixel) * psf.step_um**2)
        lag = nu * image_scale_um2(CAMERA, LINE_NM) * np.array([[x], [y]])
        exact.append(abs(table.otf(*lag)[0] * pixel))
    np.testing.assert_allclose(told.cuts[cut], exact, atol=told.uncertainty + table.uncertainty)
    # Light outside the PSF's window, 1.4 % of all, changes no more than its share.
    np.testing.assert_allclose(told.cuts[cut], expected, atol=1 - psf.energy_in_window)
