import numpy as np
import torch
from hypothesis import given
from hypothesis import strategies as st

from maskfab.base.model import ORIENTATIONS, orient, side_by_side, split_cells, unit_dots
from maskfab.camera.restorers.wiener import prior, wiener
from maskfab.designs.model.panel_error import wiener_tensor
from maskfab.optics.restoration import restoration_gain, wiener_filter

SIZES = st.tuples(*[st.integers(1, 5)] * 4)


@given(SIZES)
def test_cells_side_by_side_are_found_where_they_were_laid_and_split_again(shape: tuple[int, ...]) -> None:
    cells = np.arange(np.prod(shape)).reshape(shape)
    rows, columns, height, width = shape
    picture = side_by_side(cells)
    assert picture.shape == (rows * height, columns * width)
    np.testing.assert_array_equal(picture[-height:, -width:], cells[-1, -1])
    np.testing.assert_array_equal(split_cells(picture, height, width), cells)


@given(st.integers(1, 6), st.integers(0, 1000))
def test_the_dots_of_a_layout_are_those_of_its_turned_units(dots: int, seed: int) -> None:
    draw = np.random.default_rng(seed)
    unit, turns = draw.random((dots, dots)), draw.integers(ORIENTATIONS, size=(2, 3)).astype(np.int8)
    laid = unit.ravel()[unit_dots(turns, dots)]
    np.testing.assert_array_equal(laid, np.block([[orient(unit, int(turn)) for turn in row] for row in turns]))


@given(st.integers(0, 1000), st.floats(1e-6, 1e2))
def test_one_wiener_filter_serves_reports_photographs_and_descents(seed: int, ratio: float) -> None:
    transfer = np.random.default_rng(seed).random((4, 5))
    filtered = wiener_filter(transfer, np.float64(ratio))
    np.testing.assert_allclose(filtered * (transfer**2 + ratio), transfer, rtol=1e-14)
    np.testing.assert_array_equal(wiener_tensor(torch.from_numpy(transfer), ratio).numpy(), filtered)
    np.testing.assert_array_equal(restoration_gain(transfer, ratio), filtered)
    single, weights = transfer.astype(np.float32), prior((4, 8))
    expected = wiener_filter(single.astype(np.float64), ratio * weights.astype(np.float64))
    np.testing.assert_allclose(wiener(single, weights, ratio), expected, rtol=1e-5)


def test_without_signal_and_noise_the_filter_passes_nothing() -> None:
    np.testing.assert_array_equal(wiener_filter(np.array([0.0, 0.5]), np.float64(0.0)), [0.0, 2.0])
