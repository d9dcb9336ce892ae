"""Numbers whose noise does not grow with the light: against sums over all counts, and all errors of reading them."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.polynomial.hermite_e import hermegauss
from scipy import stats

from maskfab.camera.record import Noise
from maskfab.camera.restorers.dct import stabilised, unbiased

ELECTRONS = 500.0


def moments(mean, noise):
    """Mean and variance of the stabilised numbers of ``mean`` electrons: a direct sum, Poisson times Gauss."""
    counts = np.arange(int(mean + 12 * np.sqrt(mean) + 30))
    nodes, weights = hermegauss(60)
    probable = stats.poisson.pmf(counts, mean)[:, None] * (weights / weights.sum())
    read = (counts[:, None] + noise.read_noise * nodes).astype(np.float32)
    found = stabilised(read / np.float32(noise.electrons), noise).astype(np.float64)
    first = (probable * found).sum()
    return first, (probable * found**2).sum() - first**2


@pytest.mark.parametrize("read_noise", [0.0, 1.5, 4.87])
@pytest.mark.parametrize("mean", [5.0, 20.0, 200.0])
def test_the_mean_of_stabilised_light_is_brought_back_to_the_mean_of_the_light(mean, read_noise):
    noise = Noise(ELECTRONS, read_noise)
    first, variance = moments(mean, noise)
    # Within a fiftieth of the noise of a single pixel; the plain inverse is off by a quarter of an electron and more.
    back = ELECTRONS * float(unbiased(np.float32([first]), noise)[0])
    assert back == pytest.approx(mean, abs=0.02 * np.sqrt(mean + read_noise**2))
    assert variance == pytest.approx(1, abs=0.07)


def test_in_the_dark_read_noise_alone_leaves_no_bias():
    noise = Noise(ELECTRONS, 4.87)
    assert ELECTRONS * float(unbiased(np.float32([moments(0.0, noise)[0]]), noise)[0]) == pytest.approx(0, abs=0.1)


def test_the_converters_step_counts_as_the_read_noise_that_it_is_like():
    light = np.linspace(-0.01, 1, 50, dtype=np.float32)
    rounded = Noise(ELECTRONS, 3.0, step=6.0)
    alike = Noise(ELECTRONS, np.sqrt(3.0**2 + 6.0**2 / 12))
    np.testing.assert_allclose(stabilised(light, rounded), stabilised(light, alike), rtol=1e-6)


def test_the_inverse_rises_with_its_argument_and_is_finite_wherever_noise_may_lead():
    noise = Noise(ELECTRONS, 4.87)
    light = unbiased(np.linspace(-3, 60, 2000, dtype=np.float32), noise)
    assert np.isfinite(light).all()
    assert (np.diff(light) >= 0).all()
    assert np.isfinite(stabilised(np.float32([-1.0, -0.05, 0.0]), noise)).all()
