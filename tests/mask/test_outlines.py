"""Many outlines drawn at once are what klayout draws of each, and those that could mean less are told apart."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from klayout import db

from maskfab.mask.layout import is_plain, outlines_layout

FARTHEST = 2**31 - 1
NEAR = st.integers(-3, 3)
FAR = st.sampled_from([-FARTHEST, -1_000_000_007, 0, 1, 1_000_000_009, FARTHEST])
CORNER = st.tuples(NEAR, NEAR) | st.tuples(FAR, FAR)


def arrays(outlines):
    sizes = np.array([len(each) for each in outlines], dtype=np.int64)
    return np.array([corner for each in outlines for corner in each], dtype=np.int64).reshape(-1, 2), sizes


def polygon(outline):
    return db.Polygon([db.Point(*corner) for corner in outline])


@given(st.lists(st.lists(CORNER, min_size=1, max_size=7), min_size=1, max_size=5))
def test_plain_outlines_are_drawn_as_each_alone_and_all_others_are_not_called_plain(outlines):
    """klayout leaves out corners that do not turn: a plain outline keeps all of them, and has an area."""
    corners, sizes = arrays(outlines)
    at_once = is_plain(corners, sizes)
    for each, called in zip(outlines, at_once.tolist(), strict=True):
        alone = polygon(each)
        if called:
            assert alone.num_points() == len(each)
            assert alone.area2() != 0
        elif max(abs(value) for corner in each for value in corner) <= 3:
            # Of outlines so small nothing is rounded: what is called otherwise is so.
            assert alone.num_points() < len(each) or alone.area2() == 0
    layout = outlines_layout(corners[np.repeat(at_once, sizes)], sizes[at_once], np.flatnonzero(at_once))
    for number in np.flatnonzero(at_once).tolist():
        (shape,) = layout.top_cell().shapes(layout.find_layer(number, 0)).each()
        alone = polygon(outlines[number])
        assert shape.is_box() == alone.is_box()
        assert shape.polygon == alone
    assert layout.layers() == at_once.sum()


@pytest.mark.parametrize("count", [8189, 8190, 8191])
def test_an_outline_as_long_as_a_record_holds_is_drawn_whole_and_a_longer_one_is_no_plain_one(count):
    along = np.arange(count)
    outline = np.stack([2 * along, along % 2], axis=1)
    outline[-1] = count, 1_000_000
    sizes = np.array([count])
    (fits,) = is_plain(outline, sizes)
    assert fits == (count <= 8190)
    if fits:
        layout = outlines_layout(outline, sizes, np.zeros(1, dtype=np.int64))
        (shape,) = layout.top_cell().shapes(0).each()
        assert shape.polygon.num_points() == count
        assert shape.polygon.area() == polygon(outline.tolist()).area()
