"""Drawn scenes have the light and the spectra that photographs have."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.fft
from once import leaves

from maskfab.camera.scenes import LONG, SHORT, bundled, dead_leaves, indoors


def _falls_as(green: np.ndarray) -> float:
    """p of f^-p, from 0.02 to 0.4 cycles per pixel, under a Hann window."""
    rows, columns = green.shape
    window = np.hanning(rows)[:, None] * np.hanning(columns)
    power = abs(scipy.fft.rfft2((green - green.mean()) * window)) ** 2
    distance = np.hypot(scipy.fft.fftfreq(rows)[:, None], scipy.fft.rfftfreq(columns))
    edges = np.geomspace(0.02, 0.4, 13)
    ring = np.digitize(distance, edges)
    level = [power[ring == k].mean() for k in range(1, len(edges))]
    return float(-np.polyfit(np.log(edges[:-1] * edges[1:]) / 2, np.log(level), 1)[0])


def test_scenes_alternate_between_daylight_and_indoors() -> None:
    scenes = bundled()
    assert [scene.name for scene in scenes] == ["leaves1", "leaves2_dim", "leaves3", "leaves4_dim"]
    for scene in scenes:
        dim = scene.number % 2 == 0
        assert scene.values.shape == (3, SHORT, LONG)
        assert scene.values.dtype == np.float32
        assert scene.values.min() >= 0
        assert scene.values.max() <= 1
        assert float(scene.values.mean()) == pytest.approx(0.10 if dim else 0.37, abs=0.03)
        assert _falls_as(scene.values[1]) == pytest.approx(3.5 if dim else 2.9, abs=0.1)


def test_a_scene_follows_from_its_seed_and_more_scenes_begin_with_the_same() -> None:
    drawn = bundled(3)
    assert np.array_equal(dead_leaves(3).values, drawn[2].values)
    assert np.array_equal(drawn[1].values, indoors(leaves(2)).values)


def test_indoors_keeps_the_mean_and_turns_with_the_scene() -> None:
    scene = dead_leaves(5, 192, 256)
    dim = indoors(scene)
    assert dim.values.mean() == pytest.approx(0.3 * scene.values.mean(), rel=2e-3)
    turned = type(scene)(scene.name, scene.number, scene.values[:, ::-1, ::-1])
    assert np.allclose(indoors(turned).values, dim.values[:, ::-1, ::-1], atol=1e-6)


def test_leaves_fall_one_after_the_other():
    """As they are drawn disc by disc, to the last bit."""
    rows, columns, draw, count = 96, 128, np.random.default_rng(3), 6000
    share = draw.random(count)
    radii = 1 / np.sqrt(share / 300.0**2 + (1 - share) / 3.0**2)
    radii[:120] = np.maximum(radii[:120], draw.uniform(80, 300, 120))
    middles, brightness = draw.random((count, 2)) * (rows, columns), draw.random(count) ** 2
    colours = np.clip(brightness[:, None] * draw.uniform(0.6, 1.4, (count, 3)), 0.01, 1).astype(np.float32)
    values = np.full((3, rows, columns), 0.2, dtype=np.float32)
    y, x = np.arange(rows, dtype=np.float32)[:, None], np.arange(columns, dtype=np.float32)
    for middle, radius, colour in zip(middles.astype(np.float32), radii, colours, strict=True):
        cover = np.clip(np.float32(radius + 0.5) - np.hypot(y - middle[0], x - middle[1]), 0, 1)
        values += (colour[:, None, None] - values) * cover
    np.testing.assert_array_equal(dead_leaves(3, rows, columns).values, np.clip(values, 0, 1))
