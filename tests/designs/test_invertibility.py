"""The invertibility loss: its autocorrelation, its gradient, its symmetries, and why photons count."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from maskfab.base.errors import JobError
from maskfab.base.model import Tiling, orient
from maskfab.designs.descent.objective import Invertibility, cells_across, invertibility_of, tiled_stop
from maskfab.job.camera import Camera, Stop
from maskfab.optics.stop import stop_dots
from maskfab.optics.tiling import orientations

DOTS = 7
STOP = Stop("circle", 400.0)


def small_loss(
    tiling: Tiling = Tiling.RANDOM, *, pixel_um: float = 2.0, stop: Stop = STOP, target: float = 0.2
) -> Invertibility:
    across = cells_across(stop, DOTS, 8000)
    turned = orientations(tiling, across, across, 3)
    lens = Camera(1000.0, stop, (530.0, 610.0), pixel_um, 256.0)
    return invertibility_of(tiled_stop(DOTS, 8000, turned, lens, precision="float64"), target)


def cell_of(seed: int) -> np.ndarray:
    return np.random.default_rng(seed).random((DOTS, DOTS))


def test_stop_covers_its_circle() -> None:
    assert cells_across(Stop("circle", 4000.0), 21, 8000) == 24
    side = 24 * 21
    area = stop_dots(Stop("circle", 4000.0), side, 8.0).sum() * 64.0
    assert area == pytest.approx(np.pi * 2000.0**2, rel=1e-3)
    assert stop_dots(Stop("square", 400.0), 56, 8.0).sum() == 50**2


def test_pupil_holds_cells_oriented_as_the_model_says() -> None:
    across = cells_across(STOP, DOTS, 8000)
    elements = orientations(Tiling.RANDOM, across, across, 3)
    cell = cell_of(0)
    expected = np.block([[orient(cell, int(element)) for element in row] for row in elements])
    expected = expected * stop_dots(STOP, across * DOTS, 8.0)
    np.testing.assert_array_equal(small_loss().correlation.pupil(torch.from_numpy(cell)).numpy(), expected)


def test_autocorrelation_is_the_sum_over_shifted_pupils() -> None:
    loss = small_loss()
    cell = torch.from_numpy(cell_of(1))
    pupil = loss.correlation.pupil(cell).numpy()
    table = loss.correlation(cell).numpy()
    for y, x in ((0, 0), (3, 5), (12, -9), (0, 16)):
        rows = pupil.shape[0] - y
        left, right = max(0, -x), min(pupil.shape[1], pupil.shape[1] - x)
        direct = (pupil[:rows, left:right] * pupil[y:, left + x : right + x]).sum()
        assert table[y, x % loss.correlation.size] == pytest.approx(direct, rel=1e-12)


def test_lags_fill_the_half_plane_once() -> None:
    loss = small_loss()
    for wavelength, lags in zip((530.0, 610.0), loss.lags, strict=True):
        reach = wavelength * 1000.0 / (2 * 2.0) / 8000
        y, x = np.divmod(lags.numpy(), loss.correlation.size)
        x = np.where(x > loss.correlation.size // 2, x - loss.correlation.size, x)
        found = set(zip(y.tolist(), x.tolist(), strict=True))
        whole = {(j, i) for j in range(-40, 41) for i in range(-40, 41) if 0 < i * i + j * j <= reach**2}
        assert len(found) == lags.numel()
        assert found | {(-j, -i) for j, i in found} == whole
        assert not found & {(-j, -i) for j, i in found}


def test_loss_equals_a_direct_computation() -> None:
    loss = small_loss()
    cell = torch.from_numpy(cell_of(2))
    table = loss.correlation(cell).numpy().ravel()
    light = stop_dots(STOP, cells_across(STOP, DOTS, 8000) * DOTS, 8.0).sum() * 0.2
    means = []
    for lags in loss.lags:
        otf = table[lags.numpy()] / light
        kept = np.sort(otf**2 / (otf**2 + 0.015))
        means.append(kept[: int(np.ceil(0.3 * kept.size))].mean())
    assert loss(cell).item() == pytest.approx(-np.mean(means), rel=1e-12)


def test_gradient_agrees_with_finite_differences() -> None:
    loss = small_loss()
    cell = torch.from_numpy(cell_of(3)).requires_grad_()
    (gradient,) = torch.autograd.grad(loss(cell), cell)
    step = 1e-6
    for y, x in ((0, 0), (3, 3), (6, 1), (2, 5)):
        shift = torch.zeros_like(cell)
        shift[y, x] = step
        with torch.no_grad():
            slope = (loss(cell + shift) - loss(cell - shift)).item() / (2 * step)
        assert gradient[y, x].item() == pytest.approx(slope, rel=1e-5, abs=1e-9)


@settings(deadline=None, max_examples=20)
@given(st.integers(0, 1000), st.integers(0, 7))
def test_turning_the_unit_of_a_periodic_panel_changes_nothing(seed: int, element: int) -> None:
    loss = small_loss(Tiling.PERIODIC)
    cell = cell_of(seed)
    turned = np.ascontiguousarray(orient(cell, element))
    assert loss(torch.from_numpy(turned)).item() == pytest.approx(loss(torch.from_numpy(cell)).item(), rel=1e-9)


def test_grey_pays_for_its_photons() -> None:
    """Grey of the target's share r has r times the bare stop's O, and darker grey less; divided by its own sum grey of
    any share would have the bare stop's."""
    loss = small_loss()
    bare = torch.ones((DOTS, DOTS), dtype=torch.float64)
    stop_only = loss.correlation(bare)
    for share in (0.2, 0.1):
        table = loss.correlation(share * bare)
        otf, otf_bare = (t.flatten()[loss.lags[0]] for t in (table / loss.light, stop_only / stop_only[0, 0]))
        np.testing.assert_allclose(otf, share**2 / 0.2 * otf_bare, rtol=1e-9)
        np.testing.assert_allclose(table / table[0, 0], stop_only / stop_only[0, 0], atol=1e-12)
    assert loss(0.2 * bare).item() < loss(0.1 * bare).item()


def test_refuses_what_it_cannot_judge() -> None:
    with pytest.raises(JobError) as caught:
        small_loss(pixel_um=100.0)
    assert caught.value.code == "MF104"
    with pytest.raises(JobError) as caught:
        small_loss(stop=Stop("circle", 40_000.0))
    assert caught.value.code == "MF115"
