"""The transfer function against sums by hand, and panels laid behind a stop."""

from __future__ import annotations

import numpy as np
import pytest

from maskfab.camera.stop_cells import CELLS, CellGrid, lattice, lay, pupil_autocorrelation, pupil_transfer


def test_autocorrelation_is_the_sum_over_pairs():
    pupil = np.random.default_rng(0).random((7, 7))
    table = pupil_autocorrelation(pupil)
    for dy in range(-6, 7):
        for dx in range(-6, 7):
            a = pupil[max(0, dy) : 7 + min(0, dy), max(0, dx) : 7 + min(0, dx)]
            b = pupil[max(0, -dy) : 7 + min(0, -dy), max(0, -dx) : 7 + min(0, -dx)]
            assert table[dy + 6, dx + 6] == pytest.approx((a * b).sum(), abs=1e-12)


def test_transfer_is_the_sum_over_orders_and_lags():
    dots = 48
    room = CellGrid(dots, 1, 84.0)
    pupil = room.stop * (np.random.default_rng(1).random((dots, dots)) < 0.4).astype(np.float64)
    found = pupil_transfer(pupil, room, (16, 24))
    assert found.shape == (3, 16, 13)
    np.testing.assert_allclose(found[:, 0, 0], 1, rtol=1e-6)
    table = np.pad(pupil_autocorrelation(pupil), 1) / pupil.sum()
    for row, column in ((0, 5), (3, 12), (12, 7), (8, 0)):
        fy, fx = np.fft.fftfreq(16)[row], column / 24
        total = 0.0
        for ky in range(-3, 4):
            for kx in range(-3, 4):
                ty, tx = ((f + k) * room.per_cycle(530) for f, k in ((fy, ky), (fx, kx)))
                if max(abs(ty), abs(tx)) >= dots:
                    continue
                j, i = int(np.floor(ty)), int(np.floor(tx))
                wy, wx = np.array([1 - ty + j, ty - j]), np.array([1 - tx + i, tx - i])
                near = table[j + dots : j + dots + 2, i + dots : i + dots + 2]
                total += wy @ near @ wx * np.sinc(fy + ky) * np.sinc(fx + kx)
        assert found[1, row, column] == pytest.approx(total, abs=1e-6)


def test_the_stop_of_the_protocol():
    i = np.arange(504)
    np.testing.assert_array_equal(lattice(21).stop, (i[:, None] - 251.5) ** 2 + (i - 251.5) ** 2 <= 250**2)


def test_an_open_panel_is_the_stop_and_turning_every_cell_turns_the_panel():
    assert lay("open", np.ones((21, 21), dtype=np.bool_)).transmission == 1
    unit = np.random.default_rng(2).random((7, 7)) < 0.3
    plain = lay("a", unit, np.zeros((CELLS, CELLS), dtype=np.int8)).pupil
    turned = lay("b", unit, np.full((CELLS, CELLS), 2, dtype=np.int8)).pupil
    np.testing.assert_array_equal(turned, plain[::-1, ::-1])
