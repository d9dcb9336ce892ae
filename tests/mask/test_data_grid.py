"""The grid of a plate's data: every written vertex of every file lies on it, and what that took is told."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from small_job import finished, write_job
from sweeps import sweep

from maskfab.base.errors import JobError, OutputError
from maskfab.base.model import CLEAR
from maskfab.mask.composition import snapped
from maskfab.mask.figures import PolygonOptions, draw
from maskfab.mask.formats.table import read_layout
from maskfab.mask.houses.adaptation import fitted, kept_grid_nm
from maskfab.mask.houses.profiles import load_shop
from maskfab.mask.job import load_job
from maskfab.mask.layout import layer_info

pytestmark = pytest.mark.usefixtures("read_here")


def of_grid(grid, formats='["gdsii"]', order=""):
    return "[[die]]", f'[export]\nformats = {formats}\ngrid = "{grid}"\n\n{order}[[die]]'


def corners(layout):
    """Every vertex on CLEAR, each in the coordinates of the plate."""
    places = layout.top_cell().begin_shapes_rec(layout.find_layer(layer_info(CLEAR)))
    found = []
    while not places.at_end():
        polygon = places.shape().polygon.transformed(places.trans())
        found += [(point.x, point.y) for point in polygon.each_point_hull()]
        places.next()
    return np.array(found)


@pytest.mark.parametrize("grid_nm", sweep([5, 10], 1))
def test_every_vertex_of_every_file_lies_on_the_grid(tmp_path, grid_nm):
    formats = '["gdsii", "dxf_r12", "dxf_r2010", "cif"]'
    out = finished(tmp_path, of_grid(f"{grid_nm} nm", formats, '[order]\nchrome = "down"\n\n'))
    for name in ("SMALL.gds", "SMALL_R12.dxf", "SMALL_R2010.dxf", "SMALL.cif"):
        assert not (corners(read_layout(out / name)) % grid_nm).any()
        assert name.endswith("gds") or f"data grid of {grid_nm} nm" in (out / name).read_text()
    rows = {row["name"]: row for row in json.loads((out / "report.json").read_text())["plate"]}
    assert rows["drawn_snapped"]["value"] > 0
    assert f"data grid of {grid_nm} nm" in rows["drawn_snapped"]["method"]


def test_what_was_moved_is_counted(tmp_path):
    plain = load_job(write_job(tmp_path / "a")).plate()
    job = load_job(write_job(tmp_path / "b", of_grid("10 nm")))
    plate = job.plate()
    assert plain.snapped is None
    assert job.digest != load_job(write_job(tmp_path / "c", of_grid("5 nm"))).digest
    moved = snapped(plain, 10)
    pairs = zip(plain.marks, moved.marks, strict=True)
    marks = [(a.polygons, b.polygons) for a, b in pairs if a.layer.written]
    away = [
        np.hypot(*np.subtract(p, q)) for a, b in marks for one, two in zip(a, b, strict=True)
        if len(one) == len(two) for p, q in zip(one, two, strict=True)
    ]  # fmt: skip
    assert max(away) == pytest.approx(moved.snapped.farthest_nm)
    assert max(away) <= np.hypot(5, 5)
    assert np.count_nonzero(away) == moved.snapped.vertices > 0
    assert plate.snapped.grid_nm == 10
    assert [die.panel.dot_nm for die in plate.dies] == [die.panel.dot_nm for die in plain.dies]
    again = snapped(moved, 10).snapped
    assert again == moved.snapped  # what lies on the grid stays


@pytest.mark.parametrize(
    ("grid", "code", "said"),
    [
        ("7 nm", "MF107", "dot of die PLAIN is 8000 nm"),
        ("0.5 nm", "MF107", "grid"),
        ("2 um", "MF104", "coarser than 1 um"),
        ("0 nm", "MF104", "grid"),
        ("5", "MF103", "grid"),
    ],
)
def test_a_grid_that_the_dies_do_not_keep_is_refused(tmp_path, grid, code, said):
    with pytest.raises(JobError) as caught:
        load_job(write_job(tmp_path, of_grid(grid))).plate()
    assert caught.value.code == code
    assert said in str(caught.value)
    assert "export.grid" in caught.value.where


def test_a_cut_that_leaves_the_grid_is_refused(tmp_path):
    plate = snapped(load_job(write_job(tmp_path)).plate(), 5)
    slanted = replace(plate.marks[0], name="S", polygons=(((0, 0), (35, 5), (40, 40), (20, 55), (5, 35)),), layer=CLEAR)
    drawn = replace(plate, marks=(slanted,))
    assert draw(drawn).account.snapped.grid_nm == 5
    off = replace(slanted, polygons=(((0, 0), (36, 0), (40, 40)),))
    with pytest.raises(OutputError, match="MF413 S has a vertex at \\(36, 0\\) nm, off the data grid of 5 nm"):
        draw(replace(plate, marks=(off,)), PolygonOptions())


def test_a_house_has_the_grid_that_the_job_states(tmp_path):
    shop = load_shop("photomask_portal")
    plain, coarse = (
        load_job(write_job(tmp_path / name, *changes)).plate()
        for name, changes in (("a", ()), ("b", (of_grid("5 nm"),)))
    )
    assert (kept_grid_nm(plain, shop), kept_grid_nm(coarse, shop)) == (1, 5)
    assert fitted(plain, shop).snapped is None
    assert fitted(coarse, shop).snapped == coarse.snapped
