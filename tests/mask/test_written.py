"""The as-written shape: areas with formulas, what turning and toning must keep, and tiles against whole polygons."""

from __future__ import annotations

import math

import numpy as np
import pytest
from klayout import db

from maskfab.base.errors import JobError
from maskfab.base.model import Opening, Panel, Tiling
from maskfab.job.process import Process
from maskfab.mask.writer import (
    UNITS_PER_UM,
    Reading,
    check_process,
    configurations,
    sagitta_um,
    written_corners,
    written_region,
)

BOTH = pytest.mark.parametrize("reading", list(Reading))
MASK = np.random.default_rng(3).random((7, 7)) < 0.45


def square(side: int = 8000, x: int = 0, y: int = 0) -> db.Region:
    return db.Region(db.Box(x, y, x + side, y + side))


def panel(dot: int = 8000, gutter: int = 0) -> Panel:
    return Panel(Opening("W", MASK, dot), dot, gutter, np.zeros((2, 2), dtype=np.int8), Tiling.PERIODIC, None)


def drawn(mask: np.ndarray, dot: int) -> db.Region:
    region = db.Region()
    for y, x in np.argwhere(mask).tolist():
        region.insert(db.Box(x * dot, y * dot, (x + 1) * dot, (y + 1) * dot))
    return region


def same(a: db.Region, b: db.Region) -> bool:
    return (a ^ b).is_empty()


@BOTH
@pytest.mark.parametrize("radius", [0.5, 1.0, 3.0])
def test_a_rounded_square_loses_its_corners(reading, radius):
    written = written_region(square(), Process(radius), reading)
    assert written.area() == pytest.approx(64e6 - (4 - math.pi) * (radius * 1e3) ** 2, abs=20e3 * radius)
    fine = written_region(square(8000 * 16), Process(radius), reading, UNITS_PER_UM)
    assert fine.area() / UNITS_PER_UM**2 == pytest.approx(64 - (4 - math.pi) * radius**2, abs=2e-3 * radius)


@BOTH
@pytest.mark.parametrize("bias", [-0.4, 0.2])
def test_a_bias_moves_straight_edges_and_keeps_sharp_corners_sharp(reading, bias):
    written = written_region(square(), Process(0.0, bias), reading)
    assert same(written, square(8000 + round(bias * 1e3), -round(bias * 500), -round(bias * 500)))


@BOTH
@pytest.mark.parametrize("bias", [-0.4, 0.3])
def test_a_rounded_square_grows_by_its_perimeter(reading, bias):
    radius, growth = 1.0, bias / 2
    area, perimeter = 64 - (4 - math.pi) * radius**2, 32 - (8 - 2 * math.pi) * radius
    steiner = area + perimeter * growth + math.pi * growth**2
    written = written_region(square(8000 * 16), Process(radius, bias), reading, UNITS_PER_UM)
    assert written.area() / UNITS_PER_UM**2 == pytest.approx(steiner, abs=5e-3)


@BOTH
def test_no_process_changes_nothing(reading):
    region = drawn(MASK, 8000)
    written = written_region(region, Process(0.0), reading)
    assert same(written, region)
    expected = [str(polygon) for polygon in region.merged(reading is Reading.OPEN, 1).each()]
    assert [str(polygon) for polygon in written.each()] == expected


@BOTH
@pytest.mark.parametrize("bias", [-0.1, 0.0, 0.1])
def test_turning_and_mirroring_come_before_or_after(reading, bias):
    region, process = drawn(MASK, 8000), Process(1.0, bias)
    for turn in (db.Trans.R90, db.Trans.M0, db.Trans.M45):
        before = written_region(region.transformed(db.Trans(turn)), process, reading)
        after = written_region(region, process, reading).transformed(db.Trans(turn))
        assert (before ^ after).area() <= 2 * region.edges().length() / 8  # corners of arcs fall on other nanometres


@pytest.mark.parametrize("bias", [-0.3, 0.0, 0.3])
def test_what_is_fused_for_the_clear_is_open_for_the_dark(bias):
    frame = db.Region(db.Box(-40000, -40000, 96000, 96000))
    inside = db.Region(db.Box(-20000, -20000, 76000, 76000))
    region = drawn(MASK, 8000)
    clear = written_region(region, Process(1.0, bias), Reading.FUSED)
    dark = written_region(frame - region, Process(1.0, -bias), Reading.OPEN)
    assert (clear ^ (inside - dark)).area() < 1e-4 * region.area()


