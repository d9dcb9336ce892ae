"""Scale and defocus of near objects, against quadrature and against what the estimates promise."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.polynomial.legendre import leggauss
from optics_cases import camera, defocused_psf, focused_psf, noise, panel, pupil

from maskfab.base.errors import JobError
from maskfab.base.model import Panel
from maskfab.job.camera import Camera, Stop
from maskfab.optics.field.matrix import direct_field
from maskfab.optics.metrics import relative_difference
from maskfab.optics.phase import (
    clear_stop_strehl,
    defocus_error,
    edge_defocus_waves,
    image_distance_um,
    nearest_object_um,
    scale_error,
    stretch_sensitivity,
)
from maskfab.optics.psf import pixel_margin, pixel_psf, point_psf
from maskfab.optics.tiling_mean import mean_psf

LINE = 530.0
FOCAL = 10_000.0


def stripes(cells: int = 4) -> Panel:
    mask = np.zeros((21, 21), dtype=np.bool_)
    mask[1:19, 8:13] = True
    return panel(mask, cells=cells, seed=1)


@given(st.floats(1.001, 1e6))
def test_the_lens_equation(ratio: float) -> None:
    image = image_distance_um(FOCAL, ratio * FOCAL)
    assert 1 / image + 1 / (ratio * FOCAL) == pytest.approx(1 / FOCAL, rel=1e-9)


def test_infinity_and_what_has_no_image() -> None:
    assert image_distance_um(FOCAL, math.inf) == FOCAL
    assert image_distance_um(FOCAL, 2 * FOCAL) == 2 * FOCAL
    for distance in (FOCAL, 0.5 * FOCAL, -1.0, -math.inf, math.nan):
        with pytest.raises(JobError, match="MF104"):
            image_distance_um(FOCAL, distance)


def test_a_near_object_in_focus_is_a_stretched_psf() -> None:
    """At 2 f the image lies at 2 f: every other sample of the PSF is one of the PSF at infinity, over four."""
    setting = camera(200.0, window_um=96.0)
    source = pupil(panel(noise(5, 0.4, 3), cells=6, seed=2), setting.stop)
    far, near = point_psf(source, setting, LINE), focused_psf(source, setting, LINE, 2 * FOCAL)
    middle = far.values.shape[0] // 2
    reach = middle // 2
    stretched = near.values[middle - 2 * reach : middle + 2 * reach + 1 : 2, middle]
    np.testing.assert_allclose(stretched * 4, far.values[middle - reach : middle + reach + 1, middle], rtol=1e-8)


def test_defocus_against_quadrature_of_the_exact_path() -> None:
    """A clear round stop: polar quadrature of Fresnel's integral between the lens and the sensor."""
    setting = camera(200.0, window_um=96.0)
    source = pupil(panel(np.ones((5, 5), dtype=np.bool_), cells=6), setting.stop)
    found = defocused_psf(source, setting, LINE, 50_000.0, 200_000.0, tolerance=1e-8)
    sensor, image = image_distance_um(FOCAL, 200_000.0), image_distance_um(FOCAL, 50_000.0)
    nodes, weights = leggauss(80)
    r, a = 50.0 * (nodes + 1), 2 * np.pi * np.arange(160) / 160
    x, y = (r[:, None] * np.cos(a)).ravel(), (r[:, None] * np.sin(a)).ravel()
    w = np.repeat(50.0 * weights * r * 2 * np.pi / 160, 160)
    number = 2 * np.pi / (LINE * 1e-3)
    wave = w * np.exp(-0.5j * number * (x**2 + y**2) / image)
    middle = found.values.shape[0] // 2
    for k, m in ((0, 0), (5, 3), (11, -9)):
        sx, sy = k * found.step_um, m * found.step_um
        spread = np.exp(0.5j * number * ((sx - x) ** 2 + (sy - y) ** 2) / sensor)
        expected = abs(wave @ spread / (LINE * 1e-3 * sensor)) ** 2 / setting.stop.area_um2
        assert found.values[middle + m, middle + k] == pytest.approx(expected, rel=1e-5)


