"""Side lobes against Airy's pattern, gratings and brute force; none is told lower than it is."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from optics_cases import camera, noise, panel, pupil
from scipy.optimize import minimize_scalar
from scipy.special import j1

from maskfab.base.errors import InternalError
from maskfab.base.model import Psf
from maskfab.job.camera import Camera
from maskfab.optics.exact_psf import ExactPsf, sampled_field
from maskfab.optics.field.matrix import direct_field
from maskfab.optics.field.polygons import boundary
from maskfab.optics.psf import Leak, point_psf
from maskfab.optics.pupil import Pupil
from maskfab.optics.side_lobes import SideLobes, first_side_lobe, peak_to_side_lobe
from maskfab.optics.stop_edges import edges_in_stop
from maskfab.trials.hard_cases import clear_region

LEAK = 0.1 + 0.05j


def seen(source: Pupil, setting: Camera, line: float = 530.0, leak: Leak | None = None) -> ExactPsf:
    return ExactPsf.of(point_psf(source, setting, line), source, setting, leak)


def drawn(diameter: float = 480.0, window: float = 100.0, seed: int = 3) -> tuple[Pupil, Camera]:
    setting = camera(diameter, window_um=window)
    return pupil(panel(noise(7, 0.4, seed), cells=12, seed=seed), setting.stop), setting


def airy_psf(window: float = 30.0) -> ExactPsf:
    """(2 J1(a) / a)² itself, for a clear stop of dots has seams."""
    setting = camera(480.0, window_um=window)
    highest, half = 480.0 / 5300.0, 20

    def intensity(x: np.ndarray, y: np.ndarray) -> np.ndarray:
        argument = np.pi * highest * np.hypot(x, y[:, None])
        return np.where(argument == 0, 1.0, 2 * j1(argument) / np.where(argument == 0, 1.0, argument)) ** 2

    axis = setting.pixel_um / 2 * np.arange(-half, half + 1)
    samples = Psf(intensity(axis, axis), setting.pixel_um / 2, 530.0, "point")
    return ExactPsf(samples, intensity, 1.0, highest, 1e-15, True)


def test_the_ring_of_airy() -> None:
    """1.7498 % of the peak at 1.6347 λf/D (Born, Wolf, table 8.2), and closer by a search along a ray."""
    close = {"bounds": (4.5, 5.7), "method": "bounded", "options": {"xatol": 1e-11}}
    ring = minimize_scalar(lambda a: -((2 * j1(a) / a) ** 2), **close)
    psf = airy_psf()
    contrast, place = peak_to_side_lobe(psf), first_side_lobe(psf)
    assert abs(contrast.value + 1 / ring.fun) <= contrast.uncertainty < 1e-9
    assert abs(place.value - ring.x / np.pi / psf.highest) <= place.uncertainty < 0.02


def test_a_psf_without_side_lobes_has_none() -> None:
    def intensity(x: np.ndarray, y: np.ndarray) -> np.ndarray:
        return np.exp(-(x**2 + y[:, None] ** 2) / 50)

    axis = np.arange(-30.0, 31.0)
    psf = ExactPsf(Psf(intensity(axis, axis), 1.0, 530.0, "point"), intensity, 1.0, 0.4, 1e-15, True)
    assert peak_to_side_lobe(psf).value is None
    assert first_side_lobe(psf).value is None


def test_a_lobe_that_is_not_near_is_found_all_the_same() -> None:
    def intensity(x: np.ndarray, y: np.ndarray) -> np.ndarray:
        distance = np.hypot(x, y[:, None])
        return np.exp(-((distance / 4) ** 2) / 2) + 0.1 * np.exp(-((distance - 20.0) ** 2) / 8)

    axis = 0.5 * np.arange(-60, 61)
    psf = ExactPsf(Psf(intensity(axis, axis), 0.5, 530.0, "point"), intensity, 1.0, 0.5, 1e-15, True)
    assert first_side_lobe(psf).value == pytest.approx(20.0, abs=0.01)


def test_the_brightest_side_lobe_of_a_grating_is_its_first_order() -> None:
    mask = np.zeros((21, 21), dtype=np.bool_)
    mask[:, 8:13] = True
    setting = camera(1680.0, shape="square")
    psf = seen(pupil(panel(mask, cells=10), setting.stop), setting)
    assert abs(SideLobes(psf).brightest().distance_um - 5300.0 / 168.0) < 0.03
    assert peak_to_side_lobe(psf).value == pytest.approx(np.sinc(5 / 21) ** -2, rel=1e-3)


@pytest.mark.parametrize("leak", [None, LEAK])
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_no_place_off_the_middle_lobe_is_brighter(seed: int, leak: complex | None) -> None:
    """Against samples sixteen times as fine as the PSF's, from which a parabola was off by far more than it said."""
    source, setting = drawn(seed=seed)
    psf = seen(source, setting, leak=None if leak is None else Leak(leak, setting.stop))
    step = psf.samples.step_um / 16
    axis = step * np.arange(-400, 401)
    values = psf.intensity(axis, axis)
    inner = values[1:-1, 1:-1]
    lobes = np.all([inner >= values[1 + j : 800 + j, 1 + i : 800 + i] for j in (-1, 0, 1) for i in (-1, 0, 1)], axis=0)
    row, column = np.nonzero(lobes)
    away = np.hypot(axis[column + 1], axis[row + 1])
    off = away > 2 * step
    found = SideLobes(psf).brightest()
    near = SideLobes(psf).nearest()
    if found.distance_um < 400 * step / np.sqrt(2):
        assert inner[row[off], column[off]].max() <= found.intensity + found.error
        assert inner[row[off], column[off]].max() == pytest.approx(found.intensity, rel=1e-3)
    assert abs(away[off].min() - near.distance_um) < 2 * step


