"""A mask file from elsewhere is held to the design rules as a whole, drawn as it is and at the size that it has."""

from __future__ import annotations

import sys
import time
from pathlib import Path

import numpy as np
import pytest
from fuzz_originals import FEW
from hostile_files import arrayed, overlapping
from klayout import db
from small_job import command, edited, write_job
from sweeps import sweep

from maskfab.findings import foreign
from maskfab.findings.foreign import check_foreign
from maskfab.mask.comparison import faults
from maskfab.mask.process_limits import children_seconds

pytestmark = pytest.mark.usefixtures("read_here", "design_once")

DOT = 8000
KISSES = 100
"""The small opening has one kiss in each of 10 x 10 cells of a periodic die."""


def drawn(path: Path, *shapes) -> Path:
    layout = db.Layout()
    top = layout.create_cell("TOP")
    for shape in shapes:
        top.shapes(layout.layer(1, 0)).insert(shape)
    layout.write(str(path))
    return path


def added(*shapes):
    return lambda layout: [layout.top_cell().shapes(layout.layer(1, 0)).insert(shape) for shape in shapes]


def held(job, path, *limits: tuple[str, float], **more):
    """The rows of a file by their names; of rows of several dies the last."""
    section = job.spec.limits.model_copy(update=dict(limits))
    found = check_foreign(job.plate(), job.camera, section, path, **more)
    return {quantity.name: quantity for quantity in found.quantities}


def refused(rows) -> set[str]:
    return {name for name, quantity in rows.items() if quantity.passed is False}


def test_the_designs_own_file_keeps_every_rule(job, gds):
    rows = held(job, gds)
    assert refused(rows) == set()
    assert rows["rule_overlap"].value == rows["rule_manhattan"].value == rows["rule_extent"].value == 0


def test_a_limit_of_the_job_that_the_design_breaks_is_broken_by_the_designs_own_file(job, plate, gds):
    rows = held(job, gds, ("min_feature", 9.0))
    assert refused(rows) == {"rule_width"}
    width = rows["rule_width"]
    assert "the design itself has" in width.method
    assert "the job's limit" in width.method
    assert " um" in width.method
    assert width.unit == "places under 9000 nm"
    # What is clear is nowhere wider than 3 dots, and each cell has corners of one dot to tell at least.
    assert width.value > 2 * 100


def test_what_differs_adds_to_what_the_design_has(job, plate, gds, tmp_path):
    """Two bars a micrometre apart, far from all else, are one space more than the design has, and no width."""
    x, y = -9_000_000, 5_000_000
    bars = [db.Box(x, y, x + 20_000, y + 20_000), db.Box(x + 21_000, y, x + 41_000, y + 20_000)]
    before, after = (held(job, path) for path in (gds, edited(gds, tmp_path / "x.gds", added(*bars))))
    assert after["rule_space"].value == before["rule_space"].value + 1
    assert after["rule_width"].value == before["rule_width"].value
    assert refused(after) == {"xor_area", "rule_space"}
    assert "the smallest is 1000 nm" in after["rule_space"].method
    assert f"({(x + 20_000) / 1e3:g}, {y / 1e3:g}) um" in after["rule_space"].method
    assert "1 more where the file differs" in after["rule_space"].method


def test_a_notch_and_an_island_are_told(job, gds, tmp_path):
    x, y = -9_000_000, 5_000_000
    notched = db.Polygon(
        [db.Point(x + dx, y + dy) for dx, dy in (
            (0, 0), (0, 40_000), (20_000, 40_000), (20_000, 20_000), (22_000, 20_000), (22_000, 40_000),
            (50_000, 40_000), (50_000, 0),
        )]
    )  # fmt: skip
    ring = db.Region(db.Box(x, y - 90_000, x + 60_000, y - 30_000))
    ring -= db.Region(db.Box(x + 20_000, y - 60_000, x + 23_000, y - 57_000))
    dot = db.Box(x, y + 90_000, x + 2_000, y + 92_000)
    path = edited(gds, tmp_path / "x.gds", added(notched, *ring.each(), dot))
    before, after = held(job, gds), held(job, path)
    gained = {name: after[name].value - before[name].value for name in after if name.startswith("rule_")}
    assert gained["rule_notch"] == 1 + 2  # the notch, and both pairs of sides of the hole
    assert gained["rule_area"] == gained["rule_chrome_area"] == 1
    assert {"rule_notch", "rule_area", "rule_chrome_area"} <= refused(after)


