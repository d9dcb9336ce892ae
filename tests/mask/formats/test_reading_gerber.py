"""Gerber files of many regions: none is lost or mixed up, and what they hold is not kept as Python's numbers."""

from __future__ import annotations

import sys
import time
import tracemalloc
from pathlib import Path

import numpy as np
import pytest
from small_job import write_job

from maskfab.base.errors import MissingPackageError, SourceError
from maskfab.mask.formats import gerber, gerber_process
from maskfab.mask.formats.gerber import read_gerber
from maskfab.mask.formats.gerber_process import MOST_CURVES, content
from maskfab.mask.layout import left_out
from maskfab.runs import pipeline

HEAD = "%FSLAX46Y46*%\n%MOMM*%\n%ADD10C,0.002*%\nG01*\n%LPD*%\n"


def box(x: int, y: int = 0, side: int = 1000) -> str:
    corners = [(x, y), (x + side, y), (x + side, y + side), (x, y + side), (x, y)]
    return region(corners)


def region(corners: list[tuple[int, int]]) -> str:
    (x, y), *others = corners
    return f"G36*\nX{x}Y{y}D02*\n" + "".join(f"X{x}Y{y}D01*\n" for x, y in others) + "G37*\n"


def file(folder: Path, body: str) -> Path:
    path = folder / "x.gbr"
    path.write_text(f"{HEAD}{body}M02*\n")
    return path


def shapes(folder: Path, body: str):
    layout = read_gerber(file(folder, body))
    return [each.polygon for each in layout.top_cell().each_shape(0)]


def test_every_region_comes_however_many_there_are(tmp_path):
    count = 3_000
    read = shapes(tmp_path, "".join(box(2000 * n) for n in range(count)))
    assert sorted(each.bbox().left for each in read) == list(range(0, 2000 * count, 2000))
    assert {each.area() for each in read} == {1000**2}


def test_regions_of_unlike_size_keep_their_own_corners(tmp_path):
    corners = [[(5000 * n, 0), *((5000 * n + 100 * k, 1 + k * k) for k in range(1, n + 2))] for n in range(1, 9)]
    read = shapes(tmp_path, "".join(region([*each, each[0]]) for each in corners))
    assert [{(point.x, point.y) for point in each.each_point_hull()} for each in read] == list(map(set, corners))


def test_flashes_and_regions_cover_each_other_in_turn(tmp_path):
    body = box(0, side=9000) + "D10*\n%LPC*%\nX4000Y4000D03*\n" + box(1000) + "%LPD*%\n" + box(1200, 200, 100)
    area = sum(each.area() for each in shapes(tmp_path, body))
    assert area == pytest.approx(9000**2 - np.pi * 1000**2 - 1000**2 + 100**2, rel=1e-4)


def test_the_first_open_region_is_named(tmp_path):
    bad = region([(0, 0), (3_000_000, 0), (3_000_000, 1_000_000)])
    with pytest.raises(SourceError, match=r"MF310.*\(0\.0, 0\.0\) to \(3\.0, 1\.0\)"):
        read_gerber(file(tmp_path, box(0) + bad + region([(7, 7), (8, 7), (8, 8)]) + box(0)))


def test_numbers_beyond_all_reason_are_refused(tmp_path):
    with pytest.raises(SourceError, match="MF303"):
        read_gerber(file(tmp_path, box(10**400)))


def refusal(folder: Path, body: str) -> SourceError:
    with pytest.raises(SourceError) as caught:
        read_gerber(file(folder, body))
    return caught.value


def test_what_lies_near_two_metres_is_refused_before_anything_is_taken_from_it(tmp_path):
    """There klayout's coordinates overflow, and its booleans may never end."""
    far = region([(0, 0), (2147483647, 0), (2147483647, 2147483647), (0, 0)])
    error = refusal(tmp_path, far + "%LPC*%\n" + box(5) + far)
    assert (error.code, "limit is 1 m" in error.what) == ("MF313", True)


