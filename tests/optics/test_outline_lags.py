"""Lags of polygons on no grid: exact, with bars that are never below the truth, against booleans of polygons."""

from __future__ import annotations

import numpy as np
import pytest
from klayout import db

from maskfab.job.camera import Camera, Stop
from maskfab.mask.raster import aperture_in_stop, outline_coverage
from maskfab.optics.lags import axis_lags, lag_table
from maskfab.optics.mtf import area_under_radial_min, frequency_at, longest_lag_um, presampled_mtf
from maskfab.optics.outline_lags import OutlineLags, outline_lags
from maskfab.optics.psf import image_scale_um2
from maskfab.optics.pupil import Lattice, Pupil, cut
from maskfab.optics.stop_edges import edges_in_stop, stop_region

KINDS = ("boxes", "round", "turned", "triangles")
ROUND = Stop("circle", 200.0)
CAMERA = Camera(10_000.0, ROUND, (530.0,), 2.0, 64.0)


def polygons(kind: str, seed: int, reach_um: float = 130.0) -> db.Region:
    """Shapes off any grid, some of them cut by the stop, none of them alike."""
    random = np.random.default_rng(seed)
    pitch = random.uniform(31.0, 47.0)
    count = int(reach_um / pitch) + 1
    shapes = db.Region()
    for x, y in pitch * np.stack(np.meshgrid(*2 * [np.arange(-count, count)]), axis=-1).reshape(-1, 2):
        size = random.uniform(0.3, 0.9, 2) * pitch
        sides = {"boxes": 4, "round": 17, "turned": 4, "triangles": 3}[kind]
        angle = 2 * np.pi * (np.arange(sides) + 0.5) / sides
        turn = {"boxes": 0.0, "round": 0.0, "turned": 0.2, "triangles": seed}[kind]
        corner = size * np.stack([np.cos(angle), np.sin(angle)], axis=1) / np.sqrt(2)
        corner = corner @ np.array([[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]]) + (x, y)
        shapes.insert(db.Polygon([db.Point(*point) for point in np.rint(1000 * corner).astype(int).tolist()]))
    return shapes.merged(True, 1)


def of(shapes: db.Region, stop: Stop) -> OutlineLags:
    edges, area = edges_in_stop(shapes, stop, (0.0, 0.0))
    return outline_lags(shapes, stop, (0.0, 0.0), edges, area, outline_coverage)


def shared_um2(shapes: db.Region, stop: Stop, lag_um: tuple[float, float]) -> float:
    """By booleans of polygons on a grid of a thousandth of a nanometre."""
    finer = 1000.0
    cut_by_stop = shapes.transformed(db.ICplxTrans(finer)) & stop_region(stop, 1000 * finer)
    moved = cut_by_stop.moved(*(round(-1000 * finer * lag) for lag in lag_um))
    return float((cut_by_stop & moved).area()) / (1000 * finer) ** 2


STOPS = (
    ROUND,
    Stop.annulus(200.0, 80.0),
    Stop.ellipse(200.0, 140.0),
    Stop("square", 180.0),
    Stop.polygon(((-80.0, -90.0), (95.0, -60.0), (10.0, 99.0))),
)


@pytest.mark.parametrize("stop", STOPS, ids=lambda stop: f"{stop.shape}-{stop.inner_share:g}")
@pytest.mark.parametrize("kind", KINDS)
def test_what_polygons_share_with_themselves_is_exact(kind: str, stop: Stop) -> None:
    shapes = polygons(kind, 1)
    lags = np.array([(0.0, 0.0), (2.5, -1.25), (40.0, 61.5), (-75.5, 12.0), (120.0, 90.0), (199.0, 30.0)])
    found = of(shapes, stop).autocorrelation_um2(*lags.T)
    true = [shared_um2(shapes, stop, (x, y)) for x, y in lags.tolist()]
    # The booleans' circle has 4096 sides, and nanometres are a millionth of the stop's area there.
    np.testing.assert_allclose(found, true, rtol=0, atol=2e-8 * true[0])


@pytest.mark.parametrize("kind", KINDS)
def test_the_area_of_slanted_polygons_is_that_before_they_are_cut(kind: str) -> None:
    """Cut to a square first, on whole nanometres, edges turned: 5e-7 of the area of a small stop."""
    shapes = polygons(kind, 5)
    _, area = edges_in_stop(shapes, ROUND, (0.0, 0.0))
    assert area == pytest.approx(float(of(shapes, ROUND).autocorrelation_um2(np.zeros(1), np.zeros(1))[0]), rel=1e-8)


