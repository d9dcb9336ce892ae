"""Edges that light made pass every check; sharpened, tone-curved and unevenly lit ones fail, and tell no MTF50."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter
from slanted_edges import blurred_edge, rendered

import maskfab as mf
from maskfab.camera.inspection.edge_mtf import MeasuredEdges, edge_verdict, measured_edges

SIDE = 90


def drawn(seed: int, sigma: float = 0.8, normal_deg: float = 5.0, noise: float = 0.003, light=1.0):
    """An edge from 0.1 to 0.8 of white, its light times a factor for each pixel."""
    edge = 0.1 + 0.7 * rendered(SIDE, SIDE, normal_deg, blurred_edge(sigma))
    return edge * light + np.random.default_rng(seed).normal(0, noise, edge.shape)


def failed(found: MeasuredEdges) -> set[str]:
    return {row.name for edge in found.edges for row in edge.quantities if row.passed is False}


def honest(seed: int) -> set[str]:
    draw = np.random.default_rng(1000 + seed)
    sigma, normal = draw.choice([0.15, 0.3, 0.5, 0.8, 1.2, 2.0, 3.0]), draw.choice([2.5, 4, 5, 8, 20, -5, 95])
    picture = drawn(seed, sigma, normal, draw.choice([0.0, 0.001, 0.01, 0.03]))
    if draw.random() < 0.5:
        picture = draw.poisson(np.maximum(picture, 0) * 4000) / 4000
    return failed(measured_edges(np.round(picture * 4095), None))


def test_edges_of_any_blur_noise_and_slant_are_sound():
    assert [seed for seed in range(20) if honest(seed)] == []


@pytest.mark.slow
def test_of_a_hundred_sound_edges_none_is_called_unsound():
    assert [seed for seed in range(20, 140) if honest(seed)] == []


def sharpened(edge, amount):
    return edge + amount * (edge - gaussian_filter(edge, 1.5))


ROW, COLUMN = (np.mgrid[:SIDE, :SIDE] + 0.5) / SIDE - 0.5
WRONG = {
    "sharpened": (sharpened(drawn(1), 1.0), {"edge_overshoot", "edge_mtf_above_one"}),
    "sharpened a little": (sharpened(drawn(1), 0.15), {"edge_overshoot"}),
    "falling, sharpened": (sharpened(drawn(1), 0.3)[:, ::-1], {"edge_overshoot"}),
    "coded": (np.maximum(drawn(1), 0) ** (1 / 2.2), {"edge_asymmetry"}),
    "light across": (drawn(1, light=1 + 0.3 * COLUMN), {"edge_light_change"}),
    "light along": (drawn(1, light=1 + 0.3 * ROW), {"edge_light_change"}),
    "light at the corners": (drawn(1, light=1 - 0.6 * (ROW**2 + COLUMN**2)), {"edge_light_change", "edge_asymmetry"}),
}


@pytest.mark.parametrize("case", WRONG)
def test_an_edge_that_no_even_light_made_fails_and_tells_no_mtf50(case):
    picture, expected = WRONG[case]
    found = measured_edges(np.ascontiguousarray(picture), 2.0)
    assert expected <= failed(found)
    (edge,) = found.edges
    assert [row.value for row in edge.quantities if row.name.startswith("edge_mtf50")] == [None, None]
    (sentence,) = edge_verdict(found)
    assert "no MTF of a camera" in sentence
    assert "one half" not in sentence


def test_light_that_changes_by_a_twentieth_is_let_be():
    assert failed(measured_edges(drawn(1, light=1 + 0.05 * COLUMN), None)) == set()
    assert failed(measured_edges(drawn(1, light=1 + 0.05 * ROW), None)) == set()


def test_a_measurement_of_such_an_edge_does_not_pass():
    good, bad = (np.round(1e4 * each).astype(np.float32) for each in (drawn(1), sharpened(drawn(1), 1.0)))
    assert mf.edge(good).passed
    assert not mf.edge(bad).passed