def test_a_kissing_corner_has_a_neck_or_a_gap_of_known_width():
    pair, radius = square() + square(8000, 8000, 8000), 1.0
    for bias in (0.0, 0.2):
        neck = (2 * (math.sqrt(2) - 1) * radius + bias) * 1e3
        gap = (2 * (math.sqrt(2) - 1) * radius - bias) * 1e3
        fused = written_region(pair, Process(radius, bias), Reading.FUSED)
        opened = written_region(pair, Process(radius, bias), Reading.OPEN)
        assert fused.count() == 1
        assert opened.count() == 2
        assert fused.width_check(round(neck) - 6).count() == 0
        assert fused.width_check(round(neck) + 6).count() > 0
        assert opened.space_check(round(gap) - 6).count() == 0
        assert opened.space_check(round(gap) + 6).count() > 0


def test_enough_bias_fuses_an_open_corner_and_parts_a_fused_one():
    pair = square() + square(8000, 8000, 8000)
    assert written_region(pair, Process(1.0, 1.0), Reading.OPEN).count() == 1
    assert written_region(pair, Process(1.0, -1.0), Reading.FUSED).count() == 2


@pytest.mark.parametrize("process", [Process(1.0), Process(1.0, 0.3), Process(0.6, -0.4), Process(0.0, 0.2)])
@BOTH
def test_tiles_laid_side_by_side_are_the_written_shape(process, reading):
    dot = 8 * UNITS_PER_UM
    whole = written_region(drawn(MASK, dot), process, reading, UNITS_PER_UM)
    tiles, area = db.Region(), 0.0
    corners = written_corners(8.0, process, reading, 4)
    for (row, column), held in np.ndenumerate(configurations(MASK)):
        tiles += corners[held].region.moved(column * dot, row * dot)
        area += corners[held].area_um2
    assert (whole ^ tiles).area() <= 4 * whole.count() * MASK.size  # rounding on the grid of the units
    assert area == pytest.approx(whole.area() / UNITS_PER_UM**2, rel=1e-9)


@BOTH
def test_a_tile_knows_its_area_thrice(reading):
    for corner in written_corners(8.0, Process(1.0, 0.2), reading, 4):
        assert corner.shares.sum() * 4 == pytest.approx(corner.area_um2, abs=1e-8)
        edges = np.concatenate([corner.outline_um, *corner.border_um])
        x0, y0, x1, y1 = edges.T
        assert (x0 * y1 - x1 * y0).sum() / 2 == pytest.approx(corner.area_um2, abs=1e-8)


def test_arcs_keep_to_the_circle_within_the_stated_sagitta():
    process = Process(1.0)
    written = written_region(square(8000 * 16), process, Reading.OPEN, UNITS_PER_UM)
    (polygon,) = written.each()
    points = np.array([(point.x, point.y) for point in polygon.each_point_hull()]) / UNITS_PER_UM
    near = points[(points < 1).all(axis=1)]
    assert len(near) > 10
    assert abs(np.hypot(*(1 - near).T) - 1).max() < sagitta_um(process) < 3e-3
    assert sagitta_um(Process(0.0, 0.2)) == 0


def test_finer_arcs_change_no_area():
    areas = [written_corners(8.0, Process(1.0, 0.2), Reading.FUSED, 2, sides)[1].area_um2 for sides in (16, 64, 256)]
    assert areas == pytest.approx([areas[-1]] * 3, abs=2e-4)


@pytest.mark.parametrize("process", [Process(4.1), Process(3.9, 0.3), Process(0.0, -8.0)])
def test_a_process_that_dots_do_not_bear_is_refused(process):
    with pytest.raises(JobError) as problem:
        check_process(process, panel(), "job.toml: process")
    assert problem.value.code == "MF127"
    assert "job.toml: process" in str(problem.value)


@pytest.mark.parametrize(
    ("process", "gutter", "cure"),
    [
        (Process(0.0, 30.0), 0, "a cd_bias of more than -8 um and less than 8 um"),
        (Process(0.0, -8.0), 0, "a cd_bias of more than -8 um and less than 8 um"),
        (Process(0.0, 30.0), 400, "a cd_bias of more than -8 um and less than 0.4 um"),
        (Process(1.0, 30.0), 0, "less than 8 um; its size and twice the corner radius are together at most a dot"),
        (Process(4.0, 2.0), 0, "a corner radius of at most 3 um"),
    ],
)
def test_the_cure_of_a_process_is_possible(process, gutter, cure):
    with pytest.raises(JobError) as problem:
        check_process(process, panel(gutter=gutter))
    assert problem.value.cure.startswith("Use larger dots, or ")
    assert problem.value.cure.endswith(cure)


def test_cells_must_not_grow_across_their_gutter():
    check_process(Process(0.1, 0.2), panel(gutter=400))
    with pytest.raises(JobError, match=r"MF127.*gutter of 0\.2 um"):
        check_process(Process(0.1, 0.2), panel(gutter=200))
    check_process(Process(4.0), panel())