def test_flashes_by_the_hundred_thousand_are_refused_by_their_number(tmp_path):
    start = time.process_time()
    error = refusal(tmp_path, "D10*\n" + "D03*\n" * (MOST_CURVES + 1))
    assert (error.code, f"{MOST_CURVES + 1} flashes" in error.what) == ("MF313", True)
    assert time.process_time() - start < 1


def test_circles_with_too_many_corners_are_refused_as_they_are_counted(tmp_path, monkeypatch):
    monkeypatch.setattr(gerber_process, "MOST_CORNERS", 1000)
    with pytest.raises(SourceError, match="MF313"):
        content(file(tmp_path, "D10*\n" + "X0Y0D03*\n" * 50))


def test_many_flashes_are_where_they_should_be(tmp_path):
    body = "D10*\n" + "".join(f"X{9000 * n}Y{-500 * n}D03*\n" for n in range(40))
    centres = [each.bbox().center() for each in shapes(tmp_path, body)]
    assert [(each.x, each.y) for each in centres] == [(9000 * n, -500 * n) for n in range(40)]


def test_outlines_that_klayout_throws_at_are_told(tmp_path, monkeypatch):
    def thrown(*_):
        raise RuntimeError("Internal error: dbEdgeProcessor.cc:123 m_open.empty () was not true")

    monkeypatch.setattr(gerber._Drawing, "layout", thrown)
    error = refusal(tmp_path, box(0) + "%LPC*%\n" + box(5))
    assert (error.code, "m_open.empty" in error.what) == ("MF323", True)


def test_points_that_repeat_and_regions_without_area_are_counted(tmp_path):
    twice = [(0, 0), (9, 0), (9, 0), (9, 9), (0, 9), (0, 0), (0, 0)]
    layout = read_gerber(file(tmp_path, region(twice) + region([(0, 0), (9, 0), (0, 0)]) + box(50)))
    noted = left_out(layout)
    assert (noted.repeated_vertices, noted.empty_polygons, noted.texts) == (2, 1, 0)
    assert layout.top_cell().shapes(0).size() == 2


@pytest.mark.parametrize("diameter", [5, 2000, 10_000, 100_000])
@pytest.mark.parametrize("end", [None, (0, 0), (1, 0), (99, 77)])
def test_no_corner_of_a_circle_repeats_another(tmp_path, diameter, end):
    drawn = "X0Y0D03*\n" if end is None else "X0Y0D02*\nX{}Y{}D01*\n".format(*end)
    layout = read_gerber(file(tmp_path, f"%ADD11C,{diameter / 1e6:.6f}*%\nD11*\n{drawn}"))
    (polygon,) = (each.polygon for each in layout.top_cell().each_shape(0))
    noted = left_out(layout)
    assert noted.repeated_vertices == 0
    assert noted.curves == (1 if end is None else 2)
    assert polygon.bbox().height() == pytest.approx(diameter + (end or (0, 0))[1], abs=3)


def test_a_circle_of_no_size_is_an_empty_polygon(tmp_path):
    noted = left_out(read_gerber(file(tmp_path, "%ADD11C,0*%\nD11*\nX0Y0D03*\n" + box(0))))
    assert (noted.repeated_vertices, noted.empty_polygons) == (0, 1)


@pytest.mark.parametrize(
    ("statement", "said"),
    [
        ("%FSLAX46Y46*%\n", r"format statement \(%FS\)"),
        ("%MOMM*%\n", r"unit statement \(%MO\)"),
        ("%FSLAX46Y46*%\n%MOMM*%\n", r"format statement \(%FS\) and its unit statement \(%MO\)"),
    ],
)
@pytest.mark.parametrize("later", [False, True])
def test_a_statement_that_is_missing_or_comes_too_late_is_named(tmp_path, statement, said, later):
    path = tmp_path / "x.gbr"
    for head in (HEAD, HEAD.replace("%ADD10C,0.002*%\n", "")):
        path.write_text(f"{head.replace(statement, '')}{box(0)}{statement if later else ''}M02*\n")
        with pytest.raises(SourceError, match=rf"MF303 x\.gbr: missing before .* is its {said} "):
            read_gerber(path)


