"""The aliased MTF against samples of the PSF itself."""

from __future__ import annotations

import numpy as np
import pytest
from optics_cases import camera, noise, panel, pupil

from maskfab.base.errors import InternalError, JobError
from maskfab.job.camera import Camera, Stop
from maskfab.optics.field.matrix import direct_field
from maskfab.optics.lags import lag_table
from maskfab.optics.mtf import aliased_mtf, cy_per_pixel, phase_spread
from maskfab.optics.psf import image_scale_um2
from maskfab.optics.spectrum import line_spectrum, pixel_transfer, polychromatic_otf

GREEN = line_spectrum([530.0])


def test_point_samples_transform_to_the_sum_of_aliases() -> None:
    """A clear square stop has the PSF sinc² sinc², whose samples fall off fast enough to be summed one by one."""
    side, scale, pixel = 400.0, 5300.0, 9.0
    setting = Camera(10_000.0, Stop("square", side), (530.0,), pixel, 128.0)
    table = lag_table(pupil(panel(np.ones((5, 5), dtype=np.bool_), cells=10), setting.stop))
    nu = np.linspace(0.0, 0.05, 11)
    found = aliased_mtf(table, setting, GREEN, nu, 0 * nu, sampled="point", phases=4)
    n = np.arange(-20_000, 20_001)
    for k, phase in enumerate(found.phases):
        samples = np.sinc(side * pixel * (n + phase) / scale) ** 2
        along_x = abs(np.exp(-2j * np.pi * nu[:, None] * pixel * n) @ samples) / samples.sum()
        # The row's phase cancels: the PSF is a product, and the frequency lies on the x axis.
        np.testing.assert_allclose(found.values[:, k], np.broadcast_to(along_x, (4, nu.size)), atol=3e-5)


def test_sampling_above_twice_the_cutoff_shows_the_presampled_mtf() -> None:
    setting = Camera(10_000.0, Stop("square", 320.0), (530.0,), 2.0, 64.0)
    table = lag_table(pupil(panel(noise(8, 0.4, 1), cells=5), setting.stop))
    nu = np.linspace(0.0, 0.06, 13)
    plain = abs(polychromatic_otf(table, setting, GREEN, nu, nu / 2))
    for sampled, pixel in (("point", 1.0), ("pixel", abs(pixel_transfer(setting, nu, nu / 2)))):
        found = aliased_mtf(table, setting, GREEN, nu, nu / 2, sampled="pixel" if sampled == "pixel" else "point")
        np.testing.assert_allclose(found.lowest, plain * pixel, atol=1e-12)
        np.testing.assert_allclose(found.highest, plain * pixel, atol=1e-12)
        assert phase_spread(found, plain * pixel).value == pytest.approx(0.0, abs=1e-12)


def test_aliases_of_a_panel_against_its_own_samples() -> None:
    """Samples of |F|² by the direct transform, windowed wide: the sum of aliases must come out of them."""
    setting = Camera(10_000.0, Stop("square", 320.0), (530.0,), 8.0, 64.0)
    source = pupil(panel(noise(8, 0.4, 1), cells=5, seed=2), setting.stop)
    scale = image_scale_um2(setting, 530.0)
    # All energy lies within a few λf/dot = 662.5 µm.
    n = np.arange(-500, 501)
    nu = np.array([0.0, 0.02, 0.045])
    found = aliased_mtf(lag_table(source), setting, GREEN, nu, 0 * nu, sampled="point", phases=2)
    for j, phase_y in enumerate(found.phases):
        for i, phase_x in enumerate(found.phases):
            u, v = 8.0 * (n + phase_x) / scale, 8.0 * (n + phase_y) / scale
            samples = (abs(direct_field(source, u, v)) ** 2).sum(axis=0)
            expected = abs(np.exp(-2j * np.pi * nu[:, None] * 8.0 * n) @ samples) / samples.sum()
            np.testing.assert_allclose(found.values[j, i], expected, atol=1e-2)


def test_a_two_micrometre_grid_makes_the_published_mtf_depend_on_its_phase() -> None:
    """Point samples 2 µm apart of a 4 mm stop's PSF: nulls of a slit panel fill up, differently for each phase."""
    mask = np.zeros((21, 21), dtype=np.bool_)
    mask[1:19, 8:13] = True
    setting = camera(4000.0)
    table = lag_table(pupil(panel(mask, cells=25), setting.stop))
    nu = np.array([0.24])
    assert abs(polychromatic_otf(table, setting, GREEN, nu, 0 * nu))[0] < 1e-12
    found = aliased_mtf(table, setting, GREEN, nu, 0 * nu, sampled="point")
    assert 0.03 < found.lowest[0] < 0.08
    assert 0.08 < found.highest[0] < 0.13
    spread = phase_spread(found, np.zeros(1))
    assert spread.value == pytest.approx(found.highest[0])
    assert spread.uncertainty == found.uncertainty


def test_pixel_means_always_sum_to_one() -> None:
    setting = camera(4000.0)
    table = lag_table(pupil(panel(noise(21, 0.3, 2), cells=25, seed=0), setting.stop))
    found = aliased_mtf(table, setting, GREEN, np.zeros(1), np.zeros(1), sampled="pixel")
    np.testing.assert_allclose(found.values, 1.0, atol=1e-15)


def test_polychromatic_aliases_stop_at_each_lines_cutoff() -> None:
    setting = Camera(10_000.0, Stop("square", 320.0), (530.0,), 8.0, 64.0)
    table = lag_table(pupil(panel(noise(8, 0.4, 1), cells=5), setting.stop))
    nu = np.linspace(0.0, 0.06, 7)
    both = aliased_mtf(table, setting, line_spectrum([420.0, 680.0]), nu, 0 * nu, sampled="pixel", phases=1)
    each = [
        aliased_mtf(table, setting, line_spectrum([w]), nu, 0 * nu, sampled="pixel", phases=1) for w in (420.0, 680.0)
    ]
    assert (both.values <= (each[0].values + each[1].values) / 2 + 1e-12).all()


def test_refusals() -> None:
    setting = camera(480.0)
    source = pupil(panel(noise(7, 0.4, 3), cells=10), setting.stop)
    with pytest.raises(JobError, match="MF104"):
        aliased_mtf(lag_table(source), setting, GREEN, np.zeros(1), np.zeros(1), phases=0)
    with pytest.raises(InternalError, match="MF901"):
        aliased_mtf(lag_table(source, 50.0), setting, GREEN, np.array([0.05]), np.zeros(1))


def test_frequencies_per_pixel() -> None:
    assert cy_per_pixel(np.array([250.0]), 2.0)[0] == 0.5
