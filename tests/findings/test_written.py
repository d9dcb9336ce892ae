"""The optics of a written die: against whole polygons and their overlaps, and what must not change."""

from __future__ import annotations

import tracemalloc
from dataclasses import replace

import numpy as np
import pytest
from klayout import db
from sweeps import sweep

from maskfab.base.errors import JobError
from maskfab.base.model import Die, Opening, Panel, Plate, Tiling, Track, orient
from maskfab.findings import as_written as module
from maskfab.findings.as_written import Written, measure_written
from maskfab.findings.optics import polygon_psf, stop_boundary
from maskfab.job.camera import Camera, Stop
from maskfab.job.process import Process, Roughness
from maskfab.mask.layout import clear_shapes, plate_layout
from maskfab.mask.writer import Reading, written_region
from maskfab.optics import metrics
from maskfab.optics.lags import lag_table
from maskfab.optics.mtf import presampled_mtf
from maskfab.optics.psf import image_scale_um2
from maskfab.optics.pupil import cut, panel_aperture
from maskfab.optics.stop_edges import edges_in_stop, stop_box
from maskfab.report.figures import die as written_figures
from maskfab.report.figures.die import bitmaps, written_pictures

CAMERA = Camera(5000.0, Stop("circle", 400.0), (610.0, 530.0, 470.0), 2.0, 128.0)
LINE = replace(CAMERA, wavelengths_nm=(530.0,), window_um=64.0)
MASK = np.random.default_rng(3).random((7, 7)) < 0.4
BAR = np.zeros((7, 7), dtype=bool)
BAR[1:6, 2:4] = True
PROCESS = Process(1.0, 0.2)
ROUGH = Roughness(0.5, 0.5)


def die(mask: np.ndarray = MASK, dot: int = 8000, gutter: int = 0, turn: int = 0) -> Die:
    # Turns alone: a turn of the whole panel then turns every cell by as much.
    cells = np.random.default_rng(5).integers(0, 4, (8, 8))
    turned = (orient(cells, turn) + turn) % 4
    panel = Panel(Opening("W", mask, dot), dot, gutter, turned.astype(np.int8), Tiling.RANDOM, 5)
    return Die("W", "W", panel, (0, 0), 8 * panel.pitch_nm)


def whole(which: Die, process: Process, reading: Reading) -> db.Region:
    """The written shape from polygons over the stop, with no tiles."""
    plate = Plate("P", "", which.slot_nm, which.slot_nm, (which,), (), (), ())
    shapes = clear_shapes(plate_layout(plate), stop_box(Stop("square", 440.0), (0.0, 0.0)))
    region = db.Region()
    for box in shapes.tolist():
        region.insert(db.Box(*box))
    return written_region(region, process, reading)


def value(written: Written, name: str, line: float | None = None) -> float:
    (found,) = (q for q in written.quantities if q.name == name and q.wavelength_nm == line)
    return found.value


@pytest.fixture(scope="module")
def written() -> Written:
    return measure_written(die(), CAMERA, PROCESS)


@pytest.fixture(scope="module")
def on_line() -> Written:
    """By one wavelength alone."""
    return measure_written(die(), LINE, PROCESS)


@pytest.mark.parametrize(
    ("which", "stop"),
    sweep(
        [
            (die(gutter=4000), CAMERA.stop),
            (die(), Stop("square", 301.0)),
            (die(), CAMERA.stop),
            (die(dot=7501), CAMERA.stop),
        ],
        2,
    ),
    ids=["gutter", "square stop", "no gutter", "odd dot"],
)
def test_the_psf_is_that_of_whole_polygons(which, stop):
    camera = replace(LINE, stop=stop)
    readings = measure_written(which, camera, PROCESS).readings
    assert set(readings) == set(Reading)
    for reading, optics in readings.items():
        edges, area = edges_in_stop(whole(which, PROCESS, reading), stop, (0.0, 0.0))
        assert optics.open_ratio * stop.area_um2 == pytest.approx(area, rel=2e-4)  # outlines of whole nanometres
        psf = polygon_psf(stop_boundary(edges, area, camera), camera, optics.psf)
        assert metrics.relative_difference(optics.psf, psf) < 2e-5, reading


