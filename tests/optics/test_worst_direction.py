"""The MTF in its worst direction at stated frequencies, against a curve that is known."""

from __future__ import annotations

import numpy as np
import pytest

from maskfab.base.model import Mtf, RadialMean
from maskfab.optics.mtf import worst_directions


@pytest.fixture
def mtf():
    rings = np.linspace(0.0, 250.0, 126)
    cut = np.exp(-rings / 50)
    return Mtf(rings, {"radial_min": cut}, 530.0, 1e-7, 1e-8, RadialMean(rings, cut, np.zeros(126)))


@pytest.mark.parametrize("frequency", [0.0, 2.0, 25.0, 61.3, 125.0, 249.9, 250.0])
def test_the_truth_lies_within_the_error(mtf, frequency):
    (found,) = worst_directions(mtf, [frequency], "A")
    truth = np.exp(-frequency / 50)
    assert abs(found.value - truth) <= found.uncertainty
    assert found.uncertainty < 0.04 * truth + 1e-6
    assert (found.die, found.wavelength_nm) == ("A", 530.0)
    assert found.symbol == f"MTF({frequency:g} cy/mm)"


def test_on_a_ring_nothing_is_interpolated(mtf):
    (found,) = worst_directions(mtf, [100.0], None)
    assert (found.value, found.uncertainty) == (pytest.approx(np.exp(-2.0), abs=1e-12), pytest.approx(1e-7, rel=1e-3))
