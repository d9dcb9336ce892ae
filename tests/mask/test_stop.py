"""Polygons cut by the stop against the same stop cut from whole dots, whose areas are integrals."""

from __future__ import annotations

import numpy as np
import pytest
from klayout import db
from optics_cases import camera, clear_region, noise, panel, pupil

from maskfab.findings.optics import polygon_psf, stop_boundary
from maskfab.job.camera import Stop
from maskfab.mask.raster import outline_coverage
from maskfab.optics.metrics import AREA_ERROR, relative_difference
from maskfab.optics.psf import point_psf
from maskfab.optics.stop_edges import (
    _MET_PER_SECOND,
    _cut_edges,
    cutting_box,
    edges_in_stop,
    stop_region,
    sweep_s,
    whole_or_away,
)


@pytest.mark.parametrize("diameter_um", [6.0, 11.0, 23.0, 50.0, 77.0, 97.3])
@pytest.mark.parametrize("dot_nm", [2000, 20_000])
def test_a_small_stop_keeps_area_and_psf_of_its_polygons_within_their_bars(diameter_um: float, dot_nm: int) -> None:
    laid_out = panel(noise(3, 0.6, dot_nm), dot_nm=dot_nm, cells=2 + int(diameter_um * 1e3 / (3 * dot_nm)), seed=4)
    setting = camera(diameter_um, window_um=100.0)
    source = pupil(laid_out, setting.stop)
    edges, area = edges_in_stop(clear_region(laid_out), setting.stop, (0.0, 0.0))
    assert abs(area - source.energy_um2) < AREA_ERROR / 5 * source.energy_um2
    points = point_psf(source, setting, 530.0)
    polygons = polygon_psf(stop_boundary(edges, area, setting), setting, points)
    # The bar that every difference to polygons is reported with.
    assert relative_difference(polygons, points) < 1e-8 / 4


def test_boxes_far_larger_than_their_stop_are_cut_like_regions() -> None:
    """Rows that a die's boxes run along reach metres beyond a stop refined to picometres."""
    boxes = np.array([[-2_000_000_000, -900, 2_000_000_000, 300], [700, 300, 4000, 2_000_000_000]])
    edges, area = edges_in_stop(boxes, Stop("circle", 5.0), (0.0, 0.0))
    x0, y0, x1, y1 = edges.T
    assert abs(edges).max() < 2.5 * (1 + 1e-6)
    half = np.sum(x0 * y1 - x1 * y0) / 2
    y = np.linspace(-0.9, 0.3, 200_001)
    strip = np.trapezoid(2 * np.sqrt(2.5**2 - y**2), y)
    x = np.linspace(0.7, np.sqrt(2.5**2 - 0.3**2), 200_001)
    corner = np.trapezoid(np.sqrt(2.5**2 - x**2) - 0.3, x)
    assert area == pytest.approx(strip + corner, rel=1e-8)
    assert half == pytest.approx(area, rel=1e-8)