@pytest.mark.parametrize("reading", list(Reading))
def test_the_mtf_is_the_overlap_of_the_polygons_with_themselves(written, reading):
    half = 200_000
    angle = 2 * np.pi * (np.arange(2048) + 0.5) / 2048
    rim = [db.Point(round(half * np.cos(a)), round(half * np.sin(a))) for a in angle]
    region = whole(written.die, PROCESS, reading) & db.Region(db.Polygon(rim))
    mtf = written.readings[reading].mtfs[1]
    pixel = np.sinc(mtf.frequency_cy_per_mm / 1e3 * CAMERA.pixel_um)
    for sample in (0, 3, 20, 41, 97, 146):
        lag = round(image_scale_um2(CAMERA, 530.0) * mtf.frequency_cy_per_mm[sample])
        exact = (region & region.moved(lag, 0)).area() / region.area() * pixel[sample]
        assert mtf.cuts["horizontal"][sample] == pytest.approx(exact, abs=mtf.uncertainty + 1e-4)
    assert mtf.uncertainty < 0.02


@pytest.mark.parametrize("gutter", sweep([4000, 0], 1))
def test_no_process_leaves_the_drawing(gutter):
    which = die(gutter=gutter)
    found = measure_written(which, LINE, Process(0.0))
    table = lag_table(cut(panel_aperture(which.panel), LINE.stop))
    for reading in Reading:
        assert value(found, f"written_psf_difference_{reading.value}", 530.0) < 1e-7
        for mtf, drawn in zip(found.readings[reading].mtfs, found.drawn, strict=True):
            design = presampled_mtf(table, LINE, mtf.wavelength_nm)
            for name, curve in design.cuts.items():
                assert abs(mtf.cuts[name] - curve).max() < design.uncertainty
                assert mtf.cuts[name] == pytest.approx(drawn.cuts[name], abs=1e-7)


def test_a_turned_die_has_the_same_numbers(on_line):
    turned = measure_written(die(turn=1), LINE, PROCESS)
    assert turned.kissing == on_line.kissing
    for mine, other in zip(on_line.quantities, turned.quantities, strict=True):
        assert mine.name == other.name
        assert other.value == pytest.approx(mine.value, rel=1e-6)


def test_light_follows_radius_and_bias(written):
    drawn = measure_written(die(), LINE, Process(0.0))
    open_only = measure_written(die(), LINE, Process(1.0))
    wider = measure_written(die(), LINE, Process(1.0, 0.4))

    def ratio(which: Written, reading: str) -> float:
        return value(which, f"written_open_ratio_{reading}")

    assert ratio(drawn, "fused") == ratio(drawn, "open")
    # A kissing corner is four quarter pieces apart between the readings.
    apart = (ratio(open_only, "fused") - ratio(open_only, "open")) * LINE.stop.area_um2
    assert apart == pytest.approx(4 * (1 - np.pi / 4) * open_only.kissing, rel=0.05)
    assert ratio(open_only, "fused") < ratio(written, "fused") < ratio(wider, "fused")


@pytest.fixture(scope="module")
def rough() -> Written:
    return measure_written(die(), CAMERA, replace(PROCESS, roughness=ROUGH))


def test_rough_edges_scatter_by_their_length(written, rough):
    """Outlines of whole polygons, with no tiles, inside the stop."""
    angle = 2 * np.pi * (np.arange(512) + 0.5) / 512
    rim = db.Region(db.Polygon([db.Point(round(2e5 * np.cos(a)), round(2e5 * np.sin(a))) for a in angle]))
    for reading in Reading:
        region = whole(written.die, PROCESS, reading)
        length = region.edges().inside_part(rim).length() / 1000
        area = (region & rim).area() / 1e6
        found = value(rough, f"written_scattered_{reading.value}")
        assert found == pytest.approx(length * ROUGH.sigma_um / np.sqrt(np.pi) / area, rel=0.01)
        mine, smooth = rough.readings[reading], written.readings[reading]
        assert mine.open_ratio == smooth.open_ratio
        assert 0 < metrics.relative_difference(mine.psf, smooth.psf) < 0.01


