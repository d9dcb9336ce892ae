"""The Wiener filter's response and noise: closed forms, limits, and no NaN on the way to ε = 0."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from optics_cases import camera, noise, panel, pupil

from maskfab.base.errors import JobError
from maskfab.optics.lags import lag_table
from maskfab.optics.restoration import (
    SensorSquare,
    noise_gain,
    restoration_gain,
    sensor_square,
    wiener_response,
    worst_wiener,
)
from maskfab.optics.spectrum import line_spectrum


def square(modulation: np.ndarray, uncertainty: float = 1e-15) -> SensorSquare:
    return SensorSquare(modulation, 0.01, uncertainty, 530.0)


@given(st.floats(0, 1), st.floats(1e-12, 1))
def test_response_and_gain_are_their_formulas(modulation: float, ratio: float) -> None:
    found = wiener_response(np.array([modulation]), ratio)[0]
    assert found == pytest.approx(modulation**2 / (modulation**2 + ratio), rel=1e-12, abs=1e-300)
    gain = restoration_gain(np.array([modulation]), ratio)[0]
    assert gain * modulation == pytest.approx(found, rel=1e-12, abs=1e-300)
    assert gain <= 0.5 / np.sqrt(ratio) * (1 + 1e-12)


@given(st.floats(0, 1), st.floats(5e-324, 1))
def test_nothing_is_nan_on_the_way_to_no_noise(modulation: float, ratio: float) -> None:
    assert 0 <= wiener_response(np.array([modulation]), ratio)[0] <= 1


def test_limit_without_noise() -> None:
    np.testing.assert_array_equal(wiener_response(np.array([0.0, 1e-300, 1.0]), 0.0), [0.0, 1.0, 1.0])
    np.testing.assert_allclose(restoration_gain(np.array([0.5, 1.0]), 0.0), [2.0, 1.0])
    with pytest.raises(JobError, match="without bound"):
        restoration_gain(np.array([0.0, 1.0]), 0.0)


@pytest.mark.parametrize("ratio", [-1e-3, float("nan"), float("inf")])
def test_impossible_noise(ratio: float) -> None:
    for function in (wiener_response, restoration_gain):
        with pytest.raises(JobError, match="MF104"):
            function(np.ones(3), ratio)
    for metric in (worst_wiener, noise_gain):
        with pytest.raises(JobError, match="MF104"):
            metric(square(np.ones((4, 8))), ratio)


def test_a_flat_modulation_has_closed_forms() -> None:
    flat = square(np.full((8, 16), 0.5))
    assert worst_wiener(flat, 0.25).value == pytest.approx(0.5, rel=1e-14)
    assert noise_gain(flat, 0.25).value == pytest.approx(1.0, rel=1e-14)
    assert noise_gain(flat, 0.0).value == pytest.approx(2.0, rel=1e-14)
    assert worst_wiener(flat, 0.0).value == 1.0
    assert worst_wiener(flat, 0.25).uncertainty == pytest.approx(0.0, abs=1e-14)


def test_the_worst_thirty_per_cent_are_the_lowest() -> None:
    modulation = np.linspace(0.1, 1.0, 200).reshape(10, 20)
    expected = np.mean(modulation.ravel()[:60] ** 2 / (modulation.ravel()[:60] ** 2 + 0.015))
    assert worst_wiener(square(modulation), 0.015).value == pytest.approx(expected, rel=1e-12)


@given(st.integers(0, 1000), st.floats(1e-4, 0.5), st.floats(1e-6, 0.05))
def test_error_bars_hold_every_admissible_modulation(seed: int, ratio: float, uncertainty: float) -> None:
    random = np.random.default_rng(seed)
    stated = random.random((6, 12))
    true = np.clip(stated + random.uniform(-uncertainty, uncertainty, stated.shape), 0, None)
    for metric in (worst_wiener, noise_gain):
        found, exact = metric(square(stated, uncertainty), ratio), metric(square(true), ratio)
        assert abs(found.value - exact.value) <= found.uncertainty * (1 + 1e-9) + 1e-15


def test_open_stop_against_its_own_modulation() -> None:
    """Clear square stop: triangle x sinc along each axis, so every number is a product of known ones."""
    setting = camera(4000.0, shape="square")
    table = lag_table(pupil(panel(np.ones((5, 5), dtype=np.bool_), cells=100), setting.stop))
    found = sensor_square(table, setting, line_spectrum([530.0]), 128)
    axis = (np.arange(128) - 63.5) / (2.0 * 128)
    along = (1 - abs(axis) * 5300.0 / 4000.0) * np.sinc(axis * 2.0)
    np.testing.assert_allclose(found.modulation, along[64:, None] * along, atol=1e-12)
    ideal = noise_gain(found, 0.0)
    assert ideal.value == pytest.approx(np.mean(along**-2.0), rel=1e-12)
    assert (
        abs(noise_gain(sensor_square(table, setting, line_spectrum([530.0])), 0.0).value - ideal.value)
        < ideal.uncertainty
    )


def test_nulls_are_refused_without_noise_and_finite_with_it() -> None:
    mask = np.zeros((21, 21), dtype=np.bool_)
    mask[:, 8:13] = True
    setting = camera(1680.0, shape="square")
    table = lag_table(pupil(panel(mask, cells=10), setting.stop))
    found = sensor_square(table, setting, line_spectrum([530.0]))
    for metric in (worst_wiener, noise_gain):
        with pytest.raises(JobError, match=r"MF104.*modulation falls to"):
            metric(found, 0.0)
    gains = [noise_gain(found, ratio).value for ratio in (1e-2, 1e-6, 1e-12)]
    assert np.isfinite(gains).all()
    assert gains[0] < gains[1] < gains[2]
    assert 0 <= worst_wiener(found, 1e-12).value < 1e-6


def test_more_noise_restores_less() -> None:
    setting = camera(480.0)
    found = sensor_square(
        lag_table(pupil(panel(noise(7, 0.5, 3), cells=10), setting.stop)), setting, line_spectrum([530.0])
    )
    values = [worst_wiener(found, ratio).value for ratio in (1e-4, 1e-3, 1e-2, 1e-1)]
    assert values == sorted(values, reverse=True)
    assert found.wavelength_nm == 530.0
    with pytest.raises(JobError, match="MF104"):
        sensor_square(
            lag_table(pupil(panel(noise(7, 0.5, 3), cells=10), setting.stop)),
            setting,
            line_spectrum([530.0]),
            samples=7,
        )
