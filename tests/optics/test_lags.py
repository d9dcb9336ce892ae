"""The transfer function at any lag, against overlaps found in other ways, and what its error bars promise."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from klayout import db
from optics_cases import camera, clear_region, noise, panel, pupil
from scipy.optimize import brentq

from maskfab.base.model import Mtf, Panel, RadialMean
from maskfab.job.camera import Stop
from maskfab.optics import lags
from maskfab.optics.lags import LagTable, lag_table
from maskfab.optics.mtf import RINGS, area_under_radial_min, frequency_at, presampled_mtf
from maskfab.optics.psf import image_scale_um2
from maskfab.optics.pupil import Aperture, cut, panel_aperture
from maskfab.optics.rim import RimParts, _bits

STOPS = {
    "circle": Stop("circle", 61.3),
    "small circle": Stop("circle", 30.0),
    "square": Stop("square", 61.3),
    "ellipse": Stop.ellipse(61.3, 40.0),
    "rectangle": Stop.rectangle(43.1, 61.3),
    "annulus": Stop.annulus(61.3, 27.0),
    "annulus that cuts dots far from its dark middle": Stop.annulus(61.3, 36.0),
}

SHAPES = ("circle", "circle", "square")

# Units of polygons per micrometre, and sides of a round edge.
UNITS, SIDES = 1e5, 4_096


def outline(stop: Stop) -> db.Region:
    """A stop as polygons, round ones of their exact area."""
    if not stop.round:
        return db.Region(db.Polygon([db.Point(round(x * UNITS), round(y * UNITS)) for x, y in stop.corners_um]))
    angle = 2 * np.pi * np.arange(SIDES) / SIDES
    larger = np.sqrt(2 * np.pi / SIDES / np.sin(2 * np.pi / SIDES))
    rings = []
    for share in (1.0, stop.inner_share):
        x, y = (share * side / 2 * larger * UNITS for side in stop.sides_um)
        corners = np.rint(np.stack([x * np.cos(angle), y * np.sin(angle)], axis=1)).astype(int)
        rings.append(db.Region(db.Polygon([db.Point(*corner) for corner in corners.tolist()])))
    return rings[0] - rings[1] if stop.inner_share else rings[0]


def overlaps(laid_out: Panel, stop: Stop, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Area shared by polygons and their shifted copies over their own, at lags of whole units."""
    clear = clear_region(laid_out)
    clear.transform(db.ICplxTrans(UNITS / 1e3))
    clear &= outline(stop)
    moved = [clear.moved(round(a * UNITS), round(b * UNITS)) for a, b in zip(x, y, strict=True)]
    return np.array([(clear & each).area() for each in moved]) / clear.area()


def some_lags(count: int, farthest: float) -> tuple[np.ndarray, np.ndarray]:
    """Half-dot lags of 8 um dots, others of less than a dot, and others."""
    random = np.random.default_rng(7)
    x = np.concatenate(
        [[4.0, 0.0, 4.0, -4.0], random.uniform(-8, 8, count), random.uniform(-farthest, farthest, count)]
    )
    y = np.concatenate([[0.0, 4.0, 4.0, 4.0], random.uniform(-8, 8, count), random.uniform(-farthest, farthest, count)])
    return np.round(x, 5), np.round(y, 5)


@pytest.mark.parametrize("gutter_nm", [0, 2000])
@pytest.mark.parametrize("name", STOPS)
def test_any_lag_is_the_overlap_of_shifted_polygons(name: str, gutter_nm: int) -> None:
    laid_out = panel(noise(5, 0.6, 1), cells=3, seed=2, gutter_nm=gutter_nm)
    x, y = some_lags(3, 50.0)
    table = lag_table(pupil(laid_out, STOPS[name]))
    expected = overlaps(laid_out, STOPS[name], x, y)
    assert abs(table.otf(x, y) - expected).max() < 5e-8
    assert table.uncertainty < 1e-12