@pytest.mark.parametrize("polarity", ["%TF.FilePolarity,Negative*%\n", "G04 #@! TF.FilePolarity,Negative*\n"])
def test_a_file_that_says_it_is_negative_is_refused(tmp_path, polarity):
    assert len(shapes(tmp_path, polarity.replace("Negative", "Positive") + box(0))) == 1
    with pytest.raises(SourceError, match=r"MF315 x\.gbr says that its polarity is not positive"):
        read_gerber(file(tmp_path, polarity + box(0)))


def test_a_vertex_takes_few_bytes(tmp_path):
    turns, count = 40, 400
    sides = [(10 * k, 10 * (k % 2)) for k in range(turns)]
    comb = [*sides, (10 * turns, -10), (0, -10), (0, 0)]
    path = file(tmp_path, "".join(region([(x, y + 100 * n) for x, y in comb]) for n in range(count)))
    content(path)  # what is imported is no matter of vertices
    tracemalloc.start()
    content(path)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    # As pairs of numbers of Python a vertex took 120 bytes, besides the text and what is worked on.
    assert peak / (count * len(comb)) < 110


def test_a_plate_that_could_not_be_read_back_is_not_begun(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "gerbonara", None)
    job = write_job(tmp_path, ("[[die]]", '[export]\nformats = ["gdsii", "gerber"]\n\n[[die]]'))
    told = []
    with pytest.raises(MissingPackageError, match=r"MF152 .*\[gerber\]"):
        pipeline.run(job, tmp_path / "out", progress=lambda stage, *_: told.append(stage))
    assert not told
    assert not (tmp_path / "out").exists()


SILENT = [
    "G04 #@! %TF.Part,Single*", "G04 50% of *", "G4 a*", "G90*", "G71*", "%LNMASK*%", "%INMASK*%", "%IPPOS*%", "%SR*%",
    "%SRX1Y1I0J0*%", "%OFA0.0B0.0*%", "%SFA1.0B1.0*%", "%IR0*%", "%MIA0B0*%", "%ASAXBY*%", "%LMN*LR0*LS1.0*%",
    "%AMOC8*\n5,1,8,0,0,1.08239X$1,22.5*%",
]  # fmt: skip


@pytest.mark.parametrize("line", SILENT)
def test_commands_that_draw_nothing_are_passed_over(tmp_path, line):
    (polygon,) = shapes(tmp_path, f"{line}\n{box(2000)}{line}\n")
    assert polygon.bbox().to_s() == "(2000,0;3000,1000)"


def test_the_unit_may_be_stated_as_earlier_editions_had_it(tmp_path):
    path = file(tmp_path, box(2000))
    for code, width_nm in (("G70", 25400), ("G71", 1000)):
        path.write_text(f"{HEAD}{box(2000)}M02*\n".replace("%MOMM*%", f"{code}*"))
        layout = read_gerber(path)  # whose cells end with it
        assert layout.top_cell().bbox().width() == width_nm


@pytest.mark.parametrize(
    ("line", "cure"),
    [
        ("%IPNEG*%", "%IPPOS"),
        ("%OFA0.5B0*%", "Add the offset"),
        ("%SFA2B1*%", "Multiply"),
        ("%SRX2Y1I5J0*%", "Write every copy"),
        ("G91*", "absolute coordinates"),
        ("G70*", "State one unit"),
        ("%MIA1B0*%", ""),
        ("%IR90*%", ""),
        ("%ASAYBX*%", ""),
        ("%LS2*%", ""),
        ("%AMOC8*5,1,8,0,0,1,22.5*%%ADD11OC8,0.5*%", ""),
    ],
)
def test_commands_that_change_the_picture_are_refused_with_a_cure(tmp_path, line, cure):
    with pytest.raises(SourceError, match="MF315") as caught:
        read_gerber(file(tmp_path, f"{line}\n{box(2000)}"))
    assert cure in caught.value.cure
