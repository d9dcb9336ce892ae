"""Exposures merged: variance and mean against their formulas, full wells left out without a bias."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pytest
import scipy.fft
from once import leaves

from maskfab.base.errors import JobError
from maskfab.camera.protocol import F1, Protocol, evaluate
from maskfab.camera.record import MergedNoise, Noise, Record, merged
from maskfab.camera.restorers.dct import denoised, stabilised, unbiased
from maskfab.camera.scenes import Photograph, lit
from maskfab.camera.stop_cells import lay

BAR = lay("bar", np.pad(np.ones((6, 17), dtype=np.bool_), ((0, 15), (0, 4))))
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


@dataclass(frozen=True)
class Halo:
    """A design: half of the light in a Gaussian of 20 pixels, the other half sharp."""

    name: str = "halo"
    transmission: float = 0.2

    def on(self, shape):
        y, x = scipy.fft.fftfreq(shape[0])[:, None], scipy.fft.rfftfreq(shape[1])
        wide, sharp = (np.exp(-2 * (np.pi * s) ** 2 * (y**2 + x**2)) for s in (20, 0.6))
        return np.broadcast_to((wide + sharp) / 2, (3, *wide.shape)).astype(np.float32)

    def blurred(self, light, margin):
        return margin.through(light, self.on(margin.shape))


@pytest.mark.parametrize("light", [0.002, 0.02, 0.2, 0.5, 2.0, 3.5])
def test_merged_light_has_one_noise_once_it_is_stabilised_and_comes_back_without_a_bias(light):
    """Full wells at 0.24, 0.97 and 3.9 of white: every light but the last is in another company of exposures."""
    record = merged(exposures(light, (4000.0, 16_000.0, 64_000.0)))
    stable = stabilised(record.values, record.noise)
    assert stable.var(dtype=np.float64) == pytest.approx(1, abs=0.08)
    back = float(unbiased(np.float32([stable.mean(dtype=np.float64)]), record.noise)[0])
    sigma = float(np.sqrt(record.noise.variance(np.float32([light])))[0])
    assert back == pytest.approx(light, abs=0.04 * sigma)


def test_stabilised_merged_light_rises_everywhere_and_returns():
    noise = merged(exposures(0.1, (4000.0, 16_000.0, 64_000.0))).noise
    light = np.linspace(0.001, 8, 20_001, dtype=np.float32)
    stable = stabilised(light, noise)
    assert (np.diff(stable) > 0).all()
    sigma = np.sqrt(noise.variance(light))
    assert (abs(unbiased(stable, noise) - light) < 0.6 * sigma).all()
    assert noise.electrons == 4000.0  # the full wells of the others hold no white


def test_noise_is_taken_out_as_far_as_all_exposures_know_the_light_not_only_the_shortest():
    """Faint stripes far below the shortest exposure's noise, and above that of all."""
    stripes = 0.02 + 0.002 * np.sign(np.sin(np.arange(SIZE[2]) * 2 * np.pi / 16))
    record = merged(exposures(stripes, (250.0, 64_000.0)))
    error = float(np.square(denoised(record) - stripes).mean())
    assert error < 0.25 * float(record.variance.mean(dtype=np.float64))


@pytest.fixture(scope="module")
def lamps():
    return lit(leaves(1, 832, 832))


def test_lamps_leave_the_rest_of_a_scene_as_it_is(lamps):
    plain = leaves(1, 832, 832)
    dim = lamps.light <= 1
    assert 0.98 < np.isclose(lamps.light, plain.light, atol=1e-6).mean() < 0.999
    assert 0.001 < 1 - dim.mean() < 0.02
    assert 20 < lamps.light.max() <= 100
    np.testing.assert_allclose(lamps.values.max(), 1)


def test_one_bracket_of_all_light_is_the_photograph_without(lamps):
    plain, one = (Protocol("camera", brackets=cuts).photograph(Halo(), lamps, 40) for cuts in ((), (1.0,)))
    np.testing.assert_array_equal(plain.values, one.values)
    assert plain.noise == one.noise


def test_brackets_measure_lamps_that_one_exposure_cuts_off_and_restore_what_is_round_them(lamps):
    brackets = Protocol("camera", brackets=(1, 16, 256))
    light = brackets.seen(Halo(), lamps)
    record = brackets.photograph(Halo(), lamps, 40)
    assert isinstance(record.noise, MergedNoise)
    assert not record.clipped.any()
    off = (record.values - light) / np.sqrt(record.noise.variance(np.maximum(light, 0)))
    assert float(np.square(off).mean(dtype=np.float64)) == pytest.approx(1, abs=0.05)
    one, several = (
        evaluate([BAR], [lamps], [lamps], (40,), protocol=kind, details=False).scores[0].psnr
        for kind in (Protocol("camera"), brackets)
    )
    assert several > one + 0.5


@pytest.mark.parametrize(
    ("scene", "said"),
    [
        (Photograph("coded", 1, np.zeros((3, 832, 832), np.float32)), "code values"),
        (Photograph("dim", 1, *np.full((2, 3, 832, 832), 0.9, np.float32)), "no light above white"),
    ],
)
def test_scenes_without_highlights_are_no_brackets(scene, said):
    with pytest.raises(JobError, match=rf"MF143.*{said}"):
        evaluate([Halo()], [scene], [scene], (40,), protocol=Protocol("camera", brackets=(1, 16)))


@pytest.mark.parametrize("cuts", [(0.5,), (1, -4), (1, np.nan), (np.inf,), (4, 4)])
def test_brackets_that_are_no_shares_of_the_light_are_refused(cuts):
    with pytest.raises(JobError, match="MF143"):
        Protocol("camera", brackets=cuts)


def test_brackets_of_code_values_are_refused():
    with pytest.raises(JobError, match="MF143"):
        replace(F1, brackets=(1.0, 4.0))
