"""The polygon transform: exact shapes, frequencies next to zero, and millions of edges a few at a time."""

from __future__ import annotations

import tracemalloc
from dataclasses import replace

import numpy as np
import pytest
from optics_cases import clear_region, noise, panel

from maskfab.base.errors import InternalError
from maskfab.job.camera import Stop
from maskfab.optics.field import polygons
from maskfab.optics.field.polygons import boundary
from maskfab.optics.stop_edges import edges_in_stop


def parallelogram(first, second, centre):
    """Directed edges, counter-clockwise, and the area."""
    first, second, centre = (np.asarray(each, dtype=np.float64) for each in (first, second, centre))
    corner = centre - (first + second) / 2
    corners = np.stack([corner, corner + first, corner + first + second, corner + second])
    area = first[0] * second[1] - first[1] * second[0]
    assert area > 0
    return np.concatenate([corners, np.roll(corners, -1, axis=0)], axis=1), float(area)


def exact(first, second, centre, step, count):
    """An affine image of the unit square: area x two sincs x the phase of its centre."""
    u = step * np.arange(-(count // 2), count // 2 + 1)
    q = np.stack(np.broadcast_arrays(u, u[:, None]))
    along = [np.tensordot(np.asarray(side, dtype=np.float64), q, 1) for side in (first, second, centre)]
    area = first[0] * second[1] - first[1] * second[0]
    return area * np.sinc(along[0]) * np.sinc(along[1]) * np.exp(-2j * np.pi * along[2])


SLANTED = ((70.0, 13.0), (-31.0, 55.0), (21.0, -40.0))


@pytest.fixture(scope="module")
def cells():
    """Edges of a random panel in a round stop, and the clear area."""
    return edges_in_stop(clear_region(panel(noise(6, 0.4, 3), cells=6, seed=1)), Stop("circle", 250.0), (0.0, 0.0))


@pytest.mark.parametrize("step", [1e-14, 1e-10, 1e-7, 1e-5, 1e-4, 3e-4])
def test_next_to_zero_nothing_cancels(step):
    edges, area = parallelogram(*SLANTED)
    found = boundary(edges, area, 0.05).field(step, 5)
    # All 25 frequencies lie within a quarter cycle over the region, which reaches 74 um from the origin.
    assert abs(found - exact(*SLANTED, step, 5)).max() < 1e-15 * area


def test_the_two_sums_meet_without_a_step():
    """Where the direct sum ends the transform takes over; both are right."""
    edges, area = parallelogram(*SLANTED)
    step = 4e-4
    found, expected = boundary(edges, area, 0.05).field(step, 41), exact(*SLANTED, step, 41)
    reach = int(0.25 / (2 * abs(edges).max() * step))
    assert 1 <= reach < 20
    error = abs(found - expected) / area
    middle = slice(20 - reach, 20 + reach + 1)
    assert error[middle, middle].max() < 1e-15
    assert 1e-15 < error.max() < 1e-9


def test_more_near_frequencies_than_are_summed_directly():
    edges, area = parallelogram(*SLANTED)
    found = boundary(edges, area, 0.05).field(1e-5, 65)
    error = abs(found - exact(*SLANTED, 1e-5, 65)) / area
    assert error[16:49, 16:49].max() < 1e-15
    assert error.max() < 1e-7


def test_frequency_zero_is_the_area_and_opposite_ones_are_conjugates(cells):
    found = boundary(*cells, 0.03).field(1e-3, 31)
    assert found[15, 15] == cells[1]
    np.testing.assert_array_equal(found, found[::-1, ::-1].conj())


def test_a_few_edges_at_a_time_give_the_same_field(cells):
    """One edge in the last part, parts that do not close up, and a part for every few edges.

    In the grid's corners the transform amplifies its own rounding, to some 1e-12 of the area, whatever the parts.
    """
    whole = boundary(*cells, 0.03).field(1e-3, 41)
    count = len(cells[0])
    for at_a_time in (count - 1, count // 3, 97):
        parts = boundary(*cells, 0.03, edges_at_a_time=at_a_time)
        assert parts.starts.size > 1
        found = parts.field(1e-3, 41)
        assert np.linalg.norm(found - whole) < 1e-12 * np.linalg.norm(whole)
        assert abs(found - whole).max() < 1e-11 * cells[1]
        assert abs(parts.field(1e-6, 33) - boundary(*cells, 0.03).field(1e-6, 33)).max() < 1e-15 * cells[1]


def test_edges_of_one_length_have_a_node_each_and_the_same_field(cells, monkeypatch):
    monkeypatch.setattr(polygons, "_LEAST_SAVED", 100)
    few = boundary(*cells, 0.03)
    plain = replace(few, unit_um=0.0)
    assert few.unit_um == pytest.approx(8.0, abs=1e-9)
    counts = [sum(part.dx.size for part in each._parts(each.unit_um)) for each in (few, plain)]
    assert counts[0] < 0.8 * counts[1]
    assert abs(few.field(1e-3, 41) - plain.field(1e-3, 41)).max() < 1e-8 * cells[1]
    # Next to zero both are summed node by node.
    np.testing.assert_array_equal(few.field(1e-6, 33), plain.field(1e-6, 33))


def test_few_edges_keep_their_nodes(cells):
    assert boundary(*cells, 0.03).starts.size == 1


def test_parts_bound_the_memory():
    """The nodes of 80 000 edges take some 20 MB; those of 4 000 a twentieth, and a few megabytes are scratch."""
    low = 4000 * np.arange(-70, 71, dtype=np.int64)
    x, y = (each.ravel() for each in np.meshgrid(low, low))
    edges, area = edges_in_stop(np.stack([x, y, x + 2000, y + 2000], axis=1), Stop("square", 700.0), (0.0, 0.0))
    peaks = []
    for at_a_time in (len(edges), 4000):
        tracemalloc.start()
        boundary(edges, area, 0.01, edges_at_a_time=at_a_time).field(1e-4, 9)
        peaks.append(tracemalloc.get_traced_memory()[1] - edges.nbytes)
        tracemalloc.stop()
    assert peaks[1] < peaks[0] / 4


def test_few_long_edges_take_no_more_memory_than_many_short_ones(monkeypatch):
    """Nodes of 100 needles of 4 mm would take 18 MB at once, and as much scratch."""
    monkeypatch.setattr(polygons, "_NODES_AT_A_TIME", 2**14, raising=False)
    low = np.arange(-50, 50) * 40.0
    ends = np.stack([np.full(low.size, -2000.0), low, np.full(low.size, 2000.0), low], axis=1)
    edges = np.concatenate([ends, ends[:, [2, 1, 0, 3]] + [0, 1e-3, 0, 1e-3]])
    tracemalloc.start()
    outline = boundary(edges, 4000 * 1e-3 * low.size, 0.2)
    found = outline.field(1e-3, 9)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 10e6
    u = 1e-3 * np.arange(-4, 5)
    along = 4000 * np.sinc(4000 * u) * 1e-3
    across = np.exp(-2j * np.pi * np.outer(u, low + 0.5e-3)).sum(axis=1)
    # As closely as the transform knows sums over all of the outline.
    assert abs(found - across[:, None] * along).max() < 1e-7 * 4000 * 1e-3 * low.size


def test_edges_that_two_boxes_share_cancel():
    boxes = [((40.0, 0.0), (0.0, 60.0), (x, 7.0)) for x in (-20.0, 20.0)]
    parts = [parallelogram(*box) for box in boxes]
    edges, area = np.concatenate([part[0] for part in parts]), sum(part[1] for part in parts)
    found = boundary(edges, area, 0.05).field(1e-3, 31)
    expected = exact((80.0, 0.0), (0.0, 60.0), (0.0, 7.0), 1e-3, 31)
    assert abs(found - expected).max() < 1e-8 * area


def test_beyond_the_quadrature_is_refused(cells):
    outline = boundary(*cells, 0.01)
    outline.field(0.01 / np.sqrt(2) / 10, 21)
    with pytest.raises(InternalError, match=r"0\.0101 cycles/um is beyond the quadrature's 0\.01"):
        outline.field(0.00101, 21)


def test_the_caller_cannot_change_the_edges(cells):
    edges = cells[0].copy()
    outline = boundary(edges, cells[1], 0.01, edges_at_a_time=100)
    before = outline.field(1e-3, 5)
    edges[:] = 0.0
    np.testing.assert_array_equal(outline.field(1e-3, 5), before)
