"""What a sensor makes of light, against its formulas; and light in its three statements."""

from __future__ import annotations

import math
import re

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats

from maskfab.api.camera import protocol_f1
from maskfab.base.errors import JobError
from maskfab.camera import sensor
from maskfab.camera.record import interpolated, sampled
from maskfab.camera.sensor import ELECTRONS, F1_SENSOR, Exposure, poisson_quantile, record_light, stated_light
from maskfab.job.camera import PHOTONS_PER_LUX_SECOND_UM2, Sensor

FLAT = np.full((3, 200, 200), 0.3, dtype=np.float32)


@pytest.mark.parametrize("sensor", [Sensor(), Sensor(bits=10, black_level=64, gain=1.0), Sensor(read_noise=0.0)])
def test_noise_has_the_mean_and_variance_that_the_record_states(sensor):
    electrons = Exposure.at(32, sensor).behind(0.2072)
    found = record_light(sensor, FLAT, electrons, 5)
    stated = float(found.noise.variance(np.float32(0.3)))
    assert stated == pytest.approx(
        0.3 / electrons + (sensor.read_noise**2 + sensor.step**2 / 12) / electrons**2, rel=1e-6
    )
    assert found.values.mean() == pytest.approx(0.3, abs=5 * np.sqrt(stated / FLAT.size))
    assert found.values.var() == pytest.approx(stated, rel=5 * np.sqrt(2 / FLAT.size))


def test_noise_follows_its_seed_and_stops_at_the_full_well():
    light = np.full((3, 20, 20), 2.0, dtype=np.float32)
    first = record_light(F1_SENSOR, light, ELECTRONS[40], 1)
    np.testing.assert_array_equal(first.values, record_light(F1_SENSOR, light, ELECTRONS[40], 1).values)
    assert not np.array_equal(
        record_light(F1_SENSOR, light, 100.0, 1).values, record_light(F1_SENSOR, light, 100.0, 2).values
    )
    np.testing.assert_allclose(first.values, F1_SENSOR.full_well / ELECTRONS[40], rtol=1e-6)
    assert first.clipped.all()
    assert not record_light(F1_SENSOR, light, 100.0, 1).clipped.any()


@pytest.mark.parametrize("banding", [None, 6.0])
def test_noise_that_is_kept_is_that_of_its_seed(monkeypatch, banding):
    light, taken = (
        np.random.default_rng(1).random((3, 40, 30), dtype=np.float32),
        Sensor(read_noise=2.0, banding=banding),
    )
    monkeypatch.setattr(sensor, "_AT_ONCE", 1000)
    kept = [record_light(taken, light, 900.0, 7).values for _ in range(2)]
    monkeypatch.setattr(sensor, "_MOST_KEPT", 0)
    for each in kept:
        np.testing.assert_array_equal(each, record_light(taken, light, 900.0, 7).values)


def test_a_converter_has_its_codes_and_cuts_the_dark_only_below_its_black_level():
    dark = np.zeros((3, 100, 100), dtype=np.float32)
    shallow, deep = Sensor(bits=12, gain=1.0), Sensor(bits=12, black_level=256, gain=1.0)
    assert record_light(shallow, dark, 1000.0, 3).values.min() == 0
    found = record_light(deep, dark, 1000.0, 3)
    assert found.values.min() < 0
    codes = found.values * 1000 / deep.step
    np.testing.assert_allclose(codes, np.rint(codes), atol=1e-3)
    full = record_light(deep, dark + 20, 1000.0, 3)
    assert full.values.max() == pytest.approx(deep.full_well / 1000, rel=1e-6)


@given(st.lists(st.floats(0, 1, width=32), min_size=9, max_size=9), st.integers(0, 3))
@settings(max_examples=30, deadline=None)
def test_a_mosaic_keeps_planes_exactly_and_what_it_recorded(numbers, turns):
    """The corrected means are exact for light that changes linearly, if colours change alike."""
    base, slope = np.float32(numbers[:3]), np.float32(numbers[3:5])
    y, x = np.mgrid[:12, :16].astype(np.float32)
    light = base[:, None, None] + slope[0] * y / 16 + slope[1] * x / 16
    light = np.ascontiguousarray(np.rot90(light, turns, axes=(1, 2)))
    seen = sampled(light)
    found = interpolated(seen)
    np.testing.assert_allclose(found[:, 2:-2, 2:-2], light[:, 2:-2, 2:-2], atol=2e-6)
    np.testing.assert_array_equal(sampled(found), seen)


@pytest.mark.parametrize(
    "stated",
    [
        {"full_well": 0.0},
        {"full_well": math.nan},
        {"read_noise": -1.0},
        {"read_noise": 2e4},
        {"black_level": 4},
        {"bits": 8, "black_level": 255},
        {"bits": 0},
        {"gain": 0.5},
        {"iso": 400.0},
        {"iso": 400.0, "base_iso": 100.0, "gain": 4.0},
        {"iso": 50.0, "base_iso": 100.0},
        {"gain": 8.0, "max_gain": 4.0},
        {"gain": 4000.0},
        {"converter_noise": -1.0},
        {"banding": 2e4},
        {"base_iso": 0.0},
    ],
)
def test_sensors_that_cannot_be_are_refused(stated):
    with pytest.raises(JobError, match="MF140"):
        Sensor(**stated)


