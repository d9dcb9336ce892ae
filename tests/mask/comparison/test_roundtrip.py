from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from klayout import db
from trips import roundtrip

from maskfab.base.errors import SourceError
from maskfab.base.model import CLEAR, WIRES, Gauge, Mark
from maskfab.mask.comparison.roundtrip import clear_length_nm, compare_layout
from maskfab.mask.dots import corner_touches, die_edges_nm, die_raster
from maskfab.mask.formats.dxf_writer import write_dxf
from maskfab.mask.formats.gdsii import write_gdsii, write_oasis
from maskfab.mask.layout import plate_layout

pytestmark = pytest.mark.usefixtures("read_here")

FORMATS = ("gds", "oas", "R12.dxf", "R2010.dxf")


def write(plate, folder, format_, layout=None):
    path = folder / f"plate.{format_}"
    layout = plate_layout(plate) if layout is None else layout
    if format_ == "gds":
        write_gdsii(layout, path)
    elif format_ == "oas":
        write_oasis(layout, path)
    else:
        write_dxf(plate, path, "R12" if format_.startswith("R12") else "R2010")
    return path


def by_name(quantities, name, die=None):
    (found,) = [each for each in quantities if each.name == name and each.die == die]
    return found


@pytest.mark.parametrize("format_", FORMATS)
def test_a_written_plate_comes_back_exactly(small_plate, tmp_path, format_):
    result = roundtrip(small_plate, plate_layout(small_plate), write(small_plate, tmp_path, format_))
    assert result.xor_area_um2 == 0
    assert result.differences == ()
    assert result.polygons == result.drawn_polygons
    assert result.rounding_nm == 0
    assert [(cd.drawn_nm, cd.read_nm, cd.delta_nm) for cd in result.cds] == [(2000, 2000, 0), (100_000, 100_000, 0)]
    for die, check in zip(small_plate.dies, result.dies, strict=True):
        assert (check.name, check.xor_area_um2, check.wrong_dots) == (die.name, 0, 0)
        assert check.corner_touches == corner_touches(die_raster(die))
    assert all(quantity.passed is not False for quantity in result.quantities())
    assert by_name(result.quantities(), "cd_x_2um").value == 2000
    assert by_name(result.quantities(), "readback_xor_area", "DENSE").value == 0
    assert by_name(result.quantities(), "corner_touches", "RANDOM").value > 0


@pytest.mark.parametrize("format_", FORMATS)
def test_a_file_of_the_same_cells_needs_no_booleans(small_plate, tmp_path, format_, monkeypatch):
    path = write(small_plate, tmp_path, format_)
    laid_over = []
    monkeypatch.setattr("maskfab.mask.comparison.roundtrip._xor", lambda *given: laid_over.append(given) or db.Region())
    roundtrip(small_plate, plate_layout(small_plate), path)
    assert not laid_over
    roundtrip(small_plate, displaced(plate_layout(small_plate), "TITLE", 1, 0), path)
    assert laid_over


def test_the_raster_of_a_die_is_built_without_the_layout(small_plate):
    die = small_plate.dies[0]
    x, y = die_edges_nm(die)
    raster = die_raster(die)
    assert raster.shape == (y.size - 1, x.size - 1) == (4 * 9, 5 * 9)
    assert (x[0], y[0], x[-1], y[-1]) == die.box_nm
    area = raster @ np.diff(x) @ np.diff(y)
    assert area == die.panel.orientations.size * die.panel.opening.clear_dots * die.panel.dot_nm**2


def displaced(layout, cell, dx, dy):
    """The layout with one polygon of one cell moved."""
    shapes = layout.cell(cell).shapes(layout.layer(1, 0))
    shape = next(shapes.each())
    moved = shape.polygon.moved(dx, dy)
    shapes.erase(shape)
    shapes.insert(moved)
    return layout


@pytest.mark.parametrize("format_", ["gds", "oas"])
def test_one_moved_letter_is_found_and_named(small_plate, tmp_path, format_):
    path = write(small_plate, tmp_path, format_, displaced(plate_layout(small_plate), "TITLE", 1, 0))
    result = roundtrip(small_plate, plate_layout(small_plate), path)
    (difference,) = result.differences
    assert difference.owner == "TITLE"
    assert difference.first_nm[1] >= 3_000_000
    assert 0 < result.xor_area_um2 < 10_000
    failed = by_name(result.quantities(), "readback_xor_area")
    assert failed.passed is False
    assert "TITLE" in failed.method
    assert all(die.xor_area_um2 == 0 for die in result.dies)


def test_a_moved_bar_shows_in_its_cd_too(small_plate, tmp_path):
    path = write(small_plate, tmp_path, "gds", displaced(plate_layout(small_plate), "CD_2UM", 5_000, 0))
    result = roundtrip(small_plate, plate_layout(small_plate), path)
    assert [difference.owner for difference in result.differences] == ["CD_2UM"]
    assert result.cds[0].read_nm == 1000
    assert by_name(result.quantities(), "cd_x_2um").passed is False


def test_a_cell_in_the_wrong_place_is_laid_to_its_die(small_plate, tmp_path):
    layout = plate_layout(small_plate)
    instance = next(layout.cell("DENSE").each_inst())
    instance.transform(db.Trans(0, 30))
    result = roundtrip(small_plate, plate_layout(small_plate), write(small_plate, tmp_path, "oas", layout))
    assert [difference.owner for difference in result.differences] == ["DENSE"]
    checks = {die.name: die for die in result.dies}
    assert checks["DENSE"].xor_area_um2 > 0
    assert checks["DENSE"].wrong_dots > 0
    assert checks["RANDOM"].xor_area_um2 == checks["PERIODIC"].xor_area_um2 == 0


