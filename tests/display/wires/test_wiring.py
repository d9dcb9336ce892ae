"""Lines, barriers, ports and ways to the gutter, against what can be counted by hand."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import ndimage

from maskfab.display.wires.flow import DIRECTIONS, Net, line_flow
from maskfab.display.wires.gutter import WireRules, lines_per_layer
from maskfab.display.wires.ports import ports
from maskfab.display.wires.reach import reaches
from maskfab.errors import JobError
from maskfab.model import ORIENTATIONS, Emitters, orient


@pytest.mark.parametrize("seed", range(20))
@pytest.mark.parametrize("direction", DIRECTIONS)
def test_lines_equal_the_barrier_and_are_disjoint(seed: int, direction: str) -> None:
    closed = np.random.default_rng(seed).random((11, 11)) < 0.5 + 0.02 * seed
    found = line_flow(closed, direction)  # type: ignore[arg-type]
    axis = 0 if direction == "vertical" else 1
    used = np.zeros(closed.shape, dtype=int)
    for path in found.paths:
        assert (abs(np.diff(path, axis=0)).sum(axis=1) == 1).all()
        assert path[0, axis] == 0
        assert path[-1, axis] == 10
        used[tuple(path.T)] += 1
    assert used.max(initial=0) <= 1
    assert not (used.astype(bool) & ~closed).any()
    barrier = found.certificate.witness
    assert barrier is not None
    assert (barrier & closed).sum() == found.count
    pieces, _ = ndimage.label(closed & ~barrier)
    ends = np.take(pieces, 0, axis), np.take(pieces, -1, axis)
    assert not set(ends[0][ends[0] > 0]) & set(ends[1][ends[1] > 0])


def test_slit_corners_and_capacity() -> None:
    slit = np.ones((21, 21), dtype=bool)
    slit[:, 8:13] = False
    assert (line_flow(slit, "vertical").count, line_flow(slit, "horizontal").count) == (16, 0)
    assert ports(slit).count == 0
    assert line_flow(np.eye(5, dtype=bool), "vertical").count == 0
    assert line_flow(np.ones((4, 4), dtype=bool), "vertical", capacity=3).count == 12
    assert line_flow(np.zeros((4, 4), dtype=bool), "vertical").count == 0
    for wrong, capacity in ((np.ones((3, 4), dtype=bool), 1), (np.ones((3, 3), dtype=bool), 0)):
        with pytest.raises(JobError, match="MF120"):
            line_flow(wrong, "vertical", capacity=capacity)


def test_ports_hold_in_every_orientation_and_no_larger_set_does() -> None:
    for seed in range(12):
        closed = np.random.default_rng(seed).random((7, 7)) < 0.85
        found = ports(closed)
        assert found.exact
        largest = 0
        for bits in range(16):
            places = np.array([i for i in range(7) if bits >> min(i, 6 - i) & 1], dtype=np.intp)
            if places.size and all(Net(closed, way).count(places) == places.size for way in DIRECTIONS):
                largest = max(largest, places.size)
        assert found.count == largest
        for k in range(ORIENTATIONS):
            turned = np.ascontiguousarray(orient(closed, k))
            for way in DIRECTIONS:
                paths = Net(turned, way).paths(np.array(found.places, dtype=np.intp))
                side = 1 if way == "vertical" else 0
                assert [path[0, side] for path in paths] == [path[-1, side] for path in paths] == list(found.places)


def test_all_closed_has_every_port() -> None:
    assert ports(np.ones((6, 6), dtype=bool)).count == 6


def test_gutters() -> None:
    rules = WireRules()
    assert lines_per_layer(8000, rules) == 1
    assert lines_per_layer(7999, rules) == 0
    with pytest.raises(JobError, match="MF120"):
        WireRules(line_nm=0)


def test_emitters_reach_the_gutter_or_sit_on_an_island() -> None:
    closed = np.ones((7, 7), dtype=bool)
    closed[2:5, 2:5] = False
    closed[3, 3] = True
    labels = np.zeros((14, 14), dtype=np.int8)
    labels[6:8, 6:8], labels[2:4, 2:4] = 1, 3
    red, blue = reaches(closed, Emitters(labels, 4000))
    assert red.path is None
    assert red.certificate is not None
    assert red.certificate.witness is not None
    assert np.argwhere(red.certificate.witness).tolist() == [[3, 3]]
    assert blue.path is not None
    assert len(blue.path) == 2