@pytest.mark.parametrize(
    ("diameter", "count"),
    [(50.0, 2000), (413.7, 300), *(pytest.param(d, 2000, marks=pytest.mark.slow) for d in (413.7, 2000.0, 8000.0))],
)
def test_open_stop_has_the_closed_form_at_any_lag(diameter: float, count: int) -> None:
    """(2/π)(acos s - s sqrt(1 - s²)), Goodman 6.32."""
    laid_out = panel(np.ones((5, 5), dtype=np.bool_), cells=int(diameter / 40) + 2)
    table = lag_table(pupil(laid_out, Stop("circle", diameter)), min(diameter, 400.0))
    random = np.random.default_rng(3)
    reach = table.reach_um / np.sqrt(2)
    lag, angle = reach * random.random(count), random.uniform(0, 2 * np.pi, count)
    s = lag / diameter
    expected = 2 / np.pi * (np.arccos(s) - s * np.sqrt(1 - s**2))
    found = table.otf(lag * np.cos(angle), lag * np.sin(angle))
    assert abs(found - expected).max() <= table.uncertainty < 1e-10


def scanned(aperture: Aperture, radius: float, x: float, y: float, rows: int = 400) -> float:
    """The autocorrelation of dots of any transmission inside a circle, line by line between the ends of dots."""
    along, up = aperture.x.edges_um(), aperture.y.edges_um()
    ends = np.concatenate([up, up - y, [-radius, radius, -radius - y, radius - y]])
    ends = np.unique(np.clip(ends, max(-radius, -radius - y), min(radius, radius - y)))
    steps = np.diff(ends)[:, None] / rows
    place = (ends[:-1, None] + steps * (np.arange(rows) + 0.5)).ravel()
    half = np.sqrt(np.clip(radius**2 - np.stack([place, place + y]) ** 2, 0, None))
    row = np.searchsorted(up, [place, place + y]) - 1
    held = (row >= 0) & (row < up.size - 1)
    first, second = aperture.transmission[np.where(held, row, 0)] * held[..., None]
    near, far = half[..., None]
    low = np.maximum(np.maximum(along[:-1], -near)[:, :, None], np.maximum(along[:-1], -far)[:, None] - x)
    high = np.minimum(np.minimum(along[1:], near)[:, :, None], np.minimum(along[1:], far)[:, None] - x)
    weight = np.repeat(steps, rows)
    return float(np.einsum("r,ri,rj,rij->", weight, first, second, np.clip(high - low, 0, None), optimize=True))


@pytest.mark.parametrize("gutter_nm", [0, 3000])
def test_dots_of_any_transmission(gutter_nm: int) -> None:
    aperture = panel_aperture(panel(noise(3, 0.7, 4), cells=2, gutter_nm=gutter_nm))
    dimmed = aperture.transmission * np.random.default_rng(5).uniform(0.1, 1, aperture.transmission.shape)
    aperture = replace(aperture, transmission=dimmed)
    table = lag_table(cut(aperture, Stop("circle", 41.0)))
    whole = scanned(aperture, 20.5, 0.0, 0.0)
    for x, y in ((4.0, 0.0), (1.3, -2.9), (-13.7, 6.1), (22.0, 9.0)):
        found = table.otf(np.array([x]), np.array([y]))[0]
        assert found == pytest.approx(scanned(aperture, 20.5, x, y) / whole, abs=1e-6)


