"""Exposures merged: variance and mean against their formulas, full wells left out without a bias."""

from __future__ import annotations

import numpy as np
import pytest

from maskfab.camera.brackets import merged
from maskfab.camera.record import Noise, Record
from maskfab.errors import JobError

WELL = 15_506.0
SIZE = (3, 128, 128)


def exposures(light, electrons, seed=0):
    """Of the same light, with as many electrons of white each."""
    draw = np.random.default_rng(seed)
    light = np.broadcast_to(np.asarray(light, dtype=np.float32), SIZE)
    found = []
    for g in electrons:
        counted = draw.poisson(light * g) + 4.87 * draw.standard_normal(SIZE)
        found.append(Record((np.minimum(counted, WELL) / g).astype(np.float32), Noise(g, 4.87), WELL / g))
    return found


def test_a_flat_field_has_the_variance_of_the_formula():
    electrons, light = (1000.0, 4000.0, 16_000.0), 0.5
    record = merged(exposures(light, electrons))
    wanted = 1 / sum(1 / (light / g + (4.87 / g) ** 2) for g in electrons)
    count = record.values.size
    assert record.values.var(dtype=np.float64) == pytest.approx(wanted, rel=5 * np.sqrt(2 / count))
    assert record.values.mean(dtype=np.float64) == pytest.approx(light, abs=5 * np.sqrt(wanted / count))
    assert record.variance.mean(dtype=np.float64) == pytest.approx(wanted, rel=0.01)


@pytest.mark.parametrize("share", [0.98, 0.99, 1.0, 1.01, 1.02])
def test_light_about_a_full_well_is_told_within_noise(share):
    electrons = 4000.0, 64_000.0
    light = share * WELL / electrons[1]
    record = merged(exposures(light, electrons))
    long, error = np.sqrt(light / electrons[1]), 5 * np.sqrt(light / electrons[0] / record.values.size)
    assert -0.45 * long - error < record.values.mean(dtype=np.float64) - light < error


def test_light_clipped_by_the_long_exposure_is_that_of_the_short():
    short, long = exposures(0.9, (4000.0, 64_000.0))
    assert long.clipped.all()
    record = merged([long, short])
    np.testing.assert_allclose(record.values, short.values, rtol=1e-6)
    np.testing.assert_allclose(record.variance, short.variance, rtol=1e-5)


def test_light_that_all_clip_is_clipped():
    record = merged(exposures(3.0, (16_000.0, 64_000.0)))
    assert record.clipped.all()
    np.testing.assert_allclose(record.values, WELL / 16_000)
    assert np.isfinite(record.variance).all()


def test_more_exposures_never_know_less_of_dim_light():
    light = np.geomspace(1e-4, 0.9, SIZE[2])
    taken = exposures(light, (4000.0, 16_000.0, 64_000.0))
    one, two, three = (merged(taken[:k]).variance.mean(axis=(0, 1)) for k in (1, 2, 3))
    assert (two[:100] < one[:100] / 3.5).all()
    assert (three[:80] < two[:80] / 3).all()


def test_the_order_of_exposures_does_not_matter():
    taken = exposures(np.geomspace(1e-3, 0.9, SIZE[2]), (4000.0, 16_000.0, 64_000.0))
    np.testing.assert_array_equal(merged(taken).values, merged(taken[::-1]).values)


def test_one_exposure_is_itself():
    (record,) = exposures(np.linspace(0, 4, SIZE[2]), (4000.0,))
    np.testing.assert_allclose(merged([record]).values, record.values, rtol=1e-6)
    np.testing.assert_array_equal(merged([record]).clipped, record.clipped)


@pytest.mark.parametrize(("sizes", "code"), [((), "MF105"), ((8, 9), "MF121")])
def test_nothing_to_merge_is_refused(sizes, code):
    taken = [Record(np.zeros((3, 4, n), np.float32), Noise(100.0, 1.0)) for n in sizes]
    with pytest.raises(JobError) as caught:
        merged(taken)
    assert caught.value.code == code