def test_a_rule_that_the_file_mends_is_counted_down(job, plate, gds, tmp_path):
    """A die that is not there breaks nothing."""

    def drop(layout):
        layout.cell("PLAIN").clear()

    before, after = held(job, gds), held(job, edited(gds, tmp_path / "x.gds", drop))
    assert after["rule_corner_touch"].value == before["rule_corner_touch"].value - KISSES
    assert after["rule_corner_touch"].passed


def test_corners_that_kiss_are_no_space_and_hide_none(job, plate, gds, tmp_path):
    x, y = -9_000_000, 5_000_000
    kissing = [db.Box(x, y, x + 20_000, y + 20_000), db.Box(x + 20_000, y + 20_000, x + 40_000, y + 40_000)]
    near = db.Box(x + 40_500, y + 20_000, x + 60_000, y + 40_000)
    before = held(job, gds)
    one = held(job, edited(gds, tmp_path / "one.gds", added(*kissing)))
    two = held(job, edited(gds, tmp_path / "two.gds", added(*kissing, near)))
    assert one["rule_corner_touch"].value == before["rule_corner_touch"].value + 1
    assert "rule_space" not in refused(one)
    assert "the smallest is 500 nm" in two["rule_space"].method


@pytest.mark.parametrize("flat", [False, True])
def test_a_die_drawn_twice_is_told_though_nothing_differs(job, plate, gds, tmp_path, flat):
    def twice(layout):
        top, die = layout.top_cell(), layout.cell("PLAIN")
        (placed,) = [each for each in top.each_inst() if each.cell_index == die.cell_index()]
        if flat:
            top.shapes(layout.layer(1, 0)).insert(
                db.Region(die.begin_shapes_rec(layout.layer(1, 0))).transformed(placed.trans)
            )
        else:
            top.insert(db.CellInstArray(die.cell_index(), placed.trans))

    rows = held(job, edited(gds, tmp_path / "x.gds", twice))
    assert refused(rows) == {"rule_overlap"}
    assert rows["xor_area"].value == 0
    panel = plate.dies[0].panel
    area = panel.open_ratio * 100 * (panel.pitch_nm / 1e3) ** 2
    assert f"{area:g} um^2" in rows["rule_overlap"].method


@pytest.mark.parametrize(("name", "row"), [("main_plate#x", "rule_name_pattern"), ("A" * 33, "rule_name_length")])
def test_unusual_names_of_cells_are_told(job, gds, tmp_path, name, row):
    def rename(layout):
        layout.top_cell().name = name

    rows = held(job, edited(gds, tmp_path / "x.gds", rename))
    assert refused(rows) == {row}
    assert repr(name) in rows[row].method


def test_outlines_of_more_vertices_than_the_job_draws_are_told(job, gds):
    longest = 12  # the outline of the opening's largest part
    assert refused(held(job, gds, max_vertices=200)) == set()
    rows = held(job, gds, max_vertices=longest - 1)
    assert refused(rows) == {"rule_vertices"}
    assert "the job's max_vertices" in rows["rule_vertices"].method


def test_edges_at_an_angle_are_told_where_the_design_has_none(job, gds, tmp_path):
    x, y = -9_000_000, 5_000_000
    triangle = db.Polygon([db.Point(x, y), db.Point(x, y + 50_000), db.Point(x + 50_000, y)])
    rows = held(job, edited(gds, tmp_path / "x.gds", added(triangle)))
    assert rows["rule_manhattan"].value == 1
    assert {"rule_manhattan", "xor_area"} <= refused(rows)


def test_what_reaches_beyond_the_blank_is_told(job, plate, gds, tmp_path):
    far = plate.blank_nm // 2
    outside = db.Box(far - 50_000, 0, far + 30_000, 40_000)
    rows = held(job, edited(gds, tmp_path / "x.gds", added(outside)))
    assert rows["rule_extent"].value == 30
    assert {"rule_extent", "xor_area"} <= refused(rows)