def raster_of(shapes: db.Region, stop: Stop, dot_um: float) -> Pupil:
    """Means over dots that no edge meets."""
    count = 2 * int(np.ceil(stop.diameter_um / dot_um / 2))
    lattice = Lattice(-count * dot_um / 2, count, 1, dot_um, dot_um)
    edges, _ = edges_in_stop(shapes, stop, (0.0, 0.0))
    return cut(aperture_in_stop(lattice, lattice, shapes, edges, stop, (0.0, 0.0)), stop)


def everywhere(lags: OutlineLags, step_um: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Numbers of steps across and up of lags that are not 0 by the stop's width alone, and exact values there."""
    most = int(lags.stop.diameter_um / step_um)
    up, across = np.meshgrid(np.arange(most + 1), np.arange(-most, most + 1), indexing="ij")
    up, across = (steps[np.hypot(up, across) < most] for steps in (up, across))
    return across, up, lags.autocorrelation_um2(step_um * across, step_um * up)


def held(kind: str, seed: int) -> None:
    """No bar of a mask is below the truth, and that of the AUC is next to none."""
    shapes = polygons(kind, seed)
    lags = of(shapes, ROUND)
    pupil = raster_of(shapes, ROUND, 0.9)
    table = lag_table(pupil, longest_lag_um(CAMERA), lags)
    area = table.energy_um2
    mtf = presampled_mtf(table, CAMERA, 530.0)
    nu = mtf.frequency_cy_per_mm / 1e3
    scale = image_scale_um2(CAMERA, 530.0)
    across, up, exact = everywhere(lags, scale * nu[1])
    values, bounds = lags.on_lattice(scale * nu[1], nu.size)
    error = abs(values[up, across + nu.size - 1] - exact)
    assert (error <= bounds[up, across + nu.size - 1]).all()
    # The least of every ring, of all its lags exactly.
    pixel = np.sinc(nu[abs(across)] * CAMERA.pixel_um) * np.sinc(nu[up] * CAMERA.pixel_um)
    ring, least = np.rint(np.hypot(across, up)).astype(int), np.full(nu.size, np.inf)
    np.minimum.at(least, ring, exact / area * pixel)
    least[ring.max() :] = 0.0
    stated = mtf.minimum_uncertainty
    assert abs(area_under_radial_min(mtf) - least.mean()) <= stated <= 1e-9
    angle = np.pi * (np.arange(180) + 0.5) / 180
    for level in (0.5, 0.3, 0.1):
        found = frequency_at(mtf, level)
        if found is None:
            continue
        frequency, bar = found
        ends = []
        for place in (frequency - bar, frequency + bar):
            x, y = place / 1e3 * np.cos(angle), place / 1e3 * np.sin(angle)
            optics = lags.autocorrelation_um2(scale * x, scale * y) / area
            ends.append((optics * np.sinc(x * CAMERA.pixel_um) * np.sinc(y * CAMERA.pixel_um)).mean() - level)
        assert ends[0] >= -1e-6 >= ends[1] - 2e-6, (kind, seed, level)
        # Wide where the curve is flat, and no wider than a curve known to a hundredth makes it.
        assert min(map(abs, ends)) < 0.01
    lag = np.random.default_rng(seed).uniform(0, 200, 40)
    for axis, places in zip(axis_lags(pupil, area), ((lag, 0 * lag), (0 * lag, lag)), strict=True):
        off = abs(axis.at(lag) - lags.autocorrelation_um2(*places)) / area
        # Dots that the rim cuts are rounded to whole nanometres.
        assert (off <= axis.error_at(lag, table) + 1e-7).all()


@pytest.mark.parametrize("kind", ["boxes", "round"])
def test_no_bar_of_a_mask_on_no_grid_is_below_the_truth(kind: str) -> None:
    held(kind, 5)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(10, 20))
@pytest.mark.parametrize("kind", KINDS)
def test_no_bar_of_forty_masks_on_no_grid_is_below_the_truth(kind: str, seed: int) -> None:
    held(kind, seed)


def stripes(turn: float, seed: int) -> db.Region:
    """A polygon of long teeth off any grid, turned by an angle."""
    random = np.random.default_rng(seed)
    corners = [(-110.0, -100.0)]
    for x in np.arange(-100.0, 100.0, 5.3):
        top, wide = random.uniform(-20.0, 95.0), random.uniform(1.5, 3.5)
        corners += [(x, -95.0), (x, top), (x + wide, top), (x + wide, -95.0)]
    corners += [(110.0, -95.0), (110.0, -100.0)]
    turned = np.array(corners) @ np.array([[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]])
    polygon = db.Polygon([db.Point(*point) for point in np.rint(1000 * turned).astype(int).tolist()])
    return db.Region(polygon).merged(True, 1)


