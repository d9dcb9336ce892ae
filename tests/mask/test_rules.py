from __future__ import annotations

import math

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from maskfab.base.model import orient
from maskfab.mask.dots import corner_touches, smallest_runs

masks = arrays(np.bool_, st.tuples(st.integers(1, 8), st.integers(1, 8)))


def test_a_checkerboard_touches_at_every_inner_vertex():
    assert corner_touches(np.indices((5, 7)).sum(axis=0) % 2 == 0) == 4 * 6


def test_three_clear_cells_are_joined_not_kissing():
    assert corner_touches(np.array([[1, 1], [1, 0]], dtype=np.bool_)) == 0


@given(masks, st.integers(0, 7))
def test_corner_touches_do_not_depend_on_orientation_or_tone(mask, orientation):
    assert corner_touches(orient(mask, orientation)) == corner_touches(mask) == corner_touches(~mask)


def runs_by_hand(line, edges, tone, periodic):
    """Lengths of all runs of a tone, one cell after the other."""
    n = len(line)
    if periodic:
        if all(line == line[0]):
            return []
        shift = next(i for i in range(n) if line[i] != line[i - 1])
        line = np.roll(line, -shift)
        widths = np.roll(np.diff(edges), -shift)
    else:
        widths = np.diff(edges)
    runs, start = [], 0
    for i in range(1, n + 1):
        if i == n or line[i] != line[start]:
            at_border = not periodic and (start == 0 or i == n)
            if line[start] == tone and (tone or not at_border):
                runs.append(widths[start:i].sum())
            start = i
    return runs


@settings(deadline=None)
@given(masks, st.booleans(), st.integers(0, 2**32 - 1))
def test_smallest_runs_agree_with_counting(mask, periodic, seed):
    rng = np.random.default_rng(seed)
    x, y = (np.cumsum(rng.integers(1, 9, n + 1)).astype(float) for n in mask.shape[::-1])
    found = smallest_runs(mask, x, y, periodic=periodic)
    for tone, along_x, along_y in ((True, found.clear_x, found.clear_y), (False, found.opaque_x, found.opaque_y)):
        by_rows = [run for row in mask for run in runs_by_hand(row, x, tone, periodic)]
        by_columns = [run for column in mask.T for run in runs_by_hand(column, y, tone, periodic)]
        assert along_x == min(by_rows, default=math.inf)
        assert along_y == min(by_columns, default=math.inf)


def test_runs_in_dots_need_no_edges():
    found = smallest_runs(np.array([[1, 1, 0, 1], [1, 1, 0, 1]], dtype=np.bool_))
    assert (found.clear, found.opaque) == (1, 1)
    assert found.opaque_y == math.inf
