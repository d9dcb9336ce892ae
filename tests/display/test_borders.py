"""Gaps across borders: against distances counted one by one, and against KLayout's own geometry."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from sweeps import in_turns, sweep

from maskfab.base.model import Emitters, Opening, Panel, Tiling, orient
from maskfab.display.emitter_rules import EmitterGrid, EmitterRules
from maskfab.display.free_area import borders, margin, meetings
from maskfab.display.polygon_check import _pairs, _tile, _unlike, violations
from maskfab.optics.tiling import orientations

ALL = orientations(Tiling.RANDOM, 40, 40, 1)


def grid(n: int, gutter: int, to_opening: int, colour_gap: int) -> EmitterGrid:
    return EmitterGrid(n, 1000, 1, gutter * 1000, to_opening, colour_gap, 1)


def counted(labels: np.ndarray, opening: np.ndarray, rules: EmitterGrid, pair: tuple[int, int], diagonal: bool) -> bool:
    """Whether a pair keeps the rules, from every two cells."""
    period = rules.cells + rules.gutter
    shift = np.array([period if diagonal else 0, period])
    one, two = ((orient(labels, k), orient(opening, k)) for k in pair)

    def gap(a: np.ndarray, b: np.ndarray) -> int:
        steps = abs((np.argwhere(b) + shift)[None] - np.argwhere(a)[:, None]).max(axis=2) - 1
        return int(steps.min(initial=10**6))

    different = [gap(one[0] == i, two[0] == j) for i, j in product((1, 2, 3), repeat=2) if i != j]
    near = [gap(one[0] > 0, two[1]), gap(one[1], two[0] > 0)]
    return min(different) >= rules.colour_gap and min(near) >= rules.to_opening


@given(
    arrays(np.int8, (6, 6), elements=st.integers(0, 4)),
    st.integers(0, 2),
    st.integers(0, 3),
    st.integers(0, 3),
)
def test_every_pair_as_counted_cell_by_cell(drawn: np.ndarray, gutter: int, to_opening: int, gap: int) -> None:
    opening, labels = drawn == 4, np.where(drawn == 4, 0, drawn).astype(np.int8)
    rules = grid(6, gutter, to_opening, gap)
    found = borders(labels, opening, rules, ALL)
    assert (found.side_pairs, found.diagonal_pairs) == (64, 64)
    pairs = list(product(range(8), repeat=2))
    assert found.side_violations == sum(not counted(labels, opening, rules, pair, False) for pair in pairs)
    assert found.diagonal_violations == sum(not counted(labels, opening, rules, pair, True) for pair in pairs)
    assert found.legal == (found.side_violations + found.diagonal_violations == 0)


@given(arrays(np.int8, (8, 8), elements=st.integers(0, 4)), st.integers(0, 2), st.integers(0, 3), st.integers(0, 3))
def test_the_margin_makes_every_pair_legal(drawn: np.ndarray, gutter: int, to_opening: int, gap: int) -> None:
    rules = grid(8, gutter, to_opening, gap)
    free = margin(rules)
    kept = np.zeros((8, 8), dtype=bool)
    if free < 4:
        kept[free : 8 - free, free : 8 - free] = True
    labels = np.where(kept & (drawn < 4), drawn, 0).astype(np.int8)
    found = borders(labels, drawn == 4, rules, ALL)
    assert found.legal
    assert found.margin_nm == free * 1000


def test_only_pairs_that_meet_count() -> None:
    beside, across = meetings(orientations(Tiling.PERIODIC, 3, 3, None))
    assert beside == across == {(0, 0), (3, 3)}
    beside, _ = meetings(orientations(Tiling.ROT90, 4, 4, None))
    assert beside == {(0, 1), (1, 0), (3, 2), (2, 3)}
    both = meetings(ALL)
    assert [len(pairs) for pairs in both] == [64, 64]


@pytest.mark.parametrize(
    ("gutter_nm", "tiling"), sweep(in_turns([0, 2000], [Tiling.PERIODIC, Tiling.RANDOM, Tiling.ROT90FLIP]), 3)
)
def test_klayout_sees_the_same_violations(tiling: Tiling, gutter_nm: int) -> None:
    rng = np.random.default_rng(3)
    agreed = set()
    for _ in range(12):
        n = 9
        opening = np.zeros((n, n), dtype=bool)
        row, column = rng.integers(1, n - 2, 2)
        opening[row : row + 2, column : column + 2] = True
        labels = np.zeros((n, n), dtype=np.int8)
        for colour in (1, 2, 3):
            y, x = rng.integers(0, n - 1, 2)
            labels[y : y + 2, x : x + 2] = colour
        labels[opening] = 0
        rules = EmitterRules(1000, 2000, 1000)
        panel = Panel(
            Opening("o", opening, 1000),
            1000,
            gutter_nm,
            orientations(tiling, 24, 24, 1),
            tiling,
            1,
            Emitters(labels, 1000),
        )
        found = borders(labels, opening, EmitterGrid(n, 1000, 1, gutter_nm, 1, 2, 1), panel.orientations)
        inside = inner_violation(labels, opening)
        seen = {each.rule for each in violations(panel, rules)}
        assert bool(seen) == (inside or not found.legal)
        agreed.add(bool(seen))
    assert agreed == {True, False} or gutter_nm == 0


def test_pairs_that_are_left_out_are_others_turned():
    rng = np.random.default_rng(7)
    openings = [Opening(f"o{number}", rng.random((5, 5)) < 0.4, 1000) for number in range(2)]
    cells = rng.integers(16, size=(120, 120)).astype(np.int8)
    panel = Panel(openings[0], 1000, 2000, cells, Tiling.MAP, 1, others=(openings[1],))

    def drawn(one: int, other: int, step: tuple[int, int]) -> np.ndarray:
        """Dots of a pair in the middle of an empty square, gutters between them."""
        whole = np.zeros((21, 21), dtype=np.int8)
        for cell, (column, row) in ((one, (7, 7)), (other, (7 + 7 * step[0], 7 + 7 * step[1]))):
            whole[row + 1 : row + 6, column + 1 : column + 6] = panel.pattern(cell)
        return whole

    def alike(pair) -> tuple[tuple[int, ...], bytes]:
        whole = drawn(*pair)
        turned = [orient(whole, k) for k in range(8)]
        # Wherever the pair lies: its cells alone, from the first row and column that they take.
        frames = []
        for each in turned:
            ys, xs = np.nonzero(each)
            frames.append(each[ys.min() : ys.max() + 1, xs.min() : xs.max() + 1])
        return min((frame.shape, frame.tobytes()) for frame in frames)

    pairs = _pairs(panel)
    unlike = _unlike(pairs)
    assert {alike(pair) for pair in pairs} == {alike(pair) for pair in unlike}
    assert len({alike(pair) for pair in unlike}) == len(unlike) < len(pairs) / 5
    assert len(_tile(panel, unlike)) == 2 * len(unlike)


def inner_violation(labels: np.ndarray, opening: np.ndarray) -> bool:
    def gap(a: np.ndarray, b: np.ndarray) -> int:
        return int((abs(np.argwhere(b)[None] - np.argwhere(a)[:, None]).max(axis=2) - 1).min(initial=99))

    pairs = [gap(labels == i, labels == j) for i, j in ((1, 2), (1, 3), (2, 3))]
    return min(pairs) < 2 or gap(labels > 0, opening) < 1


def test_a_narrow_emitter_is_seen() -> None:
    labels = np.zeros((6, 6), dtype=np.int8)
    labels[1:4, 1:3], labels[1:3, 4:6], labels[4:6, 0:2] = 1, 2, 3
    panel = Panel(
        Opening("o", np.eye(6, dtype=bool) & False | (np.arange(36).reshape(6, 6) == 35), 1000),
        1000, 4000, orientations(Tiling.PERIODIC, 4, 4, None), Tiling.PERIODIC, None, Emitters(labels, 1000),
    )  # fmt: skip
    assert {each.rule for each in violations(panel, EmitterRules(0, 0, 2000))} == set()
    wide = {each.rule for each in violations(panel, EmitterRules(0, 0, 3000))}
    assert wide == {"width of red", "width of green", "width of blue"}