def test_sizes_are_those_of_the_file_when_its_scale_is_undone(job, plate, gds, tmp_path):
    def stretch(layout):
        old = layout.top_cell().cell_index()
        layout.create_cell("STRETCHED").insert(db.DCellInstArray(old, db.DCplxTrans(1.001, 90, False, 0, 0)))

    rows = held(job, edited(gds, tmp_path / "x.gds", stretch))
    assert rows["cd_x_1x"].value == rows["cd_y_1x"].value == round(DOT * 1.001)
    assert rows["cd_x_2x"].value == round(2 * DOT * 1.001)
    assert {"lies", "cd_x_1x", "cd_y_5x"} <= refused(rows)
    # Clear dots of 8008 nm keep a limit of 8004 nm, those of the design do not.
    drawn_wide = held(job, tmp_path / "x.gds", ("min_feature", 8.004))
    assert "rule_width" not in refused(drawn_wide)
    assert "rule_width" in refused(held(job, gds, ("min_feature", 8.004)))


def test_a_file_unlike_the_design_is_told_what_it_is(job, tmp_path):
    """A grating of 3 um lines 5 um apart, before both stops."""
    lines = [db.Box(x, -1_000_000, x + 3000, 1_000_000) for x in range(-1_600_000, 1_600_000, 8000)]
    rows = held(job, drawn(tmp_path / "x.gds", *lines))
    assert rows["lies"].value.startswith("unlike the design")
    assert (rows["min_feature"].value, rows["min_space"].value) == (3, 5)
    assert rows["rule_width"].value == len(lines)
    assert rows["rule_space"].value == len(lines) - 1
    assert rows["stop_open_ratio"].value == pytest.approx(3 / 8, abs=0.01)
    assert rows["stop_open_ratio"].die == "TURNED"
    assert rows["mtf50"].value > 0
    assert rows["raster_psf_difference"].value < 1e-6
    assert {"lies", "rule_width", "rule_space", "mtf_difference"} == refused(rows)


def test_a_file_that_has_nothing_where_dies_are_is_looked_through_in_its_middle(job, tmp_path):
    x, y = 5_000_000, 6_000_000
    rows = held(job, drawn(tmp_path / "x.gds", db.Box(x, y, x + 600_000, y + 600_000)))
    assert rows["stop_open_ratio"].value == pytest.approx(1, abs=1e-6)
    assert rows["stop_open_ratio"].die is None
    assert "(5300, 6300) um" in rows["stop_open_ratio"].method
    assert rows["peak_strehl"].value == pytest.approx(1, abs=1e-4)
    assert rows["rule_extent"].passed


def test_a_hole_of_a_point_is_told_and_not_stumbled_over(job, tmp_path):
    rows = held(job, drawn(tmp_path / "x.gds", db.Box(0, 0, 1, 1)))
    assert "lies" in refused(rows)
    assert rows["min_feature"].value == 0.001
    assert rows["min_space"].value is None


def test_of_too_many_shapes_a_part_is_looked_at_and_that_is_said(job, tmp_path, monkeypatch):
    monkeypatch.setattr(faults, "MOST_LOOKED_ALONE", 50)
    lines = [db.Box(x, 0, x + 3000, 90_000) for x in range(0, 1_600_000, 8000)]
    rows = held(job, drawn(tmp_path / "x.gds", *lines))
    assert 20 <= rows["rule_width"].value <= 51
    assert rows["rule_width"].unit.endswith(", in part")
    assert "of more than 50 shapes, only those from (" in rows["rule_width"].method
    assert rows["min_feature"].value == 3


def test_the_command_names_the_die_of_every_row(capsys, gds, tmp_path):
    job = write_job(tmp_path)
    shown = command(capsys, "verify", gds, "--against", job, "--quiet")
    lines = [line.split() for line in shown.stdout.splitlines()]
    assert lines[1][:3] == ["quantity", "die", "at"]
    for row in ("corner_touches", "stop_open_ratio"):
        assert [line[1] for line in lines if line[0] == row] == ["PLAIN", "TURNED"]
    document = command(capsys, "verify", gds, "--against", job, "--quiet", "--json").document
    touches = [row["die"] for row in document["quantities"] if row["name"] == "corner_touches"]
    assert touches == ["PLAIN", "TURNED"]


def test_the_command_says_what_a_count_is_allowed_to_be(capsys, gds, tmp_path):
    shown = command(capsys, "verify", gds, "--against", write_job(tmp_path), "--quiet")
    (line,) = [line for line in shown.stdout.splitlines() if line.startswith("rule_corner_touch")]
    value = int(line.split()[1])
    assert value >= KISSES
    assert line.endswith(f"pass ({value} in the design)")


