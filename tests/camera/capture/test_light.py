"""The light is found wherever it lies, and another one is refused."""

from __future__ import annotations

import numpy as np
import pytest
from capture_frames import frame, point_light

from maskfab.base.errors import SourceError
from maskfab.camera.frames.stack import light_place

TIMES = (1e-3, 1.6e-2, 0.256)


def room(row, column, side=96):
    light = np.full((300, 400), 60.0)
    light[row - side // 2 : row + side // 2, column - side // 2 : column + side // 2] += point_light(side)
    return light


def frames(light, seed=0, **options):
    draw = np.random.default_rng(seed)
    return [frame(light, time, draw, **options) for time in TIMES]


@pytest.mark.parametrize(("row", "column"), [(60, 330), (151, 200), (240, 70)])
@pytest.mark.parametrize("count", [1, 3])
def test_the_spot_is_found_although_pixels_are_hot(row, column, count):
    hot = np.zeros((300, 400))
    hot[::37, ::41] = 9000
    place = light_place(frames(room(row, column), added=hot)[:count], 96)
    assert np.hypot(place[0] - row + 2, place[1] - column) < 6


def test_no_light_and_a_second_light_are_refused():
    light = room(80, 200)
    faint = light + 0.02 * np.roll(light, 120, axis=1)
    assert light_place(frames(faint), 96) == pytest.approx((78, 200), abs=6)
    for code, given in (("MF338", light + 0.2 * np.roll(light, 120, axis=1)), ("MF334", np.full((300, 400), 60.0))):
        with pytest.raises(SourceError, match=code) as caught:
            light_place(frames(given), 96)
        assert caught.value.cure
    assert light_place(frames(light + 0.2 * np.roll(light, 120, axis=1)), 390) is not None


def test_orders_of_diffraction_are_no_second_light():
    light = room(150, 200)
    orders = light + 0.3 * (np.roll(light, 120, axis=1) + np.roll(light, -120, axis=1))
    assert light_place(frames(orders), 96) == pytest.approx((148, 200), abs=6)