def test_the_levels_of_the_protocol_are_the_published_numbers_of_electrons():
    assert dict(ELECTRONS) == {24: 273, 28: 654, 32: 1608, 36: 4005, 40: 10024}


@given(st.floats(5, 41), st.floats(0, 20))
@settings(max_examples=50, deadline=None)
def test_a_level_is_the_ratio_of_white_to_its_noise(level, read_noise):
    sensor = Sensor(read_noise=read_noise)
    found = Exposure.at(level, sensor)
    assert found.electrons / math.sqrt(found.electrons + read_noise**2) == pytest.approx(10 ** (level / 20))
    again = Exposure.of_white(found.electrons, sensor)
    assert again.level_db == pytest.approx(level)


def test_light_of_a_scene_by_hand():
    """500 cd/m2 behind f/2.5 and the published display: 13.02 lux, in 10 ms on 4 um^2 at 60 %."""
    found = Exposure.of_scene(500, 0.01, 0.6, focal_ratio=2.5, pixel_um=2, sensor=Sensor())
    lux = math.pi * 500 * 0.2072 / (4 * 2.5**2)
    photon = 6.62607015e-34 * 299792458 / 555e-9
    assert found.electrons == pytest.approx(lux * 0.01 / 683 / photon * 4e-12 * 0.6, rel=2e-3)
    assert pytest.approx(4.09e15 * 1e-12, rel=1e-9) == PHOTONS_PER_LUX_SECOND_UM2
    assert found.behind(0.4144) == pytest.approx(2 * found.electrons)


@pytest.mark.parametrize("level", [0.0, -3.0, math.nan, math.inf, 42.0])
def test_levels_without_light_or_above_a_full_well_are_refused(level):
    with pytest.raises(JobError, match="MF141"):
        Exposure.at(level, Sensor())


@pytest.mark.parametrize(
    "light",
    [
        lambda sensor, held: Exposure.at(held or 40, sensor),
        lambda sensor, held: Exposure.of_white(held or 9000, sensor),
        lambda sensor, held: Exposure.of_scene(
            5000, (held or 100) / 1e3, 0.6, focal_ratio=2.5, pixel_um=2, sensor=sensor
        ),
    ],
)
def test_a_light_that_a_full_well_does_not_hold_is_told_with_one_that_it_does(light):
    """As much of it as can be told in its digits: a twentieth more overflows again."""
    sensor = Sensor(full_well=6000.0)
    with pytest.raises(JobError, match="MF141") as caught:
        light(sensor, None)
    held = float(re.findall(r"[\d.]+", caught.value.cure)[0])
    assert light(sensor, held).electrons <= sensor.full_well
    with pytest.raises(JobError, match="MF141"):
        light(sensor, 1.05 * held)


@pytest.mark.parametrize(("full_well", "levels"), [(6000.0, (24, 32, 37.7)), (12000.0, (24, 32, 40)), (100.0, (19.0,))])
def test_levels_that_no_job_states_are_those_that_its_full_well_holds(full_well, levels):
    sensor = Sensor(full_well=full_well)
    held, words = stated_light(None, sensor, protocol_f1().model)
    assert held == levels
    assert all(Exposure.at(level, sensor).electrons <= full_well for level in held)
    assert ("full well" in words) == (levels[-1] != 40)


@pytest.mark.parametrize("transmission", [0.0, 1.5, math.nan])
def test_a_design_passes_some_light_and_no_more_than_all(transmission):
    with pytest.raises(JobError, match="MF104"):
        Exposure.at(24, Sensor()).behind(transmission)


@pytest.mark.parametrize("bits", [None, 10, 12])
def test_a_full_well_is_known_as_clipped_whatever_the_light_it_is_told_in(bits):
    """Units of white are no multiples of electrons, and are rounded: by one rounding for pixels and for the limit."""
    flash = np.full((3, 2, 2), 1e4, dtype=np.float32)
    for electrons in np.random.default_rng(0).uniform(50, 9000, 100):
        assert record_light(Sensor(bits=bits, black_level=16 if bits else 0), flash, electrons, 1).clipped.all()


@pytest.mark.parametrize("mean", [0.0, 0.05, 0.7, 3.99, 4.0, 4.5, 10, 30, 100, 3000])
def test_a_count_is_poissons_at_the_probability_of_its_normal_number(mean):
    """The exact quantile but for every 400th, off by one; below four electrons within rounding of probabilities."""
    normal = np.random.default_rng(3).standard_normal(40_000, dtype=np.float32)
    found = poisson_quantile(np.full(normal.size, mean, np.float32), normal)
    exact = stats.poisson.ppf(stats.norm.cdf(normal.astype(float)), np.float32(mean)) if mean else 0 * normal
    off = abs(found - exact)
    assert off.max() <= 1
    assert np.count_nonzero(off) <= (1 if mean < 4 else 120)
    assert found.mean(dtype=float) == pytest.approx(exact.mean(), abs=2e-3)


def test_noise_behind_one_design_is_paired_with_that_behind_another():
    """Of 2 % more light the noise is the same but for 1 % more, and what counting by whole electrons adds."""
    sensor = Sensor()
    light = np.random.default_rng(1).random((3, 100, 100), dtype=np.float32)
    one, more = (record_light(sensor, light, white, 9).values - light for white in (1000.0, 1020.0))
    assert (one - more).std() < 0.05 * one.std()
    assert np.corrcoef(one.ravel(), more.ravel())[0, 1] > 0.999