def test_the_mtf_of_rough_edges_is_the_mean_overlap(written, rough):
    """Edges that are off by chance on both copies of the openings: a mean over moves of twice their variance."""
    region = whole(written.die, PROCESS, Reading.FUSED) & db.Region(db.Box(-200_000, -200_000, 200_000, 200_000))
    nodes, weights = np.polynomial.hermite_e.hermegauss(6)
    moves = [
        (round(1000 * np.sqrt(2) * ROUGH.sigma_um * u), round(1000 * np.sqrt(2) * ROUGH.sigma_um * v), a * b)
        for u, a in zip(nodes, weights / weights.sum(), strict=True)
        for v, b in zip(nodes, weights / weights.sum(), strict=True)
    ]
    mine, smooth = (each.readings[Reading.FUSED].mtfs[1] for each in (rough, written))
    lags = image_scale_um2(CAMERA, 530.0) * mine.frequency_cy_per_mm / 1000
    sample = int(np.argmin(abs(lags - 56.0)))  # where the cells lie on each other
    lag = round(1000 * lags[sample])
    exact, plain = (
        sum(w * (region & region.moved(lag + x, y)).area() for x, y, w in each) for each in (moves, [(0, 0, 1.0)])
    )
    lost = 1 - mine.cuts["horizontal"][sample] / smooth.cuts["horizontal"][sample]
    # Parts of a dot blunt the notch, as wide as the edges are rough, but the uncertainty tells of it.
    assert 0.5 < lost / (1 - exact / plain) < 1.2
    off = abs(mine.cuts["horizontal"][sample] - smooth.cuts["horizontal"][sample] * exact / plain)
    assert off < mine.uncertainty
    assert exact < 0.99 * plain


def test_a_psf_needs_no_mtf(rough):
    found = module.written_psf_quantities(die(), CAMERA, replace(PROCESS, roughness=ROUGH))
    assert list(found) == [each for each in rough.quantities if "mtf50" not in each.name and "auc" not in each.name]


def test_shares_are_spread_by_the_variance_of_the_edges():
    one = np.zeros((1, 8, 8))
    one[0, 3, 4] = 1
    found = module._spread(one, 0.4)[0]
    at = np.arange(8)
    for axis, middle in ((1, 3), (0, 4)):
        profile = found.sum(axis=axis)
        assert profile.sum() == pytest.approx(1)
        assert (profile * (at - middle) ** 2).sum() == pytest.approx(0.16)
    assert module._spread(np.ones((1, 4, 4)), 0.4) == pytest.approx(np.ones((1, 4, 4)))


@pytest.mark.parametrize(
    ("roughness", "gutter", "cure"),
    [
        (Roughness(0.7, 1.0), 0, "sigma of at most 0.667 um"),
        (Roughness(0.1, 2.1), 0, "correlation of at most 2 um"),
        (Roughness(0.1, 1.0), 1000, "sigma of at most 0.0833 um"),
    ],
)
def test_edges_too_rough_for_the_dots_are_refused(roughness, gutter, cure):
    with pytest.raises(JobError, match=r"MF127.*rough.*job\.toml") as refused:
        measure_written(die(gutter=gutter), CAMERA, Process(0.0, 0.0, roughness), where="job.toml: process")
    assert cure in refused.value.cure


def test_openings_without_kissing_corners_have_one_reading():
    found = measure_written(die(BAR, gutter=8000), LINE, PROCESS)
    assert found.kissing == 0
    fused, opened = found.readings[Reading.FUSED], found.readings[Reading.OPEN]
    assert np.array_equal(fused.psf.values, opened.psf.values)
    assert value(found, "written_open_ratio_fused") == value(found, "written_open_ratio_open")


def test_cells_touch_across_their_borders():
    # One dot in a corner of each cell: alone it kisses nothing, but in turned neighbours it does.
    corner = np.zeros((7, 7), dtype=bool)
    corner[0, 0] = True
    assert measure_written(die(corner), LINE, PROCESS).kissing > 0
    assert measure_written(die(corner, gutter=4000), LINE, PROCESS).kissing == 0


def test_wires_do_not_count(on_line):
    panel = on_line.die.panel
    veil = Track("scan", "x", (((0, 20_000), (0, 30_000), (56_000, 30_000), (56_000, 20_000)),), False, 0.5)
    wired = replace(on_line.die, panel=replace(panel, tracks=(veil,)))
    found = measure_written(wired, LINE, PROCESS)
    assert [q.value for q in found.quantities] == [q.value for q in on_line.quantities]


