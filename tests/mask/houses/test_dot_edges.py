"""Edges of a plotter's dots: how far they lie from where they are drawn, what judges them, and what the papers say."""

from __future__ import annotations

import re
import time
import zipfile
from dataclasses import replace

import numpy as np
import pytest
from small_job import command, write_job

from maskfab.base.errors import JobError
from maskfab.base.model import Mark
from maskfab.base.units import parse_dpi
from maskfab.base.work import silent
from maskfab.job.shop import parse_shop
from maskfab.mask.comparison.files import read_back
from maskfab.mask.dots import NM_PER_INCH, DotGrid, die_edges_nm, die_raster
from maskfab.mask.formats.plate_bitmap import check_plate_dots, write_plate_tiff
from maskfab.mask.houses.files import dot_edges, files_of_job
from maskfab.mask.houses.profiles import load_shop
from maskfab.mask.job import load_job
from maskfab.mask.layout import plate_layout
from maskfab.mask.package.pack import compare_shops, pack, verify_package

pytestmark = pytest.mark.usefixtures("drawn_in_words", "read_here")

FORMATS = 'formats = ["gdsii", "plate_tiff", "plate_bmp"]'


def plotted(folder, dpi: str | None, *order: str, formats: str = FORMATS):
    """A small job that is plotted."""
    path = write_job(folder)
    stated = "" if dpi is None else f'dpi = "{dpi}"\n'
    path.write_text(path.read_text() + f"\n[export]\n{formats}\n{stated}\n[order]\n" + "\n".join(order) + "\n")
    return load_job(path)


@pytest.mark.parametrize("dpi", [6350, 10_160, 7001])
def test_every_edge_lies_from_the_nearest_border_of_dots_as_far_as_is_told(tmp_path, dpi):
    job = plotted(tmp_path, f"{dpi} dpi")
    plate = job.plate()
    told = dot_edges(plate, job.spec, None, ["plate_tiff"], dpi)
    side = DotGrid.of(plate, dpi).side
    borders = (np.arange(side + 1) - side / 2) * NM_PER_INCH / dpi
    for die, row in zip(plate.dies, told.errors[: len(plate.dies)], strict=True):
        clear = np.pad(die_raster(die), 1)
        edged = [(clear[:, 1:] != clear[:, :-1]).any(axis=0), (clear[1:] != clear[:-1]).any(axis=1)]
        edges = np.concatenate([lines[used] for lines, used in zip(die_edges_nm(die), edged, strict=True)])
        nearest = np.abs(edges[:, None] - borders[None, :]).min(axis=1) / 1000
        assert row.die == die.name
        assert row.largest_um == pytest.approx(nearest.max(), abs=1e-9)
        assert row.rms_um <= row.largest_um <= NM_PER_INCH / dpi / 2000 + 1e-9
    assert (told.errors[0].largest_um == 0) == (dpi == 6350)


def test_the_rms_weighs_edges_by_their_length(small_plate, tmp_path):
    # Dots of 1 um: upright edges 30 um long .2 and .3 um off, level ones 10 um long 0 and .5 um off.
    box = ((200, 0), (200, 30_500), (10_300, 30_500), (10_300, 0))
    plate = replace(small_plate, dies=(), marks=(replace(small_plate.marks[0], polygons=(box,), kind="cd"),))
    assert isinstance(plate.marks[0], Mark)
    (found,) = dot_edges(plate, plotted(tmp_path, None, formats="").spec, None, ["plate_bmp"], 25_400).errors
    assert found.largest_um == pytest.approx(0.5)
    mean = (30.5 * (0.2**2 + 0.3**2) + 10.1 * 0.5**2) / (2 * 30.5 + 2 * 10.1)
    assert found.rms_um == pytest.approx(mean**0.5)


def test_edges_are_judged_by_the_order_or_else_by_the_house_and_told_what_would_do(tmp_path):
    job = plotted(tmp_path, "10160 dpi", 'cd = { tolerance = "3 um" }')
    made = files_of_job(job.plate(), job.spec, [])
    assert made.edges.limit_um == 1.5
    assert made.edges.finding().passed is True
    strict = plotted(tmp_path, "10160 dpi", 'cd = { tolerance = "1.2 um" }')
    refused = files_of_job(strict.plate(), strict.spec, []).edges.finding()
    assert (refused.rule, refused.passed, refused.limit) == ("edge_error", False, 0.6)
    assert "12700 dpi, of which no edge is moved, or at 21167 dpi or more" in refused.cure
    # What it names would do.
    for dpi in (12_700, 21_167):
        assert dot_edges(strict.plate(), strict.spec, None, ["plate_bmp"], dpi).finding().passed
    plain = plotted(tmp_path, "10160 dpi")
    assert files_of_job(plain.plate(), plain.spec, []).edges.finding().passed is None
    house = load_shop("photoplotstore")
    promised = dot_edges(plain.plate(), plain.spec, house, ["plate_bmp"], 10_160)
    assert promised.limit_um == house.tolerance.of_width(4.0) / 2


