"""The Wiener filter's response and noise: closed forms, limits, and no NaN on the way to ε = 0."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from optics_cases import camera, noise, panel, pupil

from maskfab.base.errors import JobError
from maskfab.base.model import Mtf
from maskfab.job.camera import Camera
from maskfab.optics import metrics
from maskfab.optics.lags import LagTable, axis_lags, lag_table
from maskfab.optics.mtf import presampled_mtf
from maskfab.optics.psf import image_scale_um2
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
    return SensorSquare(modulation, uncertainty, 530.0)


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


@pytest.mark.parametrize("scenes", [range(2), pytest.param(range(2, 42), marks=pytest.mark.slow)], ids=["2", "40"])
def test_bars_of_restoration_and_aliasing_hold_the_truth_and_leave_the_value_to_see(scenes: range) -> None:
    """Against every frequency exact, twice as fine, and against the exact lags along both axes."""
    told = []
    for scene in scenes:
        random = np.random.default_rng(scene)
        setting, dots = (
            camera(float(random.uniform(800, 1500)), random.choice(["circle", "square"])),
            5 + 5 * (scene % 3),
        )
        laid_out = panel(noise(dots, random.uniform(0.2, 0.8), scene), cells=1700 // (8 * dots), seed=scene)
        source, line = pupil(laid_out, setting.stop), float(random.choice([470.0, 530.0]))
        table = lag_table(source)
        mtf = presampled_mtf(table, setting, line)
        axis = (np.arange(256) - 127.5) / (2.0 * 256)
        x, y = (each.ravel() for each in np.meshgrid(axis, axis[128:]))
        scale = image_scale_um2(setting, line)
        modulation = abs(table.otf(scale * x, scale * y)) * np.sinc(2 * x) * np.sinc(2 * y)
        true = [np.sort(wiener_response(modulation, 0.015))[: int(0.3 * x.size)].mean()]
        true += [np.sqrt(np.mean(restoration_gain(modulation, 0.015) ** 2)), *aliasing(table, setting, mtf)]
        found = metrics.restoration_quantities(table, setting, line, None)
        found += metrics.aliasing_quantities(axis_lags(source, table.energy_um2), table, mtf, setting, None)
        for quantity, exact in zip(found, true, strict=True):
            assert abs(float(quantity.value or 0) - exact) <= float(quantity.uncertainty or 0) + 1e-14
            if exact > 0.02:
                told.append(float(quantity.uncertainty or 0) / exact)
    assert np.median(told) < 0.1
    assert max(told) < 0.25


def aliasing(table: LagTable, setting: Camera, mtf: Mtf) -> tuple[float, float]:
    """Largest distance of the aliased MTF from the presampled one, and its largest swing, by every exact lag."""
    nu, orders, scale = 1e-3 * mtf.frequency_cy_per_mm, np.arange(-3, 4), image_scale_um2(setting, mtf.wavelength_nm)
    alias = nu + orders[:, None] / setting.pixel_um
    turn = np.exp(2j * np.pi * np.arange(16)[:, None] / 16 * orders)
    lag = np.minimum(scale * abs(alias), setting.stop.diameter_um).ravel()
    distance, swing = [], []
    for x, y in ((lag, 0 * lag), (0 * lag, lag)):
        parts = table.otf(x, y).reshape(alias.shape) * np.sinc(alias * setting.pixel_um)
        values = abs(turn @ parts)
        distance.append(abs(values - abs(parts[3])).max())
        swing.append((values.max(axis=0) - values.min(axis=0)).max())
    return max(distance), max(swing)
