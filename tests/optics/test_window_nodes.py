"""Fewer samples with the same sums: all sums, about half the samples, and none too few where nothing can be saved."""

from __future__ import annotations

import tracemalloc

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from maskfab.errors import InternalError
from maskfab.optics.torch.phasors import cosines_and_sines
from maskfab.optics.torch.window_nodes import NODE_TOLERANCE, WindowNodes, every_position, window_nodes

HALF_MICROMETRES = 0.5 * np.arange(257)


def sums(nodes: WindowNodes, frequency: np.ndarray) -> np.ndarray:
    return np.asarray(np.cos(2 * np.pi * frequency[:, None] * nodes.position_um) @ nodes.weight)


def error(position: np.ndarray, highest: float, nodes: WindowNodes) -> float:
    frequency = np.linspace(0, highest, 3000)
    every = every_position(position)
    return float(np.abs(sums(nodes, frequency) - sums(every, frequency)).max() / every.weight.sum())


@example(37, 0.25, True, 1e-9)
@settings(max_examples=25, deadline=None)
@given(st.integers(3, 90), st.sampled_from([0.25, 0.5, 2.0]), st.booleans(), st.floats(0.0, 1.3))
def test_sums_are_those_of_all_samples(count: int, step: float, on_axis: bool, share: float) -> None:
    """``share`` of the sampling frequency; beyond half of that and more, there are waves that no fewer samples tell."""
    position = step * (np.arange(count) + (0.0 if on_axis else 0.5))
    nodes = window_nodes(position, share / step)
    assert nodes.position_um.size <= count
    assert np.all(np.diff(nodes.position_um) > 0)
    assert error(position, share / step, nodes) <= 2 * NODE_TOLERANCE


@pytest.mark.parametrize("wavelength_um", [0.47, 0.53, 0.61])
def test_window_of_a_phone_camera_needs_hardly_more_than_one_node_to_two_waves(wavelength_um: float) -> None:
    highest = 4016 / (wavelength_um * 1e4) + 0.25
    nodes = window_nodes(HALF_MICROMETRES, highest)
    assert 128 * highest < nodes.position_um.size < 128 * highest + 14
    assert error(HALF_MICROMETRES, highest, nodes) <= NODE_TOLERANCE
    # Weights far from those of samples would lose digits.
    assert 0.5 < nodes.weight.min() < nodes.weight.max() < 3


def test_products_of_odd_waves_keep_their_sums() -> None:
    nodes, every = window_nodes(HALF_MICROMETRES, 0.8), every_position(HALF_MICROMETRES)
    for one, other in ((0.5, 0.3), (0.41, 0.39), (0.02, 0.78)):
        found, expected = (
            (np.sin(2 * np.pi * one * n.position_um) * np.sin(2 * np.pi * other * n.position_um)) @ n.weight
            for n in (nodes, every)
        )
        assert found == pytest.approx(expected, abs=2 * NODE_TOLERANCE * every.weight.sum())


def test_zeros_are_sought_without_a_table_of_all_waves() -> None:
    """Frequencies by half-window samples would do; a table over the search's fine grid is ten times that."""
    tracemalloc.start()
    nodes = window_nodes(HALF_MICROMETRES, 1.0)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert nodes.position_um.size < HALF_MICROMETRES.size
    assert peak < 5e6


def test_nothing_is_saved_where_every_sample_counts() -> None:
    position = np.arange(65.0)
    assert window_nodes(position, 1.1).position_um is position
    np.testing.assert_array_equal(window_nodes(position, 1.1).weight[:2], [0.5, 1.0])


def test_refuses_what_is_no_half_window() -> None:
    with pytest.raises(InternalError, match="positions"):
        every_position(-HALF_MICROMETRES)
    with pytest.raises(InternalError, match="highest"):
        window_nodes(HALF_MICROMETRES, -0.1)


def test_waves_keep_their_digits_after_many_cycles() -> None:
    """At eighths of a cycle beyond whole ones they are known; a phase in radians has lost four digits by then."""
    eighths = np.arange(-4, 5)
    found = cosines_and_sines(np.array([1.0, 4096.0, 2.0**20]), 1.0 + eighths / 8 / 2.0**20)
    half = np.sqrt(0.5)
    cosine = np.array([-1.0, -half, 0.0, half, 1.0, half, 0.0, -half, -1.0])
    sine = np.array([0.0, -half, -1.0, -half, 0.0, half, 1.0, half, 0.0])
    np.testing.assert_allclose(found[:, 2], [cosine, sine], atol=4e-16)
    np.testing.assert_allclose(found[:, 0] ** 2, 1 - found[::-1, 0] ** 2, atol=4e-16)
