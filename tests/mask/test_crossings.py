"""Outlines that meet themselves, against KLayout's own check and against all pairs of sides."""

from __future__ import annotations

from itertools import combinations

import numpy as np
import pytest
from klayout import db

from maskfab.base.errors import SourceError
from maskfab.mask import crossings
from maskfab.mask import layout as limits
from maskfab.mask.crossings import meets_itself
from maskfab.mask.layout import check_limits


def outlines(count):
    random = np.random.default_rng(0)
    for number in range(count):
        corners = random.integers(3, 30)
        angle, radius = np.sort(random.uniform(0, 2 * np.pi, corners)), random.uniform(20, 1000, corners)
        around = np.rint(radius * np.stack([np.cos(angle), np.sin(angle)])).T.astype(np.int64)
        if number % 3 == 1:
            first, second = random.integers(0, corners, 2)
            around[[first, second]] = around[[second, first]]
        yield random.integers(0, 40, (corners, 2)) if number % 3 == 2 else around


def have_a_point_in_common(p, q, r, s, joined):
    """Sides from p to q and from r to s; joined where q is r."""
    turn = [int(np.sign((b - a)[0] * (c - a)[1] - (b - a)[1] * (c - a)[0]))
            for a, b, c in ((p, q, r), (p, q, s), (r, s, p), (r, s, q))]  # fmt: skip
    if joined:
        return turn[1] == 0 and (q - p) @ (s - r) < 0
    beside = (np.maximum(np.minimum(p, q), np.minimum(r, s)) > np.minimum(np.maximum(p, q), np.maximum(r, s))).any()
    return turn[0] * turn[1] <= 0 and turn[2] * turn[3] <= 0 and not beside


@pytest.mark.parametrize("pairs", [1, 1000], ids=["crosswise", "pair by pair"])
def test_an_outline_meets_itself_where_two_of_its_sides_do(monkeypatch, pairs):
    """Slabs of three ends make a sweep of what is else a slab."""
    monkeypatch.setattr(crossings, "_FEWEST_ENDS", 3)
    monkeypatch.setattr(crossings, "_PIECES_PER_SIDE", 10**6)
    monkeypatch.setattr(crossings, "_PAIRS_PER_SIDE", pairs)
    apart = 0
    for corners in outlines(60):
        own = corners[(corners != np.roll(corners, 1, axis=0)).any(axis=1)]
        count, sides = len(own), list(zip(own, np.roll(own, -1, axis=0), strict=True))
        expected = any(
            have_a_point_in_common(*(sides[j] + sides[i] if (j + 1) % count == i else sides[i] + sides[j]),
                                   (i + 1) % count == j or (j + 1) % count == i)
            for i, j in combinations(range(count), 2)
        )  # fmt: skip
        found = meets_itself(corners)
        assert (found is not None) == expected
        if found is None:
            apart += 1
            drawn = db.Region(db.Polygon([db.Point(*corner) for corner in corners.tolist()], True))
            drawn.merged_semantics = False
            assert drawn.strange_polygon_check().is_empty()
    assert 15 < apart < 45


def star(count):
    angle = 2 * np.pi * np.arange(count) / count
    radius = np.where(np.arange(count) % 2, 1.1e6, 1.4e6)
    return np.rint(radius * np.stack([np.cos(angle), np.sin(angle)])).T.astype(np.int64)


def test_a_crossing_among_many_sides_is_found_and_none_where_there_is_none():
    corners = star(20_000)
    assert meets_itself(corners) is None
    corners[[7_000, 7_002]] = corners[[7_002, 7_000]]
    assert np.abs(meets_itself(corners) - corners[7_000]).max() < 400_000


@pytest.mark.parametrize("swept_alone", [100_000, 5_000])
def test_a_polygon_of_many_vertices_is_swept_over_and_refused_where_it_meets_itself(tmp_path, monkeypatch, swept_alone):
    """Of very many vertices one that touches itself is refused, too: klayout would take minutes to tell."""

    monkeypatch.setattr(limits, "_SWEPT_ALONE", swept_alone)
    layout = db.Layout()
    layer, cell = layout.layer(1, 0), layout.create_cell("STAR")
    corners = star(6_000)
    cell.shapes(layer).insert(db.Polygon([db.Point(*corner) for corner in corners.tolist()], True))
    check_limits(layout, tmp_path / "x.gds")
    corners[[700, 702]] = corners[[702, 700]]
    cell.shapes(layer).insert(db.Polygon([db.Point(*corner) for corner in corners.tolist()], True))
    with pytest.raises(SourceError, match=r"MF312 .*of cell 'STAR' crosses or covers itself at") as refused:
        check_limits(layout, tmp_path / "x.gds")
    assert ("touches" in refused.value.what) == (swept_alone < 6_000)
