"""The Fourier series of light is the one of its squares, at every frequency and on every grid."""

from __future__ import annotations

import numpy as np
import pytest

from maskfab.base.errors import JobError
from maskfab.display import emitted_light
from maskfab.display.emitted_light import Viewing, series


def light(rows: int, columns: int, samples: int = 1, seed: int = 0) -> emitted_light.EmittedLight:
    return emitted_light.ideal(np.random.default_rng(seed).random((rows, columns, 3)), samples, 100.0)


def brute(shown: emitted_light.EmittedLight, highest: float, viewing: Viewing) -> np.ndarray:
    """The integral over each square, by its closed form."""
    rows, columns = shown.rgb.shape[1:]
    found = []
    for size, count in ((rows, shown.pixels[0]), (columns, shown.pixels[1])):
        most = int(highest * count / viewing.pixels_per_degree)
        k = np.arange(-most, most + 1)[:, None]
        edges = np.arange(size + 1) / size
        with np.errstate(all="ignore"):
            part = np.diff(np.exp(-2j * np.pi * k * edges), axis=1) / (-2j * np.pi * k)
        part[k[:, 0] == 0] = 1 / size
        found.append(part)
    return np.einsum("ya,cab,xb->cyx", found[0], shown.rgb, found[1])


@pytest.mark.parametrize("highest", [3.0, 40.0])  # below and far above the grid's own Nyquist frequency
@pytest.mark.parametrize("shape", [(4, 4), (5, 3), (1, 1)])
def test_the_series_is_the_integral(shape, highest):
    viewing = Viewing(100.0, 60e3)  # 10.47 pixels per degree
    shown = light(*shape)
    exact = brute(shown, highest, viewing)
    half = exact.shape[2] // 2
    np.testing.assert_allclose(series(shown, viewing, highest).coefficients, exact[:, :, half:], rtol=0, atol=1e-14)


def test_finer_samples_of_the_same_light_have_the_same_series():
    viewing = Viewing(100.0, 300e3)
    one, many = light(6, 4, 1), light(6, 4, 7)
    np.testing.assert_allclose(
        series(one, viewing, 80.0).coefficients, series(many, viewing, 80.0).coefficients, rtol=0, atol=1e-14
    )


def test_values_are_the_sum_of_the_series():
    viewing = Viewing(100.0, 300e3)
    found = series(light(3, 4), viewing, 50.0)
    samples = 3
    y, x = ((np.arange(n * samples) + 0.5) / samples for n in (3, 4))
    turns_y = np.exp(2j * np.pi * np.outer(y * found.pixel_deg, found.y_cpd))
    turns_x = np.exp(2j * np.pi * np.outer(x * found.pixel_deg, found.x_cpd))
    twice = np.where(found.x_cpd > 0, 2.0, 1.0)
    direct = np.einsum("ya,cab,xb->cyx", turns_y, found.coefficients * twice, turns_x).real
    np.testing.assert_allclose(found.values(samples), direct, rtol=0, atol=1e-13)


def test_moving_the_light_by_one_pixel_rolls_it():
    viewing = Viewing(100.0, 300e3)
    found = series(light(4, 5), viewing, 50.0)
    moved = found.displaced(1.0, 2.0).values(2)
    np.testing.assert_allclose(moved, np.roll(found.values(2), (4, 2), axis=(1, 2)), rtol=0, atol=1e-13)


def test_too_few_and_too_many_samples_are_refused():
    near = series(light(10, 10), Viewing(100.0, 10e3), 59.0)
    with pytest.raises(ValueError, match="cannot carry"):
        near.values(2)
    with pytest.raises(JobError, match=r"MF115.*farther"):
        near.values(110)
    with pytest.raises(JobError, match=r"MF115.*farther"):
        series(light(100, 100), Viewing(100.0, 10e3), 59.0)


@pytest.mark.parametrize("distance_um", [0.0, -1.0, float("nan"), float("inf"), 1.0, 1e12])
def test_no_eye_is_there(distance_um):
    with pytest.raises(JobError, match=r"MF121.*10 mm to 100 m.*300 mm"):
        Viewing(84.0, distance_um)


def test_pixels_per_degree(telephone):
    assert telephone.pixels_per_degree == pytest.approx(61.84, abs=0.005)
    assert Viewing(84.0, 600e3).pixels_per_degree == pytest.approx(2 * Viewing(84.0, 300e3).pixels_per_degree)
    with pytest.raises(JobError, match="MF104"):
        Viewing(0.0, 300e3)