def test_the_jobs_limit_on_vertices_reaches_the_check(capsys, gds, tmp_path):
    job = write_job(tmp_path, ("[[die]]", "[export]\nmax_vertices = 5\n\n[[die]]"))
    rows = command(capsys, "verify", gds, "--against", job, "--quiet", "--json").document["quantities"]
    (vertices,) = [row for row in rows if row["name"] == "rule_vertices"]
    assert vertices["passed"] is False
    assert vertices["unit"] == "polygons over 5 vertices"


@pytest.mark.parametrize(
    ("corners", "width"),
    [
        ([(0, 0), (0, 40_000), (50_000, 0)], 0),
        ([(0, 0), (40_000, 40_000), (70_000, 10_000), (30_000, -30_000)], 30_000 * 2**0.5),
    ],
    ids=["an acute corner", "turned by 45 degrees"],
)
def test_the_least_width_of_slanted_outlines(job, plate, tmp_path, corners, width):
    path = drawn(tmp_path / "x.gds", db.Polygon([db.Point(*corner) for corner in corners]))
    rows = {row.name: row for row in check_foreign(plate, job.camera, job.spec.limits, path).quantities}
    assert rows["min_feature"].value == pytest.approx(width / 1e3, abs=1e-6)


def test_round_outlines_do_not_take_edges_squared(job, plate, tmp_path):
    """Seconds for what took minutes; the least distance between edges that turn by more than a quarter is told."""
    angle = 2 * np.pi * np.arange(300) / 300
    ring = np.rint(50_000 * np.stack([np.cos(angle), np.sin(angle)], axis=1)).astype(int).tolist()
    path = drawn(tmp_path / "x.gds", db.Polygon([db.Point(*corner) for corner in ring]))
    start = time.process_time()
    rows = {row.name: row for row in check_foreign(plate, job.camera, job.spec.limits, path).quantities}
    assert time.process_time() - start < 15
    assert 70 < rows["min_feature"].value < 100


CIRCLE = db.Polygon.ellipse(db.Box(0, 0, 10_000, 10_000), 64)


@pytest.mark.parametrize(
    ("drawing", "seconds"),
    sweep(
        [
            ((db.Box(0, 0, 1000, 1000), 2000, 100, 2), 10),
            ((db.Box(0, 0, 3, 3), 5, 120), 10),
            ((CIRCLE, 12_000, 100), 10),
            ((db.Polygon([db.Point(0, 0), db.Point(300, 900), db.Point(1000, 100)]), 3100, 30, 1, 11.3), 10),
            ((db.Box(0, 0, 5000, 5000), 2000, 100, 2), 10),
        ],
        1,
    ),
    ids=["nested", "tiny", "round", "turned", "overlapping"],
)
def test_few_bytes_that_draw_very_many_shapes_are_answered_soon(job, tmp_path, monkeypatch, drawing, seconds):
    """What the rules look at has a limit, whatever the shapes: some of these took longer than anybody waited."""
    monkeypatch.setattr(foreign, "optics_of_unlike", lambda *_: ())
    path = arrayed(tmp_path / "x.gds", *drawing)
    assert path.stat().st_size < 5000
    begun = time.process_time()
    rows = held(job, path)
    assert time.process_time() - begun < seconds
    assert {"lies", "rule_width"} <= refused(rows)
    assert rows["min_feature"].value is not None


def test_too_many_shapes_before_a_stop_are_not_measured_and_that_is_said(job, tmp_path, monkeypatch):
    monkeypatch.setattr(foreign, "MOST_SEEN_ALONE", 50)
    rows = held(job, arrayed(tmp_path / "x.gds", db.Box(0, 0, 1000, 1000), 30_000, 70))
    assert rows["optics"].passed is False
    assert "more than 50 shapes" in rows["optics"].method
    assert "mtf50" not in rows


@pytest.mark.skipif(sys.platform == "win32", reason="limits are those of POSIX")
@pytest.mark.usefixtures("within_limits")
def test_few_bytes_that_mean_work_without_end_are_refused_in_time(capsys, tmp_path):
    path = overlapping(tmp_path / "few.oas")
    assert path.stat().st_size < 1000
    before = children_seconds()
    shown = command(capsys, "verify", path, "--against", write_job(tmp_path, *FEW), "--quiet")
    assert children_seconds() - before < 3
    assert shown.code == 2
    assert "MF326" in shown.stderr
    assert "times over; the limit is 100" in shown.stderr
