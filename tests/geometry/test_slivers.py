"""Slivers are told from faults by their width alone, however long they are and wherever they lie."""

from __future__ import annotations

import math

import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from klayout import db

from maskfab.geometry.slivers import sift


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