@pytest.mark.parametrize("name", STOPS)
def test_parts_of_cut_dots_add_up_to_them(name: str) -> None:
    """Closed forms of all quadrants and of the dark middle, against moments integrated node by node."""
    source = pupil(panel(noise(5, 0.6, 1), cells=3, seed=2), STOPS[name])
    x, y = (
        np.stack([lattice.edges_um()[at], lattice.edges_um()[at + 1]])
        for lattice, at in ((source.x, source.rim_column), (source.y, source.rim_row))
    )
    parts = RimParts.of(source.stop, x, y, source.rim_transmission)
    clear = np.bincount(parts.dot, parts.table[-1, 1])
    dot_um2 = (x[1] - x[0]) * (y[1] - y[0])
    assert clear == pytest.approx(source.rim_moments[:, 0, 0] * dot_um2, abs=1e-9)
    assert (parts.dot[: source.rim_row.size] == np.arange(source.rim_row.size)).all()


@pytest.mark.parametrize("gutter_nm", [0, 2000])
def test_a_grid_of_lags_is_every_lag_of_it(gutter_nm: int) -> None:
    table = lag_table(pupil(panel(noise(5, 0.6, 1), cells=3, seed=2, gutter_nm=gutter_nm), STOPS["circle"]))
    x, y = np.linspace(-70, 70, 37), np.linspace(-13, 65, 23)
    one_by_one = table.coarse_otf(*np.meshgrid(x, y))
    assert abs(table.coarse_grid(x, y) - one_by_one).max() < 1e-14
    assert one_by_one.max() > 0.5


def test_the_axes_of_the_mtf_are_exact() -> None:
    setting = camera(400.0)
    table = lag_table(pupil(panel(noise(9, 0.5, 2), cells=6, seed=4), setting.stop))
    cuts = presampled_mtf(table, setting, 530.0).cuts
    frequency = 0.5 / setting.pixel_um * np.arange(RINGS) / (RINGS - 1)
    lag, none = image_scale_um2(setting, 530.0) * frequency, np.zeros(RINGS)
    pixel = np.sinc(frequency * setting.pixel_um)
    for name, along in (("horizontal", (lag, none)), ("vertical", (none, lag))):
        expected = np.where(lag < 400.0, abs(table.otf(*(np.minimum(each, 400.0) for each in along))), 0.0) * pixel
        assert abs(cuts[name] - expected).max() <= table.coarse_uncertainty
        near = lag < 24.0
        assert abs(cuts[name] - expected)[near].max() < 1e-13


@pytest.mark.parametrize("name", STOPS)
def test_lag_zero_and_the_volume_are_exact(name: str) -> None:
    """The integral of an autocorrelation is the square of the integral."""
    source = pupil(panel(noise(5, 0.6, 1), cells=3, seed=2, gutter_nm=1000), STOPS[name])
    table = lag_table(source)
    assert table.otf(np.zeros(1), np.zeros(1))[0] == pytest.approx(1.0, abs=1e-12)
    assert table.energy_um2 == pytest.approx(source.energy_um2, rel=1e-12)
    assert table.volume_um2 == pytest.approx(source.field_integral_um2**2 / source.energy_um2, rel=1e-10)


@pytest.mark.parametrize(("mask", "diameter"), [(noise(9, 0.25, 1), 400.0), (np.ones((9, 9), dtype=np.bool_), 600.0)])
def test_the_coarse_bar_holds_near_zero_and_beyond(mask: np.ndarray, diameter: float) -> None:
    """Half a dot from lag 0 is where means alone are worst: a sensor of 4 um pixels asks for that."""
    table = lag_table(pupil(panel(mask, cells=10, seed=3), Stop("circle", diameter)))
    random = np.random.default_rng(11)
    radius, angle = np.exp(random.uniform(0, np.log(diameter), 300)), random.uniform(0, np.pi, 300)
    x = np.concatenate([[4.0, 0.0, 4.0, -4.0], radius * np.cos(angle)])
    y = np.concatenate([[0.0, 4.0, 4.0, 4.0], radius * np.sin(angle)])
    error = abs(table.coarse_otf(x, y) - table.otf(x, y))
    far = np.hypot(x, y) > 3 * 8.0
    assert error.max() <= table.coarse_uncertainty <= 10 * error.max()
    bounds = table.error_at(x, y, coarse=True)
    assert (error <= bounds).all()
    assert bounds[far].max() <= 10 * error[far].max()


