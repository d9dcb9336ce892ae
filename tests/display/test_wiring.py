"""Lines, barriers, ports and ways to the gutter, against what can be counted by hand."""

from __future__ import annotations

from itertools import combinations

import numpy as np
import pytest
from scipy import ndimage

from maskfab.base.model import ORIENTATIONS, Emitters, orient
from maskfab.display.pixel_lines import DIRECTIONS, Direction, Net, WireRules, lines_per_layer, ports
from maskfab.display.wiring import reaches


@pytest.mark.parametrize("seed", range(20))
@pytest.mark.parametrize("direction", DIRECTIONS)
def test_lines_are_disjoint_and_as_many_as_were_counted(seed: int, direction: Direction) -> None:
    closed = np.random.default_rng(seed).random((11, 11)) < 0.5 + 0.02 * seed
    net = Net(closed, direction)
    axis = 0 if direction == "vertical" else 1
    used = np.zeros(closed.shape, dtype=int)
    for path in net.paths():
        assert (abs(np.diff(path, axis=0)).sum(axis=1) == 1).all()
        assert path[0, axis] == 0
        assert path[-1, axis] == 10
        used[tuple(path.T)] += 1
    assert used.max(initial=0) <= 1
    assert not (used.astype(bool) & ~closed).any()
    assert len(net.paths()) == net.count()


@pytest.mark.parametrize("seed", range(8))
def test_as_many_lines_pass_as_dots_must_be_opened_to_stop_them(seed: int) -> None:
    closed = np.random.default_rng(seed).random((5, 5)) < 0.7
    dots = np.argwhere(closed)

    def passes(opened: tuple[int, ...]) -> bool:
        left = closed.copy()
        left[tuple(dots[list(opened)].T)] = False
        pieces, _ = ndimage.label(left)
        return bool(set(pieces[0][pieces[0] > 0]) & set(pieces[-1][pieces[-1] > 0]))

    fewest = next(k for k in range(6) if not all(passes(each) for each in combinations(range(len(dots)), k)))
    assert Net(closed, "vertical").count() == fewest


def test_slit_and_corners() -> None:
    slit = np.ones((21, 21), dtype=bool)
    slit[:, 8:13] = False
    assert (Net(slit, "vertical").count(), Net(slit, "horizontal").count()) == (16, 0)
    assert ports(slit).count == 0
    assert Net(np.eye(5, dtype=bool), "vertical").count() == 0
    assert Net(np.zeros((4, 4), dtype=bool), "vertical").count() == 0


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


def test_ports_of_one_direction_are_those_of_its_own_ends() -> None:
    """No upright line ends at an open dot of the uppermost row, nor at its mirror image; its sides do not matter."""
    closed = np.ones((6, 6), dtype=bool)
    closed[-1, 1] = False
    assert ports(closed, ["vertical"]).places == ports(closed.T, ["horizontal"]).places == (0, 2, 3, 5)


def test_all_closed_has_every_port() -> None:
    assert ports(np.ones((6, 6), dtype=bool)).count == 6


def test_gutters() -> None:
    rules = WireRules()
    assert lines_per_layer(8000, rules) == 1
    assert lines_per_layer(7999, rules) == 0


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
