"""The mean over layouts in closed form against every layout, or against many."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from numpy.typing import NDArray
from optics_cases import camera, noise, panel, pupil

from maskfab.base.errors import InternalError
from maskfab.base.model import Opening, Panel, Tiling, orient
from maskfab.optics.psf import image_scale_um2, point_psf
from maskfab.optics.tiling_mean import decorrelation_error, mean_psf, phase_error

LINE = 530.0


def laid(mask: NDArray[np.bool_], orientations: NDArray[np.int8], gutter_nm: int = 0) -> Panel:
    return Panel(Opening("case", mask, 8000), 8000, gutter_nm, orientations, Tiling.RANDOM, 0)


def stripe() -> NDArray[np.bool_]:
    mask = np.zeros((21, 21), dtype=np.bool_)
    mask[1:19, 8:13] = True
    return mask


@pytest.mark.parametrize(("shape", "gutter_nm"), [("circle", 0), ("circle", 6000), ("square", 0), ("square", 6000)])
@pytest.mark.parametrize("elements", [(0, 1), (0, 3, 5)])
def test_every_layout_of_four_cells(shape: str, gutter_nm: int, elements: tuple[int, ...]) -> None:
    """All layouts enumerated: with the energies as weights the mean must agree to rounding, cut cells and all."""
    mask = noise(5, 0.5, 3)
    setting = camera(88.0, shape=shape, window_um=96.0)
    found = mean_psf(laid(mask, np.zeros((2, 2), dtype=np.int8), gutter_nm), setting, LINE, elements)
    total, energy, draws = np.zeros_like(found.psf.values), 0.0, 0
    squares = np.zeros_like(total)
    for drawn in itertools.product(elements, repeat=4):
        source = pupil(laid(mask, np.array(drawn, dtype=np.int8).reshape(2, 2), gutter_nm), setting.stop)
        intensity = point_psf(source, setting, LINE).values * source.energy_um2
        total, energy, draws = total + intensity, energy + source.energy_um2, draws + 1
        squares += intensity**2
    expected = total / energy
    assert np.linalg.norm(found.psf.values - expected) < 1e-8 * np.linalg.norm(expected)
    variance = (squares / draws - (total / draws) ** 2) / (energy / draws) ** 2
    # Four cells are far from Gaussian: the scatter is an estimate.
    assert found.scatter == pytest.approx(np.sqrt(variance.sum()) / np.linalg.norm(expected), rel=0.5)


def test_one_orientation_is_the_periodic_psf() -> None:
    mask = noise(7, 0.4, 5)
    setting = camera(300.0)
    for k in (0, 5):
        found = mean_psf(panel(mask, cells=8), setting, LINE, (k,))
        plain = point_psf(pupil(panel(np.array(orient(mask, k)), cells=8), setting.stop), setting, LINE)
        assert np.linalg.norm(found.psf.values - plain.values) < 1e-10 * np.linalg.norm(plain.values)
        assert found.scatter < 1e-6


def test_a_symmetric_opening_does_not_scatter() -> None:
    mask = np.zeros((7, 7), dtype=np.bool_)
    mask[2:5, 2:5] = True
    found = mean_psf(panel(mask, cells=6), camera(240.0), LINE)
    assert found.scatter < 1e-6


def test_the_mean_has_the_symmetry_of_the_tilings() -> None:
    found = mean_psf(panel(noise(7, 0.4, 5), cells=8), camera(300.0, window_um=64.0), LINE)
    for k in range(8):
        np.testing.assert_allclose(orient(found.psf.values, k), found.psf.values, atol=1e-9 * found.psf.values.max())


def test_octants_stand_for_the_rest() -> None:
    """All eight orientations twice each are the same ensemble, summed over all cut cells instead of an eighth."""
    setting = camera(300.0, window_um=64.0)
    once, twice = (
        mean_psf(panel(stripe(), cells=3, gutter_nm=8000), setting, LINE, tuple(range(8)) * n) for n in (1, 2)
    )
    np.testing.assert_allclose(once.psf.values, twice.psf.values, rtol=1e-9, atol=1e-9 * once.psf.values.max())
    np.testing.assert_allclose(once.variance, twice.variance, rtol=1e-6, atol=1e-9 * once.variance.max())


def test_scatter_and_mean_of_many_layouts() -> None:
    setting = camera(600.0, window_um=96.0)
    found = mean_psf(panel(stripe(), cells=4), setting, LINE)
    layouts = np.stack(
        [point_psf(pupil(panel(stripe(), cells=4, seed=s), setting.stop), setting, LINE).values for s in range(200)]
    )
    size = np.linalg.norm(found.psf.values)
    scatter = np.sqrt(((layouts - found.psf.values) ** 2).sum(axis=(1, 2)).mean()) / size
    assert scatter == pytest.approx(found.scatter, rel=0.12)
    assert np.linalg.norm(layouts.mean(axis=0) - found.psf.values) / size < 3 * found.scatter / np.sqrt(200)


def test_energy_and_peak_of_the_mean() -> None:
    """On the axis every whole cell has the same field, so only cut cells vary: peak Strehl is η² nearly."""
    setting = camera(600.0)
    found = mean_psf(panel(stripe(), cells=4), setting, LINE)
    middle = found.psf.values.shape[0] // 2
    layouts = [pupil(panel(stripe(), cells=4, seed=seed), setting.stop) for seed in range(400)]
    eta = np.mean([layout.energy_um2 for layout in layouts]) / setting.stop.area_um2
    peak = found.psf.values[middle, middle] * image_scale_um2(setting, LINE) ** 2 / setting.stop.area_um2
    assert peak == pytest.approx(eta, rel=2e-3)
    assert 0.5 < found.psf.energy_in_window < 1


def test_estimates_from_correlation() -> None:
    """Two Gaussian fields of correlation ρ: the estimate is what draws of them show."""
    draw = np.random.default_rng(5)
    parts = draw.normal(size=(4, 200_000))
    first, other = parts[0] + 1j * parts[1], parts[2] + 1j * parts[3]
    rho = 0.8
    one, two = abs(first) ** 2, abs(rho * first + np.sqrt(1 - rho**2) * other) ** 2
    expected = np.linalg.norm(one - two) / np.linalg.norm(one)
    assert decorrelation_error(one**2 / 2, one, rho) == pytest.approx(expected, rel=0.02)
    assert decorrelation_error(one, one, 1.0) == 0
    assert phase_error(None, 0.75) == pytest.approx(0.5)


def test_nothing_to_draw_from() -> None:
    with pytest.raises(InternalError, match="MF901"):
        mean_psf(panel(stripe(), cells=2), camera(200.0), LINE, ())