def test_every_number_has_unit_method_and_error(written):
    places = [(q.name, q.wavelength_nm) for q in written.quantities]
    assert len(set(places)) == len(places) == 2 * (3 + 2 * 3)
    for quantity in written.quantities:
        assert quantity.die == "W"
        assert quantity.unit
        assert "corners of 1 um, bias 0.2 um" in quantity.method
        assert quantity.value is None or quantity.uncertainty < 0.05 * abs(quantity.value) + 1


def test_a_process_that_dots_do_not_bear_is_refused():
    with pytest.raises(JobError, match=r"MF127.*these are 8 um.*job\.toml"):
        measure_written(die(), CAMERA, Process(4.5), where="job.toml: process")
    with pytest.raises(JobError, match=r"MF127.*gutter of 0\.4 um"):
        measure_written(die(gutter=400), CAMERA, PROCESS)


def test_more_dots_than_memory_bears_are_refused():
    dots = Opening("FINE", np.eye(64, dtype=bool), 1000)
    panel = Panel(dots, 1000, 0, np.zeros((64, 64), dtype=np.int8), Tiling.PERIODIC, None)
    camera = replace(CAMERA, stop=Stop("circle", 4000.0))
    with pytest.raises(JobError, match=r"MF115.*larger dots than 1 um"):
        measure_written(Die("F", "F", panel, (0, 0), 64 * 64_000), camera, Process(0.3))


def test_one_table_of_lags_is_in_memory_and_at_most_one_copy(monkeypatch):
    tables = []

    def noted(*arguments):
        table = lag_table(*arguments)
        tables.append(table.values.nbytes)
        return table

    monkeypatch.setattr(module, "lag_table", noted)
    camera = replace(LINE, stop=Stop("circle", 560.0))
    tracemalloc.start()
    measure_written(die(gutter=8000), camera, PROCESS)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    # The table is made by doubling itself once; four of them stood side by side when it was kept and copied.
    assert peak < 2.6 * max(tables)


def test_figures_show_both_readings_and_are_the_same_twice(written):
    drawn = written_pictures(written)
    assert set(drawn) == {"written_corner", "written_psf", "written_mtf"}
    assert drawn == written_pictures(written)
    assert "fused" in drawn["written_corner"]
    assert all(picture.startswith("<img") for picture in drawn.values())
    assert all(file.startswith(b"\x89PNG") for file in bitmaps(written).values())


def shown_psfs(written: Written, monkeypatch) -> dict[str, np.ndarray]:
    """What the PSF's figure shows, by title."""
    sheets = []
    monkeypatch.setattr(written_figures, "image", lambda figure, words: sheets.append(figure) or "")
    written_pictures(written)
    (sheet,) = (figure for figure in sheets if any("intensity" in text.get_text() for text in figure.texts))
    return {axes.get_title(): np.asarray(axes.images[0].get_array()) for axes in sheet.axes if axes.get_title()}


def test_psfs_as_drawn_and_as_written_stand_on_one_scale(written, monkeypatch):
    shown = shown_psfs(written, monkeypatch)
    assert list(shown) == ["drawn", "written, fused", "written, open"]
    peak = written.drawn_psf.values.max()
    psfs = [written.drawn_psf, *(written.readings[reading].psf for reading in Reading)]
    for picture, psf in zip(shown.values(), psfs, strict=True):
        assert psf.wavelength_nm == written.drawn_psf.wavelength_nm
        # The picture has tenths of a decade.
        assert np.allclose(picture, np.log10(np.clip(psf.values / peak, 1e-6, 1)), rtol=0, atol=0.05 + 1e-12)
    assert shown["drawn"].max() == 0
    assert not np.allclose(shown["drawn"], shown["written, fused"], atol=1e-3)
    assert not np.allclose(shown["written, fused"], shown["written, open"], atol=1e-3)


def test_without_kissing_corners_there_is_one_written_psf(monkeypatch):
    shown = shown_psfs(measure_written(die(BAR, gutter=4000), LINE, PROCESS), monkeypatch)
    assert list(shown) == ["drawn", "written"]