def test_the_contrast_does_not_depend_on_the_wavelength() -> None:
    """The window grows with it; its samples lie elsewhere on the same field."""
    source, setting = drawn(window=60.0)
    told = [
        peak_to_side_lobe(seen(source, replace(setting, window_um=60.0 * line / 530, wavelengths_nm=(line,)), line))
        for line in (470.0, 530.0, 610.0)
    ]
    assert max(q.value for q in told) - min(q.value for q in told) <= 2 * max(q.uncertainty for q in told) < 1e-9


def test_polygons_have_the_lobes_of_their_dots() -> None:
    laid_out = panel(noise(5, 0.4, 1), cells=6, seed=2)
    setting = camera(200.0, shape="square")
    edges, area = edges_in_stop(clear_region(laid_out), setting.stop, (0.0, 0.0))
    outline = boundary(edges, area, 0.02)
    source = pupil(laid_out, setting.stop)
    u = np.array([-0.01, 0.0, 0.003])
    np.testing.assert_allclose(
        sampled_field(outline, setting).at(u, u[1:]), direct_field(source, u, u[1:]), atol=1e-8 * area
    )
    points = point_psf(source, setting, 530.0)
    one, other = (ExactPsf.of(points, openings, setting, None) for openings in (source, outline))
    for told in (peak_to_side_lobe, first_side_lobe):
        assert abs(told(one).value - told(other).value) <= told(other).uncertainty


def test_a_sampled_field_tells_the_same_lobes_and_refuses_what_it_does_not_hold() -> None:
    source, setting = drawn()
    sampled, points = sampled_field(source, setting), point_psf(source, setting, 530.0)
    places = np.linspace(-50.0, 50.0, 23)
    exact, quick = (ExactPsf.of(points, source, setting, None, each) for each in (None, sampled))
    off = abs(np.sqrt(exact.intensity(places, places[3:9])) - np.sqrt(quick.intensity(places, places[3:9])))
    assert off.max() <= quick.rounding * np.sqrt(quick.most)
    for told in (first_side_lobe, peak_to_side_lobe):
        one, other = told(exact), told(quick)
        assert abs(one.value - other.value) <= one.uncertainty + other.uncertainty
    with pytest.raises(InternalError, match="MF901"):
        quick.intensity(np.array([60.0]), places)