def test_a_house_states_the_dots_of_its_plotter(tmp_path):
    house = parse_shop(
        'title = "Film"\nsources = []\n[accepts]\nformats = ["plate_tiff"]\ndpi = [6350, 12700]\n', "film", where="film"
    )
    made = pack(plotted(tmp_path, None), house, tmp_path / "film.zip")
    assert made.path is not None
    coarse = plotted(tmp_path, "8000 dpi")
    refused = pack(coarse, house, tmp_path / "film8.zip")
    assert refused.path is None
    (bid,) = compare_shops(coarse.spec, coarse.plate(), [house])
    assert [each for each in bid.findings if each.rule in ("dpi", "edge_error")] == [
        each for each in refused.findings if each.rule in ("dpi", "edge_error")
    ]
    assert not bid.taken
    (row,) = (each for each in refused.findings if each.rule == "dpi")
    assert (row.passed, row.value, row.limit) == (False, 8000, "6350 12700")


def test_a_package_holds_the_bitmap_and_the_sheet_its_edges(tmp_path):
    job = plotted(tmp_path, "12700 dpi", 'tone = "dark"', 'chrome = "down"')
    target = tmp_path / "plate.zip"
    made = pack(job, load_shop("photoplotstore"), target, ["plate_bmp"])
    assert [check.name for check in made.checks] == ["plate_bitmap_wrong_dots"]
    with zipfile.ZipFile(target) as archive:
        (sheet,) = (archive.read(name).decode() for name in archive.namelist() if name.endswith("order.txt"))
    lines = [line.strip() for line in sheet.splitlines() if "  " in line.strip()]
    said = {line.split("  ")[0]: line.split("  ", 1)[1].strip() for line in lines}
    assert said["plotter's dots"].startswith("12700 dpi; 1 (white) is digitized data")
    assert said["edges of the bitmap"].startswith("at most 0 um from where they are drawn, rms 0 um; at most 0.25 um")
    assert said["units"] == "1 dot = 2 um"
    checks = [check for check in verify_package(target) if check.passed is not None]
    assert all(check.passed for check in checks)
    assert "plate_bitmap_wrong_dots" in {check.name for check in checks}


def test_every_dot_is_read_back_and_edges_that_are_too_far_fail(tmp_path):
    job = plotted(tmp_path, "10160 dpi", 'cd = { tolerance = "1 um" }', 'tone = "dark"', 'chrome = "down"')
    made = files_of_job(job.plate(), job.spec, ["job 0123"])
    for product in made.products:
        product.write(tmp_path / product.name)
    rows = [*read_back(made, tmp_path, silent).quantities, *made.account()]
    assert [row.passed for row in rows if row.name == "plate_bitmap_wrong_dots"] == [True, True]
    failed = {(row.name, row.die) for row in rows if row.passed is False}
    assert failed == {("dot_edge_error", "PLAIN"), ("dot_edge_error", "TURNED"), ("dot_edge_error", None)}


@pytest.mark.parametrize(
    ("text", "code"),
    [("0 dpi", "MF104"), ("-1 dpi", "MF104"), ("nan dpi", "MF104"), ("inf dpi", "MF104"), ("1e6 dpi", "MF104"),
     ("25400.5 dpi", "MF104"), ("25400", "MF103"), (25_400, "MF103"), ("1 um", "MF103"), ("dpi", "MF103"),
     (None, "MF103")],
)  # fmt: skip
def test_dots_per_inch_are_whole_positive_and_told_as_such(text, code):
    with pytest.raises(JobError, match=code):
        parse_dpi(text)
    assert parse_dpi("25400 dpi") == 25_400


@pytest.mark.parametrize(
    ("dpi", "said"),
    [
        ("3000 dpi", "MF104.*larger than the smallest feature.*3175 dpi"),
        (None, "MF105.*dpi = "),
        ("254000 dpi", "MF415"),
    ],
)
def test_dots_that_lose_openings_fill_no_file_or_are_not_told_are_refused_before_any_work(tmp_path, capsys, dpi, said):
    job = plotted(tmp_path, dpi)
    made = command(capsys, "run", job.where, "--out", tmp_path / "out")
    assert made.code == 2
    assert not (tmp_path / "out").exists()
    assert re.search(said, made.stderr)


@pytest.mark.slow
def test_sixteen_thousand_million_dots_are_written_and_read_back_in_a_minute(tmp_path):
    job = load_job("layouts/upc12.toml")
    plate, path = job.plate(), tmp_path / "plate.tif"
    started = time.process_time()
    assert write_plate_tiff(plate, path, 25_400).side == 127_000
    assert check_plate_dots(plate, plate_layout(plate), path, 25_400, "clear").value == 0
    assert time.process_time() - started < 60
