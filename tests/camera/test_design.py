"""What a scene is photographed through, and what restorers take that for."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from once import leaves
from optics_cases import noise, panel

from maskfab.camera.die_transfer import die_transfer
from maskfab.camera.imaging import Isoplanatic, Margin, RestoredBy
from maskfab.camera.protocol import Protocol, evaluate
from maskfab.job.camera import Camera, Sensor, Stop
from maskfab.optics.scene.scene import Scene

CAMERA = Camera(2000.0, Stop("circle", 300.0), (610.0, 530.0, 470.0), 1.4, 128.0)
PANEL = panel(noise(7, 0.4, 4), cells=16, seed=3)


@pytest.fixture(scope="module")
def near_and_far():
    scene = Scene(nearest_um=20e3, farthest_um=math.inf)
    return [die_transfer("D", PANEL, CAMERA, scene, object_um=distance) for distance in (20e3, math.inf)]


def test_light_falls_where_the_sum_over_the_scene_says():
    """Every pixel by its own sum of scene times point spread, on the circle that a transform closes."""
    shape, draw = (24, 20), np.random.default_rng(0)
    spread = draw.random((3, *shape), dtype=np.float32)
    scene = draw.random((3, *shape), dtype=np.float32)
    found = Margin(shape, 4).through(scene, np.fft.rfft2(spread).astype(np.complex64))
    for row, column in ((4, 4), (11, 7), (19, 15)):
        back = np.roll(spread[:, ::-1, ::-1], (row + 1, column + 1), axis=(1, 2))
        assert found[:, row - 4, column - 4] == pytest.approx((back * scene).sum(axis=(1, 2)), rel=1e-5)


def test_a_transfer_is_computed_once_for_each_shape_and_kept_from_change():
    class Counted(Isoplanatic):
        calls = 0
        transmission = 1.0

        def _transfer(self, shape):
            Counted.calls += 1
            return np.ones((3, shape[0], shape[1] // 2 + 1), dtype=np.float32)

    design = Counted("C")
    light, margin = np.random.default_rng(0).random((3, 32, 32), dtype=np.float32), Margin((32, 32), 8)
    assert design.blurred(light, margin) == pytest.approx(light[:, 8:-8, 8:-8], abs=1e-6)
    assert design.blurred(light, margin) is not design.blurred(light, margin)
    assert Counted.calls == 1
    with pytest.raises(ValueError, match="read-only"):
        design.on((32, 32))[:] = 0
    assert design.on((16, 32)).shape == (3, 16, 17)
    assert Counted.calls == 2


def test_a_near_object_is_photographed_as_such_and_deblurred_by_the_transfer_of_infinity(near_and_far):
    near, far = near_and_far
    mistaken = RestoredBy(near, far)
    known = leaves(1, 832, 832)
    kind = Protocol("quiet", Sensor(full_well=1e6, read_noise=0.0))
    np.testing.assert_array_equal(
        kind.photograph(mistaken, known, 50.0).values, kind.photograph(near, known, 50.0).values
    )
    np.testing.assert_array_equal(mistaken.on((64, 64)), far.on((64, 64)))
    assert (mistaken.name, mistaken.transmission) == (near.name, near.transmission)


def test_to_restore_by_another_transfer_costs_what_the_right_one_gains(near_and_far):
    near, far = near_and_far
    designs = [near, RestoredBy(replace(near, name="mistaken"), far)]
    scenes = (leaves(1, 832, 832),)
    own, mistaken = evaluate(designs, scenes, scenes, (40,), protocol=Protocol("camera"), details=False).scores
    assert mistaken.psnr < own.psnr - 0.3
