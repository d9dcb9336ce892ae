"""Boxes in free cells: against every placement of small ones, under turns, and never closer than their gap."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from maskfab.base.model import ORIENTATIONS, orient
from maskfab.display.box_packing import Kind, Packing

NODES = 400


def kind(count: int, high: int, wide: int, gap: int, *, turnable: bool = True) -> Kind:
    return Kind(count, (high, wide), (high + gap, wide + gap), turnable and high != wide)


def placeable(packing: Packing) -> bool:
    """Whether all boxes have a place, by trying every one; knows no theorem and no rule of thumb."""
    n = len(packing.free)
    gap = packing.kinds[0].step[0] - packing.kinds[0].size[0]
    boxes = [number for number, each in enumerate(packing.kinds) for _ in range(each.count)]
    options: list[list[tuple[int, int]]] = []
    for each in packing.kinds:
        masks = []
        for high, wide in {each.size, each.size[::-1]} if each.turnable else {each.size}:
            for y in range(n - high + 1):
                for x in range(n - wide + 1):
                    if packing.free[y : y + high, x : x + wide].all():
                        own = np.zeros((n, n), dtype=bool)
                        own[y : y + high, x : x + wide] = True
                        near = np.zeros((n, n), dtype=bool)
                        near[max(0, y - gap) : y + high + gap, max(0, x - gap) : x + wide + gap] = True
                        masks.append(
                            tuple(int("".join("01"[bit] for bit in m.ravel().astype(int)), 2) for m in (own, near))
                        )
        options.append(masks)

    def lay(which: int, taken: int, first: int) -> bool:
        if which == len(boxes):
            return True
        places = options[boxes[which]]
        for number in range(first if which and boxes[which] == boxes[which - 1] else 0, len(places)):
            own, near = places[number]
            if not own & taken and lay(which + 1, taken | near, number + 1):
                return True
        return False

    return lay(0, 0, 0)


def assert_apart(packing: Packing, places) -> None:
    """Boxes on free cells, a gap from each other, none more often than it is there."""
    taken = np.zeros_like(packing.free)
    for index, row, column in places:
        shape = packing.shapes[index]
        high, wide = shape.size
        gap = shape.step[0] - high
        assert packing.free[row : row + high, column : column + wide].all()
        assert row + high <= len(packing.free) >= column + wide
        assert not taken[row : row + high, column : column + wide].any()
        taken[max(0, row - gap) : row + high + gap, max(0, column - gap) : column + wide + gap] = True
    for number, each in enumerate(packing.kinds):
        assert sum(packing.shapes[index].kind == number for index, _, _ in places) <= each.count


def small(count: int, seed: int) -> Iterator[Packing]:
    """Packings of a few boxes of one to three cells a side, about as many as there is room for."""
    rng = np.random.default_rng(seed)
    for _ in range(count):
        n, gap = int(rng.integers(3, 8)), int(rng.integers(0, 3))
        free = rng.random((n, n)) < rng.uniform(0.6, 1)
        kinds = tuple(
            kind(int(rng.integers(1, 4)), *map(int, rng.integers(1, 4, 2)), gap, turnable=bool(rng.integers(2)))
            for _ in range(int(rng.integers(1, 3)))
        )
        yield Packing(free, kinds)


def test_a_proof_is_never_given_where_a_placement_exists():
    """Nor is a placement told that is none; what the search has ended is exact both ways."""
    told = {"placed": 0, "homeless": 0, "points": 0, "ended": 0, "open": 0}
    for packing in small(400, seed=1):
        fits = placeable(packing)
        found = packing.placed(nodes=NODES)
        assert_apart(packing, found.places)
        assert found.complete == (len(found.places) == packing.boxes)
        assert not found.complete or fits
        short = packing.shortage()
        if packing.homeless() is not None:
            told["homeless"] += 1
            assert not fits
        elif short is not None:
            told["points"] += 1
            assert not fits
            assert short.points < short.covered
        elif found.complete:
            told["placed"] += 1
        elif found.exhausted:
            told["ended"] += 1
            assert not fits
        else:
            told["open"] += 1
    assert min(told["placed"], told["homeless"], told["points"], told["ended"]) >= 3, told
    assert told["open"] <= 4, told


def test_lattices_prove_what_area_does_not():
    """Two corridors of a cell and a half: room for nine squares by area, for four by points two apart."""
    free = np.zeros((12, 12), dtype=bool)
    free[0:3, 0:6] = free[6:9, 0:6] = True
    packing = Packing(free, (kind(7, 2, 2, 0),))
    assert int(free.sum()) >= 7 * 4
    short = packing.shortage()
    assert short is not None
    assert (short.spacing, short.covered, short.points, short.areas) == ((2, 2), 7, 6, 2)
    assert Packing(free, (kind(6, 2, 2, 0),)).placed(nodes=NODES).complete
    assert Packing(free, (kind(6, 2, 2, 0),)).shortage() is None


def test_every_place_of_a_box_covers_the_points_that_the_proof_tells():
    """Counted on the marks themselves, without gaps, which the marks leave out beyond the grid."""
    rng = np.random.default_rng(4)
    looked = 0
    for _ in range(40):
        free = np.zeros((14, 14), dtype=bool)
        for start in rng.integers(0, 12, size=3):
            strip = free if rng.integers(2) else free.T
            strip[start : start + 3] = True
        packing = Packing(free, (kind(int(rng.integers(12, 26)), 2, 2, 0), kind(2, 2, 4, 0)))
        short = packing.shortage()
        if short is None or packing.homeless() is not None:
            continue
        looked += short.spacing != (1, 1)
        covered = 0
        for number in short.kinds:
            least = min(
                int(short.marks[row : row + shape.step[0], column : column + shape.step[1]].sum())
                for shape, anchors in zip(packing.shapes, packing.anchors, strict=True)
                if shape.kind == number
                for row, column in np.argwhere(anchors)
            )
            covered += packing.kinds[number].count * least
        assert covered >= short.covered > short.points
        assert int(short.marks.sum()) >= short.points
        assert len(short.kinds) == 1 or int(short.marks.sum()) == short.points
    assert looked >= 5


def test_a_rest_in_every_area_is_lost():
    """Three areas of five cells hold two boxes of two each: seven do not fit, though fifteen cells are free."""
    free = np.zeros((5, 9), dtype=bool)
    free[:, ::4] = True
    padded = np.zeros((9, 9), dtype=bool)
    padded[:5] = free
    packing = Packing(padded, (kind(7, 2, 1, 0),))
    short = packing.shortage()
    assert short is not None
    assert (short.points, short.areas) == (6 * short.covered // 7, 3)
    assert Packing(padded, (kind(6, 2, 1, 0),)).placed(nodes=NODES).complete


@pytest.mark.parametrize(("side", "count", "fits"), [(5, 5, False), (6, 4, True), (8, 9, True), (8, 10, False)])
def test_squares_in_a_square(side: int, count: int, fits: bool) -> None:
    """Squares of two cells, a cell apart: (side + 1) / 3 along each side, rounded down."""
    packing = Packing(np.ones((side, side), dtype=bool), (kind(count, 2, 2, 1),))
    assert packing.quickly().complete == fits
    assert (packing.shortage() is None) == fits


def test_the_answer_turns_with_the_free_cells():
    """Whether there is a proof, and whether all are placed, is the same for all eight."""
    for packing in small(25, seed=2):
        answers = set()
        for element in range(ORIENTATIONS):
            kinds = tuple(
                each if element % 2 == 0 else replace(each, size=each.size[::-1], step=each.step[::-1])
                for each in packing.kinds
            )
            turned = Packing(np.ascontiguousarray(orient(packing.free, element)), kinds)
            found = turned.placed(nodes=NODES)
            excluded = turned.homeless() is not None or turned.shortage() is not None or found.exhausted
            answers.add((found.complete, excluded and not found.complete))
        assert len(answers) == 1, answers


@settings(max_examples=60, deadline=None)
@given(
    st.integers(4, 14), st.integers(0, 3), st.integers(0, 2**32 - 1),
    st.lists(st.tuples(st.integers(1, 5), st.integers(1, 5), st.integers(1, 5)), min_size=1, max_size=3),
)  # fmt: skip
def test_whatever_is_placed_keeps_every_gap(n: int, gap: int, seed: int, sizes) -> None:
    rng = np.random.default_rng(seed)
    packing = Packing(rng.random((n, n)) < 0.9, tuple(kind(*each, gap) for each in sizes))
    for found in (packing.quickly(), packing.placed(nodes=30)):
        assert_apart(packing, found.places)
    if found.complete:
        assert packing.homeless() is None
        assert packing.shortage() is None


def test_boxes_of_a_group_lie_together_where_nothing_stands_in_the_way():
    """Three groups of a large and two small boxes on free ground: each within its own band."""
    packing = Packing(np.ones((30, 30), dtype=bool), (kind(3, 6, 6, 1), kind(6, 2, 6, 1)), groups=3)
    order = [packing.shapes[index].kind for index, _, _ in packing.quickly().places]
    assert order == [0, 1, 1] * 3
