"""Slivers are told from faults by their width alone, however long they are and wherever they lie."""

from __future__ import annotations

import math
from fractions import Fraction
from itertools import pairwise

import gdstk
import numpy as np
import pytest
from hypothesis import assume, example, given
from hypothesis import strategies as st
from klayout import db

from maskfab.mask.comparison.roundtrip import sift

pytestmark = pytest.mark.usefixtures("read_here")


def kinds(*shapes, tolerance=1.0):
    found = sift(db.Region([db.Polygon(shape) for shape in shapes]).merged(), tolerance)
    return found.faults.count(), found.slivers.count(), found.widest_nm


@pytest.mark.parametrize("length", [1, 50_000, 900_000])
@pytest.mark.parametrize("place", [0, -60_000_000])
def test_an_edge_off_by_the_tolerance_is_a_sliver_and_by_twice_that_a_fault(length, place):
    assert kinds(db.Box(place, 0, place + 1, length)) == (0, 1, pytest.approx(1, abs=0.01))
    assert kinds(db.Box(place, 0, place + 2, max(2, length)))[:2] == (1, 0)
    assert kinds(db.Box(place, 0, place + 1, length), tolerance=0)[:2] == (1, 0)


def test_an_edge_across_a_plate_is_told_as_well():
    assert kinds(db.Box(0, 0, 1, 120_000_000))[:2] == (0, 1)
    assert kinds(db.Box(0, 0, 2, 120_000_000))[:2] == (1, 0)


def test_a_bent_sliver_is_no_wider_than_its_arms():
    """Though no straight strip of that width holds it."""
    bent = db.Region(db.Box(0, 0, 30_000, 1)) + db.Region(db.Box(29_999, 0, 30_000, 20_000))
    assert kinds(*bent.merged().each()) == (0, 1, pytest.approx(1, abs=0.01))


def test_a_wide_part_makes_a_fault_of_what_hangs_on_it():
    both = db.Region(db.Box(0, 0, 30_000, 1)) + db.Region(db.Box(10_000, 0, 10_003, 3))
    assert kinds(*both.merged().each())[:2] == (1, 0)


@given(
    corners=st.tuples(*(st.tuples(st.integers(-2000, 2000), st.integers(-2000, 2000)) for _ in range(3))),
    tolerance=st.floats(0.3, 40),
)
@example(corners=((124, -1919), (133, 1019), (151, -362)), tolerance=36.9453125)
def test_a_triangle_is_as_wide_as_the_circle_in_it(corners, tolerance):
    (ax, ay), (bx, by), (cx, cy) = corners
    twice = abs((bx - ax) * (cy - ay) - (cx - ax) * (by - ay))
    assume(twice > 0)
    around = math.dist(corners[0], corners[1]) + math.dist(corners[1], corners[2]) + math.dist(corners[2], corners[0])
    width = 2 * twice / around
    assume(abs(width - tolerance) > 0.05)
    faults, slivers, widest = kinds(db.Polygon([db.Point(*corner) for corner in corners]), tolerance=tolerance)
    assert (faults, slivers) == ((1, 0) if width > tolerance else (0, 1))
    if slivers:
        assert width <= widest + 1e-9
        assert widest == pytest.approx(width, abs=0.05 + tolerance / 100)


def star(arms, radius):
    """Slanted wedges around a hole, and a ring of many corners."""

    def around(turns, radii):
        angles = 2 * math.pi * np.array(turns)
        ends = np.rint(np.array(radii) * [np.cos(angles), np.sin(angles)]).astype(int).T.tolist()
        return db.Polygon([db.Point(*end) for end in ends])

    wedges = [
        around([k / arms, k / arms, (k + 0.5) / arms, (k + 0.5) / arms], [radius / 9, radius, radius, radius / 9])
        for k in range(arms)
    ]
    outer, inner = (around(np.arange(97) / 97, [part * radius] * 97) for part in (1.4, 1.2))
    return [*wedges, *(db.Region(outer) - db.Region(inner)).each()]


def by_gdstk(polygons, most=5):
    simple = [polygon.resolved_holes() for polygon in polygons]
    pieces = [gdstk.Polygon([(p.x, p.y) for p in each.each_point_hull()]).fracture(most, 1e-3) for each in simple]
    return [np.rint(piece.points).astype(int).tolist() for each in pieces for piece in each]


def slabs(polygons, to_grid, upright=False):
    """Trapezoids between the lines through all corners of a polygon, as fractures for writers are made."""
    pieces = []
    for polygon in polygons:
        rings = [list(polygon.each_point_hull()), *(list(polygon.each_point_hole(i)) for i in range(polygon.holes()))]
        ends = [[(p.y, p.x) if upright else (p.x, p.y) for p in ring] for ring in rings]
        sides = [sorted(side, key=lambda end: end[1]) for ring in ends for side in pairwise([*ring, ring[0]])]
        for low, high in pairwise(sorted({y for ring in ends for _, y in ring})):
            cuts = sorted(
                tuple(ax + Fraction((bx - ax) * (y - ay), by - ay) for y in (low, high))
                for (ax, ay), (bx, by) in sides
                if ay <= low < high <= by
            )
            for left, right in zip(cuts[::2], cuts[1::2], strict=True):
                corners = [(left[0], low), (right[0], low), (right[1], high), (left[1], high)]
                on_grid = [(to_grid(x), y) for x, y in corners]
                pieces.append([(y, x) for x, y in on_grid] if upright else on_grid)
    return pieces


FRACTURES = {
    "gdstk, 5 corners": by_gdstk,
    "gdstk, 8 corners": lambda polygons: by_gdstk(polygons, 8),
    "lying, nearest": lambda polygons: slabs(polygons, round),
    "lying, below": lambda polygons: slabs(polygons, math.floor),
    "upright, nearest": lambda polygons: slabs(polygons, round, upright=True),
    "upright, above": lambda polygons: slabs(polygons, math.ceil, upright=True),
}


@pytest.mark.parametrize("fracture", FRACTURES.values(), ids=FRACTURES)
def test_any_fracture_into_trapezoids_is_slivers_and_an_edge_of_it_off_by_two_nanometres_a_fault(fracture):
    """Every slanted mark is cut into pieces whose corners lie on the grid; the longest edge is then moved."""
    design = star(23, 61_003)
    pieces = fracture(design)
    assert len(pieces) > 2 * len(design)

    def judged(drawn):
        return sift((db.Region([polygon_of(piece) for piece in drawn]) ^ db.Region(design)).merged(), 1.0)

    whole = judged(pieces)
    assert whole.faults.is_empty()
    assert 0 < whole.widest_nm <= 1
    assert whole.slivers.area() > 0
    length, which, corner = max(
        (math.dist(piece[k - 1], piece[k]), number, k)
        for number, piece in enumerate(pieces)
        for k in range(len(piece))
        if piece[k - 1][0] != piece[k][0] and piece[k - 1][1] != piece[k][1]
    )
    ends = np.array(pieces[which])
    along = ends[corner] - ends[corner - 1]
    for way in (2, -2):
        moved = ends.copy()
        moved[[corner - 1, corner]] += way * np.eye(2, dtype=int)[int(abs(along[0]) > abs(along[1]))]
        found = judged([*pieces[:which], moved.tolist(), *pieces[which + 1 :]])
        assert found.faults.area() > length, way


def polygon_of(piece):
    return db.Polygon([db.Point(*end) for end in piece])
