"""Tilings: who draws what, and what the maps are good for."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from maskfab.base.errors import JobError
from maskfab.base.model import Opening, Panel, Tiling, orient
from maskfab.mask.panels import hexagonal_sheet
from maskfab.optics.tiling import FLIPS, PAPER4, blue_noise, orientations

L_SHAPE = np.array([[1, 1, 0], [1, 0, 0], [0, 0, 0]], dtype=bool)


@pytest.mark.parametrize(
    ("tiling", "allowed"),
    [
        (Tiling.PERIODIC, {0}),
        (Tiling.RANDOM, set(range(8))),
        (Tiling.PAPER4, set(PAPER4)),
        (Tiling.FLIPS, set(FLIPS)),
        (Tiling.ROT90, {0, 1, 2, 3}),
        (Tiling.ROT90FLIP, {0, 5, 2, 7}),
        (Tiling.BLUE_NOISE, set(range(8))),
    ],
)
def test_each_tiling_uses_its_orientations_and_no_other(tiling: Tiling, allowed: set[int]) -> None:
    found = orientations(tiling, 20, 21, 5)
    assert found.shape == (20, 21)
    assert set(np.unique(found).tolist()) == allowed


@pytest.mark.parametrize("tiling", [Tiling.RANDOM, Tiling.PAPER4, Tiling.FLIPS, Tiling.BLUE_NOISE, Tiling.HEXAGONAL])
def test_what_is_drawn_needs_a_seed(tiling: Tiling) -> None:
    with pytest.raises(JobError, match="MF111"):
        orientations(tiling, 4, 4, None)
    assert np.array_equal(orientations(tiling, 9, 9, 3), orientations(tiling, 9, 9, 3))


def test_cycles_turn_by_a_quarter_from_cell_to_cell() -> None:
    """Round each 2 x 2 block every step is one more quarter turn; in the other cycle also a mirror image."""
    plain, flipped = (orientations(kind, 2, 2, None) for kind in (Tiling.ROT90, Tiling.ROT90FLIP))
    ring = [(0, 0), (0, 1), (1, 1), (1, 0)]
    for step, place in enumerate(ring):
        assert np.array_equal(orient(L_SHAPE, int(plain[place])), orient(L_SHAPE, step))
        assert flipped[place] % 4 == step
        assert (flipped[place] >= 4) == (step % 2 == 1)


def test_flips_are_the_mirror_images_of_the_cell() -> None:
    images = {orient(L_SHAPE, k).tobytes() for k in FLIPS}
    mirrored = (L_SHAPE, L_SHAPE[:, ::-1], L_SHAPE[::-1], L_SHAPE[::-1, ::-1])
    assert images == {image.tobytes() for image in mirrored}


def test_blue_noise_has_far_less_power_at_low_frequencies_than_independent_draws() -> None:
    def low(kinds: np.ndarray) -> float:
        frequency = np.fft.fftfreq(40)
        radius = np.hypot(*np.meshgrid(frequency, frequency))
        near = (radius > 0) & (radius < 0.12)
        return sum(float((abs(np.fft.fft2(kinds == k)) ** 2)[near].mean()) for k in range(8))

    assert low(blue_noise(8, 40, 40, 1)) < low(orientations(Tiling.RANDOM, 40, 40, 1)) / 5


@given(st.integers(1, 12), st.integers(1, 12), st.integers(1, 20), st.integers(0, 99))
def test_blue_noise_is_balanced(rows: int, columns: int, kinds: int, seed: int) -> None:
    counts = np.bincount(blue_noise(kinds, rows, columns, seed).ravel(), minlength=kinds)
    assert counts.max() - counts.min() <= 1


def test_several_openings_are_drawn_apart_from_their_orientations() -> None:
    found = orientations(Tiling.RANDOM, 60, 60, 2, openings=3)
    counts = np.bincount(found.ravel(), minlength=24)
    assert counts.size == 24
    assert abs(counts - 150).max() < 5 * np.sqrt(150)
    assert set(orientations(Tiling.PERIODIC, 30, 30, 2, openings=3).ravel().tolist()) == {0, 8, 16}
    with pytest.raises(JobError, match="MF122"):
        orientations(Tiling.RANDOM, 2, 2, 1, openings=16)
    with pytest.raises(JobError, match="MF111"):
        orientations(Tiling.PERIODIC, 2, 2, None, openings=2)


def test_a_panel_of_several_openings_has_their_mean_open_ratio() -> None:
    one, two = Opening("one", L_SHAPE, 8000), Opening("two", ~L_SHAPE, 8000)
    held = np.array([[0, 8], [3, 0]], dtype=np.int8)
    panel = Panel(one, 8000, 0, held, Tiling.RANDOM, 1, others=(two,))
    assert panel.open_ratio == pytest.approx((3 * 3 + 6) / 36)
    assert np.array_equal(panel.pattern(8), ~L_SHAPE)
    assert np.array_equal(panel.pattern(3), orient(L_SHAPE, 3))


def test_a_hexagonal_sheet_repeats_on_its_lattice() -> None:
    """A disc does not show its turns: the sheet is periodic but for snapping, and a third of a turn changes nothing."""
    width = 31
    y, x = np.mgrid[:width, :width] - (width - 1) / 2
    disc = Opening("disc", np.hypot(x, y) < 9, 8000)
    sheet = hexagonal_sheet(disc, 400, 1)
    assert sheet.open_ratio == pytest.approx(disc.clear_dots / (width**2 * np.sqrt(3) / 2), rel=0.03)
    power = abs(np.fft.fft2(sheet.mask)) ** 2
    correlation = np.fft.ifft2(power).real / sheet.clear_dots
    background = sheet.open_ratio
    rise = width * np.sqrt(3) / 2
    for right, up in ((width, 0), (width / 2, rise), (-width / 2, rise), (0, 2 * rise)):
        peak = max(correlation[int(np.floor(up)) + i, int(np.floor(right)) + j] for i in (0, 1) for j in (0, 1))
        assert peak > 2.5 * background
    assert correlation[0, width // 2] < background


def test_turns_of_a_hexagonal_sheet_differ_from_cell_to_cell() -> None:
    width = 21
    slit = np.zeros((width, width), dtype=bool)
    slit[:, 9:12] = True
    sheets = [hexagonal_sheet(Opening("slit", slit, 8000), 210, seed).mask for seed in (1, 1, 2)]
    assert np.array_equal(sheets[0], sheets[1])
    assert not np.array_equal(sheets[0], sheets[2])
