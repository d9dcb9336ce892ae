"""Photographs of one scene that lie apart, against scenes that are moved before they are drawn."""

from __future__ import annotations

import math
from functools import cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from sweeps import sweep

from maskfab.base.errors import SourceError
from maskfab.camera.registration import Similarity, brought, registered

SHAPE = (216, 288)


def similar(turn_deg, scale, shift_x, shift_y):
    turn = math.radians(turn_deg)
    return Similarity(scale * math.cos(turn) - 1, scale * math.sin(turn), shift_x, shift_y)


STILL = Similarity()


@cache
def drawn(seed, where=STILL, blur=0.0, noise=0.0, shape=SHAPE):
    """Gaussian spots in three colours, which stay Gaussian turned, larger and blurred; white is about 1."""
    draw = np.random.default_rng(seed)
    count, half = 3000, max(SHAPE) / 2
    x, y = draw.uniform(-1.3 * half, 1.3 * half, (2, count))
    size = np.exp(draw.uniform(np.log(1.2), np.log(20), count))
    light = draw.uniform(0.3, 1, (3, count)) * draw.choice([-1, 1], count) * draw.lognormal(0, 0.5, count)
    at_x = (1 + where.u) * x + where.v * y + where.shift_x
    at_y = (1 + where.u) * y - where.v * x + where.shift_y
    own = (size * where.scale) ** 2
    spread = own + blur**2
    rows, columns = (np.arange(side) - (side - 1) / 2 for side in shape)
    upright = np.exp(-((rows[:, None] - at_y) ** 2) / (2 * spread))
    level = np.exp(-((columns - at_x[:, None]) ** 2) / (2 * spread[:, None]))
    picture = np.stack([(upright * (each * own / spread)) @ level for each in light]) / 12 + 0.5
    seen = np.random.default_rng(seed + 1000 * (where != STILL)).standard_normal(picture.shape)
    return (picture + noise * seen).astype(np.float32)


def full(picture):
    return np.zeros(picture.shape[1:], dtype=np.bool_)


def matched(first, second):
    return registered(first, full(first), second, full(second))


def farthest(found, true, shape=SHAPE):
    """Of the places of all pixels, the largest error."""
    y, x = (np.arange(side) - (side - 1) / 2 for side in shape)
    u, v = found.u - true.u, found.v - true.v
    right = u * x + v * y[:, None] + found.shift_x - true.shift_x
    down = u * y[:, None] - v * x + found.shift_y - true.shift_y
    return np.hypot(right, down).max()


MOVED = [similar(0.7, 1.01, 3.3, -7.8), similar(-9.3, 0.93, 20.25, 11.5), similar(5.55, 1.09, -31.2, 14.7)]


@pytest.mark.parametrize(("true", "blur"), sweep(zip(MOVED, [0.0, 1.5, 1.5], strict=True), 2))
def test_noisy_pictures_lie_where_they_do_within_a_twentieth_of_a_pixel(true, blur):
    first, second = drawn(1, noise=0.01), 0.7 * drawn(1, true, blur, 0.01) + 0.02
    found = matched(first, second)
    assert farthest(found.where, true) < 0.05
    assert found.shift_error_px == pytest.approx((0, 0), abs=0.05)


def test_without_noise_nothing_is_left():
    found = matched(drawn(2), 0.5 * drawn(2, MOVED[0]))
    assert farthest(found.where, MOVED[0]) < 5e-3
    assert found.correlation > 0.9999


@pytest.mark.slow
def test_stated_intervals_hold_the_truth():
    misses = []
    for seed in range(4):
        found = matched(drawn(seed, noise=0.02), drawn(seed, MOVED[0], 1.0, 0.02))
        true, errors = MOVED[0], (*found.shift_error_px, found.turn_error_deg, found.scale_error)
        off = (
            found.where.shift_x - true.shift_x,
            found.where.shift_y - true.shift_y,
            found.where.turn_deg - true.turn_deg,
            found.where.scale - true.scale,
        )
        misses += [abs(each / half) for each, half in zip(off, errors, strict=True)]
    # In halves of 95 % intervals the root mean square is 0.51.
    assert 0.3 < np.sqrt(np.mean(np.square(misses))) < 0.8


def test_the_other_way_round_is_the_inverse():
    first, second = drawn(3, noise=0.01), drawn(3, MOVED[2], noise=0.01)
    there, back = matched(first, second).where, matched(second, first).where
    assert there.scale * back.scale == pytest.approx(1, abs=2e-4)
    assert there.turn_deg == pytest.approx(-back.turn_deg, abs=0.01)
    again_x = there.shift_x + (1 + there.u) * back.shift_x + there.v * back.shift_y
    again_y = there.shift_y + (1 + there.u) * back.shift_y - there.v * back.shift_x
    assert (again_x, again_y) == pytest.approx((0, 0), abs=0.03)


def test_full_pixels_do_not_pull():
    first, second = drawn(4), drawn(4, MOVED[0])
    level = np.quantile(first, 0.98)
    cut = [np.minimum(each, level) for each in (first, second)]
    clipped = [(each >= level).any(axis=0) for each in (first, second)]
    found = registered(cut[0], clipped[0], cut[1], clipped[1])
    blind = matched(*cut)
    assert farthest(found.where, MOVED[0]) < 0.02
    assert found.shared < blind.shared


@settings(max_examples=3, deadline=None)
@given(st.floats(-9.5, 9.5), st.floats(0.91, 1.09), st.floats(-60, 60), st.floats(-40, 40))
def test_any_small_turn_scale_and_shift_is_found(turn, scale, right, down):
    true = similar(turn, scale, right, down)
    assert farthest(matched(drawn(5), drawn(5, true)).where, true) < 0.02


def test_pictures_of_two_sizes_match():
    larger = drawn(6, MOVED[0], shape=(320, 480))
    assert farthest(matched(drawn(6), larger).where, MOVED[0]) < 0.01


def test_the_second_is_taken_at_the_places_of_the_first():
    first, second = drawn(7), drawn(7, MOVED[1])
    taken = np.stack([MOVED[1].taken(plane, SHAPE, order=5) for plane in second])
    inner = (slice(None), slice(60, -60), slice(80, -80))
    assert abs(taken - first)[inner].max() < 5e-4


def test_what_is_left_between_two_pictures_is_their_noise():
    first, second = drawn(7, noise=0.01), 0.8 * drawn(7, MOVED[0], noise=0.01)
    found = brought(("a", "b"), first, full(first), second.clip(0, 1), full(second))
    assert found.gain == pytest.approx((0.8, 0.8, 0.8), abs=0.01)
    # Resampling between pixels averages noise, and keeps more than half of it.
    assert 0.01 < found.difference < 0.01 * math.sqrt(2)
    assert found.picture[:, 0, -1] == pytest.approx(0)


@pytest.mark.parametrize("other", ["another scene", "far away", "even"])
def test_pictures_that_do_not_show_one_scene_are_refused(other):
    second = {
        "another scene": drawn(9),
        "far away": drawn(8, similar(0, 1, 300, 150)),
        "even": np.full((3, *SHAPE), 0.5, dtype=np.float32),
    }[other]
    with pytest.raises(SourceError, match="MF354"):
        matched(drawn(8), second)