def test_the_sign_of_defocus() -> None:
    """An opening on the right, its focus behind the sensor: its blur still lies on the right."""
    mask = np.zeros((8, 8), dtype=np.bool_)
    mask[3:5, 6:] = True
    setting = camera(400.0, window_um=400.0)
    source = pupil(panel(mask, dot_nm=50_000, cells=1), setting.stop)
    found = defocused_psf(source, setting, LINE, 50_000.0)
    across = found.step_um * (np.arange(found.values.shape[0]) - found.values.shape[0] // 2)
    centroid = float(found.values.sum(axis=0) @ across / found.values.sum())
    # 150 um off axis, sensor at f, focus at z' = 1.25 f: 150 (1 - f / z') = 30 um.
    assert centroid == pytest.approx(30.0, rel=0.1)


@pytest.mark.parametrize("object_um", [80_000.0, 300_000.0])
def test_strehl_of_the_clear_stop(object_um: float) -> None:
    setting = camera(300.0, window_um=32.0)
    source = pupil(panel(np.ones((5, 5), dtype=np.bool_), cells=8), setting.stop)
    sharp = point_psf(source, setting, LINE).values
    blurred = defocused_psf(source, setting, LINE, object_um).values
    middle = sharp.shape[0] // 2
    edge = edge_defocus_waves(setting, LINE, object_um, math.inf)
    assert edge == pytest.approx(150.0**2 / (2 * 0.53 * object_um))
    assert blurred[middle, middle] / sharp[middle, middle] == pytest.approx(clear_stop_strehl(edge), abs=1e-5)


def test_in_focus_there_is_no_phase() -> None:
    setting = camera(200.0, window_um=64.0)
    source = pupil(panel(noise(5, 0.4, 3), cells=6, seed=2), setting.stop)
    near = focused_psf(source, setting, LINE, 70_000.0)
    assert relative_difference(defocused_psf(source, setting, LINE, 70_000.0, 70_000.0), near) < 1e-9
    assert defocus_error(setting, LINE, 70_000.0, 70_000.0) == 0


@pytest.mark.parametrize("shape", ["circle", "square"])
@pytest.mark.parametrize("object_um", [200_000.0, 1_000_000.0])
def test_estimate_of_leaving_defocus_out(shape: str, object_um: float) -> None:
    setting = camera(400.0, shape=shape, window_um=96.0)
    source = pupil(stripes(), setting.stop)
    change = relative_difference(defocused_psf(source, setting, LINE, object_um), point_psf(source, setting, LINE))
    mean = mean_psf(stripes(), setting, LINE)
    assert 0.25 < change / defocus_error(setting, LINE, object_um, mean=mean) < 1.6
    assert change < defocus_error(setting, LINE, object_um)


@pytest.mark.parametrize("object_um", [1e5, 1e6, 1e7])
def test_estimate_of_leaving_the_scale_out(object_um: float) -> None:
    setting = camera(400.0)
    source = pupil(stripes(), setting.stop)
    far = point_psf(source, setting, LINE)
    change = relative_difference(focused_psf(source, setting, LINE, object_um), far)
    assert scale_error(far, setting, object_um) == pytest.approx(change, rel=0.2)


def test_depth_at_which_it_matters() -> None:
    """The planner's question: the answer, tried out, costs what was asked for; nearer costs more, wider stops too."""
    setting = camera(400.0)
    source = pupil(stripes(), setting.stop)
    far = point_psf(source, setting, LINE)
    for error in (0.01, 0.05):
        distance = nearest_object_um(far, setting, error)
        assert scale_error(far, setting, distance) == pytest.approx(error, rel=1e-6)
        assert relative_difference(focused_psf(source, setting, LINE, distance), far) == pytest.approx(error, rel=0.1)
    wide = replace(setting, stop=Stop("circle", 600.0))
    assert stretch_sensitivity(point_psf(pupil(stripes(), wide.stop), wide, LINE)) > stretch_sensitivity(far)
    with pytest.raises(JobError, match="MF104"):
        nearest_object_um(far, setting, 1.0)


def test_wide_pixels_hardly_see_the_depth() -> None:
    """Pixels wider than the speckle average most of it away, and what is left moves less than a pixel."""
    setting = Camera(FOCAL, Stop("circle", 600.0), (LINE,), 16.0, 320.0)
    source = pupil(stripes(), setting.stop)
    margin = pixel_margin(setting)
    points = [point_psf(source, setting, LINE, margin), focused_psf(source, setting, LINE, 1e6, margin)]
    pixels = [pixel_psf(each, setting) for each in points]
    assert relative_difference(*pixels[::-1]) < 0.75 * relative_difference(*points[::-1])


def test_the_transform_scale_matches_direct_summation() -> None:
    setting = camera(200.0, window_um=32.0)
    source = pupil(panel(noise(5, 0.4, 3), cells=6, seed=2), setting.stop)
    found = focused_psf(source, setting, LINE, 30_000.0)
    scale = LINE * 1e-3 * 15_000.0
    u = np.array([0.0, found.step_um * 3 / scale])
    expected = abs(direct_field(source, u, u)) ** 2 / (scale**2 * source.energy_um2)
    middle = found.values.shape[0] // 2
    np.testing.assert_allclose(found.values[middle : middle + 4 : 3, middle : middle + 4 : 3], expected, rtol=1e-9)