def test_a_wrong_orientation_is_found_though_design_and_file_agree(small_plate, tmp_path):
    """The raster knows the openings and orientations themselves, not only the layout."""
    die = small_plate.dies[2]
    turned = replace(die.panel, orientations=(die.panel.orientations + 1) % 8)
    wrong = replace(small_plate, dies=(*small_plate.dies[:2], replace(die, panel=turned)))
    result = roundtrip(small_plate, plate_layout(wrong), write(wrong, tmp_path, "oas"))
    assert result.xor_area_um2 == 0
    assert [die.wrong_dots > 0 for die in result.dies] == [False, False, True]
    assert by_name(result.quantities(), "readback_wrong_dots", "RANDOM").passed is False


def test_a_lost_layer_is_a_difference_not_a_crash(small_plate, tmp_path):
    layout = plate_layout(small_plate)
    layout.clear_layer(layout.layer(1, 0))
    result = roundtrip(small_plate, plate_layout(small_plate), write(small_plate, tmp_path, "gds", layout))
    assert {difference.owner for difference in result.differences} == {"PERIODIC", "DENSE", "RANDOM", "TITLE", "CD_2UM"}
    assert result.polygons == 0


def test_stray_geometry_is_laid_to_what_is_nearest(small_plate, tmp_path):
    layout = plate_layout(small_plate)
    layout.top_cell().shapes(layout.layer(1, 0)).insert(db.Box(2_100_000, -500, 2_100_010, -490))
    result = roundtrip(small_plate, plate_layout(small_plate), write(small_plate, tmp_path, "oas", layout))
    (difference,) = result.differences
    assert (difference.owner, difference.layer) == ("CD_2UM", CLEAR)
    assert difference.first_nm == (2_100_000, -500)
    assert difference.area_um2 == pytest.approx(1e-4)


def test_a_second_top_cell_is_refused(small_plate, tmp_path):
    layout = plate_layout(small_plate)
    layout.create_cell("CONTEXT_INFO")
    with pytest.raises(SourceError, match="MF305"):
        roundtrip(small_plate, plate_layout(small_plate), write(small_plate, tmp_path, "gds", layout))


def test_dots_are_left_out_on_request(small_plate, tmp_path):
    result = roundtrip(small_plate, plate_layout(small_plate), write(small_plate, tmp_path, "gds"), dots=False)
    assert all(die.wrong_dots is None and die.corner_touches is None for die in result.dies)
    assert not [each for each in result.quantities() if each.name == "corner_touches"]


def test_clear_length_adds_up_what_a_gauge_crosses():
    layout = db.Layout()
    layout.dbu = 0.001
    shapes = layout.create_cell("TOP").shapes(layout.layer(1, 0))
    shapes.insert(db.Box(0, 0, 100, 50))
    shapes.insert(db.Box(90, 0, 130, 50))
    shapes.insert(db.Box(150, 0, 1000, 50))
    assert clear_length_nm(layout, Gauge("g", "x", (100, 25), 100, 0)) == 130 + 50
    assert clear_length_nm(layout, Gauge("g", "y", (50, 25), 100, 0)) == 50
    assert clear_length_nm(layout, Gauge("g", "x", (100, 60), 100, 0)) == 0


@pytest.mark.parametrize("seed", range(4))
def test_dies_whose_dots_are_exact_need_no_polygons_compared(small_plate, seed):
    """Faults of a nanometre and more, within dies, across their borders, between them and off the plate."""
    generator = np.random.default_rng(seed)
    design = plate_layout(small_plate)
    read = plate_layout(small_plate)
    read.flatten(read.top_cell().cell_index(), -1, True)
    shapes = read.top_cell().shapes(read.layer(1, 0))
    x0, y0, x1, y1 = small_plate.dies[seed % len(small_plate.dies)].box_nm
    corners = [(x0, y0), (x1, (y0 + y1) // 2), ((x0 + x1) // 2, y1 + 50_000), (-9 * x1 - 70_000_000, y0)]
    for x, y in corners[: seed + 1]:
        dx, dy = generator.integers(-700, 700, 2).tolist()
        shapes.insert(db.Box(x + dx, y + dy, x + dx + 1, y + dy + int(generator.integers(1, 900))))
    every, fewer = (
        compare_layout(small_plate, design, read, Path("x.gds"), dots_prove=prove) for prove in (False, True)
    )
    assert every.differences
    assert fewer.differences == every.differences
    assert fewer.dies == every.dies
    assert (fewer.differing ^ every.differing).is_empty()


@pytest.mark.parametrize("format_", FORMATS)
def test_wires_are_told_one_by_one_and_laid_over_each_other_where_they_differ(small_plate, tmp_path, format_):
    def wire(low: int) -> tuple[tuple[int, int], ...]:
        return ((0, low), (0, low + 3000), (90_000, low + 3000), (90_000, low))

    def wired(*wires: tuple[tuple[int, int], ...]):
        return replace(small_plate, marks=(*small_plate.marks, Mark("LINES", "wires", WIRES[0], wires)))

    plate = wired(wire(0), wire(6000))
    asked = plate, plate_layout(plate)
    assert roundtrip(*asked, write(plate, tmp_path, format_)).differences == ()
    moved = wired(wire(0), wire(6001))
    (found,) = roundtrip(*asked, write(moved, tmp_path, format_)).differences
    assert (found.layer, found.area_um2) == (WIRES[0], pytest.approx(2 * 90 * 0.001))
    # Cut in two, it covers what it covered.
    parts = tuple(tuple((x // 2 + half, y) for x, y in wire(0)) for half in (0, 45_000))
    assert roundtrip(*asked, write(wired(*parts, wire(6000)), tmp_path, format_)).differences == ()
