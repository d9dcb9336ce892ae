"""Shapes drawn by rule: their symmetries, exact counts, and the counts they cannot have."""

from __future__ import annotations

import re
from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from maskfab.base.errors import InputError, OpeningError
from maskfab.mask.opening_masks import blobs, diamond_discs, stripe

Shape = Callable[[int, int], np.ndarray]


def test_stripe() -> None:
    mask = stripe(21, 5, 90)
    assert mask.sum() == 90
    assert mask.any(axis=0).nonzero()[0].tolist() == [8, 9, 10, 11, 12]
    assert mask.any(axis=1).nonzero()[0].tolist() == list(range(1, 19))
    assert stripe(21, 21).all()
    assert stripe(4, 1).sum() == 4


@given(st.integers(4, 48), st.floats(0.02, 0.6), st.sampled_from([blobs, diamond_discs]))
def test_count_is_exact_or_the_nearest_is_named(dots: int, ratio: float, shape: Shape) -> None:
    count = max(1, round(ratio * dots * dots))
    mask, reachable = grown_or_nearest(shape, dots, count)
    if mask is not None:
        assert mask.sum() == count
    else:
        assert reachable
        assert count not in reachable
        assert all(shape(dots, nearest).sum() == nearest for nearest in reachable)


def grown_or_nearest(shape: Shape, dots: int, count: int) -> tuple[np.ndarray | None, list[int]]:
    """The mask, or else the counts that its refusal names."""
    try:
        return shape(dots, count), []
    except OpeningError as error:
        return None, [int(n) for n in re.findall(r"(\d+) \(open ratio", error.cure)] if error.code == "MF204" else []


def test_discs_lie_on_a_diamond_lattice() -> None:
    mask = diamond_discs(42, 416)
    assert mask.sum() == 416
    np.testing.assert_array_equal(mask, np.roll(mask, (21, 21), (0, 1)))
    for turned in (mask.T, mask[::-1], mask[:, ::-1]):
        np.testing.assert_array_equal(mask, turned)


def test_blobs_alternate_at_half_pitch() -> None:
    mask = blobs(42, 404, size_ratio=0.75, aspect=1.3, exponent=3.0)
    assert mask.sum() == 404
    np.testing.assert_array_equal(mask, np.roll(mask, (21, 21), (0, 1)))
    quarter = mask[:21, :21].sum(), mask[:21, 21:].sum()
    assert quarter[0] > quarter[1] > 0
    large = mask[:21, :21]
    assert large.any(axis=0).sum() > large.any(axis=1).sum()  # it lies
    assert not np.array_equal(mask, mask.T)


def test_a_closed_centre_lattice_may_be_left_out() -> None:
    mask = blobs(20, 32, size_ratio=0.0, aspect=1.0, exponent=2.0)
    assert mask[:10, 10:].sum() == 0


@pytest.mark.parametrize(
    ("code", "shape", "arguments"),
    [
        ("MF104", stripe, {"dots": 0, "width_dots": 1}),
        ("MF104", stripe, {"dots": 21, "width_dots": 22}),
        ("MF104", stripe, {"dots": 21, "width_dots": 0}),
        ("MF203", stripe, {"dots": 21, "width_dots": 5, "clear_dots": 0}),
        ("MF204", stripe, {"dots": 21, "width_dots": 5, "clear_dots": 88}),
        ("MF204", stripe, {"dots": 21, "width_dots": 5, "clear_dots": 110}),
        ("MF104", diamond_discs, {"dots": 0, "clear_dots": 1}),
        ("MF203", diamond_discs, {"dots": 42, "clear_dots": 0}),
        ("MF204", diamond_discs, {"dots": 42, "clear_dots": 1765}),
        ("MF104", blobs, {"dots": 5000, "clear_dots": 4}),
        ("MF104", blobs, {"dots": 42, "clear_dots": 404, "size_ratio": 1.1}),
        ("MF104", blobs, {"dots": 42, "clear_dots": 404, "aspect": 0.5}),
        ("MF104", blobs, {"dots": 42, "clear_dots": 404, "exponent": float("nan")}),
        ("MF204", blobs, {"dots": 42, "clear_dots": 405}),
    ],
)
def test_refused(code: str, shape: object, arguments: dict[str, float]) -> None:
    with pytest.raises(InputError) as caught:
        shape(**arguments)  # type: ignore[operator]
    assert caught.value.code == code
    assert caught.value.where
    assert caught.value.cure
