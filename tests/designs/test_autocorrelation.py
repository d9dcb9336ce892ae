"""The pruned autocorrelation: its pupil, the sum over shifted pupils, the optics' lag table, and its gradient."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from optics_cases import noise, panel, pupil
from sweeps import examples

from maskfab.base.model import orient
from maskfab.designs.descent.objective import Autocorrelation, autocorrelation
from maskfab.job.camera import Stop
from maskfab.optics.lags import lag_table


def small(dots: int, rows: int, columns: int, reach: int, seed: int) -> tuple[Autocorrelation, np.ndarray, np.ndarray]:
    draw = np.random.default_rng(seed)
    turns = draw.integers(0, 8, (rows, columns)).astype(np.int8)
    inside = draw.random((rows * dots, columns * dots)) < 0.9
    cell = draw.random((dots, dots))
    laid = np.block([[orient(cell, int(k)) for k in row] for row in turns]) * inside
    return autocorrelation(dots, turns, inside, reach), cell, laid


@examples(40)
@given(st.integers(1, 4), st.integers(1, 4), st.integers(1, 4), st.integers(0, 100), st.data())
def test_is_the_sum_over_shifted_pupils(dots: int, rows: int, columns: int, seed: int, data: st.DataObject) -> None:
    reach = data.draw(st.integers(0, max(rows, columns) * dots - 1))
    found, cell, laid = small(dots, rows, columns, reach, seed)
    np.testing.assert_array_equal(found.pupil(torch.from_numpy(cell)).numpy(), laid)
    table = found(torch.from_numpy(cell)).numpy()
    assert found.size % 2 == 0
    assert table.shape == (reach + 1, found.size)
    height, width = laid.shape
    for y in range(reach + 1):
        for x in range(-reach, reach + 1):
            direct = 0.0
            if y < height and abs(x) < width:
                lower = laid[: height - y, max(0, -x) : min(width, width - x)]
                direct = float((lower * laid[y:, max(0, x) : min(width, width + x)]).sum())
            assert table[y, x % found.size] == pytest.approx(direct, abs=1e-10)


def test_equals_the_lag_table_of_the_optics() -> None:
    laid_out = panel(noise(5, 0.4, 2), cells=4, seed=3)
    found = autocorrelation(5, laid_out.orientations, np.ones((20, 20), dtype=np.bool_), 12)
    table = found(torch.from_numpy(laid_out.opening.mask.astype(np.float64))).numpy()
    lags = lag_table(pupil(laid_out, Stop("square", 160.0)))
    y, x = np.mgrid[0:13, -12:13]
    expected = lags.otf(8.0 * x, 8.0 * y) * lags.energy_um2 / 64.0
    np.testing.assert_allclose(table[y, x % found.size], expected, atol=1e-10)


@pytest.mark.parametrize(("rows", "columns", "reach"), [(3, 3, 4), (2, 3, 0), (3, 2, 8), (1, 1, 2)])
def test_gradient_agrees_with_finite_differences(rows: int, columns: int, reach: int) -> None:
    found, cell, _ = small(3, rows, columns, reach, 1)
    assert torch.autograd.gradcheck(found, torch.from_numpy(cell).requires_grad_())


def test_float32_is_good_to_rounding() -> None:
    found, cell, _ = small(7, 10, 10, 25, 4)
    slopes = torch.from_numpy(np.random.default_rng(0).standard_normal((26, found.size)))
    results = []
    for dtype in (torch.float64, torch.float32):
        leaf = torch.from_numpy(cell).to(dtype).requires_grad_()
        table = found(leaf)
        results.append((table.detach().double(), torch.autograd.grad(table, leaf, slopes.to(dtype))[0].double()))
    for exact, single in zip(*results, strict=True):
        assert torch.linalg.vector_norm(single - exact) < 1e-6 * torch.linalg.vector_norm(exact)