def ring_minima(table: LagTable, line_nm: float) -> np.ndarray:
    """Every lag of the rings one by one, as the statistics are defined."""
    setting = camera()
    step = 0.5 / setting.pixel_um / (RINGS - 1)
    across, up = np.meshgrid(np.arange(1 - RINGS, RINGS), np.arange(RINGS))
    ring = np.rint(np.hypot(across, up)).astype(int)
    lag_x, lag_y = (image_scale_um2(setting, line_nm) * step * each for each in (across, up))
    seen = (ring < RINGS) & (np.hypot(lag_x, lag_y) < np.ptp(table.x.edges_um()))
    pixel = np.sinc(across * step * setting.pixel_um) * np.sinc(up * step * setting.pixel_um)
    value = np.zeros(ring.shape)
    value[seen] = abs(table.otf(lag_x[seen], lag_y[seen])) * pixel[seen]
    return np.array([value[ring == k].min() for k in range(RINGS)])


@pytest.mark.parametrize("periodic", [False, True])
def test_the_area_under_the_minimum_is_exact_but_for_its_bar(periodic: bool) -> None:
    """Behind slits in step many lags of a ring hold next to nothing, and not all of them are looked at closely."""
    mask = np.zeros((9, 9), dtype=np.bool_)
    mask[:, 3:6] = True
    laid_out = panel(mask, cells=6) if periodic else panel(noise(9, 0.8, 2), cells=6, seed=4)
    table = lag_table(pupil(laid_out, Stop("circle", 400.0)))
    mtf = presampled_mtf(table, camera(400.0), 530.0)
    error = abs(area_under_radial_min(mtf) - float(ring_minima(table, 530.0).mean()))
    assert error <= mtf.minimum_uncertainty < (1e-5 if periodic else 1e-10)


def test_mtf50_is_where_the_mean_over_all_directions_falls() -> None:
    setting = camera(400.0)
    table = lag_table(pupil(panel(noise(9, 0.5, 2), cells=6, seed=4), setting.stop))
    mtf = presampled_mtf(table, setting, 530.0)
    angle = np.pi * (np.arange(1000) + 0.25) / 1000
    scale = image_scale_um2(setting, 530.0)

    def mean(frequency: float) -> float:
        x, y = 1e-3 * frequency * np.cos(angle), 1e-3 * frequency * np.sin(angle)
        return float((abs(table.otf(scale * x, scale * y)) * np.sinc(2 * x) * np.sinc(2 * y)).mean())

    # Half a ring is 0.86 cy/mm.
    for level, most in ((0.5, 0.05), (0.3, 0.1), (0.1, 0.1)):
        found = frequency_at(mtf, level)
        assert found is not None
        frequency, bar = found
        assert bar < most
        assert mean(frequency - bar) > level > mean(frequency + bar)