@pytest.mark.parametrize("stop", [Stop("circle", 90.0), Stop("circle", 90.0, inner_share=0.4), Stop("square", 81.0)])
def test_only_polygons_at_the_rim_are_cut_and_the_rest_stay_as_they_are(monkeypatch, stop):
    """Against a boolean of all polygons; the axis lies between two nanometres."""
    random = np.random.default_rng(7)
    shapes = db.Region()
    for x, y in np.ndindex(26, 26):
        width, height = random.integers(800, 3600, 2).tolist()
        corners = [(0, 0), (0, height), (width // 2, height), (width, height // 3), (width, 0)]
        shapes.insert(db.Polygon([db.Point(3700 * x - 48_000 + dx, 3700 * y - 48_000 + dy) for dx, dy in corners]))
    shapes.merge(True, 1)
    axis = (0.5, -13.0)
    booleans = []

    def cut(region, *others):
        booleans.append(region.count())
        return _cut_edges(region, *others)

    monkeypatch.setattr("maskfab.optics.stop_edges._cut_edges", cut)
    edges, area = edges_in_stop(shapes, stop, axis)
    assert sum(booleans) < 0.3 * shapes.count()
    expected, expected_area = _cut_edges(shapes & cutting_box(stop, axis), stop, axis)
    # The boolean rounds to some thousandths of a nanometre.
    assert area == pytest.approx(expected_area, rel=2e-9)
    lines = np.linspace(-50, 50, 331)
    shares = [outline_coverage(each, lines, lines) for each in (edges, expected)]
    np.testing.assert_allclose(*shares, rtol=0, atol=1e-5)


@pytest.mark.parametrize(
    "stop",
    [
        Stop.annulus(90.0, 45.0),
        Stop.ellipse(90.0, 50.0),
        Stop.rectangle(60.0, 80.0),
        Stop.polygon([(-40, -30), (45, -20), (30, 35), (0, 5), (-35, 40)]),
    ],
    ids=lambda stop: stop.shape,
)
def test_a_box_is_told_to_lie_in_a_stop_or_off_it_unless_it_lies_at_the_rim(stop: Stop) -> None:
    """Against booleans of every box, also grown by a tenth of a micrometre, beyond which all is decided."""
    random = np.random.default_rng(5)
    middle, half = random.integers(-60_000, 60_000, (50, 2)), random.integers(100, 7000, (50, 2))
    low, high = middle - half, middle + half
    inside, outside = whole_or_away(stop.scaled(1e3, 1e3), *low.T.astype(float), *high.T.astype(float))
    assert min(inside.sum(), outside.sum()) >= 3
    region = stop_region(stop, 1e3)
    for held, away, lower, upper in zip(inside, outside, low, high, strict=True):
        box, grown = (db.Region(db.Box(*(lower - by).tolist(), *(upper + by).tolist())) for by in (0, 100))
        assert (grown - region).is_empty() <= held <= (box - region).is_empty()
        assert (grown & region).is_empty() <= away <= (box & region).is_empty()


def test_a_sweep_looks_at_all_edges_that_are_side_by_side() -> None:
    """Of a column of k boxes, 4 k edges: 2 k of them side by side along x, 2 on a third of the height along y."""
    column = db.Region([db.Box(0, 300 * k, 500, 300 * k + 100) for k in range(40)])
    height = 39 * 300 + 100
    expected = (160 * 80 / _MET_PER_SECOND, 160 * 2 * 40 * 100 / height / _MET_PER_SECOND)
    assert sweep_s(column) == pytest.approx(expected)
    assert sweep_s(column.transformed(db.Trans.M45)) == pytest.approx(expected[::-1])


@pytest.mark.parametrize("stop", [Stop("circle", 90.0), Stop.annulus(90.0, 45.0), Stop.ellipse(90.0, 60.0)])
def test_the_rim_of_a_stop_that_sides_touch_or_that_holds_none_is_whole(stop: Stop) -> None:
    """Sides tangent to the rim, or beyond it, and none within a hole."""
    whole = np.pi / 4 * np.prod(stop.sides_um) * (1 - stop.inner_share**2)
    for half in (45_000, 60_000):
        edges, area = edges_in_stop(db.Region(db.Box(-half, -half, half, half)), stop, (0.0, 0.0))
        assert area == pytest.approx(whole, rel=1e-14)
        x0, y0, x1, y1 = edges.T
        assert np.sum(x0 * y1 - x1 * y0) / 2 == pytest.approx(whole, rel=1e-8)
    assert edges_in_stop(db.Region(db.Box(50_000, -1, 60_000, 1)), stop, (0.0, 0.0))[1] == 0


def test_edges_of_touching_boxes_are_those_of_their_union() -> None:
    """Against the borders between squares of a random raster, piece by piece; the axis lies between two nanometres."""
    clear = np.random.default_rng(3).random((17, 23)) < 0.6
    row, column = np.nonzero(clear)
    boxes = np.stack([column, row, column + 1, row + 1], axis=1) * 10 - 100
    edges, area = edges_in_stop(boxes, Stop("square", 1.0), (0.5, 3.0))
    assert area == pytest.approx(1e-4 * clear.sum(), rel=1e-12)
    found = np.rint((edges * 1000 + np.tile((0.5, 3.0), 2) + 100) / 10).astype(int)
    assert len(found) < 0.7 * 4 * clear.sum()
    pieces = []
    for x0, y0, x1, y1 in found.tolist():
        steps = range(abs(x1 - x0) + abs(y1 - y0))
        dx, dy = np.sign([x1 - x0, y1 - y0]).tolist()
        pieces += [(x0 + k * dx, y0 + k * dy, dx, dy) for k in steps]
    padded = np.pad(clear.astype(int), 1)
    up, across = np.diff(padded, axis=0)[:, 1:-1], np.diff(padded, axis=1)[1:-1]
    wanted = [(int(x + (turn < 0)), int(y), int(turn), 0) for (y, x), turn in np.ndenumerate(up) if turn]
    wanted += [(int(x), int(y + (turn > 0)), 0, int(-turn)) for (y, x), turn in np.ndenumerate(across) if turn]
    assert sorted(pieces) == sorted(wanted)