def holed() -> db.Region:
    """Boxes with holes and boxes that touch, of which a region that is not merged holds each on its own."""
    shapes = polygons("boxes", 3) - db.Region(
        [db.Box(1000 * x, -70_001, 1000 * x + 777, 65_003) for x in range(-90, 90, 9)]
    )
    shapes += db.Region([db.Box(5000, 70_003, 25_001, 90_001), db.Box(25_001, 70_003, 40_003, 85_000)])
    return shapes.merged(True, 1)


DEAR = {
    "boxes": lambda: polygons("boxes", 5),
    "triangles": lambda: polygons("triangles", 2),
    "comb": lambda: stripes(0.0, 1),
    "level": lambda: stripes(np.pi / 2, 1),
    "slanted": lambda: stripes(0.3, 1),
    "holed": holed,
}


@pytest.mark.parametrize("kind", DEAR)
def test_bounds_hold_where_no_lag_is_exact(kind: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Of the lattice, the cuts, the least of every ring and the mean, against lags that booleans have proved exact."""
    shapes = DEAR[kind]()
    known = of(shapes, ROUND)
    lags = np.array([(3.0, 1.0), (-40.0, 61.5), (75.5, 12.0)])
    true = [shared_um2(shapes, ROUND, (x, y)) for x, y in lags.tolist()]
    np.testing.assert_allclose(known.autocorrelation_um2(*lags.T), true, rtol=0, atol=2e-8 * known.area_um2)
    monkeypatch.setattr("maskfab.optics.outline_lags._MOST_PAIRS", 0)
    dear = of(shapes, ROUND)
    assert known.pairs
    assert not dear.pairs
    area = dear.area_um2
    pupil = raster_of(shapes, ROUND, 0.9)
    table = lag_table(pupil, longest_lag_um(CAMERA), dear)
    mtf = presampled_mtf(table, CAMERA, 530.0)
    nu = mtf.frequency_cy_per_mm / 1e3
    scale = image_scale_um2(CAMERA, 530.0)
    across, up, exact = everywhere(known, scale * nu[1])
    values, bounds = dear.on_lattice(scale * nu[1], nu.size)
    error = abs(values[up, across + nu.size - 1] - exact)
    assert (error <= bounds[up, across + nu.size - 1]).all()
    pixel = np.sinc(nu[abs(across)] * CAMERA.pixel_um) * np.sinc(nu[up] * CAMERA.pixel_um)
    ring, least, most = np.rint(np.hypot(across, up)).astype(int), np.full(nu.size, np.inf), np.zeros(nu.size)
    np.minimum.at(least, ring, exact / area * pixel)
    np.maximum.at(most, ring, exact / area * pixel)
    least[ring.max() :] = 0.0
    assert abs(area_under_radial_min(mtf) - least.mean()) <= mtf.minimum_uncertainty < 0.2
    for name, x, y in (("horizontal", 1, 0), ("vertical", 0, 1), ("diagonal", 0.5**0.5, 0.5**0.5)):
        cut_of = known.autocorrelation_um2(scale * nu * x, scale * nu * y) / area
        cut_of = cut_of * np.sinc(nu * x * CAMERA.pixel_um) * np.sinc(nu * y * CAMERA.pixel_um)
        assert (abs(mtf.cuts[name] - cut_of) <= mtf.uncertainty).all()
    inner = np.arange(ring.max())
    assert (abs(mtf.cuts["radial_max"] - most)[inner] <= mtf.uncertainty).all()
    random = np.random.default_rng(1)
    x, y = random.uniform(-90, 90, (2, 60))
    off = abs(table.otf(x, y) - known.autocorrelation_um2(x, y) / area)
    assert (off <= table.error_at(x, y) + 1e-7).all()


def test_of_polygons_with_too_many_parts_none_is_left_out(monkeypatch: pytest.MonkeyPatch) -> None:
    """Slanted polygons beside boxes: all are known exactly, or no lag is."""
    shapes = polygons("boxes", 1) - db.Region(db.Polygon([db.Point(-90_000, 0), db.Point(0, 1), db.Point(9, -999)]))
    assert of(shapes, ROUND).pairs
    monkeypatch.setattr("maskfab.optics.outline_lags._MOST_PARTS_CUT", 100)
    assert not of(shapes, ROUND).pairs