@pytest.mark.parametrize("scenes", [range(3), pytest.param(range(3, 43), marks=pytest.mark.slow)], ids=["3", "40"])
def test_the_bar_of_a_fall_holds_the_truth_and_is_little_more(scenes: range) -> None:
    """Against the mean of 701 exact directions."""
    angle = np.pi * (np.arange(701) + 0.37) / 701
    ratios = []
    for scene in scenes:
        random = np.random.default_rng(scene)
        dots, dot, shape = int(random.integers(5, 14)), int(random.choice([4000, 8000])), random.choice(list(SHAPES))
        setting = camera(float(random.uniform(250, 700)), shape)
        gutter, seed = int(random.choice([0, 0, 0, 6000])), int(random.integers(100))
        cells = int(1.1 * setting.stop.diameter_um / (dots * dot + gutter) * 1e3) + 3
        opening = noise(dots, random.uniform(0.15, 0.9), seed)
        laid_out = panel(
            opening, cells=cells, seed=seed if random.random() < 0.5 else None, gutter_nm=gutter, dot_nm=dot
        )
        table, line = lag_table(pupil(laid_out, setting.stop)), float(random.choice([470.0, 530.0, 610.0]))
        mtf, scale = presampled_mtf(table, setting, line), image_scale_um2(setting, line)

        def mean(frequency: float, table: LagTable = table, scale: float = scale) -> float:
            x, y = 1e-3 * frequency * np.cos(angle), 1e-3 * frequency * np.sin(angle)
            return float((abs(table.otf(scale * x, scale * y)) * np.sinc(2 * x) * np.sinc(2 * y)).mean())

        for level in (0.5, 0.3, 0.1):
            frequency, bar = frequency_at(mtf, level) or (0.0, 0.0)
            if not 0 < frequency < mtf.frequency_cy_per_mm[-1] - bar:
                continue
            assert mean(frequency - bar) > level > mean(frequency + bar)
            true = brentq(
                lambda f, of=mean, level=level: of(f) - level, frequency - bar, frequency + bar, xtol=bar / 99
            )
            ratios.append(bar / max(abs(true - frequency), bar / 99))
    assert len(ratios) > 2 * len(scenes)
    # Three standard deviations of a mean over 32 directions, in steps that serve it better than drawn ones.
    assert np.median(ratios) <= 20


def test_a_curve_that_nearly_falls_before_has_a_bar_that_says_so() -> None:
    axis = np.linspace(0.0, 100.0, 11)
    curve = np.array([1.0, 0.8, 0.501, 0.6, 0.55, 0.52, 0.45, 0.4, 0.4, 0.4, 0.4])
    sure, unsure = (
        Mtf(axis, {}, 530.0, 0.0, 0.0, RadialMean(axis, curve, np.full(11, error))) for error in (1e-4, 2e-3)
    )
    assert frequency_at(sure, 0.5) == (pytest.approx(50 + 10 * 2 / 7), pytest.approx(10 * 1e-4 / 0.07))
    frequency, bar = frequency_at(unsure, 0.5) or (0.0, 0.0)
    assert frequency == pytest.approx(50 + 10 * 2 / 7)
    assert frequency - bar == pytest.approx(10 + 10 * (0.8 - 0.502) / 0.299)
    assert frequency_at(sure, 0.3) is None


@pytest.mark.parametrize("held", [1, 10**9], ids=["in many parts", "in place of its columns"])
@pytest.mark.parametrize("gutter_nm", [0, 2000])
def test_a_table_of_dots_laid_out_as_bytes_is_that_of_numbers(monkeypatch, held, gutter_nm):
    laid_out, stop = panel(noise(5, 0.6, 1), cells=3, seed=2, gutter_nm=gutter_nm), Stop("circle", 61.3)
    expected = lag_table(cut(panel_aperture(laid_out), stop), 20.0)
    monkeypatch.setattr(lags, "_MOST_HELD", held)
    seen = cut(panel_aperture(laid_out, as_bytes=True), stop)
    assert seen.whole.dtype == np.uint8
    table = lag_table(seen, 20.0)
    scale = expected.values.max()
    np.testing.assert_allclose(table.values, expected.values, atol=1e-14 * scale, rtol=0)
    x, y = np.random.default_rng(0).uniform(-20, 20, (2, 50))
    np.testing.assert_allclose(table.otf(x, y), expected.otf(x, y), atol=1e-14, rtol=0)


def test_clear_dots_are_bits_in_a_margin_unless_one_is_grey() -> None:
    """Of more rows than are looked at at a time, the first and the last with clear dots."""
    whole = (np.random.default_rng(1).random((2500, 9)) < 0.6).astype(np.float64)
    bits = _bits(whole)
    assert bits is not None
    np.testing.assert_array_equal(bits, np.pad(whole, 1))
    whole[2400, 3] = 0.5
    assert _bits(whole) is None
